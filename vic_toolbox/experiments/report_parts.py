"""The pieces that every report is put together from: tables, figures with their captions, the verdict."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib.figure

from vic_toolbox.experiments import report
from vic_toolbox.experiments.evaluation import Evaluation
from vic_toolbox.experiments.figures import motion, style
from vic_toolbox.tasks.cup_scene import PLATE_RADIUS

TASKS = {"cup-on-plate": "Cup-on-Plate"}
"""Tasks as headings call them."""

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
    "gains": (
        "Stiffness and damping over one episode. The broad pale band is the expert: stiff and lightly "
        "damped while far from the goal, soft and well damped near it. Dotted lines mark the distances at "
        "which he changes over."
    ),
    "wrench": (
        "The wrench that the policy sets, over one episode; the broad pale band is the expert's. Dotted lines mark the "
        "distances at which he changes over."
    ),
    "paths": (
        "Left: the path of the cup's bottom from its start to the plate. Right: how far each policy is from "
        "where the expert is at the same moment."
    ),
    "forces": "Force that drives the arm, speed of the cup, and the force on it when it touches the plate.",
    "reward": (
        "The learned reward at states along the expert's path, when one quantity of the action is varied "
        "and the rest is the expert's. Pale is what the reward prefers; where the pale ridge follows the "
        "dashed line, it has learned what the expert does."
    ),
}


def draw(drawing: matplotlib.figure.Figure, path: Path, title: str, caption: str) -> report.Figure:
    """Save a figure and make it a part of a report."""
    return report.Figure(style.save(drawing, path), title, CAPTIONS[caption])


def motion_figures(scenes: Mapping[str, motion.Traces], folder: Path) -> list[report.Part]:
    """Gains (or wrenches) of each scene, paths of all of them, forces of the last."""
    drawings = [
        (motion.gains_over_time(traces), "gains", where)
        if motion.has_gains(traces)
        else (motion.wrench_over_time(traces), "wrench", where)
        for where, traces in scenes.items()
    ]
    drawings += [(motion.paths(scenes, plate_radius=PLATE_RADIUS), "paths", "")]
    where, traces = list(scenes.items())[-1]
    drawings += [(motion.forces_over_time(traces), "forces", where)]
    parts: list[report.Part] = []
    for i, (drawing, kind, where) in enumerate(drawings):
        title = _TITLES[kind] + (f", {where}" if where and len(scenes) > 1 else "")
        name = f"{kind}-{i + 1}" if i < len(scenes) > 1 else kind
        parts.append(draw(drawing, folder / f"{name}.svg", title, kind))
    return parts


_TITLES = {
    "gains": "Gains over time",
    "wrench": "Wrench over time",
    "paths": "Paths in space",
    "forces": "Forces",
}


def results_table(
    title: str, rows: Sequence[tuple[str, Evaluation]], *, marked: str, caption: str = ""
) -> report.Table:
    """One row for each policy, (label, evaluation); the marked label is set off."""
    head = ("policy", "start", "score", "expert's score", "relative difference", "success", "peak contact")
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
        f"Mean ± standard deviation over {episodes} episodes; every policy and the expert start from the "
        "same, slightly varied postures. Relative difference: |score − expert's score| / |expert's score|."
    )


def _cells(label: str, row: Evaluation) -> tuple[str, ...]:
    return (
        label,
        row.scenario,
        f"{row.score_mean:.1f} ± {row.score_std:.1f}".replace("-", "−"),
        f"{row.expert_score:.1f}".replace("-", "−"),
        difference(row),
        f"{100 * row.success_rate:.0f} %",
        f"{row.peak_force_mean:.1f} N",
    )


def difference(row: Evaluation) -> str:
    """``|S − S_e| / |S_e|``, and on which side."""
    if row.method == "expert":
        return "–"
    return f"{row.relative_difference:.3f} {'worse' if row.signed_difference > 0 else 'better'}"


def verdict(row: Evaluation) -> str:
    """The result in a sentence."""
    side = "below" if row.signed_difference > 0 else "above"
    return (
        f"The policy scores {row.score_mean:.1f} from {place(row.scenario)}, "
        f"{100 * row.relative_difference:.1f} % {side} the expert's {row.expert_score:.1f}; the cup stands "
        f"in {100 * row.success_rate:.0f} % of {row.episodes} episodes."
    ).replace(" -", " −")


def tiles(row: Evaluation) -> list[tuple[str, str]]:
    """The numbers at the head of a report."""
    return [
        (f"{row.score_mean:.1f}".replace("-", "−"), "score"),
        (f"{row.expert_score:.1f}".replace("-", "−"), "expert's score"),
        (f"{row.relative_difference:.3f}", "relative difference"),
        (f"{100 * row.success_rate:.0f} %", "success"),
    ]


def short(scenario: str) -> str:
    """A scenario as figures call it."""
    return "training start" if scenario == "train" else f"start {scenario}"


def place(scenario: str) -> str:
    """A scenario in words."""
    if scenario == "train":
        return "the training start"
    return (
        f"the start ({scenario.replace(',', ', ')}) m" if "," in scenario else f"the unseen start {scenario}"
    )
