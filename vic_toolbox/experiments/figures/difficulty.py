"""Success against difficulty: how far each method carries along one quantity."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style


def success_curves(
    values: np.ndarray,
    success: Mapping[str, np.ndarray],
    intervals: Mapping[str, np.ndarray],
    *,
    areas: Mapping[str, float],
    label: str,
) -> Figure:
    """One line for each method with the band of its intervals; its area stands in the legend.

    Parameters
    ----------
    values : ndarray, shape (n,)
        The quantity.
    success : dict of ndarray, shape (n,)
        Success rates by look.
    intervals : dict of ndarray, shape (2, n)
        Their intervals.
    areas : dict of float
        Area under each curve over the width of the range.
    label : str
        The quantity with its unit.
    """
    with style.figure(9.0, 3.8) as drawing:
        axes = drawing.subplots()
        for name, rate in success.items():
            look = style.look(name)
            band = 100.0 * intervals[name]
            axes.fill_between(values, *band, color=look.colour, alpha=0.15, lw=0, zorder=look.order - 1.5)
            named = f"{look.label}  ({areas[name]:.2f})"
            style.line(axes, values, 100.0 * rate, name, label=named, marker="o", ms=3.5)
        axes.set(xlabel=label, ylabel="success  [%]", ylim=(-4, 104))
        axes.margins(x=0.02)
        drawing.legend(loc="outside right upper", title="method  (area under its curve)", handlelength=2.6)
    return drawing
