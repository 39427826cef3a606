"""What a policy sets over one episode, gains or the wrench itself: each method beside the expert."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.trace import Trace

Traces = Mapping[str, Trace]

_AXES = ("x", "y", "z")


def has_gains(traces: Traces) -> bool:
    """Whether these policies set gains; the others set the wrench itself."""
    return any(trace.stiffness.any() for trace in traces.values())


def gains_over_time(traces: Traces, *, zones: Sequence[float] = ()) -> Figure:
    """Stiffness of each axis, damping factor (or speed, where the damping is fixed) and distance to the goal.

    Parameters
    ----------
    traces : dict of Trace
        Episodes by look.
    zones : sequence of float
        Distances at which the expert changes over, drawn as lines [m].
    """
    factors = any("d" in trace.task.gains.names for trace in traces.values())
    with style.figure(9.0, 4.6) as drawing:
        grid = drawing.subplots(2, 4, sharex=True)
        for i, axis in enumerate(_AXES):
            for name, trace in traces.items():
                style.line(grid[0, i], trace.time, trace.stiffness[:, i], name)
                style.line(grid[1, i], trace.time, trace.stiffness[:, 3 + i], name)
            grid[0, i].set_title(f"stiffness along {axis}  [N/m]")
            grid[1, i].set_title(f"stiffness about {axis}  [Nm/rad]")
        if factors:
            for name, trace in traces.items():
                style.line(grid[0, 3], trace.time, trace.damping_factor, name)
            grid[0, 3].set_title("damping factor d  [√kg]")
        else:
            _speed(grid[0, 3], traces)
        _distance(grid[1, 3], traces, zones)
        finish(drawing, grid)
        if factors:
            values = np.concatenate([trace.damping_factor for trace in traces.values()])
            grid[0, 3].set_ylim(values.min() - 0.4, values.max() + 0.4)
    return drawing


def wrench_over_time(traces: Traces, *, zones: Sequence[float] = ()) -> Figure:
    """Feedback wrench, distance to the goal and speed, over time; see :func:`gains_over_time`."""
    with style.figure(9.0, 4.6) as drawing:
        grid = drawing.subplots(2, 4, sharex=True)
        for name, trace in traces.items():
            for i in range(6):
                style.line(grid[i // 3, i % 3], trace.time, trace.feedback[:, i], name)
        for i, axis in enumerate(_AXES):
            grid[0, i].set_title(f"force along {axis}  [N]")
            grid[1, i].set_title(f"torque about {axis}  [Nm]")
        _distance(grid[0, 3], traces, zones)
        _speed(grid[1, 3], traces)
        finish(drawing, grid)
    return drawing


def _distance(axes: Axes, traces: Traces, zones: Sequence[float]) -> None:
    factor, unit = _unit(traces)
    for name, trace in traces.items():
        style.line(axes, trace.time, factor * trace.distance, name)
    for level in zones:
        axes.axhline(factor * level, color=style.QUIET, lw=0.8, ls=":")
    axes.set_title(f"distance to go  [{unit}]")


def _speed(axes: Axes, traces: Traces) -> None:
    factor, unit = _unit(traces)
    for name, trace in traces.items():
        style.line(axes, trace.time, factor * trace.speed, name)
    axes.set_title(f"speed  [{unit}/s]")


def _unit(traces: Traces) -> tuple[float, str]:
    return style.length_unit(max(float(trace.distance.max()) for trace in traces.values()))


def finish(drawing: Figure, grid: np.ndarray) -> None:
    """Label time below the last row, let the axes of what is never negative begin at zero, add the legend."""
    for axes in grid[-1]:
        axes.set_xlabel("time  [s]")
    for axes in grid.flat:
        axes.set_ylim(bottom=0) if min(axes.get_ylim()) > -1e-9 or _non_negative(axes) else None
        axes.margins(x=0)
    style.shared_legend(drawing, grid.flat[0])


def _non_negative(axes: Axes) -> bool:
    return all(np.nanmin(line.get_ydata(), initial=0.0) >= 0.0 for line in axes.get_lines())
