"""Topics at different rates, brought onto one clock.

The default clock is the wrench's own: its noise stays as it was, and the pose, which is smooth, is what is
interpolated. Positions and rates go linearly, orientations along the shortest rotation. A reference is held
before its first and after its last message, since many are published once; everything else is cut to the time
that wrench and pose have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array, FileError, InputError, positive
from vic_toolbox.files import LARGEST_BYTES
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.table import Table, too_large
from vic_toolbox.recordings.validation import GAP

NANO = 1e-9
LONGEST_BRIDGE = 0.1
"""A gap in the pose that is longer than this [s], and than four steps, is not bridged."""


@dataclass(frozen=True)
class Stream:
    """Messages of one topic."""

    role: str
    """wrench, pose, reference, twist or joints."""
    topic: str
    """Its name."""
    time: NDArray[np.int64]
    """(n,) [ns]."""
    values: Array
    """(n, k)."""
    names: tuple[str, ...] = ()
    """Names of the joints."""


def on_one_clock(
    source: str, streams: Sequence[Stream], *, clock: str | float = "wrench", repair: bool = False
) -> Table:
    """Resample streams onto one clock.

    Parameters
    ----------
    source : str
        The file, for messages.
    streams : sequence of Stream
        With a wrench and a pose.
    clock : str or float
        ``wrench``, ``pose``, or a rate [Hz].
    repair : bool
        Drop messages whose time runs backwards.

    Returns
    -------
    Table
        Time in seconds after the first sample.

    Raises
    ------
    FileError
        Wrench and pose have no time in common, or the time of a topic runs backwards.
    InputError
        Unknown clock.
    """
    notes: list[str] = []
    by_role = {stream.role: _ordered(source, stream, notes, repair) for stream in streams}
    wrench, pose = by_role["wrench"], by_role["pose"]
    begin, end = max(wrench.time[0], pose.time[0]), min(wrench.time[-1], pose.time[-1])
    if begin >= end:
        raise FileError(
            f"{source}: {wrench.topic} ({_span(wrench, begin)}) and {pose.topic} ({_span(pose, begin)}) have no time "
            "in common; their clocks differ: read with stamps='arrival'."
        )
    if clock in ("wrench", "pose"):
        times = by_role[str(clock)].time
        times = times[(times >= begin) & (times <= end)]
    elif isinstance(clock, str):
        raise InputError(f"clock is {clock!r}; choose 'wrench', 'pose' or a rate [Hz].")
    else:
        count = float(end - begin) * NANO * positive("clock", clock)
        if count * 8 * sum(stream.values.shape[1] for stream in streams) > LARGEST_BYTES:
            raise too_large(source, f"would have {count:.3g} samples at {clock:g} Hz")
        times = begin + (np.arange(int(count) + 1) / clock / NANO).astype(np.int64)
    kept = _without_gaps(times, pose)
    if len(kept) < len(times):
        notes.append(f"left out {len(times) - len(kept)} samples in gaps of {pose.topic}")
    if len(kept) == 0:
        raise FileError(
            f"{source}: no sample is left on the clock of {clock}; the topics hardly overlap in time."
        )
    if not isinstance(clock, str) or clock != "wrench" or len(by_role) > 1:
        notes.append(f"everything on the clock of {clock if isinstance(clock, str) else f'{clock:g} Hz'}")
    seconds = (kept - kept[0]) * NANO
    columns: dict[str, Array] = {"time": seconds}
    fields: dict[str, tuple[str, ...]] = {"time": ("time",)}
    for role, stream in by_role.items():
        for field, (names, values) in _fields(role, stream, kept).items():
            fields[field] = tuple(names)
            columns |= dict(zip(names, values.T, strict=True))
    return Table(source, tuple(columns), lambda names: {n: columns[n] for n in names}, tuple(notes), fields)


def _span(stream: Stream, origin: int) -> str:
    first, last = (stream.time[[0, -1]] - origin) * NANO
    return f"{first:.3f} to {last:.3f} s"


def _ordered(source: str, stream: Stream, notes: list[str], repair: bool) -> Stream:
    """The stream on an increasing clock: equal times are the same message, backward ones an error."""
    step = np.diff(stream.time)
    if (step > 0).all():
        return stream
    backwards = step < 0
    if backwards.any() and not repair:
        raise FileError(
            f"{source}: the time of {stream.topic} runs backwards {backwards.sum()} times, first at message "
            f"{backwards.argmax() + 1}; read with stamps='arrival', or with repair=True to drop late messages."
        )
    latest = np.maximum.accumulate(stream.time)
    keep = np.concatenate([[True], stream.time[1:] > latest[:-1]])
    notes.append(f"dropped {np.count_nonzero(~keep)} messages of {stream.topic} whose time does not advance")
    return Stream(stream.role, stream.topic, stream.time[keep], stream.values[keep], stream.names)


def _without_gaps(times: NDArray[np.int64], pose: Stream) -> NDArray[np.int64]:
    step = np.diff(pose.time)
    longest = max(GAP * float(np.median(step)), LONGEST_BRIDGE / NANO)
    after = np.clip(np.searchsorted(pose.time, times), 1, len(step))
    exact = (times == pose.time[after]) | (times == pose.time[after - 1])
    return times[(step[after - 1] <= longest) | exact]


def _fields(role: str, stream: Stream, times: NDArray[np.int64]) -> dict[str, tuple[list[str], Array]]:
    """Columns of a stream at other times, by field of a layout."""
    origin = stream.time[0]
    own, wanted = (stream.time - origin) * NANO, (times - origin) * NANO

    def linear(values: Array) -> Array:
        return np.column_stack([np.interp(wanted, own, column) for column in values.T])

    if role == "wrench":
        names = [f"wrench.{half}.{axis}" for half in ("force", "torque") for axis in "xyz"]
        return {"wrench": (names, linear(stream.values))}
    if role in ("pose", "reference"):
        prefix = "reference_" if role == "reference" else ""
        track = quaternions.normalised(stream.values[:, [6, 3, 4, 5]])
        norm = np.linalg.norm(stream.values[:, 3:], axis=1)
        turned = quaternions.interpolate(own, track, wanted)
        if (np.abs(norm - 1) > 0.01).any():  # let validation see and tell it
            turned = turned * np.interp(wanted, own, norm)[:, None]
        return {
            f"{prefix}position": ([f"{role}.position.{a}" for a in "xyz"], linear(stream.values[:, :3])),
            f"{prefix}quat_wxyz": ([f"{role}.orientation.{a}" for a in "wxyz"], turned),
        }
    if role == "twist":
        names = [f"twist.{half}.{axis}" for half in ("linear", "angular") for axis in "xyz"]
        return {"twist": (names, linear(stream.values))}
    count = len(stream.names)
    halves = {"joint_position": stream.values[:, :count], "joint_velocity": stream.values[:, count:]}
    return {
        field: ([f"{field}.{name}" for name in stream.names], linear(values))
        for field, values in halves.items()
        if count and np.isfinite(values).all()
    }
