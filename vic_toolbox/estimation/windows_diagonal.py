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

CHUNK = 4096
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
    independence : ndarray
        Share of Σv² at a right angle to e: zero where k and b cannot be told apart.
    squares : ndarray
        Σ (f − k e − b v)² of the unconstrained fit.
    """

    stiffness: Array
    damping: Array
    stiffness_variance: Array
    damping_variance: Array
    independence: Array
    squares: Array

    @property
    def condition(self) -> Array:
        """Condition number of the information about (k, b), each scaled to unit information."""
        correlation = np.sqrt(np.clip(1 - self.independence, 0.0, 1.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            known = np.isfinite(self.stiffness_variance) & np.isfinite(self.damping_variance)
            return np.where(known, (1 + correlation) / (1 - correlation), np.inf)


def window_sum(x: Array, window: int, step: int, count: int) -> Array:
    """Sums over `count` windows that start every `step` rows, by additions alone (no cancellation).

    A window is put together from pieces whose lengths are powers of two, each the sum of two of half its length:
    about 2 log₂(window) additions of the whole array. Where windows are far apart, it is added row by row.
    """
    stop = (count - 1) * step + 1
    if step * 2 * window.bit_length() > window + 2:
        total = x[:stop:step].copy()
        for k in range(1, window):
            total += x[k : k + stop : step]
        return total
    total, piece, length, start = None, x, 1, 0
    while length <= window:
        if window & length:
            part = piece[start : start + stop : step]
            total = part.copy() if total is None else np.add(total, part, out=total)
            start += length
        length *= 2
        if length <= window:
            piece = piece[: -length // 2] + piece[length // 2 :]
    assert total is not None
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
    a, c, s, p = (window_sum(x, window, step, count) for x in (e * e, v * v, e * v, e * f))
    a[a <= STILL], c[c <= STILL] = 0.0, 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1 / a
        if a.all():
            ratio, start = s * inverse, p * inverse
        else:
            ratio, start = (np.where(a > 0, x * inverse, 0.0) for x in (s, p))
        d, q, squares = _second_pass(e, v, f, ratio, start, window, step)
        together = d <= RANK * c + STILL
        alone = together.any()
        if alone:
            d[together] = 0.0
        b_variance = 1 / d
        b = q * b_variance
        k = start - b * ratio
        k_variance = inverse + ratio * ratio * b_variance
        independence = d / c
        if alone:  # what e and v do not tell apart; an axis of which only one moves has that one gain
            b[together] = np.nan
            k = np.where(c > 0, k, start)
            k_variance = np.where(together & (c > 0), np.inf, np.where(c > 0, k_variance, inverse))
            independence = np.where(together, 0.0, independence)
        k[~np.isfinite(k_variance)] = np.nan
        squares -= np.where(together, 0.0, b * q) if alone else b * q
        if positive and (infeasible := (k < 0) | (b < 0)).any():
            k[infeasible], b[infeasible] = _bounded(
                *(x[infeasible] for x in (k, b, start, (q + start * s) / c, a, c))
            )
    return [k, b, k_variance, b_variance, independence, np.maximum(squares, 0.0, out=squares)]


def _bounded(k: Array, b: Array, k_alone: Array, b_alone: Array, a: Array, c: Array) -> tuple[Array, Array]:
    """Non-negative gains where the free ones (NaN: not known) are not: the better of the two fits of one gain."""
    k_gain, b_gain = np.maximum(k_alone, 0.0), np.maximum(np.where(c > 0, b_alone, 0.0), 0.0)
    spring = k_gain**2 * a >= b_gain**2 * c  # how much either takes off the squares
    return (
        np.where(np.isnan(b), np.maximum(k, 0.0), np.where(spring, k_gain, 0.0)),
        np.where(np.isnan(k), np.maximum(b, 0.0), np.where(spring, 0.0, b_gain)),
    )


def _second_pass(
    e: Array, v: Array, f: Array, ratio: Array, start: Array, window: int, step: int
) -> tuple[Array, Array, Array]:
    """Σu², Σug and Σg² of every window with ``u = v − ratio e``, ``g = f − start e``; no temporaries but these."""
    u, g, product = (np.empty_like(ratio) for _ in range(3))
    d, q, squares = (np.zeros_like(ratio) for _ in range(3))
    stop = (len(ratio) - 1) * step + 1
    for k in range(window):
        rows = slice(k, k + stop, step)
        np.subtract(v[rows], np.multiply(ratio, e[rows], out=u), out=u)
        np.subtract(f[rows], np.multiply(start, e[rows], out=g), out=g)
        d += np.multiply(u, u, out=product)
        q += np.multiply(u, g, out=product)
        squares += np.multiply(g, g, out=product)
    return d, q, squares
