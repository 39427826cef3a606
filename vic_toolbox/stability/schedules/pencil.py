r"""All numbers α for which ``A_t + α B_t ⪰ 0`` holds at every sample t: an interval, found exactly.

``f(α) = min_t λ_min(A_t + α B_t)`` is concave, so {f ≥ 0} is an interval. Where an eigenvector v shows a violation at
α, the line ``vᵀ A v + α vᵀ B v ≥ 0`` must hold too, and it cuts α off: Newton's method on f from either side, monotone
and quadratic. Nearly all samples never matter. The bound of a few hundred is found first, then all are tried against
it by elimination, and only those that violate it go on (Clarkson's sampling): most of the work is one elimination.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.definite import CHUNK, ROUNDING, positive_definite, size, unpack

Samples = NDArray[np.intp]
Pick = Callable[[Samples | slice], tuple[Array, Array]]
"""Rows of A and B, (p, m) each, of the samples asked for."""

SAMPLE = 256
"""Samples whose eigenvalues are taken together."""
CONVERGED = 1e-13
"""Relative step of α at which Newton stops."""
STEPS = 100


@dataclass(frozen=True, eq=False)
class Edge:
    """Where the interval ends, and the sample and direction that end it.

    Parameters
    ----------
    value : float
        α; ±inf where no α is left.
    index : int
        Sample that decides it; −1 if none does.
    direction : ndarray, shape (d,)
        Eigenvector v at that sample with ``vᵀ (A + α B) v = 0``.
    """

    value: float
    index: int = -1
    direction: Array | None = None


def least(pick: Pick, count: int, *, start: float = 0.0, diagonal: bool = False) -> Edge:
    """Smallest α ≥ `start` with ``A_t + α B_t ⪰ 0`` for all t; +inf if there is none.

    Parameters
    ----------
    pick : callable
        Gives packed matrices, or (`diagonal`) the diagonal entries.
    count : int
        Number of samples.
    start : float, optional
        α to start from.
    diagonal : bool, optional
        The matrices are diagonal: the answer is a closed form.
    """
    edge = Edge(start)
    if diagonal:
        for begin in range(0, count, CHUNK):
            edge = _divided(edge, begin, *pick(slice(begin, min(begin + CHUNK, count))))
        return edge
    seen, violating = _spread(np.arange(count)), False
    while len(seen):
        before, edge = edge, _raised(edge, seen, pick)
        # elimination may see a violation that eigenvalues take for rounding
        stuck = violating and edge.value - before.value <= CONVERGED * abs(edge.value)
        if stuck or not np.isfinite(edge.value) or len(seen) == count:
            break
        seen, violating = _spread(_violators(pick, count, edge.value)), True
    return edge


def largest(pick: Pick, count: int, *, start: float, diagonal: bool = False) -> Edge:
    """Largest α ≤ `start` with ``A_t + α B_t ⪰ 0`` for all t; −inf if there is none."""

    def mirrored(samples: Samples | slice) -> tuple[Array, Array]:
        a, b = pick(samples)
        return a, -b

    edge = least(mirrored, count, start=-start, diagonal=diagonal)
    return Edge(-edge.value, edge.index, edge.direction)


def lifted(total: Array, terms: Array) -> Array:
    """Packed matrices with the rounding of the `terms` they are the sum of added to their diagonals.

    What is zero, and negative only by rounding, is then positive.
    """
    diagonal = np.cumsum(np.arange(1, size(total) + 1)) - 1
    raised = total.copy()
    raised[diagonal] += ROUNDING * np.abs(terms[diagonal]) + np.finfo(float).tiny
    return raised


def _violators(pick: Pick, count: int, alpha: float) -> Samples:
    """Samples at which ``A + α B`` is not positive definite, beyond the rounding of its own terms."""
    found = []
    for begin in range(0, count, CHUNK):
        a, b = pick(slice(begin, min(begin + CHUNK, count)))
        total = lifted(a + alpha * b, np.abs(a) + np.abs(alpha * b))
        found.append(begin + np.flatnonzero(~positive_definite(total)))
    return np.concatenate(found)


def _spread(samples: Samples) -> Samples:
    """At most `SAMPLE` of them, evenly."""
    if len(samples) <= SAMPLE:
        return samples
    return samples[np.linspace(0, len(samples) - 1, SAMPLE).astype(np.intp)]


def _divided(edge: Edge, begin: int, a: Array, b: Array) -> Edge:
    """Diagonal matrices: ``α ≥ −a / b`` where b is positive."""
    wrong = a + edge.value * b < 0
    if not wrong.any():
        return edge
    with np.errstate(divide="ignore", invalid="ignore"):
        bound = np.where(wrong, np.where(b > 0, -a / b, np.inf), -np.inf)
    axis, index = np.unravel_index(int(np.argmax(bound)), bound.shape)
    if bound[axis, index] <= edge.value:
        return edge
    return Edge(float(bound[axis, index]), begin + int(index), np.eye(len(bound))[axis])


def _raised(edge: Edge, samples: Samples, pick: Pick) -> Edge:
    """Newton from below on a few samples."""
    a, b = (unpack(x) for x in pick(samples))
    for _ in range(STEPS):
        # unit diagonals: which sample is the worst then does not depend on units
        total = a + edge.value * b
        scale = np.sqrt(_diagonal(a) + np.abs(edge.value) * _diagonal(b))
        scale = np.where(scale > 0, scale, 1.0)
        values, vectors = np.linalg.eigh(total / (scale[:, :, None] * scale[:, None, :]))
        wrong = np.flatnonzero(values[:, 0] < -ROUNDING)
        if not len(wrong):
            return edge
        v = vectors[wrong, :, 0] / scale[wrong]
        top, slope = np.einsum("ni,nij,nj->n", v, a[wrong], v), np.einsum("ni,nij,nj->n", v, b[wrong], v)
        if not (slope > 0).all():
            k = int(np.argmin(slope > 0))
            return Edge(np.inf, int(samples[wrong[k]]), _unit(v[k]))
        bound = -top / slope
        k = int(np.argmax(bound))
        step = float(bound[k]) - edge.value
        if step > 0 or edge.index < 0:
            edge = Edge(max(float(bound[k]), edge.value), int(samples[wrong[k]]), _unit(v[k]))
        if step <= CONVERGED * abs(edge.value):
            return edge
    return edge


def _diagonal(x: Array) -> Array:
    return np.abs(np.diagonal(x, axis1=1, axis2=2))


def _unit(v: Array) -> Array:
    return v / np.linalg.norm(v) * (1.0 if v[np.argmax(np.abs(v))] > 0 else -1.0)
