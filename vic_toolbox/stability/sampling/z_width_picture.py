"""The picture of a Z-width: decay per period over (K, B), the edge of stability, the passive gains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

if TYPE_CHECKING:
    from vic_toolbox.stability.sampling.z_width import ZWidth

LEVELS = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 1.0)
PASSIVE, EDGE = "#d95f02", "#111111"


def draw(found: ZWidth) -> Figure:
    """Filled contours of the spectral radius where it is below one; outside is left white."""
    figure = Figure(figsize=(6.4, 4.6), layout="constrained")
    axes = figure.subplots()
    kilo, unit = (1e3, "kN/m") if found.stiffness[-1] >= 1e4 else (1.0, "N/m")
    k, b = np.meshgrid(found.stiffness / kilo, found.damping)
    filled = axes.contourf(k, b, found.spectral_radius, levels=LEVELS, cmap="viridis_r", alpha=0.85)
    bar = figure.colorbar(
        filled, ax=axes, label="spectral radius (share left after one period)", ticks=LEVELS
    )
    bar.ax.tick_params(labelsize=8)
    axes.plot(found.edge[:, 0] / kilo, found.edge[:, 1], color=EDGE, linewidth=1.8)
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=EDGE, linewidth=1.8, label="edge of stability (exact)")
    ]
    if found.passive.any():
        needed = found.required_damping
        levels = [min(needed.min(), 0.0) - 1.0, found.physical_damping]
        axes.contourf(k, b, needed, levels=levels, colors=[PASSIVE], alpha=0.8)
        axes.contour(k, b, needed, levels=levels[1:], colors=[PASSIVE], linewidths=1.2)
        handles.append(Patch(facecolor=PASSIVE, alpha=0.8, label="passive: stable with every hand"))
    if np.isfinite(found.largest).all():
        axes.plot(found.largest[0] / kilo, found.largest[1], "o", color=EDGE, markersize=5)
        label = f"largest: {found.largest[0] / kilo:.4g} {unit} at {found.largest[1]:.4g} Ns/m"
        handles.append(Line2D([], [], color=EDGE, marker="o", linestyle="none", markersize=5, label=label))
    axes.set(
        xlim=found.stiffness[[0, -1]] / kilo,
        ylim=found.damping[[0, -1]],
        xlabel=f"virtual stiffness K [{unit}]",
        ylabel="virtual damping B [Ns/m]",
    )
    steps = found.delay_steps
    late = f", {steps} period{'s' * (steps > 1)} late" if steps else ""
    axes.set_title(
        f"m = {found.mass:g} kg, T = {found.period * 1e3:g} ms, friction {found.physical_damping:g} Ns/m, "
        f"{found.velocity} velocity{late}",
        fontsize=9,
    )
    axes.legend(handles=handles, fontsize=8, loc="upper right", framealpha=0.9)
    return figure
