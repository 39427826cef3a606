"""The containers of bags: ROS 1, ROS 2 in SQLite, MCAP; messages out, as they lie in the file.

What a container claims is not believed: chunks, messages and files unpack to a bounded size, a database is read
from its tables only, and the message definitions that a bag carries are never compiled.
"""

from __future__ import annotations

import bz2
import contextlib
import dataclasses
import re
import sqlite3
import tempfile
import zlib
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import quote

from vic_toolbox.files import LARGEST_BYTES
from vic_toolbox.recordings.messages import kind_of
from vic_toolbox.recordings.table import too_large

LARGEST_CHUNK = 1 << 28
"""Bytes, unpacked, beyond which a chunk or a message is refused."""
ENCODINGS = ("cdr", "ros1")
ZSTD = b"\x28\xb5\x2f\xfd"
"""How anything compressed with Zstandard begins; no message in CDR does."""
SUFFIXES = (".mcap", ".db3", ".zstd")
"""Files of a folder that a ROS 2 bag is kept in."""


class Packet(NamedTuple):
    """A message as it lies in the file."""

    topic: str
    cdr: bool
    arrival: int
    data: bytes


def parts_of(folder: Path) -> list[Path]:
    """Files of a ROS 2 bag in the order of their numbers: ``bag_2`` comes before ``bag_10``."""

    def numbers(path: Path) -> list[str | int]:
        return [int(part) if i % 2 else part for i, part in enumerate(re.split(r"([0-9]+)", path.name))]

    files = sorted(
        (path for path in folder.iterdir() if path.suffix in SUFFIXES and path.is_file()), key=numbers
    )
    return [path for path in files if path.suffix != ".zstd" or path.with_suffix("") not in files]


def packets(path: Path, types: dict[str, str]) -> Generator[Packet, None, None]:
    """Messages of the types that a recording is made of; `types` is filled with those of all topics.

    Parameters
    ----------
    path : Path
        File, or folder of a ROS 2 bag.
    types : dict
        Message type by topic.
    """
    if path.is_dir():
        for part in parts_of(path):
            yield from packets(part, types)
        return
    with path.open("rb") as file:
        magic = file.read(16)
    if magic.startswith(ZSTD):
        with tempfile.TemporaryDirectory() as folder:
            yield from packets(_unpacked_file(path, Path(folder)), types)
    elif magic.startswith(b"\x89MCAP"):
        yield from _mcap(path, types)
    elif magic.startswith(b"#ROSBAG"):
        yield from _rosbag1(path, types)
    elif magic.startswith(b"SQLite"):
        yield from _sqlite(path, types)
    else:
        raise ValueError(f"{path.name} is neither a database nor MCAP")


def _rosbag1(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    from rosbags.rosbag1 import Reader

    with Reader(path) as bag:
        for position, chunk in bag.chunks.items():
            bag.chunks[position] = chunk._replace(decompressor=_bounded(chunk.decompressor))
        types.update({connection.topic: connection.msgtype for connection in bag.connections})
        connections = [connection for connection in bag.connections if kind_of(connection.msgtype)]
        for connection, arrival, data in bag.messages(connections) if connections else ():
            yield Packet(connection.topic, False, arrival, data)


def _sqlite(path: Path, types: dict[str, str]) -> Iterator[Packet]:
    """Messages of a ROS 2 database, by time. Views and virtual tables, which could compute anything, are no tables."""
    size = path.stat().st_size
    address = f"file:{quote(str(path.resolve()))}?mode=ro&immutable=1"
    with contextlib.closing(sqlite3.connect(address, uri=True)) as database:
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, min(size, LARGEST_CHUNK))
        database.text_factory = lambda raw: raw.decode(errors="replace")
        schema = "select name from sqlite_master where type = 'table' and sql like 'create table%'"
        tables = {name for (name,) in database.execute(schema)}
        if missing := {"topics", "messages"} - tables:
            raise ValueError(f"it has no table {', '.join(sorted(missing))}")
        chosen: dict[int, str] = {}
        for number, topic, kind, encoding in database.execute(
            "select id, name, type, serialization_format from topics"
        ):
            types[str(topic)] = str(kind) if encoding == "cdr" else f"{kind} as {encoding}"
            if kind_of(types[str(topic)]):
                chosen[number] = str(topic)
        left = size
        for number, arrival, data in database.execute(
            "select topic_id, timestamp, data from messages order by timestamp"
        ):
            if number not in chosen:
                continue
            if not isinstance(data, bytes) or not isinstance(arrival, int):
                raise ValueError(f"a message of {chosen[number]} holds no bytes, or no time")
            left -= len(data)
            if left < 0:
                raise ValueError("its messages are larger than the file")
            yield Packet(chosen[number], True, arrival, _unpack_zstd(data) if data[:4] == ZSTD else data)


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
                yield from breakup_chunk(_unpacked_chunk(record))
            else:
                yield record


# --- what anything unpacks to is bounded ---------------------------------------------------------------------


def _unpacked_file(path: Path, folder: Path) -> Path:
    """A file that was compressed as a whole, unpacked into a folder."""
    import zstandard

    target, left = folder / path.stem, LARGEST_BYTES
    with (
        path.open("rb") as source,
        target.open("wb") as file,
        zstandard.ZstdDecompressor().stream_reader(source) as stream,
    ):
        while piece := stream.read(1 << 20):
            left -= len(piece)
            if left < 0:
                raise too_large(path, f"unpacks to more than {LARGEST_BYTES >> 20} MiB")
            file.write(piece)
    return target


def _unpacked_chunk(chunk: Any) -> Any:
    """A chunk of MCAP without its compression."""
    unpack = {"": lambda data: data, "lz4": _unpack_lz4, "zstd": _unpack_zstd}.get(chunk.compression)
    if unpack is None:
        raise ValueError(f"its compression {chunk.compression[:20]!r} is unknown")
    data = unpack(chunk.data)
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


def _unpack_zstd(data: bytes) -> bytes:
    import zstandard

    pieces, size = [], 0
    with zstandard.ZstdDecompressor().stream_reader(data) as stream:
        while piece := stream.read(1 << 20):
            pieces.append(piece)
            size += len(piece)
            if size > LARGEST_CHUNK:
                raise ValueError(TOO_MUCH)
    return b"".join(pieces)


def _unpack_lz4(data: bytes) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return _at_most(LZ4FrameDecompressor(), data)


TOO_MUCH = "a chunk is cut off, or unpacks to more than a chunk may"


def _at_most(decompressor: Any, data: bytes) -> bytes:
    unpacked = decompressor.decompress(data, LARGEST_CHUNK)
    if not decompressor.eof:
        raise ValueError(TOO_MUCH)
    return unpacked
