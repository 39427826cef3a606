"""Savitzky-Golay smoothing and derivatives of tracks that may be sampled unevenly."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_filter

from vic_toolbox.errors import Array, InputError, positive
from vic_toolbox.recordings import quaternions

ORDER = 3
WINDOW = 0.08
"""Length of the window [s]: from 0.1 mm of position noise at 1 kHz it leaves 0.3 % in the damping."""
JITTER = 0.02
"""Steps that differ by more than this share of the median one are no even clock."""


def smoothed(time: Array, values: Array, *, window: float) -> Array:
    """Value (n, k) of the cubic that fits the samples within ``± window/2`` best.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Increasing [s].
    values : ndarray, shape (n, k)
    window : float
        [s].

    Raises
    ------
    InputError
        The window is not positive, or there are fewer than five samples.
    """
    return _filtered(time, values, window, 0)


def derivative(time: Array, values: Array, *, window: float) -> Array:
    """Time derivative (n, k) of the cubic that fits the samples within ``± window/2`` best; see :func:`smoothed`."""
    return _filtered(time, values, window, 1)


def second_derivative(time: Array, values: Array, *, window: float) -> Array:
    """Second time derivative (n, k), of local quintics; see :func:`smoothed`."""
    return _filtered(time, values, window, 2)


def pose_twist(time: Array, position: Array, quat_wxyz: Array, *, window: float) -> Array:
    """Twist (n, 6) of a moving frame, world axes [m/s, rad/s]: ``v = ṗ``, ``ω = 2 (q̇ ⊗ q*)_v``.

    Parameters
    ----------
    time : ndarray, shape (n,)
    position : ndarray, shape (n, 3)
    quat_wxyz : ndarray, shape (n, 4)
    window : float
        Of the Savitzky-Golay derivative [s].
    """
    track = quaternions.continuous(quaternions.normalised(quat_wxyz))
    rates = derivative(time, np.hstack([position, track]), window=window)
    turning = 2.0 * quaternions.multiply(rates[:, 3:], quaternions.conjugate(track))
    return np.hstack([rates[:, :3], turning[:, 1:]])


def even_clock(time: Array) -> bool:
    """Whether the steps are equal, but for a little jitter."""
    step = np.diff(time)
    return bool((np.abs(step - np.median(step)) <= JITTER * np.median(step)).all())


def samples_in(window: float, step: float, count: int) -> int:
    """Odd number of samples in a window, at least five and at most `count`."""
    odd = 2 * round(window / step / 2) + 1
    largest = count if count % 2 else count - 1
    return int(min(max(odd, ORDER + 2), largest))


def _filtered(time: Array, values: Array, window: float, order: int) -> Array:
    window = positive("window", window)
    fewest = _degree(order) + 2
    if len(time) < fewest:
        raise InputError(
            f"{len(time)} samples are too few for a rate by local polynomials; pass at least {fewest}, "
            "or give the twist."
        )
    step = float(np.median(np.diff(time)))
    if even_clock(time):
        return _on_even_clock(values, float(time[-1] - time[0]) / (len(time) - 1), window, order)
    # an uneven clock goes through an even one; a gap there is bridged by a straight line
    count = min(round((time[-1] - time[0]) / step) + 1, 20 * len(time))
    grid = np.linspace(time[0], time[-1], max(count, ORDER + 2))
    even = np.column_stack([np.interp(grid, time, column) for column in values.T])
    even = _on_even_clock(even, float(grid[1] - grid[0]), window, order)
    return np.column_stack([np.interp(time, grid, column) for column in even.T])


def _on_even_clock(values: Array, step: float, window: float, order: int) -> Array:
    degree = _degree(order)
    length = max(samples_in(window, step, len(values)), degree + 2 - degree % 2)
    return np.asarray(savgol_filter(values, length, degree, order, delta=step, axis=0))


def _degree(order: int) -> int:
    """Degree of the polynomials: a cubic's second derivative would lose 6 % at 2 Hz in 80 ms, a quintic's 0.1 %."""
    return ORDER + 2 if order == 2 else ORDER
