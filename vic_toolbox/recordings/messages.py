"""ROS messages of fixed layout, decoded a whole topic at a time.

A bag carries the definitions of its own message types, and generic decoders compile code from them. That is
not done here: the few types that a recording needs are known, and their numbers lie at the end of the message,
after a header with a time and a name.

=====================  ==========================================================
Wrench(Stamped)        force, torque: 6 doubles
Pose(Stamped)          position, orientation (x, y, z, w): 7 doubles
Twist(Stamped)         linear, angular: 6 doubles
JointState             names, then position, velocity, effort of each
=====================  ==========================================================

ROS 1 packs fields tightly. ROS 2 (CDR) puts four bytes in front, of which the second names the byte order, and
aligns every number to its own size, counted from there.
"""

from __future__ import annotations

import struct
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array, FileError


class Kind(NamedTuple):
    """A type of message."""

    role: str
    doubles: int
    stamped: bool


KINDS = {
    "geometry_msgs/WrenchStamped": Kind("wrench", 6, True),
    "geometry_msgs/Wrench": Kind("wrench", 6, False),
    "geometry_msgs/PoseStamped": Kind("pose", 7, True),
    "geometry_msgs/Pose": Kind("pose", 7, False),
    "geometry_msgs/TwistStamped": Kind("twist", 6, True),
    "geometry_msgs/Twist": Kind("twist", 6, False),
    "sensor_msgs/JointState": Kind("joints", 0, True),
}


@dataclass(frozen=True)
class Messages:
    """Decoded messages of one topic, in the order of the file."""

    stamp: NDArray[np.int64]
    """Time in the header [ns]; zeros where the type has none."""
    values: Array
    """(n, k); for joints positions and velocities side by side, NaN where there are none."""
    names: tuple[str, ...]
    """Names of the joints."""
    kept: NDArray[np.intp]
    """Which of the messages these are: joints may be published by several sources."""


def kind_of(message_type: str) -> Kind | None:
    """What a message type is to a recording, by its ROS 1 or ROS 2 name."""
    return KINDS.get(message_type.replace("/msg/", "/"))


def decode(kind: Kind, raw: Sequence[bytes], *, cdr: bool, topic: str) -> Messages:
    """Decode all messages of a topic.

    Parameters
    ----------
    kind : Kind
    raw : sequence of bytes
    cdr : bool
        ROS 2, else ROS 1.
    topic : str
        For messages.

    Raises
    ------
    FileError
        A message is shorter than its type, or in an unknown encoding (its number is named).
    """
    groups: dict[tuple[int, bytes], list[int]] = defaultdict(list)
    for number, message in enumerate(raw):
        groups[len(message), message[:2] + message[12:16] if kind.stamped else message[:2]].append(number)
    stamp, joints = np.zeros(len(raw), dtype=np.int64), kind.role == "joints"
    values = np.empty((len(raw), kind.doubles))
    by_names: dict[tuple[str, ...], list[tuple[int, Array]]] = defaultdict(list)
    for (length, _), members in groups.items():
        first = raw[members[0]]
        try:
            order = _byte_order(first) if cdr else "<"
            start = _payload(first, order, cdr) if kind.stamped else 4 * cdr
            if not joints and start + 8 * kind.doubles > length:
                raise ValueError(f"{length} bytes are too few")
            table = np.frombuffer(b"".join([raw[i] for i in members]), dtype=np.uint8).reshape(-1, length)
            if kind.stamped:
                seconds = table[:, 4:12].copy().view(f"{order}u4").astype(np.int64)
                stamp[members] = seconds[:, 0] * 1_000_000_000 + seconds[:, 1]
            if joints:
                for number in members:
                    names, numbers = _joints(raw[number], order, cdr)
                    by_names[names].append((number, numbers))
            else:
                values[members] = table[:, start : start + 8 * kind.doubles].copy().view(f"{order}f8")
        except (ValueError, struct.error, UnicodeDecodeError) as error:
            raise FileError(f"message {members[0]} of {topic} is damaged ({error}).") from error
    if not joints:
        return Messages(stamp, values, (), np.arange(len(raw)))
    names = Counter({names: len(rows) for names, rows in by_names.items()}).most_common(1)[0][0]
    rows = sorted(by_names[names], key=lambda row: row[0])
    kept = np.array([number for number, _ in rows])
    return Messages(stamp[kept], np.array([numbers for _, numbers in rows]), names, kept)


def _byte_order(message: bytes) -> str:
    if len(message) < 4 or message[0] != 0 or message[1] not in (0, 1):
        raise ValueError(f"encoding {message[:2].hex()} is not plain CDR")
    return "<" if message[1] else ">"


def _payload(message: bytes, order: str, cdr: bool) -> int:
    """Where the first double is after the header: sequence (ROS 1) or encoding (CDR), time, name of the frame."""
    (length,) = struct.unpack_from(f"{order}I", message, 12)
    if 16 + length > len(message):
        raise ValueError("the name of its frame is longer than the message")
    return 4 + _aligned(12 + length, 8) if cdr else 16 + length


def _aligned(offset: int, size: int) -> int:
    return -(-offset // size) * size


def _joints(message: bytes, order: str, cdr: bool) -> tuple[tuple[str, ...], Array]:
    """Names of the joints, and their positions and velocities."""
    origin = 4 if cdr else 0

    def aligned(at: int, size: int) -> int:
        return origin + _aligned(at - origin, size) if cdr else at

    def count(at: int) -> tuple[int, int]:
        at = aligned(at, 4)
        (number,) = struct.unpack_from(f"{order}I", message, at)
        if number > len(message):
            raise ValueError("a list is longer than the message")
        return number, at + 4

    length, at = count(12)
    number, at = count(at + length)
    names = []
    for _ in range(number):
        length, at = count(at)
        names.append(message[at : at + length].rstrip(b"\0").decode())
        at += length
    numbers = np.full(2 * number, np.nan)
    for half in (0, 1):
        length, at = count(at)
        at = aligned(at, 8) if length else at
        if length not in (0, number) or at + 8 * length > len(message):
            raise ValueError(f"{length} numbers for {number} joints")
        numbers[half * number : half * number + length] = np.frombuffer(message, f"{order}f8", length, at)
        at += 8 * length
    return tuple(names), numbers
