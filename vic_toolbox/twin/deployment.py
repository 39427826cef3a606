"""Policies on the twin: gains or wrenches at 100 Hz, the law at 1 kHz with the nominal model, the arm as it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, integer
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.twin.loop import PERIOD
from vic_toolbox.twin.robot import Twin

Policy = Callable[[Array], Array]
"""From observations (n, 12 h) to actions (n, action_size), as the task defines them."""


@dataclass(frozen=True, eq=False)
class Deployment:
    """What n copies of the twin did under a policy, at the T + 1 times of its steps; the truth, not what it saw."""

    time: Array
    """(T + 1,) [s]"""
    joint_position: Array
    """(n, T + 1, 6) [rad]"""
    error: Array
    """e and ė of the end-effector to the goal, (n, T + 1, 12), world axes."""
    observations: Array
    """What the policy saw: measured, late and noisy, (n, T + 1, 12 h)."""
    actions: Array
    """(n, T, action_size)"""
    peak_force: Array
    """Largest contact force, (n,) [N]."""
    stopped: Array
    """Whether an arm ran away and was stopped, (n,)."""

    @property
    def position(self) -> Array:
        """Centre of the cup's bottom, (n, T + 1, 3) [m]."""
        return self.error[..., :3] + np.array(cup_scene.GOAL)

    def deviation(self, other: Deployment) -> tuple[Array, Array]:
        """Distance to another deployment's path: mean along the path and at the end, (n,) each [m].

        Raises
        ------
        InputError
            The two have other numbers of copies or steps.
        """
        if self.error.shape != other.error.shape:
            raise InputError(
                f"this deployment has shape {self.error.shape[:2]} and the other {other.error.shape[:2]}; "
                "compare equal numbers of copies and steps."
            )
        distance = np.linalg.norm(self.error[..., :3] - other.error[..., :3], axis=-1)
        return distance.mean(axis=1), distance[:, -1]


def run(
    twin: Twin,
    policy: Policy,
    *,
    task: CupOnPlate | None = None,
    scenarios: Sequence[Any] = ("train",),
    start_noise: float = 0.0,
    seed: int = 0,
    threads: int = 1,
) -> Deployment:
    """Run a policy on copies of the twin for one episode, one for each scenario.

    Parameters
    ----------
    twin : Twin
    policy : callable
        Such as ``task.expert_action``, or a learned policy's mean.
    task : CupOnPlate, optional
        Its action space, history and horizon; by default gain actions and one observation.
    scenarios : sequence
        Starts.
    start_noise : float
        Variation of the starts, in units of the task's.
    seed : int
        Of starts and encoder noise.
    threads : int
        Threads of the physics; the numbers do not depend on it.

    Raises
    ------
    InputError
        Bad input, or actions of another shape.
    """
    task = CupOnPlate() if task is None else task
    rngs = [np.random.default_rng([integer("seed", seed, low=0), part, 0xDE]) for part in range(2)]
    count, horizon = len(scenarios), task.horizon
    loop = twin.loop(count, rng=rngs[0], threads=threads)
    task.start(loop.law, scenarios, noise=finite_number("start_noise", start_noise, low=0.0), rng=rngs[1])
    loop.begin()
    angles, truth = np.empty((horizon + 1, count, 6)), np.empty((horizon + 1, count, 12))
    seen = np.empty((horizon + 1, count, task.observation_size))
    actions = np.empty((horizon, count, task.action_size))
    peak = np.zeros(count)
    angles[0], truth[0], now = loop.arm.qpos, loop.arm.observe(), loop.law.observe()
    seen[0] = np.tile(now, task.history)
    for t in range(horizon):
        actions[t] = finite_array("actions of the policy", policy(seen[t]), shape=actions.shape[1:])
        task.act(loop.law, actions[t])
        for _ in range(task.substeps):
            loop.step()
            peak = np.maximum(peak, loop.arm.contact_force)
        angles[t + 1], truth[t + 1] = loop.arm.qpos, loop.arm.observe()
        seen[t + 1] = np.concatenate([seen[t][:, 12:], loop.law.observe()], axis=1)
    return Deployment(
        time=PERIOD * task.substeps * np.arange(horizon + 1, dtype=np.float64),
        joint_position=angles.swapaxes(0, 1),
        error=truth.swapaxes(0, 1),
        observations=seen.swapaxes(0, 1),
        actions=actions.swapaxes(0, 1),
        peak_force=peak,
        stopped=loop.arm.stopped.copy(),
    )
