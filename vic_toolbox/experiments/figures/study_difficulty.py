"""Success against difficulty over all seeds: every method along one quantity, with intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style

SHOWN = 0.012
"""Sidestep of one method beside the next, as a share of the range, so that equal rates do not hide each other."""


@dataclass(frozen=True)
class Line:
    """Success rates of one method along the quantity; NaN where there is none.

    Attributes
    ----------
    name, look : str
        How it is called and drawn.
    mean, low, high : ndarray, shape (n,)
        Rates in [0, 1] and the ends of their intervals.
    dashed : bool
        Drawn in dashes: the same method on a history of observations.
    """

    name: str
    look: str
    mean: np.ndarray
    low: np.ndarray
    high: np.ndarray
    dashed: bool = False


def success_of_seeds(
    values: Sequence[float], panels: Mapping[str, Sequence[Line]], *, label: str, trained: float | None = None
) -> Figure:
    """Success with its intervals, a panel for each group of methods.

    Parameters
    ----------
    values : sequence of float
        The quantity, ascending.
    panels : mapping
        Lines by the title of their panel.
    label : str
        The quantity with its unit.
    trained : float, optional
        Its value in the demonstrations, marked.
    """
    x = np.asarray(values, dtype=float)
    with style.figure(9.0, 3.9) as drawing:
        grid = drawing.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, (title, lines) in zip(grid, panels.items(), strict=True):
            step = SHOWN * (x[-1] - x[0])
            for i, line in enumerate(lines):
                _draw(axes, x + step * (i - (len(lines) - 1) / 2.0), line)
            if trained is not None:
                axes.axvline(trained, color=style.QUIET, lw=0.9, ls=":", zorder=1)
                axes.annotate("demonstrated", (trained, 1.0), (3, -2), xycoords=("data", "axes fraction"),
                              textcoords="offset points", va="bottom", fontsize=7.5, color=style.QUIET)  # fmt: skip
            axes.set(title=title, xlabel=label, ylim=(-4, 104))
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.2), ncols=2, handlelength=2.6)
        grid[0].set_ylabel("success  [%]")
    return drawing


def _draw(axes: Axes, x: np.ndarray, line: Line) -> None:
    look = style.look(line.look)
    known = np.isfinite(line.mean)
    mean = 100.0 * line.mean[known]
    reach = np.clip([mean - 100.0 * line.low[known], 100.0 * line.high[known] - mean], 0.0, None)
    axes.errorbar(
        x[known],
        mean,
        yerr=reach,
        color=look.colour,
        lw=look.width if line.look != "expert" else 4.0,
        elinewidth=0.9,
        capsize=2.0,
        marker="o",
        ms=3.5,
        ls=(0, (4, 1.5)) if line.dashed else "-",
        mfc="white" if line.dashed else look.colour,
        zorder=look.order,
        label=line.name,
    )
