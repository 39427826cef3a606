"""How far a Cup-on-Plate skill carries: policies judged from starts at many distances and bearings around the goal."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vic_toolbox.errors import InputError, finite_number, integer
from vic_toolbox.experiments.evaluation import START_NOISE, START_SEED, Policy, baselines, run_episodes
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.start_sweep import sweep_maps
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.skill import Skill, side_by_side
from vic_toolbox.files import write_atomically, write_json
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.cup_scene import GOAL, start_angles


@dataclass(frozen=True)
class StartGrid:
    """Starts on rings around the goal, all seen from it under the same elevation."""

    nearest: float = 0.25
    """Distance of the innermost ring [m]."""
    farthest: float = 1.05
    """Distance of the outermost ring [m]."""
    rings: int = 9
    """Number of rings."""
    bearings: int = 24
    """Starts on a ring."""
    elevation: float = 30.0
    """Angle of the starts above the horizontal, seen from the goal [deg]."""

    def __post_init__(self) -> None:
        finite_number("nearest", self.nearest, low=0.05)
        finite_number("farthest", self.farthest, low=self.nearest)
        finite_number("elevation", self.elevation, low=5.0, high=85.0)
        integer("rings", self.rings, low=1)
        integer("bearings", self.bearings, low=1)

    def starts(self) -> np.ndarray:
        """All of them, reachable or not, (rings · bearings, 3) [m]."""
        distance, bearing = np.meshgrid(
            np.linspace(self.nearest, self.farthest, self.rings),
            np.linspace(-np.pi, np.pi, self.bearings, endpoint=False),
            indexing="ij",
        )
        slope = np.radians(self.elevation)
        flat = np.cos(slope) * distance
        offset = np.stack([flat * np.cos(bearing), flat * np.sin(bearing), np.sin(slope) * distance], axis=-1)
        return np.array(GOAL) + offset.reshape(-1, 3)


@dataclass(frozen=True)
class Sweep:
    """Results by start; each row of an array is a start.

    Attributes
    ----------
    starts : ndarray, shape (n, 3)
        Starts that were judged [m].
    unreachable : ndarray, shape (m, 3)
        Starts that were left out, since the arm cannot begin there [m].
    score, success : dict of ndarray, shape (n,)
        Mean over the episodes, by look; the expert among them.
    """

    starts: np.ndarray
    unreachable: np.ndarray
    score: Mapping[str, np.ndarray]
    success: Mapping[str, np.ndarray]

    @property
    def relative_difference(self) -> dict[str, np.ndarray]:
        """``|S − S_e| / |S_e|`` of each method but the expert, (n,)."""
        expert = self.score["expert"]
        return {name: np.abs((s - expert) / expert) for name, s in self.score.items() if name != "expert"}

    @property
    def distance(self) -> np.ndarray:
        """Distance of each start from the goal, (n,) [m]."""
        return np.linalg.norm(self.starts - GOAL, axis=1)

    @property
    def bearing(self) -> np.ndarray:
        """Direction of each start, seen from the goal, (n,) [deg]."""
        offset = self.starts - GOAL
        return np.degrees(np.arctan2(offset[:, 1], offset[:, 0]))

    def summary(self) -> dict[str, Any]:
        """Numbers over all starts, for tables."""
        methods = {
            name: {
                "relative_difference_mean": float(difference.mean()),
                "relative_difference_worst": float(difference.max()),
                "success_rate": float(self.success[name].mean()),
            }
            for name, difference in self.relative_difference.items()
        }
        return {
            "starts": len(self.starts),
            "unreachable": len(self.unreachable),
            "expert_success_rate": float(self.success["expert"].mean()),
            "methods": methods,
        }

    def write(self, folder: Path) -> None:
        """Write ``sweep.json`` (summary), ``sweep.csv`` (every start) and ``sweep.svg``."""
        write_json(folder / "sweep.json", self.summary())
        write_atomically(folder / "sweep.csv", self._csv())
        drawing = sweep_maps(
            self.starts, np.array(GOAL), self.relative_difference, self.success, unreachable=self.unreachable
        )
        style.save(drawing, folder / "sweep.svg")

    def _csv(self) -> str:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        heads = [f"{what}_{name}" for name in self.score for what in ("score", "success")]
        writer.writerow(["x", "y", "z", "distance", "bearing", *heads])
        for i, start in enumerate(self.starts):
            place = [*start, self.distance[i], self.bearing[i]]
            values = [column[name][i] for name in self.score for column in (self.score, self.success)]
            writer.writerow([f"{value:.6g}" for value in (*place, *values)])
        return text.getvalue()


def sweep_starts(
    task: Task,
    policies: Mapping[str, Policy],
    *,
    grid: StartGrid | None = None,
    episodes: int = 1,
    seed: int = START_SEED,
    threads: int = 0,
    progress: Progress | None = None,
) -> Sweep:
    """Run every policy and the expert from every reachable start of a grid.

    Parameters
    ----------
    task : Task
        Cup-on-Plate, as the policies know it; its own scenario does not matter.
    policies : dict of Policy
        What to judge, by look.
    grid : StartGrid, optional
        Where to start.
    episodes : int
        Episodes from each start; one begins exactly there, more vary the joint angles a little.
    seed : int
        Draws that variation.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.
    progress : Progress, optional
        Told how it goes; by default nobody.

    Raises
    ------
    InputError
        No start of the grid can be reached.
    """
    progress = progress or Progress()
    episodes = integer("episodes", episodes, low=1)
    everywhere = (grid or StartGrid()).starts()
    progress.stage("reachable starts", len(everywhere))
    reachable = np.zeros(len(everywhere), dtype=bool)
    for i, start in enumerate(everywhere):
        reachable[i] = _can_start(start)
        progress.update(i + 1)
    starts = everywhere[reachable]
    if not len(starts):
        raise InputError(
            "none of the grid's starts can be reached; bring them nearer or change the elevation."
        )
    scenarios = [tuple(start) for start in starts for _ in range(episodes)]
    noise = 0.0 if episodes == 1 else START_NOISE
    contestants = {"expert": Policy.expert(task)} | dict(policies)
    progress.stage("sweep", len(contestants))
    run = partial(
        run_episodes,
        task,
        episodes=len(scenarios),
        scenarios=scenarios,
        start_noise=noise,
        seed=seed,
        threads=threads,
    )
    score, success = {}, {}
    for i, (name, policy) in enumerate(contestants.items()):
        outcome = run(policy.act)
        score[name] = outcome.score.reshape(len(starts), episodes).mean(axis=1)
        success[name] = outcome.success.reshape(len(starts), episodes).mean(axis=1)
        progress.update(i + 1)
    return Sweep(starts, everywhere[~reachable], score, success)


def sweep_runs(skills: Sequence[Skill], **options: Any) -> Sweep:
    """Sweep the policies of several runs and the constant gain; see :func:`sweep_starts` for the options.

    Raises
    ------
    InputError
        The runs are not of the same task.
    """
    task, policies = side_by_side(skills)
    return sweep_starts(task, policies | baselines(task), **options)


def _can_start(start: np.ndarray) -> bool:
    try:
        start_angles(tuple(start))
    except InputError:
        return False
    return True
