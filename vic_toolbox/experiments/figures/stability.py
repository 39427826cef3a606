"""Gains over time with the α that certifies them, and where gains lie in the Z-width of their axis."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox import stability
from vic_toolbox.errors import Array
from vic_toolbox.experiments.figures import style
from vic_toolbox.gains import AXES
from vic_toolbox.stability import Analysis

COLOURS = ("#d55e00", "#009e73", "#0072b2")
NEEDED, ALLOWED, CHOSEN = "#0072b2", "#009e73", "#d55e00"
BELOW = 3.0
"""How far the Z-width map goes below the least gain (factor)."""


def gains_over_time(analysis: Analysis) -> Figure:
    """K(t) and B(t) of the axes that were judged, and below the α that the changes need and the damping allows."""
    assert analysis.time is not None
    assert analysis.stiffness is not None
    assert analysis.damping is not None
    groups = [
        (unit, [i for i, name in enumerate(analysis.axes) if (name in AXES[3:]) == turning])
        for turning, unit in ((False, ("N/m", "Ns/m")), (True, ("Nm/rad", "Nms/rad")))
    ]
    groups = [group for group in groups if group[1]]
    drawn = alphas(analysis)
    rows = 2 + bool(drawn)
    with style.figure(9.0, 0.4 + 1.9 * rows) as drawing:
        grid = drawing.add_gridspec(rows, len(groups))
        for column, (units, axes) in enumerate(groups):
            for row, (name, gains) in enumerate(
                (("stiffness", analysis.stiffness), ("damping", analysis.damping))
            ):
                panel = drawing.add_subplot(grid[row, column])
                panel.set_title(f"{name}  [{units[row]}]")
                for i in axes:
                    colour = COLOURS[i % 3] if len(analysis.axes) > 1 else style.INK
                    panel.plot(analysis.time, gains[:, i, i], color=colour, lw=1.3, label=analysis.axes[i])
                panel.set_ylim(bottom=0.0)
                panel.margins(x=0)
                if row == 0 and len(analysis.axes) > 1:
                    panel.legend(ncols=len(axes), fontsize=8)
        if drawn:
            _draw_alphas(drawing.add_subplot(grid[2, :]), drawn)
        drawing.axes[-1].set_xlabel("time  [s]")
    return drawing


def alphas(analysis: Analysis) -> dict[str, tuple[Array, Array]]:
    """α over time that the changing gains need, that the damping allows, and that was chosen: (time, α) by label."""
    found: dict[str, tuple[Array, Array]] = {}
    if "schedule" not in analysis:
        return found
    finding = next(f for f in analysis if f.name == "schedule")
    for verdict in (finding.verdict, *finding.tried):
        for key, label in (
            ("profile_needed", "needed by the changes"),
            ("profile_allowed", "allowed by the damping"),
            ("profile_alpha", "chosen"),
            ("profile_chosen", "chosen"),
        ):
            if key in verdict.values and "profile_time" in verdict.values and label not in found:
                time = np.asarray(verdict.values["profile_time"])
                found[label] = time, np.broadcast_to(verdict.values[key], time.shape)
    return found


def _draw_alphas(panel: Axes, drawn: dict[str, tuple[Array, Array]]) -> None:
    colours: dict[str, str] = dict(
        zip(
            ("needed by the changes", "allowed by the damping", "chosen"),
            (NEEDED, ALLOWED, CHOSEN),
            strict=True,
        )
    )
    for label, (time, alpha) in drawn.items():
        panel.plot(
            time, np.where(np.isfinite(alpha), alpha, np.nan), color=colours[label], lw=1.5, label=label
        )
    tops = [np.nanmax(np.where(np.isfinite(a), a, np.nan)) for _, a in drawn.values() if np.isfinite(a).any()]
    reach = [
        top for (label, _), top in zip(drawn.items(), tops, strict=False) if label != "needed by the changes"
    ]
    panel.set_ylim(0.0, 1.25 * (max(reach) if reach else max(tops, default=1.0)))
    panel.set_title("α of the storage function  [1/s]")
    panel.legend(ncols=3, fontsize=8)
    panel.margins(x=0)


def in_the_z_width(
    analysis: Analysis, *, period: float, friction: Array, velocity: str, delay_steps: int
) -> tuple[Figure, str] | None:
    """The gains of the axis that takes the largest share of its Z-width, in its map; None if none can be drawn."""
    if analysis.mass is None or analysis.stiffness is None or analysis.damping is None:
        return None
    mass = analysis.mass if analysis.mass.ndim == 2 else analysis.mass[0]
    masses = 1.0 / np.diagonal(np.linalg.inv(mass))
    shares = []
    for i in range(len(masses)):
        full = _map(float(masses[i]), period, float(friction[i]), velocity, delay_steps)
        if full is not None:
            shares.append((float(analysis.stiffness[:, i, i].max() / full.largest[0]), i))
    if not shares:
        return None
    _, axis = max(shares)
    k, b = analysis.stiffness[:, axis, axis], analysis.damping[:, axis, axis]
    full = _map(float(masses[axis]), period, float(friction[axis]), velocity, delay_steps)
    assert full is not None
    spans = [_span(gain, float(np.nanmax(full.edge[:, i]))) for i, gain in enumerate((k, b))]
    drawn = stability.z_width(
        float(masses[axis]),
        period=period,
        stiffness=np.geomspace(*spans[0], 200),
        damping=np.geomspace(*spans[1], 200),
        physical_damping=float(friction[axis]),
        velocity=velocity,
        delay_steps=delay_steps,
    )
    figure = drawn.plot()
    panel = figure.axes[0]
    kilo = 1e3 if "kN" in panel.get_xlabel() else 1.0
    panel.plot(k / kilo, b, "o", color="#b3261e", ms=3.5, mew=0, zorder=6, label="the gains")
    if analysis.axes[axis] in AXES[3:]:
        panel.set_xlabel(_turned(panel.get_xlabel(), analysis.axes[axis]))
        panel.set_ylabel(_turned(panel.get_ylabel(), analysis.axes[axis]))
        panel.set_title(
            _turned(panel.get_title(), analysis.axes[axis]).replace(" kg,", " kg m²,"), fontsize=9
        )
    panel.set_xscale("log")
    panel.set_yscale("log")
    handles, labels = panel.get_legend_handles_labels()
    old = panel.get_legend()
    if old is not None:
        handles = [*old.legend_handles, *handles]
        labels = [*(_turned(text.get_text(), analysis.axes[axis]) for text in old.get_texts()), *labels]
    panel.legend(handles, labels, fontsize=8, loc="lower right", framealpha=0.9)
    return figure, analysis.axes[axis]


def _map(
    mass: float, period: float, friction: float, velocity: str, delay_steps: int
) -> stability.ZWidth | None:
    try:
        found = stability.z_width(
            mass, period=period, physical_damping=friction, velocity=velocity, delay_steps=delay_steps
        )
    except ValueError:
        return None
    return found if np.isfinite(found.largest).all() else None


def _turned(text: str, axis: str) -> str:
    """Units of a rotation instead of a translation."""
    return text.replace("N/m", "Nm/rad").replace("Ns/m", "Nms/rad") if axis in AXES[3:] else text


def _span(gains: Array, top: float) -> tuple[float, float]:
    """Ends of a logarithmic axis that holds the gains and the edge."""
    least = float(gains[gains > 0].min()) if (gains > 0).any() else top
    return max(min(least / BELOW, 0.1 * top), 1e-9 * top), 1.3 * max(top, float(gains.max()))
