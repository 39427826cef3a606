"""Doing a study: every cell once, as soon as what it needs is there, whatever happens to the processes."""

from __future__ import annotations

import contextlib
import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from vic_toolbox.experiments.loop import deferred_interrupt
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.engines import Engine, Lost
from vic_toolbox.experiments.study.folder import Failure, StudyFolder
from vic_toolbox.experiments.study.parcels import pack, unpack
from vic_toolbox.experiments.study.plan import Plan
from vic_toolbox.experiments.study.presence import present
from vic_toolbox.experiments.study.progress import State, StudyProgress
from vic_toolbox.experiments.study.timing import Timing
from vic_toolbox.experiments.study.work import Job, Outcome, perform

ATTEMPTS = 2
"""How often a cell is tried before it counts as failed."""


@dataclass
class Summary:
    """How the execution of a study ended."""

    kept: int
    """Cells that were done before."""
    done: int = 0
    """Cells that were done now."""
    failures: list[Failure] = field(default_factory=list)
    """Cells that failed."""
    blocked: dict[str, str] = field(default_factory=dict)
    """Cells that were not run → the failed cell that they need."""

    @property
    def complete(self) -> bool:
        """Whether every cell is done."""
        return not self.failures and not self.blocked


class Queue(Iterator[Cell | None]):
    """The cells that are left; the next one is that which begins the longest chain, of those whose needs are done.

    Yields None while nothing is ready.
    """

    def __init__(self, plan: Plan, done: set[str]) -> None:
        self.plan = plan
        self.left = {cell.name: cell for cell in plan.cells if cell.name not in done}
        self._waits = {
            name: {need for need in cell.needs if need not in done} for name, cell in self.left.items()
        }
        self._ready: list[tuple[float, int, str]] = []
        self._order = {cell.name: i for i, cell in enumerate(plan.cells)}
        for name, needs in self._waits.items():
            if not needs:
                self._add(name)

    def _add(self, name: str) -> None:
        heapq.heappush(self._ready, (-self.plan.urgency[name], self._order[name], name))

    def __next__(self) -> Cell | None:
        return self.left[heapq.heappop(self._ready)[2]] if self._ready else None

    def again(self, name: str) -> None:
        """Put a cell back that was begun."""
        self._add(name)

    def finish(self, name: str) -> None:
        """A cell is done: those that waited for it may be ready."""
        del self.left[name]
        for other, needs in self._waits.items():
            if name in needs:
                needs.remove(name)
                if not needs and other in self.left:
                    self._add(other)

    def give_up(self, name: str) -> list[str]:
        """A cell failed: it and all that need it are out; returns the names of the latter."""
        out = {name}
        for cell in self.plan.cells:
            if cell.name in self.left and not out.isdisjoint(cell.needs):
                out.add(cell.name)
        for other in out:
            self.left.pop(other, None)
        return [cell.name for cell in self.plan.cells if cell.name in out and cell.name != name]


def execute(folder: StudyFolder, engine: Engine, *, progress: StudyProgress | None = None) -> Summary:
    """Do every cell of a study that is not done yet.

    A cell that fails is tried once more; then its traceback is kept in ``failure.json``, the cells that need it are
    left out, and the others go on. A worker that dies counts as a failure of its cell, which is taken up from its
    checkpoint.

    Parameters
    ----------
    folder : StudyFolder
        Made with :meth:`StudyFolder.create`.
    engine : Engine
        Where cells are done.
    progress : StudyProgress, optional
        Told how it goes; by default nobody.

    Raises
    ------
    FileError
        A result is damaged, or the folder cannot be written.
    KeyboardInterrupt
        Ctrl-C or SIGTERM; the cells under way have saved what they could.
    """
    with deferred_interrupt() as stopped, present(folder.path, note=engine.label) as presence:
        return _Execution(folder, engine, progress or StudyProgress(), presence).run(stopped)


class _Execution:
    """One run through the queue."""

    def __init__(
        self, folder: StudyFolder, engine: Engine, progress: StudyProgress, presence: dict[str, Any]
    ) -> None:
        self._folder, self._engine, self._progress = folder, engine, progress
        self._presence = presence
        self._away = False  # whether a worker does not see the folder
        self._timing = Timing(folder.plan)
        results = folder.results()
        for result in results.values():
            self._timing.add(result.cell, result.seconds)
        self._queue = Queue(folder.plan, set(results))
        self._summary = Summary(kept=len(results))
        self._running: dict[str, Job] = {}
        self._tracebacks: dict[str, list[str]] = {}

    def run(self, stopped: Callable[[], bool]) -> Summary:
        with contextlib.closing(self._engine.map(perform, self._jobs(), stopped=stopped)) as ended:
            for job, answer in ended:
                del self._running[job.cell.name]
                self._take(job, answer)
        self._tell()
        return self._summary

    def _jobs(self) -> Iterator[Job | None]:
        for cell in self._queue:
            if cell is None:
                self._tell()
                yield None
                continue
            job = self._job(cell)
            self._running[cell.name] = job
            self._presence["cells"] = list(self._running)
            self._tell()
            yield job

    def _job(self, cell: Cell) -> Job:
        folder, parcels = self._folder, None
        if self._away:
            parcels = {name: pack(folder.cell_path(name)) for name in (cell.name, *cell.needs)}
        where = str(folder.path.absolute())
        return Job(cell, folder.digests[cell.name], where, token=folder.token, parcels=parcels)

    def _take(self, job: Job, answer: Any) -> None:
        name = job.cell.name
        if isinstance(answer, Outcome) and answer.state == "away":
            self._away = True
            self._queue.again(name)
        elif isinstance(answer, Outcome) and answer.state == "done":
            unpack(answer.parcel, self._folder.cell_path(name))
            self._summary.done += 1
            self._timing.add(job.cell, answer.seconds)
            self._queue.finish(name)
        else:
            self._fail(name, answer.reason if isinstance(answer, Lost) else answer.traceback)

    def _fail(self, name: str, why: str) -> None:
        tracebacks = self._tracebacks.setdefault(name, [])
        tracebacks.append(why)
        if len(tracebacks) < ATTEMPTS:
            self._progress.say(f"{name} failed and is tried once more: {_last_line(why)}")
            self._queue.again(name)
            return
        failure = self._folder.write_failure(name, tracebacks)
        self._summary.failures.append(failure)
        blocked = self._queue.give_up(name)
        self._summary.blocked |= dict.fromkeys(blocked, name)
        more = f"; {len(blocked)} cells that need it are not run" if blocked else ""
        self._progress.say(f"{name} failed twice{more}: {failure.reason}")

    def _tell(self) -> None:
        summary, queue = self._summary, self._queue
        self._progress.update(
            State(
                total=len(queue.plan.cells),
                done=summary.kept + summary.done,
                running=len(self._running),
                failed=len(summary.failures),
                blocked=len(summary.blocked),
                left=self._timing.left(queue.left.values(), slots=self._engine.slots),
            )
        )


def _last_line(text: str) -> str:
    lines = [line for line in text.splitlines() if line.strip()]
    return lines[-1] if lines else ""
