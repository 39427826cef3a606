"""Policies on the digital twin, measured against the human that they learned from.

The reference is the path that the same human means from the same posture on the same robot: his impedance over time,
without his unrest (sway, tremor) and without the push that was only there to identify him. His own unrest moves him by
1-2 mm from it; a row "Human again" says how much.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vic_toolbox import twin
from vic_toolbox.errors import Array, FileError, InputError, finite_array, one_of
from vic_toolbox.files import read_arrays, write_arrays
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.tasks.cup_on_plate import GAINS
from vic_toolbox.twin.deployment import Deployment, Policy

BESIDE = cup_scene.PLATE_RADIUS + cup_scene.CUP_RADIUS
"""A cup that ends farther than this from where the human puts it stands beside the plate: it has failed [m]."""
KEPT = 3
"""Episodes whose motion is kept for figures."""
TRACES = "traces.npz"
_FORMAT = "vic-deployment/1"


@dataclass(frozen=True, eq=False)
class Deployed:
    """A policy's episodes on the twin, beside the human's and its own on the nominal arm, from the same postures."""

    on_twin: Deployment
    nominal: Deployment
    human: Deployment

    def values(self) -> dict[str, Any]:
        """Deviations from the human's path [mm], how many failed, and what else tells how it went.

        Returns
        -------
        dict
            Means over the episodes: ``mean_deviation`` along the path and ``final_deviation`` [mm], with ``..._each``;
            ``success_rate`` and ``stopped_rate``; ``nominal_deviation``, mean and end between twin and nominal arm
            [mm]; ``distance`` of twin and human to the goal at the end [mm]; ``peak_force`` [N].
        """
        mean, end = (1e3 * x for x in self.on_twin.deviation(self.human))
        failed = np.logical_or(self.on_twin.stopped, end > 1e3 * BESIDE)
        ends = {
            name: float(1e3 * np.linalg.norm(motion.error[:, -1, :3], axis=-1).mean())
            for name, motion in (("twin", self.on_twin), ("human", self.human))
        }
        return {
            "mean_deviation": float(mean.mean()),
            "final_deviation": float(end.mean()),
            "mean_deviation_each": mean.tolist(),
            "final_deviation_each": end.tolist(),
            "success_rate": float(1.0 - failed.mean()),
            "stopped_rate": float(self.on_twin.stopped.mean()),
            "nominal_deviation": [1e3 * float(x.mean()) for x in self.on_twin.deviation(self.nominal)],
            "distance": ends,
            "peak_force": float(self.on_twin.peak_force.max()),
            "episodes": len(mean),
        }

    def traces(self) -> Traces:
        """The first few episodes, for figures."""
        return Traces(
            self.on_twin.time,
            *(motion.error[:KEPT] for motion in (self.on_twin, self.nominal, self.human)),
        )


@dataclass(frozen=True, eq=False)
class Traces:
    """Motion of a few episodes: e and ė (k, T + 1, 12) at the times (T + 1,) [s], on the twin, nominal, the human's."""

    time: Array
    on_twin: Array
    nominal: Array
    human: Array

    def save(self, path: Path) -> None:
        """Write one ``.npz``, whole or not at all."""
        arrays = {name: getattr(self, name).astype(np.float32) for name in ("on_twin", "nominal", "human")}
        write_arrays(path, {"format": _FORMAT, "time": self.time} | arrays)

    @classmethod
    def load(cls, path: Path) -> Traces:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            Missing, damaged, or something else.
        """
        content = read_arrays(path, "traces of a deployment", remedy="run it again")
        if str(content.pop("format", "")) != _FORMAT or content.keys() != {
            field.name for field in fields(cls)
        }:
            raise FileError(f"{path} holds no traces of a deployment of format {_FORMAT}; run it again.")
        shape = (None, len(np.atleast_1d(content["time"])), 12)
        try:
            time = finite_array("time", content.pop("time"), shape=(None,))
            return cls(time, **{name: finite_array(name, x, shape=shape) for name, x in content.items()})
        except InputError as error:
            raise FileError(f"{path} holds damaged traces ({error}); run it again.") from error


def deploy(
    make_policy: Callable[[], Policy],
    task: CupOnPlate,
    *,
    robot: int,
    start: str,
    episodes: int = 20,
    seed: int = 0,
    threads: int = 1,
) -> Deployed:
    """Run a policy on a twin, and what it is to be compared with, from the same varied postures.

    Parameters
    ----------
    make_policy : callable
        Gives the policy, anew for each robot: it may have a memory.
    task : CupOnPlate
        Its action space and history.
    robot : int
        Which twin.
    start : str
        Name of the scenario.
    episodes : int
        Copies, each from a posture of its own.
    seed : int
        Of postures and noise.
    threads : int
        Threads of the physics; the numbers do not depend on it.
    """
    options: dict[str, Any] = {
        "task": task, "scenarios": [start] * episodes, "start_noise": 1.0, "seed": seed, "threads": threads
    }  # fmt: skip
    real, nominal = twin.Twin(seed=robot), twin.Twin(twin.Imperfections.none())
    return Deployed(
        twin.run(real, make_policy(), **options),
        twin.run(nominal, make_policy(), **options),
        twin.lead(real, twin.CALM, **options),
    )


def deploy_human(task: CupOnPlate, *, robot: int, start: str, episodes: int = 20, seed: int = 0) -> Deployed:
    """The human himself, once more, with his unrest: what a deviation of zero would have to be compared with."""
    options: dict[str, Any] = {
        "task": task,
        "scenarios": [start] * episodes,
        "start_noise": 1.0,
        "seed": seed,
    }
    real, nominal = twin.Twin(seed=robot), twin.Twin(twin.Imperfections.none())
    return Deployed(
        twin.lead(real, **options), twin.lead(nominal, **options), twin.lead(real, twin.CALM, **options)
    )


def true_gains(task: CupOnPlate, episodes: int) -> Callable[[], Policy]:
    """The human's true gains over time, as far as the task's action can write them: a fit without error."""
    time = task.dt * np.arange(task.horizon, dtype=np.float64)
    gains = ImpedanceGains.diagonal(*twin.Operator().schedule.gains(time))
    parameters = np.clip(GAINS.closest_parameters(gains), GAINS.minimum, GAINS.maximum)

    def player() -> Policy:
        steps: Iterator[Array] = iter(GAINS.parameters_to_action(parameters))
        return lambda observations: np.tile(next(steps), (episodes, 1))

    return player


def constant_gains(task: CupOnPlate, episodes: int) -> Callable[[], Policy]:
    """The middle of the range."""
    return lambda: lambda observations: np.tile(task.constant_action(), (len(observations), 1))


BASELINES: Mapping[str, Callable[[CupOnPlate, int], Callable[[], Policy]]] = MappingProxyType({
    "constant": constant_gains, "true-gains": true_gains
})  # fmt: skip
"""What is run on the twin without learning, by name."""


def baseline(which: str, task: CupOnPlate, *, robot: int, start: str, episodes: int, seed: int) -> Deployed:
    """A baseline by its name: one of :data:`BASELINES`, or "human".

    Raises
    ------
    InputError
        Unknown, or not in this action space.
    """
    if which == "human":
        return deploy_human(task, robot=robot, start=start, episodes=episodes, seed=seed)
    if task.action != "gain":
        raise InputError(f"{which} sets gains; pass a task with action 'gain', not {task.action!r}.")
    policy = BASELINES[one_of("baseline", which, BASELINES)](task, episodes)
    return deploy(policy, task, robot=robot, start=start, episodes=episodes, seed=seed)
