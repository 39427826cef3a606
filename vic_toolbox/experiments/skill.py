"""A finished policy, read back from the folder of its run."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.configuration import RunConfiguration, TransferRunConfiguration, from_json
from vic_toolbox.experiments.evaluation import Policy
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.learning import GaussianPolicy, RewardNetwork, load_policy, load_reward


@dataclass(frozen=True)
class Skill:
    """A policy with what is known about its origin.

    Attributes
    ----------
    folder : RunFolder
        Folder of its run.
    run : RunConfiguration
        Configuration of the training run.
    transfer : TransferRunConfiguration
        Configuration of the transfer run, if it is from one.
    policy : GaussianPolicy
        The policy.
    reward : RewardNetwork
        The learned (or frozen) reward, if there is one.
    """

    folder: RunFolder
    run: RunConfiguration
    transfer: TransferRunConfiguration | None
    policy: GaussianPolicy
    reward: RewardNetwork | None

    @property
    def seed(self) -> int:
        """Seed of the run."""
        return self.transfer.seed if self.transfer else self.run.seed

    @property
    def origin(self) -> str:
        """Empty for a training run; else how it was transferred."""
        return transfer_label(self.transfer) if self.transfer else ""

    @property
    def look(self) -> str:
        """Name under which figures draw it."""
        if self.transfer is None:
            return self.run.method
        return "transfer" if self.transfer.reward == "learned" else "random"

    def task(self, scenario: Any = None) -> tasks.Task:
        """The skill's task on a scenario, or on its name or text; by default on the one of its run."""
        if scenario is None:
            scenario = self.transfer.scenario if self.transfer else "train"
        return make_task(self.run, scenario)

    @property
    def judged(self) -> Policy:
        """The mean action, labelled for tables."""
        return Policy(self.policy.mean, self.run.method, transfer=self.origin, seed=self.seed)


def transfer_label(transfer: TransferRunConfiguration) -> str:
    """How a policy was transferred, for tables."""
    start = "from random weights" if transfer.transfer.fresh else "continued"
    return f"{transfer.reward} reward, {start}"


def make_task(run: RunConfiguration, scenario: Any) -> tasks.Task:
    """The task of a run on a scenario.

    Raises
    ------
    InputError
        Unknown scenario, or one that the task cannot begin with.
    """
    return tasks.make(run.task, action=run.action, history=run.history, scenario=scenario)


def side_by_side(skills: Sequence[Skill]) -> tuple[tasks.Task, dict[str, Policy]]:
    """Several skills to be judged together: their task, and their policies by look.

    Of two of a kind the later ones go by the names of their folders.

    Raises
    ------
    InputError
        The runs are not of the same task, action space and history.
    """
    policies: dict[str, Policy] = {}
    task = skills[0].task("train")
    for skill in skills:
        other = skill.task("train")
        if (other.name, other.action, other.history) != (task.name, task.action, task.history):
            raise InputError(
                f"{skill.folder.path} is of {other.name}, action {other.action}, history {other.history}; "
                f"the first run is of {task.name}, action {task.action}, history {task.history}. Sweep each alone."
            )
        name = skill.look if skill.look not in policies else skill.folder.path.name
        policies[name] = skill.judged
    return task, policies


def load_skill(path: str | os.PathLike[str]) -> Skill:
    """Read a finished run.

    Raises
    ------
    FileError
        No run there, an unfinished one, or a damaged or unfitting file; the file is named.
    """
    folder = RunFolder.open(path)
    where = str(folder.path / "config.json")
    transfer = None
    if folder.kind == "transfer":
        transfer = from_json(TransferRunConfiguration, folder.configuration, where=where)
        run = transfer.source
    elif folder.kind == "training":
        run = from_json(RunConfiguration, folder.configuration, where=where)
    else:
        raise FileError(f"{folder.path} is a run of kind {folder.kind!r}; pass a training or transfer run.")
    if not (folder.path / "policy.safetensors").exists():
        raise FileError(f"{folder.path} has no policy yet; finish the run with --resume.")
    policy = load_policy(folder.path / "policy.safetensors")
    reward_path = folder.path / "reward.safetensors"
    reward = load_reward(reward_path) if reward_path.exists() else None
    skill = Skill(folder, run, transfer, policy, reward)
    _check_fit(skill)
    return skill


def _check_fit(skill: Skill) -> None:
    task = make_task(skill.run, "train")
    sizes = (len(skill.policy.observation_scale), skill.policy.action_size)
    if sizes != (task.observation_size, task.action_size):
        raise FileError(
            f"{skill.folder.path / 'policy.safetensors'} maps {sizes[0]} observations to {sizes[1]} actions; "
            f"the run's task has {task.observation_size} and {task.action_size}. The file is from another "
            "run."
        )
    rewarded = task.observation_size // task.history + task.action_size
    if skill.reward is not None and skill.reward.network.sizes[0] != rewarded:
        raise FileError(
            f"{skill.folder.path / 'reward.safetensors'} takes {skill.reward.network.sizes[0]} inputs; the "
            f"run's task has {rewarded}. The file is from another run."
        )


def fingerprint(skill: Skill) -> str:
    """Short digest of the skill's weights."""
    parts = [skill.policy.theta] + ([skill.reward.theta] if skill.reward is not None else [])
    return hashlib.sha256(b"".join(part.numpy().tobytes() for part in parts)).hexdigest()[:16]
