"""npz and HDF5: files of arrays. Nothing in them is executed, and nothing is believed before it is checked.

A small file may claim to hold terabytes; an HDF5 file may point to other files. Sizes are therefore looked at
before memory is taken, and links out of the file are not followed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vic_toolbox.errors import Array, FileError, require
from vic_toolbox.files import LARGEST_BYTES, MOST_ARRAYS, read_arrays, short
from vic_toolbox.recordings.assembly import native_recording
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.table import Table, as_numbers, table_of_arrays, too_large

FORMAT = "vic-recording-1"
TEXTS = ("format", "wrench_axes", "notes")
DEEPEST = 16
LONGEST_TEXT = 60_000


def read_npz(path: Path) -> Table | Recording:
    """Read ``.npz`` without pickles: the recording that it is, or the table that its arrays make.

    Raises
    ------
    FileError
        Damaged, of objects, or it unpacks to too much.
    """
    arrays = read_arrays(path)
    texts = {
        n: str(a.item()) for n, a in arrays.items() if n in TEXTS and a.dtype.kind == "U" and a.ndim == 0
    }
    return _recording_or_table(path, arrays, texts)


def read_hdf5(path: Path) -> Table | Recording:
    """Read HDF5: the recording that it is, or the table that its datasets make.

    Raises
    ------
    FileError
        Damaged, or too much.
    DependencyError
        h5py is not installed.
    """
    require("recordings", "h5py")
    import h5py

    try:
        with h5py.File(path, "r") as file:
            texts = {name: text for name in TEXTS if (text := _text(file, name)) is not None}
            arrays: dict[str, np.ndarray] = {}
            left = LARGEST_BYTES
            for name, dataset in _datasets(file, h5py):
                left -= dataset.size * dataset.dtype.itemsize
                if left < 0 or len(arrays) >= MOST_ARRAYS:
                    raise too_large(
                        path, f"holds more than {LARGEST_BYTES >> 30} GiB or {MOST_ARRAYS} datasets"
                    )
                arrays[name] = dataset[()]
    except FileError:
        raise
    except Exception as error:  # a parser of a file from a stranger may fail in any way
        raise FileError(
            f"{path} cannot be read as HDF5 ({short(error)}); it is damaged or cut off."
        ) from error
    return _recording_or_table(path, arrays, texts)


def _text(file: Any, name: str) -> str | None:
    """An attribute of text; only one of fixed length, which takes no more memory than it says."""
    if name not in file.attrs:
        return None
    attribute = file.attrs.get_id(name)
    if attribute.dtype.kind != "S" or attribute.shape != () or attribute.dtype.itemsize > LONGEST_TEXT:
        return None
    return bytes(file.attrs[name]).decode(errors="replace")


def _datasets(file: Any, h5py: Any) -> Iterator[tuple[str, Any]]:
    """Datasets of numbers, but for those that lie in other files; a group is entered once, by its shortest name."""
    seen: set[int] = set()
    waiting: deque[tuple[str, Any]] = deque([("", file)])
    while waiting:
        prefix, group = waiting.popleft()
        address = h5py.h5o.get_info(group.id).addr
        if prefix.count("/") > DEEPEST or address in seen:
            continue
        seen.add(address)
        for name in group:
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                continue
            item = group[name]
            if isinstance(item, h5py.Group):
                waiting.append((f"{prefix}{name}/", item))
            elif isinstance(item, h5py.Dataset) and item.dtype.kind in "fiu" and 1 <= item.ndim <= 3:
                yield from [] if item.external or item.is_virtual else [(f"{prefix}{name}", item)]


def _recording_or_table(
    path: Path, arrays: dict[str, np.ndarray], texts: dict[str, str]
) -> Table | Recording:
    numbers: dict[str, Array] = {}
    for name, array in arrays.items():
        column = as_numbers(str(path), name, array) if name not in TEXTS else None
        if column is not None:
            numbers[name] = column
    if texts.get("format", "").startswith("vic-recording-"):
        if texts["format"] != FORMAT:
            raise FileError(
                f"{path} is a recording of format {texts['format'][:40]!r}; this version reads {FORMAT}."
            )
        return native_recording(str(path), numbers, dict(texts))
    lengths = [len(array) for array in numbers.values()]
    if not lengths:
        raise FileError(f"{path} holds no arrays of numbers; expected time, position, wrench and reference.")
    usual = max(set(lengths), key=lengths.count)
    others = [name for name, array in numbers.items() if len(array) != usual]
    notes = [f"left out, of another length than {usual}: {', '.join(others[:20])}"] if others else []
    return table_of_arrays(str(path), {n: a for n, a in numbers.items() if len(a) == usual}, notes)
