"""Cells that train a policy and judge it on the training scenario."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vic_toolbox.experiments.configuration import RecordedDemonstrations, RunConfiguration, from_json
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.training import train


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Train what the settings (a :class:`RunConfiguration`) say; the values are its evaluation.

    Where ``demonstrations`` is ``{"cell": name, "file": name}``, they are that file of a finished cell.
    """
    settings, file = dict(cell.settings), None
    if "cell" in settings["demonstrations"]:
        source = settings["demonstrations"]
        file = study / "cells" / source["cell"] / source["file"]
        settings["demonstrations"] = asdict(RecordedDemonstrations.of(file))
    configuration = from_json(RunConfiguration, settings, where=f"settings of {cell.name}")
    return train(
        configuration, folder / "run", resume=True, threads=1, report=False, demonstrations=file
    ).to_json()


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core."""
    recipe = settings["recipe"]
    if settings["method"] != "airl":
        return 3.0 + 0.005 * recipe["cloning"]["steps"]
    airl = recipe["airl"]
    return 5.0 + airl["iterations"] * (0.25 + 0.016 * airl["search"]["environments"])
