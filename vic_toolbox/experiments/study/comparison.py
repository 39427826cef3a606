"""How the methods of a table stand against the paper, against each other and against their controls."""

from __future__ import annotations

from typing import Literal

from vic_toolbox.experiments.study.statistics import Estimate
from vic_toolbox.experiments.study.table import ResultTable, TableCell, TableRow

Standing = Literal["reached", "open", "below"]
"""Against a number of the paper: at least as good; worse with the number inside the interval; worse."""


def standing(table: ResultTable, cell: TableCell) -> Standing | None:
    """How a cell stands against the paper's number; None without one, or while the cell is not complete.

    The comparison is made at the paper's decimals.
    """
    found, paper = cell.estimate, cell.paper
    if found is None or paper is None:
        return None
    if table.metric.reaches(found.mean, paper):
        return "reached"
    inside = found.low is not None and found.high is not None and found.low <= paper <= found.high
    return "open" if inside else "below"


def standings(table: ResultTable, row: TableRow) -> dict[str, Standing]:
    """:func:`standing` of the scenarios that have one."""
    return {where: said for where, cell in row.cells.items() if (said := standing(table, cell)) is not None}


def subjects(table: ResultTable) -> tuple[TableRow, ...]:
    """The rows that the study is about: gains learned by AIRL; else what the paper has; else what is learned."""
    rows = table.of_role("method")
    choices = (
        [row for row in rows if (row.method, row.action) == ("airl", "gain")],
        [row for row in rows if any(cell.paper is not None for cell in row.cells.values())],
        [row for row in rows if row.method != "constant"],
    )
    return tuple(next((chosen for chosen in choices if chosen), ()))


def rivals(table: ResultTable, row: TableRow) -> tuple[TableRow, ...]:
    """The methods that a row is compared with: those that see as much, and the constant gain."""
    return tuple(
        other
        for other in table.of_role("method")
        if other is not row and (other.history == row.history or other.method == "constant")
    )


def better_rivals(table: ResultTable, row: TableRow, scenario: str) -> list[TableRow]:
    """Rivals that are better there, see :func:`beats`; the best first."""
    found = [
        other
        for other in rivals(table, row)
        if scenario in row.estimates and beats(table, other, row, scenario)
    ]
    sign = -1.0 if table.metric.more_is_better else 1.0
    return sorted(found, key=lambda other: sign * other.estimates[scenario].mean)


def beats(table: ResultTable, one: TableRow, other: TableRow, scenario: str) -> bool:
    """Whether the mean of one row is better than that of another, to the digits that are shown."""
    if scenario not in one.estimates or scenario not in other.estimates:
        return False
    first, second = one.estimates[scenario].mean, other.estimates[scenario].mean
    return table.metric.better(first, second) and table.metric.text(first) != table.metric.text(second)


def apart(one: Estimate, other: Estimate) -> bool:
    """Whether two intervals have no number in common; an unknown one has all."""
    if one.low is None or one.high is None or other.low is None or other.high is None:
        return False
    return one.high < other.low or other.high < one.low
