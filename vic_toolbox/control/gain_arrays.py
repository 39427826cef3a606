"""Gains as a runtime filter takes them: diagonals beside the errors, or matrices."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.gains import spd_matrix


def checked_gains(name: str, value: ArrayLike, *, error: Array, definite: bool = True) -> Array:
    """Stiffness or damping for errors (..., d): positive diagonals (..., d), or matrices (..., d, d).

    Raises
    ------
    InputError
        Another shape, not finite, not symmetric or not positive (with ``definite=False``, of diagonals: negative).
    """
    d = error.shape[-1]
    array = finite_array(name, value)
    if array.shape == error.shape:
        low = array.min(initial=np.inf)
        if low < 0 or (definite and low <= 0):
            raise InputError(f"{name} has the entry {low:g}; every one must be greater than zero.")
        return array
    if array.shape == (*error.shape, d):
        if definite or array.any():
            return spd_matrix(name, array)
        return array
    raise InputError(
        f"{name} has shape {array.shape} beside errors of shape {error.shape}; pass diagonals {error.shape} or "
        f"matrices {(*error.shape, d)}."
    )


def is_diagonal(gains: Array, error: Array) -> bool:
    """Whether gains are diagonals (..., d) rather than matrices (..., d, d)."""
    return gains.ndim == error.ndim


def quadratic(gains: Array, vector: Array) -> Array:
    """``vᵀ G v`` (...) for diagonals or matrices G."""
    if is_diagonal(gains, vector):
        return (gains * vector**2).sum(axis=-1)
    return np.vecdot(vector, np.matvec(gains, vector))
