"""Gains over time, from their samples: slopes, what lies between the samples, and jumps that have no slope.

The slope at a sample is that of the fourth-degree polynomial through it and its four neighbours, and between samples
the gains are the cubics with these values and slopes (Hermite). Both are local: a bad sample spoils five instants, not
the schedule. A step of a gain that is held has no slope at all, however finely it is sampled: :attr:`Schedule.jumps`
finds such steps, so that nobody divides them by a time step.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.definite import CHUNK, lower

NEIGHBOURS = 5
"""Samples behind a slope."""
ABRUPT = 8.0
"""A step is a jump if it is steeper than all its neighbours (two on either side) by this factor ..."""
VISIBLE = 1e-3
"""... and larger than this share of the gain."""
UNIFORM = 1e-8
"""Relative spread of the time steps below which they count as equal."""

Index = slice | NDArray[np.intp]
Share = float | Array


class Cubics(NamedTuple):
    """Cubic pieces by their four Bernstein coefficients (p, m): at every instant they are a mean of these."""

    values: tuple[Array, ...]
    slopes: tuple[Array, ...]
    """The rates of change, raised to degree three."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """Entries of a matrix over time, one row for each.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Increasing [s].
    values : ndarray, shape (p, n)
        Packed (see :mod:`~vic_toolbox.stability.schedules.definite`), or (p, 1) where it is constant.
    diagonal : bool
        The rows are the diagonal entries, and not all of them.
    """

    time: Array
    values: Array
    diagonal: bool

    @classmethod
    def of(cls, time: Array, values: Array, *, diagonal: bool = False) -> Schedule:
        """Of values (p, n) or (p, 1); what never changes is kept once."""
        still = (values[:, -1:] == values[:, :1]).all() and (values == values[:, :1]).all()
        return cls(time, values[:, :1].copy() if still else values, diagonal)

    @property
    def constant(self) -> bool:
        """Whether it never changes."""
        return self.values.shape[1] == 1

    @cached_property
    def scale(self) -> Array:
        """Size of each row, (p,): of an entry off the diagonal, the mean of the two on it (geometric)."""
        if self.diagonal:
            return _extent(self.values)
        rows, columns = lower((int(np.sqrt(8 * len(self.values) + 1)) - 1) // 2)
        size = np.sqrt(np.abs(self.values[rows == columns]).max(axis=1))
        return size[rows] * size[columns]

    @cached_property
    def slopes(self) -> Array:
        """Rates of change at the samples, shaped as the values."""
        return np.zeros_like(self.values) if self.constant else slopes(self.time, self.values)

    @cached_property
    def jumps(self) -> NDArray[np.intp]:
        """Intervals i, from sample i to i + 1, in which the gain jumps."""
        n = self.values.shape[1]
        if n < 4:
            return np.zeros(0, np.intp)
        found = [np.zeros(0, np.intp)]
        for start in range(0, n - 1, CHUNK):  # two intervals more on either side
            first, stop = max(start - 2, 0), min(start + CHUNK + 2, n - 1)
            step = np.abs(np.diff(self.values[:, first : stop + 1], axis=1))
            visible = step > VISIBLE * self.scale[:, None]
            if not visible.any():
                continue
            steep = step / np.diff(self.time[first : stop + 1])
            around = np.zeros_like(steep)
            for shift in (1, 2):
                np.maximum(around[:, shift:], steep[:, :-shift], out=around[:, shift:])
                np.maximum(around[:, :-shift], steep[:, shift:], out=around[:, :-shift])
            abrupt = (steep > ABRUPT * around) & visible
            inside = first + np.flatnonzero(abrupt.any(axis=0))
            found.append(inside[(inside >= start) & (inside < start + CHUNK)])
        return np.concatenate(found)

    def at(self, t: Array) -> tuple[Array, Array]:
        """Values and slopes (p, m) at instants t (m,), which lie within the samples."""
        if self.constant:
            value = np.repeat(self.values, len(t), axis=1)
            return value, np.zeros_like(value)
        i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
        width = self.time[i + 1] - self.time[i]
        s = (t - self.time[i]) / width
        points, slopes = self.cubics(i)
        bernstein = ((1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3)
        value = sum(w * x for w, x in zip(bernstein, points, strict=True))
        return np.asarray(value), np.asarray(sum(w * x for w, x in zip(bernstein, slopes, strict=True)))

    def cubics(self, index: Index, low: Share = 0.0, high: Share = 1.0) -> Cubics:
        """Bernstein form over the part [low, high] of each of some intervals between samples (m,)."""
        if self.constant:
            return Cubics((self.values,) * 4, (np.zeros_like(self.values),) * 4)
        after = slice(index.start + 1, index.stop + 1) if isinstance(index, slice) else index + 1
        width = self.time[after] - self.time[index]
        start, end = self.values[:, index], self.values[:, after]
        first = start + self.slopes[:, index] * (width / 3)
        last = end - self.slopes[:, after] * (width / 3)
        points = (start, first, last, end)
        if np.any(low != 0.0) or np.any(high != 1.0):
            shares = ((low, low, low), (low, low, high), (low, high, high), (high, high, high))
            points = tuple(_blossom(points, *x) for x in shares)
            width = width * (high - low)
        a, b, c = ((y - x) * (3 / width) for x, y in pairwise(points))
        return Cubics(points, (a, (a + 2 * b) / 3, (2 * b + c) / 3, c))

    def bounds(self, index: slice) -> tuple[Array, Array]:
        """Least Bernstein value of each row, and its steepest Bernstein slope, over neighbouring intervals; (p,) each.

        The inner values are ``x ± h ẋ/3`` of a sample, and the inner slopes means of ẋ at one end and of
        ``b = 3 Δx/h − ẋ₀ − ẋ₁``.
        """
        if self.constant:
            return self.values[:, 0], np.zeros(len(self.values))
        ends = slice(index.start, index.stop + 1)
        values, width = self.values[:, ends], np.diff(self.time[ends])
        steepest, step = _extent(self.slopes[:, ends]), _extent(np.diff(values, axis=1))
        middle = 3 * step / width.min() + 2 * steepest
        lowest = values.min(axis=1) - steepest * (width.max() / 3)
        return lowest, np.maximum(steepest, (steepest + 2 * middle) / 3)


def _extent(rows: Array) -> Array:
    """Largest ``|entry|`` of each row; of ``|rows|`` itself it would take a second array."""
    return np.maximum(rows.max(axis=1), -rows.min(axis=1))


def _blossom(points: tuple[Array, ...], *shares: Share) -> Array:
    """Symmetric trilinear form of a cubic: de Casteljau with one share for each step."""
    for share in shares:
        points = tuple(x + share * (y - x) for x, y in pairwise(points))
    return points[0]


def slopes(time: Array, values: Array) -> Array:
    """Derivatives of values (p, n) at increasing times (n,): fourth-degree polynomials through five neighbours."""
    n = len(time)
    width = min(NEIGHBOURS, n)
    half = width // 2
    found = np.empty_like(values)
    steps = np.diff(time)
    step = float(steps.mean())
    even = width == NEIGHBOURS and np.ptp(steps) < UNIFORM * step
    for start in range(0, n, CHUNK):
        stop = min(start + CHUNK, n)
        if even and start >= half and stop + half <= n:
            _even(values, start, stop, step, found[:, start:stop])
            continue
        first = np.clip(np.arange(start, stop) - half, 0, n - width)
        own = np.arange(start, stop) - first
        nodes = [time[first + k] - time[start:stop] for k in range(width)]
        base, total = values[:, start:stop], np.zeros((len(values), stop - start))
        for j in range(width):
            total += _lagrange(nodes, own, j) * (values[:, first + j] - base)
        found[:, start:stop] = total
    return found


def _even(values: Array, start: int, stop: int, step: float, found: Array) -> None:
    """The same in the middle of evenly spaced samples: (x₋₂ − 8 x₋₁ + 8 x₁ − x₂) / 12 h."""
    np.subtract(values[:, start + 1 : stop + 1], values[:, start - 1 : stop - 1], out=found)
    found *= 8
    found -= values[:, start + 2 : stop + 2] - values[:, start - 2 : stop - 2]
    found /= 12 * step


def _lagrange(nodes: list[Array], own: NDArray[np.intp], j: int) -> Array:
    """Derivative at zero of the Lagrange polynomial of node j, where node `own` is zero; for j = own, nothing.

    ``Π_{k ≠ own, j} (0 − x_k) / Π_{k ≠ j} (x_j − x_k)``; the weight of the own node follows from Σ = 0, which
    differences from the own value use.
    """
    weight = np.where(own == j, 0.0, 1.0)
    for k, node in enumerate(nodes):
        if k != j:
            gap = nodes[j] - node
            weight = weight * np.where(k == own, 1.0, -node) / gap
    return weight
