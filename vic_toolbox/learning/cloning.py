"""Behaviour cloning: regression of the expert's action on the observation, with held-out early stopping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from vic_toolbox.learning.networks import GaussianPolicy


@dataclass(frozen=True)
class CloningConfiguration:
    """Settings of behaviour cloning."""

    steps: int = 6000
    """Adam steps."""
    batch: int = 1024
    """Rows of a step."""
    learning_rate: float = 3e-3
    """Adam step size, decayed to a hundredth along a cosine."""
    check_every: int = 200
    """Steps between two looks at the held-out error; the best weights are kept."""


def action_error(policy: GaussianPolicy, inputs: torch.Tensor, actions: torch.Tensor) -> float:
    """Root-mean-square difference between the mean action and the expert's, over rows and components."""
    return float((policy.network.value(inputs) - actions).square().mean().sqrt())


@torch.no_grad()
def clone(
    policy: GaussianPolicy,
    expert: tuple[torch.Tensor, torch.Tensor],
    held_out: tuple[torch.Tensor, torch.Tensor],
    *,
    configuration: CloningConfiguration,
    rng: np.random.Generator,
    progress: Callable[[dict[str, float]], None] | None = None,
) -> float:
    """Fit the policy's mean to expert (inputs, actions) in place; returns the best held-out action error.

    Minimises `E ‖(μ(o) − a) / s‖²` with s the expert actions' standard deviation per component; log σ is set to the
    logarithm of the held-out error, so that the cloned policy is a proper Gaussian.
    """
    inputs, actions = expert
    scale = actions.std(0) + 1e-3
    parameters = policy.theta
    optimiser = torch.optim.Adam([parameters], lr=configuration.learning_rate, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimiser, configuration.steps, eta_min=configuration.learning_rate / 100
    )
    best, best_theta = float("inf"), parameters.clone()
    for step in range(1, configuration.steps + 1):
        rows = torch.from_numpy(rng.integers(len(inputs), size=configuration.batch))
        output, activations = policy.network.forward(inputs[rows])
        difference = (output - actions[rows]) / scale
        cotangent = difference * (2.0 / difference.numel()) / scale
        parameters.grad = torch.cat(
            [policy.network.gradient(activations, cotangent), torch.zeros(policy.action_size)]
        )
        optimiser.step()
        schedule.step()
        if step % configuration.check_every == 0 or step == configuration.steps:
            error = action_error(policy, *held_out)
            if error < best:
                best, best_theta = error, parameters.clone()
            if progress is not None:
                progress({"iteration": step, "action_error": error})
    parameters.grad = None
    parameters.copy_(best_theta)
    residual = (policy.network.value(held_out[0]) - held_out[1]).square().mean(0).sqrt()
    policy.log_std.copy_(residual.clamp_(min=1e-3).log_())
    return best
