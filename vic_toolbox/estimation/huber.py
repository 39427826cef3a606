"""Huber's loss: residuals count squared near zero and linearly beyond, so that outliers pull little (Huber 1964)."""

from __future__ import annotations

import numpy as np

from vic_toolbox.errors import Array

LIMIT = 1.345
"""Residual, in standard deviations, beyond which Huber's loss is linear (95 % efficient for Gaussian noise)."""


def scale(residuals: Array) -> Array:
    """Standard deviation of Gaussian noise with these residuals' median absolute value, (6,)."""
    return 1.4826 * np.median(np.abs(residuals), axis=0)


def weights(residuals: Array) -> Array:
    """Huber's weights: one inside ± 1.345 robust deviations, falling as the inverse of the residual outside."""
    limit = LIMIT * scale(residuals)
    size = np.abs(residuals)
    return np.where(size > limit, limit / np.where(size > 0, size, 1.0), 1.0)


def widening(residuals: Array, weight: Array, noise: Array, *, axis: int | None = 0) -> Array:
    """By how much deviations grow: the sandwich of Huber's estimate over the information that the weights leave.

    For each wrench axis, (6,); with ``axis=None`` one number for all of them together.
    """
    standard = residuals / np.where(noise > 0, noise, 1.0)
    psi = np.clip(standard, -LIMIT, LIMIT)
    inside = np.mean(np.abs(standard) <= LIMIT, axis=axis)
    return np.sqrt(np.mean(psi**2, axis=axis) * np.mean(weight, axis=axis)) / inside
