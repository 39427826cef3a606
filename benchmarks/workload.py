"""The work that both learners do: sizes, a simulation that costs next to nothing, and its demonstrations.

Imported by both sides of `benchmarks.learner`, so it needs NumPy only.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Workload:
    """Sizes and numbers of updates of one AIRL iteration."""

    environments: int = 20
    """Simulations side by side."""
    horizon: int = 500
    """Steps of an episode; `environments * horizon` is the batch."""
    observation_size: int = 12
    """Components of an observation."""
    action_size: int = 7
    """Components of an action."""
    expert_trajectories: int = 50
    """Demonstrations."""
    held_out: int = 10
    """Demonstrations, the last ones, that the discriminator does not see."""
    hidden: int = 32
    """Units of each of the two hidden layers of policy, critic and reward."""
    log_std: float = -0.5
    """Initial logarithm of the policy's standard deviation."""
    discount: float = 0.99
    """Discount factor."""
    trace: float = 0.97
    """Decay of the generalised advantages."""
    divergence: float = 0.03
    """Trust region [nats]."""
    conjugate_gradient_steps: int = 10
    """Fisher products of a TRPO step, over the whole batch."""
    fisher_damping: float = 0.1
    """Multiple of the identity added to the Fisher matrix."""
    backtracks: int = 10
    """Largest number of halvings of a TRPO step."""
    critic_epochs: int = 3
    """Passes of the critic over the batch."""
    critic_batch: int = 1000
    """Rows of a critic's Adam step."""
    critic_learning_rate: float = 3e-3
    """The critic's Adam step size."""
    discriminator_steps: int = 20
    """Adam steps of the discriminator."""
    discriminator_batch: int = 512
    """Expert rows, and as many policy rows, of such a step."""
    discriminator_learning_rate: float = 1e-3
    """The discriminator's Adam step size."""


class LinearTask:
    """What a learner may know of the task; the expert is a saturated linear feedback."""

    name = "linear-system"
    history = 1

    def __init__(self, workload: Workload):
        self.horizon = workload.horizon
        self.observation_size = workload.observation_size
        self.action_size = workload.action_size
        self.observation_scale = np.ones(workload.observation_size)
        rng = np.random.default_rng(0)
        self.input = 0.1 * rng.standard_normal((workload.action_size, workload.observation_size))
        self._gain = 0.3 * rng.standard_normal((workload.observation_size, workload.action_size))

    def expert_action(self, observations: np.ndarray) -> np.ndarray:
        """Actions (n, n_a) in [-1, 1]."""
        return np.tanh(observations @ self._gain)

    def strata(self, observations: np.ndarray) -> np.ndarray:
        """Three phases (n,), by the distance from the origin."""
        return np.digitize(np.linalg.norm(observations, axis=-1), (0.5, 2.0))


class LinearSystem:
    """`x' = 0.95 x + a B` in `num_envs` copies: stable, and a few microseconds a step."""

    def __init__(self, task: LinearTask, num_envs: int):
        self.task = task
        self.num_envs = num_envs
        self._state = np.zeros((num_envs, task.observation_size))

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Random states of unit variance."""
        self._state = np.random.default_rng(seed).standard_normal(self._state.shape)
        return self._state, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """One step of every copy; the learners see no episode end other than the horizon."""
        self._state = 0.95 * self._state + np.clip(actions, -1.0, 1.0) @ self.task.input
        ends = np.zeros(self.num_envs, dtype=bool)
        return self._state, -np.square(self._state).sum(1), ends, ends, {}


def demonstrations(task: LinearTask, count: int) -> tuple[np.ndarray, np.ndarray]:
    """The expert's observations (n, T+1, n_o) and actions (n, T, n_a), the same on both sides."""
    system = LinearSystem(task, count)
    observations = np.empty((count, task.horizon + 1, task.observation_size))
    actions = np.empty((count, task.horizon, task.action_size))
    observations[:, 0], _ = system.reset(seed=1)
    for t in range(task.horizon):
        actions[:, t] = task.expert_action(observations[:, t])
        observations[:, t + 1] = system.step(actions[:, t])[0]
    return observations, actions
