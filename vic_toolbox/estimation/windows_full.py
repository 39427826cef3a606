"""Windows with full symmetric matrices: 21 entries of K and 21 of B at once.

The samples of a window enter through ``H = Σ x xᵀ`` (12, 12) with x = (e, ė) and ``G = Σ x fᵀ`` (12, 6). With the
duplication matrix D, which writes the 72 entries of [K B] in their 42 free ones θ, and weights W = diag(1/σ²),

    minimise  θᵀ A θ − 2 bᵀ θ,   A = Dᵀ (W ⊗ H) D,   b = Dᵀ vec(W Gᵀ),

in units in which e, ė and f are about one. Ten samples have rank 30 of 42.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.estimation.samples import Samples, root_mean_square
from vic_toolbox.estimation.windows_diagonal import window_count

CHUNK = 256
RANK = 1e-11
"""Smallest eigenvalue of the information that counts, each unknown scaled to unit information."""


@cache
def symmetric_index() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Rows and columns of the 21 free entries of a symmetric (6, 6) matrix: the upper triangle, column by column.

    That is the order in which Clarabel keeps a positive semidefinite cone.
    """
    rows, columns = zip(*[(i, j) for j in range(6) for i in range(j + 1)], strict=True)
    return np.array(rows), np.array(columns)


@cache
def duplication() -> Array:
    """D (6, 12, 42): ``[K B][row] = D[row] θ`` with θ the free entries of K, then of B."""
    rows, columns = symmetric_index()
    d = np.zeros((6, 12, 42))
    for free, (i, j) in enumerate(zip(rows, columns, strict=True)):
        for offset, shift in ((0, 0), (21, 6)):
            d[i, shift + j, offset + free] = d[j, shift + i, offset + free] = 1
    return d


def matrices(theta: Array) -> tuple[Array, Array]:
    """K and B (..., 6, 6) of the free entries (..., 42)."""
    rows, columns = symmetric_index()
    pair = []
    for part in (theta[..., :21], theta[..., 21:]):
        matrix = np.zeros((*theta.shape[:-1], 6, 6), theta.dtype)
        matrix[..., rows, columns] = matrix[..., columns, rows] = part
        pair.append(matrix)
    return pair[0], pair[1]


@dataclass(frozen=True, eq=False)
class FullUnits:
    """Units in which stiffness and damping entries are about one, (6,) each: ``K = k ⊗ k ∘ K̃``, ``B = b ⊗ b ∘ B̃``.

    A congruence with a diagonal matrix, so K is positive definite where K̃ is.
    """

    stiffness: Array
    damping: Array

    @classmethod
    def of(cls, parts: list[Samples]) -> FullUnits:
        """From the sizes of wrench and motion."""
        e, v, w = (
            root_mean_square(np.concatenate([getattr(p, name) for p in parts]))
            for name in ("error", "rate", "wrench")
        )
        w = np.where(w > 0, w, 1.0)
        return cls(np.sqrt(w / np.where(e > 0, e, 1.0)), np.sqrt(w / np.where(v > 0, v, 1.0)))

    @property
    def entries(self) -> Array:
        """What one unit of each of the 42 free entries is."""
        rows, columns = symmetric_index()
        return np.concatenate([unit[rows] * unit[columns] for unit in (self.stiffness, self.damping)])

    def normal_equations(self, h: Array, g: Array, noise: Array) -> tuple[Array, Array]:
        """A (..., 42, 42) and b (..., 42) from H (..., 12, 12) and G (..., 12, 6), both in SI units."""
        d = (
            duplication()
            * np.concatenate([np.outer(u, u) for u in (self.stiffness, self.damping)], axis=1)[..., None]
        )
        weighted = d / noise[:, None, None]
        a = np.einsum("rik,...ij,rjl->...kl", weighted, h, weighted, optimize=True)
        return a, np.einsum("rik,...ir->...k", weighted / noise[:, None, None], g, optimize=True)


@dataclass(frozen=True, eq=False)
class FullWindows:
    """Normal equations of every window, in the units `units`, and their solution without constraint.

    Parameters
    ----------
    information : ndarray, shape (m, 42, 42)
    right : ndarray, shape (m, 42)
    solution : ndarray, shape (m, 42)
        Least squares of least norm.
    variance : ndarray, shape (m, 42)
        Diagonal of the inverse information; infinite where it does not determine the entry.
    rank : ndarray, shape (m,)
    condition : ndarray, shape (m,)
    """

    information: Array
    right: Array
    solution: Array
    variance: Array
    rank: Array
    condition: Array


def full_windows(data: Samples, window: int, *, step: int, noise: Array, units: FullUnits) -> FullWindows:
    """Fit every window without constraint."""
    count = window_count(len(data), window, step)
    x = np.concatenate([data.error, data.rate], axis=1)
    found = []
    for first in range(0, count, CHUNK):
        starts = step * np.arange(first, min(first + CHUNK, count))
        h, g = np.zeros((len(starts), 12, 12)), np.zeros((len(starts), 12, 6))
        for k in range(window):
            rows = x[starts + k]
            h += rows[:, :, None] * rows[:, None, :]
            g += rows[:, :, None] * data.wrench[starts + k][:, None, :]
        a, b = units.normal_equations(h, g, noise)
        found.append((a, b, *least_norm(a, b)))
    return FullWindows(*(np.concatenate(part) for part in zip(*found, strict=True)))


def least_norm(a: Array, b: Array) -> tuple[Array, Array, Array, Array]:
    """Solution of A θ = b, diagonal of A⁻¹ (infinite where A is singular), rank and condition number, batched."""
    size = np.sqrt(np.maximum(np.diagonal(a, axis1=-2, axis2=-1), 0.0))
    seen = size > 0
    safe = np.where(seen, size, 1.0)
    values, vectors = np.linalg.eigh(a / (safe[..., :, None] * safe[..., None, :]))
    counts = values > RANK * np.maximum(values[..., -1:], 1e-300)
    inverse = np.where(counts, 1 / np.where(counts, values, 1.0), 0.0)
    half = np.einsum("...ij,...i->...j", vectors, b / safe)
    solution = np.einsum("...ij,...j->...i", vectors, inverse * half) / safe
    # an entry is determined when no direction of the null space has a part in it
    lost = np.einsum("...ij,...j->...i", vectors**2, (~counts).astype(float))
    variance = np.einsum("...ij,...j->...i", vectors**2, inverse) / safe**2
    variance = np.where(seen & (lost < 1e-8), variance, np.inf)
    rank = counts.sum(axis=-1)
    with np.errstate(divide="ignore"):
        condition = np.where(
            counts.all(axis=-1), values[..., -1] / np.where(counts, values, 1.0)[..., 0], np.inf
        )
    return solution, variance, rank, condition
