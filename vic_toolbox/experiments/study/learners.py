"""Learned policies of a study, and the cells that each of them needs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

from vic_toolbox.experiments.configuration import (
    DemonstrationConfiguration,
    RunConfiguration,
    default_configuration,
    to_json,
)
from vic_toolbox.experiments.study.definition import Budget, Study, Table
from vic_toolbox.experiments.study.plan import Draft, row_name
from vic_toolbox.learning import Recipe, TransferConfiguration

CARRIED: Mapping[str, tuple[str, str, bool]] = MappingProxyType({
    "no-transfer": ("no transfer", "", False),
    "random": ("random reward", "random", False),
    "fresh": ("fresh policy", "learned", True),
    "fresh-random": ("fresh policy, random reward", "random", True),
})  # fmt: skip
"""Control of an AIRL policy → its words in the row, the reward, and whether it begins with random weights."""


@dataclass(frozen=True)
class Learner:
    """A method in an action space, with a history and a seed: one training run and what follows from it."""

    study: Study
    task: str
    method: str
    action: str
    history: int
    seed: int

    @property
    def row(self) -> str:
        """Name of its row."""
        return row_name(self.method, self.action, self.history)

    @property
    def stem(self) -> str:
        """What its cells are called by."""
        return f"{self.row.lower()}-seed{self.seed}"

    @property
    def budget(self) -> Budget:
        """What it may spend."""
        return self.study.budget_of(self.task)

    def configuration(self) -> RunConfiguration:
        """Of its training run."""
        budget = self.budget
        run = default_configuration(
            self.task,
            self.method,
            action=self.action,
            history=self.history,
            seed=self.seed,
            episodes=budget.episodes,
            demonstrations=DemonstrationConfiguration.for_task(
                self.task, count=budget.demonstrations, held_out=budget.held_out
            ),
        )
        return replace(run, recipe=within(run.recipe, budget))

    def train(self, draft: Draft) -> str:
        """Its training cell."""
        return draft.cell("train", f"{self.task}/train/{self.stem}", to_json(self.configuration()))

    def transfer(self, draft: Draft, scenario: str, *, reward: str = "learned", fresh: bool = False) -> str:
        """A cell that carries the trained policy over, or trains a new one under its reward."""
        settings = transfer_settings(self.configuration().recipe.transfer, self.budget, fresh=fresh)
        kind = f"{reward}{'-fresh' if fresh else ''}"
        return draft.cell(
            "transfer",
            f"{self.task}/transfer/{self.stem}/{scenario}/{kind}",
            {
                "scenario": scenario,
                "reward": reward,
                "fresh": fresh,
                "seed": self.seed,
                "episodes": self.budget.episodes,
                "transfer": asdict(settings),
            },
            needs=(self.train(draft),),
        )

    def judge(self, draft: Draft, scenario: str) -> str:
        """A cell that judges the trained policy where it is, without transfer."""
        return judge_cell(
            draft,
            self.study,
            self.task,
            {"cell": self.train(draft)},
            stem=self.stem,
            action=self.action,
            history=self.history,
            scenario=scenario,
        )

    def entry(self, draft: Draft, table: Table, scenario: str, cell: str, **changes: Any) -> None:
        """Add an entry to one of its rows."""
        fields = {
            "table": table.name,
            "row": self.row,
            "role": "method",
            "method": self.method,
            "action": self.action,
            "history": self.history,
            "scenario": scenario,
            "seed": self.seed,
            "cell": cell,
        }
        draft.entry(**(fields | changes))


def learners(study: Study, table: Table) -> Iterator[Learner]:
    """Every learned policy of a table, row by row."""
    for history in table.histories:
        for action in table.actions:
            for method in table.methods:
                if method != "constant":
                    for seed in study.seeds:
                        yield Learner(study, table.task, method, action, history, seed)


def within(recipe: Recipe, budget: Budget) -> Recipe:
    """The recipe with the numbers of the budget, where it gives them."""
    airl, carried, cloning = recipe.airl, recipe.transfer, recipe.cloning
    if budget.environments is not None:
        airl = replace(airl, search=replace(airl.search, environments=budget.environments))
        carried = replace(carried, search=replace(carried.search, environments=budget.environments))
    if budget.iterations is not None:
        airl = replace(airl, iterations=budget.iterations)
    if budget.transfer_iterations is not None:
        carried = replace(carried, iterations=budget.transfer_iterations)
    if budget.cloning_steps is not None:
        cloning = replace(cloning, steps=budget.cloning_steps)
    return replace(recipe, airl=airl, transfer=carried, cloning=cloning)


def transfer_settings(
    settings: TransferConfiguration, budget: Budget, *, fresh: bool
) -> TransferConfiguration:
    """Those of a transfer that continues or that begins with random weights."""
    if fresh and budget.fresh_iterations is not None:
        settings = replace(settings, iterations=budget.fresh_iterations)
    if fresh and budget.fresh_divergence is not None:
        settings = replace(settings, divergence=budget.fresh_divergence)
    return replace(settings, fresh=fresh)


def judge_cell(
    draft: Draft,
    study: Study,
    task: str,
    policy: Mapping[str, Any],
    *,
    stem: str,
    scenario: str,
    action: str = "gain",
    history: int = 1,
    time_step: float = 1.0,
) -> str:
    """A cell that judges a policy on a scenario; see :mod:`~vic_toolbox.experiments.study.judging`."""
    suffix = "" if time_step == 1.0 else f"-step={time_step:g}"
    return draft.cell(
        "judge",
        f"{task}/judge/{stem}/{scenario}{suffix}",
        {
            "policy": policy,
            "task": task,
            "action": action,
            "history": history,
            "scenario": scenario,
            "episodes": study.budget_of(task).episodes,
            "time_step": time_step,
        },
        needs=(policy["cell"],) if "cell" in policy else (),
    )
