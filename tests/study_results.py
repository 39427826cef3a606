"""Studies whose results were made up: the folder of a study without any computation."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import vic_toolbox
from vic_toolbox import tasks
from vic_toolbox.experiments.difficulty import DifficultySweep
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.definition import Study, parse
from vic_toolbox.experiments.study.folder import Result, StudyFolder, write_result
from vic_toolbox.experiments.study.plan import Entry

Value = Callable[[Entry], float | None]
"""What comes out of the cell of an entry, as success rate and as relative difference; None for no result."""


def definition(**changes: Any) -> Study:
    """Two small tables, over tilts and over starts."""
    tree: dict[str, Any] = {
        "name": "small",
        "title": "A small study",
        "seeds": [1, 2, 3],
        "budget": {"peg-in-hole": {"episodes": 50}},
        "table": [
            {
                "name": "I",
                "title": "Peg-in-Hole over tilts",
                "task": "peg-in-hole",
                "metric": "success",
                "scenarios": ["tilt=-6", "train", "tilt=2"],
                "controls": [
                    "no-transfer",
                    "random",
                    "fresh",
                    "fresh-random",
                    "untrained",
                    "expert",
                    "matched",
                ],
                "histories": [1, 5],
                "halved_step": ["tilt=-6"],
                "sweeps": ["tilt"],
                "paper": {"Gain-AIRL": [0.917, 0.983, 1.0], "Gain-AIRL-His": [1.0, 1.0, 0.933]},
            },
            {
                "name": "III",
                "title": "Cup-on-Plate from other starts",
                "task": "cup-on-plate",
                "metric": "difference",
                "scenarios": ["train", "T3"],
                "controls": ["no-transfer", "random", "expert"],
                "paper": {"Gain-AIRL": [0.01, 0.19], "Gain-BC": [0.02, 0.25]},
            },
        ],
    }
    return parse(tree | changes, where="the test's definition")


def write_study(path: Path, study: Study, value: Value) -> StudyFolder:
    """A study whose cells have the results that `value` says."""
    with StudyFolder.create(path, study) as folder:
        by_cell = {entry.cell: entry for entry in folder.plan.entries}
        for cell in folder.cells:
            entry = by_cell.get(cell.name)
            if entry is None:
                values: dict[str, Any] = evaluation(0.9, 50, cell)
            elif (found := value(entry)) is None:
                continue
            elif entry.role == "sweep":
                values = sweep(found, cell)
            else:
                values = evaluation(found, study.budget_of(cell_task(cell)).episodes, cell, entry)
            result = Result(cell, values, 60.0, vic_toolbox.__version__, "a processor, 4 cores")
            write_result(folder.cell_path(cell.name), result)
        return folder


def cell_task(cell: Cell) -> str:
    """Name of a cell's task, by its own name."""
    return cell.name.split("/")[0]


def evaluation(value: float, episodes: int, cell: Cell, entry: Entry | None = None) -> dict[str, Any]:
    """An evaluation of this success rate; its relative difference is the same number."""
    low, high = wilson_interval(min(value, 1.0), episodes)
    return Evaluation(
        task=cell_task(cell),
        scenario=entry.scenario if entry else "train",
        method=entry.method if entry else "airl",
        transfer="",
        action=entry.action if entry else "gain",
        history=entry.history if entry else 1,
        seed=(entry.seed or 0) if entry else 0,
        start_seed=1000,
        episodes=episodes,
        success_rate=min(value, 1.0),
        success_low=low,
        success_high=high,
        score_mean=-10.0,
        score_std=1.0,
        expert_score=-9.0,
        expert_success_rate=1.0,
        relative_difference=value,
        signed_difference=value,
        peak_force_mean=3.0,
    ).to_json()


def sweep(height: float, cell: Cell) -> dict[str, Any]:
    """The summary of a sweep whose success falls off on both sides."""
    axis = tasks.make(cell_task(cell)).sweeps[cell.settings["quantity"]]
    x = np.array(axis.values, dtype=float)
    looks = list(cell.settings["policies"]) or ["expert", "constant"]
    rate = height * np.exp(-((x / max(abs(x).max(), 1e-9)) ** 2))
    return DifficultySweep(
        cell_task(cell),
        axis.label,
        axis.label,
        x,
        50,
        1000,
        {look: rate for look in looks},  # noqa: C420
    ).summary()
