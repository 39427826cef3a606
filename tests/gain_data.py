"""Recordings with known gains: rich motion and reaching, smooth and step-like gains, noise of an F/T sensor."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.recordings import Recording

NOISE = np.repeat([0.2, 0.01], 3)
"""Of the wrench [N, Nm]."""
STIFFNESS = np.array([600.0, 900.0, 400.0, 30.0, 40.0, 20.0])
MASS = np.repeat([3.0, 0.05], 3)


class Known(NamedTuple):
    """A recording and the gains that made it."""

    recording: Recording
    stiffness: Array
    damping: Array


def clock(duration: float, rate: float = 1000.0) -> Array:
    return np.arange(round(duration * rate)) / rate


def rich_motion(t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Six frequencies from 0.3 to 3 Hz, 15 mm or 80 mrad rms: error and its rate."""
    size = np.repeat([0.015, 0.08], 3) * np.sqrt(2 / 6)
    rate = 2 * np.pi * rng.uniform(0.3, 3.0, (6, 6))
    phase = rate * t[:, None, None] + rng.uniform(0, 2 * np.pi, (6, 6))
    return size * np.sin(phase).sum(axis=1), size * (rate * np.cos(phase)).sum(axis=1)


def reach(t: Array) -> tuple[Array, Array]:
    """A minimum-jerk reach of about 0.3 m."""
    size, s = np.array([0.3, 0.2, 0.25, 0.3, 0.2, 0.4]), (t / t[-1])[:, None]
    return size * (1 - 10 * s**3 + 15 * s**4 - 6 * s**5), -size * 30 * (s**2 - 2 * s**3 + s**4) / t[-1]


def gains(t: Array, profile: str, rng: np.random.Generator) -> tuple[Array, Array]:
    """Diagonals of K(t) and B(t); damping is 0.7 of critical for 3 kg."""
    if profile == "constant":
        k = np.tile(STIFFNESS, (len(t), 1))
    elif profile == "smooth":
        k = STIFFNESS * (1 + 0.5 * np.sin(2 * np.pi * 0.2 * t[:, None] + rng.uniform(0, 2 * np.pi, 6)))
    else:
        first, second = (1 / (1 + np.exp(-(t - share * t[-1]) / 0.05)) for share in (0.35, 0.7))
        k = STIFFNESS * (1.5 - first + 0.6 * second)[:, None]
    return k, 1.4 * np.sqrt(k * MASS)


def diagonal(
    seed: int = 0,
    *,
    duration: float = 10.0,
    profile: str = "smooth",
    motion: str = "rich",
    noise: float = 1.0,
) -> Known:
    rng = np.random.default_rng(seed)
    t = clock(duration)
    e, v = rich_motion(t, rng) if motion == "rich" else reach(t)
    k, b = gains(t, profile, rng)
    return Known(recorded(t, e, v, k * e + b * v, noise=noise, rng=rng), k, b)


def full(seed: int = 0, *, duration: float = 10.0, noise: float = 1.0) -> Known:
    """SPD gains with turning axes, every entry in its own units."""
    rng = np.random.default_rng(seed)
    t = clock(duration)
    e, v = rich_motion(t, rng)
    turn, first = (x - x.T for x in rng.normal(size=(2, 6, 6)))
    values, vectors = np.linalg.eig(turn / np.linalg.norm(turn))
    angle = 0.6 * np.sin(2 * np.pi * 0.15 * t)
    rotation = np.real((vectors * np.exp(values * angle[:, None])[:, None, :]) @ np.linalg.inv(vectors))
    rotation = rotation @ np.linalg.qr(first + np.eye(6))[0]
    size = np.array([400.0, 600, 800, 900, 1100, 500]) * (
        1 + 0.4 * np.sin(2 * np.pi * 0.2 * t[:, None] + rng.uniform(0, 6, 6))
    )
    lever = np.repeat([1.0, 0.2], 3)
    k = (rotation * size[:, None, :]) @ np.swapaxes(rotation, 1, 2) * np.outer(lever, lever)
    b = (
        (rotation * (1.4 * np.sqrt(3 * size))[:, None, :])
        @ np.swapaxes(rotation, 1, 2)
        * np.outer(lever, lever)
    )
    wrench = (k @ e[..., None] + b @ v[..., None])[..., 0]
    return Known(recorded(t, e, v, wrench, noise=noise, rng=rng), k, b)


def recorded(
    t: Array, e: Array, v: Array, wrench: Array, *, noise: float = 0.0, rng: np.random.Generator | None = None
) -> Recording:
    rng = rng or np.random.default_rng(0)
    return Recording.from_errors(t, e, v, wrench + noise * NOISE * rng.normal(size=wrench.shape))


def biased() -> Recording:
    """Case A5: 600 N/m pushed to one side, and 3 N of sensor bias."""
    t = clock(2.0)
    wave = 0.5 * (1 - np.cos(2 * np.pi * t))[:, None] * np.ones(6)
    size = wave.mean(axis=0) / np.mean(wave**2, axis=0) / 30  # mean(e) / mean(e²) = 30 / m
    e, v = size * wave, size * np.pi * np.sin(2 * np.pi * t)[:, None]
    noise = 0.2 * np.random.default_rng(0).normal(size=e.shape)
    return recorded(t, e, v, 600 * e + 20 * v + 3 + noise)


def struck() -> Recording:
    """Case A10: 600 N/m and 2 % outliers of 20 ± 30 N."""
    t = clock(10.0)
    rng = np.random.default_rng(0)
    e, v = rich_motion(t, rng)
    scale = np.repeat([1.0, 0.015 / 0.08], 3)
    e, v = scale * e + 0.01, scale * v  # pushed to one side, or outliers of one sign would cancel
    wrench = 600 * e + 20 * v + 0.2 * rng.normal(size=e.shape)
    hit = rng.random(e.shape) < 0.02
    wrench[hit] += 20 + 30 * rng.normal(size=hit.sum())
    return recorded(t, e, v, wrench)


def diagonals(matrices: Array) -> Array:
    return np.diagonal(matrices, axis1=-2, axis2=-1)


def relative_rms(found: Array, true: Array) -> float:
    """Root mean square error relative to that of the truth; every entry has to be there."""
    return float(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))
