"""Policies on the twin: gains or wrenches at 100 Hz, the law at 1 kHz with the nominal model, the arm as it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, integer
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.twin.loop import PERIOD, Loop
from vic_toolbox.twin.operator import Operator
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
    """(n, T, action_size); of a human the wrench of the hand, (n, T, 6)."""
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
    loop = _started(twin, task, scenarios, noise=start_noise, seed=seed, threads=threads)

    def act(observed: Array) -> Array:
        actions = finite_array(
            "actions of the policy", policy(observed), shape=(len(scenarios), task.action_size)
        )
        task.act(loop.law, actions)
        return actions

    return _episode(loop, task, act, lambda: 0.0)


def lead(
    twin: Twin,
    operator: Operator | None = None,
    *,
    task: CupOnPlate | None = None,
    scenarios: Sequence[Any] = ("train",),
    start_noise: float = 0.0,
    seed: int = 0,
    threads: int = 1,
) -> Deployment:
    """Let an operator lead copies of the twin from the very starts that :func:`run` gives a policy; nobody pushes.

    The controller only compensates, as in :func:`~vic_toolbox.twin.guide`. With :data:`~vic_toolbox.twin.CALM` it is
    the path that the operator means, without sway and tremor: what a policy that learned from him is measured against.

    Parameters
    ----------
    twin : Twin
    operator : Operator, optional
        The default human.
    task, scenarios, start_noise, seed, threads
        As for :func:`run`; the seed also draws the operator's unrest. Of the task only rate and horizon matter.

    Returns
    -------
    Deployment
        Its actions (n, T, 6) are the wrench of the hand on the end-effector [N, Nm].
    """
    task = CupOnPlate() if task is None else task
    loop = _started(twin, task, scenarios, noise=start_noise, seed=seed, threads=threads)
    loop.reset(loop.arm.qpos.copy())  # the task's gains away: only gravity and Coriolis are left
    time = PERIOD * np.arange(task.horizon * task.substeps, dtype=np.float64)
    rng = np.random.default_rng([seed, 2, 0xDE])
    hands = (operator or Operator()).take(time, count=len(scenarios), rng=rng)

    def hand() -> Array:
        return hands.wrench(round(loop.time / PERIOD), loop.arm.observe())

    return _episode(loop, task, lambda _: hand(), hand)


def _started(
    twin: Twin, task: CupOnPlate, scenarios: Sequence[Any], *, noise: float, seed: int, threads: int
) -> Loop:
    """Copies of the twin at rest at the starts."""
    rngs = [np.random.default_rng([integer("seed", seed, low=0), part, 0xDE]) for part in range(2)]
    loop = twin.loop(len(scenarios), rng=rngs[0], threads=threads)
    task.start(loop.law, scenarios, noise=finite_number("start_noise", noise, low=0.0), rng=rngs[1])
    loop.begin()
    return loop


def _episode(
    loop: Loop, task: CupOnPlate, act: Callable[[Array], Array], hand: Callable[[], ArrayLike]
) -> Deployment:
    """One episode: `act` at every step of the task, `hand` at every step of the physics."""
    angles, truth, seen, actions = [loop.arm.qpos.copy()], [loop.arm.observe().copy()], [], []
    seen.append(np.tile(loop.law.observe(), task.history))
    peak = np.zeros(len(angles[0]))
    for _ in range(task.horizon):
        actions.append(act(seen[-1]))
        for _ in range(task.substeps):
            loop.step(hand())
            peak = np.maximum(peak, loop.arm.contact_force)
        angles.append(loop.arm.qpos.copy())
        truth.append(loop.arm.observe().copy())
        seen.append(np.concatenate([seen[-1][:, 12:], loop.law.observe()], axis=1))
    return Deployment(
        time=PERIOD * task.substeps * np.arange(task.horizon + 1, dtype=np.float64),
        joint_position=np.stack(angles, axis=1),
        error=np.stack(truth, axis=1),
        observations=np.stack(seen, axis=1),
        actions=np.stack(actions, axis=1),
        peak_force=peak,
        stopped=loop.arm.stopped.copy(),
    )
