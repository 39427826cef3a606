"""Gains as B-splines of time, and the normal equations of ``y = Σ_i x_i(t) s_i(t)`` in their coefficients.

A basis function of a cubic spline overlaps three neighbours on either side, so the normal matrix is banded: it is kept
as ``G[d, j]``, the (q, q) block that couples knot j with knot j + d, d = 0..3. Building it costs time proportional to
the samples, everything after that to the knots.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from vic_toolbox.errors import Array

DEGREE = 3
CHUNK = 32768
"""Samples worked on at a time."""


@dataclass(frozen=True, eq=False)
class Basis:
    """Uniform cubic B-splines on [start, stop], or the constant function (`intervals` = 0).

    Parameters
    ----------
    start, stop : float
        [s]
    intervals : int
        Number of knot intervals.
    """

    start: float
    stop: float
    intervals: int

    @classmethod
    def spaced(cls, start: float, stop: float, spacing: float | None) -> Basis:
        """Knots about `spacing` seconds apart that divide the interval evenly; None: constant."""
        if spacing is None:
            return cls(start, stop, 0)
        return cls(start, stop, max(round((stop - start) / spacing), 1))

    @property
    def degree(self) -> int:
        """Three, or zero for the constant."""
        return DEGREE if self.intervals else 0

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.intervals + self.degree if self.intervals else 1

    def __call__(self, t: Array) -> tuple[NDArray[np.intp], Array]:
        """First active coefficient (n,) and the values of the active functions (n, degree + 1); held outside."""
        if not self.intervals:
            return np.zeros(len(t), np.intp), np.ones((len(t), 1))
        # evenly spaced beyond the ends as well, so that the coefficients of a straight line are one themselves
        inner = np.linspace(self.start, self.stop, self.intervals + 1)
        outer = np.arange(1, DEGREE + 1) * (self.stop - self.start) / self.intervals
        knots = np.concatenate([self.start - outer[::-1], inner, self.stop + outer])
        matrix: Any = BSpline.design_matrix(np.clip(t, self.start, self.stop), knots, DEGREE)
        return matrix.indices[:: DEGREE + 1].astype(np.intp), matrix.data.reshape(-1, DEGREE + 1)

    def evaluate(self, coefficients: Array, t: Array) -> Array:
        """Spline values (n, ...) of coefficients (size, ...)."""
        first, values = self(t)
        terms = [
            values[:, a].reshape(-1, *[1] * (coefficients.ndim - 1)) * coefficients[first + a]
            for a in range(values.shape[1])
        ]
        return np.sum(terms, axis=0)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Sums over samples, for several problems of one shape side by side (the six axes).

    Parameters
    ----------
    gram : ndarray, shape (p, degree + 1, m, q, q)
        Blocks of the normal matrix.
    right : ndarray, shape (p, m, q)
    squares : ndarray, shape (p,)
        Σ y².
    border : ndarray, shape (p, m, q, r)
        Coupling with r unknowns that do not depend on time.
    corner : ndarray, shape (p, r, r)
    border_right : ndarray, shape (p, r)
    count : ndarray, shape (p,)
        Number of observations.
    """

    gram: Array
    right: Array
    squares: Array
    border: Array
    corner: Array
    border_right: Array
    count: Array

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return NormalEquations(
            self.gram + other.gram,
            self.right + other.right,
            self.squares + other.squares,
            self.border + other.border,
            self.corner + other.corner,
            self.border_right + other.border_right,
            self.count + other.count,
        )


def normal_equations(
    basis: Basis, t: Array, *, x: Array, y: Array, z: Array | None = None, weight: Array | None = None
) -> NormalEquations:
    """Sum up the samples of one recording.

    Parameters
    ----------
    basis : Basis
    t : ndarray, shape (n,)
        Increasing.
    x : ndarray, shape (n, p, q)
        What the splines multiply.
    y : ndarray, shape (n, p)
        What they should add up to.
    z : ndarray, shape (n, p, r), optional
        What the constant unknowns multiply.
    weight : ndarray, shape (n, p), optional
        Of the squared residuals.
    """
    n, p, q = x.shape
    width, m = basis.degree + 1, basis.size
    z = np.zeros((n, p, 0)) if z is None else z
    r = z.shape[2]
    upper = np.triu_indices(q)
    gram, right = np.zeros((width, m, p, len(upper[0]))), np.zeros((m, p, q))
    border = np.zeros((m, p, q, r))
    for start in range(0, n, CHUNK):
        rows = slice(start, start + CHUNK)
        first, values = basis(t[rows])
        edges = np.flatnonzero(np.diff(first, prepend=-1))
        spans = first[edges]
        xs = x[rows] if weight is None else x[rows] * weight[rows, :, None]
        pairs = xs[:, :, upper[0]] * x[rows][:, :, upper[1]]
        target = xs * y[rows][:, :, None]
        extra = xs[:, :, :, None] * z[rows][:, :, None, :]
        for a in range(width):
            right[spans + a] += np.add.reduceat(_scaled(values[:, a], target), edges, axis=0)
            if r:
                border[spans + a] += np.add.reduceat(_scaled(values[:, a], extra), edges, axis=0)
            for b in range(a, width):
                sums = np.add.reduceat(_scaled(values[:, a] * values[:, b], pairs), edges, axis=0)
                gram[b - a][spans + a] += sums
    full = np.empty((p, width, m, q, q))
    full[..., upper[0], upper[1]] = full[..., upper[1], upper[0]] = gram.transpose(2, 0, 1, 3)
    zw, yw = (z, y) if weight is None else (z * weight[:, :, None], y * weight)
    return NormalEquations(
        full,
        right.transpose(1, 0, 2),
        np.sum(yw * y, axis=0),
        border.transpose(1, 0, 2, 3),
        np.einsum("npr,nps->prs", zw, z),
        np.einsum("npr,np->pr", zw, y),
        np.full(p, float(n)),
    )


def _scaled(factor: Array, x: Array) -> Array:
    return x * factor.reshape(-1, *[1] * (x.ndim - 1))
