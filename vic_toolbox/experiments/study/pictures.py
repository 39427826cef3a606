"""The figures of a study: its tables as dots, success against difficulty, learning curves, gains and wrenches."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox import tasks
from vic_toolbox.experiments.evaluation import Policy
from vic_toolbox.experiments.figures.study_difficulty import Line, success_of_seeds
from vic_toolbox.experiments.figures.study_learning import Curves, learning_of_seeds
from vic_toolbox.experiments.figures.study_motion import gains_of_seeds, wrench_of_seeds
from vic_toolbox.experiments.figures.study_table import Dot, DotRow, dots
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.study.folder import Result, StudyFolder
from vic_toolbox.experiments.study.plan import Entry
from vic_toolbox.experiments.study.sweeps import line, sweeps
from vic_toolbox.experiments.study.table import ResultTable, TableRow
from vic_toolbox.experiments.study.twin_pictures import velocity_drawings
from vic_toolbox.experiments.study.wording import called
from vic_toolbox.experiments.task_views import Drawing, view
from vic_toolbox.experiments.trace import Trace, record_trace


@dataclass(frozen=True)
class Pictures:
    """Everything that can be drawn.

    Attributes
    ----------
    by_table : mapping
        Drawings by the name of the table.
    general : list
        Those of no single table.
    left_out : tuple of str
        Figures that cannot be drawn, with the reason.
    """

    by_table: Mapping[str, list[Drawing]]
    general: list[Drawing]
    left_out: tuple[str, ...] = field(default=())


def draw(folder: StudyFolder, tables: Sequence[ResultTable], results: Mapping[str, Result]) -> Pictures:
    """Draw what the results and the runs in the folder allow."""
    runs = _Runs(folder, results)
    by_table = {table.name: [*_table_pictures(folder, table, results)] for table in tables}
    in_simulation = [table for table in tables if not table.definition.on_twin]
    general = [*_learning(runs, in_simulation)]
    for task in dict.fromkeys(table.definition.task for table in in_simulation):
        general += _motions(runs, next(table for table in in_simulation if table.definition.task == task))
    return Pictures(by_table, general, runs.left_out())


# --- of one table ------------------------------------------------------------------------------------------------


def _table_pictures(
    folder: StudyFolder, table: ResultTable, results: Mapping[str, Result]
) -> Iterator[Drawing]:
    rows = [*table.of_role("method", "control")]
    if any(row.estimates for row in rows):
        yield Drawing(
            f"table-{table.name}",
            f"Table {table.name} as a picture",
            "Each method and control (grey) with its 95 % interval; diamonds are the paper's numbers.",
            _dots(table, rows),
        )
    yield from velocity_drawings(folder, table, results)
    for quantity, values, lines in _difficulty(table):
        axis = tasks.make(table.definition.task).sweeps[quantity]
        yield Drawing(
            f"table-{table.name}-{quantity}",
            f"Success against {quantity}",
            "As in the table, with 95 % intervals; dashed with a history of observations. Methods stand a little "
            "beside each other, so that none hides another.",
            success_of_seeds(values, lines, label=axis.label, trained=_trained(table, quantity)),
        )
    for swept in sweeps(folder.plan, results, table.name):
        areas = ", ".join(f"{name} {area:.2f}" for name, area in swept.areas.items())
        yield Drawing(
            f"sweep-{swept.quantity}",
            f"Beyond the paper: success over {swept.quantity}, without transfer",
            f"Every policy as it was trained, all seeds, with 95 % intervals. Area under the curve: {areas}.",
            success_of_seeds(
                swept.values.tolist(),
                {f"{action} actions": lines for action, lines in swept.lines.items()},
                label=swept.label,
                trained=_trained(table, swept.quantity),
            ),
        )


def _dots(table: ResultTable, rows: Sequence[TableRow]) -> Figure:
    factor = table.metric.factor
    drawn = [
        DotRow(
            row.name,
            row.method,
            row.role == "control",
            {
                called(where): Dot(
                    factor * found.mean,
                    None if found.low is None else factor * found.low,
                    None if found.high is None else factor * found.high,
                    None if (paper := row.cells[where].paper) is None else factor * paper,
                )
                for where, found in row.estimates.items()
            },
        )
        for row in rows
        if row.estimates
    ]
    columns = [called(where) for where in table.scenarios]
    return dots(drawn, columns, label=table.metric.label, rate=table.metric.more_is_better)


def _difficulty(table: ResultTable) -> Iterator[tuple[str, list[float], dict[str, list[Line]]]]:
    """Quantity, values and lines, where the scenarios of a table are values of one quantity."""
    if not table.metric.more_is_better:
        return
    unseen = [where for where in table.scenarios if where != "train"]
    quantities = {where.partition("=")[0] for where in unseen}
    if len(unseen) < 2 or len(quantities) != 1 or any(where.count("=") != 1 for where in unseen):
        return
    (quantity,) = quantities
    at = {where: float(where.partition("=")[2]) for where in unseen}
    if (trained := _trained(table, quantity)) is not None:
        at["train"] = trained
    ordered = sorted(at, key=at.__getitem__)
    panels: dict[str, list[Line]] = {}
    for row in table.of_role("method"):
        if row.estimates:
            drawn = line(
                row.name, row.method, [row.estimates.get(where) for where in ordered], dashed=row.history > 1
            )
            panels.setdefault(f"{row.action} actions", []).append(drawn)
    if panels:
        yield quantity, [at[where] for where in ordered], panels


def _trained(table: ResultTable, quantity: str) -> float | None:
    """Value of a quantity in the demonstrations."""
    scenario = tasks.make(table.definition.task).scenario
    value = getattr(scenario, quantity, None)
    return float(value) if isinstance(value, int | float) else None


# --- of the runs ---------------------------------------------------------------------------------------------------


class _Runs:
    """Runs in the folder of a study; remembers what is not there."""

    def __init__(self, folder: StudyFolder, results: Mapping[str, Result]):
        self._folder = folder
        self._results = results
        self._missing: list[str] = []

    def path(self, entry: Entry) -> Path | None:
        """Folder of an entry's run, or None if its cell is not done or the run is gone."""
        if entry.cell not in self._results:
            return None
        path = self._folder.cell_path(entry.cell) / "run"
        if not (path / "config.json").is_file():
            self._missing.append(entry.cell)
            return None
        return path

    def values(self, entry: Entry) -> Mapping[str, float]:
        """Numbers of a cell that is done."""
        return self._results[entry.cell].values

    def of(self, table: ResultTable, row: TableRow, scenario: str) -> list[Entry]:
        """The seeds of a row in a scenario."""
        return [
            entry
            for entry in self._folder.plan.entries
            if (entry.table, entry.row, entry.scenario) == (table.name, row.name, scenario)
        ]

    def left_out(self) -> tuple[str, ...]:
        """What cannot be drawn."""
        missing = list(dict.fromkeys(self._missing))
        if not missing:
            return ()
        listed = f"{', '.join(missing[:3])}{', ...' if len(missing) > 3 else ''}"
        return (f"Not drawn, since the run is no longer in the folder ({len(missing)}): {listed}.",)


def _learning(runs: _Runs, tables: Sequence[ResultTable]) -> Iterator[Drawing]:
    methods: dict[str, dict[str, Curves]] = {}
    for table in tables:
        for row in table.of_role("method"):
            title = tasks.make(table.definition.task).title
            if row.method == "airl" and title not in methods.get(row.name, {}):
                curves = _curves(runs, runs.of(table, row, "train"))
                if curves is not None:
                    methods.setdefault(row.name, {})[title] = curves
    if methods:
        yield Drawing(
            "learning",
            "Learning curves",
            "Score of the mean action while AIRL learns, from a few episodes that decide nothing: every seed (thin), "
            "their mean, and the expert. Early scores far below are cut off.",
            learning_of_seeds(methods, looks=dict.fromkeys(methods, "airl")),
        )


def _curves(runs: _Runs, entries: Sequence[Entry]) -> Curves | None:
    found = []
    for entry in entries:
        path = runs.path(entry)
        rows = RunFolder.open(path).metrics() if path else []
        scored = np.array(
            [(row["iteration"], row["mean_score"]) for row in rows if row.get("mean_score") is not None]
        )
        if len(scored) > 1:
            found.append(scored)
    if not found:
        return None
    expert = float(np.mean([runs.values(entry)["expert_score"] for entry in entries if runs.path(entry)]))
    return Curves([rows[:, 0] for rows in found], [rows[:, 1] for rows in found], expert)


def _motions(runs: _Runs, table: ResultTable) -> Iterator[Drawing]:
    """Gains (or wrenches) of the trained policies, and what a task has of its own, for one observation."""
    task = tasks.make(table.definition.task)
    shown = view(task)
    rows = [row for row in table.of_role("method") if row.history == 1 and row.method != "constant"]
    for action in dict.fromkeys(row.action for row in rows):
        traces = _traces(runs, table, [row for row in rows if row.action == action])
        if len(traces) < 2:
            continue
        gains = action == "gain"
        figure = (gains_of_seeds if gains else wrench_of_seeds)(traces, zones=shown.zones)
        yield Drawing(
            f"{task.name}-{action}",
            f"{task.title}: {'gains' if gains else 'wrench'} over time",
            (shown.gains if gains else shown.wrench) + _SEEDS,
            figure,
        )
        for own in shown.figures({"training": {name: seeds[0] for name, seeds in traces.items()}}):
            yield Drawing(
                f"{task.name}-{action}-{own.file}",
                f"{task.title}, {action} actions: {own.title[0].lower()}{own.title[1:]}",
                f"{own.caption} Policies of the first seed.",
                own.figure,
            )


_SEEDS = " Lines are the median of the seeds, bands reach from the lowest to the highest."


def _traces(runs: _Runs, table: ResultTable, rows: Sequence[TableRow]) -> dict[str, list[Trace]]:
    """Episodes from the exact training start, by look; the expert first, the constant gain last."""
    traces: dict[str, list[Trace]] = {}
    for row in rows:
        paths = [path for entry in runs.of(table, row, "train") if (path := runs.path(entry)) is not None]
        skills = [load_skill(path) for path in paths]
        if skills:
            task = skills[0].task()
            traces.setdefault("expert", [record_trace(task, task.expert_action)])
            traces[row.method] = [record_trace(task, skill.judged.act) for skill in skills]
    if rows and rows[0].action == "gain" and traces:
        task = tasks.make(table.definition.task)
        traces["constant"] = [record_trace(task, Policy.constant(task).act)]
    return traces
