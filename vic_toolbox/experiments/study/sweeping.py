"""Cells that judge policies along one quantity that makes the task harder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vic_toolbox import tasks
from vic_toolbox.experiments.difficulty import START, sweep_difficulty
from vic_toolbox.experiments.evaluation import baselines
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.start_sweep import sweep_starts
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.kinds import needed_folder


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Sweep over ``quantity``; the values are the sweep's summary, files with every number and a figure lie beside.

    ``policies`` maps looks to cells. Without any the expert and the constant gains are judged; they are the same for
    every seed. (A sweep over starts has the expert in any case, whose score it compares with.)
    """
    settings = cell.settings
    task = tasks.make(settings["task"], action=settings["action"], history=settings["history"])
    policies = {
        look: load_skill(needed_folder(study, name)).judged for look, name in settings["policies"].items()
    }
    if settings["quantity"] == START:
        swept = sweep_starts(task, policies or baselines(task), threads=1)
    else:
        swept = sweep_difficulty(
            task,
            policies,
            settings["quantity"],
            episodes=settings["episodes"],
            threads=1,
            beside=not policies,
        )
    swept.write(folder)
    return swept.summary()


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core."""
    task = tasks.make(settings["task"])
    runs = len(settings["policies"]) or 1 + len(task.constants)
    if settings["quantity"] == START:
        return 5.0 + 20.0 * (1 + runs)
    return 1.0 + 0.06 * runs * len(task.sweeps[settings["quantity"]].values) * settings["episodes"]
