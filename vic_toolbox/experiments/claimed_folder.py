"""A folder of one kind that one process at a time works in."""

from __future__ import annotations

import fcntl
import os
import time
from pathlib import Path
from typing import ClassVar, Self

from vic_toolbox.errors import FileError

_LOOK = 0.2  # seconds between two tries


class Claim:
    """Keeps other processes out of a folder until it is released, or this process ends however it ends.

    Parameters
    ----------
    folder : Path
        An existing folder.
    patience : float
        How long to wait for a process that is there [s].
    remedy : str
        What somebody can do whose claim comes second.

    Raises
    ------
    FileError
        Another process has it, or the folder cannot be written.
    """

    def __init__(self, folder: Path, *, patience: float = 0.0, remedy: str) -> None:
        try:
            self._handle: int | None = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
        except OSError as error:
            raise FileError(f"{folder} cannot be written ({error}); choose another folder.") from error
        try:
            self._take(time.monotonic() + patience)
        except BlockingIOError as error:
            self.release()
            raise FileError(f"{folder} is in use by another process; {remedy}") from error
        except OSError:
            pass  # a file system without locks: two processes in one folder are then the user's care

    def _take(self, end: float) -> None:
        assert self._handle is not None
        while True:
            try:
                fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
            except BlockingIOError:
                if time.monotonic() >= end:
                    raise
                time.sleep(_LOOK)

    def release(self) -> None:
        """Let other processes in."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


class ClaimedFolder:
    """A folder that says by a file what it holds.

    Attributes
    ----------
    path : Path
        The folder.
    """

    marker: ClassVar[str]
    """File that says what the folder holds."""
    content: ClassVar[str]
    """What that is, in a word."""
    remedy: ClassVar[str] = "wait for it or choose another folder."
    """What to do when another process has the folder."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._claim: Claim | None = None

    def claim(self) -> None:
        """Make the folder, unless it is there, and keep other processes out of it.

        Raises
        ------
        FileError
            It holds something else, is in use by another process, or cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            names = {entry.name for entry in self.path.iterdir()}
        except OSError as error:
            raise FileError(f"{self.path} cannot be made ({error}); choose another folder.") from error
        foreign = sorted(name for name in names if not name.startswith("."))
        if foreign and self.marker not in names:
            raise FileError(
                f"{self.path} is not empty ({', '.join(foreign[:3])}{', ...' if len(foreign) > 3 else ''}) "
                f"and holds no {self.content}; choose a new or empty folder."
            )
        self._claim = Claim(self.path, remedy=self.remedy.format(path=self.path))

    def check_resume(self, *, resume: bool) -> None:
        """Refuse to take up what is there, unless that is wanted."""
        if not resume:
            raise FileError(
                f"{self.path} holds a {self.content} already; take it up with --resume, or choose another folder."
            )

    def close(self) -> None:
        """Let other processes into the folder."""
        if self._claim is not None:
            self._claim.release()
            self._claim = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
