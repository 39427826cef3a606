"""What every reader makes of a file: named columns of equal length."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from vic_toolbox.errors import Array, FileError
from vic_toolbox.recordings import quaternions
from vic_toolbox.spatial import rotation_to_quat_wxyz

LARGEST_SAMPLES = 50_000_000
"""Samples beyond which a file is refused: 14 hours at 1 kHz."""


@dataclass(frozen=True)
class Table:
    """Named columns, loaded when they are asked for."""

    source: str
    """The file."""
    names: tuple[str, ...]
    """Names of the columns, in the order of the file."""
    load: Callable[[Sequence[str]], dict[str, Array]]
    """Columns (n,) by name."""
    notes: tuple[str, ...] = ()
    """What the reader had to decide."""
    fields: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Columns of each field where the reader knows them (bags); else they are guessed from the names."""


def too_large(source: object, what: str) -> FileError:
    """The error of a file that claims to hold more than a recording can."""
    return FileError(f"{source} {what}, too much for one recording; cut it, or log at a lower rate.")


def table_of_arrays(source: str, arrays: dict[str, Array], notes: Iterable[str] = ()) -> Table:
    """A table of arrays (n,), (n, k) and (n, 4, 4), all of one length; the columns of one have its name as prefix.

    ``force`` (n, 3) becomes ``force.x``, ``force.y``, ``force.z``; ``wrench`` (n, 6) its force and torque;
    ``quat_wxyz`` and ``quat_xyzw`` their components; poses (n, 4, 4) a position and an orientation; anything
    else is numbered.
    """
    columns: dict[str, Array] = {}
    for name, array in arrays.items():
        if array.ndim == 1:
            columns[name] = array
        elif array.ndim == 3:
            columns |= _pose_columns(source, name, array)
        else:
            suffixes = _suffixes(name, array.shape[1])
            columns |= {f"{name}.{suffix}": array[:, i] for i, suffix in enumerate(suffixes)}
    return Table(source, tuple(columns), lambda names: {n: columns[n] for n in names}, tuple(notes))


_HALVES = {"wrench": ("force", "torque"), "ft": ("force", "torque"), "twist": ("linear", "angular")}


def _suffixes(name: str, width: int) -> list[str]:
    last = name.lower().replace("/", "_").replace(".", "_")
    if width == 4 and last.endswith(("wxyz", "xyzw")):
        return list(last[-4:])
    if width == 3:
        return list("xyz")
    for word, halves in _HALVES.items():
        if width == 6 and word in last.split("_"):
            return [f"{half}.{axis}" for half in halves for axis in "xyz"]
    return [str(i) for i in range(width)]


def _pose_columns(source: str, name: str, array: Array) -> dict[str, Array]:
    try:
        quat = rotation_to_quat_wxyz(array[:, :3, :3])
    except ValueError as error:
        raise FileError(f"{source}: {name} {array.shape} holds no poses ({error})") from error
    parts = {f"{name}.position.{axis}": array[:, i, 3] for i, axis in enumerate("xyz")}
    quat = quaternions.continuous(quat)
    return parts | {f"{name}.orientation.{axis}": quat[:, i] for i, axis in enumerate("wxyz")}


def as_numbers(source: str, name: str, array: np.ndarray) -> Array | None:
    """An array of numbers as ``float64``; None for one that holds anything else or cannot be columns."""
    if array.dtype.kind not in "fiu" or array.ndim not in (1, 2, 3) or len(array) == 0:
        return None
    if array.ndim == 3 and array.shape[1:] != (4, 4):
        return None
    if len(array) > LARGEST_SAMPLES:
        raise too_large(source, f"holds {len(array)} samples in {name}")
    return array.astype(np.float64)
