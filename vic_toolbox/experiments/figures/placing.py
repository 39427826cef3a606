"""What happens to the cup: paths through space and forces over one episode, each method beside the expert."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import MultipleLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.motion import Traces, finish
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.tasks.cup_scene import PLATE_RADIUS


def forces_over_time(traces: Traces) -> Figure:
    """Force that drives the arm, speed, and force on the object once it touches."""
    with style.figure(9.0, 2.7) as drawing:
        driving, speed, contact = drawing.subplots(1, 3)
        for name, trace in traces.items():
            style.line(driving, trace.time, np.linalg.norm(trace.feedback[:, :3], axis=1), name)
            style.line(speed, trace.time, trace.speed, name)
            style.line(contact, trace.time, _smoothed(trace.contact), name)
        driving.set_title("feedback force ‖F_fb‖  [N]")
        speed.set_title("speed of the cup  [m/s]")
        contact.set_title("contact force, mean over 0.1 s  [N]")
        finish(drawing, np.array([[driving, speed, contact]]))
        first_touch = min(trace.time[trace.contact > 0.0].min(initial=np.inf) for trace in traces.values())
        if np.isfinite(first_touch):
            contact.set_xlim(left=max(0.0, first_touch - 0.3))
    return drawing


def _smoothed(force: np.ndarray, samples: int = 10) -> np.ndarray:
    """Mean over the last samples: a rigid cup on a rigid plate makes the raw force chatter."""
    return np.convolve(force, np.full(samples, 1.0 / samples))[: len(force)]


def paths(scenes: Mapping[str, Traces]) -> Figure:
    """Paths in space around the robot's base, and how far each method leaves the expert's path.

    Parameters
    ----------
    scenes : Mapping[str, Traces]
        Traces by scenario and look; every scenario has an "expert".
    """
    with style.figure(9.0, 4.4) as drawing:
        left, right = drawing.subfigures(1, 2, width_ratios=(1.5, 1.0), squeeze=False)[0]
        axes = left.add_subplot(projection="3d")
        draw_paths(axes, scenes)
        grid = right.subplots(len(scenes), 1, squeeze=False, sharex=True)[:, 0]
        for panel, (scenario, traces) in zip(grid, scenes.items(), strict=True):
            for name, trace in traces.items():
                if name != "expert":
                    deviation = np.linalg.norm(trace.path - traces["expert"].path, axis=1)
                    style.line(panel, trace.time, 1e3 * deviation, name)
            panel.set(title=f"{scenario}, off the expert's path  [mm]", xlim=(0, trace.time[-1]))
            panel.set_ylim(bottom=0)
        grid[-1].set_xlabel("time  [s]")
        style.shared_legend(drawing, axes)
    return drawing


def draw_paths(axes: Any, scenes: Mapping[str, Traces]) -> None:
    """Draw paths, their shadows on the table, the plate and the robot's base into 3-D axes, to scale."""
    all_traces = [trace for traces in scenes.values() for trace in traces.values()]
    goal = all_traces[0].goal
    for scenario, traces in scenes.items():
        for name, trace in traces.items():
            x, y, z = trace.path.T
            style.line(axes, x, y, name, zs=z)
            axes.plot(x, y, 0.0, color=style.QUIET, lw=0.6, alpha=0.25)
        start = next(iter(traces.values())).path[0]
        axes.plot(start[[0, 0]], start[[1, 1]], [0.0, start[2]], color=style.QUIET, lw=0.6, ls=":")
        axes.scatter(*start, color=style.INK, s=16, depthshade=False, zorder=6)
        axes.text(
            *(start - np.array([0.0, 0.0, 0.04])),
            scenario,
            fontsize=8.5,
            ha="center",
            va="top",
            weight="bold",
            path_effects=[withStroke(linewidth=3.0, foreground="white")],
            zorder=7,
        )
    _disc(axes, goal[:2], PLATE_RADIUS, "#dfe6ee", "")
    _disc(axes, np.zeros(2), 0.095, "#f5dd90", "robot")
    rims = [[-0.1, -0.1, 0.0], *(goal + PLATE_RADIUS * np.array([[-1, -1, 0], [1, 1, 0]]))]
    points = np.concatenate([trace.path for trace in all_traces] + [np.array(rims)])
    low, high = (
        points.min(axis=0) - np.array([0.0, 0.05, 0.0]),
        points.max(axis=0) + np.array([0.05, 0.1, 0.06]),
    )
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(0.0, high[2]))
    axes.set_box_aspect(high - [low[0], low[1], 0.0], zoom=1.22)
    axes.view_init(elev=26, azim=-32)
    axes.tick_params(labelsize=7, pad=-2)
    axes.set_xlabel("x  [m]", labelpad=-4)
    axes.set_ylabel("y  [m]", labelpad=-2)
    axes.set_zlabel("z  [m]", labelpad=-6)
    for direction in (axes.xaxis, axes.yaxis, axes.zaxis):
        direction.set_major_locator(MultipleLocator(0.2))
        direction.set_pane_color((1, 1, 1, 0))
        direction.line.set_color(style.GRID)


def _disc(axes: Any, centre: np.ndarray, radius: float, colour: str, label: str) -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 60)
    rim = np.stack(
        [centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle), 0.0 * angle], axis=1
    )
    axes.add_collection3d(Poly3DCollection([rim], facecolor=colour, edgecolor=style.QUIET, lw=0.6, alpha=0.8))
    axes.text(*centre, 0.0, label, fontsize=7.5, color=style.QUIET, ha="center", va="center")


def scenery(axes: Any, name: str, trace: Trace, skeleton: np.ndarray) -> None:
    """What stands around the arm, with room for all of it: see ``TaskView.scenery``."""
    del skeleton  # the limits below hold every posture
    draw_paths(axes, {"start": {name: trace}})
    axes.set_zlim(0.0, 0.9)
    axes.set_box_aspect((0.8, 0.9, 0.9), zoom=1.1)
