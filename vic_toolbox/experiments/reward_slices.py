"""Slices of a learned reward along the expert's path, for the figure of what it values."""

from __future__ import annotations

import numpy as np
import torch

from vic_toolbox.experiments.figures.reward import RewardSlice
from vic_toolbox.experiments.task_views import knob
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.learning import GaussianPolicy, RewardNetwork
from vic_toolbox.tasks import Task

_STATES, _VALUES = 90, 61
_CLOSEST = 0.035  # where the slice ends, as a share of the distance at which the path begins


def reward_slice(
    task: Task, reward: RewardNetwork, policy: GaussianPolicy, expert: Trace, *, name: str
) -> RewardSlice:
    """The reward along the task's :class:`~vic_toolbox.experiments.task_views.Knob`, at states of the expert's path.

    The knob turns all actions together: with one of them varied and the others the expert's, a reward looks as if it
    knew more than it does.

    Parameters
    ----------
    task : Task
        The run's task.
    reward : RewardNetwork
        Its reward.
    policy : GaussianPolicy
        Its policy.
    expert : Trace
        One episode of the expert.
    name : str
        Look of the policy.
    """
    shown = _evenly_spaced(expert.distance)
    states = expert.observations[shown]
    own, wanted = np.clip(policy.mean(states), task.action_low, task.action_high), task.expert_action(states)
    line = knob(task)
    direction = wanted if line.direction is None else np.broadcast_to(line.direction, wanted.shape)
    grid = np.linspace(line.low, line.high, _VALUES)
    return RewardSlice(
        name=line.title,
        value=line.unit(task, grid),
        distance=expert.distance[shown],
        reward=_values(reward, policy, states, grid[:, None] * direction[:, None]),
        chosen={
            look: line.unit(task, _place(actions, direction))
            for look, actions in (("expert", wanted), (name, own))
        },
    )


def _place(actions: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The s (n,) for which s · direction is nearest to the actions (n, n_a)."""
    return (actions * direction).sum(axis=1) / np.maximum(np.square(direction).sum(axis=1), 1e-12)


def _evenly_spaced(distance: np.ndarray) -> np.ndarray:
    """Rows at which the distance to the goal first falls below evenly spaced levels."""
    levels = np.linspace(distance[0], _CLOSEST * distance[0], _STATES)
    rows = [int(np.argmax(distance <= level)) for level in levels if (distance <= level).any()]
    return np.unique(rows)


def _values(
    reward: RewardNetwork, policy: GaussianPolicy, states: np.ndarray, actions: np.ndarray
) -> np.ndarray:
    """R (n, m) for states (n, n_o) and actions (n, m, n_a)."""
    n, m, size = actions.shape
    inputs = policy.scaled(states).repeat_interleave(m, dim=0)
    tried = torch.from_numpy(np.ascontiguousarray(actions.reshape(n * m, size), dtype=np.float32))
    return reward.value(torch.cat([inputs, tried], dim=1)).numpy().reshape(n, m)
