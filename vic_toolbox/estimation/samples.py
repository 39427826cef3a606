"""What the estimators use of a recording: time, error, its rate and the wrench, checked once."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, positive_array

LATENCY = 0.05
"""Largest latency between wrench and motion that is looked for, either way [s]."""


class Motion(Protocol):
    """Anything with the four arrays below; :class:`vic_toolbox.recordings.Recording` is one."""

    @property
    def time(self) -> Any: ...  # noqa: D102
    @property
    def error(self) -> Any: ...  # noqa: D102
    @property
    def error_rate(self) -> Any: ...  # noqa: D102
    @property
    def wrench(self) -> Any: ...  # noqa: D102


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of ``wrench = K e + B ė + noise``.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Increasing [s].
    error, rate, wrench : ndarray, shape (n, 6)
        e [m, rad], ė [m/s, rad/s] and the wrench [N, Nm] that belongs to them, world axes.
    """

    time: Array
    error: Array
    rate: Array
    wrench: Array

    def __len__(self) -> int:
        return len(self.time)

    def delayed(self, delay: float) -> Samples:
        """The motion as it was `delay` seconds ago beside the wrench of now: what a late wrench belongs to.

        Motion is smooth and the wrench is noisy, so the motion is interpolated (cubic Hermite, which needs
        nothing but e and ė), never the wrench. At the ends it is held. Time becomes the clock of the motion.
        """
        if delay == 0 or len(self) < 2:
            return self
        t = self.time - delay
        left = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self) - 2)
        step = (self.time[left + 1] - self.time[left])[:, None]
        u = np.clip((t - self.time[left])[:, None] / step, 0.0, 1.0)
        e0, e1 = self.error[left], self.error[left + 1]
        v0, v1 = self.rate[left], self.rate[left + 1]
        error = (
            (1 + 2 * u) * (1 - u) ** 2 * e0
            + u * (1 - u) ** 2 * step * v0
            + u**2 * (3 - 2 * u) * e1
            - u**2 * (1 - u) * step * v1
        )
        return Samples(t, error, (1 - u) * v0 + u * v1, self.wrench)


def samples(recording: Motion) -> Samples:
    """Check a recording and take what an estimator needs of it.

    Raises
    ------
    InputError
        An array is missing, has another shape, holds NaN, or time does not increase.
    """
    check = getattr(recording, "check", None)
    if callable(check):
        check()
    if getattr(recording, "wrench_axes", "world") != "world":
        raise InputError(
            "the wrench is in the sensor's or the tool's axes; bring it into world axes first "
            "(vic_toolbox.recordings.wrench_to_world)."
        )
    try:
        arrays = recording.time, recording.error, recording.error_rate, recording.wrench
    except AttributeError as error:
        raise InputError(
            f"{type(recording).__name__} is not a recording ({error}); pass one of vic_toolbox.recordings, "
            "e.g. Recording.from_errors(time, error, error_rate, wrench)."
        ) from None
    time = finite_array("time", arrays[0], shape=(None,))
    n = len(time)
    if n < 2:
        raise InputError(f"the recording has {n} samples; an estimate needs at least two.")
    if (np.diff(time) <= 0).any():
        index = int(np.argmax(np.diff(time) <= 0)) + 1
        raise InputError(f"time[{index}] is {time[index]:g}, not after time[{index - 1}]; sort the samples.")
    e, v, w = (
        np.ascontiguousarray(finite_array(name, value, shape=(n, 6)))
        for name, value in zip(("error", "error_rate", "wrench"), arrays[1:], strict=True)
    )
    return Samples(time, e, v, w)


def pooled(recordings: Motion | Iterable[Motion]) -> list[Samples]:
    """Check one recording, or several whose clocks then all start at zero.

    Raises
    ------
    InputError
        As :func:`samples`, or an empty list.
    """
    if hasattr(recordings, "wrench") or not isinstance(recordings, Iterable):
        return [samples(recordings)]  # type: ignore[arg-type]
    several = [samples(recording) for recording in recordings]
    if not several:
        raise InputError("no recording was given; pass one, or a list of them.")
    if len(several) == 1:
        return several
    return [Samples(s.time - s.time[0], s.error, s.rate, s.wrench) for s in several]


def given_noise(noise: ArrayLike | None) -> Array | None:
    """Check the standard deviation of the wrench's noise, if it is known: one number for each axis [N, Nm]."""
    return None if noise is None else positive_array("noise", noise, shape=(6,))


def root_mean_square(value: Any) -> Array:
    """Root mean square over the first axis."""
    return np.sqrt(np.mean(np.square(value), axis=0))


def weights(parts: list[Samples], noise: Array, *, least: float = 1e-6) -> Array:
    """By how much [N, Nm] a residual of each axis counts as one: its noise, as far as that can be resolved.

    Noise below `least` times the force (or moment) is rounding and no reason to prefer one axis to another; an
    infinite one is not known yet: then the axes of force count alike, and those of moment.
    """
    size = root_mean_square(np.concatenate([p.wrench for p in parts])).reshape(2, 3)
    group = np.repeat(np.sqrt(np.mean(size**2, axis=1)), 3)
    group = np.where(group > 0, group, 1.0)
    return np.where(np.isfinite(noise), np.maximum(noise, least * group), group)
