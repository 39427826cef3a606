"""A folder of results that appears whole or not at all."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from vic_toolbox.errors import FileError


@contextlib.contextmanager
def new_folder(
    path: str | os.PathLike[str], *, marker: str, what: str, overwrite: bool = False
) -> Iterator[Path]:
    """A temporary folder beside `path` to write to; it becomes `path` when the block ends well, else it is removed.

    Parameters
    ----------
    path : path-like
        A new or an empty folder, or with `overwrite` one that holds such a result.
    marker : str
        File by which such a result is recognised.
    what : str
        What such a result is called.
    overwrite : bool
        Replace the result that is there.

    Raises
    ------
    FileError
        The folder holds something else, or a result (without `overwrite`), or it cannot be written.
    """
    path = Path(path).absolute()
    refuse_foreign(path, marker=marker, what=what, overwrite=overwrite)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    except OSError as error:
        raise FileError(f"{path} cannot be made ({error}); choose another folder.") from error
    try:
        temporary.chmod(0o755)
        yield temporary
        _put_in_place(temporary, path, marker=marker, what=what, overwrite=overwrite)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def refuse_foreign(path: Path, *, marker: str, what: str, overwrite: bool) -> None:
    """Look at the folder before any work starts; see :func:`new_folder`."""
    if not path.exists():
        return
    if not path.is_dir():
        raise FileError(f"{path} is a file; choose a new or empty folder.")
    names = sorted(entry.name for entry in path.iterdir())
    if not names:
        return
    if marker not in names:
        listed = f"{', '.join(names[:3])}{', ...' if len(names) > 3 else ''}"
        raise FileError(f"{path} is not empty ({listed}) and holds no {what}; choose a new or empty folder.")
    if not overwrite:
        raise FileError(
            f"{path} holds a {what} already; choose another folder, or replace it with --overwrite."
        )


def _put_in_place(temporary: Path, path: Path, *, marker: str, what: str, overwrite: bool) -> None:
    refuse_foreign(path, marker=marker, what=what, overwrite=overwrite)  # it may have come while we worked
    try:
        if not path.exists():
            temporary.rename(path)
            return
        attic = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
        try:
            path.rename(attic / "old")
            try:
                temporary.rename(path)
            except BaseException:
                (attic / "old").rename(path)
                raise
        finally:
            shutil.rmtree(attic, ignore_errors=True)
    except OSError as error:
        raise FileError(f"{path} cannot be written ({error}); choose another folder.") from error
