"""A linear task with a linear expert: a batched environment that costs nothing, for tests of the learner."""

from __future__ import annotations

import numpy as np

from vic_toolbox.learning import ExpertData, GaussianPolicy


class ToyTask:
    """`x' = .9 x + B a`, expert `a = tanh(K x)`, reward `−‖a − a_expert‖²`."""

    name = "toy"
    history = 1
    horizon = 40
    observation_size = 4
    action_size = 2

    def __init__(self):
        rng = np.random.default_rng(7)
        self.observation_scale = np.full(4, 0.5)
        self.input_matrix = 0.2 * rng.normal(size=(4, 2))
        self.expert_matrix = 0.8 * rng.normal(size=(2, 4))

    def expert_action(self, observations: np.ndarray) -> np.ndarray:
        return np.tanh(observations @ self.expert_matrix.T)

    def strata(self, observations: np.ndarray) -> np.ndarray:
        return (np.linalg.norm(observations, axis=1) > 0.5).astype(int)


class ToyEnvironment:
    def __init__(self, num_envs: int = 16):
        self.num_envs = num_envs
        self.task = ToyTask()

    def reset(self, *, seed=None, options=None):
        self.state = np.random.default_rng(seed).normal(size=(self.num_envs, 4))
        return self.state.copy(), {}

    def step(self, actions):
        reward = -np.square(actions - self.task.expert_action(self.state)).sum(1)
        self.state = 0.9 * self.state + np.clip(actions, -1.0, 1.0) @ self.task.input_matrix.T
        over = np.zeros(self.num_envs, dtype=bool)
        return self.state.copy(), reward, over, over, {}


def toy_expert(environment: ToyEnvironment, seed: int = 0) -> ExpertData:
    task = environment.task
    observations, _ = environment.reset(seed=seed)
    states, actions = [observations], []
    for _ in range(task.horizon):
        actions.append(task.expert_action(states[-1]))
        states.append(environment.step(actions[-1])[0])
    policy = GaussianPolicy(task.observation_scale, task.action_size, hidden=4, log_std=0.0, seed=0)
    return ExpertData.from_trajectories(
        np.stack(states, axis=1),
        np.stack(actions, axis=1),
        policy=policy,
        bounds=(-np.ones(2), np.ones(2)),
        held_out=4,
    )
