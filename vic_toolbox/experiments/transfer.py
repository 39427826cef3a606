"""Carry a skill over: optimise a policy on another scenario under the reward that was learned, frozen."""

from __future__ import annotations

import math
import os
from dataclasses import replace

from vic_toolbox import tasks
from vic_toolbox.errors import InputError, one_of
from vic_toolbox.experiments.configuration import REWARDS, TransferRunConfiguration, to_json
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.loop import one_thread, run_to_end
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.results import read_evaluation
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.run_report import judge_run, report_run
from vic_toolbox.experiments.skill import Skill, fingerprint, load_skill
from vic_toolbox.experiments.training import mean_score
from vic_toolbox.learning import RewardNetwork, Transfer, TransferConfiguration, save_policy, save_reward
from vic_toolbox.learning.policy_search import random_stream


def transfer(
    source: str | os.PathLike[str],
    scenario: str,
    out: str | os.PathLike[str],
    *,
    fresh: bool = False,
    reward: str = "learned",
    seed: int = 0,
    settings: TransferConfiguration | None = None,
    episodes: int = 20,
    resume: bool = False,
    threads: int = 0,
    seconds: float = math.inf,
    progress: Progress | None = None,
    report: bool = True,
) -> Evaluation:
    """Optimise a policy under the frozen reward of a run, on another scenario, and write a run folder of its
    own.

    Parameters
    ----------
    source : str or PathLike
        Folder of the finished run.
    scenario : str
        A name, or text that the task's ``as_scenario`` reads.
    out : str or PathLike
        The new run's folder.
    fresh : bool
        Begin with random weights instead of the run's policy: the test of the reward itself.
    reward : str
        "learned", or "random" for an untrained network, the control.
    seed : int
        Draws fresh weights, exploration and minibatches.
    settings : TransferConfiguration, optional
        Hyper-parameters; by default those of the source's recipe.
    episodes : int
        Episodes of the evaluation at the end.
    resume, threads, seconds, progress, report
        As for :func:`~vic_toolbox.experiments.training.train`.

    Raises
    ------
    InputError, FileError
        Bad run, scenario or folder.
    KeyboardInterrupt
        Ctrl-C; `resume` goes on from there.
    """
    progress = progress or Progress()
    skill = load_skill(source)
    frozen = _reward(skill, reward, seed)
    task = skill.task(skill.task(scenario).scenario.name)  # the scenario as config.json can hold it
    run = TransferRunConfiguration(
        source=skill.run,
        source_weights=fingerprint(skill),
        scenario=task.scenario.name,
        transfer=replace(settings or skill.run.recipe.transfer, fresh=fresh),
        reward=one_of("reward", reward, REWARDS),  # type: ignore[arg-type]
        seed=seed,
        episodes=episodes,
    )
    with RunFolder.create(out, "transfer", to_json(run), resume=resume) as folder, one_thread():
        if folder.complete:
            progress.say(f"{folder.path} is complete already.")
            return read_evaluation(folder, run.scenario)
        environment = tasks.VectorEnvironment(task, run.transfer.search.environments, threads=threads)
        learner = Transfer(environment, frozen, skill.policy, configuration=run.transfer, seed=seed)
        progress.stage(
            f"transfer to {run.scenario}",
            run.transfer.iterations,
            expert_score=mean_score(task, task.expert_action),
        )
        run_to_end(
            learner,
            folder,
            progress=progress,
            mean_score=lambda: mean_score(task, learner.search.averaged_policy().mean),
            seconds=seconds,
        )
        save_reward(folder.path / "reward.safetensors", frozen)
        save_policy(folder.path / "policy.safetensors", learner.result())
        progress.stage("evaluation and report" if report else "evaluation")
        moved = load_skill(folder.path)
        if not report:
            return judge_run(moved, threads=threads)
        return report_run(moved, before=None if fresh else skill, threads=threads)


def _reward(skill: Skill, kind: str, seed: int) -> RewardNetwork:
    task = skill.task()
    if kind == "random":
        weights = int(random_stream(seed, 7).integers(2**31))
        return RewardNetwork.for_task(task, seed=weights)
    if skill.reward is None:
        raise InputError(
            f"{skill.folder.path} ({skill.run.method}) has learned no reward; pass an AIRL run, or use the "
            "control, --reward random."
        )
    return skill.reward
