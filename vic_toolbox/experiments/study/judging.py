"""Cells that judge a policy on a scenario, without learning anything."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vic_toolbox import tasks
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.evaluation import Policy, evaluate
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.kinds import needed_folder
from vic_toolbox.experiments.study.untrained import untrained
from vic_toolbox.tasks import Task


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Judge a policy; the values are its evaluation.

    The setting ``policy`` is one of ``{"cell": name}``, the policy of a finished cell; ``{"baseline": name}``, the
    expert or a constant gain; ``{"untrained": seed}``, random weights with their exploration noise. ``time_step``
    is in units of the task's own physics step.
    """
    del folder  # it leaves no files
    settings = cell.settings
    options = {name: settings[name] for name in ("action", "history", "scenario")}
    task = tasks.make(settings["task"], **options)
    if settings["time_step"] != 1.0:
        task = tasks.make(settings["task"], **options, substeps=round(task.substeps / settings["time_step"]))
    policy = _policy(settings, task, study)
    return evaluate(task, policy, episodes=settings["episodes"], threads=1).to_json()


def _policy(settings: Mapping[str, Any], task: Task, study: Path) -> Policy:
    ((kind, which),) = settings["policy"].items()
    if kind == "cell":
        return load_skill(needed_folder(study, which)).judged
    if kind == "baseline":
        return Policy.expert(task) if which == "expert" else Policy.constant(task, which=which)
    if kind == "untrained":
        return Policy(untrained(task, which), "untrained", seed=which)
    raise InputError(f"policy is of the kind {kind!r}; it should be a cell, a baseline or untrained.")


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core; the expert is judged beside the policy."""
    return 0.5 + 0.08 * settings["episodes"] / settings["time_step"]
