"""Cells as parcels: for a worker that does not see the study's folder, as on a cluster without shared files."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import shutil
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

from vic_toolbox.errors import FileError

LEFT_BEHIND = (".lock", "running.json")
"""Files of a cell that belong to a process, not to the cell."""


def pack(folder: Path) -> bytes:
    """The files of a folder as one archive; empty if there is no folder.

    Files that grow come last, so that a learner's metrics reach at least as far as its checkpoint.
    """
    files = [path for path in folder.rglob("*") if path.is_file() and path.name not in LEFT_BEHIND]
    if not files:
        return b""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for path in sorted(files, key=lambda path: (path.suffix == ".jsonl", path)):
            with contextlib.suppress(FileNotFoundError):  # a temporary file of somebody who writes
                archive.write(path, path.relative_to(folder).as_posix())
    return buffer.getvalue()


def unpack(content: bytes, folder: Path) -> None:
    """Put an archive in place of a folder, as a whole; nothing if it is empty.

    Raises
    ------
    FileError
        The archive is damaged, or the folder cannot be written.
    """
    if not content:
        return
    temporary = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=".arriving-", dir=folder.parent))
        new, old = temporary / "new", temporary / "old"
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            archive.extractall(new)  # leaves out absolute paths and "..", by its own documentation
        if folder.exists():
            folder.rename(old)
        new.rename(folder)
    except (OSError, zipfile.BadZipFile) as error:
        raise FileError(
            f"the files of a cell cannot be put into {folder} ({error}); free some space."
        ) from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


@contextlib.contextmanager
def bench(study: str, digest: str) -> Iterator[Path]:
    """A folder on this machine that stands in for the study's, while one cell is done.

    It has the same place for every attempt at the same cell of a study: what a killed one left there is taken up. It
    goes when the block ends well.
    """
    place = hashlib.sha256(study.encode()).hexdigest()[:12]
    path = Path(tempfile.gettempdir()) / f"vic-study-{place}-{os.getuid()}" / digest
    try:
        path.mkdir(parents=True, exist_ok=True, mode=0o700)
    except OSError as error:
        raise FileError(f"{path} cannot be made ({error}); free some space on this machine.") from error
    yield path
    shutil.rmtree(path, ignore_errors=True)
    with contextlib.suppress(OSError):
        path.parent.rmdir()  # the last one goes with it
