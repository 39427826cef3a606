"""The reference learner: AIRL of the `imitation` library with sb3-contrib's TRPO, one iteration at a time.

Runs inside the benchmark's own environment as `python -m benchmarks.reference_imitation`. The first line on
its standard input is the workload as JSON; it answers with the versions it runs on. Every further line makes
it do one AIRL iteration and answer with the processor and wall seconds of each part.

The parts are those of a learner, without the simulation:

    discriminator   all calls of `train_disc`; `expert_batches` of it draws the expert's minibatches
    relabel         the learned reward of the batch, which imitation computes at every step of a rollout
    advantages      generalised advantages
    trpo, critic    the two halves of `TRPO.train`

Stepping the environments, sampling the policy (with its values and log-probabilities) and storing the
rollouts are measured as `not_counted`.
"""
# pyright: reportMissingImports=false

from __future__ import annotations

import json
import platform
import sys
import tempfile
import warnings
from collections.abc import Callable
from typing import Any

import gymnasium
import imitation
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from imitation.algorithms.adversarial.airl import AIRL
from imitation.data import types
from imitation.data.rollout import flatten_trajectories
from imitation.rewards.reward_nets import BasicRewardNet
from imitation.util import logger, networks
from sb3_contrib import TRPO
from stable_baselines3.common.vec_env import DummyVecEnv

from benchmarks.stopwatch import Stopwatch, now
from benchmarks.workload import LinearSystem, LinearTask, Workload, demonstrations


class LinearEnvironment(gymnasium.Env):
    """One copy of the synthetic system as a Gymnasium environment."""

    def __init__(self, task: LinearTask):
        self._system = LinearSystem(task, 1)
        self._horizon = task.horizon
        self._time = 0
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (task.observation_size,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (task.action_size,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """A new start, drawn from the environment's own generator."""
        super().reset(seed=seed)
        self._time = 0
        observation, info = self._system.reset(seed=int(self.np_random.integers(2**31)))
        return observation[0].astype(np.float32), info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One step; the episode is truncated at the horizon and never terminates."""
        self._time += 1
        observation, reward, _, _, info = self._system.step(action[None])
        return observation[0].astype(np.float32), float(reward[0]), False, self._time >= self._horizon, info


def make_trainer(workload: Workload, folder: str) -> AIRL:
    """The library's AIRL at the workload's sizes, and its defaults where the workload names nothing."""
    task = LinearTask(workload)

    def environment() -> gymnasium.Env:
        return LinearEnvironment(task)

    environments = DummyVecEnv([environment] * workload.environments)
    environments.seed(0)
    hidden = [workload.hidden, workload.hidden]
    generator = TRPO(
        "MlpPolicy",
        environments,
        n_steps=workload.horizon,
        gamma=workload.discount,
        gae_lambda=workload.trace,
        target_kl=workload.divergence,
        cg_max_steps=workload.conjugate_gradient_steps,
        cg_damping=workload.fisher_damping,
        line_search_max_iter=workload.backtracks,
        line_search_shrinking_factor=0.5,
        n_critic_updates=workload.critic_epochs,
        batch_size=workload.critic_batch,
        learning_rate=workload.critic_learning_rate,
        policy_kwargs={
            "net_arch": {"pi": hidden, "vf": hidden},
            "activation_fn": torch.nn.Tanh,
            "log_std_init": workload.log_std,
        },
        device="cpu",
        seed=0,
    )
    observations, actions = demonstrations(task, workload.expert_trajectories)
    trajectories = [
        types.Trajectory(obs=rows, acts=acts, infos=None, terminal=True)
        for rows, acts in zip(observations.astype(np.float32), actions.astype(np.float32), strict=True)
    ][: -workload.held_out]
    return AIRL(
        demonstrations=flatten_trajectories(trajectories),
        demo_batch_size=workload.discriminator_batch,
        n_disc_updates_per_round=workload.discriminator_steps,
        disc_opt_kwargs={"lr": workload.discriminator_learning_rate},
        venv=environments,
        gen_algo=generator,
        reward_net=BasicRewardNet(
            environments.observation_space, environments.action_space, hid_sizes=(workload.hidden,) * 2
        ),
        custom_logger=logger.configure(folder, []),  # no output: logging to files would be counted
        log_dir=folder,
    )


def timed_iteration(trainer: AIRL) -> Callable[[], dict[str, list[float]]]:
    """A function that does one round of `AIRL.train`; returns the [processor, wall] seconds of its parts."""
    watch = Stopwatch()
    generator: Any = trainer.gen_algo
    buffer = generator.rollout_buffer
    watch.watch(trainer, "train_disc", "discriminator")
    watch.watch(trainer, "_next_expert_batch", "expert_batches")
    watch.watch(trainer.venv_wrapped, "reward_fn", "relabel")
    watch.watch(buffer, "compute_returns_and_advantage", "advantages")

    # TRPO.train takes the whole batch for the policy first, then minibatches for the critic until it returns.
    get, train = buffer.get, generator.train
    critic_start: np.ndarray | None = None

    def watched_get(batch_size: int | None = None) -> Any:
        nonlocal critic_start
        if batch_size is not None and critic_start is None:
            critic_start = now()
        return get(batch_size)

    def watched_train() -> None:
        nonlocal critic_start
        critic_start = None
        start = now()
        train()
        end = now()
        assert critic_start is not None
        watch.add("trpo", critic_start - start)
        watch.add("critic", end - critic_start)

    buffer.get, generator.train = watched_get, watched_train

    def iterate() -> dict[str, list[float]]:
        start = now()
        trainer.train_gen(trainer.gen_train_timesteps)
        for _ in range(trainer.n_disc_updates_per_round):
            with networks.training(trainer.reward_train):
                trainer.train_disc()
        elapsed = now() - start
        parts = watch.take()
        total = sum((seconds for part, seconds in parts.items() if part != "expert_batches"), np.zeros(2))
        parts = {"total": total, **parts, "not_counted": elapsed - total}
        return {part: seconds.tolist() for part, seconds in parts.items()}

    return iterate


def main() -> None:
    warnings.filterwarnings("ignore")
    torch.set_num_threads(1)
    versions = {
        "python": platform.python_version(),
        "torch": torch.__version__,
        "numpy": np.__version__,
        "gymnasium": gymnasium.__version__,
        "stable-baselines3": stable_baselines3.__version__,
        "sb3-contrib": sb3_contrib.__version__,
        "imitation": imitation.__version__,
    }
    with tempfile.TemporaryDirectory() as folder:
        iterate = timed_iteration(make_trainer(Workload(**json.loads(sys.stdin.readline())), folder))
        print(json.dumps(versions), flush=True)
        for _ in sys.stdin:
            print(json.dumps(iterate()), flush=True)


if __name__ == "__main__":
    main()
