"""Variances of splines: the band of a banded matrix's inverse, without the rest of it (Takahashi et al. 1973)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array


def selected_inverse(gram: Array, width: int) -> Array:
    """Entries of the inverse that couple a spline with itself within the band, shape (width, m, q).

    Three neighbouring knots make a block, so the matrix is block tridiagonal. With its factors from the first
    block on, the inverse's blocks follow from the last one back:
    ``Σ_kk = D_k⁻¹ + G_k Σ_(k+1,k+1) G_kᵀ``, ``Σ_(k,k+1) = −G_k Σ_(k+1,k+1)``, ``G_k = D_k⁻¹ A_(k,k+1)``.
    """
    offsets, m, q, _ = gram.shape
    step = max(offsets - 1, 1)
    blocks = -(-m // step)
    s = step * q
    diagonal, coupling = np.zeros((blocks, s, s)), np.zeros((max(blocks - 1, 0), s, s))
    for j in range(blocks * step):
        k, a = divmod(j, step)
        if j >= m:  # the last block is filled up with knots that nothing couples
            diagonal[k, a * q : (a + 1) * q, a * q : (a + 1) * q] = np.eye(q)
            continue
        for d in range(min(offsets, m - j)):
            other, b = divmod(j + d, step)
            rows, columns = slice(a * q, (a + 1) * q), slice(b * q, (b + 1) * q)
            if other == k:
                diagonal[k, rows, columns] = gram[d, j]
                diagonal[k, columns, rows] = gram[d, j].T
            else:
                coupling[k, rows, columns] = gram[d, j]
    inverses, gains = np.empty_like(diagonal), np.empty_like(coupling)
    inverses[0] = np.linalg.inv(diagonal[0])
    for k in range(blocks - 1):
        gains[k] = inverses[k] @ coupling[k]
        inverses[k + 1] = np.linalg.inv(diagonal[k + 1] - coupling[k].T @ gains[k])
    result = np.zeros((width, m, q))
    index = np.arange(s)
    later = np.zeros((s, s))
    for k in range(blocks - 1, -1, -1):
        current, beside = inverses[k], np.zeros((s, s))
        if k < blocks - 1:
            beside = -gains[k] @ later
            current = current - beside @ gains[k].T
        both = np.concatenate([current, beside], axis=1)
        for d in range(width):
            values = both[index, index + d * q] if d * q + s <= 2 * s else both[index, index]
            for a in range(step):
                j = k * step + a
                if j + d < m:
                    result[d, j] = values[a * q : (a + 1) * q]
        later = current
    return result


def pointwise(band: Array, first: NDArray[np.intp], values: Array) -> Array:
    """Variances (n, q) of the splines at points with active functions `first` and `values`, from the band."""
    width = values.shape[1]
    total = np.zeros((len(first), band.shape[2]))
    for a in range(width):
        for b in range(a, width):
            share = (1 if a == b else 2) * values[:, a] * values[:, b]
            total += share[:, None] * band[b - a, first + a]
    return np.maximum(total, 0.0)
