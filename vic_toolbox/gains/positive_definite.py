"""Symmetric positive definite (SPD) matrices: the check, and the square root."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array

SYMMETRY_TOLERANCE = 1e-9
"""Largest ``|A − Aᵀ|``, relative to the largest entry of A, that is taken for rounding."""


def spd_matrix(name: str, value: ArrayLike, *, size: int | None = None) -> Array:
    """Return `value` as symmetric positive definite matrices, exactly symmetric.

    Parameters
    ----------
    name : str
        What the value is called in the error message.
    value : array_like, shape (..., n, n)
    size : int, optional
        The wanted n; without it, any.

    Raises
    ------
    InputError
        Not square, not finite, not symmetric, or an eigenvalue is zero or negative.
    """
    matrix = finite_array(name, value, shape=(..., size, size))
    if matrix.shape[-1] != matrix.shape[-2]:
        raise InputError(f"{name} has shape {matrix.shape}; pass square matrices (..., n, n).")
    transposed = np.swapaxes(matrix, -1, -2)
    scale = np.abs(matrix).max(axis=(-2, -1), initial=0.0)
    asymmetry = np.abs(matrix - transposed).max(axis=(-2, -1), initial=0.0)
    if (asymmetry > SYMMETRY_TOLERANCE * scale).any():
        raise InputError(
            f"{name} is not symmetric: it differs from its transpose by {asymmetry.max():.3g}; "
            "pass (A + Aᵀ)/2 if only its symmetric part is meant."
        )
    symmetric = 0.5 * (matrix + transposed)
    try:
        np.linalg.cholesky(symmetric)
    except np.linalg.LinAlgError:
        smallest = np.linalg.eigvalsh(symmetric).min()
        raise InputError(
            f"{name} is not positive definite: its smallest eigenvalue is {smallest:.3g}; "
            "every eigenvalue must be greater than zero."
        ) from None
    return symmetric


def matrix_square_root(matrix: ArrayLike) -> Array:
    """Return the symmetric positive definite S with ``S S = A``.

    Parameters
    ----------
    matrix : array_like, shape (..., n, n)
        Symmetric positive definite A.

    Returns
    -------
    ndarray, shape (..., n, n)
    """
    values, vectors = np.linalg.eigh(spd_matrix("matrix", matrix))
    # Rounding can put an eigenvalue of an ill-conditioned matrix a hair below zero.
    roots = np.sqrt(np.maximum(values, 0.0))
    return (vectors * roots[..., None, :]) @ np.swapaxes(vectors, -1, -2)
