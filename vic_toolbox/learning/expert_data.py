"""Demonstrations as rows for learning: scaled inputs and normalised actions, split by trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vic_toolbox.errors import InputError, finite_array
from vic_toolbox.learning.networks import LARGEST_INPUT, GaussianPolicy

Rows = tuple[torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class ExpertData:
    """`training` and `held_out`: (inputs (n, n_o), actions (n, n_a)), from different trajectories.

    `low` and `high` (n_a,) are the action's bounds, to which the environment clips.
    """

    training: Rows
    held_out: Rows
    low: torch.Tensor
    high: torch.Tensor

    @classmethod
    def from_trajectories(
        cls,
        observations: np.ndarray,
        actions: np.ndarray,
        *,
        policy: GaussianPolicy,
        bounds: tuple[np.ndarray, np.ndarray],
        held_out: int = 10,
    ) -> ExpertData:
        """Split trajectories: observations (n, T or T+1, n_o), actions (n, T, n_a); the last `held_out` are kept back.

        `policy` scales the observations; `bounds` are the lowest and highest action.

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
        low, high = (torch.from_numpy(np.asarray(bound, dtype=np.float32)) for bound in bounds)
        return cls(_rows(inputs[:split], targets[:split]), _rows(inputs[split:], targets[split:]), low, high)

    @torch.no_grad()
    def action_error(self, policy: GaussianPolicy) -> float:
        """Held-out action error: RMS over rows and components of the mean action, as the environment clips it,
        less the expert's.
        """
        inputs, actions = self.held_out
        return float(
            (policy.network.value(inputs).clamp(self.low, self.high) - actions).square().mean().sqrt()
        )


def _rows(inputs: torch.Tensor, actions: torch.Tensor) -> Rows:
    return inputs.reshape(-1, inputs.shape[-1]), actions.reshape(-1, actions.shape[-1])
