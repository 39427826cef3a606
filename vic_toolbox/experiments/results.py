"""Evaluations on disk."""

from __future__ import annotations

from vic_toolbox.experiments.configuration import from_json
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.files import read_json, write_json


def write_evaluation(folder: RunFolder, evaluation: Evaluation) -> None:
    """Write it as the run's latest, and under ``evaluations/<scenario>/``."""
    for path in (folder.path / "evaluations" / evaluation.scenario, folder.path):
        write_json(path / "evaluation.json", evaluation.to_json())


def read_evaluation(folder: RunFolder, scenario: str) -> Evaluation:
    """The run's latest evaluation on a scenario.

    Raises
    ------
    FileError
        Missing or damaged.
    """
    path = folder.path / "evaluations" / scenario / "evaluation.json"
    return from_json(Evaluation, read_json(path), where=str(path))
