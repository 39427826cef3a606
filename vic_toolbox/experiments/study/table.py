"""The tables of a study: results put together by row and scenario, with what the paper reports beside them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.definition import Study, Table
from vic_toolbox.experiments.study.folder import Result
from vic_toolbox.experiments.study.metric import Metric, metric
from vic_toolbox.experiments.study.plan import Entry, Plan
from vic_toolbox.experiments.study.statistics import Estimate


@dataclass(frozen=True)
class TableCell:
    """One place of a table."""

    estimate: Estimate | None
    """Over all seeds; None as long as one of them is missing, so that nothing is averaged over those that happen to be
    there.
    """
    values: tuple[float, ...]
    """The metric, seed by seed, of those that are done."""
    wanted: int
    """Results that belong here: one for each seed, or one where nothing is left to chance."""
    failed: int
    """Those among the missing that failed."""
    paper: float | None
    """What the paper reports."""
    success: float | None
    """Mean success rate, where the metric is another quantity and the results have one."""
    iterations: int | None
    """Of AIRL or of the transfer; None where nothing is iterated."""

    @property
    def done(self) -> int:
        """Results that are there."""
        return len(self.values)

    @property
    def complete(self) -> bool:
        """Whether all of them are."""
        return self.done == self.wanted


@dataclass(frozen=True)
class TableRow:
    """One row: a method, a control, or the check of a method."""

    name: str
    """As the paper calls it."""
    role: str
    """method, control or check."""
    method: str
    action: str
    history: int
    cells: Mapping[str, TableCell]
    """By scenario; a control need not have all of them."""

    @property
    def estimates(self) -> dict[str, Estimate]:
        """Of the scenarios that are complete."""
        return {where: cell.estimate for where, cell in self.cells.items() if cell.estimate is not None}


@dataclass(frozen=True)
class ResultTable:
    """A table with its results."""

    definition: Table
    metric: Metric
    rows: tuple[TableRow, ...]

    @property
    def name(self) -> str:
        """Its number."""
        return self.definition.name

    @property
    def scenarios(self) -> tuple[str, ...]:
        """Its columns."""
        return self.definition.scenarios

    def of_role(self, *roles: str) -> tuple[TableRow, ...]:
        """Rows of these roles, in order."""
        return tuple(row for row in self.rows if row.role in roles)

    def row(self, name: str) -> TableRow | None:
        """A row by its name."""
        return next((row for row in self.rows if row.name == name), None)

    @property
    def complete(self) -> bool:
        """Whether nothing is missing."""
        return all(cell.complete for row in self.rows for cell in row.cells.values())


def make_tables(
    study: Study, plan: Plan, results: Mapping[str, Result], *, failed: Collection[str] = ()
) -> tuple[ResultTable, ...]:
    """All tables of a study, finished or not.

    Parameters
    ----------
    study : Study
        Its definition.
    plan : Plan
        Its cells and table entries.
    results : mapping of Result
        Results of the cells that are done, by name.
    failed : collection of str
        Names of cells that failed.

    Raises
    ------
    FileError
        A result lacks the number that a table needs.
    """
    return tuple(_table(table, study, plan, results, failed) for table in study.table)


def _table(
    table: Table, study: Study, plan: Plan, results: Mapping[str, Result], failed: Collection[str]
) -> ResultTable:
    own = [entry for entry in plan.entries if entry.table == table.name and entry.role != "sweep"]
    kind = metric(table.metric)
    rows = []
    for name in dict.fromkeys(entry.row for entry in own):
        group = [entry for entry in own if entry.row == name]
        first = group[0]
        published = dict(zip(table.scenarios, table.paper.get(name, ()), strict=False))
        cells = {
            scenario: _cell(
                [entry for entry in group if entry.scenario == scenario],
                kind,
                plan.by_name,
                results,
                failed,
                paper=published.get(scenario),
                episodes=study.budget_of(table.task).episodes,
            )
            for scenario in table.scenarios
            if any(entry.scenario == scenario for entry in group)
        }
        rows.append(TableRow(name, first.role, first.method, first.action, first.history, cells))
    return ResultTable(table, kind, _in_order(rows))


def _in_order(rows: Sequence[TableRow]) -> tuple[TableRow, ...]:
    """Methods first, then controls, then checks; each as the plan has them."""
    roles = ("method", "control", "check")
    return tuple(sorted(rows, key=lambda row: roles.index(row.role)))


def _cell(
    entries: Sequence[Entry],
    kind: Metric,
    cells: Mapping[str, Cell],
    results: Mapping[str, Result],
    failed: Collection[str],
    *,
    paper: float | None,
    episodes: int,
) -> TableCell:
    found = [results[entry.cell].values for entry in entries if entry.cell in results]
    values = tuple(
        kind.value(results[entry.cell].values, where=entry.cell) for entry in entries if entry.cell in results
    )
    complete = len(values) == len(entries)
    return TableCell(
        estimate=kind.estimate(values, episodes=episodes) if complete else None,
        values=values,
        wanted=len(entries),
        failed=sum(entry.cell in failed for entry in entries),
        paper=paper,
        success=_success(found) if complete and kind.key != "success_rate" else None,
        iterations=_iterations(cells[entries[0].cell]),
    )


def _success(values: Sequence[Mapping[str, Any]]) -> float | None:
    rates = [found["success_rate"] for found in values if "success_rate" in found]
    return sum(rates) / len(rates) if rates and len(rates) == len(values) else None


def _iterations(cell: Cell) -> int | None:
    """The budget of a cell that learns by iterations."""
    if cell.kind == "train" and cell.settings["method"] == "airl":
        return int(cell.settings["recipe"]["airl"]["iterations"])
    if cell.kind == "transfer":
        return int(cell.settings["transfer"]["iterations"])
    return None
