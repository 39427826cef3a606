"""The picture of a replayed filter: gains before and after, and where the energy went."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.gains import AXES

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vic_toolbox.control.filter_replay import FilterReplay
    from vic_toolbox.errors import Array

BEFORE, AFTER = "0.55", "C0"


def draw(replay: FilterReplay) -> Figure:
    """Stiffness and damping of each axis (translations left, rotations right), and the energy that they put in."""
    stiffness = _diagonal(replay.stiffness), _diagonal(replay.filtered_stiffness)
    damping = _diagonal(replay.damping), _diagonal(replay.filtered_damping)
    d = stiffness[0].shape[1]
    groups = [slice(0, 3), slice(3, 6)] if d == 6 else [slice(0, d)]
    units = [("N/m", "Ns/m"), ("Nm/rad", "Nms/rad")][: len(groups)]
    names = AXES if d == 6 else tuple(AXES[:d]) if d <= 3 else tuple(str(i + 1) for i in range(d))
    figure = Figure(figsize=(4.6 * len(groups) + 1.2, 6.8), layout="constrained")
    grid = figure.add_gridspec(3, len(groups))
    first = None
    for column, (group, unit) in enumerate(zip(groups, units, strict=True)):
        for row, (title, pair) in enumerate((("stiffness", stiffness), ("damping", damping))):
            axes = figure.add_subplot(grid[row, column], sharex=first)
            first = first or axes
            for i in range(*group.indices(d)):
                _curve(axes, replay.time, pair[0][:, i], pair[1][:, i], label=names[i] if d > 1 else None)
            axes.set_ylabel(f"{title} [{unit[row]}]")
            axes.grid(alpha=0.3)
            axes.tick_params(labelbottom=False)
            if row == 0:
                axes.plot([], [], color=BEFORE, ls="--", label="recorded")
                axes.legend(fontsize="small", ncols=2, loc="best")
            _shade(axes, replay)
    energy = figure.add_subplot(grid[2, :], sharex=first)
    energy.plot(replay.time, replay.injected, color=BEFORE, ls="--", label="put in, recorded gains")
    energy.plot(replay.time, replay.filtered_injected, color=AFTER, label="put in, filtered gains")
    if replay.tank is not None:
        energy.plot(replay.time, replay.tank, color="C2", label="in the tank")
    _shade(energy, replay)
    energy.set_ylabel("energy [J]")
    energy.set_xlabel("time [s]")
    energy.grid(alpha=0.3)
    energy.legend(fontsize="small", loc="best")
    figure.suptitle(
        f"{replay.share_changed:.0%} of the samples changed (shaded), {replay.energy_saved:.3g} J kept out",
        fontsize="medium",
    )
    return figure


def _curve(axes: Axes, time: Array, before: Array, after: Array, *, label: str | None) -> None:
    (line,) = axes.step(time, after, where="post", label=label or "filtered", zorder=3)
    axes.step(
        time, before, where="post", color=BEFORE if label is None else line.get_color(), ls="--", alpha=0.7
    )


def _shade(axes: Axes, replay: FilterReplay) -> None:
    """Mark the time in which the gains differ."""
    edges = np.diff(np.concatenate([[0], replay.changed.astype(int), [0]]))
    ends = np.append(replay.time, replay.time[-1])
    for begin, end in zip(np.nonzero(edges == 1)[0], np.nonzero(edges == -1)[0], strict=True):
        axes.axvspan(ends[begin], ends[end], color="C1", alpha=0.12, linewidth=0)


def _diagonal(gains: Array) -> Array:
    return np.diagonal(gains, axis1=1, axis2=2) if gains.ndim == 3 else gains
