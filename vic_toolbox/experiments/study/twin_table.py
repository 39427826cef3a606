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
from vic_toolbox.experiments.study.learners import Learner
from vic_toolbox.experiments.study.plan import Draft, Role

NO_TRANSFER = ", no transfer"
"""Ending of the row of a policy that was not carried over."""
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

    def deploy(self, draft: Draft, policy: str, start: str, *, transferred: bool) -> str:
        """A cell that runs the policy of a cell on the twin."""
        return deploy_cell(
            draft,
            self.study,
            self.task,
            {"cell": policy},
            stem=f"{self.stem}{'-transferred' if transferred else ''}",
            start=start,
            seed=self.seed,
            action=self.action,
            history=self.history,
        )


def twin_table(draft: Draft, study: Study, table: Table) -> None:
    """Add the cells of a table of deviations. At a new start, AIRL's policies are first carried over in simulation."""
    for learner in twin_learners(study, table):
        words = f", {learner.fit} fit" if learner.beside else ""
        role: Role = "control" if learner.beside else "method"
        for start in table.scenarios:
            moved = learner.method == "airl" and start != "train"
            policy = learner.transfer(draft, start) if moved else learner.train(draft)
            cell = learner.deploy(draft, policy, start, transferred=moved)
            learner.entry(draft, table, start, cell, row=f"{learner.row}{words}", role=role)
            if moved and "no-transfer" in table.controls:
                cell = learner.deploy(draft, learner.train(draft), start, transferred=False)
                row = f"{learner.row}{words}{NO_TRANSFER}"
                learner.entry(draft, table, start, cell, row=row, role="control")
    if "constant" in table.methods:
        _baseline(draft, study, table, "constant", row="Constant gain", role="method")
    for control in table.controls:
        if control in _BASELINES:
            _baseline(draft, study, table, control, row=_BASELINES[control], role="control")


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


def _baseline(draft: Draft, study: Study, table: Table, which: str, *, row: str, role: Role) -> None:
    for seed in study.seeds:
        for start in table.scenarios:
            cell = deploy_cell(
                draft,
                study,
                table.task,
                {"baseline": which},
                stem=f"{which}-seed{seed}",
                start=start,
                seed=seed,
            )
            draft.entry(
                table=table.name,
                row=row,
                role=role,
                method=which,
                action="gain",
                history=1,
                scenario=start,
                seed=seed,
                cell=cell,
            )
