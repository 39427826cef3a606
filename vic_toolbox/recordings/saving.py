"""Writing a recording: npz without objects, or HDF5; whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vic_toolbox.errors import InputError, require
from vic_toolbox.files import atomic_path, write_arrays

if TYPE_CHECKING:
    from vic_toolbox.recordings.recording import Recording

SUFFIXES = {".npz": "npz", ".h5": "HDF5", ".hdf5": "HDF5"}


def save(recording: Recording, path: str | os.PathLike[str]) -> None:
    """Write every array, the axes of the wrench and the notes; :func:`read` gives the same recording back.

    Raises
    ------
    InputError
        The suffix is neither ``.npz`` nor ``.h5`` nor ``.hdf5``.
    FileError
        The file cannot be written.
    DependencyError
        HDF5 without h5py.
    """
    from vic_toolbox.recordings.arrays import FORMAT, LONGEST_TEXT

    path = Path(path)
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        raise InputError(f"{path} has the suffix {path.suffix!r}; choose one of: {', '.join(SUFFIXES)}.")
    texts = {"format": FORMAT, "wrench_axes": recording.wrench_axes, "notes": "\n".join(recording.notes)}
    if kind == "npz":
        write_arrays(path, recording.arrays() | {name: np.array(text) for name, text in texts.items()})
        return
    require("recordings", "h5py")
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w") as file:
        for name, array in recording.arrays().items():
            file.create_dataset(name, data=array, compression="gzip", shuffle=True)
        file.attrs.update(
            {name: np.bytes_(text.encode()[:LONGEST_TEXT]) for name, text in texts.items() if text}
        )
