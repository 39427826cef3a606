"""The command that fits gains to logs: ``fit``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from vic_toolbox.cli.console import console_progress, print_table, say
from vic_toolbox.cli.options import MaybeFile, Name, NewFolder
from vic_toolbox.cli.reading import Reading
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.fit_settings import FitSettings

if TYPE_CHECKING:
    from vic_toolbox.experiments.fitting import Fit as FittedLogs
    from vic_toolbox.tasks import Task

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
    task: Name = None
    """Write demonstrations.npz too, the motions and their gains as demonstrations of this task, for `vic train`."""
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
        task = None if self.task is None else _task(self.task)
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
        if task is not None:
            _write_demonstrations(fit, task, out)


def _task(name: str) -> Task:
    """The task, before any work: here it may be missing, or need what is not installed."""
    from vic_toolbox import tasks

    return tasks.make(name)


def _write_demonstrations(fit: FittedLogs, task: Task, out: Path) -> None:
    from vic_toolbox.experiments.fit_demonstrations import FILE, fit_demonstrations, next_step

    found, remarks = fit_demonstrations(fit, task)
    found.save(out / FILE)
    count, steps = found.actions.shape[:2]
    say(f"  {out / FILE}\n      {count} demonstrations of {task.title}, {steps} steps of {task.dt:g} s.")
    for remark in remarks:
        say(f"      {remark}")
    command, what = next_step(task.name, out, remarks)
    say(f"  {command}\n      {what}")
