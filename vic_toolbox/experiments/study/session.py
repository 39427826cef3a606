"""Cells that record a guided session on the digital twin and fit its gains."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vic_toolbox.experiments.guided import record_session
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.experiments.study.cell import Cell


def run(cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
    """Record and fit; the values say how good the fits are, the demonstrations lie in the folder, one file a fit."""
    del study  # it needs no other cell
    session = cell.settings["session"]
    settings = SessionSettings(**(session | {"fits": tuple(session["fits"])}))
    return record_session(settings, folder, seed=cell.settings["seed"])


def effort(settings: Mapping[str, Any]) -> float:
    """About the seconds on one core."""
    return 5.0 + 0.5 * settings["session"]["count"]
