"""Transfer: a policy for a changed task, optimised under the frozen learned reward.

The learned reward says what the demonstrated skill values; a policy that maximises it where the demonstrations
never were is the skill carried over. `fresh` starts that policy from random weights (the test of the reward
itself), otherwise it continues from the trained one, π₀, which is then an *anchor* of weight w:

    maximise  E Σ γᵗ ( (r(o, a) + w log π₀(a|o)) / (1 + w) − log π(a|o) )

The reward was learned near the demonstrations, and so was π₀; both estimate the logarithm of the expert's density, and
what only one of them says, in places that neither has seen, counts for less.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.policy_search import Batch, PolicySearch, PolicySearchConfiguration, restore
from vic_toolbox.learning.reward import RewardNetwork
from vic_toolbox.learning.rollouts import BatchedEnvironment


@dataclass(frozen=True)
class TransferConfiguration:
    """Settings of transfer."""

    iterations: int = 40
    """TRPO iterations under the frozen reward."""
    divergence: float = 0.01
    """Trust region δ [nats] at the first iteration."""
    divergence_final: float = 0.002
    """Trust region δ [nats] at the last iteration."""
    anchor: float = 0.3
    """Weight w of the trained policy's log π₀ beside the reward; a fresh policy has no anchor."""
    fresh: bool = False
    """Start from random weights instead of the trained policy."""
    search: PolicySearchConfiguration = field(default_factory=PolicySearchConfiguration)
    """The policy's improvement."""


class Transfer:
    """The state of a transfer run; `iterate()` until `finished`. The result is the averaged policy."""

    def __init__(
        self,
        environment: BatchedEnvironment,
        reward: RewardNetwork,
        policy: GaussianPolicy,
        *,
        configuration: TransferConfiguration,
        seed: int,
    ):
        self.reward = reward
        self.configuration = configuration
        self.iteration = torch.zeros((), dtype=torch.int64)
        self.anchor = None if configuration.fresh else policy.copy()
        if configuration.fresh:
            task, search = environment.task, configuration.search
            policy = GaussianPolicy.for_task(task, hidden=search.hidden, log_std=search.log_std, seed=seed)
        else:
            policy = policy.copy()
        self.search = PolicySearch(environment, policy, configuration=configuration.search, seed=seed)

    @property
    def finished(self) -> bool:
        """Whether all iterations are done."""
        return int(self.iteration) >= self.configuration.iterations

    @torch.no_grad()
    def iterate(self) -> dict[str, float]:
        """One iteration; returns its metrics."""
        settings, index = self.configuration, int(self.iteration)
        batch = self.search.sample(index)
        progress = index / max(settings.iterations - 1, 1)
        divergence = settings.divergence * (settings.divergence_final / settings.divergence) ** progress
        metrics = self.search.improve(batch, self._value(batch), divergence_limit=divergence, iteration=index)
        self.iteration.add_(1)
        return metrics | {"iteration": int(self.iteration)}

    def _value(self, batch: Batch) -> torch.Tensor:
        """What the policy is to maximise besides its entropy, (n·T,)."""
        reward, weight = self.reward.value(batch.samples), self.configuration.anchor
        if self.anchor is None or not weight:
            return reward
        mean = self.anchor.network.value(batch.steps)
        trained = self.anchor.log_probability(mean, self.anchor.log_std, batch.actions)
        return (reward + weight * trained) / (1.0 + weight)

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that the rest of the run depends on, as live tensors (see `checkpoints`)."""
        return {
            "iteration": self.iteration,
            **{f"search.{name}": value for name, value in self.search.state().items()},
        }

    def load_state(self, state: dict[str, torch.Tensor]) -> None:
        """Take a saved state; the next `iterate()` is the one that the saved run would have made."""
        restore(self.state(), state)

    def result(self) -> GaussianPolicy:
        """The averaged policy."""
        return self.search.averaged_policy()
