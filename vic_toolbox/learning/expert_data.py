"""Demonstrations as rows for learning: scaled inputs and normalised actions, split by trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vic_toolbox.errors import InputError
from vic_toolbox.learning.networks import GaussianPolicy

Rows = tuple[torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class ExpertData:
    """`training` and `held_out`: (inputs (n, n_o), actions (n, n_a)), from different trajectories."""

    training: Rows
    held_out: Rows

    @classmethod
    def from_trajectories(
        cls, observations: np.ndarray, actions: np.ndarray, policy: GaussianPolicy, *, held_out: int = 10
    ) -> ExpertData:
        """Split trajectories: observations (n, T or T+1, n_o), actions (n, T, n_a); the last `held_out` are kept back.

        Raises
        ------
        InputError : fewer than two trajectories beyond the held-out ones, or shapes that do not agree.
        """
        count, length, _ = actions.shape
        if len(observations) != count or observations.shape[1] < length:
            raise InputError(
                f"observations {observations.shape} and actions {actions.shape} do not agree; "
                "expected (n, T or T+1, n_o) and (n, T, n_a)"
            )
        if not 1 <= held_out < count:
            raise InputError(f"held_out is {held_out} of {count} trajectories; keep at least one on each side")
        inputs = policy.scaled(observations[:, :length])
        targets = torch.from_numpy(np.ascontiguousarray(actions, dtype=np.float32))
        split = count - held_out
        return cls(_rows(inputs[:split], targets[:split]), _rows(inputs[split:], targets[split:]))


def _rows(inputs: torch.Tensor, actions: torch.Tensor) -> Rows:
    return inputs.reshape(-1, inputs.shape[-1]), actions.reshape(-1, actions.shape[-1])
