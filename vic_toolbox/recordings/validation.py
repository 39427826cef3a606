"""What is wrong with a recording: findings with a sample index and a remedy.

An *error* makes the numbers meaningless (time that runs backwards, NaN, a quaternion that is none): whatever
computes with the recording refuses it. A *warning* is legal data that is often a mistake. Nothing is changed
silently: mending is :mod:`vic_toolbox.recordings.repairs`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.recordings import quaternions
from vic_toolbox.spatial import QUATERNION_TOLERANCE

if TYPE_CHECKING:
    from vic_toolbox.recordings.recording import Recording

AXES = ("fx", "fy", "fz", "mx", "my", "mz")
ABSURD = 1e30
"""Numbers beyond this are damage: nothing in SI units is so large, and its fourth power still has to be a number."""
LARGEST_POSITION = 20.0
"""Beyond this distance from the origin [m], positions are millimetres."""
LARGEST_FORCE = 2e4
"""Beyond this force [N] it is millinewton."""
LARGEST_LEVER = 20.0
"""Moments above this lever times the force [m] are Nmm."""
LARGEST_JOINT = 30.0
"""Joint positions beyond this [rad] are degrees."""
SLOWEST = 0.5
"""A median step above this [s] means that time is not in seconds."""
GAP = 4.0
"""A step this many times the median one is a gap."""
FROZEN = 0.25
"""A sensor channel that repeats one value for so long [s] is frozen."""
SATURATED = 5
"""A sensor channel that stays at its own extreme for so many samples in a row is clipped."""


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong with a recording, or looks so."""

    kind: str
    """What: ``time``, ``nan``, ``quaternion``, ``flip``, ``duplicate``, ``gap``, ``units``, ``frozen``, ..."""
    severity: Literal["error", "warning"]
    """An error makes the numbers meaningless; a warning is legal and often a mistake."""
    index: int
    """First sample that shows it."""
    count: int
    """Number of samples that show it."""
    message: str
    """What was found."""
    remedy: str
    """What to do."""

    def __str__(self) -> str:
        return f"{self.severity}: {self.message} (first at sample {self.index}). {self.remedy}."


def findings(recording: Recording) -> tuple[Finding, ...]:
    """Everything that is wrong with a recording, or looks so: errors first, each with its first sample.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    tuple of Finding
        Empty where nothing was found.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        found = [*_not_finite(recording), *_time(recording), *_orientations(recording)]
        flips = list(_flips(recording))
    if not found:  # the remaining questions make sense for finite numbers on an increasing clock only
        found = [
            *_rows(recording),
            *_units(recording),
            *_far_reference(recording),
            *_sensor(recording),
        ]
    return tuple(sorted([*found, *flips], key=lambda finding: finding.severity != "error"))


def meaningful(array: Array) -> NDArray[np.bool_]:
    """Samples (n,) in which every number is finite, and small enough to compute with."""
    return np.asarray((np.abs(array.reshape(len(array), -1)) < ABSURD).all(axis=1))


def _not_finite(recording: Recording) -> Iterator[Finding]:
    for name, array in recording.arrays().items():
        bad = ~meaningful(array)
        if bad.any():
            yield Finding(
                "nan",
                "error",
                int(bad.argmax()),
                int(bad.sum()),
                f"{name} is not finite, or absurdly large, in {bad.sum()} of {len(bad)} samples",
                "Drop them with repair(recording, ['nan']), or fill them where the log was made",
            )


def _time(recording: Recording) -> Iterator[Finding]:
    step = np.diff(recording.time)
    back, same = step < 0, step == 0
    if back.any():
        index = int(back.argmax()) + 1
        yield Finding(
            "time",
            "error",
            index,
            int(back.sum()),
            f"time runs backwards {back.sum()} times, first by {-step[index - 1]:.3g} s",
            "Cut the log there (two logs in one file?), or drop late samples with repair(recording, ['time'])",
        )
    if same.any():
        yield Finding(
            "duplicate",
            "error",
            int(same.argmax()) + 1,
            int(same.sum()),
            f"{same.sum()} samples have the same time as the one before",
            "Drop them with repair(recording, ['duplicate'])",
        )


def _orientations(recording: Recording) -> Iterator[Finding]:
    for name in ("quat_wxyz", "reference_quat_wxyz"):
        off = np.abs(np.linalg.norm(getattr(recording, name), axis=1) - 1)
        bad = off > QUATERNION_TOLERANCE
        if bad.any():
            yield Finding(
                "quaternion",
                "error",
                int(bad.argmax()),
                int(bad.sum()),
                f"{name} has norm {np.linalg.norm(getattr(recording, name)[bad.argmax()]):.4g}, not 1, "
                f"in {bad.sum()} samples",
                "Check which columns it was read from; repair(recording, ['quaternion']) normalises",
            )


def _flips(recording: Recording) -> Iterator[Finding]:
    for name in ("quat_wxyz", "reference_quat_wxyz"):
        flips = quaternions.sign_flips(getattr(recording, name))
        if len(flips):
            yield Finding(
                "flip",
                "warning",
                int(flips[0]),
                len(flips),
                f"{name} changes its sign {len(flips)} times, which is the same rotation",
                "Nothing here minds; repair(recording, ['flip']) removes the jumps for those who do",
            )


def _rows(recording: Recording) -> Iterator[Finding]:
    step = np.diff(recording.time)
    if len(step) == 0:
        return
    usual = float(np.median(step))
    gap = step > GAP * usual
    if gap.any():
        yield Finding(
            "gap",
            "warning",
            int(gap.argmax()) + 1,
            int(gap.sum()),
            f"{gap.sum()} gaps in time, the longest {step.max():.3g} s where steps are {usual:.3g} s",
            "Fit the pieces apart (recording.between), the rate of the error is not known across a gap",
        )
    measured = np.hstack([recording.position, recording.quat_wxyz, recording.wrench])
    same = (measured[1:] == measured[:-1]).all(axis=1)
    if same.any() and not same.all():
        yield Finding(
            "duplicate",
            "warning",
            int(same.argmax()) + 1,
            int(same.sum()),
            f"{same.sum()} rows repeat the pose and wrench of the row before",
            "Drop them with repair(recording, ['duplicate']), or log every source at its own rate",
        )


def _units(recording: Recording) -> Iterator[Finding]:
    def suspect(name: str, size: Array, limit: float, guess: str) -> Iterator[Finding]:
        large = size > limit
        if large.any():
            yield Finding(
                "units",
                "warning",
                int(large.argmax()),
                int(large.sum()),
                f"{name} reaches {size.max():.3g}, which looks like {guess}",
                "State the unit when reading (units in the layout), everything here is SI",
            )

    step = np.diff(recording.time)
    if len(step) and np.median(step) > SLOWEST:
        guess = "milliseconds" if np.median(step) < 5e2 else "micro- or nanoseconds"
        yield Finding(
            "units",
            "warning",
            0,
            len(recording),
            f"the median step of time is {np.median(step):.3g} s, which looks like {guess}",
            "State the unit when reading (units in the layout), everything here is SI",
        )
    norm = np.linalg.norm
    for name in ("position", "reference_position"):
        yield from suspect(name, norm(getattr(recording, name), axis=1), LARGEST_POSITION, "millimetres")
    force, moment = norm(recording.wrench[:, :3], axis=1), norm(recording.wrench[:, 3:], axis=1)
    yield from suspect("the force", force, LARGEST_FORCE, "millinewton")
    typical = float(np.sqrt(np.mean(force**2)))
    if typical > 1.0 and np.sqrt(np.mean(moment**2)) > LARGEST_LEVER * typical:
        yield from suspect("the moment", moment, LARGEST_LEVER * typical, "Nmm")
    if recording.joint_position is not None:
        joints = np.abs(recording.joint_position).max(axis=1, initial=0.0)
        yield from suspect("joint_position", joints, LARGEST_JOINT, "degrees")


def _far_reference(recording: Recording) -> Iterator[Finding]:
    distance = np.linalg.norm(recording.position - recording.reference_position, axis=1)
    turned = np.abs((recording.quat_wxyz * recording.reference_quat_wxyz).sum(axis=1))
    twisted = turned < np.cos(0.75)
    if twisted.mean() > 0.5 and recording.given_error is None:
        angle = np.degrees(2 * np.arccos(np.median(np.clip(turned, 0, 1))))
        yield Finding(
            "reference",
            "warning",
            int(twisted.argmax()),
            int(twisted.sum()),
            f"the reference is turned by {angle:.0f}° against the end-effector",
            "Check the order of its quaternion and its axes; the rotational gains will be wrong",
        )
    far = distance > 1.0
    if far.mean() > 0.5 and recording.given_error is None:
        yield Finding(
            "reference",
            "warning",
            int(far.argmax()),
            int(far.sum()),
            f"the reference is {np.median(distance):.3g} m away from the end-effector",
            "Check that both are in the same axes and the same unit",
        )


def _sensor(recording: Recording) -> Iterator[Finding]:
    wrench = recording.wrench
    if len(recording) < 2:
        return
    if not wrench.any():
        yield Finding(
            "zero",
            "warning",
            0,
            len(recording),
            "the wrench is zero throughout",
            "Check which columns or topic it was read from; nothing can be fitted to it",
        )
        return
    step = float(np.median(np.diff(recording.time)))
    longest_hold = max(int(np.ceil(FROZEN / step)), 20)
    still = [name for name, column in zip(AXES, wrench.T, strict=True) if (column == column[0]).all()]
    if still:
        yield Finding(
            "constant",
            "warning",
            0,
            len(recording),
            f"{', '.join(still)} never change",
            "Nothing can be fitted along these axes",
        )
    for name, column in zip(AXES, wrench.T, strict=True):
        if name in still:
            continue
        start, length = _runs(column)
        clipped = ((column[start] == column.max()) | (column[start] == column.min())) & (column[start] != 0)
        clipped &= length >= SATURATED
        frozen = (length >= longest_hold) & ~clipped
        if clipped.any():
            yield Finding(
                "saturated",
                "warning",
                int(start[clipped.argmax()]),
                int(length[clipped].sum()),
                f"{name} stays at its extreme {column[start[clipped.argmax()]]:.4g} in {clipped.sum()} stretches",
                "The sensor is clipped there: leave these stretches out, or record with a larger range",
            )
        if frozen.any():
            yield Finding(
                "frozen",
                "warning",
                int(start[frozen.argmax()]),
                int(length[frozen].sum()),
                f"{name} repeats one value for up to {length[frozen].max() * step:.3g} s",
                "The sensor or its driver stood still: leave these stretches out",
            )


def _runs(column: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """First sample and length of every stretch of equal values."""
    start = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1]]))
    return start, np.diff(np.append(start, len(column)))
