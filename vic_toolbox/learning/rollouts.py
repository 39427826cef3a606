"""Rollouts of a policy in the batched simulation, and their generalised advantages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vic_toolbox.learning.networks import GaussianPolicy


class BatchedEnvironment(Protocol):
    """What learning asks of an environment: `num_envs` simulations of one task that start and end together."""

    num_envs: int
    task: Any  # a `vic_toolbox.tasks.Task`

    def reset(self, *, seed: Any = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Start an episode in every simulation; returns the observations (n, n_o)."""
        ...

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Apply actions (n, n_a) for one policy step."""
        ...


@dataclass(frozen=True)
class Rollout:
    """`n` episodes of `T` steps: observations (T+1, n, n_o), actions as sampled (T, n, n_a), task rewards (T, n)."""

    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray

    @property
    def score(self) -> np.ndarray:
        """Sum of the task's rewards of each episode, (n,)."""
        return self.rewards.sum(axis=0)


def collect(
    environment: BatchedEnvironment,
    policy: GaussianPolicy,
    *,
    rng: np.random.Generator | None,
    seed: int,
    start_noise: float,
) -> Rollout:
    """One episode of every sub-environment.

    With `rng` the actions are samples of the policy, without it the mean. Actions are recorded unclipped; the
    environment clips them. `seed` draws the start noise [rad, standard deviation of each joint].
    """
    task = environment.task
    horizon, count = task.horizon, environment.num_envs
    observations = np.empty((horizon + 1, count, task.observation_size))
    actions = np.empty((horizon, count, task.action_size), dtype=np.float32)
    rewards = np.empty((horizon, count))
    observations[0], _ = environment.reset(seed=seed, options={"start_noise": start_noise})
    std = np.exp(policy.log_std.numpy())
    noise = None if rng is None else rng.standard_normal(actions.shape, dtype=np.float32) * std
    for t in range(horizon):
        actions[t] = policy.mean(observations[t])
        if noise is not None:
            actions[t] += noise[t]
        observations[t + 1], rewards[t], _, _, _ = environment.step(actions[t])
    return Rollout(observations, actions, rewards)


def generalised_advantages(
    rewards: np.ndarray, values: np.ndarray, *, discount: float, trace: float
) -> tuple[np.ndarray, np.ndarray]:
    """Advantages and λ-returns of fixed-length episodes, time first.

    `δ_t = r_t + γ V_{t+1} − V_t`, `A_t = δ_t + γλ A_{t+1}`, return `A_t + V_t`. The episodes end by their time
    limit only, so the last value bootstraps.

    Parameters
    ----------
    rewards
        (T, n).
    values
        (T+1, n).

    Source: Schulman et al., "High-dimensional continuous control using generalized advantage estimation", ICLR 2016.
    """
    advantages = rewards + discount * values[1:] - values[:-1]
    for t in range(len(rewards) - 2, -1, -1):
        advantages[t] += discount * trace * advantages[t + 1]
    return advantages, advantages + values[:-1]
