"""Judging and reporting one run: the policy beside the expert and the constant gain."""

from __future__ import annotations

from collections.abc import Mapping

from vic_toolbox.experiments import report
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.experiments.evaluation import Evaluation, Policy, judge
from vic_toolbox.experiments.figures import learning, style
from vic_toolbox.experiments.figures.reward import reward_landscape
from vic_toolbox.experiments.report_parts import (
    TASKS,
    draw,
    motion_figures,
    place,
    results_table,
    short,
    table_caption,
    tiles,
    verdict,
)
from vic_toolbox.experiments.results import write_evaluation
from vic_toolbox.experiments.reward_slices import reward_slices
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.trace import record_trace
from vic_toolbox.tasks import Task


def report_run(skill: Skill, *, before: Skill | None = None, threads: int = 0) -> Evaluation:
    """Evaluate the run on its scenario; write ``evaluation.json``, the figures and ``report.html``.

    Parameters
    ----------
    skill : Skill
        The finished run.
    before : Skill, optional
        The policy that a transfer began with, shown beside it.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.
    """
    task, label = skill.task(), style.look(skill.look).label
    policies = _contestants(task, skill, before)
    episodes = skill.transfer.episodes if skill.transfer else skill.run.episodes
    rows = judge(task, policies, episodes=episodes, threads=threads)
    own = rows[skill.look]
    write_evaluation(skill.folder, own)
    labelled = [(style.look(name).label, row) for name, row in rows.items()]
    report.write_report(
        skill.folder.path / "report.html",
        title=_title(skill, own),
        subtitle=f"{task.action} actions, history {task.history}, seed {skill.seed}, {place(own.scenario)}",
        summary=verdict(own),
        tiles=tiles(own),
        parts=[
            results_table("Result", labelled, marked=label, caption=table_caption(own.episodes)),
            *_figures(skill, task, policies, own),
            report.Commands("Where to go from here", _next_steps(skill)),
            report.Settings("Every setting of this run", flatten(skill.folder.configuration)),
        ],
    )
    return own


def _contestants(task: Task, skill: Skill, before: Skill | None) -> dict[str, Policy]:
    policies = {"expert": Policy.expert(task)}
    if before is not None:
        policies["before"] = before.judged
    policies[skill.look] = skill.judged
    return policies | {"constant": Policy.constant(task)}


def _figures(skill: Skill, task: Task, policies: Mapping[str, Policy], own: Evaluation) -> list[report.Part]:
    folder = skill.folder.path / "figures"
    traces = {name: record_trace(task, policy.act) for name, policy in policies.items()}
    parts: list[report.Part] = []
    curves = learning.learning_curves(skill.folder.metrics(), expert_score=own.expert_score, name=skill.look)
    if curves is not None:
        title = "Transfer" if skill.transfer else "Cloning" if skill.run.method == "bc" else "Learning"
        parts.append(draw(curves, folder / "learning.svg", title, title))
    parts += motion_figures({short(own.scenario): traces}, folder)
    if skill.reward is not None:
        slices = reward_slices(task, skill.reward, skill.policy, traces["expert"], name=skill.look)
        parts.append(
            draw(reward_landscape(slices), folder / "reward.svg", "What the reward values", "reward")
        )
    return parts


def _title(skill: Skill, own: Evaluation) -> str:
    task = TASKS.get(own.task, own.task)
    if skill.transfer is None:
        label = style.look(skill.look).label
        return f"{label[0].upper()}{label[1:]} on {task}"
    return f"{task}: a skill carried to {place(own.scenario)}"


def _next_steps(skill: Skill) -> list[tuple[str, str]]:
    run = skill.folder.path
    steps = []
    if skill.reward is not None and skill.transfer is None:
        steps.append((
            f"vic transfer {run} --scenario T1 --out {run}-T1",
            "Optimise the policy under the frozen reward on a start that it never saw.",
        ))  # fmt: skip
    return [
        *steps,
        (f"vic evaluate {run} --sweep start", "Map score and success over starts all around the arm."),
        (f"vic play {run} --scenario T2 --video {run.name}-T2.mp4", "Film the policy beside the expert."),
    ]
