"""How far a study is, from its files alone: while it runs, and after a crash."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.folder import Failure, StudyFolder
from vic_toolbox.experiments.study.presence import Presence, presence
from vic_toolbox.experiments.study.timing import Timing


@dataclass
class KindStatus:
    """Cells of one kind by their state."""

    kind: str
    total: int = 0
    done: int = 0
    running: int = 0
    stale: int = 0
    """Begun by a process that is gone; they go on from where they were."""
    failed: int = 0
    blocked: int = 0
    """Not run, because a cell that they need failed."""
    seconds: float = 0.0
    """Time of those that are done, together [s]."""

    @property
    def waiting(self) -> int:
        """Not begun."""
        return self.total - self.done - self.running - self.stale - self.failed - self.blocked

    @property
    def mean(self) -> float | None:
        """Mean time of those that are done [s]."""
        return self.seconds / self.done if self.done else None


@dataclass
class Status:
    """How far a study is."""

    runner: Presence | None
    """Who does it, or did; `alive` says which."""
    kinds: dict[str, KindStatus] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    blocked: dict[str, str] = field(default_factory=dict)
    """Cells that were not run → the failed cell that they need."""
    running: list[tuple[str, Presence]] = field(default_factory=list)
    stale: list[tuple[str, Presence]] = field(default_factory=list)
    per_hour: float | None = None
    """Cells that were done in an hour, of the present or last run."""
    left: float = 0.0
    """Time until all is done, with as many at once as now [s]."""

    @property
    def total(self) -> KindStatus:
        """Of all kinds together."""
        whole = KindStatus("all")
        for kind in self.kinds.values():
            for name in ("total", "done", "running", "stale", "failed", "blocked", "seconds"):
                setattr(whole, name, getattr(whole, name) + getattr(kind, name))
        return whole


def read_status(folder: StudyFolder) -> Status:
    """Look at every cell's files.

    Raises
    ------
    FileError
        A result or a failure is damaged; the file is named.
    """
    status = Status(presence(folder.path))
    timing, left, ends = Timing(folder.plan), [], []
    out: dict[str, str] = {}
    for cell in folder.cells:
        row = status.kinds.setdefault(cell.kind, KindStatus(cell.kind))
        row.total += 1
        result = folder.result(cell.name)
        if result is not None:
            row.done += 1
            row.seconds += result.seconds
            timing.add(cell, result.seconds)
            ends.append((folder.cell_path(cell.name) / "result.json").stat().st_mtime)
            continue
        if not _count(status, row, folder, cell, out):
            left.append(cell)
    status.left = timing.left(left, slots=max(len(status.running), 1))
    status.per_hour = _rate(status.runner, ends)
    return status


def _count(status: Status, row: KindStatus, folder: StudyFolder, cell: Cell, out: dict[str, str]) -> bool:
    """Put a cell that is not done where it belongs; returns whether it failed or waits for one that did."""
    here, runner = presence(folder.cell_path(cell.name)), status.runner
    if here is None and runner is not None and runner.alive and cell.name in runner.cells:
        here = replace(runner, seconds=0.0)  # by a worker that does not see this folder
    if here is not None and here.alive:
        row.running += 1
        status.running.append((cell.name, here))
        return False
    failure = folder.failure(cell.name)
    if failure is not None:
        row.failed += 1
        status.failures.append(failure)
        out[cell.name] = cell.name
        return True
    cause = next((out[name] for name in cell.needs if name in out), None)
    if cause is not None:
        row.blocked += 1
        status.blocked[cell.name] = out[cell.name] = cause
        return True
    if here is not None:
        row.stale += 1
        status.stale.append((cell.name, here))
    return False


def _rate(runner: Presence | None, ends: list[float]) -> float | None:
    """Cells per hour since the runner began, or over all results if there is none."""
    if not ends:
        return None
    if runner is not None:
        since = [end for end in ends if end >= runner.began]
        until = time.time() if runner.alive else runner.beat
        hours = (until - runner.began) / 3600.0
        return len(since) / hours if hours > 0 else None
    hours = (max(ends) - min(ends)) / 3600.0
    return (len(ends) - 1) / hours if hours > 0 else None
