"""Linear loops with a delay: roots on the right counted by the argument principle, found by collocation, motions."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import expm

from vic_toolbox.stability.environments.contact_loop import Quasipolynomial

STEP = 0.4
"""Largest change of the argument between two frequencies [rad]."""
ROUNDS = 40
"""Most halvings of the frequencies where it changes more."""
NODES = 40
"""Of the collocation on [−τ, 0]: roots with ``|s| τ < 15`` to rounding."""
HISTORY = 64
"""Steps per delay of the motion's other route."""


def unstable_roots(characteristic: Quasipolynomial) -> int | None:
    """Roots with Re s > 0 of ``P + e^{−sτ} Q``, by the argument principle; None if one is on the axis.

    ``g = (P + e^{−sτ} Q)/(s + 1)ⁿ`` is analytic on the right and 1 at infinity: the roots there are ``−Δ arg g/π`` as s
    goes from 0 to j∞.
    """
    order = len(characteristic.own) - 1
    highest = _highest(characteristic)
    frequency = np.concatenate([[0.0], np.geomspace(1e-6, highest, 800)])
    if characteristic.delay > 0:
        turning = np.linspace(0.0, min(highest, 4000.0 / characteristic.delay), 8000)[1:]
        frequency = np.unique(np.concatenate([frequency, turning]))
    value = _normalised(characteristic, frequency, order)
    for _ in range(ROUNDS):
        if not np.isfinite(value).all() or (value == 0).any():
            return None
        turn = np.angle(value[1:] / value[:-1])
        sharp = np.flatnonzero(np.abs(turn) > STEP)
        if not len(sharp):
            break
        between = 0.5 * (frequency[sharp] + frequency[sharp + 1])
        frequency = np.insert(frequency, sharp + 1, between)
        value = np.insert(value, sharp + 1, _normalised(characteristic, between, order))
    else:
        return None  # a root on the axis: the argument jumps however fine the grid
    total = turn.sum() - np.angle(value[-1])  # what is left turns to g(j∞) = 1
    return round(-float(total) / math.pi)


def _normalised(characteristic: Quasipolynomial, frequency: np.ndarray, order: int) -> np.ndarray:
    s = 1j * frequency
    return characteristic(s) / (s + 1) ** order


def _highest(characteristic: Quasipolynomial) -> float:
    """Frequency above which the leading power is 100 times all others."""
    weights = np.abs(characteristic.own[1:]) + np.abs(characteristic.late[1:])
    powers = np.arange(1, len(weights) + 1)
    return 100 * len(weights) * float(max(1.0, np.max(weights ** (1 / powers))))


def generator(dynamics: np.ndarray, late: np.ndarray, delay: float) -> tuple[np.ndarray, np.ndarray]:
    """Chebyshev collocation of ``ẋ = A x + A_τ x(t − τ)`` on the history, now first; and its nodes.

    Breda, Maset, Vermiglio, SIAM J. Sci. Comput. 27 (2005).
    """
    size = len(dynamics)
    nodes = np.cos(np.pi * np.arange(NODES + 1) / NODES)
    ends = np.ones(NODES + 1)
    ends[[0, -1]] = 2.0
    ends *= (-1.0) ** np.arange(NODES + 1)
    spread = nodes[:, None] - nodes + np.eye(NODES + 1)
    slope = np.outer(ends, 1 / ends) / spread
    slope -= np.diag(slope.sum(axis=1))
    whole = np.kron(2 / delay * slope, np.eye(size))
    whole[:size] = 0.0
    whole[:size, :size], whole[:size, -size:] = dynamics, late
    return whole, 0.5 * delay * (nodes - 1)


def rightmost_root(characteristic: Quasipolynomial, dynamics: np.ndarray, late: np.ndarray) -> complex | None:
    """The root with the largest real part, from the collocation and from dips on the axis, by Newton; or None."""
    if characteristic.delay == 0:
        roots = np.linalg.eigvals(dynamics + late)
        return complex(roots[np.argmax(roots.real)])
    roots = np.linalg.eigvals(generator(dynamics, late, characteristic.delay)[0])
    roots = roots[np.argsort(-roots.real)[:8]]
    # fast roots are beyond the collocation: they show as dips along the axis
    frequency = np.geomspace(1e-3, _highest(characteristic), 4000)
    size = np.log(np.abs(_normalised(characteristic, frequency, len(characteristic.own) - 1)) + 1e-300)
    dips = np.flatnonzero((size[1:-1] < size[:-2]) & (size[1:-1] < size[2:])) + 1
    deepest = dips[np.argsort(size[dips])[:12]]
    starts = np.concatenate([roots, 1j * frequency[deepest]])
    own, behind = np.polyder(characteristic.own), np.polyder(characteristic.late)
    found = []
    for s in starts:
        for _ in range(30):
            shift = np.exp(-s * characteristic.delay)
            slope = np.polyval(own, s) + shift * (
                np.polyval(behind, s) - characteristic.delay * np.polyval(characteristic.late, s)
            )
            step = characteristic(s) / slope if slope else np.inf
            s = s - step
            if not np.isfinite(s) or abs(step) <= 1e-13 * max(1.0, abs(s)):
                break
        if np.isfinite(s) and abs(step) <= 1e-10 * max(1.0, abs(s)):
            found.append(complex(s))
    return max(found, key=lambda s: s.real) if found else None


def collocated(dynamics: np.ndarray, late: np.ndarray, delay: float, root: complex) -> bool:
    """Whether the collocation has that rightmost root, and none further right that is its own."""
    rightmost = np.linalg.eigvals(generator(dynamics, late, delay)[0]).real.max()
    return bool(abs(rightmost - root.real) <= 1e-6 * max(1.0, abs(root)))


def collocated_step(
    dynamics: np.ndarray, late: np.ndarray, delay: float, step: float
) -> tuple[np.ndarray, np.ndarray]:
    """Map of the history over a step, and the history of a state that rested: (map, repeats of the state)."""
    whole, nodes = generator(dynamics, late, delay)
    return expm(whole * step), np.kron(np.ones((len(nodes), 1)), np.eye(len(dynamics)))


def stepped(dynamics: np.ndarray, late: np.ndarray, delay: float) -> tuple[np.ndarray, np.ndarray, float]:
    """The other route: variation of constants on a grid of the history; (map, repeats of the state, step).

    What comes late is a parabola in each step, from the cubic through the history, and is integrated exactly against
    ``e^{A s}``: a filter far faster than the delay does no harm.
    """
    size, step = len(dynamics), delay / HISTORY
    chain = np.zeros((4 * size, 4 * size))
    chain[:size, :size] = dynamics
    for i in range(3):
        chain[i * size : (i + 1) * size, (i + 1) * size : (i + 2) * size] = np.eye(size)
    # ∫ e^{A (h − s)} sᵏ/k! ds for k = 0, 1, 2
    whole, flat, ramp, bow = np.split(np.asarray(expm(chain * step))[:size], 4, axis=1)
    begin = flat - 3 * ramp / step + 4 * bow / step**2
    half = 4 * ramp / step - 8 * bow / step**2
    end = -ramp / step + 4 * bow / step**2

    past = HISTORY + 2  # x_n … x_{n − m − 1}
    first = np.zeros((size, size * past))
    first[:, :size] = whole
    middle = zip((1, 0, -1, -2), (-1, 9, 9, -1), strict=True)
    shares = [(0, begin), (-1, end), *((shift, weight / 16 * half) for shift, weight in middle)]
    for shift, share in shares:
        ago = (HISTORY + shift) * size
        first[:, ago : ago + size] += share @ late
    matrix = np.zeros((size * past, size * past))
    matrix[:size] = first
    matrix[size:, :-size] = np.eye(size * (past - 1))
    return matrix, np.kron(np.ones((past, 1)), np.eye(size)), step
