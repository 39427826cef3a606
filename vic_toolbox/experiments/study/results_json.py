"""A study's tables as a list of cells, for programs to read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import Any

from vic_toolbox.errors import FileError
from vic_toolbox.experiments.study.plan import row_name
from vic_toolbox.experiments.study.table import ResultTable, TableRow
from vic_toolbox.files import read_json

KEYS = (
    "table",
    "method",
    "history",
    "scenario",
    "metric",
    "mean",
    "low",
    "high",
    "seeds",
    "paper",
    "best3",
    "iterations",
)
"""Keys of a cell, in their order."""


def cells(tables: Sequence[ResultTable]) -> list[dict[str, Any]]:
    """One mapping for each cell of each table, see :data:`KEYS`; controls and checks follow the methods.

    ``method`` is the row's name without what says the history; ``mean``, ``low``, ``high`` and ``best3`` are null in a
    cell that is not complete, whose ``seeds`` are those that are there.
    """
    return [cell for table in tables for row in table.rows for cell in _cells(table, row)]


def _cells(table: ResultTable, row: TableRow) -> Iterator[dict[str, Any]]:
    for scenario, cell in row.cells.items():
        found = cell.estimate
        values = (
            table.name,
            method_name(row),
            row.history,
            scenario,
            table.metric.name,
            _rounded(found and found.mean),
            _rounded(found and found.low),
            _rounded(found and found.high),
            cell.done,
            cell.paper,
            _rounded(found and found.best3),
            cell.iterations,
        )
        yield dict(zip(KEYS, values, strict=True))


def _rounded(value: float | None) -> float | None:
    """Without the digits that are rounding errors of the machine."""
    return None if value is None else round(value, 6)


def method_name(row: TableRow) -> str:
    """The row's name without what says the history: "Gain-AIRL" of "Gain-AIRL-His"."""
    own = row_name(row.method, row.action, row.history)
    plain = row_name(row.method, row.action, 1)
    return plain + row.name.removeprefix(own) if row.name.startswith(own) else row.name


def read_cells(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """Read what :func:`cells` wrote.

    Raises
    ------
    FileError
        The file is missing, or is not a list of such cells.
    """
    found = read_json(path)
    if not isinstance(found, list) or any(
        not isinstance(cell, dict) or set(cell) != set(KEYS) for cell in found
    ):
        raise FileError(
            f"{path} is not a list of cells with the keys {', '.join(KEYS)}; make it again with vic study report."
        )
    return found
