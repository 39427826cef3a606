"""Small fully connected networks on one flat parameter vector, with hand-written derivatives.

TRPO, the discriminator and the critic all need the same three products of a network `y = f(x; θ)`: the value,
the vector-Jacobian product `vᵀ ∂y/∂θ` and the Jacobian-vector product `∂y/∂θ · t`. For two hidden layers of 32
units they are a handful of matrix products each; writing them out avoids the autograd graph, which costs several
times the arithmetic at this size, and double backpropagation altogether.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from vic_toolbox.errors import InputError

LARGEST_INPUT = 30.0
"""Scaled observations are clipped here: a diverging simulation cannot produce infinite activations."""

LOG_TWO_PI = math.log(2.0 * math.pi)
ONE = torch.ones(())

Layers = list[tuple[torch.Tensor, torch.Tensor]]


@dataclass
class Activations:
    """What a forward pass leaves for the derivative products: layer inputs and activation slopes."""

    inputs: list[torch.Tensor]
    slopes: list[torch.Tensor]


def tanh_(x: torch.Tensor) -> torch.Tensor:
    """`tanh` in place. NumPy's vector tanh takes a tenth of the time of torch's on one thread."""
    array = x.numpy()
    np.tanh(array, out=array)
    return x


class Mlp:
    """`y = W_L h_{L-1} + b_L`, `h_i = φ(W_i h_{i-1} + b_i)`, `h_0 = x`, with φ tanh or ReLU.

    Parameters
    ----------
    sizes
        Widths of all layers, input first, e.g. `(12, 32, 32, 7)`.
    activation
        `"tanh"` or `"relu"`.
    generator
        Source of the initial weights, N(0, 1/fan-in); biases start at zero.
    output_scale
        Factor on the last layer's initial weights.
    extra
        Trailing parameters of `theta` that belong to the owner (a policy's log standard deviations).
    """

    def __init__(
        self,
        sizes: Sequence[int],
        activation: str,
        *,
        generator: torch.Generator,
        output_scale: float = 1.0,
        extra: int = 0,
    ):
        if activation not in ("tanh", "relu"):
            raise InputError(f"activation is {activation!r}; expected 'tanh' or 'relu'")
        self.sizes = tuple(int(size) for size in sizes)
        self.activation = activation
        shapes = list(zip(self.sizes[:-1], self.sizes[1:], strict=True))
        self.theta = torch.zeros(sum(n_out * (n_in + 1) for n_in, n_out in shapes) + extra)
        self.layers = self.split(self.theta)
        for depth, (weight, _) in enumerate(self.layers):
            scale = output_scale if depth == len(shapes) - 1 else 1.0
            weight.copy_(
                torch.randn(weight.shape, generator=generator) * (scale / math.sqrt(weight.shape[1]))
            )

    def split(self, vector: torch.Tensor) -> Layers:
        """Views of a flat vector as the layers' (weight, bias) pairs."""
        layers, start = [], 0
        for n_in, n_out in zip(self.sizes[:-1], self.sizes[1:], strict=True):
            middle, end = start + n_in * n_out, start + (n_in + 1) * n_out
            layers.append((vector[start:middle].view(n_out, n_in), vector[middle:end]))
            start = end
        return layers

    def value(self, x: torch.Tensor, layers: Layers | None = None) -> torch.Tensor:
        """Output for inputs (n, n_in), optionally with other weights than the network's own."""
        *hidden, (weight, bias) = self.layers if layers is None else layers
        for hidden_weight, hidden_bias in hidden:
            x = torch.addmm(hidden_bias, x, hidden_weight.T)
            x = tanh_(x) if self.activation == "tanh" else x.relu_()
        return torch.addmm(bias, x, weight.T)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, Activations]:
        """Output (n, n_out) and what `gradient` and `tangent` need of this pass."""
        *hidden, (weight, bias) = self.layers
        inputs, slopes = [x], []
        for hidden_weight, hidden_bias in hidden:
            x = torch.addmm(hidden_bias, x, hidden_weight.T)
            if self.activation == "tanh":
                x = tanh_(x)
                slopes.append(torch.addcmul(ONE, x, x, value=-1.0))
            else:
                x = x.relu_()
                slopes.append(x.sign())
            inputs.append(x)
        return torch.addmm(bias, x, weight.T), Activations(inputs, slopes)

    def gradient(self, activations: Activations, cotangent: torch.Tensor) -> torch.Tensor:
        """`Σ_n cotangent_nᵀ ∂y_n/∂θ` as a flat vector, for a cotangent (n, n_out)."""
        parts: list[torch.Tensor] = []
        for depth in range(len(self.layers) - 1, -1, -1):
            parts[:0] = [(cotangent.T @ activations.inputs[depth]).reshape(-1), cotangent.sum(0)]
            if depth:
                cotangent = (cotangent @ self.layers[depth][0]).mul_(activations.slopes[depth - 1])
        return torch.cat(parts)

    def tangent(self, activations: Activations, direction: torch.Tensor) -> torch.Tensor:
        """`∂y/∂θ · direction` (n, n_out) for a flat direction."""
        change = None
        for depth, (weight_change, bias_change) in enumerate(self.split(direction)):
            total = torch.addmm(bias_change, activations.inputs[depth], weight_change.T)
            if change is not None:
                total.addmm_(change, self.layers[depth][0].T)
            change = total.mul_(activations.slopes[depth]) if depth < len(self.layers) - 1 else total
        assert change is not None
        return change


class PolicyTask(Protocol):
    """What a policy must know of its task."""

    observation_scale: np.ndarray
    action_size: int


class GaussianPolicy:
    """`π(a|o) = N(μ(o), diag σ²)`, μ a tanh network on the scaled observation, σ independent of the state.

    `theta` holds the network's weights and, at its end, `log_std`. Observations are divided by `observation_scale` and
    clipped to ± `LARGEST_INPUT` before they enter the network.
    """

    def __init__(
        self,
        observation_scale: np.ndarray,
        action_size: int,
        *,
        hidden: int,
        log_std: float,
        seed: int,
    ):
        self.observation_scale = np.asarray(observation_scale, dtype=np.float64)
        self.action_size = int(action_size)
        generator = torch.Generator().manual_seed(seed)
        sizes = (len(self.observation_scale), hidden, hidden, self.action_size)
        self.network = Mlp(sizes, "tanh", generator=generator, output_scale=0.1, extra=self.action_size)
        self.log_std.fill_(log_std)

    @classmethod
    def for_task(cls, task: PolicyTask, *, hidden: int, log_std: float, seed: int) -> GaussianPolicy:
        """An untrained policy for a task: its observation scale and number of actions."""
        return cls(task.observation_scale, task.action_size, hidden=hidden, log_std=log_std, seed=seed)

    def copy(self, theta: torch.Tensor | None = None) -> GaussianPolicy:
        """A policy of the same shape with the given (default: its own) parameters."""
        policy = GaussianPolicy(
            self.observation_scale, self.action_size, hidden=self.network.sizes[1], log_std=0.0, seed=0
        )
        policy.theta.copy_(self.theta if theta is None else theta)
        return policy

    @property
    def theta(self) -> torch.Tensor:
        """All parameters, flat; live."""
        return self.network.theta

    @property
    def log_std(self) -> torch.Tensor:
        """Logarithm of the standard deviation of each action, (n_a,); live."""
        return self.theta[-self.action_size :]

    def scaled(self, observations: np.ndarray) -> torch.Tensor:
        """Network inputs (…, n_o) float32 of raw observations."""
        scaled = np.clip(observations / self.observation_scale, -LARGEST_INPUT, LARGEST_INPUT)
        return torch.from_numpy(np.ascontiguousarray(scaled, dtype=np.float32))

    def unscaled(self, inputs: torch.Tensor) -> np.ndarray:
        """Raw observations (n, n_o) of network inputs."""
        return inputs.numpy() * self.observation_scale

    def mean(self, observations: np.ndarray) -> np.ndarray:
        """Mean action (n, n_a) for raw observations (n, n_o): the policy that is evaluated and deployed.

        Runs in NumPy on views of the weights; for the 20-40 rows of a control step this is twice as fast as torch.
        """
        x = np.clip(observations / self.observation_scale, -LARGEST_INPUT, LARGEST_INPUT).astype(np.float32)
        *hidden, (weight, bias) = self._numpy_layers()
        for hidden_weight, hidden_bias in hidden:
            x = np.tanh(x @ hidden_weight.T + hidden_bias)
        return x @ weight.T + bias

    def _numpy_layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        return [(weight.numpy(), bias.numpy()) for weight, bias in self.network.layers]

    def log_probability(
        self, mean: torch.Tensor, log_std: torch.Tensor, actions: torch.Tensor
    ) -> torch.Tensor:
        """`log π(a|o)` (n,) from the mean (n, n_a), log σ (n_a,) and the actions (n, n_a)."""
        z = (actions - mean) * (-log_std).exp()
        return -0.5 * z.square().sum(1) - (log_std.sum() + 0.5 * self.action_size * LOG_TWO_PI)

    def divergence(
        self, mean_old: torch.Tensor, log_std_old: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor
    ) -> torch.Tensor:
        """Mean `KL(π_old ‖ π)` over the batch."""
        variance = (2.0 * log_std).exp()
        terms = ((2.0 * log_std_old).exp() + (mean_old - mean).square()) / (2.0 * variance)
        return (terms + log_std - log_std_old - 0.5).sum(1).mean()
