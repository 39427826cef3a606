"""What happens to the peg: the way of its tip into the hole, and what it takes, each method beside the expert."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.motion import Traces, finish
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.tasks.peg_scene import BLOCK, BORE_DEPTH, CHAMFER, GOAL_DEPTH, HOLE_RADIUS, PegScenario

_SOLID = "#dfe3e8"


def insertion(traces: Traces) -> Figure:
    """The tip's path against the hole's profile; its offset, the tilt, the way to go and the force over time."""
    task: Any = next(iter(traces.values())).task
    with style.figure(9.0, 4.6) as drawing:
        grid = drawing.add_gridspec(2, 3, width_ratios=(1.15, 1.0, 1.0))
        path = drawing.add_subplot(grid[:, 0])
        offset, tilt, way, force = panels = [drawing.add_subplot(grid[i, j]) for i in (0, 1) for j in (1, 2)]
        for name, trace in traces.items():
            tip = 1e3 * task.tip_position(trace.observations)
            style.line(path, tip[:, 0], tip[:, 2], name)
            style.line(offset, trace.time, np.linalg.norm(tip[:, :2], axis=1), name)
            style.line(tilt, trace.time, np.degrees(np.linalg.norm(trace.error[:, 3:5], axis=1)), name)
            style.line(way, trace.time, 1e3 * trace.distance, name)
            style.line(force, trace.time, trace.contact, name)
        draw_profile(path, task.scenario)
        path.set(title="path of the tip  [mm]", xlabel="x  [mm]", ylabel="height  [mm]")
        offset.set_title("tip off the hole's axis  [mm]")
        tilt.set_title("tilt  [deg]")
        way.set_title("distance to the goal  [mm]")
        force.set_title("contact force  [N]")
        finish(drawing, np.array(panels).reshape(2, 2))
    return drawing


def draw_profile(axes: Axes, scenario: PegScenario) -> None:
    """Fill where the centre of an upright peg's tip cannot be, in the plane y = 0, [mm]; mark the goal depth."""
    scale, gap = scenario.scale, 1e-3 * scenario.clearance * scenario.scale
    chamfer, depth, goal = (1e3 * scale * length for length in (CHAMFER, BORE_DEPTH, GOAL_DEPTH))
    low, high = axes.get_xlim()
    reach = max(abs(low), abs(high), 2.5 * chamfer)
    wall = np.array(
        [[gap, -depth], [gap, -chamfer], [gap + chamfer, 0.0], [2.0 * reach, 0.0], [2.0 * reach, -depth]]
    )
    for side in (-1.0, 1.0):
        axes.fill(side * wall[:, 0], wall[:, 1], facecolor=_SOLID, edgecolor=style.QUIET, lw=0.8, zorder=1)
    axes.axhline(-goal, color=style.QUIET, lw=0.8, ls=":", zorder=1.5)
    axes.annotate("goal", (1.0, -goal), (-3, 3), xycoords=("axes fraction", "data"), textcoords="offset points",
                  ha="right", color=style.QUIET, fontsize=7.5, annotation_clip=True)  # fmt: skip
    axes.set(xlim=(-reach, reach), ylim=(-1.25 * goal, axes.get_ylim()[1]))


def scenery(axes: Any, name: str, trace: Trace, skeleton: np.ndarray) -> None:
    """The block's top with its hole, with room for the peg: see ``TaskView.scenery``."""
    task: Any = trace.task
    scale = task.scenario.scale
    x, y, z = task.tip_position(trace.observations).T
    style.line(axes, x, y, name, zs=z)
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    for radius in (HOLE_RADIUS, HOLE_RADIUS + CHAMFER):
        axes.plot(
            scale * radius * np.cos(angle), scale * radius * np.sin(angle), 0.0, color=style.QUIET, lw=0.8
        )
    edge = scale * BLOCK * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    axes.plot(*edge.T, 0.0, color=style.QUIET, lw=0.8)
    side, top = 1.2 * scale * BLOCK, 1.05 * float(skeleton[..., 2].max())
    ticks = scale * BLOCK * np.array([-1.0, 0.0, 1.0])
    axes.set(
        xlim=(-side, side), ylim=(-side, side), zlim=(-scale * GOAL_DEPTH, top), xticks=ticks, yticks=ticks
    )
    axes.set_box_aspect((2.0 * side, 2.0 * side, top + scale * GOAL_DEPTH))
