"""Judging a policy: its mean action over many episodes, beside the expert on the very same starts."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from vic_toolbox.errors import finite_number, integer, one_of
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.tasks import Task, VectorEnvironment

Act = Callable[[np.ndarray], np.ndarray]
"""A policy as a function: observations (n, n_o) → actions (n, n_a)."""

START_SEED = 1000
"""Seed of the evaluation's starts: every method and every run is judged on the same ones."""

START_NOISE = 1.0
"""Variation of the starts in an evaluation, in units of the task's usual one."""

_AT_ONCE = 64  # simulations side by side


@dataclass(frozen=True)
class Policy:
    """A policy to judge, and what the tables say about it."""

    act: Act
    """Its mean action."""
    method: str
    """airl, bc, expert, or the name of a constant baseline."""
    transfer: str = ""
    """How it was transferred, if it was."""
    seed: int = 0
    """Of its run."""

    @classmethod
    def expert(cls, task: Task) -> Policy:
        """The task's expert."""
        return cls(task.expert_action, "expert")

    @classmethod
    def constant(cls, task: Task, *, which: str = "constant") -> Policy:
        """One of the task's constant gains, by its name in ``task.constants``."""
        one_of("constant gain", which, task.constants)
        return cls(partial(task.constant_action, which=which), which)


def baselines(task: Task) -> dict[str, Policy]:
    """All constant gains of a task, by look."""
    return {which: Policy.constant(task, which=which) for which in task.constants}


@dataclass(frozen=True)
class Episodes:
    """Outcome of n episodes: task score, success, distance to the goal at the end [m], peak contact force
    [N]; (n,).
    """

    score: np.ndarray
    success: np.ndarray
    distance: np.ndarray
    peak_force: np.ndarray


@dataclass(frozen=True)
class Evaluation:
    """One row of a results table; what ``evaluation.json`` holds."""

    task: str
    """Name of the task."""
    scenario: str
    """Name of the scenario."""
    method: str
    """airl, bc, expert, or the name of a constant baseline."""
    transfer: str
    """Empty, or how the policy was optimised under a frozen reward: e.g. "learned reward, continued"."""
    action: str
    """gain or force."""
    history: int
    """Observations that the policy sees."""
    seed: int
    """Of the run."""
    start_seed: int
    """Of the starts."""
    episodes: int
    """Number of episodes."""
    success_rate: float
    """Share of episodes that succeeded."""
    success_low: float
    """Lower end of its 95 % interval."""
    success_high: float
    """Upper end of its 95 % interval."""
    score_mean: float
    """Mean score."""
    score_std: float
    """Standard deviation of the score over the episodes."""
    expert_score: float
    """The expert's mean score on the same starts."""
    expert_success_rate: float
    """The expert's share of successes."""
    relative_difference: float
    """``|score − expert's| / |expert's|``."""
    signed_difference: float
    """``(expert's − score) / |expert's|``: positive is worse than the expert."""
    peak_force_mean: float
    """Mean over the episodes of the largest contact force [N]."""

    def to_json(self) -> dict[str, Any]:
        """The fields as JSON values."""
        return asdict(self)


def run_episodes(
    task: Task,
    act: Act,
    *,
    episodes: int,
    seed: int = START_SEED,
    start_noise: float = START_NOISE,
    scenarios: Sequence[Any] | None = None,
    threads: int = 0,
) -> Episodes:
    """Run the policy once from each start.

    Parameters
    ----------
    task : Task
        What to do.
    act : callable
        Policy: observations (n, observation_size) → actions (n, action_size).
    episodes : int
        Number of starts.
    seed : int
        Draws the starts.
    start_noise : float
        Variation of the starts, in units of the task's usual one.
    scenarios : sequence, optional
        One for each episode; by default the task's.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.

    Raises
    ------
    InputError
        A number out of range, or a start that cannot be used.
    SimulationError
        A simulation diverged.
    """
    episodes = integer("episodes", episodes, low=1)
    integer("seed", seed, low=0)
    finite_number("start noise", start_noise, low=0.0)
    parts = [
        _run(task, act, range(first, min(first + _AT_ONCE, episodes)), seed, start_noise, scenarios, threads)
        for first in range(0, episodes, _AT_ONCE)
    ]
    columns = ("score", "success", "distance", "peak_force")
    return Episodes(*(np.concatenate([part[name] for part in parts]) for name in columns))


def _run(
    task: Task,
    act: Act,
    which: range,
    seed: int,
    start_noise: float,
    scenarios: Sequence[Any] | None,
    threads: int,
) -> dict[str, np.ndarray]:
    environment = VectorEnvironment(task, len(which), threads=threads)
    options: dict[str, Any] = {"start_noise": start_noise}
    if scenarios is not None:
        options["scenarios"] = scenarios[which.start : which.stop]
    observations, info = environment.reset(seed=seed + which.start, options=options)
    for _ in range(task.horizon):
        observations, _, _, _, info = environment.step(act(observations))
    return info


def judge(
    task: Task,
    policies: Mapping[str, Policy],
    *,
    episodes: int = 20,
    seed: int = START_SEED,
    threads: int = 0,
) -> dict[str, Evaluation]:
    """Evaluate several policies on the task's scenario, all of them and the expert on the same starts.

    Parameters
    ----------
    task : Task
        Task with the scenario to judge on.
    policies : dict of Policy
        What to judge, by any name.
    episodes, seed, threads : int
        See :func:`run_episodes`.
    """
    run = partial(run_episodes, task, episodes=episodes, seed=seed, threads=threads)
    expert = run(task.expert_action)
    rows = {}
    for name, policy in policies.items():
        own = expert if policy.method == "expert" else run(policy.act)
        rows[name] = _row(task, policy, own, expert, seed)
    return rows


def evaluate(
    task: Task, policy: Policy, *, episodes: int = 20, seed: int = START_SEED, threads: int = 0
) -> Evaluation:
    """Evaluate one policy; see :func:`judge`."""
    return judge(task, {"": policy}, episodes=episodes, seed=seed, threads=threads)[""]


def _row(task: Task, policy: Policy, own: Episodes, expert: Episodes, seed: int) -> Evaluation:
    score, expert_score = float(own.score.mean()), float(expert.score.mean())
    success = float(own.success.mean())
    low, high = wilson_interval(success, len(own.success))
    signed = (expert_score - score) / abs(expert_score)
    return Evaluation(
        task=task.name,
        scenario=task.scenario.name,
        method=policy.method,
        transfer=policy.transfer,
        action=task.action,
        history=task.history,
        seed=policy.seed,
        start_seed=seed,
        episodes=len(own.score),
        success_rate=success,
        success_low=low,
        success_high=high,
        score_mean=score,
        score_std=float(own.score.std()),
        expert_score=expert_score,
        expert_success_rate=float(expert.success.mean()),
        relative_difference=abs(signed),
        signed_difference=signed,
        peak_force_mean=float(own.peak_force.mean()),
    )
