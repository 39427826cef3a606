"""A learned policy at work in its task: gains and motion over time, and the mass that they move."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.trace import Trace, record_trace
from vic_toolbox.tasks import Task, cup_on_plate

CONTINUOUS = (
    "in the simulator the law acts without a period; what is said about the computer is about a real one"
)


@dataclass(frozen=True, eq=False)
class Moved:
    """What a task's gains move.

    Parameters
    ----------
    model : RobotModel or ndarray (n, 6, 6)
        The arm, or the mass along the episode.
    q : ndarray, shape (n, nv), optional
        Joint angles of the arm.
    last : ndarray, shape (6, 6)
        M where the episode ends: that about which a policy is judged.
    note : str
        What is special.
    """

    model: Any
    q: Array | None
    last: Array
    note: str = ""


def roll_out(skill: Skill, task: Task, *, episodes: int, seed: int) -> list[Trace]:
    """The exact start, then others that vary as usual."""
    act = skill.policy.mean
    return [record_trace(task, act, seed=seed + i, start_noise=float(i > 0)) for i in range(episodes)]


def moved(trace: Trace) -> Moved:
    """The mass along an episode, from the task's own model."""
    return _MOVED[trace.task.name](trace)


def _arm(trace: Trace) -> Moved:
    arm = cup_on_plate.robot()
    last = arm.operational_space(trace.joints[-1], np.zeros(arm.nv)).mass
    return Moved(arm, trace.joints, 0.5 * (last + last.T), f"M(x) of {arm.name} along the way")


def _free_body(trace: Trace) -> Moved:
    """Mass, and inertia about world axes, of the one body that is free."""
    model = trace.task.simulation(1).model
    body = int(model.jnt_bodyid[np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)[0]])
    principal = _rotation(model.body_iquat[body][None])[0]
    inertia = principal @ np.diag(model.body_inertia[body]) @ principal.T
    turned = _rotation(trace.joints[:, 3:7])
    mass = np.zeros((len(turned), 6, 6))
    mass[:, :3, :3] = model.body_mass[body] * np.eye(3)
    mass[:, 3:, 3:] = turned @ inertia @ np.swapaxes(turned, 1, 2)
    mass = 0.5 * (mass + np.swapaxes(mass, 1, 2))
    return Moved(mass, None, mass[-1], CONTINUOUS)


_MOVED: dict[str, Callable[[Trace], Moved]] = {"cup-on-plate": _arm, "peg-in-hole": _free_body}
"""What each task's gains move; a new task adds a line."""


def _rotation(quat_wxyz: Array) -> Array:
    found = np.zeros((len(quat_wxyz), 9))
    for row, quat in zip(found, quat_wxyz, strict=True):
        mujoco.mju_quat2Mat(row, quat)
    return found.reshape(-1, 3, 3)


def action_policy(skill: Skill, task: Task) -> Callable[[Array], Array]:
    """The policy's mean action as a function of (e, ė) in SI units, which a scaled part does not observe in."""
    unit = np.tile(task.observation_unit, task.history)
    return lambda observations: skill.policy.mean(np.asarray(observations) / unit)


def wrench_policy(skill: Skill, task: Task) -> tuple[Callable[[Array], Array], Array]:
    """A force policy as the feedback wrench that it sets, and the damping (6, 6) that the law keeps beside it."""
    act, simulation = action_policy(skill, task), task.simulation(1)
    task.start(simulation, [task.scenario], noise=0.0, rng=np.random.default_rng(0))
    task.act(simulation, np.ones((1, task.action_size)))
    unit, damping = simulation.wrench[0].copy(), np.diag(simulation.damping[0])

    def wrench(observations: Array) -> Array:
        actions = act(observations).astype(np.float64)
        return np.clip(actions, task.action_low, task.action_high) * unit

    return wrench, damping
