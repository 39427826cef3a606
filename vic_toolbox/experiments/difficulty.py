"""How hard a task may become before a skill fails: success along one quantity, one method beside the other."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vic_toolbox import tasks
from vic_toolbox.errors import InputError, integer
from vic_toolbox.experiments.evaluation import START_SEED, Policy, baselines, run_episodes
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.difficulty import success_curves
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.skill import Skill, side_by_side
from vic_toolbox.files import write_atomically, write_json
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.task import SweepAxis

START = "start"
"""Name of the sweep over Cup-on-Plate's starts (:mod:`~vic_toolbox.experiments.start_sweep`)."""


def offered_sweeps(task: Task) -> tuple[str, ...]:
    """Names of the sweeps that a task has."""
    return (START,) * (task.name == "cup-on-plate") + tuple(task.sweeps)


def sweep_axis(task: Task, quantity: str) -> SweepAxis:
    """A quantity of the task by name.

    Raises
    ------
    InputError
        The task has no such sweep; the message names those that it has.
    """
    if quantity not in task.sweeps:
        offered = ", ".join(offered_sweeps(task)) or "none"
        raise InputError(f"{task.title} has no sweep {quantity!r}; choose one of: {offered}.")
    return task.sweeps[quantity]


@dataclass(frozen=True)
class DifficultySweep:
    """Success of every method at every value of one quantity.

    Attributes
    ----------
    task, quantity, label : str
        Names of the task and of the quantity, and the quantity with its unit.
    values : ndarray, shape (n,)
        Where it was judged, ascending.
    episodes : int
        Episodes at each value.
    start_seed : int
        Of the starts.
    success : dict of ndarray, shape (n,)
        Success rates by look; the expert and the constant gains among them.
    """

    task: str
    quantity: str
    label: str
    values: np.ndarray
    episodes: int
    start_seed: int
    success: Mapping[str, np.ndarray]

    def interval(self, name: str) -> np.ndarray:
        """Ends (low, high) of a method's 95 % intervals, (2, n)."""
        return np.array([wilson_interval(float(rate), self.episodes) for rate in self.success[name]]).T

    def area(self, name: str) -> float:
        """Area under a method's success curve over the width of the range, in [0, 1]: its mean success."""
        rate = self.success[name]
        if len(rate) == 1:
            return float(rate[0])
        return float(np.trapezoid(rate, self.values) / (self.values[-1] - self.values[0]))

    def summary(self) -> dict[str, Any]:
        """Everything, as JSON values."""
        methods = {}
        for name, rate in self.success.items():
            low, high = self.interval(name)
            columns = {"success": rate, "low": low, "high": high}
            methods[name] = {"area": self.area(name)} | {key: v.tolist() for key, v in columns.items()}
        return {
            "task": self.task,
            "quantity": self.quantity,
            "label": self.label,
            "episodes": self.episodes,
            "start_seed": self.start_seed,
            "values": self.values.tolist(),
            "methods": methods,
        }

    def write(self, folder: Path) -> None:
        """Write ``sweep.json`` (everything), ``sweep.csv`` (a row for each value) and ``sweep.svg``."""
        write_json(folder / "sweep.json", self.summary())
        write_atomically(folder / "sweep.csv", self._csv())
        intervals = {name: self.interval(name) for name in self.success}
        areas = {name: self.area(name) for name in self.success}
        drawing = success_curves(self.values, self.success, intervals, areas=areas, label=self.label)
        style.save(drawing, folder / "sweep.svg")

    def _csv(self) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        heads = [f"{what}_{name}" for name in self.success for what in ("success", "low", "high")]
        writer.writerow([self.quantity, *heads])
        columns = [column for name in self.success for column in (self.success[name], *self.interval(name))]
        for row in zip(self.values, *columns, strict=True):
            writer.writerow([f"{value:.6g}" for value in row])
        return text.getvalue()


def sweep_difficulty(
    task: Task,
    policies: Mapping[str, Policy],
    quantity: str,
    *,
    episodes: int = 50,
    seed: int = START_SEED,
    threads: int = 0,
    progress: Progress | None = None,
    beside: bool = True,
) -> DifficultySweep:
    """Run every policy, the expert and the constant gains at every value of a quantity.

    Every value has the same starts, varied as usual; an evaluation on that scenario with the same seed runs the very
    same episodes.

    Parameters
    ----------
    task : Task
        Task of the policies; its own scenario does not matter.
    policies : dict of Policy
        What to judge, by look.
    quantity : str
        Name of the quantity in ``task.sweeps``.
    episodes : int
        Episodes at each value.
    seed : int
        Draws the starts.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.
    progress : Progress, optional
        Told how it goes; by default nobody.
    beside : bool
        Run the expert and the constant gains too.

    Raises
    ------
    InputError
        The task has no such sweep, or a number is out of range.
    """
    progress = progress or Progress()
    axis = sweep_axis(task, quantity)
    episodes = integer("episodes", episodes, low=1)
    integer("seed", seed, low=0)
    success: dict[str, list[float]] = {}
    progress.stage(f"sweep over {quantity}", len(axis.values))
    for i, value in enumerate(axis.values):
        there = tasks.make(task.name, action=task.action, history=task.history, scenario=axis.scenario(value))
        contestants = dict(policies)
        if beside:
            contestants = {"expert": Policy.expert(there), **contestants, **baselines(there)}
        for name, policy in contestants.items():
            outcome = run_episodes(there, policy.act, episodes=episodes, seed=seed, threads=threads)
            success.setdefault(name, []).append(float(outcome.success.mean()))
        progress.update(i + 1)
    return DifficultySweep(
        task=task.name,
        quantity=quantity,
        label=axis.label,
        values=np.array(axis.values, dtype=np.float64),
        episodes=episodes,
        start_seed=seed,
        success={name: np.array(rates) for name, rates in success.items()},
    )


def sweep_runs_difficulty(skills: Sequence[Skill], quantity: str, **options: Any) -> DifficultySweep:
    """Sweep the policies of several runs; see :func:`sweep_difficulty` for the options.

    Raises
    ------
    InputError
        The runs are not of the same task.
    """
    task, policies = side_by_side(skills)
    return sweep_difficulty(task, policies, quantity, **options)
