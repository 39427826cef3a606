"""Windows with axes on their own: least squares and its non-negative form, in closed form.

Each axis of each window fits ``f = k e + b v``: two unknowns. With u = v − r e, r = Σev/Σe² (Gram-Schmidt),

    b = Σuf / Σu²,   k = (Σef − b Σev) / Σe²,   var b = σ²/Σu²,   var k = σ² (1/Σe² + r²/Σu²).

Taking u sample by sample costs a second pass and keeps half of the digits that ``Σe² Σv² − (Σev)²`` loses: over ten
samples e and v are nearly parallel. For k, b ≥ 0 the least-squares point is the answer where it is feasible; else
one of them is zero, and the better of the two one-gain fits is (the problem is convex in two variables).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation.samples import Samples

CHUNK = 2048
"""Windows worked on at a time: small enough for the processor's cache."""
STILL = 1e-100
"""Sum of squares below which nothing moves; a gain from it would overflow."""
RANK = 1e-12
"""Smallest share of v (squared) at a right angle to e for the two to be told apart in floating point."""


@dataclass(frozen=True, eq=False)
class AxisWindows:
    """Gains of every window and axis; each array has shape (m, 6).

    Parameters
    ----------
    stiffness, damping : ndarray
        NaN where floating point does not determine them.
    stiffness_variance, damping_variance : ndarray
        Variance for noise of variance one: the inverse of the information; infinite without information.
    condition : ndarray
        Condition number of the information about (k, b), each scaled to unit information.
    squares : ndarray
        Σ (f − k e − b v)² of the unconstrained fit.
    """

    stiffness: Array
    damping: Array
    stiffness_variance: Array
    damping_variance: Array
    condition: Array
    squares: Array


def window_sum(x: Array, window: int, step: int, count: int) -> Array:
    """Sums over `count` windows that start every `step` rows, by direct addition (no cancellation)."""
    stop = (count - 1) * step + 1
    total = x[:stop:step].copy()
    for k in range(1, window):
        total += x[k : k + stop : step]
    return total


def window_count(n: int, window: int, step: int) -> int:
    """Number of windows in n samples."""
    return (n - window) // step + 1


def diagonal_windows(data: Samples, window: int, *, step: int = 1, positive: bool = False) -> AxisWindows:
    """Fit every window and axis.

    Parameters
    ----------
    data : Samples
    window : int
        Samples in a window, at most all of them.
    step : int, optional
        Samples from one window to the next.
    positive : bool, optional
        Ask for k ≥ 0 and b ≥ 0. Variances and squares stay those of the unconstrained fit.
    """
    count = window_count(len(data), window, step)
    result = np.empty((6, count, 6))
    for first in range(0, count, CHUNK):
        size = min(CHUNK, count - first)
        rows = slice(first * step, (first + size - 1) * step + window)
        result[:, first : first + size] = _chunk(
            data.error[rows], data.rate[rows], data.wrench[rows], window, step, size, positive
        )
    return AxisWindows(*result)


def _chunk(e: Array, v: Array, f: Array, window: int, step: int, count: int, positive: bool) -> list[Array]:
    a, c, s = (window_sum(x, window, step, count) for x in (e * e, v * v, e * v))
    a, c = np.where(a > STILL, a, 0.0), np.where(c > STILL, c, 0.0)
    p = window_sum(e * f, window, step, count)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(a > 0, s / a, 0.0)
        start = np.where(a > 0, p / a, 0.0)
        d, q, squares = (np.zeros_like(a) for _ in range(3))
        stop = (count - 1) * step + 1
        for k in range(window):
            row = slice(k, k + stop, step)
            u = v[row] - ratio * e[row]
            g = f[row] - start * e[row]
            d += u * u
            q += u * g
            squares += g * g
        apart = d > RANK * c
        b = np.where(apart, q / d, np.nan)
        k_seen = (a > 0) & (apart | (c == 0))
        b_alone = np.where(c > 0, (q + start * s) / c, 0.0)  # Σvf / Σv²
        k = np.where(k_seen, start - np.where(c > 0, b, 0.0) * ratio, np.nan)
        squares -= np.where(apart, b * q, 0.0)
        k_variance = np.where(k_seen, 1 / a + np.where(c > 0, ratio**2 / d, 0.0), np.inf)
        b_variance = np.where(apart, 1 / d, np.inf)
        correlation = np.sqrt(np.clip(1 - d / c, 0.0, 1.0))
        condition = np.where(apart & (a > 0), (1 + correlation) / (1 - correlation), np.inf)
        if positive:
            infeasible = (k < 0) | (b < 0)
            k_gain, b_gain = np.maximum(start, 0.0), np.maximum(b_alone, 0.0)
            spring = k_gain**2 * a >= b_gain**2 * c  # how much either takes off the squares
            # where only one gain is known the other is NaN, and it alone is bounded
            k_bounded = np.where(np.isnan(b), np.maximum(k, 0.0), np.where(spring, k_gain, 0.0))
            b_bounded = np.where(np.isnan(k), np.maximum(b, 0.0), np.where(spring, 0.0, b_gain))
            k, b = np.where(infeasible, k_bounded, k), np.where(infeasible, b_bounded, b)
    return [k, b, k_variance, b_variance, condition, np.maximum(squares, 0.0)]
