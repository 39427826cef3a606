"""The pieces that every report is put together from: tables, figures with their captions, the verdict."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from vic_toolbox.experiments import report
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.figures import learning, motion, style
from vic_toolbox.experiments.figures.reward import reward_landscape
from vic_toolbox.experiments.reward_slices import reward_slice
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.task_views import Drawing, Scenes, knob, view
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.experiments.wording import score_text, success_text
from vic_toolbox.tasks import Task

CAPTIONS = {
    "Learning": (
        "The policy is judged by its mean action (thick line); the thin line is its score while it explores. The "
        "error on held-out expert states, never a score, decides which iteration is kept. The discriminator sees the "
        "exploring policy, which is wider than the expert, so it need not fall to chance."
    ),
    "Cloning": "Error of the mean action on held-out expert states: the weights of its minimum are kept.",
    "Transfer": (
        "The reward is frozen; only the policy moves. The thin line is its score while it explores, the "
        "thick one the score of its mean action, which the optimisation never sees."
    ),
}


def saved(drawing: Drawing, folder: Path) -> report.Figure:
    """A drawing as a part of a report, its file in the folder."""
    path = style.save(drawing.figure, folder / f"{drawing.file}.svg")
    return report.Figure(path, drawing.title, drawing.caption)


def learning_figure(skill: Skill, row: Evaluation, *, file: str, title: str = "") -> list[Drawing]:
    """The learning curves of a run, if it has any."""
    curves = learning.learning_curves(skill.folder.metrics(), expert_score=row.expert_score, name=skill.look)
    kind = "Transfer" if skill.transfer else "Cloning" if skill.run.method == "bc" else "Learning"
    return [] if curves is None else [Drawing(file, title or kind, CAPTIONS[kind], curves)]


def motion_figures(scenes: Scenes) -> list[Drawing]:
    """Gains (or wrenches) of each scene, and what the task has of its own."""
    shown = view(next(iter(next(iter(scenes.values())).values())).task)
    drawings = []
    for i, (where, traces) in enumerate(scenes.items()):
        several = len(scenes) > 1
        if motion.has_gains(traces):
            kind, title, caption = "gains", "Gains over time", shown.gains
            figure = motion.gains_over_time(traces, zones=shown.zones)
        else:
            kind, title, caption = "wrench", "Wrench over time", shown.wrench
            figure = motion.wrench_over_time(traces, zones=shown.zones)
        name, place = (f"{kind}-{i + 1}", f", {where}") if several else (kind, "")
        drawings.append(Drawing(name, title + place, caption, figure))
    return [*drawings, *shown.figures(scenes)]


def reward_figure(skill: Skill, expert: Trace) -> list[Drawing]:
    """What the skill's reward values along the expert's path, if it has one."""
    if skill.reward is None:
        return []
    task = expert.task
    part = reward_slice(task, skill.reward, skill.policy, expert, name=skill.look)
    return [Drawing("reward", "What the reward values", knob(task).caption, reward_landscape([part]))]


def results_table(
    title: str, rows: Sequence[tuple[str, Evaluation]], *, marked: str, caption: str = ""
) -> report.Table:
    """One row for each policy, (label, evaluation); the marked label is set off."""
    head = ("policy", "scenario", "success", "score", "expert's score", "relative difference", "peak contact")
    return report.Table(
        title,
        head,
        [_cells(label, row) for label, row in rows],
        caption=caption,
        marked=frozenset(i for i, (label, _) in enumerate(rows) if label == marked),
    )


def table_caption(episodes: int) -> str:
    """What the numbers of a results table are."""
    return (
        f"{episodes} episodes; every policy and the expert begin at the same, slightly varied starts. Success with its "
        "95 % interval (Wilson); score as mean ± standard deviation over the episodes. Relative difference: "
        "|score − expert's score| / |expert's score|."
    )


def _cells(label: str, row: Evaluation) -> tuple[str, ...]:
    return (
        label,
        row.scenario,
        success_text(row),
        _minus(f"{score_text(row.score_mean)} ± {score_text(row.score_std)}"),
        _minus(score_text(row.expert_score)),
        difference(row),
        f"{row.peak_force_mean:.1f} N",
    )


def difference(row: Evaluation) -> str:
    """``|S − S_e| / |S_e|``, and on which side."""
    if row.method == "expert":
        return "–"
    return f"{row.relative_difference:.3f} {'worse' if row.signed_difference > 0 else 'better'}"


def verdict(row: Evaluation, task: Task) -> str:
    """The result in two sentences."""
    side = "below" if row.signed_difference > 0 else "above"
    return _minus(
        f"In {place(row.scenario)} {task.outcome_text[0]} at the end of {success_text(row)} of {row.episodes} "
        f"episodes; the expert's success is {100 * row.expert_success_rate:.0f} %. The policy scores "
        f"{score_text(row.score_mean)}, {100 * row.relative_difference:.1f} % {side} the expert's "
        f"{score_text(row.expert_score)}."
    )


def tiles(row: Evaluation) -> list[tuple[str, str]]:
    """The numbers at the head of a report."""
    rate, interval = success_text(row).split(" (")
    return [
        (rate, f"success ({interval}"),
        (_minus(score_text(row.score_mean)), "score"),
        (_minus(score_text(row.expert_score)), "expert's score"),
        (f"{row.relative_difference:.3f}", "relative difference"),
    ]


def _minus(text: str) -> str:
    """With the sign of typography instead of hyphens before numbers."""
    return re.sub(r"(?<!\S)-(?=\d)", "−", text)


def short(scenario: str) -> str:
    """A scenario as figures call it."""
    return "training" if scenario == "train" else scenario


def place(scenario: str) -> str:
    """A scenario in words."""
    return "the training scenario" if scenario == "train" else f"the scenario {scenario}"
