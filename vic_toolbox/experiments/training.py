"""Train a policy from the expert's demonstrations: AIRL, behaviour cloning, or a constant gain as the
baseline.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass

import torch

from vic_toolbox import tasks
from vic_toolbox.experiments.configuration import DemonstrationConfiguration, RunConfiguration, to_json
from vic_toolbox.experiments.evaluation import Act, Evaluation, run_episodes
from vic_toolbox.experiments.given_demonstrations import COPY, given_demonstrations
from vic_toolbox.experiments.loop import one_thread, run_to_end
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.results import read_evaluation
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.run_report import judge_run, report_run
from vic_toolbox.experiments.skill import load_skill, make_task
from vic_toolbox.learning import Airl, ExpertData, GaussianPolicy, clone, save_policy, save_reward
from vic_toolbox.learning.policy_search import random_stream

LOOKS = 4
"""Episodes behind the score that is shown while a policy learns."""


@dataclass(frozen=True)
class Workshop:
    """What every method works with."""

    run: RunConfiguration
    folder: RunFolder
    task: tasks.Task
    threads: int
    seconds: float
    progress: Progress
    given: tasks.Demonstrations | None = None
    """Demonstrations from a file, until the folder has its copy."""

    def policy(self) -> GaussianPolicy:
        """An untrained policy."""
        return untrained_policy(self.run, self.task)

    def expert(self) -> ExpertData:
        """The expert's demonstrations as rows for learning."""
        self.progress.stage("demonstrations of the expert")
        held_out = self.run.demonstrations.held_out
        return ExpertData.from_demonstrations(
            self._demonstrations(),
            self.task,
            policy=self.policy(),
            held_out=held_out,
            stratified=self.run.recipe.stratified,
        )

    def _demonstrations(self) -> tasks.Demonstrations:
        """What the expert did; kept in the folder, so that a run taken up again learns from the same."""
        path, wanted = self.folder.path / COPY, self.run.demonstrations
        if path.exists():
            return tasks.Demonstrations.load(path)
        if isinstance(wanted, DemonstrationConfiguration):
            recorded = tasks.record(
                self.task,
                wanted.count + wanted.held_out,
                seed=self.run.seed,
                push=wanted.push,
                start_noise=wanted.start_noise,
                threads=self.threads,
            )
        else:
            assert self.given is not None  # given_demonstrations saw to it
            recorded = self.given
        recorded.save(path)
        return recorded


def train(
    run: RunConfiguration,
    out: str | os.PathLike[str],
    *,
    resume: bool = False,
    threads: int = 0,
    seconds: float = math.inf,
    progress: Progress | None = None,
    report: bool = True,
    demonstrations: str | os.PathLike[str] | None = None,
) -> Evaluation:
    """Train, judge on the training scenario, and write the run's folder with its report.

    The same configuration gives the same numbers, whatever the number of threads, and whether the run was
    stopped and taken up again (after Ctrl-C or a kill) or not.

    Parameters
    ----------
    run : RunConfiguration
        What to train.
    out : str or PathLike
        The run's folder (see :mod:`~vic_toolbox.experiments.run_folder`).
    resume : bool
        Take up the run in `out`, if there is one.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.
    seconds : float
        Stop AIRL early once so much time is used up [s]; then the numbers depend on the machine.
    progress : Progress, optional
        Told how it goes; by default nobody.
    report : bool
        Draw the figures and write the report; without them, as in a study of many runs, the run ends with its
        evaluation, and a later call with `report` makes up for it.
    demonstrations : str or PathLike, optional
        The file to learn from, where the configuration says so
        (:class:`~vic_toolbox.experiments.configuration.RecordedDemonstrations`). The run's folder keeps a copy.

    Raises
    ------
    InputError, FileError
        Bad configuration, folder or demonstrations.
    KeyboardInterrupt
        Ctrl-C; `resume` goes on from there.
    """
    progress = progress or Progress()
    task = make_task(run, "train")
    given = given_demonstrations(run, out, demonstrations)
    with RunFolder.create(out, "training", to_json(run), resume=resume) as folder, one_thread():
        if folder.complete:
            progress.say(f"{folder.path} is complete already.")
            return read_evaluation(folder, task.scenario.name)
        workshop = Workshop(run, folder, task, threads, seconds, progress, given)
        policy = _METHODS[run.method](workshop)
        save_policy(folder.path / "policy.safetensors", policy)
        progress.stage("evaluation and report" if report else "evaluation")
        return (report_run if report else judge_run)(load_skill(folder.path), threads=threads)


def _train_airl(shop: Workshop) -> GaussianPolicy:
    settings = shop.run.recipe.airl
    environment = tasks.VectorEnvironment(shop.task, settings.search.environments, threads=shop.threads)
    learner = Airl(environment, shop.expert(), configuration=settings, seed=shop.run.seed)
    shop.progress.stage(
        "imitation (AIRL)", settings.iterations, expert_score=mean_score(shop.task, shop.task.expert_action)
    )
    run_to_end(
        learner,
        shop.folder,
        progress=shop.progress,
        mean_score=lambda: mean_score(shop.task, learner.search.averaged_policy().mean),
        seconds=shop.seconds,
    )
    policy, reward = learner.result()
    save_reward(shop.folder.path / "reward.safetensors", reward)
    return policy


def _train_bc(shop: Workshop) -> GaussianPolicy:
    settings = shop.run.recipe.cloning
    policy, expert = shop.policy(), shop.expert()
    shop.folder.load_checkpoint()  # cloning takes seconds and starts over: drop the metrics of a killed run
    shop.progress.stage("cloning (BC)", settings.steps)

    def note(metrics: dict[str, float]) -> None:
        shop.folder.append_metrics(metrics)
        shop.progress.update(int(metrics["iteration"]))

    rng = random_stream(shop.run.seed, 6)
    clone(policy, expert, configuration=settings, rng=rng, progress=note)
    return policy


def _constant(shop: Workshop) -> GaussianPolicy:
    """The task's constant gain: a network of zeros, whose output bias is the action."""
    policy = shop.policy()
    policy.theta.zero_()
    policy.network.layers[-1][1].copy_(torch.from_numpy(shop.task.constant_action()))
    return policy


_METHODS: dict[str, Callable[[Workshop], GaussianPolicy]] = {
    "airl": _train_airl,
    "bc": _train_bc,
    "constant": _constant,
}


def untrained_policy(run: RunConfiguration, task: tasks.Task) -> GaussianPolicy:
    """The policy that learning begins with: random weights, drawn by the run's seed."""
    search = run.recipe.airl.search
    seed = int(random_stream(run.seed, 5).integers(2**31))
    return GaussianPolicy.for_task(task, hidden=search.hidden, log_std=search.log_std, seed=seed)


def mean_score(task: tasks.Task, act: Act) -> float:
    """Mean score of a few episodes, to watch the learning; nothing is decided by it."""
    return float(run_episodes(task, act, episodes=LOOKS, threads=1).score.mean())
