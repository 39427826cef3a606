"""Cells that optimise a policy on another scenario under a frozen reward."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vic_toolbox.experiments.configuration import from_json
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.kinds import needed_folder
from vic_toolbox.experiments.transfer import transfer
from vic_toolbox.learning import TransferConfiguration


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Transfer the policy of the one cell that this one needs; the values are its evaluation."""
    (source,) = cell.needs
    settings = cell.settings
    return transfer(
        needed_folder(study, source),
        settings["scenario"],
        folder / "run",
        fresh=settings["fresh"],
        reward=settings["reward"],
        seed=settings["seed"],
        settings=from_json(TransferConfiguration, settings["transfer"], where=f"settings of {cell.name}"),
        episodes=settings["episodes"],
        resume=True,
        threads=1,
        report=False,
    ).to_json()


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core."""
    carried = settings["transfer"]
    return 2.0 + carried["iterations"] * (0.1 + 0.015 * carried["search"]["environments"])
