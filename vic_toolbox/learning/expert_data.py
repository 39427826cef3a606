"""Demonstrations as rows for learning: scaled inputs and normalised actions, split by trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from vic_toolbox.errors import InputError, finite_array
from vic_toolbox.learning.networks import LARGEST_INPUT, GaussianPolicy

if TYPE_CHECKING:
    from vic_toolbox.tasks import Demonstrations, Task

Rows = tuple[torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class ExpertData:
    """`training` and `held_out`: (inputs (n, n_o), actions (n, n_a)), from different trajectories.

    `low` and `high` (n_a,) are the action's bounds, to which the environment clips. With `strata`, the integers (n,) of
    both, cloning and the held-out error look at every part of the way alike; without, at every moment.
    """

    training: Rows
    held_out: Rows
    low: torch.Tensor
    high: torch.Tensor
    strata: tuple[np.ndarray, np.ndarray] | None = None

    @classmethod
    def from_trajectories(
        cls,
        observations: np.ndarray,
        actions: np.ndarray,
        *,
        policy: GaussianPolicy,
        bounds: tuple[np.ndarray, np.ndarray],
        held_out: int = 10,
        strata: np.ndarray | None = None,
    ) -> ExpertData:
        """Split trajectories: observations (n, T or T+1, n_o), actions (n, T, n_a); the last `held_out` are kept back.

        `policy` scales the observations; `bounds` are the lowest and highest action; `strata` (n, T or T+1) are small
        integers, the parts of the way.

        Raises
        ------
        InputError
            Fewer than two trajectories, shapes that do not agree, entries that are not finite, or observations far
            beyond the task's scale (millimetres or degrees, perhaps).
        """
        observations = finite_array(
            "observations", observations, shape=(None, None, len(policy.observation_scale))
        )
        actions = finite_array("actions", actions, shape=(None, None, policy.action_size))
        count, length, _ = actions.shape
        if len(observations) != count or observations.shape[1] < length:
            raise InputError(
                f"observations {observations.shape} and actions {actions.shape} do not agree; "
                "expected (n, T or T+1, n_o) and (n, T, n_a)"
            )
        largest = float(np.abs(observations / policy.observation_scale).max(initial=0.0))
        if largest > LARGEST_INPUT:
            raise InputError(
                f"an observation is {largest:.0f} times the task's scale; expected at most {LARGEST_INPUT:.0f} times. "
                "Pass metres, radians and seconds"
            )
        if not 1 <= held_out < count:
            raise InputError(
                f"held_out is {held_out} of {count} trajectories; keep at least one on each side"
            )
        inputs = policy.scaled(observations[:, :length])
        targets = torch.from_numpy(np.ascontiguousarray(actions, dtype=np.float32))
        split = count - held_out
        parts = None if strata is None else np.asarray(strata)[:, :length].astype(np.int64)
        low, high = (torch.from_numpy(np.asarray(bound, dtype=np.float32)) for bound in bounds)
        return cls(
            _rows(inputs[:split], targets[:split]),
            _rows(inputs[split:], targets[split:]),
            low,
            high,
            None if parts is None else (parts[:split].ravel(), parts[split:].ravel()),
        )

    @classmethod
    def from_demonstrations(
        cls,
        demonstrations: Demonstrations,
        task: Task,
        *,
        policy: GaussianPolicy,
        held_out: int = 10,
        stratified: bool = False,
    ) -> ExpertData:
        """Split demonstrations of a task, with or without its strata; see :meth:`from_trajectories`.

        Raises
        ------
        InputError
            They are of another task, action space or history, or too few.
        """
        theirs = (demonstrations.task, demonstrations.action, demonstrations.history)
        if theirs != (task.name, task.action, task.history):
            raise InputError(
                f"the demonstrations are of {theirs[0]}, action {theirs[1]}, history {theirs[2]}; the task is "
                f"{task.name}, action {task.action}, history {task.history}. Record them for this task"
            )
        return cls.from_trajectories(
            demonstrations.observations,
            demonstrations.actions,
            policy=policy,
            bounds=(task.action_low, task.action_high),
            held_out=held_out,
            strata=task.strata(demonstrations.observations) if stratified else None,
        )

    @torch.no_grad()
    def action_error(self, policy: GaussianPolicy) -> float:
        """Held-out action error: RMS over rows and components of the mean action, as the environment clips it,
        less the expert's; with strata, each of them weighs the same.
        """
        inputs, actions = self.held_out
        squared = (policy.network.value(inputs).clamp(self.low, self.high) - actions).square()
        if self.strata is None:
            return float(squared.mean().sqrt())
        of_row = squared.mean(1).double().numpy()
        counts = np.bincount(self.strata[1])
        sums = np.bincount(self.strata[1], weights=of_row)
        return float(np.sqrt((sums[counts > 0] / counts[counts > 0]).mean()))


def _rows(inputs: torch.Tensor, actions: torch.Tensor) -> Rows:
    return inputs.reshape(-1, inputs.shape[-1]), actions.reshape(-1, actions.shape[-1])
