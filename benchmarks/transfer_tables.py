"""The tables of `benchmarks.transfer`: cells of single seeds put together, as JSON values and as a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from scipy import stats

from benchmarks.studies import Study
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.intervals import wilson_interval


@dataclass(frozen=True)
class Cell:
    """One number of the table: a row, a scenario, a seed, the signed relative difference to the expert, and the
    share of successes.
    """

    row: str
    scenario: str
    seed: int
    signed: float
    success: float

    @classmethod
    def of(cls, row: str, seed: int, evaluation: Evaluation) -> Cell:
        """The cell of an evaluation."""
        return cls(row, evaluation.scenario, seed, evaluation.signed_difference, evaluation.success_rate)


class Swept(Protocol):
    """Results of a sweep."""

    def summary(self) -> dict[str, Any]:
        """Numbers, as JSON values."""
        ...

    def write(self, folder: Path) -> None:
        """Write files."""
        ...


def interval(values: np.ndarray) -> float:
    """Half width of the 95 % confidence interval of the mean (Student's t)."""
    if len(values) < 2:
        return float("nan")
    return float(stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))


def summarise(cells: list[Cell], study: Study) -> list[dict[str, Any]]:
    """Mean over the seeds of the study's metric with its interval, signed mean and success rate, for each cell."""
    found: dict[tuple[str, str], list[Cell]] = {}
    for cell in cells:
        found.setdefault((cell.row, cell.scenario), []).append(cell)
    return [_entry(row, scenario, group, study) for (row, scenario), group in found.items()]


def _entry(row: str, scenario: str, group: list[Cell], study: Study) -> dict[str, Any]:
    signed = np.array([cell.signed for cell in group])
    success = np.array([cell.success for cell in group])
    values = success if study.metric == "success" else np.abs(signed)
    half = interval(values)
    return {
        "row": row,
        "scenario": scenario,
        "seeds": len(group),
        "mean": float(values.mean()),
        "half_interval": half if np.isfinite(half) else None,
        "signed_mean": float(signed.mean()),
        "success": float(success.mean()),
        "success_interval": list(wilson_interval(float(success.mean()), len(group) * study.episodes)),
        "paper": study.paper.get(row, {}).get(scenario),
        "values": (success if study.metric == "success" else signed).tolist(),
    }


def markdown(
    study: Study, table: list[dict[str, Any]], sweeps: Mapping[tuple[str, str, int], Swept], command: str
) -> str:
    """The tables as a page."""
    return "\n".join([*_introduction(study, command), *_table(study, table), *_sweeps(study, sweeps)]) + "\n"


_TITLES = {"cup-on-plate": "Cup-on-Plate", "peg-in-hole": "Peg-in-Hole"}


def _introduction(study: Study, command: str) -> list[str]:
    if study.metric == "success":
        meaning = (
            f"Success in %, mean over the seeds ± half of the 95 % interval over the seeds, {study.episodes} episodes "
            "a cell and seed; (the paper's number, best three of five seeds)."
        )
    else:
        meaning = (
            "|score − expert's score| / |expert's score|, mean over the seeds ± half of the 95 % interval, "
            f"{study.episodes} episodes a cell; (the paper's number, best three of five seeds). "
            "Success is 100 % unless given."
        )
    return [f"# {_TITLES[study.task]}: what transfers", "", f"Made by `{command}`. {meaning}", ""]


def _table(study: Study, table: list[dict[str, Any]]) -> list[str]:
    rows = list(dict.fromkeys(entry["row"] for entry in table))
    by_cell = {(entry["row"], entry["scenario"]): entry for entry in table}
    text = _success_text if study.metric == "success" else _difference_text
    lines = ["| | " + " | ".join(study.scenarios) + " |", "|---" * (len(study.scenarios) + 1) + "|"]
    for row in rows:
        cells = (by_cell.get((row, scenario)) for scenario in study.scenarios)
        lines.append(f"| {row} | " + " | ".join("" if cell is None else text(cell) for cell in cells) + " |")
    return [
        *lines,
        "",
        "*Random reward*: the same optimisation under an untrained reward network, the control.",
        f"*Fresh policy*: from random weights, {study.fresh_iterations} iterations; otherwise the trained policy "
        "continues. *Dither*: the middle of every gain's range, with noise on it.",
        "",
    ]


def _success_text(entry: dict[str, Any]) -> str:
    half, paper = entry["half_interval"], entry["paper"]
    spread = f" ± {100 * half:.0f}" if half else ""
    return f"{100 * entry['mean']:.0f}{spread}" + (f" ({100 * paper:.0f})" if paper is not None else "")


def _difference_text(entry: dict[str, Any]) -> str:
    half = f" ± {entry['half_interval']:.3f}" if entry["half_interval"] is not None else ""
    paper = f" ({entry['paper']:.2f})" if entry["paper"] is not None else ""
    success = "" if entry["success"] == 1.0 else f", {100 * entry['success']:.0f} %"
    return f"{entry['mean']:.3f}{half}{paper}{success}"


def _sweeps(study: Study, sweeps: Mapping[tuple[str, str, int], Swept]) -> list[str]:
    if study.sweeps == ("start",):
        return _starts(study, {(action, seed): swept for (_, action, seed), swept in sweeps.items()})
    lines = [
        "## Beyond the paper's scenarios, without transfer",
        "",
        "Area under the success curve (1 is success everywhere), mean over the seeds for gain actions, of the first "
        "seed for force actions; the figures show the gain policies of the first seed.",
        "",
    ]
    for action in ("gain", "force"):
        lines += [f"**{action} actions**", ""]
        own = {
            (quantity, seed): swept for (quantity, space, seed), swept in sweeps.items() if space == action
        }
        lines += _areas(study, own)
    for quantity in study.sweeps:
        lines += [f"![Success against {quantity}]({study.file}/{quantity}/sweep.svg)", ""]
    return lines


def _areas(study: Study, sweeps: Mapping[tuple[str, int], Swept]) -> list[str]:
    areas: dict[tuple[str, str], list[float]] = {}
    for (quantity, _), swept in sweeps.items():
        for name, method in swept.summary()["methods"].items():
            areas.setdefault((name, quantity), []).append(method["area"])
    names = dict.fromkeys(name for name, _ in areas)
    lines = ["| | " + " | ".join(study.sweeps) + " |", "|---" * (len(study.sweeps) + 1) + "|"]
    for name in names:
        lines.append(
            f"| {name} | " + " | ".join(f"{np.mean(areas[name, q]):.2f}" for q in study.sweeps) + " |"
        )
    return [*lines, ""]


def _starts(study: Study, sweeps: Mapping[tuple[str, int], Swept]) -> list[str]:
    lines = [
        "## Starts all around the arm, without transfer",
        "",
        f"![Relative difference and success over the starts]({study.file}/start/sweep.svg)",
        "",
        "The figure shows the gain policies of the first seed.",
        "",
        "| action | policy | seed | mean difference | worst | success |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {action} | {name} | {seed} | {entry['relative_difference_mean']:.3f} "
        f"| {entry['relative_difference_worst']:.3f} | {100 * entry['success_rate']:.0f} % |"
        for (action, seed), found in sweeps.items()
        for name, entry in found.summary()["methods"].items()
    ]
    return lines
