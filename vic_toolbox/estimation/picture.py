"""The picture of an estimate: six axes, stiffness and damping, with their bands and gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.gains import AXES

if TYPE_CHECKING:
    from vic_toolbox.estimation.estimate import GainEstimate

_UNITS = {"stiffness": ("N/m", "Nm/rad"), "damping": ("Ns/m", "Nms/rad")}


def draw(estimate: GainEstimate) -> Figure:
    """Diagonals of K (left) and B (right) over time; the band is ± 1.96 standard deviations."""
    figure = Figure(figsize=(9, 10), layout="constrained")
    axes = figure.subplots(6, 2, sharex=True)
    for column, name in enumerate(("stiffness", "damping")):
        values = np.diagonal(getattr(estimate, name), axis1=1, axis2=2)
        deviations = np.diagonal(getattr(estimate, f"{name}_sd"), axis1=1, axis2=2)
        for row, axis in enumerate(AXES):
            plot = axes[row, column]
            value, band = values[:, row], 1.96 * deviations[:, row]
            plot.set_ylabel(f"{axis} [{_UNITS[name][row > 2]}]")
            plot.grid(alpha=0.3)
            if not np.isfinite(value).any():
                plot.text(0.5, 0.5, "not determined", transform=plot.transAxes, ha="center", va="center")
                continue
            # one instant, or instants between gaps, are no line: mark them
            marker = "o" if np.isfinite(value).sum() < 3 else None
            plot.plot(estimate.time, value, color="C0", marker=marker)
            plot.fill_between(estimate.time, value - band, value + band, color="C0", alpha=0.25, linewidth=0)
        axes[0, column].set_title(f"{name}, 95 % band")
        axes[-1, column].set_xlabel("time [s]")
    return figure
