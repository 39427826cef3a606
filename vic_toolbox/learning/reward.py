"""The AIRL discriminator: a reward network with a bounded slope.

    D(o, a) = exp r(o, a) / (exp r(o, a) + π(a|o)),      logit D = r(o, a) − log π(a|o)
    loss    = −E_expert log D − E_policy log(1 − D) + λ E_ẑ [ max(0, ‖∂r/∂ẑ‖ − L)² ]

ẑ lies on straight lines between expert and policy samples z = (o, a). Without the bound a deterministic expert
drives D to 100 % accuracy and r to a spike that cannot teach another policy; L also sets how far the policy's
standard deviation can shrink. For a ReLU network ∂r/∂z is piecewise constant in z, so the penalty's parameter
gradient needs no second differentiation of the activation and is written out below.

Sources: Fu, Luo, Levine, "Learning robust rewards with adversarial inverse reinforcement learning", ICLR 2018,
eq. 4; Gulrajani et al., "Improved training of Wasserstein GANs", NeurIPS 2017 (two-sided form of the penalty).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch

from vic_toolbox.errors import InputError
from vic_toolbox.learning.networks import Mlp
from vic_toolbox.learning.strata import stratified_rows


@dataclass(frozen=True)
class DiscriminatorConfiguration:
    """Settings of the discriminator's update."""

    steps: int = 40
    """Adam steps an iteration."""
    batch: int = 512
    """Expert rows and as many policy rows in a step."""
    penalty: float = 10.0
    """Weight λ of the slope penalty; 0 leaves the slope free (plain AIRL)."""


class JudgedTask(Protocol):
    """What a reward must know of its task."""

    observation_size: int
    action_size: int
    history: int


class RewardNetwork:
    """`r(o, a)`: ReLU network on the newest scaled observation and the normalised action.

    A history of observations is for the policy: what a step is worth is seen in the step itself, and a reward that
    judged five observations at once would have five times as many directions to be wrong in where nobody has been.
    """

    def __init__(self, observation_size: int, action_size: int, *, hidden: int = 32, seed: int):
        generator = torch.Generator().manual_seed(seed)
        self.observation_size = observation_size
        self.network = Mlp((observation_size + action_size, hidden, hidden, 1), "relu", generator=generator)
        self.optimiser = torch.optim.Adam([self.network.theta], fused=True)

    @classmethod
    def for_task(cls, task: JudgedTask, *, seed: int) -> RewardNetwork:
        """An untrained reward for a task: one of its observations and its action."""
        return cls(task.observation_size // task.history, task.action_size, seed=seed)

    @property
    def theta(self) -> torch.Tensor:
        """All parameters, flat; live."""
        return self.network.theta

    def value(self, samples: torch.Tensor) -> torch.Tensor:
        """`r` (n,) of samples z = (scaled observations, oldest first, action), (n, h n_o + n_a)."""
        return self.network.value(self.judged(samples))[:, 0]

    def judged(self, samples: torch.Tensor) -> torch.Tensor:
        """The newest observation and the action (..., n_o + n_a) of samples (..., h n_o + n_a).

        Raises
        ------
        InputError
            Samples that are no history of such observations and an action: the reward is of another task.
        """
        judged, width = self.network.sizes[0], samples.shape[-1]
        if width < judged or (width - judged) % self.observation_size:
            raise InputError(
                f"samples have {width} numbers; this reward judges {self.observation_size} of an observation and "
                f"{judged - self.observation_size} of an action, after any number of earlier observations"
            )
        return samples[..., width - judged :]


Samples = tuple[torch.Tensor, torch.Tensor, np.ndarray]


def slope_penalty(network: Mlp, samples: torch.Tensor, *, bound: float) -> tuple[torch.Tensor, torch.Tensor]:
    """`mean max(0, ‖∂r/∂z‖ − bound)²` of a ReLU network with one output, and its gradient in θ.

    With the activation patterns s_i held (their derivative is zero almost everywhere) the slope is
    `∂r/∂z = W₁ᵀ s₁ ∘ (W₂ᵀ s₂ ∘ w₃)` and so on for any depth, linear in each weight matrix.
    """
    _, activations = network.forward(samples)
    matrices = [weight for weight, _ in network.layers]
    # Row vectors, from the output back to the input: rows[i] = ∂r/∂(pre-activation of layer i).
    row = torch.ones(len(samples), 1)
    rows = [row]
    for depth in range(len(matrices) - 1, 0, -1):
        row = (row @ matrices[depth]).mul_(activations.slopes[depth - 1])
        rows.insert(0, row)
    slope = row @ matrices[0]
    norm = slope.norm(dim=1)
    excess = (norm - bound).clamp_(min=0.0)

    back = slope.mul_((2.0 * excess / norm.clamp(min=1e-12) / len(samples))[:, None])
    gradient = torch.zeros_like(network.theta)
    for depth, (weight_gradient, _) in enumerate(network.split(gradient)):
        weight_gradient.copy_(rows[depth].T @ back)
        if depth < len(matrices) - 1:
            back = (back @ matrices[depth].T).mul_(activations.slopes[depth])
    return excess.square().mean(), gradient


def _drawn(reward: RewardNetwork, pool: Samples, rows: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """What the reward judges (*rows.shape, n_o + n_a) and log π (*rows.shape) of the drawn rows."""
    samples, log_probability, _ = pool
    flat = rows.reshape(-1)
    judged = reward.judged(samples).index_select(0, flat).view(*rows.shape, -1)
    return judged, log_probability.index_select(0, flat).view(rows.shape)


@torch.no_grad()
def train_discriminator(
    reward: RewardNetwork,
    expert: Samples,
    policy: Samples,
    *,
    slope_bound: float,
    learning_rate: float,
    configuration: DiscriminatorConfiguration,
    rng: np.random.Generator,
) -> dict[str, float]:
    """Fit the reward to tell expert from policy samples; returns the mean loss, accuracy and slope penalty.

    `expert` and `policy` are each samples z (n, h n_o + n_a), the log density log π(a|o) (n,) of the policy, or of
    the mixture of policies, that drew the latter, and strata (n,). Minibatches draw every stratum equally often, so
    that a short phase of the task teaches as much as a long one.
    """
    network, optimiser, batch = reward.network, reward.optimiser, configuration.batch
    optimiser.param_groups[0]["lr"] = learning_rate
    label = torch.cat([torch.ones(batch), torch.zeros(batch)])
    shape = (configuration.steps, batch)
    expert_rows, policy_rows = (stratified_rows(strata, shape, rng) for strata in (expert[2], policy[2]))
    mixture = torch.from_numpy(rng.random((*shape, 1), dtype=np.float32))
    # All minibatches at once, (steps, batch, ...): one gather instead of one a step.
    expert_samples, expert_log = _drawn(reward, expert, expert_rows)
    policy_samples, policy_log = _drawn(reward, policy, policy_rows)
    between = torch.lerp(policy_samples, expert_samples, mixture)
    samples = torch.cat([expert_samples, policy_samples], dim=1)
    log_probability = torch.cat([expert_log, policy_log], dim=1)
    totals = torch.zeros(3)
    for z, log_policy, middle in zip(samples, log_probability, between, strict=True):
        output, activations = network.forward(z)
        logit = output[:, 0] - log_policy
        gradient = network.gradient(activations, ((logit.sigmoid() - label) / len(label))[:, None])
        penalty = torch.zeros(())
        if configuration.penalty:
            penalty, penalty_gradient = slope_penalty(network, middle, bound=slope_bound)
            gradient.add_(penalty_gradient, alpha=configuration.penalty)
        network.theta.grad = gradient
        optimiser.step()
        loss = torch.nn.functional.binary_cross_entropy_with_logits(logit, label)
        totals += torch.stack([loss, ((logit > 0) == (label > 0)).float().mean(), penalty])
    network.theta.grad = None
    loss, accuracy, penalty = (totals / configuration.steps).tolist()
    return {"discriminator_loss": loss, "discriminator_accuracy": accuracy, "slope_penalty": penalty}
