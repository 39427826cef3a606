"""Draws the README's picture from a gain-AIRL run or its transfer: python docs/images/hero.py RUN"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.trace import Trace, record_trace
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.rendering import Renderer

WIDTH, HEIGHT = 1120, 700
MOMENTS = (0, 40, 100)
"""Policy steps whose postures are drawn as ghosts, before the last one."""


def ghosts(task: Task, trace: Trace) -> np.ndarray:
    """The arm at the end of the episode, its earlier postures shining through behind it."""
    with Renderer(task.picture_spec(), width=WIDTH, height=HEIGHT) as renderer:
        frames = {
            step: renderer.picture(trace.joints[step]).astype(float)
            for step in (*range(0, 240, 30), *MOMENTS, -1)
        }
    scene = np.median(list(frames.values()), axis=0)  # what stays when the arm moves
    picture = frames[-1]
    free = np.abs(picture - scene).max(axis=2, keepdims=True) < 12.0
    for i, step in enumerate(MOMENTS):
        moved = free & (np.abs(frames[step] - scene).max(axis=2, keepdims=True) > 12.0)
        weight = 0.3 + 0.12 * i
        picture = np.where(moved, (1 - weight) * picture + weight * frames[step], picture)
    return picture.astype(np.uint8)


def hero(task: Task, learned: Trace, expert: Trace) -> Figure:
    """Picture on the left, learned gains beside the expert's on the right."""
    with style.figure(11.0, 4.1) as drawing:
        left, right = drawing.subfigures(1, 2, width_ratios=(1.75, 1.0))
        axes = left.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.imshow(ghosts(task, learned))
        axes.axis("off")
        panels = right.subplots(3, 1, sharex=True)
        rows = (
            ("stiffness [N/m]", lambda trace: trace.stiffness[:, 1]),
            ("damping factor [√kg]", lambda trace: trace.damping_factor),
            ("distance to the plate [m]", lambda trace: trace.distance),
        )
        for panel, (label, quantity) in zip(panels, rows, strict=True):
            for name, trace in (("expert", expert), ("airl", learned)):
                style.line(panel, trace.time, quantity(trace), name)
            panel.set_title(label)
            panel.margins(x=0)
        panels[0].legend(loc="upper right")
        panels[-1].set_xlabel("time [s]")
        panels[-1].set_ylim(bottom=0.0)
    return drawing


def main(run: str) -> None:
    """Draw the picture of the run in this folder."""
    skill = load_skill(run)
    task = skill.task()
    learned, expert = record_trace(task, skill.policy.mean), record_trace(task, task.expert_action)
    style.save(hero(task, learned, expert), Path(__file__).with_name("hero.png"))


if __name__ == "__main__":
    main(sys.argv[1])
