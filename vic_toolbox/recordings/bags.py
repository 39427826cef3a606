"""ROS bags: ROS 1, ROS 2 in SQLite, MCAP. Topics in, streams with their own clocks out.

The containers are those of :mod:`vic_toolbox.recordings.containers`, the messages those of
:mod:`vic_toolbox.recordings.messages`.
"""

from __future__ import annotations

import contextlib
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from vic_toolbox.errors import FileError, InputError, one_of, require
from vic_toolbox.files import LARGEST_BYTES, short
from vic_toolbox.recordings.clock import Stream
from vic_toolbox.recordings.containers import packets
from vic_toolbox.recordings.guessing import names_reference
from vic_toolbox.recordings.layout import listed, nearest
from vic_toolbox.recordings.messages import decode, kind_of
from vic_toolbox.recordings.table import LARGEST_SAMPLES, too_large

STAMPS = ("header", "arrival")


def read_bag(
    path: Path, topics: Mapping[str, str], *, stamps: str = "header", repair: bool = False
) -> tuple[list[Stream], list[str]]:
    """Read the topics that a recording is made of.

    Parameters
    ----------
    path : Path
        ROS 1 ``.bag``, ROS 2 folder, ``.db3`` or ``.mcap``, the last three also compressed (``.zstd``).
    topics : mapping
        Topic of wrench, pose, reference, twist and joints where it is stated; the others go by message type,
        and by words such as *desired* in the name of the reference's.
    stamps : str
        Times of the messages: in their ``header`` (the time of arrival where that is zero), or of ``arrival``.
    repair : bool
        Use what comes before the place where the file breaks off.

    Returns
    -------
    streams : list of Stream
    notes : list of str

    Raises
    ------
    FileError
        Damaged, encrypted or too much.
    InputError
        A topic is not there, is of an unknown type, or several would do.
    DependencyError
        rosbags or mcap is not installed.
    """
    one_of("stamps", stamps, STAMPS)
    require("recordings", "rosbags", "mcap", "lz4", "zstandard")
    notes: list[str] = []
    types: dict[str, str] = {}
    raw: dict[str, list[bytes]] = defaultdict(list)
    arrival: dict[str, list[int]] = defaultdict(list)
    cdr: dict[str, bool] = {}
    size = count = 0
    try:
        try:
            with contextlib.closing(packets(path, types)) as found:
                for packet in found:
                    raw[packet.topic].append(packet.data)
                    arrival[packet.topic].append(packet.arrival)
                    cdr[packet.topic] = packet.cdr
                    size, count = size + len(packet.data), count + 1
                    if size > LARGEST_BYTES or count > LARGEST_SAMPLES:
                        raise too_large(path, f"holds more than {count} messages")
        except FileError:
            raise
        except Exception as error:
            if not (repair and count):
                raise
            notes.append(f"the file breaks off after {count} messages ({short(error)})")
        chosen = choose_topics(str(path), types, topics)
        streams = []
        for role, topic in chosen.items():
            if raw[topic]:
                stream, more = _stream(
                    role, topic, types[topic], raw[topic], arrival[topic], cdr[topic], stamps
                )
                streams.append(stream)
                notes += [f"{role} = {topic} ({types[topic]}, {len(raw[topic])} messages)", *more]
            elif role in ("wrench", "pose", "reference"):
                raise FileError(f"{path}: the topic {topic} has no messages.")
    except (FileError, InputError):
        raise
    except Exception as error:  # a parser of a file from a stranger may fail in any way
        raise FileError(
            f"{path} cannot be read as a bag ({short(error)}); it is damaged or cut off "
            "(what comes before is read with repair)."
        ) from error
    return streams, notes


def choose_topics(source: str, types: Mapping[str, str], stated: Mapping[str, str]) -> dict[str, str]:
    """Topic of each role, stated or found by its message type and name.

    Raises
    ------
    InputError
        A topic is not there, is of an unknown type, or several would do.
    """
    found = listed([f"{topic} ({kind})" for topic, kind in sorted(types.items())])
    chosen = {}
    for role, topic in stated.items():
        if topic not in types:
            raise InputError(f"{source} has no topic {topic!r} for {role}; {nearest(topic, types)}")
        kind = kind_of(types[topic])
        if kind is None or kind.role != {"reference": "pose"}.get(role, role):
            raise InputError(
                f"the topic {topic} is {types[topic]}, which is no {role}; the topics are: {found}."
            )
        chosen[role] = topic
    for role in ("wrench", "pose", "reference", "twist", "joints"):
        if role in chosen:
            continue
        candidates = []
        for topic, message_type in types.items():
            kind = kind_of(message_type)
            if kind is None or topic in chosen.values():
                continue
            wanted = names_reference(topic)
            if role == "reference":
                fits = kind.role == "pose" and wanted
            else:
                fits = kind.role == role and not (wanted and role in ("pose", "twist"))
            candidates += [topic] * fits
        if len(candidates) == 1:
            chosen[role] = candidates[0]
        elif len(candidates) > 1 and role in ("wrench", "pose", "reference"):
            raise InputError(
                f"{source}: {listed(sorted(candidates))} could all be the {role}; state it, topics {role} = ..."
            )
        elif role in ("wrench", "pose"):
            raise InputError(f"{source} has no topic that could be the {role}; the topics are: {found}.")
    return chosen


def _stream(
    role: str, topic: str, message_type: str, raw: list[bytes], arrival: list[int], cdr: bool, stamps: str
) -> tuple[Stream, list[str]]:
    kind = kind_of(message_type)
    assert kind is not None
    messages = decode(kind, raw, cdr=cdr, topic=topic)
    notes = []
    if len(messages.kept) < len(raw):
        notes.append(f"left out {len(raw) - len(messages.kept)} messages of {topic} with other joints")
    time = np.array(arrival, dtype=np.int64)[messages.kept]
    if stamps == "header" and kind.stamped and (messages.stamp > 0).all():
        time = messages.stamp
    elif stamps == "header":
        notes.append(f"{topic} has no times in its messages: the time of arrival is used")
    return Stream(role, topic, time, messages.values, messages.names), notes
