"""The command that fits gains to logs: ``fit``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from vic_toolbox.cli.console import console_progress, print_table, say
from vic_toolbox.cli.options import MaybeFile, NewFolder
from vic_toolbox.cli.reading import Reading
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.fit_settings import FitSettings

Logs = Positional[Annotated[tuple[Path, ...], arg(metavar="FILE ...")]]


@dataclass(frozen=True)
class Fit:
    """Fit stiffness and damping over time to logs of poses, references and wrenches, and say how sure they are.

    Writes gains.csv, fit.json, report.html, estimate.npz and the figures into a folder. What the data do not
    determine is left out, and why is said. The same files and options give the same numbers: nothing is random.

    Example: vic fit log.csv --calibration rest.csv --out runs/fit
    """

    files: Logs = ()
    """Logs (CSV, TSV, npz, HDF5, ROS 1 and 2 bags); several of the same motion are pooled."""
    out: NewFolder = None
    """New folder for the results; by default runs/fit-NAME."""
    example: bool = False
    """Fit the demonstration that comes along: a hand guides a cup to its plate."""
    calibration: MaybeFile = None
    """Log of the same sensor, untouched, at rest in tilted poses: its bias and the tool's weight are taken out."""
    overwrite: bool = False
    """Replace a fit that is in the folder already."""
    settings: OmitArgPrefixes[FitSettings] = field(default_factory=FitSettings)
    reading: OmitArgPrefixes[Reading] = field(default_factory=Reading)

    def run(self) -> None:
        """Fit."""
        from vic_toolbox.experiments.fit_report import (
            FILES,
            HEAD,
            next_steps,
            refuse_folder,
            result_rows,
            write_fit,
        )
        from vic_toolbox.experiments.fit_summary import axis_summaries, in_one_number, verdict
        from vic_toolbox.experiments.fitting import EXAMPLE, EXAMPLE_SETTINGS, fit_logs
        from vic_toolbox.recordings import Layout

        files, calibration, layout = self.files, self.calibration, self.reading.stated()
        settings = self.settings
        if self.example:
            if files or calibration is not None or self.reading != Reading():
                raise InputError(
                    "--example brings its own log, calibration and reading options; leave yours out."
                )
            files, calibration = (EXAMPLE / "guided.npz",), EXAMPLE / "calibration.npz"
            layout = Layout.of(EXAMPLE / "guided.toml")
            settings = EXAMPLE_SETTINGS if settings == FitSettings() else settings
        name = "example" if self.example else files[0].stem if files else "nothing"
        out = self.out or Path("runs") / f"fit-{name}"
        refuse_folder(out, overwrite=self.overwrite)
        with console_progress() as progress:
            fit = fit_logs(
                files,
                settings,
                layout=layout,
                stamps=self.reading.stamps,
                repair=self.reading.repair,
                calibration=calibration,
                progress=progress,
            )
            progress.stage("figures and report")
            write_fit(fit, out, overwrite=self.overwrite)
        axes = axis_summaries(fit)
        text = verdict(fit, axes)
        if not fit.determined:
            raise InputError(f"{' '.join(text)} {out / 'report.html'} shows why.")
        say(f"{fit.estimate.method}\n")
        print_table(HEAD, result_rows(axes))
        for advice in fit.advice:
            if advice.severity != "note":
                say(f"{advice.severity}: {advice}")
        say("\n" + "\n".join(text + in_one_number(fit, axes)) + "\n")
        print_table(("file", "what"), [(str(out / file), what) for file, what in FILES.items()])
        say("Next:")
        for command, what in next_steps(fit, out):
            say("\n".join(f"  {line}" for line in command.splitlines()) + f"\n      {what}")
