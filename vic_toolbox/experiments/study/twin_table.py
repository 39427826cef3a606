"""Cells and entries of tables on the digital twin: a human is recorded, policies learn from it, and go back to it.

For each seed one robot and one session. Everything is learned in the nominal simulation; on the twin nothing is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from vic_toolbox.experiments.configuration import to_json
from vic_toolbox.experiments.guided import WRENCH
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.experiments.study.definition import Study, Table
from vic_toolbox.experiments.study.learners import CARRIED, Learner
from vic_toolbox.experiments.study.plan import Draft, Role, untrained_row

_BASELINES: Mapping[str, str] = {"human": "Human again", "true-gains": "True gains, replayed"}
"""Control → its row."""


@dataclass(frozen=True)
class TwinLearner(Learner):
    """A method that learns from a session on the twin."""

    session: SessionSettings
    fit: str
    """Which labels of the session's motions it learns from."""

    @property
    def beside(self) -> bool:
        """Whether it learns from another fit than the table's first one."""
        return self.fit not in (self.session.fits[0], WRENCH)

    @property
    def stem(self) -> str:
        """What its cells are called by."""
        return f"twin-{self.row.lower()}-{self.fit}-seed{self.seed}"

    def train(self, draft: Draft) -> str:
        """Its training cell, in the nominal simulation."""
        source = session_cell(draft, self.task, self.session, self.seed)
        settings = to_json(self.configuration()) | {
            "demonstrations": {"cell": source, "file": f"{self.fit}.npz"}
        }
        return draft.cell("train", f"{self.task}/train/{self.stem}", settings, needs=(source,))

    def deploy(self, draft: Draft, policy: str, start: str, *, carried: str = "") -> str:
        """A cell that runs the policy of a cell on the twin; ``carried`` says in its name how it was carried over."""
        return deploy_cell(
            draft,
            self.study,
            self.task,
            {"cell": policy},
            stem=f"{self.stem}{carried}",
            start=start,
            seed=self.seed,
            action=self.action,
            history=self.history,
        )


def twin_table(draft: Draft, study: Study, table: Table) -> None:
    """Add the cells of a table of deviations. At a new start, AIRL's policies are first carried over in simulation."""
    for learner in twin_learners(study, table):
        row = f"{learner.row}, {learner.fit} fit" if learner.beside else learner.row
        role: Role = "control" if learner.beside else "method"
        for start in table.scenarios:
            moved = learner.method == "airl" and start != "train"
            if moved:
                cell = learner.deploy(draft, learner.transfer(draft, start), start, carried="-transferred")
            else:
                cell = learner.deploy(draft, learner.train(draft), start)
            learner.entry(draft, table, start, cell, row=row, role=role)
            if moved:
                _controls(draft, learner, table, start, row=row)
    if "constant" in table.methods:
        _unlearned(draft, study, table, "constant", row="Constant gain", role="method")
    if "untrained" in table.controls:
        for action in table.actions:
            row = untrained_row(action)
            _unlearned(draft, study, table, "untrained", row=row, role="control", action=action)
    for control in table.controls:
        if control in _BASELINES:
            _unlearned(draft, study, table, control, row=_BASELINES[control], role="control")


def _controls(draft: Draft, learner: TwinLearner, table: Table, start: str, *, row: str) -> None:
    """The policy at a new start without transfer, or carried over by another reward."""
    for control in table.controls:
        if control in CARRIED:
            words, reward, fresh = CARRIED[control]
            if control == "no-transfer":
                cell = learner.deploy(draft, learner.train(draft), start)
            else:
                policy = learner.transfer(draft, start, reward=reward, fresh=fresh)
                cell = learner.deploy(draft, policy, start, carried=f"-{control}")
            learner.entry(draft, table, start, cell, row=f"{row}, {words}", role="control")


def twin_learners(study: Study, table: Table) -> Iterator[TwinLearner]:
    """Every learned policy of a table, row by row: gains from each fit, wrenches from the sensor."""
    assert table.session is not None  # the definition saw to it
    for history in table.histories:
        for action in table.actions:
            for fit in table.session.fits if action == "gain" else (WRENCH,):
                for method in table.methods:
                    for seed in study.seeds if method != "constant" else ():
                        yield TwinLearner(
                            study, table.task, method, action, history, seed, table.session, fit
                        )


def session_cell(draft: Draft, task: str, session: SessionSettings, seed: int) -> str:
    """The cell that records a seed's session."""
    return draft.cell("session", f"{task}/session/seed{seed}", {"session": asdict(session), "seed": seed})


def deploy_cell(
    draft: Draft,
    study: Study,
    task: str,
    policy: Mapping[str, Any],
    *,
    stem: str,
    start: str,
    seed: int,
    action: str = "gain",
    history: int = 1,
) -> str:
    """A cell that runs a policy on a seed's twin; see :mod:`~vic_toolbox.experiments.study.deploy`."""
    settings = {
        "policy": policy,
        "action": action,
        "history": history,
        "robot": seed,
        "start": start,
        "episodes": study.budget_of(task).episodes,
        "seed": seed,
    }
    needs = (policy["cell"],) if "cell" in policy else ()
    return draft.cell("deploy", f"{task}/deploy/{stem}/{start}", settings, needs=needs)


def _unlearned(
    draft: Draft, study: Study, table: Table, which: str, *, row: str, role: Role, action: str = "gain"
) -> None:
    """A baseline on the robot of each seed, or the seed's policy with random weights."""
    random = which == "untrained"
    for seed in study.seeds:
        for start in table.scenarios:
            cell = deploy_cell(
                draft,
                study,
                table.task,
                {"untrained": seed} if random else {"baseline": which},
                stem=f"{action}-{which}-seed{seed}" if random else f"{which}-seed{seed}",
                start=start,
                seed=seed,
                action=action,
            )
            draft.entry(
                table=table.name,
                row=row,
                role=role,
                method=which,
                action=action,
                history=1,
                scenario=start,
                seed=seed,
                cell=cell,
            )
