"""How the pages of a study write a scenario, a cell, and what they have in common."""

from __future__ import annotations

from collections.abc import Sequence

from vic_toolbox.experiments.study.table import ResultTable, TableCell

_READING = (
    "A cell is the mean of all seeds with its 95 % interval. Intervals of means are Student's over the seeds; those of "
    "success rates are Wilson's, from the spread of the seeds or from the number of starts, whichever is wider, so "
    "that they stay within 0 and 100 %. A cell that lacks a seed has no mean, and says how many are there."
)
_PAPER = (
    " Below the mean: the paper's number, which is the mean of its best three of five seeds, and our best three. Means "
    "that reach the paper's number, at its decimals, are set off."
)


def reading(tables: Sequence[ResultTable]) -> str:
    """How the tables are read."""
    every = (cell for table in tables for row in table.rows for cell in row.cells.values())
    return _READING + _PAPER * any(cell.paper is not None for cell in every)


def called(scenario: str) -> str:
    """A scenario in a sentence or at the head of a column."""
    return "training" if scenario == "train" else scenario


def asides(table: ResultTable, cell: TableCell) -> list[str]:
    """What stands beside a mean: the paper's number, our best three, success where the table shows another quantity."""
    parts = []
    if cell.paper is not None:
        parts.append(f"paper {table.metric.paper_text(cell.paper)}")
        if cell.estimate is not None and cell.estimate.best3 is not None:
            parts.append(f"best three {table.metric.text(cell.estimate.best3)}")
    if cell.success is not None and cell.success < 1.0:
        parts.append(f"succeeds in {100 * cell.success:.0f} %")
    return parts


def missing_text(cell: TableCell) -> str:
    """What there is of a cell that is not complete."""
    failed = f", {cell.failed} failed" if cell.failed else ""
    return f"{cell.done} of {cell.wanted} seeds{failed}" if cell.wanted > 1 else f"not done{failed}"
