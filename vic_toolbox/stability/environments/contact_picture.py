"""The picture of a contact: Nyquist curve, poles as the environment stiffens, contact force after a step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import control
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.stability.environments.contact_systems import frequency_response, poles

if TYPE_CHECKING:
    from vic_toolbox.stability.environments.contact import Contact

CURVE = 2000
STIFFNESSES = 160
SHOWN = 3.0
"""Half width of the Nyquist picture, where the point −1 is one away."""


def draw(found: Contact) -> Figure:
    """Four pictures of one contact."""
    figure = Figure(figsize=(10, 7.4), layout="constrained")
    axes = figure.subplots(2, 2)
    _nyquist(axes[0, 0], found)
    stiffnesses = _stiffnesses(found)
    every = [poles(found._numbers, k) for k in stiffnesses]
    _locus(axes[0, 1], found, stiffnesses, every, figure)
    _step(axes[1, 0], found)
    _decay(axes[1, 1], found, stiffnesses, every)
    largest = found.values["max_environment_stiffness"]
    figure.suptitle(f"{found.question}  {found.status}; largest K_e {largest:.5g} N/m", fontsize=11)
    return figure


def _stiffnesses(found: Contact) -> np.ndarray:
    largest = found.values["max_environment_stiffness"]
    centre = largest if 0 < largest < np.inf else found.environment or found._numbers.unit
    return centre * np.geomspace(1e-3, 1e2 if largest == np.inf else 10.0, STIFFNESSES)


def _nyquist(axes: Axes, found: Contact) -> None:
    loop = found._numbers
    highest = np.pi / loop.period if loop.period > 0 else 1e4 * loop.rate
    frequency = np.geomspace(1e-4 * loop.rate, highest, CURVE)
    curve = frequency_response(loop, found.environment, frequency)
    curve = np.where(np.abs(curve) < 20 * SHOWN, curve, np.nan)  # no lines through infinity
    axes.plot(np.real(curve), np.imag(curve), color="C0", label="ω > 0")
    axes.plot(np.real(curve), -np.imag(curve), color="C0", linestyle=":", label="ω < 0")
    turn = np.linspace(0, 2 * np.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color="0.8", linewidth=0.8, zorder=0)
    axes.plot(-1, 0, "+", color="C3", markersize=11, markeredgewidth=2, label="−1")
    axes.set(xlim=(-SHOWN, SHOWN), ylim=(-SHOWN, SHOWN), aspect="equal", xlabel="Re L", ylabel="Im L")
    axes.set_title(f"Nyquist curve at K_e = {found.environment:.5g} N/m", fontsize=10)
    axes.legend(fontsize=8, loc="upper right")
    axes.grid(alpha=0.3)


def _locus(
    axes: Axes, found: Contact, stiffnesses: np.ndarray, every: list[np.ndarray], figure: Figure
) -> None:
    held = found._numbers.period > 0
    points = np.concatenate(every)
    colour = np.concatenate([np.full(len(p), k) for p, k in zip(every, stiffnesses, strict=True)])
    drawn = axes.scatter(np.real(points), np.imag(points), c=np.log10(colour), s=5, cmap="viridis")
    figure.colorbar(drawn, ax=axes, label="log₁₀ K_e [N/m]")
    edge = found.values["max_environment_stiffness"]
    if 0 < edge < np.inf:
        at_edge = poles(found._numbers, edge)
        axes.plot(
            np.real(at_edge), np.imag(at_edge), "x", color="C3", markersize=6, label="at the largest K_e"
        )
        axes.legend(fontsize=8, loc="upper right")
    if held:
        turn = np.linspace(0, 2 * np.pi, 200)
        axes.plot(np.cos(turn), np.sin(turn), color="k", linewidth=0.8)
        axes.set(aspect="equal", xlabel="Re z", ylabel="Im z")
    else:
        axes.axvline(0, color="k", linewidth=0.8)
        # far poles of a filter or a delay would hide the bounce
        fastest = 2 * max(np.abs(p[np.argmax(np.real(p))]) for p in every)
        axes.set(
            xlim=(-fastest, 0.5 * fastest), ylim=(-fastest, fastest), xlabel="Re s [1/s]", ylabel="Im s [1/s]"
        )
    axes.set_title("poles as the environment stiffens", fontsize=10)
    axes.grid(alpha=0.3)


def _step(axes: Axes, found: Contact) -> None:
    system = found.closed_loop()
    slowest = np.abs(found.values.get("decay_rate", np.nan))
    rate = found._numbers.rate
    horizon = 5 / slowest if np.isfinite(slowest) and slowest > rate / 20 else 60 / rate
    period = found._numbers.period
    time = np.arange(max(int(horizon / period), 2) + 1) * period if period else np.linspace(0, horizon, 1500)
    time, force = control.step_response(system, T=time)
    axes.step(time, force, where="post") if period else axes.plot(time, force)
    if np.abs(force).max() > 20:
        axes.set_ylim(-20, 20)
    axes.set(xlabel="time [s]", ylabel="contact force [N]")
    axes.set_title(f"after a force command of 1 N, K_e = {found.environment:.5g} N/m", fontsize=10)
    axes.grid(alpha=0.3)


def _decay(axes: Axes, found: Contact, stiffnesses: np.ndarray, every: list[np.ndarray]) -> None:
    period = found._numbers.period
    rates = [-np.log(np.abs(p).max()) / period if period else -np.real(p).max() for p in every]
    axes.semilogx(stiffnesses, rates, color="C0")
    axes.axhline(0, color="k", linewidth=0.8)
    for low, high in found.values["stable_ranges"]:
        low, high = max(low, stiffnesses[0]), min(high, stiffnesses[-1])
        if low < high:
            axes.axvspan(low, high, color="C2", alpha=0.15)
    axes.set(xlim=stiffnesses[[0, -1]], xlabel="environment stiffness K_e [N/m]", ylabel="decay rate [1/s]")
    axes.set_title("decay of the slowest mode; green: stable", fontsize=10)
    axes.grid(alpha=0.3)
