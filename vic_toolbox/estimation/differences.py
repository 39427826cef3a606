"""Differences of spline coefficients along time: the squares that a penalty adds up, and their determinant."""

from __future__ import annotations

from math import lgamma, log

import numpy as np

from vic_toolbox.errors import Array

ORDER = 2
"""Order of the differences that the penalty squares, if nothing else is said: a straight line costs nothing."""


def squared_differences(m: int, order: int = ORDER) -> Array:
    """Bands (order + 1, m) of ΔᵀΔ: entry [d, j] couples coefficients j and j + d; zero for too few of them."""
    bands = np.zeros((order + 1, m))
    row = np.diff(np.eye(order + 1), order, axis=0)[0]
    for a in range(order + 1):
        for b in range(a, order + 1):
            if m > order:
                bands[b - a, a : a + m - order] += row[a] * row[b]
    return bands


def log_determinant(m: int, order: int) -> float:
    """Logarithm of det ΔΔᵀ, with which likelihoods of different orders compare.

    It is the determinant of the Gram matrix of the polynomials that Δ leaves, in the basis of binomials: the product
    of the squared norms of the discrete Chebyshev polynomials of degree below the order.
    """
    if m <= order:
        return 0.0
    return sum(
        2 * lgamma(i + 1)
        - lgamma(2 * i + 1)
        - lgamma(2 * i + 2)
        + log(m)
        + sum(log(m**2 - k**2) for k in range(1, i + 1))
        for i in range(order)
    )
