"""Judging and reporting one run: the policy beside the expert and the constant gains."""

from __future__ import annotations

from collections.abc import Mapping

from vic_toolbox.experiments import report
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.experiments.difficulty import offered_sweeps
from vic_toolbox.experiments.evaluation import Evaluation, Policy, baselines, evaluate, judge
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.report_parts import (
    learning_figure,
    motion_figures,
    place,
    results_table,
    reward_figure,
    saved,
    short,
    table_caption,
    tiles,
    verdict,
)
from vic_toolbox.experiments.results import write_evaluation
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.trace import record_trace
from vic_toolbox.tasks import Task


def judge_run(skill: Skill, *, threads: int = 0) -> Evaluation:
    """Evaluate the run on its scenario and write ``evaluation.json``: :func:`report_run` without its pages."""
    own = evaluate(skill.task(), skill.judged, episodes=_episodes(skill), threads=threads)
    write_evaluation(skill.folder, own)
    return own


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
    rows = judge(task, policies, episodes=_episodes(skill), threads=threads)
    own = rows[skill.look]
    write_evaluation(skill.folder, own)
    labelled = [(style.look(name).label, row) for name, row in rows.items()]
    report.write_report(
        skill.folder.path / "report.html",
        title=_title(skill, task),
        subtitle=f"{task.action} actions, history {task.history}, seed {skill.seed}, {place(own.scenario)}",
        summary=verdict(own, task),
        tiles=tiles(own),
        parts=[
            results_table("Result", labelled, marked=label, caption=table_caption(own.episodes)),
            *_figures(skill, task, policies, own),
            report.Commands("Where to go from here", _next_steps(skill, task)),
            report.Settings("Every setting of this run", flatten(skill.folder.configuration)),
        ],
    )
    return own


def _episodes(skill: Skill) -> int:
    return skill.transfer.episodes if skill.transfer else skill.run.episodes


def _contestants(task: Task, skill: Skill, before: Skill | None) -> dict[str, Policy]:
    policies = {"expert": Policy.expert(task)}
    if before is not None:
        policies["before"] = before.judged
    policies[skill.look] = skill.judged
    return policies | {name: policy for name, policy in baselines(task).items() if name not in policies}


def _figures(skill: Skill, task: Task, policies: Mapping[str, Policy], own: Evaluation) -> list[report.Part]:
    traces = {name: record_trace(task, policy.act) for name, policy in policies.items()}
    drawings = [
        *learning_figure(skill, own, file="learning"),
        *motion_figures({short(own.scenario): traces}),
        *reward_figure(skill, traces["expert"]),
    ]
    return [saved(drawing, skill.folder.path / "figures") for drawing in drawings]


def _title(skill: Skill, task: Task) -> str:
    if skill.transfer is None:
        label = style.look(skill.look).label
        return f"{label[0].upper()}{label[1:]} on {task.title}"
    return f"{task.title}: a skill carried to {place(task.scenario.name)}"


def _next_steps(skill: Skill, task: Task) -> list[tuple[str, str]]:
    run, unseen = skill.folder.path, [name for name in task.scenarios if name != "train"]
    steps = []
    if skill.reward is not None and skill.transfer is None and unseen:
        steps.append((
            f"vic transfer {run} --scenario {unseen[0]} --out {run}-{unseen[0]}",
            "Optimise the policy under the frozen reward on a scenario that it never saw.",
        ))  # fmt: skip
    if sweeps := offered_sweeps(task):
        steps.append((f"vic evaluate {run} --sweep {sweeps[0]}", "See how far the skill carries."))
    where = unseen[-1] if unseen else "train"
    film = f"vic play {run} --scenario {where} --video {run.name}-{where}.mp4"
    return [*steps, (film, "Film the policy beside the expert.")]
