"""Cells that run a policy on the digital twin, against the human that it learned from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vic_toolbox.experiments.deployed import TRACES, Deployed, baseline, deploy
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.kinds import needed_folder
from vic_toolbox.experiments.study.untrained import untrained
from vic_toolbox.tasks import CupOnPlate


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Deploy; the values are deviations in mm and failures, ``traces.npz`` in the folder holds motion for figures.

    The setting ``policy`` is one of ``{"cell": name}``, the policy of a finished cell; ``{"baseline": name}``;
    ``{"untrained": seed}``, random weights with their exploration noise.
    """
    found = _deployed(cell.settings, study)
    folder.mkdir(parents=True, exist_ok=True)
    found.traces().save(folder / TRACES)
    return found.values()


def _deployed(settings: Mapping[str, Any], study: Path) -> Deployed:
    place: dict[str, Any] = {name: settings[name] for name in ("robot", "start", "episodes", "seed")}
    task = CupOnPlate(action=settings["action"], history=settings["history"])
    ((kind, which),) = settings["policy"].items()
    if kind == "baseline":
        return baseline(which, task, **place)
    if kind == "untrained":
        return deploy(lambda: untrained(task, which), task, **place)
    skill = load_skill(needed_folder(study, which))
    return deploy(lambda: skill.policy.mean, task, **place)


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core."""
    return 2.0 + 0.3 * settings["episodes"]
