"""The passive environment - a spring, a mass, one of them with a damper - that makes an active port unstable."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vic_toolbox.stability.environments.axis_crossings import axis_crossings
from vic_toolbox.stability.environments.positive_real import Rational

UNSTABLE = 1e-7
"""Real part of a root that counts; rates are of order one."""
TRIED = 41
"""Gains tried in a range for the fastest growth."""
REACH = 1e3
"""How far into an unbounded range they reach."""
DAMPERS = (0.0, 0.25, 0.5, 0.75, 0.9, 0.97, 0.99, 0.999)
"""Shares of the damping with which the roots would stay on the axis."""


class Environment(NamedTuple):
    """``u = −(integral ∫y + proportional y + derivative ẏ)``: a spring, a damper, a mass on an admittance."""

    integral: float
    proportional: float
    derivative: float

    def growth(self, port: Rational) -> float:
        """Largest real part of a root of port and environment."""
        bottom = port.bottom if self.integral == 0 else np.polymul(port.bottom, [1.0, 0.0])
        terms = [self.derivative, self.proportional, self.integral]
        terms = terms if self.integral else terms[:2]
        roots = np.roots(np.polyadd(bottom, np.polymul(port.top, np.trim_zeros(terms, "f"))))
        return float(roots.real.max(initial=-np.inf))


def destabilising_gains(port: Rational, *, derivative: bool) -> list[tuple[float, float]]:
    """Ranges of the integral (spring) or the derivative (mass) gain alone that make the port unstable."""
    first, second = (
        (port.bottom, np.polymul(port.top, [1.0, 0.0]))
        if derivative
        else (np.polymul(port.bottom, [1.0, 0.0]), port.top)
    )
    if not np.any(second):
        return []
    bounds = [0.0, *(edge.gain for edge in axis_crossings(first, second)), np.inf]
    ranges: list[tuple[float, float]] = []
    for low, high in pairwise(bounds):
        if high <= low * (1 + 1e-9):
            continue
        gain = 2 * low or 1.0 if high == np.inf else 0.5 * high if low == 0 else np.sqrt(low * high)
        if _only(gain, derivative).growth(port) > UNSTABLE:
            joined = bool(ranges) and ranges[-1][1] >= low * (1 - 1e-9)
            ranges[-1:] = [(ranges[-1][0], high)] if joined else [*ranges[-1:], (low, high)]
    return ranges


def destabilising_environment(
    port: Rational, springs: list[tuple[float, float]], masses: list[tuple[float, float]], frequency: float
) -> Environment | None:
    """The simplest one found: a spring, a mass, then with a damper that fits the port at `frequency`.

    Where ``Re G(jω) < 0`` the positive number ``p = Re(−1/G)`` with a spring or a mass for the imaginary part puts a
    root exactly on jω; with less damping it is on the right.
    """
    for derivative, ranges in ((False, springs), (True, masses)):
        for low, high in ranges:
            first, last = low or min(high, REACH) / REACH, high if np.isfinite(high) else (low or 1.0) * REACH
            inner = np.geomspace(first, last, TRIED + 2)[1:-1]
            tried = [_only(gain, derivative) for gain in inner]
            best = max(tried, key=lambda one: one.growth(port))
            if best.growth(port) > UNSTABLE:
                return best
    best = max(_fitted(port, frequency), key=lambda one: one.growth(port), default=None)
    return best if best is not None and best.growth(port) > UNSTABLE else None


def _fitted(port: Rational, frequency: float) -> Iterator[Environment]:
    tried = [frequency * f for f in (1.0, 0.9, 1.1, 0.5, 2.0)] if 0 < frequency < np.inf else []
    for one in [*tried, *np.geomspace(1e-2, 1e2, 41)]:
        value = complex(port(np.array(1j * one)))
        if value.real >= 0 or value == 0:
            continue
        wanted = -1 / value
        for share in DAMPERS:
            spring, mass = max(-wanted.imag * one, 0.0), max(wanted.imag / one, 0.0)
            yield Environment(spring, share * wanted.real, mass)


def _only(gain: float, derivative: bool) -> Environment:
    return Environment(0.0, 0.0, float(gain)) if derivative else Environment(float(gain), 0.0, 0.0)


def coupled(
    dynamics: np.ndarray, push: np.ndarray, measure: np.ndarray, through: float, environment: Environment
) -> np.ndarray:
    """Of a port ``ẋ = A x + b u``, ``y = c x + d u`` with an environment: states x, ∫y (and u if d and ẏ act)."""
    size = len(push)
    i, p, m = environment
    row = np.concatenate([measure, [0.0]])  # of y without d u
    driven = np.concatenate([push, [0.0]])
    whole = np.zeros((size + 1, size + 1))
    whole[:size, :size] = dynamics
    whole[size] = row
    driven[size] = through
    wanted = p * row + m * row[:size] @ whole[:size] if m else p * row
    wanted = wanted + i * np.eye(size + 1)[size]
    if m == 0 or through == 0:
        factor = 1 + p * through + m * float(measure @ push)
        return whole + np.outer(driven, -wanted / factor)
    # m d u̇ = −(wanted + (1 + p d + m c b) u)
    more = np.zeros((size + 2, size + 2))
    more[:-1, :-1], more[:-1, -1] = whole, driven
    more[-1, :-1] = -wanted / (m * through)
    more[-1, -1] = -(1 + p * through + m * float(measure @ push)) / (m * through)
    return more
