"""Slices of a learned reward along the expert's path, for the figure of what it values."""

from __future__ import annotations

import numpy as np
import torch

from vic_toolbox.experiments.figures.reward import RewardSlice
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.learning import GaussianPolicy, RewardNetwork
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.cup_on_plate import GAINS

_STATES, _VALUES = 90, 61


def reward_slices(
    task: Task, reward: RewardNetwork, policy: GaussianPolicy, expert: Trace, *, name: str
) -> list[RewardSlice]:
    """The reward over one quantity of the action at a time, at states of the expert's path; the rest is the
    expert's.

    Gain actions: the translational stiffness (all three alike) and the damping factor, over their ranges.
    Force actions: the force, as a multiple of the expert's.

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
    states = expert.observations[_evenly_spaced(expert.distance)]
    distance = np.linalg.norm(states[:, -12:-9], axis=1)
    own, wanted = np.clip(policy.mean(states), task.action_low, task.action_high), task.expert_action(states)
    if task.action == "force":
        grid = np.linspace(0.0, 2.0, _VALUES)
        tried = np.repeat(wanted[:, None], _VALUES, axis=1)
        tried[..., :3] *= grid[:, None]
        share = (own * wanted)[:, :3].sum(axis=1) / np.square(wanted[:, :3]).sum(axis=1)
        chosen = {"expert": np.ones_like(share), name: share}
        title = "force along the expert's  [multiple of it]"
        return [RewardSlice(title, grid, distance, _values(reward, policy, states, tried), chosen)]
    slices = []
    grid = np.linspace(-1.0, 1.0, _VALUES)
    for title, which in (("translational stiffness  [N/m]", [0, 1, 2]), ("damping factor d  [√kg]", [6])):
        low, high = GAINS.minimum[which[0]], GAINS.maximum[which[0]]
        tried = np.repeat(wanted[:, None], _VALUES, axis=1)
        tried[..., which] = grid[:, None]
        in_units = {
            method: low + (high - low) * (action[:, which].mean(axis=1) + 1.0) / 2.0
            for method, action in (("expert", wanted), (name, own))
        }
        value = low + (high - low) * (grid + 1.0) / 2.0
        slices.append(RewardSlice(title, value, distance, _values(reward, policy, states, tried), in_units))
    return slices


def _evenly_spaced(distance: np.ndarray) -> np.ndarray:
    """Rows at which the distance to the goal first falls below evenly spaced levels, down to 20 mm."""
    levels = np.linspace(distance[0], 0.02, _STATES)
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
