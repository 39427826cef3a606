"""How late the wrench is against the pose: a scan of what a constant spring and damper leave unexplained."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from vic_toolbox.errors import Array, InputError, finite_number, positive
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.recording import Recording

STEPS = 41
MOST_SAMPLES = 20_000
LEAST_MOTION = 1e-9
SHARPEST = 1e-3
"""The best lag has to explain this share more than the edges of the scan, or nothing can be said."""


@dataclass(frozen=True)
class Latency:
    """Delay of the wrench against the pose."""

    seconds: float
    """Positive where the wrench is late [s]."""
    lags: Array
    """The lags that were tried [s]."""
    residual: Array
    """Root mean square that is left at each, relative to that of the wrench."""
    certain: bool
    """Whether the residual has a clear minimum inside the scan."""


def find_latency(
    recording: Recording, *, largest: float = 0.05, axes: tuple[int, ...] | None = None
) -> Latency:
    """Find the lag τ at which ``wrench(t) = K e(t − τ) + B ė(t − τ) + c`` leaves least, K, B, c constant.

    The pose is shifted, not the wrench: interpolation smooths noise, and a smoothed wrench would fit better at
    lags between the samples. Every axis has its own K, B, c; the residuals are summed in units of each axis'
    scatter. A wrench that is late by τ makes B smaller by K τ.

    Parameters
    ----------
    recording : Recording
    largest : float
        Largest lag that is looked for, to both sides [s].
    axes : tuple of int, optional
        Axes to use; by default those that move.

    Raises
    ------
    InputError
        Nothing moves, or the recording is too short for such lags.
    """
    largest = positive("largest", largest)
    time, error, rate, wrench = recording.time, recording.error, recording.error_rate, recording.wrench
    if recording.duration < 6 * largest or len(recording) < 50:
        raise InputError(f"{recording.duration:g} s are too short to look for lags of {largest:g} s.")
    if axes is None:
        axes = tuple(i for i in range(6) if error[:, i].std() > LEAST_MOTION and wrench[:, i].std() > 0)
    if not axes:
        raise InputError("no axis has both motion and wrench; nothing tells a latency.")
    inside = (time >= time[0] + largest) & (time <= time[-1] - largest)
    which = np.flatnonzero(inside)[:: max(1, int(inside.sum()) // MOST_SAMPLES)]
    columns = list(axes)
    motion = CubicSpline(time, np.hstack([error[:, columns], rate[:, columns]]))
    seen = wrench[which][:, columns]
    seen = seen - seen.mean(axis=0)
    scatter = seen.std(axis=0)

    def residual(lag: float) -> float:
        shifted = motion(time[which] - lag)
        total = 0.0
        for i in range(len(columns)):
            total += _unexplained(shifted[:, [i, len(columns) + i]], seen[:, i] / (scatter[i] or 1.0))
        return total / len(columns)

    lags = np.linspace(-largest, largest, STEPS)
    values = np.array([residual(lag) for lag in lags])
    best = int(values.argmin())
    lag, width = lags[best], lags[1] - lags[0]
    for _ in range(6):  # parabolas through ever closer triples
        low, mid, high = residual(lag - width), residual(lag), residual(lag + width)
        bend = low - 2 * mid + high
        step = 0.5 * width * (low - high) / bend if bend > 0 else 0.0
        lag = float(np.clip(lag + np.clip(step, -width, width), -largest, largest))
        width /= 3
    inner = 0 < best < STEPS - 1
    gain = min(values[0], values[-1]) - values[best]
    return Latency(float(lag), lags, np.sqrt(values), bool(inner and gain > SHARPEST))


def _unexplained(motion: Array, wrench: Array) -> float:
    """Mean square of `wrench` (n,) that a linear fit of `motion` (n, 2) and a constant leaves."""
    centred = motion - motion.mean(axis=0)
    scale = centred.std(axis=0)
    centred = centred / np.where(scale == 0, 1.0, scale)
    solution, *_ = np.linalg.lstsq(centred.T @ centred, centred.T @ wrench, rcond=1e-12)
    return float(np.mean((wrench - centred @ solution) ** 2))


def shift_wrench(recording: Recording, seconds: float) -> Recording:
    """Bring a wrench that is late by `seconds` back to the time of the pose: ``wrench'(t) = wrench(t + τ)``.

    The pose is put on the wrench's clock, so the noise of the wrench stays as it was; the ends, where there is
    no pose, are cut off.

    Parameters
    ----------
    recording : Recording
    seconds : float
        ``τ``, positive for a late wrench [s].

    Raises
    ------
    InputError
        Nothing is left, or the recording has errors.
    """
    recording.check()
    lag = finite_number("seconds", seconds)
    when = recording.time - lag  # where the pose was when this wrench acted
    keep = (when >= recording.time[0]) & (when <= recording.time[-1])
    if keep.sum() < 2:
        raise InputError(f"a recording of {recording.duration:g} s cannot be shifted by {lag:g} s.")
    when = when[keep]
    changes = {"time": when, "wrench": recording.wrench[keep]}
    for name, array in recording.arrays().items():
        if name in changes:
            continue
        if name.endswith("quat_wxyz"):
            track = quaternions.normalised(array)
            changes[name] = quaternions.interpolate(recording.time, track, when)
        else:
            changes[name] = CubicSpline(recording.time, array)(when)
    return recording.noted(f"wrench shifted by {1e3 * lag:.3g} ms", **changes)
