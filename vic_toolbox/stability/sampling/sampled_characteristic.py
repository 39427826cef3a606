"""The characteristic polynomial of a held 1-DOF loop: affine in the gains, so its edges are exact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

ON_CIRCLE = 1e-6
"""Distance from the unit circle at which a computed root counts as on it; the crossing itself is then exact."""


class Characteristic(NamedTuple):
    """``free(z) + K' spring(z) + B' damper(z)``, highest power first, one length; K', B' dimensionless."""

    free: np.ndarray
    spring: np.ndarray
    damper: np.ndarray

    def __call__(self, stiffness: np.ndarray, damping: np.ndarray) -> np.ndarray:
        """Coefficients (n + 1, …) of gains K', B' of any common shape."""
        columns = [p.reshape((-1,) + (1,) * np.ndim(stiffness)) for p in self]
        return columns[0] + columns[1] * stiffness + columns[2] * damping


def characteristic(friction: float, backward: bool, delay_steps: int) -> Characteristic:
    """Of a unit mass with friction ``D T/m``, time in periods.

    With ``x⁺ = x + φ₁ v + φ₂ u`` and ``v⁺ = E v + φ₁ u``: ``zˢ (z − 1)(z − E) + K' N(z) + B' φ₁ (z − 1)`` for the exact
    velocity, N(z) = φ₂ (z − E) + φ₁², and ``zˢ⁺¹ (z − 1)(z − E) + K' z N(z) + B' (z − 1) N(z)`` for the backward
    difference.
    """
    held = expm(np.array([[0.0, 1.0, 0.0], [0.0, -friction, 1.0], [0.0, 0.0, 0.0]]))
    shrink, velocity, position = held[1, 1], held[1, 2], held[0, 2]
    free = np.polymul([1.0, -1.0], [1.0, -shrink])
    moved = np.array([position, velocity**2 - position * shrink])
    if backward:
        spring, damper = np.polymul([1.0, 0.0], moved), np.polymul([1.0, -1.0], moved)
    else:
        spring, damper = moved, velocity * np.array([1.0, -1.0])
    free = np.concatenate([free, np.zeros(delay_steps + backward)])
    return Characteristic(free, *(_padded(p, len(free)) for p in (spring, damper)))


def schur_stable(coefficients: np.ndarray) -> np.ndarray:
    """Whether all roots lie inside the unit circle, for polynomials (n + 1, …): the Schur-Cohn recursion."""
    stable = np.ones(coefficients.shape[1:], dtype=bool)
    polynomial = coefficients
    while len(polynomial) > 1:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            reflection = polynomial[-1] / polynomial[0]
            stable &= np.abs(reflection) < 1  # False for NaN too
            polynomial = polynomial[:-1] - reflection * polynomial[:0:-1]
    return stable


def spectral_radius(coefficients: np.ndarray) -> np.ndarray:
    """Largest ``|root|`` of polynomials (n + 1, …): in closed form up to cubics, else of companion matrices."""
    order, batch = len(coefficients) - 1, coefficients.shape[1:]
    if order in (2, 3):
        return (_of_quadratic if order == 2 else _of_cubic)(*(coefficients[1:] / coefficients[0]))
    companion = np.zeros((*batch, order, order))
    companion[..., 0, :] = -np.moveaxis(coefficients[1:] / coefficients[0], 0, -1)
    companion[..., np.arange(1, order), np.arange(order - 1)] = 1.0
    return np.abs(np.linalg.eigvals(companion)).max(axis=-1)


def _of_quadratic(b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Largest ``|root|`` of ``z² + b z + c``."""
    square = 0.25 * b**2 - c
    return np.where(square < 0, np.sqrt(np.abs(c)), 0.5 * np.abs(b) + np.sqrt(np.maximum(square, 0.0)))


def _of_cubic(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Largest ``|root|`` of ``z³ + a z² + b z + c``: Cardano and Viète about the mean of the roots, z = t − a/3.

    The real root with the sign of −q is the simplest to find: it is alone, or the one farthest from the mean. Dividing
    by it leaves ``t² + r t + r² + p``.
    """
    shift = a / 3
    p, q = b - a * shift, c + shift * (2 * shift**2 - b)
    half, third = 0.5 * np.abs(q), p / 3
    square = half**2 + third**3
    with np.errstate(divide="ignore", invalid="ignore"):
        cube = np.cbrt(half + np.sqrt(np.maximum(square, 0.0)))
        alone = np.where(cube > 0, cube - third / cube, 0.0)
        reach = np.sqrt(np.maximum(-third, 0.0))
        share = np.where(reach**3 > 0, np.minimum(half / reach**3, 1.0), 1.0)
        farthest = 2 * reach * np.cos(np.arccos(share) / 3)
        root = np.where(square > 0, alone, farthest)
        for _ in range(2):  # Newton: Cardano's difference loses digits where p > 0
            slope = 3 * root**2 + p
            root = root - np.where(slope > 0, (root * (root**2 + p) - 2 * half) / slope, 0.0)
    root = np.where(q > 0, -root, root)
    middle, part = -0.5 * root - shift, 0.75 * root**2 + p
    spread = np.sqrt(np.abs(part))
    return np.maximum(
        np.abs(root - shift), np.where(part > 0, np.hypot(middle, spread), np.abs(middle) + spread)
    )


def damping_range(family: Characteristic, stiffness: float, damping: float) -> tuple[float, float]:
    """Interval of B' ≥ 0 that is stable at this K': the one that holds B', else the nearest; NaN if there is none.

    At an edge a root is on the circle: ``B' = −a(z)/b(z)`` must be real there, with a = free + K' spring and
    b = damper. So ``a(z) b(1/z) = a(1/z) b(z)``, a polynomial.
    """
    fixed = family.free + stiffness * family.spring
    roots = np.roots(
        _trimmed(np.convolve(fixed, family.damper[::-1]) - np.convolve(fixed[::-1], family.damper))
    )
    roots = np.concatenate([roots[np.abs(np.abs(roots) - 1) < ON_CIRCLE], [1.0, -1.0]])
    roots = roots / np.abs(roots)
    below = np.polyval(family.damper, roots)
    usable = np.abs(below) > 1e-9 * np.abs(family.damper).max()
    edges = (-np.polyval(fixed, roots[usable]) / below[usable]).real
    edges = np.concatenate([[0.0], np.unique(edges[edges > 0])])
    tried = np.concatenate([0.5 * (edges[1:] + edges[:-1]), [2 * edges[-1] + 1.0]])
    stable = np.flatnonzero(schur_stable(family(np.full(len(tried), stiffness), tried)))
    if not len(stable):
        return float("nan"), float("nan")
    upper = np.append(edges[1:], np.inf)
    # rounding splits an edge into twins: join intervals that touch
    ranges: list[list[float]] = []
    for i in stable:
        if ranges and edges[i] <= ranges[-1][1] * (1 + 1e-9):
            ranges[-1][1] = upper[i]
        else:
            ranges.append([edges[i], upper[i]])
    low, high = min(ranges, key=lambda r: max(r[0] - damping, damping - r[1], 0.0))
    return float(low), float(high)


def _padded(polynomial: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([np.zeros(length - len(polynomial)), polynomial])


def _trimmed(polynomial: np.ndarray) -> np.ndarray:
    """Without leading and trailing coefficients that are rounding: they would be roots at ∞ and 0."""
    kept = np.flatnonzero(np.abs(polynomial) > 1e-13 * np.abs(polynomial).max())
    return polynomial[kept[0] : kept[-1] + 1] if len(kept) else np.ones(1)
