"""Adversarial inverse reinforcement learning of a reward and a policy from demonstrations.

Each iteration: roll the policy out, teach the reward to tell the expert's samples from the policy's, relabel the
rollouts with it, take one TRPO step, all with even weight for every part of the way (`strata`). Four more things
are added to the textbook algorithm, all decided without looking at a task's score, the last three for a
deterministic expert:

* the discriminator also sees samples of earlier policies (`replay`), so that the reward does not forget them;
* expert actions carry Gaussian noise, drawn anew each iteration, so that a density ratio exists;
* the slope bound, the trust region, the reward's step size and that noise are *sharpened* (moved geometrically to
  their final values) once the action error on held-out expert states is small, not at a fixed iteration;
* a run whose held-out action error stays large is restarted from new weights; of the fully sharpened iterations
  the one with the smallest error is kept, its policy and reward averaged over the last ten or so.

Sources: Fu, Luo, Levine, ICLR 2018; Zhang et al., section III of the paper (docs/reproduction.md).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import torch

from vic_toolbox.errors import integer
from vic_toolbox.learning.expert_data import ExpertData
from vic_toolbox.learning.networks import GaussianPolicy
from vic_toolbox.learning.policy_search import (
    Batch,
    PolicySearch,
    PolicySearchConfiguration,
    adam_state,
    random_stream,
    restore,
)
from vic_toolbox.learning.replay import Replay
from vic_toolbox.learning.reward import DiscriminatorConfiguration, RewardNetwork, train_discriminator
from vic_toolbox.learning.rollouts import BatchedEnvironment


@dataclass(frozen=True)
class AirlConfiguration:
    """Settings of AIRL."""

    iterations: int = 200
    """Iterations of one attempt."""
    divergence: float = 0.03
    """Trust region δ [nats] before sharpening."""
    divergence_final: float = 0.005
    """Trust region δ [nats] after sharpening."""
    slope_bound: float = 4.0
    """Bound L on ‖∂r/∂z‖ before sharpening."""
    slope_bound_final: float = 8.0
    """Bound L on ‖∂r/∂z‖ after sharpening."""
    learning_rate: float = 3e-3
    """Adam step size of the reward before sharpening."""
    learning_rate_final: float = 3e-4
    """Adam step size of the reward after sharpening."""
    expert_noise: float = 0.2
    """Standard deviation of the noise on expert actions before sharpening (normalised action)."""
    expert_noise_final: float = 0.05
    """Standard deviation of the noise on expert actions after sharpening."""
    sharpen_below: float = 0.2
    """Held-out action error (RMS, normalised action) below which sharpening goes on."""
    sharpen_iterations: int = 60
    """Iterations from the initial to the final values."""
    restart_after: int = 80
    """Iteration at which an attempt is judged."""
    restart_above: float = 0.4
    """Held-out action error above which the judged attempt is restarted."""
    restarts: int = 2
    """Largest number of restarts."""
    replay: int = 0
    """Earlier policies whose samples (a fifth of an iteration's) the discriminator also sees."""
    replay_stride: int = 2
    """Iterations from one of them to the next."""
    search: PolicySearchConfiguration = field(default_factory=PolicySearchConfiguration)
    """The policy's improvement."""
    discriminator: DiscriminatorConfiguration = field(default_factory=DiscriminatorConfiguration)
    """The reward's update."""

    def __post_init__(self) -> None:
        """Refuse a replay that is none."""
        integer("replay", self.replay, low=0)
        integer("replay_stride", self.replay_stride, low=1)


class Airl:
    """The state of an AIRL run; `iterate()` until `finished`.

    Parameters
    ----------
    environment
        The training task.
    expert
        Demonstrations, split into training and held-out rows.
    seed
        Of initial weights, exploration, starts and minibatches: the same seed gives the same numbers.
    """

    def __init__(
        self,
        environment: BatchedEnvironment,
        expert: ExpertData,
        *,
        configuration: AirlConfiguration,
        seed: int,
    ):
        self.environment = environment
        self.expert = expert
        self.configuration = configuration
        self.seed = seed
        # attempt, iteration in this attempt, in all, sharpness in [0, 1]; sharpness and held-out error of what is kept
        self.attempt = torch.zeros((), dtype=torch.int64)
        self.iteration = torch.zeros((), dtype=torch.int64)
        self.total = torch.zeros((), dtype=torch.int64)
        self.sharpness = torch.zeros((), dtype=torch.float64)
        self.best_sharpness = torch.zeros((), dtype=torch.float64)
        self.best_error = torch.full((), float("inf"), dtype=torch.float64)
        self._begin_attempt()
        self.best_policy = self.search.policy.theta.clone()
        self.best_reward = self.reward.theta.clone()

    def _begin_attempt(self) -> None:
        settings, task = self.configuration, self.environment.task
        seed = int(random_stream(self.seed, 3, int(self.attempt)).integers(2**31))
        search = settings.search
        policy = GaussianPolicy.for_task(task, hidden=search.hidden, log_std=search.log_std, seed=seed)
        self.search = PolicySearch(self.environment, policy, configuration=search, seed=seed)
        self.reward = RewardNetwork.for_task(task, seed=seed + 2)
        self.reward_average = self.reward.theta.clone()
        rows, width = search.environments * task.horizon, task.observation_size + task.action_size
        self.replay = Replay(
            settings.replay, stride=settings.replay_stride, policy=policy, shape=(rows, width)
        )
        self.expert_strata = task.strata(policy.unscaled(self.expert.training[0]))
        self.iteration.zero_()
        self.sharpness.zero_()

    @property
    def finished(self) -> bool:
        """Whether all iterations are done."""
        return int(self.iteration) >= self.configuration.iterations

    @torch.no_grad()
    def iterate(self) -> dict[str, float]:
        """One iteration; returns its metrics."""
        settings, index = self.configuration, int(self.iteration)
        batch = self.search.sample(index)
        metrics = self._train_reward(batch, index)
        reward = self.reward.value(batch.samples)
        divergence = self._sharpened(settings.divergence, settings.divergence_final)
        metrics |= self.search.improve(batch, reward, divergence_limit=divergence, iteration=index)

        self.reward_average.lerp_(self.reward.theta, 1.0 / float(self.search.average_weight))
        error = self.expert.action_error(self.search.averaged_policy())
        self._keep_if_better(error)
        if error < settings.sharpen_below:
            self.sharpness.add_(1.0 / settings.sharpen_iterations).clamp_(max=1.0)
        self.iteration.add_(1)
        self.total.add_(1)
        metrics |= {
            "iteration": int(self.total),
            "attempt": int(self.attempt),
            "action_error": error,
            "sharpness": float(self.sharpness),
        }
        if self._failing(error):
            self.attempt.add_(1)
            self._begin_attempt()
        return metrics

    def _keep_if_better(self, error: float) -> None:
        """Keep the averaged policy and reward: sharper beats blunter, then the smaller error counts.

        A policy may be good before its reward is; only a sharpened reward can teach another policy precisely.
        """
        if (float(self.sharpness), -error) >= (float(self.best_sharpness), -float(self.best_error)):
            self.best_sharpness.copy_(self.sharpness)
            self.best_error.fill_(error)
            self.best_policy.copy_(self.search.average)
            self.best_reward.copy_(self.reward_average)

    def _failing(self, error: float) -> bool:
        settings = self.configuration
        return (
            int(self.iteration) == settings.restart_after
            and error > settings.restart_above
            and int(self.attempt) < settings.restarts
        )

    def _sharpened(self, initial: float, final: float) -> float:
        """On the geometric way from the initial to the final value; a zero stays zero."""
        return initial * (final / initial) ** float(self.sharpness) if initial else 0.0

    def _train_reward(self, batch: Batch, index: int) -> dict[str, float]:
        settings, policy = self.configuration, self.search.policy
        rng = random_stream(self.search.seed, 4, index)
        noise = self._sharpened(settings.expert_noise, settings.expert_noise_final)
        inputs, actions = self.expert.training
        noisy = actions + noise * torch.from_numpy(rng.standard_normal(actions.shape, dtype="float32"))
        expert = torch.cat([inputs, noisy], dim=1)
        own, mixture = self.replay.mixed(batch.samples, policy, iteration=index)
        own_strata = self.environment.task.strata(policy.unscaled(own[:, : inputs.shape[1]]))
        metrics = train_discriminator(
            self.reward,
            (expert, mixture.log_density(expert), self.expert_strata),
            (own, mixture.log_density(own), own_strata),
            slope_bound=self._sharpened(settings.slope_bound, settings.slope_bound_final),
            learning_rate=self._sharpened(settings.learning_rate, settings.learning_rate_final),
            configuration=settings.discriminator,
            rng=rng,
        )
        self.replay.keep(batch.samples, policy, iteration=index)
        return metrics

    def state(self) -> dict[str, torch.Tensor]:
        """Everything that the rest of the run depends on, as live tensors (see `checkpoints`)."""
        return {
            "attempt": self.attempt,
            "iteration": self.iteration,
            "total": self.total,
            "sharpness": self.sharpness,
            "best_sharpness": self.best_sharpness,
            "best_error": self.best_error,
            "best_policy": self.best_policy,
            "best_reward": self.best_reward,
            "reward": self.reward.theta,
            "reward_average": self.reward_average,
            **{f"replay.{name}": value for name, value in self.replay.state().items()},
            **{f"reward.{name}": value for name, value in adam_state(self.reward.optimiser).items()},
            **{f"search.{name}": value for name, value in self.search.state().items()},
        }

    def load_state(self, state: dict[str, torch.Tensor]) -> None:
        """Take a saved state; the next `iterate()` is the one that the saved run would have made."""
        self.attempt.copy_(state["attempt"])
        self._begin_attempt()  # the attempt's own seeds
        restore(self.state(), state)

    def result(self) -> tuple[GaussianPolicy, RewardNetwork]:
        """The kept policy and the reward of the same iteration."""
        policy = self.search.policy.copy(self.best_policy)
        reward = RewardNetwork.for_task(self.environment.task, seed=0)
        reward.theta.copy_(self.best_reward)
        return policy, reward
