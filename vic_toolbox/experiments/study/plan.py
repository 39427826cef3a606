"""From a definition to its cells, and from the places of its tables to cells.

Equal cells of several tables are one cell: Tables I and II of the paper share their training.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

from vic_toolbox.errors import InputError
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.definition import Study
from vic_toolbox.experiments.study.kinds import effort

Role = Literal["method", "control", "check", "sweep"]

LAYOUTS: Mapping[str, str] = MappingProxyType({
    "success": "vic_toolbox.experiments.study.transfer_table:transfer_table",
    "difference": "vic_toolbox.experiments.study.transfer_table:transfer_table",
    "deviation": "vic_toolbox.experiments.study.twin_table:twin_table",
    "final deviation": "vic_toolbox.experiments.study.twin_table:twin_table",
})  # fmt: skip
"""Metric of a table → function ``(Draft, Study, Table)`` that adds its cells and entries."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One seed's number in a table, and the cell that it comes from."""

    table: str
    """Name of the table."""
    row: str
    """As the paper calls it, e.g. "Gain-AIRL-His"; of a sweep the quantity."""
    role: Role
    """One of the compared methods, a control, an artefact check, or a sweep over a quantity."""
    method: str
    """airl, bc, a constant gain, expert or untrained; of a sweep empty."""
    action: str
    history: int
    scenario: str
    """Column; of a sweep empty."""
    seed: int | None
    """None where nothing depends on one."""
    cell: str
    """Name of the cell."""


@dataclass(frozen=True)
class Plan:
    """Everything that there is to do, and what it is for."""

    cells: tuple[Cell, ...]
    """Each after those that it needs."""
    entries: tuple[Entry, ...]
    """Of all tables, in the order of their rows."""

    @cached_property
    def by_name(self) -> dict[str, Cell]:
        """Cells by name."""
        return {cell.name: cell for cell in self.cells}

    @cached_property
    def effort(self) -> dict[str, float]:
        """What each cell costs, by name; comparable numbers, about seconds of one core."""
        return {cell.name: effort(cell) for cell in self.cells}

    @cached_property
    def urgency(self) -> dict[str, float]:
        """Effort of the longest chain of cells that begins with each; the largest goes first."""
        longest = dict(self.effort)
        for cell in reversed(self.cells):
            for name in cell.needs:
                longest[name] = max(longest[name], self.effort[name] + longest[cell.name])
        return longest


class Draft:
    """A plan in the making."""

    def __init__(self) -> None:
        self._cells: dict[str, Cell] = {}
        self._entries: dict[Entry, None] = {}

    def cell(self, kind: str, name: str, settings: Mapping[str, Any], *, needs: tuple[str, ...] = ()) -> str:
        """Add a cell, unless it is there already; returns its name.

        Raises
        ------
        InputError
            Another cell has this name, or a cell that it needs has not been added.
        """
        cell = Cell(kind, name, settings, needs)
        if self._cells.setdefault(name, cell) != cell:
            raise InputError(
                f"two tables need the cell {name!r} with different settings; give them the same budget."
            )
        missing = [need for need in needs if need not in self._cells]
        if missing:
            raise InputError(f"the cell {name!r} needs {', '.join(missing)}, which is not in the plan.")
        return name

    def entry(self, **fields: Any) -> None:
        """Add an :class:`Entry`, unless it is there already."""
        self._entries.setdefault(Entry(**fields))

    def finish(self) -> Plan:
        """The plan.

        Raises
        ------
        InputError
            A cell's folder would lie inside that of another one.
        """
        for name in self._cells:
            parts = name.split("/")
            for i in range(1, len(parts)):
                if "/".join(parts[:i]) in self._cells:
                    raise InputError(f"the cell {name!r} would lie inside the cell {'/'.join(parts[:i])!r}.")
        return Plan(tuple(self._cells.values()), tuple(self._entries))


def make_plan(study: Study) -> Plan:
    """The cells and table entries of a study.

    Raises
    ------
    InputError
        The tables contradict each other, or the paper's numbers are of a row that there is not.
    """
    draft = Draft()
    for table in study.table:
        if table.metric not in LAYOUTS:
            raise InputError(f"table {table.name}: nothing makes a table of the metric {table.metric!r}.")
        module, function = LAYOUTS[table.metric].split(":")
        getattr(importlib.import_module(module), function)(draft, study, table)
    plan = draft.finish()
    for table in study.table:
        own = (entry for entry in plan.entries if entry.table == table.name and entry.role == "method")
        rows = list(dict.fromkeys(entry.row for entry in own))
        for row in table.paper:
            if row not in rows:
                raise InputError(
                    f"table {table.name}: paper has the row {row!r}, which the table does not have; its rows are: "
                    f"{', '.join(rows)}."
                )
    return plan


def row_name(method: str, action: str, history: int) -> str:
    """What the paper calls the row of a learned policy."""
    past = {1: "", 5: "-His"}.get(history, f"-His{history}")
    return f"{action.capitalize()}-{method.upper()}{past}"


def untrained_row(action: str) -> str:
    """Name of the row of policies with random weights."""
    return f"{action.capitalize()}, untrained with noise"
