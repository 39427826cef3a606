"""Windows with tied damping, ``B = d √K``: the paper's six stiffnesses and a damping factor.

With s = √k ≥ 0 an axis fits ``f = s² e + d s v``. The factor is shared by the three axes of translation, and another
by those of rotation (it is in √kg in one, √(kg m²) in the other): four unknowns for three axes, the problem is not
linear, and it depends on the samples only through Σe², Σev, Σv², Σef, Σvf and Σf². Levenberg-Marquardt on those sums
solves all windows side by side, from several factors, because the sum of squares can have more than one minimum.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation.samples import Samples
from vic_toolbox.estimation.windows_diagonal import window_count, window_sum

ITERATIONS = 60
STARTS = (0.3, 1.0, 3.0)
"""Starting factors, relative to what a fit of free damping suggests."""
SUMS = 6
"""Σe², Σev, Σv², Σef, Σvf, Σf²."""


@dataclass(frozen=True, eq=False)
class FactorWindows:
    """Tied gains of every window.

    Parameters
    ----------
    root : ndarray, shape (m, 6)
        s = √k.
    factor : ndarray, shape (m, 2)
        d of translation and of rotation.
    covariance : ndarray, shape (m, 2, 4, 4)
        Of (s, s, s, d) for each group; infinite on the diagonal where the data do not determine them.
    condition : ndarray, shape (m, 2)
        Condition number of the information, each unknown scaled to unit information.
    squares : ndarray, shape (m, 2)
        Weighted sum of squares, Σ (f − k e − b v)² / σ².
    """

    root: Array
    factor: Array
    covariance: Array
    condition: Array
    squares: Array


def window_sums(data: Samples, window: int, step: int) -> Array:
    """The six sums over every window, shape (6, m, 6): kind, window, axis."""
    e, v, f = data.error, data.rate, data.wrench
    count = window_count(len(data), window, step)
    return np.stack([window_sum(x, window, step, count) for x in (e * e, e * v, v * v, e * f, v * f, f * f)])


def factor_windows(sums: Array, noise: Array, *, start: tuple[Array, Array]) -> FactorWindows:
    """Fit every window.

    Parameters
    ----------
    sums : ndarray, shape (6, m, 6)
        :func:`window_sums`.
    noise : ndarray, shape (6,)
        Standard deviation of the wrench's noise, by which the axes are weighed against each other.
    start : pair of ndarray, shape (6,)
        Constant K and B of the whole recording, to start from.
    """
    groups = []
    for axes in (slice(0, 3), slice(3, 6)):
        part = sums[:, :, axes] / noise[axes] ** 2
        stiffness = np.maximum(np.nan_to_num(start[0][axes]), 0)
        damping = np.maximum(np.nan_to_num(start[1][axes]), 0)
        stiffness = np.where(stiffness > 0, stiffness, max(stiffness.max(), 1.0))
        guess = np.median(damping / np.sqrt(stiffness))
        groups.append(_group(part, np.sqrt(stiffness), guess if guess > 0 else 1.0))
    s, d, covariance, condition, squares = zip(*groups, strict=True)
    return FactorWindows(
        np.concatenate(s, axis=1),
        np.stack(d, axis=1),
        np.stack(covariance, axis=1),
        np.stack(condition, axis=1),
        np.stack(squares, axis=1),
    )


def _group(sums: Array, root: Array, guess: float) -> tuple[Array, Array, Array, Array, Array]:
    best, lowest = None, np.full(sums.shape[1], np.inf)
    for share in STARTS:
        x = np.empty((sums.shape[1], 4))
        x[:, :3], x[:, 3] = root, share * guess
        x, value = _descend(sums, x)
        best = x if best is None else np.where((value < lowest)[:, None], x, best)
        lowest = np.minimum(value, lowest)
    assert best is not None
    _, _, information = _model(sums, best)
    size = np.sqrt(np.diagonal(information, axis1=1, axis2=2))
    seen = size > 0
    safe = np.where(seen, size, 1.0)
    values, vectors = np.linalg.eigh(information / (safe[:, :, None] * safe[:, None, :]))
    inverse = 1 / np.maximum(values, 1e-14)
    covariance = (vectors * inverse[:, None, :]) @ np.swapaxes(vectors, 1, 2)
    covariance = covariance / (safe[:, :, None] * safe[:, None, :])
    unseen = ~seen | (np.diagonal(covariance, axis1=1, axis2=2) * safe**2 > 1e11)
    covariance[np.broadcast_to(np.eye(4, dtype=bool), covariance.shape) & unseen[:, :, None]] = np.inf
    with np.errstate(divide="ignore", invalid="ignore"):
        condition = np.where(unseen.any(axis=1), np.inf, values[:, -1] / np.maximum(values[:, 0], 0.0))
    return best[:, :3], best[:, 3], covariance, condition, np.maximum(lowest, 0.0)


def _descend(sums: Array, x: Array) -> tuple[Array, Array]:
    """Levenberg-Marquardt with s, d ≥ 0 by clipping; every window has a damping of its own."""
    trust = np.full(len(x), 1e-3)
    value, gradient, information = _model(sums, x)
    for _ in range(ITERATIONS):
        diagonal = np.diagonal(information, axis1=1, axis2=2)
        damped = (
            information
            + np.eye(4) * (trust[:, None] * diagonal + 1e-12 * diagonal.max(axis=1)[:, None])[:, None, :]
        )
        damped[diagonal.max(axis=1) == 0] += np.eye(4)
        trial = np.maximum(x - np.linalg.solve(damped, gradient[..., None])[..., 0], 0.0)
        new, *_ = _model(sums, trial)
        better = new < value
        shift = np.abs(trial - x).max(axis=1) / np.maximum(np.abs(x).max(axis=1), 1e-12)
        x = np.where(better[:, None], trial, x)
        trust = np.clip(np.where(better, trust / 5, trust * 4), 1e-12, 1e12)
        value, gradient, information = _model(sums, x)
        if not (better & (shift > 1e-12)).any() and (trust > 1e6).all():
            break
    return x, value


def _model(sums: Array, x: Array) -> tuple[Array, Array, Array]:
    """Sum of squares (m,), half its gradient (m, 4) and the Gauss-Newton information (m, 4, 4)."""
    a, b, c, p, q, f = sums
    s, d = x[:, :3], x[:, 3:]
    k, g = s * s, d * s
    rest_e, rest_v = p - k * a - g * b, q - k * b - g * c  # Σ e r and Σ v r
    value = np.sum(f - k * (p + rest_e) - g * (q + rest_v), axis=1)
    gradient = np.concatenate(
        [-(2 * s * rest_e + d * rest_v), -np.sum(s * rest_v, axis=1, keepdims=True)], axis=1
    )
    information = np.zeros((len(x), 4, 4))
    index = np.arange(3)
    information[:, index, index] = 4 * s**2 * a + 4 * s * d * b + d**2 * c
    information[:, index, 3] = information[:, 3, index] = s * (2 * s * b + d * c)
    information[:, 3, 3] = np.sum(s**2 * c, axis=1)
    return value, gradient, information
