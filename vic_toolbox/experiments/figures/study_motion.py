"""What the policies of all seeds set over one episode, gains or wrench: the median seed and the range of the seeds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.figures.motion import finish
from vic_toolbox.experiments.trace import Trace

SeedTraces = Mapping[str, Sequence[Trace]]
"""Traces of all seeds by look; the expert is one of the looks, with a single trace."""

_AXES = ("x", "y", "z")


def gains_of_seeds(traces: SeedTraces, *, zones: Sequence[float] = ()) -> Figure:
    """Stiffness of each axis, damping factor (or speed, where the damping is fixed) and distance to the goal.

    Parameters
    ----------
    traces : mapping of sequences of Trace
        Of every look all seeds.
    zones : sequence of float
        Distances at which the expert changes over: dotted lines, and where he passes them, shaded phases [m].
    """
    factors = any("d" in trace.task.gains.names for seeds in traces.values() for trace in seeds)
    with style.figure(9.0, 4.6) as drawing:
        grid = drawing.subplots(2, 4, sharex=True)
        for i, axis in enumerate(_AXES):
            _panel(grid[0, i], traces, lambda t, i=i: t.stiffness[:, i], f"stiffness along {axis}  [N/m]")
            _panel(
                grid[1, i], traces, lambda t, i=i: t.stiffness[:, 3 + i], f"stiffness about {axis}  [Nm/rad]"
            )
        if factors:
            _panel(grid[0, 3], traces, lambda t: t.damping_factor, "damping factor d  [√kg]")
        else:
            _speed(grid[0, 3], traces)
        _distance(grid[1, 3], traces, zones)
        _phases(grid, traces, zones)
        finish(drawing, grid)
        if factors:
            _narrow(
                grid[0, 3], np.concatenate([t.damping_factor for seeds in traces.values() for t in seeds])
            )
    return drawing


def wrench_of_seeds(traces: SeedTraces, *, zones: Sequence[float] = ()) -> Figure:
    """Feedback wrench, distance to the goal and speed, over time; see :func:`gains_of_seeds`."""
    with style.figure(9.0, 4.6) as drawing:
        grid = drawing.subplots(2, 4, sharex=True)
        for i, axis in enumerate(_AXES):
            _panel(grid[0, i], traces, lambda t, i=i: t.feedback[:, i], f"force along {axis}  [N]")
            _panel(grid[1, i], traces, lambda t, i=i: t.feedback[:, 3 + i], f"torque about {axis}  [Nm]")
        _distance(grid[0, 3], traces, zones)
        _speed(grid[1, 3], traces)
        _phases(grid, traces, zones)
        finish(drawing, grid)
    return drawing


def _panel(axes: Axes, traces: SeedTraces, quantity: Callable[[Trace], np.ndarray], title: str) -> None:
    for name, seeds in traces.items():
        values = np.array([quantity(trace) for trace in seeds])
        look = style.look(name)
        if len(values) > 1:
            some = slice(None, None, max(values.shape[1] // 200, 1))  # as fine as can be seen
            band = values.min(axis=0)[some], values.max(axis=0)[some]
            axes.fill_between(
                seeds[0].time[some], *band, color=look.colour, alpha=0.18, lw=0, zorder=look.order - 1.5
            )
        style.line(axes, seeds[0].time, np.median(values, axis=0), name)
    axes.set_title(title)


def _distance(axes: Axes, traces: SeedTraces, zones: Sequence[float]) -> None:
    factor, unit = _unit(traces)
    _panel(axes, traces, lambda t: factor * t.distance, f"distance to go  [{unit}]")
    for level in zones:
        axes.axhline(factor * level, color=style.QUIET, lw=0.8, ls=":")


def _speed(axes: Axes, traces: SeedTraces) -> None:
    factor, unit = _unit(traces)
    _panel(axes, traces, lambda t: factor * t.speed, f"speed  [{unit}/s]")


def _unit(traces: SeedTraces) -> tuple[float, str]:
    return style.length_unit(max(float(t.distance.max()) for seeds in traces.values() for t in seeds))


def _phases(grid: np.ndarray, traces: SeedTraces, zones: Sequence[float]) -> None:
    """Shade the time during which the expert changes over, between the outermost of the zones."""
    if len(zones) < 2 or "expert" not in traces:
        return
    expert = traces["expert"][0]
    between = expert.time[(expert.distance <= max(zones)) & (expert.distance >= min(zones))]
    for axes in grid.flat if len(between) else ():
        axes.axvspan(between[0], between[-1], color=style.GRID, alpha=0.6, lw=0, zorder=0.5)


def _narrow(axes: Axes, values: np.ndarray) -> None:
    axes.set_ylim(np.nanmin(values) - 0.4, np.nanmax(values) + 0.4)
