"""Sweeps of a study, put together over the seeds: success along a quantity, scores over starts all around."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vic_toolbox.experiments.difficulty import START
from vic_toolbox.experiments.figures.study_difficulty import Line
from vic_toolbox.experiments.study.folder import Result
from vic_toolbox.experiments.study.metric import METRICS
from vic_toolbox.experiments.study.plan import Entry, Plan, row_name
from vic_toolbox.experiments.study.statistics import Estimate, rate_estimate


@dataclass(frozen=True)
class Sweep:
    """Success along one quantity.

    Attributes
    ----------
    quantity, label : str
        Its name, and with its unit.
    values : ndarray, shape (n,)
        Where it was judged, ascending.
    lines : mapping
        Lines by action space; what needs no training belongs to both.
    areas : mapping
        Area under each line over the width of the range, by the name of the line.
    """

    quantity: str
    label: str
    values: np.ndarray
    lines: Mapping[str, Sequence[Line]]
    areas: Mapping[str, float]


@dataclass(frozen=True)
class StartSweep:
    """A sweep over starts as a table."""

    title: str
    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


def sweeps(plan: Plan, results: Mapping[str, Result], table: str) -> list[Sweep]:
    """The sweeps of a table along a quantity whose cells are all done."""
    return [
        _sweep(group, results)
        for quantity, group in _complete(plan, results, table).items()
        if quantity != START
    ]


def start_sweep(plan: Plan, results: Mapping[str, Result], table: str) -> StartSweep | None:
    """The sweep over starts of a table, if there is one and its cells are all done."""
    group = _complete(plan, results, table).get(START)
    if group is None:
        return None
    shown = METRICS["difference"]
    by_method: dict[str, list[Mapping[str, float]]] = {}
    for entry in group:
        for look, numbers in results[entry.cell].values["methods"].items():
            by_method.setdefault(_name(entry, look), []).append(numbers)
    rows = []
    for name, seeds in by_method.items():
        mean = np.array([numbers["relative_difference_mean"] for numbers in seeds])
        found = shown.estimate(mean.tolist(), episodes=1)
        interval = (
            ""
            if found.low is None or found.high is None
            else " " + shown.interval_text(found.low, found.high)
        )
        worst = max(numbers["relative_difference_worst"] for numbers in seeds)
        success = np.mean([numbers["success_rate"] for numbers in seeds])
        rows.append((name, shown.text(found.mean) + interval, shown.text(worst), f"{100 * success:.1f} %"))
    first = results[group[0].cell].values
    return StartSweep(
        "Starts all around the arm, without transfer",
        f"{first['starts']} starts on rings around the goal. Relative difference to the expert's score, mean over "
        "starts and seeds with its 95 % interval over the seeds; the worst start of any seed; share of starts that "
        f"succeed. The expert succeeds in {100 * first['expert_success_rate']:.1f} %.",
        ("policy", "relative difference", "worst", "success"),
        tuple(rows),
    )


def _complete(plan: Plan, results: Mapping[str, Result], table: str) -> dict[str, list[Entry]]:
    """Entries of the sweeps of which no cell is missing, by quantity."""
    found: dict[str, list[Entry]] = {}
    for entry in plan.entries:
        if entry.table == table and entry.role == "sweep":
            found.setdefault(entry.row, []).append(entry)
    return {
        quantity: group for quantity, group in found.items() if all(entry.cell in results for entry in group)
    }


def _sweep(group: Sequence[Entry], results: Mapping[str, Result]) -> Sweep:
    first = results[group[0].cell].values
    x = np.array(first["values"], dtype=float)
    curves: dict[tuple[str, str, str], list[np.ndarray]] = {}
    for entry in group:
        for look, numbers in results[entry.cell].values["methods"].items():
            key = ("" if entry.seed is None else entry.action, look, _name(entry, look))
            curves.setdefault(key, []).append(np.array(numbers["success"]))
    lines: dict[str, list[Line]] = {action: [] for action, *_ in curves if action}
    areas = {}
    for (action, look, name), seeds in curves.items():
        line = _line(name, look, np.array(seeds), int(first["episodes"]))
        areas[name] = (
            float(np.trapezoid(line.mean, x) / (x[-1] - x[0])) if len(x) > 1 else float(line.mean[0])
        )
        for panel in lines if not action else [action]:
            lines[panel].append(line)
    return Sweep(group[0].row, first["label"], x, lines, areas)


def _line(name: str, look: str, rates: np.ndarray, episodes: int) -> Line:
    """A line of the rates of k seeds at n values, (k, n)."""
    return line(name, look, [rate_estimate(column.tolist(), episodes=episodes) for column in rates.T])


def line(name: str, look: str, estimates: Sequence[Estimate | None], *, dashed: bool = False) -> Line:
    """A line through estimates; None leaves a gap."""
    columns = [
        [np.nan if found is None else value(found) for found in estimates]
        for value in (lambda f: f.mean, lambda f: f.low, lambda f: f.high)
    ]
    mean, low, high = (np.array(column, dtype=float) for column in columns)
    return Line(name, look, mean, low, high, dashed)


def _name(entry: Entry, look: str) -> str:
    if entry.seed is not None:
        return row_name(look, entry.action, entry.history)
    return "Expert" if look == "expert" else f"{look.capitalize()} gain"
