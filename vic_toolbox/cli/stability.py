"""The command that judges gains: ``stability``."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import OmitArgPrefixes, Positional, arg

from vic_toolbox.cli.console import console_progress, print_table, say
from vic_toolbox.cli.options import MaybeScenario, Name, NewFolder, Numbers
from vic_toolbox.experiments.stability_settings import StabilitySettings

Subject = Positional[Annotated[Path, arg(metavar="FILE|RUN")]]
Axes = Annotated[tuple[str, ...], arg(metavar="AXIS ...")]


@dataclass(frozen=True, kw_only=True)
class Options(StabilitySettings):
    """What the gains act on, and how."""

    mass: Numbers = ()
    """One mass [kg] for x, y, z, or six: three in kg, three in kg m²."""
    robot: Name = None
    """Arm whose M(x) is the mass, see vic robots; along the log's joints, or in one posture."""
    tool: Name = None
    """Tool of that arm."""
    posture: Numbers = ()
    """Its joint angles [rad]; by default the joints of the log, else its home."""
    axes: Axes = ()
    """Axes to judge: x y z rx ry rz; by default all that are known."""
    physical_damping: Numbers = ()
    """Friction of the mechanism: one number for x, y, z [Ns/m], or six."""
    scenario: MaybeScenario = None
    """Of a run: where it starts; by default as it was trained."""


@dataclass(frozen=True)
class Stability:
    """Judge the gains of a fit, a table or a run: are they stable and passive, how far from the edge, what to do.

    Takes the folder of vic fit (or its estimate.npz), a CSV with time, K_x, B_x, ..., or the folder of a run, whose
    policy is rolled out in its task. Writes report.html, stability.json and the figures into a folder. Ends with code 0
    whatever the verdict.

    Example: vic stability runs/fit --mass 3 --out runs/fit-stability
    """

    subject: Subject
    """Folder of a fit or of a run, estimate.npz, or a CSV of gains."""
    out: NewFolder = None
    """New folder for the results; by default the subject's name with -stability."""
    overwrite: bool = False
    """Replace an analysis that is in the folder already."""
    settings: OmitArgPrefixes[Options] = field(default_factory=Options)

    def run(self) -> None:
        """Analyse."""
        from vic_toolbox.experiments.stability_report import (
            ABOUT,
            FILES,
            HEAD,
            refuse_folder,
            rows,
            summary,
            write_study,
        )
        from vic_toolbox.experiments.stability_study import study

        out = self.out or Path("runs") / f"{self.subject.resolve().stem}-stability"
        self.settings.check()
        refuse_folder(out, overwrite=self.overwrite)
        with console_progress() as progress:
            found = study(self.subject, self.settings, progress=progress)
            progress.stage("figures and report")
            write_study(found, out, overwrite=self.overwrite)
        for name, analysis in found.analyses.items():
            say(f"{ABOUT[name]}\n")
            print_table(HEAD, rows(analysis))
            for text in analysis.assumptions:
                say(f"assuming: {text}")
        for name, replay in found.replays.items():
            say(f"{name}: " + replay.summary().replace("\n", "\n    "))
        for text in found.notes:
            say(f"note: {text}")
        say(f"\n{summary(found)}\n")
        print_table(("file", "what"), [(str(out / file), what) for file, what in FILES.items()])
