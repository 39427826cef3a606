"""How long the rest of a study will take, from what its cells have taken so far."""

from __future__ import annotations

import statistics
from collections.abc import Iterable

from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.plan import Plan

_Group = tuple[str, str, float]
"""Cells that take alike: of one kind, one task, and one effort."""


class Timing:
    """Times of cells, measured where there are any, else estimated from their effort."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._measured: dict[_Group, list[float]] = {}
        self._by_kind: dict[str, tuple[float, float]] = {}  # effort and seconds of those that were measured

    def add(self, cell: Cell, seconds: float) -> None:
        """Count a cell that is done."""
        self._measured.setdefault(self._group(cell), []).append(seconds)
        for kind in (cell.kind, ""):
            effort, spent = self._by_kind.get(kind, (0.0, 0.0))
            self._by_kind[kind] = effort + self._plan.effort[cell.name], spent + seconds

    def expected(self, cell: Cell) -> float:
        """Time that a cell takes [s]."""
        measured = self._measured.get(self._group(cell))
        if measured:
            return statistics.fmean(measured)
        effort, spent = self._by_kind.get(cell.kind) or self._by_kind.get("", (1.0, 1.0))
        return self._plan.effort[cell.name] * spent / effort

    def left(self, cells: Iterable[Cell], *, slots: int) -> float:
        """Time until cells are done, so many at once [s]: all of their work shared out, or their longest chain."""
        chain: dict[str, float] = {}
        total = 0.0
        for cell in cells:  # in the plan's order: each after those that it needs
            own = self.expected(cell)
            total += own
            chain[cell.name] = own + max((chain.get(name, 0.0) for name in cell.needs), default=0.0)
        return max(total / max(slots, 1), max(chain.values(), default=0.0))

    def _group(self, cell: Cell) -> _Group:
        return cell.kind, cell.name.split("/")[0], self._plan.effort[cell.name]


def duration(seconds: float) -> str:
    """A time in words, e.g. "2 h 10 min"."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    if minutes < 60:
        return f"{minutes} min"
    return f"{minutes // 60} h {minutes % 60:02d} min"
