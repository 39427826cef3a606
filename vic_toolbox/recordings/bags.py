"""ROS bags: ROS 1, ROS 2 in SQLite, MCAP. Topics in, streams with their own clocks out.

The containers are read by ``rosbags`` and ``mcap``; the message definitions that a bag carries are never
compiled (see :mod:`vic_toolbox.recordings.messages`), and what a chunk unpacks to is bounded.
"""

from __future__ import annotations

import bz2
import dataclasses
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vic_toolbox.errors import FileError, InputError, one_of, require
from vic_toolbox.recordings.clock import Stream
from vic_toolbox.recordings.guessing import names_reference
from vic_toolbox.recordings.layout import nearest
from vic_toolbox.recordings.messages import decode, kind_of
from vic_toolbox.recordings.table import LARGEST_BYTES, LARGEST_SAMPLES, short, too_large

LARGEST_CHUNK = 1 << 28
STAMPS = ("header", "arrival")
ENCODINGS = ("cdr", "ros1")


class Packet(NamedTuple):
    """A message as it lies in the file."""

    topic: str
    cdr: bool
    arrival: int
    data: bytes


def read_bag(
    path: Path, topics: Mapping[str, str], *, stamps: str = "header", repair: bool = False
) -> tuple[list[Stream], list[str]]:
    """Read the topics that a recording is made of.

    Parameters
    ----------
    path : Path
        ROS 1 ``.bag``, ROS 2 folder, ``.db3`` or ``.mcap``.
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
            for packet in _packets(path, types):
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
    found = ", ".join(f"{topic} ({kind})" for topic, kind in sorted(types.items())[:40]) or "none"
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
                f"{source}: {', '.join(sorted(candidates))} could all be the {role}; state it, topics {role} = ..."
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


# --- containers ----------------------------------------------------------------------------------------------


def _packets(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    """Messages of the types that a recording is made of; `types` is filled with those of all topics."""
    if path.is_dir():
        parts = sorted(path.glob("*.mcap"))
        if not parts:
            yield from _rosbag2(path, types)
        for part in parts:
            yield from _mcap(part, types)
        return
    with path.open("rb") as file:
        magic = file.read(16)
    if magic.startswith(b"\x89MCAP"):
        yield from _mcap(path, types)
    elif magic.startswith(b"#ROSBAG"):
        yield from _rosbag1(path, types)
    else:
        yield from _rosbag2(path, types)


def _rosbag1(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    from rosbags.rosbag1 import Reader

    with Reader(path) as bag:
        for position, chunk in bag.chunks.items():
            bag.chunks[position] = chunk._replace(decompressor=_bounded(chunk.decompressor))
        types.update({connection.topic: connection.msgtype for connection in bag.connections})
        connections = [connection for connection in bag.connections if kind_of(connection.msgtype)]
        for connection, arrival, data in bag.messages(connections) if connections else ():
            yield Packet(connection.topic, False, arrival, data)


def _rosbag2(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    from rosbags.rosbag2 import Reader

    if path.is_file() and path.suffix != ".db3":
        raise FileError(f"{path} is an SQLite file; a ROS 2 bag of that kind is called *.db3, rename it.")
    if path.is_dir() and any(path.glob("*.zstd")):
        raise FileError(f"{path} holds compressed files; unpack them first (ros2 bag convert).")
    with Reader(path) as bag:
        types.update({connection.topic: connection.msgtype for connection in bag.connections})
        connections = [connection for connection in bag.connections if kind_of(connection.msgtype)]
        for connection, arrival, data in bag.messages(connections) if connections else ():
            yield Packet(connection.topic, True, arrival, bytes(data))


def _mcap(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    """Messages in the order of the file, which also reads one that was never finished."""
    from mcap.records import Channel, Message, Schema

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, bool]] = {}
    for record in _mcap_records(path):
        if isinstance(record, Message):
            if record.channel_id in channels:
                topic, cdr = channels[record.channel_id]
                yield Packet(topic, cdr, record.log_time, record.data)
        elif isinstance(record, Schema):
            schemas[record.id] = record.name
        elif isinstance(record, Channel):
            kind = schemas.get(record.schema_id, "unknown")
            encoding = record.message_encoding
            types[record.topic] = kind if encoding in ENCODINGS else f"{kind} as {encoding}"
            if kind_of(types[record.topic]):
                channels[record.id] = record.topic, encoding == "cdr"


def _mcap_records(path: Path) -> Iterator[Any]:
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True, record_size_limit=path.stat().st_size).records:
            if isinstance(record, Chunk):
                yield from breakup_chunk(_unpacked(record))
            else:
                yield record


# --- what a chunk unpacks to is bounded ----------------------------------------------------------------------


def _unpacked(chunk: Any) -> Any:
    """A chunk of MCAP without its compression."""
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "lz4":
        data = _unpack_lz4(chunk.data)
    elif chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as stream:
            data = stream.read(min(chunk.uncompressed_size, LARGEST_CHUNK) + 1)
    else:
        raise ValueError(f"its compression {chunk.compression[:20]!r} is unknown")
    if len(data) != chunk.uncompressed_size:
        raise ValueError("a chunk is cut off, or unpacks to more than it says")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk does not fit")
    return dataclasses.replace(chunk, compression="", data=data)


def _bounded(decompressor: Callable[[bytes], bytes]) -> Callable[[bytes], bytes]:
    """The decompressor of a chunk of ROS 1, which stops where a chunk has become absurdly large."""
    from lz4.frame import decompress

    if decompressor is bz2.decompress:
        return lambda data: _at_most(bz2.BZ2Decompressor(), data)
    return _unpack_lz4 if decompressor is decompress else decompressor


def _unpack_lz4(data: bytes) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return _at_most(LZ4FrameDecompressor(), data)


def _at_most(decompressor: Any, data: bytes) -> bytes:
    unpacked = decompressor.decompress(data, LARGEST_CHUNK)
    if not decompressor.eof:
        raise ValueError("a chunk is cut off, or unpacks to more than a chunk may")
    return unpacked
