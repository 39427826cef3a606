"""Files that are whole or not there: write under a temporary name, flush, rename.

Files of arrays come from strangers too: nothing in them is executed, and what a small file claims to hold is looked at
before memory is taken.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from vic_toolbox.errors import FileError

LARGEST_BYTES = 4 << 30
"""Bytes, unpacked, beyond which a file is refused: small files may claim to hold anything."""
MOST_ARRAYS = 10_000
"""Arrays of one file beyond which it is refused."""


@contextlib.contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path beside `path` to write to; it replaces `path` when the block ends well, else it is removed.

    The temporary name keeps the suffix of `path`, because many writers choose the format by it.

    Raises
    ------
    FileError
        The folder or the file cannot be written; an earlier file of that name is untouched.
    """
    path = Path(path)
    temporary = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.stem}.", suffix=path.suffix, dir=path.parent)
        os.close(handle)
        temporary = Path(name)
        temporary.chmod(0o644)
        yield temporary
        with temporary.open("rb+") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        if isinstance(error, FileError):
            raise
        raise FileError(
            f"{path} cannot be written ({error}); free some space or choose another folder"
        ) from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)


def write_atomically(path: str | os.PathLike[str], content: bytes | str) -> None:
    """Replace the file's content as a whole (text as UTF-8)."""
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode() if isinstance(content, str) else content)


def write_json(path: str | os.PathLike[str], value: Any) -> None:
    """Replace the file by indented JSON; NaN and infinities are refused, since JSON has no word for them."""
    write_atomically(path, json.dumps(value, indent=2, allow_nan=False) + "\n")


def read_json(path: str | os.PathLike[str]) -> Any:
    """Parse a JSON file.

    Raises
    ------
    FileError
        The file is missing or not JSON.
    """
    try:
        return json.loads(Path(path).read_text())
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise FileError(f"{path} cannot be read as JSON ({error})") from error


def write_arrays(path: str | os.PathLike[str], arrays: Mapping[str, Any]) -> None:
    """Replace the file by a compressed ``.npz`` of numbers and text.

    Raises
    ------
    FileError
        The file cannot be written.
    """
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_arrays(
    path: str | os.PathLike[str], kind: str = "npz", *, remedy: str = "it is damaged or cut off"
) -> dict[str, np.ndarray]:
    """Read all arrays of an ``.npz``, by name.

    Parameters
    ----------
    path : path
        The file.
    kind : str
        What it should be, for the message.
    remedy : str
        What to do about a damaged one, for the message.

    Raises
    ------
    FileError
        Missing, damaged, of Python objects, or it unpacks to too much.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            members = [info for info in archive.infolist() if info.filename.endswith(".npy")]
            size = sum(info.file_size for info in members)
            if len(members) > MOST_ARRAYS or size > LARGEST_BYTES:
                raise FileError(
                    f"{path} unpacks to {size >> 20} MiB in {len(members)} arrays, too much for one file; cut it, or "
                    "keep fewer samples."
                )
            return {info.filename[:-4]: _read_array(archive, info) for info in members}
    except FileError:
        raise
    except Exception as error:  # a parser of a file from a stranger may fail in any way
        raise FileError(f"{path} cannot be read as {kind} ({short(error)}); {remedy}.") from error


def _read_array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> np.ndarray:
    """One array; a header that promises more than the file holds is refused before memory is taken."""
    with archive.open(info) as file:
        version = npy.read_magic(file)
        header = npy.read_array_header_1_0 if version == (1, 0) else npy.read_array_header_2_0
        shape, _, dtype = header(file)
    if dtype.hasobject:
        raise FileError(
            f"{archive.filename}: {info.filename} holds Python objects, which are not read; save numbers."
        )
    if int(np.prod(shape, dtype=object)) * dtype.itemsize > info.file_size:
        raise ValueError(f"{info.filename} of shape {shape} is cut off")
    with archive.open(info) as file:
        return npy.read_array(file, allow_pickle=False)


def short(error: Exception) -> str:
    """What a library said, on one line."""
    text = " ".join(str(error).split()) or type(error).__name__
    return text if len(text) <= 160 else text[:157] + "..."


def file_digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's content.

    Raises
    ------
    FileError
        It cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise FileError(f"{path} cannot be read ({error})") from error
