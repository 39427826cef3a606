"""Is every matrix of a long sequence positive definite: one elimination for thousands of them at a time.

Symmetric matrices are kept packed: their lower triangle entry by entry, samples last, shape (p, n) with
p = d (d + 1)/2; diagonal ones as their d entries. An elimination ``X = L Δ Lᵀ`` is then d³/6 operations on whole rows,
ten times as fast as LAPACK called for each matrix when d is 6, and the signs of the pivots Δ are those of the
eigenvalues (Sylvester's law of inertia).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array

CHUNK = 4096
"""Samples worked on at a time: few enough for the processor's cache."""
READ = 512
"""Matrices read together: few enough to stay in the cache until they are read again."""
ROUNDING = 1e-12
"""Negative eigenvalue, relative to the terms it comes from, that counts as zero."""
Mask = NDArray[np.bool_]


@lru_cache
def lower(d: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the packed entries of a (d, d) matrix."""
    return np.tril_indices(d)


def pack(matrices: Array) -> Array:
    """Lower triangles (p, n) of symmetric matrices (n, d, d); a single (d, d) becomes (p, 1)."""
    stack = matrices if matrices.ndim == 3 else matrices[None]
    rows, columns = lower(stack.shape[-1])
    packed = np.empty((len(rows), len(stack)))
    for start in range(0, len(stack), CHUNK):
        some = slice(start, start + CHUNK)
        packed[:, some] = stack[some, rows, columns].T
    return packed


def unpack(packed: Array) -> Array:
    """Symmetric matrices (n, d, d) of packed entries (p, n)."""
    d = size(packed)
    rows, columns = lower(d)
    stack = np.empty((packed.shape[1], d, d))
    stack[:, rows, columns] = stack[:, columns, rows] = packed.T
    return stack


def size(packed: Array) -> int:
    """The d of packed entries (p, n)."""
    return (int(np.sqrt(8 * len(packed) + 1)) - 1) // 2


def diagonals(matrices: Array) -> Array | None:
    """Diagonals (d, n) of (n, d, d) or (d, d) matrices that have nothing else; None if any has."""
    d = matrices.shape[-1]
    # of the d² entries in a row, every (d + 1)-th is on the diagonal: seen so, the others are a block
    flat = np.ascontiguousarray(matrices).reshape(-1, d * d)
    found = np.empty((d, len(flat)))
    for start in range(0, len(flat), READ):
        some = flat[start : start + READ]
        if d > 1 and some[:, :-1].reshape(-1, d - 1, d + 1)[:, :, 1:].any():
            return None
        found[:, start : start + READ] = some[:, :: d + 1].T
    return found


def positive_definite(packed: Array) -> Mask:
    """Which of the packed matrices (p, n) are positive definite, shape (n,)."""
    found = np.empty(packed.shape[1], dtype=bool)
    for start in range(0, len(found), CHUNK):
        found[start : start + CHUNK] = _eliminate(packed[:, start : start + CHUNK])
    return found


def _eliminate(packed: Array) -> Mask:
    d = size(packed)
    entry = {(int(i), int(j)): row for i, j, row in zip(*lower(d), packed.copy(), strict=True)}
    good = np.ones(packed.shape[1], dtype=bool)
    for j in range(d):
        pivot = entry[j, j]
        good &= pivot > 0
        inverse = 1 / np.where(good, pivot, np.inf)
        for i in range(j + 1, d):
            factor = entry[i, j] * inverse
            for k in range(j + 1, i + 1):
                entry[i, k] -= factor * entry[k, j]
    return good


def least_ratio(a: Array, b: Array) -> Array:
    """Least eigenvalue of ``b⁻¹ a`` for symmetric a and b ≻ 0, (n, d, d) each; shape (n,)."""
    factor = np.linalg.inv(np.linalg.cholesky(b))
    values = np.asarray(np.linalg.eigvalsh(factor @ a @ np.swapaxes(factor, 1, 2)), dtype=np.float64)
    return values[:, 0]


def relative_slack(*terms: Array) -> float:
    """Least eigenvalue of sums of matrices (n, d, d), in units of their terms: a diagonal of ``|terms|`` is one.

    By LAPACK, one matrix after the other. Zero where it is negative by rounding only, −inf where a term is not finite.
    """
    if not all(np.isfinite(x).all() for x in terms):
        return -np.inf
    size = np.sqrt(sum(np.abs(np.diagonal(x, axis1=1, axis2=2)) for x in terms))
    size = np.where(size > 0, size, 1.0)
    total = sum(terms[1:], start=terms[0]) / (size[:, :, None] * size[:, None, :])
    worst = float(np.linalg.eigvalsh(total).min())
    return worst if worst < -ROUNDING else max(worst, 0.0)
