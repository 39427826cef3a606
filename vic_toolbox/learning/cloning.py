"""Behaviour cloning: regression of the expert's action on the observation, with held-out early stopping."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

from vic_toolbox.learning.expert_data import ExpertData
from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.strata import stratified_rows


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


@torch.no_grad()
def clone(
    policy: GaussianPolicy,
    expert: ExpertData,
    *,
    configuration: CloningConfiguration,
    rng: np.random.Generator,
    progress: Callable[[dict[str, float]], None] | None = None,
) -> float:
    """Fit the policy's mean to the expert's training rows in place; returns the best held-out action error.

    Minimises `E ‖(μ(o) − a) / s‖²` with s the expert actions' standard deviation per component, over all moments or,
    where the data have strata, over all parts of the way alike; log σ is set to the logarithm of the held-out error, so
    that the cloned policy is a proper Gaussian.
    """
    inputs, actions = expert.training
    scale = actions.std(0) + 1e-3
    parameters = policy.theta
    optimiser = torch.optim.Adam([parameters], lr=configuration.learning_rate, fused=True)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimiser, configuration.steps, eta_min=configuration.learning_rate / 100
    )
    best, best_theta = float("inf"), parameters.clone()
    for step in range(1, configuration.steps + 1):
        rows = _minibatch(expert, configuration.batch, rng)
        output, activations = policy.network.forward(inputs[rows])
        difference = (output - actions[rows]) / scale
        cotangent = difference * (2.0 / difference.numel()) / scale
        parameters.grad = torch.cat(
            [policy.network.gradient(activations, cotangent), torch.zeros(policy.action_size)]
        )
        optimiser.step()
        schedule.step()
        if step % configuration.check_every == 0 or step == configuration.steps:
            error = expert.action_error(policy)
            if error < best:
                best, best_theta = error, parameters.clone()
            if progress is not None:
                progress({"iteration": step, "action_error": error})
    parameters.grad = None
    parameters.copy_(best_theta)
    held_inputs, held_actions = expert.held_out
    residual = (policy.network.value(held_inputs) - held_actions).square().mean(0).sqrt()
    policy.log_std.copy_(residual.clamp_(min=1e-3).log_())
    return best


def _minibatch(expert: ExpertData, size: int, rng: np.random.Generator) -> torch.Tensor:
    if expert.strata is not None:
        return stratified_rows(expert.strata[0], (size,), rng)
    return torch.from_numpy(rng.integers(len(expert.training[0]), size=size))
