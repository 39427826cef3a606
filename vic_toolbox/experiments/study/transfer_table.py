"""Tables over the scenarios of a task: which cells they need, their controls and artefact checks among them."""

from __future__ import annotations

from vic_toolbox.experiments.study.definition import Study, Table
from vic_toolbox.experiments.study.learners import CARRIED, Learner, judge_cell, learners
from vic_toolbox.experiments.study.plan import Draft, Role, untrained_row


def transfer_table(draft: Draft, study: Study, table: Table) -> None:
    """Cells of a table over scenarios: AIRL policies are carried over by their frozen rewards, others stay."""
    for learner in learners(study, table):
        for scenario in table.scenarios:
            policy = learner.train(draft)
            if scenario != "train" and learner.method == "airl":
                policy = learner.transfer(draft, scenario)
            settled = scenario == "train" or learner.method == "airl"  # judged where it was made
            cell = policy if settled else learner.judge(draft, scenario)
            learner.entry(draft, table, scenario, cell)
            if scenario in table.halved_step:
                _halved(draft, learner, table, scenario, policy)
    if "constant" in table.methods:
        _baseline(draft, study, table, "constant", role="method")
    _controls(draft, study, table)
    for quantity in table.sweeps:
        _sweep(draft, study, table, quantity)


def _halved(draft: Draft, learner: Learner, table: Table, scenario: str, policy: str) -> None:
    judged = judge_cell(
        draft,
        learner.study,
        learner.task,
        {"cell": policy},
        stem=learner.stem,
        action=learner.action,
        history=learner.history,
        scenario=scenario,
        time_step=0.5,
    )
    learner.entry(draft, table, scenario, judged, row=f"{learner.row}, half the time step", role="check")


def _controls(draft: Draft, study: Study, table: Table) -> None:
    unseen = [scenario for scenario in table.scenarios if scenario != "train"]
    for learner in learners(study, table):
        if learner.method == "airl":
            for control in table.controls:
                if control not in CARRIED or (CARRIED[control][2] and not _may_be_fresh(learner)):
                    continue
                words, reward, fresh = CARRIED[control]
                for scenario in unseen:
                    if control == "no-transfer":
                        cell = learner.judge(draft, scenario)
                    else:
                        cell = learner.transfer(draft, scenario, reward=reward, fresh=fresh)
                    row = f"{learner.row}, {words}"
                    learner.entry(draft, table, scenario, cell, row=row, role="control")
    if "untrained" in table.controls:
        _untrained(draft, study, table)
    for which in ("expert", "middle", "matched"):
        if which in table.controls:
            _baseline(draft, study, table, which, role="control")


def _may_be_fresh(learner: Learner) -> bool:
    return learner.action == "gain" and learner.history == 1


def _untrained(draft: Draft, study: Study, table: Table) -> None:
    """Policies with random weights, acting with their exploration noise: what dither alone does."""
    for action in table.actions:
        for seed in study.seeds:
            for scenario in table.scenarios:
                cell = judge_cell(
                    draft,
                    study,
                    table.task,
                    {"untrained": seed},
                    stem=f"{action}-untrained-seed{seed}",
                    action=action,
                    scenario=scenario,
                )
                draft.entry(
                    table=table.name,
                    row=untrained_row(action),
                    role="control",
                    method="untrained",
                    action=action,
                    history=1,
                    scenario=scenario,
                    seed=seed,
                    cell=cell,
                )


def _baseline(draft: Draft, study: Study, table: Table, which: str, *, role: Role) -> None:
    """The expert or a constant gain, with which nothing is left to chance but the starts."""
    row = "Expert" if which == "expert" else f"{which.capitalize()} gain"
    steps = [(scenario, 1.0) for scenario in table.scenarios]
    if role == "method":
        steps += [(scenario, 0.5) for scenario in table.halved_step]
    for scenario, time_step in steps:
        halved = time_step != 1.0
        draft.entry(
            table=table.name,
            row=f"{row}, half the time step" if halved else row,
            role="check" if halved else role,
            method=which,
            action="gain",
            history=1,
            scenario=scenario,
            seed=None,
            cell=judge_cell(
                draft,
                study,
                table.task,
                {"baseline": which},
                stem=which,
                scenario=scenario,
                time_step=time_step,
            ),
        )


def _sweep(draft: Draft, study: Study, table: Table, quantity: str) -> None:
    """Cells of the trained policies along a quantity, and one of the expert and the constant gains."""
    history = min(table.histories)
    trained: dict[tuple[str, int | None], dict[str, str]] = {("gain", None): {}}
    for learner in learners(study, table):
        if learner.history == history:
            group = trained.setdefault((learner.action, learner.seed), {})
            group[learner.method] = learner.train(draft)
    for (action, seed), policies in trained.items():
        stem = "baselines" if seed is None else f"{action}-seed{seed}"
        settings = {
            "task": table.task,
            "action": action,
            "history": history if policies else 1,
            "quantity": quantity,
            "policies": policies,
            "episodes": study.budget_of(table.task).sweep_episodes,
        }
        cell = draft.cell(
            "sweep", f"{table.task}/sweep/{quantity}/{stem}", settings, needs=tuple(policies.values())
        )
        draft.entry(
            table=table.name,
            row=quantity,
            role="sweep",
            method="",
            action=action,
            history=history,
            scenario="",
            seed=seed,
            cell=cell,
        )
