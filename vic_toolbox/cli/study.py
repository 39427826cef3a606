"""The command of studies: ``study run``, ``study status`` and ``study report``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, ClassVar

from rich.console import Console
from tyro.conf import Positional, arg

from vic_toolbox.cli.console import complain, print_table, say
from vic_toolbox.cli.options import NewFolder

if TYPE_CHECKING:
    from vic_toolbox.experiments.study.engines import Engine
    from vic_toolbox.experiments.study.execution import Summary
    from vic_toolbox.experiments.study.folder import StudyFolder
    from vic_toolbox.experiments.study.status import KindStatus, Status

File = Positional[Annotated[str, arg(metavar="FILE")]]
Folder = Positional[Annotated[Path, arg(metavar="DIR")]]
Address = Annotated[str | None, arg(metavar="ADDRESS")]
Seeds = Annotated[tuple[int, ...], arg(metavar="N ...")]

_SHOWN = 10  # cells that a list names before it is cut off


@dataclass(frozen=True)
class RunStudy:
    """Do every cell of a study that is not done yet, then write its report.

    A killed study goes on from its checkpoints with --resume; done cells are never done again. A cell that fails is
    tried once more, then reported, and the others go on. Ends with code 0 if every cell is done, 1 if some failed.

    Example: vic study run studies/paper.toml --out runs/paper --jobs 4
    """

    file: File
    """The study's TOML file, or the name of one that comes with the package: paper, quick."""
    out: NewFolder = None
    """Folder of the study; by default runs/study-NAME."""
    jobs: int = 0
    """Cells at once, one thread each; 0 for as many as there are processors."""
    cluster: Address = None
    """Do them on a Ray cluster instead: auto (this machine's), or HOST:PORT of its head."""
    resume: bool = False
    """Take up the study in that folder, if there is one; cells whose settings are unchanged are kept."""
    seeds: Seeds = ()
    """Seeds instead of those of the file."""

    def run(self) -> None:
        """Run."""
        from vic_toolbox.experiments.study.definition import load
        from vic_toolbox.experiments.study.execution import execute
        from vic_toolbox.experiments.study.folder import StudyFolder
        from vic_toolbox.experiments.study.progress import ConsoleStudyProgress

        study = load(self.file)
        if self.seeds:
            study = study.with_seeds(self.seeds)
        out, engine = self.out or Path("runs") / f"study-{study.name}", self._engine()
        with StudyFolder.create(out, study, resume=self.resume) as folder:
            title = f"study {study.name}"
            with ConsoleStudyProgress(Console(stderr=True), title) as progress:
                summary = execute(folder, engine, progress=progress)
            _print_summary(summary, out)
            _write_report(folder, out)
        if not summary.complete:
            raise SystemExit(1)

    def _engine(self) -> Engine:
        from vic_toolbox.experiments.study.engines import JoblibEngine, RayEngine

        return JoblibEngine(self.jobs) if self.cluster is None else RayEngine(self.cluster, self.jobs)


@dataclass(frozen=True)
class StudyStatus:
    """Show how far a study is: cells done, running, failed, cells per hour, time left.

    Reads only files: it works while the study runs, and after a crash.

    Example: vic study status runs/paper
    """

    folder: Folder
    """Folder of the study."""

    def run(self) -> None:
        """Show."""
        from vic_toolbox.experiments.study.folder import StudyFolder
        from vic_toolbox.experiments.study.status import read_status

        folder = StudyFolder.open(self.folder)
        _print_status(folder, read_status(folder))


@dataclass(frozen=True)
class StudyReport:
    """Write the tables and figures of a study, as far as it is done: HTML, Markdown and JSON.

    Example: vic study report runs/paper --out docs/results
    """

    folder: Folder
    """Folder of the study."""
    out: NewFolder = None
    """Folder of the report; by default that of the study."""

    def run(self) -> None:
        """Report."""
        from vic_toolbox.experiments.study.folder import StudyFolder

        _write_report(StudyFolder.open(self.folder), self.out or self.folder)


class Study:
    """Run a study of many trainings and transfers, resumable, on one machine or a cluster; show its tables.

    A study is a TOML file of tasks, methods, actions, histories, seeds and scenarios; studies/paper.toml is the
    paper's, studies/quick.toml the same in a few minutes. See vic study run --help.

    Example: vic study run quick --out runs/quick
    """

    parts: ClassVar[dict[str, type]] = {"run": RunStudy, "status": StudyStatus, "report": StudyReport}


def _write_report(folder: StudyFolder, out: Path) -> None:
    from vic_toolbox.experiments.study.report import report

    report(folder, out)
    say(f"{out / 'report.html'}")


def _print_summary(summary: Summary, out: Path) -> None:
    before = f", {summary.kept} were done before" if summary.kept else ""
    say(f"{summary.done} cells done{before}.")
    for failure in summary.failures[:_SHOWN]:
        complain(
            f"failed: {failure.name}: {failure.reason}\n    {out / 'cells' / failure.name / 'failure.json'}"
        )
    if len(summary.failures) > _SHOWN:
        complain(f"... and {len(summary.failures) - _SHOWN} more failed; see vic study status {out}")
    for cause in dict.fromkeys(summary.blocked.values()):
        names = [name for name, why in summary.blocked.items() if why == cause]
        more = ", ..." if len(names) > 3 else ""
        complain(f"not run, because {cause} failed: {len(names)} cells ({', '.join(names[:3])}{more})")
    if not summary.complete:
        complain(
            f"Failed cells are tried again with --resume; to begin one anew, delete its folder in {out / 'cells'}."
        )


def _print_status(folder: StudyFolder, status: Status) -> None:
    from vic_toolbox.experiments.study.timing import duration

    say(f"{folder.definition.title} ({folder.path})\n")
    rows = [*status.kinds.values(), status.total]
    columns = ("total", "done", "running", "stale", "failed", "blocked", "waiting")
    table = [(row.kind, *(str(getattr(row, name)) for name in columns), _mean(row)) for row in rows]
    heads = ("cells", "all", "done", "running", "interrupted", "failed", "not run", "waiting", "mean time")
    print_table(heads, table)
    for name, here in status.running[:_SHOWN]:
        say(f"running {duration(here.seconds)}: {name}")
    for failure in status.failures:
        say(f"failed: {failure.name}: {failure.reason}")
    say(_runner_text(folder, status))
    parts = [f"{status.per_hour:.0f} cells per hour"] if status.per_hour else []
    whole = status.total
    if whole.done + whole.failed + whole.blocked < whole.total:
        at_once = max(whole.running, 1)
        parts.append(f"about {duration(status.left)} left with {at_once} at once")
    if parts:
        say(", ".join(parts))


def _mean(row: KindStatus) -> str:
    return "" if row.mean is None else f"{row.mean:.1f} s"


def _runner_text(folder: StudyFolder, status: Status) -> str:
    runner, whole = status.runner, status.total
    if runner is not None and runner.alive:
        return f"It runs: process {runner.pid} on {runner.host}, {runner.note}."
    if whole.done == whole.total:
        return "It is complete."
    ended = "Nobody works on it" if runner is None else "It was stopped" if runner.over else "Its runner died"
    return f"{ended}; go on with: vic study run FILE --out {folder.path} --resume"
