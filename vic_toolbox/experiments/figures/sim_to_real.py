"""Velocity responses: what a policy does on the robot beside what it does in simulation and what the human does.

The counterpart of the paper's sim-to-real figure; the robot is the digital twin.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.deployed import Traces
from vic_toolbox.experiments.figures import style

_AXES = ("x", "y", "z")
_ROOM = 1.6
"""Panels reach so many times as far as the human does: a policy that runs away leaves them."""
_THIN = slice(None, None, 3)
"""Of 100 samples a second as many as can be seen."""
_TWIN, _NOMINAL = style.look("airl").colour, style.look("bc").colour


def velocity_responses(traces: Mapping[str, Traces], *, episode: int = 0) -> Figure:
    """Speed along x, y, z and distance from the human's path over time, a row for each policy.

    Parameters
    ----------
    traces : mapping of Traces
        What the deploy cells of a study keep (``traces.npz``, read by :meth:`Traces.load`), by the policy's name, all
        from the same start.
    episode : int
        Which of the kept episodes.
    """
    with style.figure(9.0, 0.7 + 1.35 * len(traces)) as drawing:
        grid = drawing.subplots(len(traces), 4, sharex=True, squeeze=False)
        for row, (name, trace) in zip(grid, traces.items(), strict=True):
            _speeds(row[:3], trace, episode)
            _distance(row[3], trace, episode)
            row[0].set_ylabel(name.replace(", ", "\n", 1), fontsize=7.5)
        for column, axis in enumerate(_AXES):
            grid[0, column].set_title(f"speed along {axis}  [m/s]")
        grid[0, 3].set_title("off his path  [mm]")
        for axes in grid[-1]:
            axes.set_xlabel("time  [s]")
        style.shared_legend(drawing, grid[0, 0])
    return drawing


def _speeds(panels: np.ndarray, trace: Traces, episode: int) -> None:
    human = style.look("expert")
    for i, axes in enumerate(panels):
        rate = {name: getattr(trace, name)[episode, _THIN, 6 + i] for name in ("human", "nominal", "on_twin")}
        axes.plot(
            trace.time[_THIN],
            rate["human"],
            color=human.colour,
            lw=human.width,
            zorder=2,
            label="the human on the twin",
        )
        axes.plot(
            trace.time[_THIN],
            rate["nominal"],
            color=_NOMINAL,
            lw=1.3,
            dashes=(3, 1),
            zorder=4,
            label="policy, simulation",
        )
        axes.plot(trace.time[_THIN], rate["on_twin"], color=_TWIN, lw=1.3, zorder=3, label="policy, twin")
        low, high = min(rate["human"].min(), 0.0), max(rate["human"].max(), 0.0)
        room = 0.5 * (_ROOM - 1.0) * (high - low)
        axes.set_ylim(low - room, high + room)
        axes.margins(x=0)


def _distance(axes: Axes, trace: Traces, episode: int) -> None:
    for name, colour, dashes in (("nominal", _NOMINAL, (3, 1)), ("on_twin", _TWIN, (None, None))):
        off = getattr(trace, name)[episode, _THIN, :3] - trace.human[episode, _THIN, :3]
        axes.plot(trace.time[_THIN], 1e3 * np.linalg.norm(off, axis=-1), color=colour, lw=1.3, dashes=dashes)
    way = 1e3 * float(np.linalg.norm(trace.human[episode, 0, :3]))
    axes.set_ylim(0.0, min(float(axes.get_ylim()[1]), way))
    axes.margins(x=0)
