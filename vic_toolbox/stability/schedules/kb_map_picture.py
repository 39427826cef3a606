"""The picture of a map of certificates: growth where the motion is unstable, and how far each certificate reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

if TYPE_CHECKING:
    from vic_toolbox.stability.schedules.kb_map import KbMap

INK, QUIET = "#1f2933", "#616e7c"
CERTIFIED, SCHEDULED, STABLE = "#7fc3e8", "#c5e3f3", "#f3f4f6"
GROWTH = LinearSegmentedColormap.from_list("growth", ["#fbd9c4", "#e8743b", "#8c2d04"])


def draw(found: KbMap) -> Figure:
    """Frequency over √(k/m) to the right, relative amplitude upwards."""
    figure = Figure(figsize=(6.6, 4.5), layout="constrained")
    axes = figure.subplots()
    natural = np.sqrt(found.stiffness / found.mass)
    x, y = found.frequency / natural, found.amplitude
    # growth in one oscillation of the mean system, so that slow schedules do not look worse than fast ones
    growth = np.log(found.spectral_radius) * x
    axes.set_facecolor(STABLE)
    if found.schedule_edge is not None:
        edge = found.schedule_edge
        axes.fill_between(edge[:, 0] / natural, 0, edge[:, 1], color=SCHEDULED, linewidth=0)
        axes.plot(edge[:, 0] / natural, edge[:, 1], color="#0072b2", linewidth=1.4, linestyle=(0, (4, 2)))
    top = np.minimum(found.certified_amplitude, y[-1])
    axes.fill_between(x, 0, top, color=CERTIFIED, linewidth=0)
    axes.plot(x, found.certified_amplitude, color="#0072b2", linewidth=1.8)
    peak = float(growth.max())
    if peak > 0:
        shown = np.ma.masked_less_equal(growth, 0.0)
        filled = axes.pcolormesh(
            x, y, shown, cmap=GROWTH, vmin=0, vmax=peak, shading="gouraud", rasterized=True
        )
        axes.contour(x, y, growth, levels=[0.0], colors=[INK], linewidths=1.6)
        bar = figure.colorbar(filled, ax=axes, pad=0.02, aspect=28)
        bar.set_label("growth: ln ρ in one natural period", fontsize=8.5, color=INK)
        bar.ax.tick_params(labelsize=8)
        bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set(
        xlim=(x[0], x[-1]),
        ylim=(y[0], y[-1]),
        xlabel="frequency of the stiffness  ω / √(k/m)",
        ylabel="relative amplitude  a",
    )
    ratio = found.damping / (2 * np.sqrt(found.stiffness * found.mass))
    axes.set_title(
        f"m ë + d ė + k (1 + a sin ωt) e = 0,  damping ratio {ratio:.3g}", fontsize=9.5, loc="left", color=INK
    )
    handles: list[Patch | Line2D] = [
        Patch(facecolor=CERTIFIED, edgecolor="#0072b2", label="proved, constant α")
    ]
    if found.schedule_edge is not None:
        handles.append(Patch(facecolor=SCHEDULED, edgecolor="#0072b2", linestyle="--", label="proved, α(t)"))
    handles.append(Patch(facecolor=STABLE, edgecolor=QUIET, label="stable, not proved"))
    if peak > 0:
        handles.append(Patch(facecolor=GROWTH(0.5), edgecolor=INK, label="unstable (Floquet)"))
    figure.legend(handles=handles, loc="outside lower center", ncols=4, fontsize=8.5, frameon=False)
    return figure
