"""Samples of earlier policies, and the density of the mixture that they and the present policy's were drawn from.

In the end AIRL's policy is much like the expert, and a discriminator that meets nobody else forgets what it knew of
others. With earlier samples it tells the expert from a mixture, so that mixture's density belongs into it:

    D = exp r / (exp r + Σ w_k π_k),      w_k the share of policy k in the samples

With the present policy's density alone, r would be off by `log (π / Σ w_k π_k)`, away from whatever earlier policies
did, good or bad (docs/reproduction.md has what that costs).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from vic_toolbox.learning.networks import GaussianPolicy

_EVERY = 5
"""Of each kept iteration every fifth sample stays."""


@dataclass(frozen=True)
class Mixture:
    """Policies, the chance `weights` (K,) with which each draws."""

    policies: Sequence[GaussianPolicy]
    weights: torch.Tensor

    def log_density(self, samples: torch.Tensor) -> torch.Tensor:
        """`log Σ w_k π_k(a|o)` (n,) of samples (o, a), (n, n_o + n_a)."""
        size = self.policies[0].action_size
        inputs, actions = samples.split([samples.shape[1] - size, size], dim=1)
        each = [p.log_probability(p.network.value(inputs), p.log_std, actions) for p in self.policies]
        return torch.logsumexp(torch.stack(each) + self.weights.log()[:, None], dim=0)


class Replay:
    """The last `count` of every `stride`-th iteration's samples, and the policies that drew them.

    Parameters
    ----------
    count
        Policies kept; 0 keeps nothing.
    stride
        Iterations from one of them to the next.
    policy
        One of the policies to come: all have its shape.
    shape
        Samples of an iteration, numbers of a sample.
    """

    def __init__(self, count: int, *, stride: int, policy: GaussianPolicy, shape: tuple[int, int]):
        self.count, self.stride = count, stride
        rows, width = shape
        self.samples = torch.zeros(count, len(range(0, rows, _EVERY)) if count else 0, width)
        self.thetas = torch.zeros(count, len(policy.theta))

    def mixed(
        self, samples: torch.Tensor, policy: GaussianPolicy, *, iteration: int
    ) -> tuple[torch.Tensor, Mixture]:
        """The present policy's samples (n, n_o + n_a) and the kept ones below them, and what all were drawn from."""
        known = min(-(-iteration // self.stride), self.count)
        every = torch.cat([samples, *self.samples[:known]])
        policies = [policy, *(policy.copy(theta) for theta in self.thetas[:known])]
        weights = torch.tensor([len(samples), *[self.samples.shape[1]] * known]) / len(every)
        return every, Mixture(policies, weights)

    def keep(self, samples: torch.Tensor, policy: GaussianPolicy, *, iteration: int) -> None:
        """Put an iteration's samples in the place of the oldest ones, if it is one of those that are kept."""
        if self.count and iteration % self.stride == 0:
            oldest = iteration // self.stride % self.count
            self.samples[oldest] = samples[::_EVERY]
            self.thetas[oldest] = policy.theta

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that the rest of the run depends on, as live tensors (see `checkpoints`)."""
        return {"samples": self.samples, "thetas": self.thetas}
