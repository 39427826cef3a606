"""The picture of a verdict: what shows it, in the panels that its witness and numbers allow.

A counter-example is drawn as the motion that grows, its energy and its gains; a certificate as what it compares over
time, the multipliers and the unit circle, or the level set of its storage function. Where there is nothing to draw, the
numbers are written.
"""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.errors import Array
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOURS = {"proved": "#00785a", "disproved": "#b3400a", "inconclusive": "#5f6b7a"}
INK, QUIET = "#1f2933", "#8a94a1"
NEEDED, ALLOWED, CHOSEN = "#0072b2", "#009e73", "#d55e00"
AXES_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#44546a")
WIDTH, PANEL, HEAD = 7.2, 1.9, 0.75
"""Size of the figure, of a panel and of the headline [inch]."""
MULTIPLIERS = ("multipliers", "eigenvalues")
LOGARITHMIC = 20.0
"""Ratio of energies above which their axis is logarithmic."""

Panel = Callable[["Axes"], None]


def draw(verdict: Verdict) -> Figure:
    """Draw one verdict; the figure belongs to no window."""
    over_time, square = _over_time(verdict), _square(verdict)
    if not over_time and not square:
        over_time = [lambda axes: _card(axes, verdict)]
    rows = max(len(over_time), 1)
    height = HEAD + max(PANEL * rows, 3.4 if square else 2.6)
    figure = Figure(figsize=(WIDTH + 2.6 * bool(square and over_time), height), layout="constrained")
    halves: Any = figure.subfigures(2, 1, height_ratios=(HEAD, height - HEAD))
    head, body = halves
    _headline(head, verdict)
    left, right = body, body
    if square and over_time:
        left, right = body.subfigures(1, 2, width_ratios=(1.7, 1.0))
    if over_time:
        shared = left.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for axes, panel in zip(shared, over_time, strict=True):
            _quiet(axes)
            panel(axes)
        if not shared[-1].axison:
            return figure
        shared[-1].set_xlabel("time [s]", fontsize=8.5)
    if square:
        axes = right.subplots()
        _quiet(axes)
        square[0](axes)
    return figure


def _headline(place: Any, verdict: Verdict) -> None:
    colour = COLOURS[verdict.status]
    margin = (
        f"margin {verdict.margin:.4g} {verdict.margin_unit}"
        if np.isfinite(verdict.margin)
        else verdict.reason
    )
    place.text(0.012, 0.93, verdict.status, color=colour, fontsize=12, weight="bold", va="top")
    # the widest status word takes a sixth of the width
    place.text(0.175, 0.92, _cut(verdict.question, 95), color=INK, fontsize=9, va="top")
    place.text(0.175, 0.55, _cut(verdict.method, 110), color=QUIET, fontsize=7.5, va="top")
    place.text(0.175, 0.22, _cut(margin, 110), color=QUIET, fontsize=7.5, va="top")


def _over_time(verdict: Verdict) -> list[Panel]:
    """Panels that share the axis of time."""
    panels: list[Panel] = []
    witness, values = verdict.witness, verdict.values
    if "profile_time" in values:
        panels.append(lambda axes: _profile(axes, values))
    if isinstance(witness, CounterExample):
        same = "profile_time" not in values or witness.time[-1] <= 1.5 * values["profile_time"][-1]
        panels = panels if same else []
        example = witness
        panels += [lambda axes: _errors(axes, example), lambda axes: _energy(axes, example)]
        panels += [
            lambda axes, name=name: _gains(axes, example.time, name, example.gains[name])
            for name in ("stiffness", "damping")
            if _changes(example, name)
        ]
    return panels


def _changes(witness: CounterExample, name: str) -> bool:
    gains = np.asarray(witness.gains.get(name, 0.0))
    return gains.ndim > 0 and len(gains) == len(witness.time) and bool(np.ptp(gains, axis=0).any())


def _square(verdict: Verdict) -> list[Panel]:
    """Panels that have their own axes; the first one is drawn."""
    panels: list[Panel] = []
    for name in MULTIPLIERS:
        if name in verdict.values and "spectral_radius" in verdict.values:
            panels.append(lambda axes, name=name: _circle(axes, np.asarray(verdict.values[name])))
    witness = verdict.witness
    if isinstance(witness, Certificate) and np.ndim(witness.values.get("P", 0.0)) == 2:
        panels.append(lambda axes: _storage(axes, np.asarray(witness.values["P"])))
    return panels


def _profile(axes: Axes, values: Any) -> None:
    """α that the gains need, α that the damping allows, and α(t) where there is one."""
    t = np.asarray(values["profile_time"])
    needed, allowed = values.get("profile_needed"), np.asarray(values["profile_allowed"])
    axes.plot(t, allowed, color=ALLOWED, label="the damping allows less than")
    if needed is not None:
        shown = np.clip(np.nan_to_num(np.asarray(needed), nan=0.0, posinf=np.inf), 0, None)
        axes.plot(t, shown, color=NEEDED, label="the rising gains need more than")
        axes.fill_between(t, shown, allowed, where=shown > allowed, color=CHOSEN, alpha=0.18, linewidth=0)
    if "profile_alpha" in values:
        axes.plot(t, values["profile_alpha"], color=CHOSEN, label="α(t)")
    chosen = np.asarray(values.get("profile_chosen", np.nan))
    if np.isfinite(chosen):
        axes.axhline(
            float(chosen), color=CHOSEN, linewidth=1.2, linestyle=(0, (4, 2)), label="α of the certificate"
        )
    axes.set(ylabel="α [1/s]", xlim=(t[0], t[-1]))
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    axes.legend(fontsize=7.5, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0, 1.0), borderpad=0)


def _errors(axes: Axes, witness: CounterExample) -> None:
    size = witness.gains["stiffness"].shape[-1] if np.ndim(witness.gains.get("stiffness", 0.0)) == 3 else 0
    count = size or max(witness.state.shape[1] // 2, 1)
    for k in range(count):
        axes.plot(
            witness.time, witness.state[:, k], color=AXES_COLOURS[k % len(AXES_COLOURS)], label=f"{k + 1}"
        )
    axes.set_ylabel("error e" if count > 1 else "error e [m]")
    axes.axhline(0, color=QUIET, linewidth=0.6, zorder=0)
    if 1 < count <= 7:
        axes.legend(
            fontsize=7, frameon=False, ncols=count, loc="lower left", bbox_to_anchor=(0, 1.0), borderpad=0
        )


def _energy(axes: Axes, witness: CounterExample) -> None:
    energy = witness.energy
    axes.plot(witness.time, energy, color=COLOURS["disproved"])
    if energy.min() > 0 and energy.max() > LOGARITHMIC * energy.min():
        axes.set_yscale("log")
    axes.set_ylabel("energy [J]")
    axes.set_title(
        "\n".join(textwrap.wrap(witness.description, 108)), fontsize=7.5, color=QUIET, loc="left", pad=3
    )


def _gains(axes: Axes, t: Array, name: str, gains: Array) -> None:
    """Eigenvalues of a gain matrix, held from each instant to the next."""
    values = np.linalg.eigvalsh(gains) if np.ndim(gains) == 3 else np.reshape(gains, (len(t), -1))
    for k in range(values.shape[1]):
        axes.plot(t, values[:, k], color=AXES_COLOURS[k % len(AXES_COLOURS)], linewidth=1.1)
    units = {"stiffness": "N/m", "damping": "Ns/m"}
    axes.set_ylabel(f"{name} [{units[name]}]" if values.shape[1] == 1 else f"{name}, eigenvalues", fontsize=8)


def _circle(axes: Axes, multipliers: Array) -> None:
    angle = np.linspace(0, 2 * np.pi, 361)
    axes.plot(np.cos(angle), np.sin(angle), color=QUIET, linewidth=1.0)
    inside = np.abs(multipliers) <= 1
    for where, colour in ((inside, COLOURS["proved"]), (~inside, COLOURS["disproved"])):
        some = multipliers[where]
        axes.plot(some.real, some.imag, "o", color=colour, markersize=6, clip_on=False)
    reach = 1.08 * max(1.1, float(np.abs(multipliers).max()))
    axes.set(aspect="equal", xlim=(-reach, reach), ylim=(-reach, reach), xlabel="real", ylabel="imaginary")
    axes.set_title("multipliers and unit circle", fontsize=8, loc="left", color=INK)


def _storage(axes: Axes, p: Array) -> None:
    """Level set of V for one axis; the matrix itself for more."""
    if len(p) == 2:
        angle = np.linspace(0, 2 * np.pi, 361)
        values, vectors = np.linalg.eigh(p / np.trace(p))
        ring = vectors @ (
            np.stack([np.cos(angle), np.sin(angle)]) / np.sqrt(np.maximum(values, 1e-12))[:, None]
        )
        axes.plot(*ring, color=COLOURS["proved"])
        axes.set(xlabel="e (scaled)", ylabel="ė (scaled)", aspect="equal")
        axes.set_title("level set of V", fontsize=8, loc="left", color=INK)
        return
    size = np.sqrt(np.diagonal(p))
    axes.imshow(p / (size[:, None] * size), cmap="PuOr_r", vmin=-1, vmax=1)
    axes.grid(visible=False)
    axes.set(xticks=[], yticks=[])
    axes.set_title("P, unit diagonal", fontsize=8, loc="left", color=INK)


def _card(axes: Axes, verdict: Verdict) -> None:
    """The numbers, in words."""
    axes.set_axis_off()
    lines = verdict.summary().splitlines()[2:]
    text = "\n".join(part for line in lines for part in textwrap.wrap(line.strip(), 118))
    axes.text(0, 1, text, fontsize=8, color=INK, va="top", transform=axes.transAxes)


def _quiet(axes: Axes) -> None:
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=7.5, colors=QUIET, labelcolor=INK)
    axes.yaxis.label.set_fontsize(8.5)
    axes.grid(color="#e4e7eb", linewidth=0.7)
    axes.set_axisbelow(True)


def _cut(text: str, width: int) -> str:
    return textwrap.shorten(text, width, placeholder=" …")
