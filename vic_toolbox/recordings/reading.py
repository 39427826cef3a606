"""``read``: any supported file becomes a recording."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import FileError, InputError
from vic_toolbox.recordings.arrays import read_hdf5, read_npz
from vic_toolbox.recordings.assembly import assemble
from vic_toolbox.recordings.bags import read_bag
from vic_toolbox.recordings.clock import on_one_clock
from vic_toolbox.recordings.containers import ZSTD, parts_of
from vic_toolbox.recordings.layout import Layout
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.repairs import repair as repair_recording
from vic_toolbox.recordings.table import too_large
from vic_toolbox.recordings.text import read_text

MAGIC = {
    b"PK\x03\x04": "npz",
    b"PK\x05\x06": "npz",
    b"\x89HDF\r\n\x1a\n": "hdf5",
    b"#ROSBAG V": "bag",
    b"\x89MCAP0\r\n": "bag",
    b"SQLite format 3\0": "bag",
    ZSTD: "bag",
}
"""How a file of each format begins; anything else is text."""


def read(
    path: str | os.PathLike[str],
    layout: Layout | Mapping[str, Any] | str | os.PathLike[str] | None = None,
    *,
    wrench_axes: str | None = None,
    sensor_rotation: ArrayLike | None = None,
    sensor_offset: ArrayLike | None = None,
    wrench_sign: int | None = None,
    reference: str | None = None,
    rate: float | None = None,
    topics: Mapping[str, str] | None = None,
    clock: str | float = "wrench",
    stamps: str = "header",
    repair: bool = False,
) -> Recording:
    """Read a log: CSV, TSV, npz, HDF5, a ROS 1 bag, a ROS 2 bag (SQLite or MCAP), or a saved recording.

    The format is known by the content. Columns and topics that the layout does not name are guessed from their
    names and types; the recording's ``notes`` say what was guessed. Nothing in a file is executed.

    Parameters
    ----------
    path : path-like
        File, or folder of a ROS 2 bag.
    layout : Layout, mapping or path-like, optional
        Where the log keeps what, or the path of a TOML file that says so.
    wrench_axes : {"world", "tool"}, optional
        Axes that the wrench was logged in; this and the next five win over the layout.
    sensor_rotation : array_like, shape (3, 3), optional
        ``Q``: axes of the sensor, as columns, in those of the end-effector. With ``tool``, ``f' = R Q f``;
        with ``world``, for a log that turned the wrench but did not know ``Q``, ``f' = R Q Rᵀ f``.
    sensor_offset : array_like, shape (3,), optional
        From the end-effector's origin to the point that the moment is taken about, end-effector's axes [m].
    wrench_sign : {1, -1}, optional
        -1 for a sensor that reports what the robot does to the environment.
    reference : {"logged", "start", "mean"}, optional
        Where there is no reference in the log: one that stands still.
    rate : float, optional
        Samples per second [Hz] of a log without time.
    topics : mapping, optional
        Topics of a bag: ``wrench``, ``pose``, ``reference``, ``twist``, ``joints``.
    clock : {"wrench", "pose"} or float
        Clock that the topics of a bag are resampled onto, or its rate [Hz].
    stamps : {"header", "arrival"}
        Which times of a bag's messages to use.
    repair : bool
        Use what comes before the place where a file breaks off, and mend the recording
        (:func:`~vic_toolbox.recordings.repair`).

    Returns
    -------
    Recording
        In SI units, world axes. Not checked: see its ``findings``.

    Raises
    ------
    FileError
        Missing, damaged, or too much for one recording.
    InputError
        A column or topic is not there (those found and the nearest are named).
    DependencyError
        The format needs a package that is not installed.
    """
    path = Path(path)
    changes = {
        "wrench_axes": wrench_axes,
        "sensor_rotation": sensor_rotation,
        "sensor_offset": sensor_offset,
        "wrench_sign": wrench_sign,
        "reference": reference,
        "rate": rate,
        "topics": topics,
    }
    stated = dataclasses.replace(Layout.of(layout), **{n: v for n, v in changes.items() if v is not None})
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # numbers that are damage become findings
            recording = _recording(path, stated, clock=clock, stamps=stamps, repair=repair)
            return repair_recording(recording) if repair else recording
    except (FileError, InputError) as error:
        if str(path) in str(error):
            raise
        raise type(error)(f"{path}: {error}") from error
    except MemoryError as error:
        raise too_large(path, "does not fit into memory") from error


def _recording(path: Path, layout: Layout, *, clock: str | float, stamps: str, repair: bool) -> Recording:
    """The recording in a file, as it is."""
    kind = format_of(path)
    if kind == "bag":
        streams, notes = read_bag(path, layout.topics, stamps=stamps, repair=repair)
        table = on_one_clock(str(path), streams, clock=clock, repair=repair)
        content = dataclasses.replace(table, notes=(*notes, *table.notes))
        if layout.reference == "logged" and "reference_position" not in content.fields and not layout.columns:
            raise InputError(
                f"{path} has no topic that could be the reference (a pose called desired, reference, target ...); "
                "state it, topics reference = ..., or choose reference 'start' or 'mean' for one that stands still."
            )
    elif kind == "npz":
        content = read_npz(path)
    elif kind == "hdf5":
        content = read_hdf5(path)
    else:
        content = read_text(path, repair=repair)
    return content if isinstance(content, Recording) else assemble(content, layout)


def format_of(path: Path) -> str:
    """Format of a file by its first bytes: ``npz``, ``hdf5``, ``bag`` or ``text``.

    Raises
    ------
    FileError
        It is missing, empty or cannot be opened, or is a folder without a bag.
    """
    try:
        if path.is_dir():
            if parts_of(path):
                return "bag"
            raise FileError(f"{path} is a folder without a ROS 2 bag (no .db3, no .mcap); pass a file.")
        if path.exists() and not path.is_file():
            raise FileError(f"{path} is a device or a pipe, which cannot be read twice; pass a file.")
        with path.open("rb") as file:
            start = file.read(16)
    except FileError:
        raise
    except (OSError, ValueError) as error:
        raise FileError(f"{path} cannot be opened ({error}); pass the path of a log.") from error
    if not start:
        raise FileError(f"{path} is empty.")
    return next((kind for magic, kind in MAGIC.items() if start.startswith(magic)), "text")
