"""Random signals with a known band and power: tremor, sway and excitation are sums of sines."""

from __future__ import annotations

import numpy as np

from vic_toolbox.errors import Array

LINES = 12
"""Sines in a signal."""


def multisine(
    time: Array, *, count: int, band: tuple[float, float], rms: Array, rng: np.random.Generator
) -> Array:
    """Sums of twelve sines, equally strong, their frequencies spread over a band, phases and places random.

    Parameters
    ----------
    time : ndarray, shape (T,)
        [s].
    count : int
        Independent signals of each channel.
    band : (float, float)
        Lowest and highest frequency [Hz].
    rms : ndarray, shape (k,)
        Root mean square of each channel over a long time.
    rng : numpy.random.Generator
        Draws one frequency in each twelfth of the band, and its phase.

    Returns
    -------
    ndarray, shape (T, count, k)
    """
    low, high = band
    shape = (count, len(rms), LINES)
    frequency = low + (high - low) * (np.arange(LINES) + rng.uniform(size=shape)) / LINES
    phase = rng.uniform(0.0, 2 * np.pi, shape)
    signal = np.zeros((len(time), *shape[:2]))
    for line in range(LINES):  # a sum over lines at once would take LINES times the memory
        angle = 2 * np.pi * np.multiply.outer(time, frequency[..., line]) + phase[..., line]
        signal += np.sin(angle)
    return signal * (np.sqrt(2.0 / LINES) * rms)


def smoothstep(share: Array) -> Array:
    """Minimum-jerk rise from 0 to 1 while the argument goes from 0 to 1."""
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))
