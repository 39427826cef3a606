"""Trust-region policy optimisation with an analytic Gauss-Newton Fisher product.

    maximise  E[ π_θ(a|o) / π_old(a|o) · A(o, a) ]   subject to   E[ KL(π_old ‖ π_θ) ] ≤ δ

The step is `√(2δ / xᵀFx) · x`, `F x = g`, by conjugate gradients, then a backtracking line search. For a Gaussian
with mean μ_θ(o) and a free log σ the Fisher matrix at θ_old is exactly the Gauss-Newton matrix
`F = E[ Jᵀ Σ⁻¹ J ] ⊕ 2I`, `J = ∂μ/∂θ`: two matrix passes a product instead of double backpropagation.

Source: Schulman, Levine, Moritz, Jordan, Abbeel, "Trust Region Policy Optimization", ICML 2015, and its appendix C.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch

from vic_toolbox.learning.networks import GaussianPolicy


@dataclass(frozen=True)
class TrpoConfiguration:
    """Settings of one trust-region step."""

    conjugate_gradient_steps: int = 10
    """Conjugate-gradient iterations for F x = g."""
    fisher_damping: float = 0.1
    """Multiple of the identity added to the Fisher matrix."""
    fisher_stride: int = 4
    """Every how many-th sample enters the Fisher matrix."""
    backtracks: int = 10
    """Largest number of halvings of the step."""
    divergence_slack: float = 1.5
    """The line search accepts a step up to this multiple of the KL limit."""


@dataclass(frozen=True)
class TrpoStep:
    """What a step did: the measured KL divergence, the surrogate's gain, and the accepted fraction of the step."""

    divergence: float
    improvement: float
    fraction: float


def conjugate_gradient(
    product: Callable[[torch.Tensor], torch.Tensor], target: torch.Tensor, steps: int
) -> torch.Tensor:
    """Approximate solution of `F x = target` for a symmetric positive definite `product(x) = F x`."""
    x = torch.zeros_like(target)
    residual = target.clone()
    direction = target.clone()
    squared = residual @ residual
    for _ in range(steps):
        if float(squared) < 1e-10:
            break
        image = product(direction)
        length = squared / (direction @ image)
        x += length * direction
        residual -= length * image
        squared, previous = residual @ residual, squared
        direction = residual + (squared / previous) * direction
    return x


def fisher_product(
    policy: GaussianPolicy, inputs: torch.Tensor, damping: float
) -> Callable[[torch.Tensor], torch.Tensor]:
    """`v ↦ (F + damping · I) v` at the policy's present parameters, for network inputs (n, n_o)."""
    _, activations = policy.network.forward(inputs)
    weight = (-2.0 * policy.log_std).exp() / len(inputs)

    def product(vector: torch.Tensor) -> torch.Tensor:
        tangent = policy.network.tangent(activations, vector).mul_(weight)
        result = torch.cat(
            [policy.network.gradient(activations, tangent), 2.0 * vector[-policy.action_size :]]
        )
        return result.add_(vector, alpha=damping)

    return product


@torch.no_grad()
def trpo_step(
    policy: GaussianPolicy,
    inputs: torch.Tensor,
    actions: torch.Tensor,
    advantages: torch.Tensor,
    *,
    divergence_limit: float,
    configuration: TrpoConfiguration,
) -> TrpoStep:
    """Improve the policy in place by one trust-region step.

    Parameters
    ----------
    inputs
        Scaled observations (n, n_o).
    actions
        As sampled, unclipped, (n, n_a).
    advantages
        (n,).
    divergence_limit
        Δ [nats].
    """
    mean, activations = policy.network.forward(inputs)
    log_std = policy.log_std.clone()
    inverse_variance = (-2.0 * log_std).exp()
    log_probability = policy.log_probability(mean, log_std, actions)

    deviation = actions - mean
    weight = (advantages / len(inputs))[:, None]
    gradient = torch.cat(
        [
            policy.network.gradient(activations, weight * deviation * inverse_variance),
            (weight * (deviation.square() * inverse_variance - 1.0)).sum(0),
        ]
    )
    subset = inputs[:: configuration.fisher_stride].contiguous()
    product = fisher_product(policy, subset, configuration.fisher_damping)
    direction = conjugate_gradient(product, gradient, configuration.conjugate_gradient_steps)
    step = direction * math.sqrt(2.0 * divergence_limit / max(float(direction @ product(direction)), 1e-12))

    start = policy.theta.clone()
    baseline = float(advantages.mean())
    fraction = 1.0
    for _ in range(configuration.backtracks):
        policy.theta.copy_(start).add_(step, alpha=fraction)
        new_mean = policy.network.value(inputs)
        ratio = (policy.log_probability(new_mean, policy.log_std, actions) - log_probability).exp()
        improvement = float((advantages * ratio).mean()) - baseline
        divergence = float(policy.divergence(mean, log_std, new_mean, policy.log_std))
        if improvement > 0.0 and divergence <= configuration.divergence_slack * divergence_limit:
            return TrpoStep(divergence, improvement, fraction)
        fraction *= 0.5
    policy.theta.copy_(start)
    return TrpoStep(0.0, 0.0, 0.0)
