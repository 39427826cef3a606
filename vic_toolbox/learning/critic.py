"""The value function: least-squares fit of the returns, for the advantages of TRPO."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from vic_toolbox.learning.networks import Mlp


@dataclass(frozen=True)
class CriticConfiguration:
    """Settings of the value function's fit."""

    epochs: int = 3
    """Passes over the batch an iteration."""
    batch: int = 1000
    """Rows of an Adam step."""
    learning_rate: float = 3e-3
    """Adam step size."""


class Critic:
    """`V(o)`: tanh network on the scaled observation."""

    def __init__(self, observation_size: int, *, hidden: int = 32, seed: int):
        generator = torch.Generator().manual_seed(seed)
        self.network = Mlp((observation_size, hidden, hidden, 1), "tanh", generator=generator)
        self.optimiser = torch.optim.Adam([self.network.theta], fused=True)

    @property
    def theta(self) -> torch.Tensor:
        """All parameters, flat; live."""
        return self.network.theta

    def value(self, inputs: torch.Tensor) -> torch.Tensor:
        """`V` (n,) for scaled observations (n, n_o)."""
        return self.network.value(inputs)[:, 0]

    @torch.no_grad()
    def fit(
        self,
        inputs: torch.Tensor,
        returns: torch.Tensor,
        *,
        configuration: CriticConfiguration,
        rng: np.random.Generator,
    ) -> float:
        """Regress the returns (n,) on the inputs (n, n_o); returns the last epoch's mean squared error."""
        self.optimiser.param_groups[0]["lr"] = configuration.learning_rate
        error = 0.0
        for _ in range(configuration.epochs):
            order = torch.from_numpy(rng.permutation(len(inputs)))
            batches = [rows.index_select(0, order).split(configuration.batch) for rows in (inputs, returns)]
            error = 0.0
            for x, target in zip(*batches, strict=True):
                output, activations = self.network.forward(x)
                difference = output[:, 0] - target
                cotangent = (difference * (2.0 / len(x)))[:, None]
                self.network.theta.grad = self.network.gradient(activations, cotangent)
                self.optimiser.step()
                error += float(difference.square().sum()) / len(inputs)
        self.network.theta.grad = None
        return error
