"""Who is at work: a file that is renewed every few seconds while a process is alive."""

from __future__ import annotations

import contextlib
import os
import socket
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vic_toolbox.errors import FileError
from vic_toolbox.files import read_json, write_json

FILE = "running.json"
BEAT = 5.0
"""Time between two signs of life [s]."""
STALE = 60.0
"""Time after the last sign of life from which a process of another machine counts as gone [s]."""


@dataclass(frozen=True)
class Presence:
    """A sign of life."""

    pid: int
    host: str
    began: float
    """When the work was begun [s, Unix time]."""
    beat: float
    """When this sign was given [s, Unix time]."""
    seconds: float
    """Time spent so far, all pieces of the work together [s]."""
    note: str
    """What else there is to say."""
    cells: list[str]
    """Of a runner: the cells that are under way."""
    over: bool = False
    """Whether the work was broken off, by an error or because it was stopped."""

    @property
    def alive(self) -> bool:
        """Whether the process still works, as far as can be told."""
        if self.over or (self.host == socket.gethostname() and not _exists(self.pid)):
            return False
        return time.time() - self.beat < STALE


def _exists(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def presence(folder: Path) -> Presence | None:
    """Who works in a folder, or did when it was killed; None if nobody is on record."""
    try:
        value = read_json(folder / FILE)
        return Presence(**{name: value[name] for name in Presence.__dataclass_fields__ if name in value})
    except (FileError, KeyError, TypeError):
        return None  # it went as we looked, or was never there


@contextlib.contextmanager
def present(folder: Path, *, note: str = "") -> Iterator[dict[str, Any]]:
    """Give signs of life from a thread while the block lasts; yields a table of them.

    Its ``seconds`` are kept up to date; its ``cells`` may be set by the block.

    The file goes when the block ends well. It stays when the process is killed or the block ends with an error: the
    time of that piece of work is then counted by the next one.
    """
    before = presence(folder)
    earlier = before.seconds if before is not None else 0.0
    began, clock, over = time.time(), time.monotonic(), threading.Event()
    table: dict[str, Any] = {"seconds": earlier, "cells": []}

    def sign(*, ended: bool = False) -> None:
        table["seconds"] = earlier + time.monotonic() - clock
        _write(folder, _signed(began, note, table, ended=ended))

    def keep() -> None:
        while not over.wait(BEAT):
            sign()

    sign()
    thread = threading.Thread(target=keep, daemon=True)
    thread.start()
    try:
        yield table
    except BaseException:
        over.set()
        thread.join()
        sign(ended=True)
        raise
    over.set()
    thread.join()
    table["seconds"] = earlier + time.monotonic() - clock
    with contextlib.suppress(OSError):
        (folder / FILE).unlink()


def _signed(began: float, note: str, table: Mapping[str, Any], *, ended: bool) -> Mapping[str, Any]:
    return {
        "pid": os.getpid(),
        "host": socket.gethostname(),
        "began": began,
        "beat": time.time(),
        "seconds": round(table["seconds"], 2),
        "note": note,
        "cells": list(table["cells"]),
        "over": ended,
    }


def _write(folder: Path, value: Mapping[str, Any]) -> None:
    with contextlib.suppress(FileError):  # a full disk must not end a computation that may still be saved
        write_json(folder / FILE, value)
