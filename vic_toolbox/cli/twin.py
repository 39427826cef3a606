"""The command of the digital twin: ``twin record``, ``twin compare`` and ``twin study``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from vic_toolbox.cli.console import console_progress, print_table, say
from vic_toolbox.cli.options import MaybeFile, Scenario

Folder = Annotated[Path, arg(metavar="DIR")]
Start = Annotated[str, arg(metavar="START")]


@dataclass(frozen=True)
class Twin:
    """Record demonstrations on the digital twin, guided by a simulated human, and compare fits of them with the truth.

    The twin is the arm of Cup-on-Plate with other inertia, friction, delay and noise than its model says. `record`
    writes demonstration_00.npz ..., calibration.npz and layout.toml, as a real session would leave them, and the
    human's true gains into another folder. `compare` fits them by the paper's window and by smooth splines. `study`
    records and fits sessions that differ in one thing each (what a push buys, where errors come from), and carries
    the expert's gains and wrenches over to other robots; it takes two minutes.

    Example: vic twin record --out runs/guided --count 30
    """

    what: Positional[Literal["record", "compare", "study"]]
    """What to do."""
    out: Folder = Path("runs/guided")
    """Folder of the session."""
    truth: MaybeFile = None
    """File of the truth; by default truth/truth.npz in that folder."""
    count: int = 30
    """Demonstrations."""
    seed: int = 0
    """Of starts, the human's unrest, perturbation and noise."""
    robot: int = 0
    """Which twin: the seed of its inertia, friction and bias."""
    perturbation: float = 5.0
    """Known push of the controller while the human works, root mean square along x [N]; 0: none, as in the paper."""
    start: Scenario = "train"
    """Where demonstrations start: a name of `vic tasks`, or "x,y,z" [m]."""
    start_noise: float = 1.0
    """Variation of the starts, in units of 0.02 rad in every joint."""
    duration: float = 5.0
    """Of a demonstration [s]."""
    rate: float = 500.0
    """Samples per second of the logs [Hz]: 1000 divided by a whole number."""
    window: int = 10
    """Samples in a window of the paper's estimator (compare)."""
    knots: float = 0.2
    """Distance of the smooth fit's knots [s] (compare)."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""

    def run(self) -> None:
        """Record, compare or study."""
        {"record": self._record, "compare": self._compare, "study": self._study}[self.what]()

    def _record(self) -> None:
        from vic_toolbox.twin import Excitation, guide, save_session, session_paths
        from vic_toolbox.twin import Twin as Robot

        session_paths(self.out, self.truth)  # refused before any work, not after
        robot = Robot(seed=self.robot)
        with console_progress() as progress:
            progress.stage("demonstrations", round(1e3 * self.duration))
            session = guide(
                robot,
                count=self.count,
                seed=self.seed,
                excitation=Excitation(force=self.perturbation),
                scenario=self.start,
                start_noise=self.start_noise,
                duration=self.duration,
                rate=self.rate,
                threads=self.threads,
                progress=lambda done, total: progress.update(done, total=total),
            )
            progress.stage("files")
            save_session(session, robot, self.out, truth=self.truth)
        say(f"{len(session.logs)} demonstrations, calibration.npz and layout.toml: {self.out}")

    def _compare(self) -> None:
        from vic_toolbox.twin import HEAD, compare_session

        with console_progress() as progress:
            rows = compare_session(
                self.out, self.truth, window=self.window, knots=self.knots, stage=progress.stage
            )
        print_table(HEAD, rows)

    def _study(self) -> None:
        from vic_toolbox.twin.study import REPLAY_HEAD, STUDY_HEAD, replay, study

        with console_progress() as progress:
            progress.stage("sessions")
            rows = study(
                seed=self.seed,
                threads=self.threads,
                progress=lambda done, total: progress.update(done, total=total),
            )
            progress.stage("replays")
            carried = replay(seed=self.seed, threads=self.threads)
        print_table(STUDY_HEAD, rows)
        print_table(REPLAY_HEAD, carried)
