"""Policy improvement under a reward: roll out, relabel, estimate advantages, take a TRPO step, refit the critic.

The same iteration serves AIRL (the reward changes between the steps) and transfer (the reward is frozen). The
objective is `E Σ γᵗ ( r(o, a) − w log π(a|o) )`, the entropy-regularised return whose optimum AIRL's discriminator
assumes; log π is taken at sampling time on the unclipped action.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import torch

from vic_toolbox.learning.critic import Critic, CriticConfiguration
from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.rollouts import BatchedEnvironment, Rollout, collect, generalised_advantages
from vic_toolbox.learning.strata import stratified_rows
from vic_toolbox.learning.trpo import TrpoConfiguration, trpo_step


@dataclass(frozen=True)
class PolicySearchConfiguration:
    """Settings of the policy's improvement, the same for AIRL and transfer."""

    environments: int = 20
    """Simulations side by side; with a horizon of 500 steps 20 of them give the paper's batch of 10000."""
    start_noise: float = 1.0
    """Variation of the starts, in units of the task's usual one."""
    hidden: int = 32
    """Units of each of the policy's and the critic's two hidden layers."""
    log_std: float = -0.5
    """Initial logarithm of the policy's standard deviation (normalised action)."""
    discount: float = 0.8
    """Discount factor γ."""
    trace: float = 0.8
    """Decay λ of the generalised advantages."""
    entropy_weight: float = 1.0
    """Weight w of −log π in the objective."""
    averaging: float = 0.9
    """Decay of the running average of the weights; the average is what is evaluated and kept."""
    trpo: TrpoConfiguration = field(default_factory=TrpoConfiguration)
    """The trust-region step."""
    critic: CriticConfiguration = field(default_factory=CriticConfiguration)
    """The value function's fit."""


@dataclass(frozen=True)
class Batch:
    """A rollout as network inputs, episode first: inputs (n, T+1, n_o), actions (n·T, n_a), log π(a|o) (n·T,)."""

    rollout: Rollout
    inputs: torch.Tensor
    actions: torch.Tensor
    log_probability: torch.Tensor

    @property
    def steps(self) -> torch.Tensor:
        """Inputs (n·T, n_o) at which the actions were taken."""
        return self.inputs[:, :-1].reshape(len(self.actions), -1)

    @property
    def samples(self) -> torch.Tensor:
        """`z = (input, action)` (n·T, n_o + n_a) for the reward."""
        return torch.cat([self.steps, self.actions], dim=1)


def random_stream(seed: int, *path: int) -> np.random.Generator:
    """An independent generator for a seed and a path of counters.

    Every iteration has its own streams, so a run resumed at iteration k draws what the unbroken run drew.
    """
    return np.random.default_rng([seed, *path])


class PolicySearch:
    """A policy, its critic and its running average, improved one iteration at a time.

    Parameters
    ----------
    environment
        Batched environment of the task.
    policy
        Changed in place.
    seed
        Of exploration and starts.
    """

    def __init__(
        self,
        environment: BatchedEnvironment,
        policy: GaussianPolicy,
        *,
        configuration: PolicySearchConfiguration,
        seed: int,
    ):
        self.environment = environment
        self.policy = policy
        self.configuration = configuration
        self.seed = seed
        self.critic = Critic(environment.task.observation_size, hidden=configuration.hidden, seed=seed + 1)
        self.average = policy.theta.clone()
        self.average_weight = torch.zeros(())
        self.return_scale = torch.zeros(())

    @torch.no_grad()
    def sample(self, iteration: int) -> Batch:
        """Roll the stochastic policy out in every sub-environment."""
        rollout = collect(
            self.environment,
            self.policy,
            rng=random_stream(self.seed, 0, iteration),
            seed=int(random_stream(self.seed, 1, iteration).integers(2**31)),
            start_noise=self.configuration.start_noise,
        )
        inputs = self.policy.scaled(rollout.observations.transpose(1, 0, 2))
        actions = torch.from_numpy(rollout.actions.transpose(1, 0, 2).reshape(-1, self.policy.action_size))
        steps = inputs[:, :-1].reshape(len(actions), -1)
        log_probability = self.policy.log_probability(
            self.policy.network.value(steps), self.policy.log_std, actions
        )
        return Batch(rollout, inputs, actions, log_probability)

    @torch.no_grad()
    def improve(
        self, batch: Batch, reward: torch.Tensor, *, divergence_limit: float, iteration: int
    ) -> dict[str, float]:
        """One TRPO step on a batch relabelled with `reward` (n·T,), then the critic; returns the metrics."""
        settings = self.configuration
        count, length = batch.inputs.shape[0], batch.inputs.shape[1] - 1
        objective = reward - settings.entropy_weight * batch.log_probability
        mean_objective = float(objective.mean())
        objective = objective - objective.mean()
        # The first batch sets the unit of the returns, so that the critic's targets are of order one.
        unit = float(self.return_scale) or 1.0
        rewards = (objective / unit).view(count, length).T.double().numpy()
        values = self.critic.value(batch.inputs.reshape(-1, batch.inputs.shape[-1])).view(count, length + 1)
        advantages, returns = generalised_advantages(
            rewards, values.T.double().numpy(), discount=settings.discount, trace=settings.trace
        )
        if not float(self.return_scale):
            self.return_scale.fill_(max(float(returns.std()), 1e-3))
            returns /= float(self.return_scale)
        normalised = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
        rows = self._evenly(batch, iteration)
        step = trpo_step(
            self.policy,
            batch.steps[rows],
            batch.actions[rows],
            _episode_first(normalised)[rows],
            divergence_limit=divergence_limit,
            configuration=settings.trpo,
        )
        error = self.critic.fit(
            batch.steps,
            _episode_first(returns),
            configuration=settings.critic,
            rng=random_stream(self.seed, 2, iteration),
        )
        self._update_average()
        return {
            "score": float(batch.rollout.score.mean()),
            "objective": mean_objective,
            "divergence": step.divergence,
            "log_std": float(self.policy.log_std.mean()),
            "critic_error": error,
        }

    def _evenly(self, batch: Batch, iteration: int) -> torch.Tensor:
        """As many rows as the batch has, drawn so that every stratum of the task weighs the same in the step."""
        strata = self.environment.task.strata(self.policy.unscaled(batch.steps))
        return stratified_rows(strata, (len(batch.actions),), random_stream(self.seed, 5, iteration))

    def _update_average(self) -> None:
        """Bias-corrected exponential average: exact mean of the first few iterates, then a window."""
        self.average_weight.mul_(self.configuration.averaging).add_(1.0)
        self.average.lerp_(self.policy.theta, 1.0 / float(self.average_weight))

    def averaged_policy(self) -> GaussianPolicy:
        """A copy of the policy with the running average of its weights."""
        return self.policy.copy(self.average)

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that the next iteration depends on."""
        return {
            "policy": self.policy.theta,
            "critic": self.critic.theta,
            **{f"critic.{name}": value for name, value in adam_state(self.critic.optimiser).items()},
            "average": self.average,
            "average_weight": self.average_weight,
            "return_scale": self.return_scale,
        }


def _episode_first(values: np.ndarray) -> torch.Tensor:
    """(T, n) float64 to (n·T,) float32, the order of `Batch.actions`."""
    return torch.from_numpy(np.ascontiguousarray(values.T, dtype=np.float32).reshape(-1))


def adam_state(optimiser: torch.optim.Adam) -> dict[str, torch.Tensor]:
    """The optimiser's moments and step count as live tensors, made at the first call."""
    (parameters,) = optimiser.param_groups[0]["params"]
    state = optimiser.state[parameters]
    if not state:
        state["step"] = torch.zeros(())
        state["exp_avg"] = torch.zeros_like(parameters)
        state["exp_avg_sq"] = torch.zeros_like(parameters)
    return {name: state[name] for name in ("step", "exp_avg", "exp_avg_sq")}


def restore(live: dict[str, torch.Tensor], saved: dict[str, torch.Tensor]) -> None:
    """Copy saved tensors into live ones of the same names and shapes."""
    for name, tensor in live.items():
        tensor.copy_(saved[name])
