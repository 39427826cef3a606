"""What one episode looked like: motion, gains and forces over time, for figures and videos."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vic_toolbox.tasks import Task, VectorEnvironment


@dataclass(frozen=True)
class Trace:
    """One episode, sampled at the policy rate; T rows, SI units, world axes.

    Attributes
    ----------
    task : Task
        What was done, with its scenario.
    time : ndarray, shape (T,)
        Since the start [s].
    error, rate : ndarray, shape (T, 6)
        Pose error e and its rate ė.
    stiffness, damping : ndarray, shape (T, 6)
        Diagonals of K and B; the stiffness is zero in the force action space.
    feedback : ndarray, shape (T, 6)
        Feedback wrench F_fb.
    contact : ndarray, shape (T,)
        Force of the surroundings on what is moved [N].
    joints : ndarray, shape (T, nq)
        Joint positions of the simulation: an arm's angles [rad], or the pose of a free body [m, quat wxyz].
    observations : ndarray, shape (T, observation_size)
        What the policy saw.
    score : float
        The task's score of the episode.
    """

    task: Task
    time: np.ndarray
    error: np.ndarray
    rate: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    feedback: np.ndarray
    contact: np.ndarray
    joints: np.ndarray
    observations: np.ndarray
    score: float

    @property
    def goal(self) -> np.ndarray:
        """Reference position of the end-effector, (3,) [m]."""
        return self.task.goal

    @property
    def path(self) -> np.ndarray:
        """Positions of the end-effector, (T, 3) [m]."""
        return self.error[:, :3] + self.goal

    @property
    def distance(self) -> np.ndarray:
        """Distance to the goal, (T,) [m]."""
        return np.linalg.norm(self.error[:, :3], axis=1)

    @property
    def speed(self) -> np.ndarray:
        """Speed of the end-effector, (T,) [m/s]."""
        return np.linalg.norm(self.rate[:, :3], axis=1)

    @property
    def damping_factor(self) -> np.ndarray:
        """`d = b / √k` of the translations, (T,) [√kg]; NaN without stiffness."""
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = self.damping[:, :3] / np.sqrt(self.stiffness[:, :3])
        return np.where(self.stiffness[:, 0] > 0.0, factor.mean(axis=1), np.nan)


def record_trace(
    task: Task, act: Callable[[np.ndarray], np.ndarray], *, seed: int = 0, start_noise: float = 0.0
) -> Trace:
    """Run one episode with the policy's mean action, by default from the scenario's exact start, and keep everything.

    Parameters
    ----------
    task : Task
        Task with its scenario.
    act : callable
        Policy: observations (1, observation_size) → actions (1, action_size).
    seed : int
        Of the variation of the start.
    start_noise : float
        Its size, in units of the task's usual one.

    Raises
    ------
    SimulationError
        The simulation diverged.
    """
    environment = VectorEnvironment(task, 1)
    simulation = environment.simulation
    columns: dict[str, list[np.ndarray]] = {name: [] for name in _COLUMNS}
    observation, info = environment.reset(seed=seed, options={"start_noise": start_noise})
    for _ in range(task.horizon):
        seen, joints = observation[0], simulation.qpos[0].copy()
        observation, _, _, _, info = environment.step(act(observation))
        stiffness, damping = simulation.stiffness[0].copy(), simulation.damping[0].copy()
        error, rate = np.split(seen[-12:] * task.observation_unit, 2)
        feedback = simulation.wrench[0] - stiffness * error - damping * rate
        contact = simulation.contact_force[0]
        row = (error, rate, stiffness, damping, feedback, contact, joints, seen)
        for column, value in zip(columns.values(), row, strict=True):
            column.append(value)
    recorded = {name: np.array(column) for name, column in columns.items()}
    return Trace(
        task=task,
        time=task.dt * np.arange(task.horizon),
        score=float(info["score"][0]),
        **recorded,
    )


_COLUMNS = ("error", "rate", "stiffness", "damping", "feedback", "contact", "joints", "observations")
