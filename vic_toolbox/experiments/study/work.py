"""Doing one cell, in whatever process an engine chooses."""

from __future__ import annotations

import contextlib
import os
import platform
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import vic_toolbox
from vic_toolbox.errors import FileError, VicError
from vic_toolbox.experiments.claimed_folder import Claim
from vic_toolbox.experiments.loop import one_thread
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.folder import CELL_FORMAT, TOKEN, Result, read_result, write_result
from vic_toolbox.experiments.study.kinds import kind_of
from vic_toolbox.experiments.study.parcels import bench, pack, unpack
from vic_toolbox.experiments.study.presence import present
from vic_toolbox.files import write_json

PATIENCE = 20.0
"""How long to wait for a process that still holds the cell, because it has not noticed yet that its runner died [s]."""


@dataclass(frozen=True)
class Job:
    """A cell to be done in the folder of its study."""

    cell: Cell
    digest: str
    """Fingerprint of the cell."""
    study: str
    """Folder of the study, as the runner sees it."""
    token: str = ""
    """What the runner wrote into the folder's ``.token``: a worker that reads the same is in the same place."""
    parcels: Mapping[str, bytes] | None = None
    """For a worker in another place: the folders of the cell and of those that it needs, by name."""
    version: str = vic_toolbox.__version__
    """Of the runner's package; a worker of another one refuses."""


@dataclass(frozen=True)
class Outcome:
    """How a cell ended."""

    name: str
    state: Literal["done", "failed", "away"]
    """"away": the worker does not see the study's folder and has to be sent what the cell needs."""
    seconds: float = 0.0
    """Time that it took, all pieces together [s]."""
    traceback: str = ""
    parcel: bytes = b""
    """The cell's folder, from a worker in another place."""


def perform(job: Job) -> Outcome:
    """Do a cell and write its result; what a killed process left of it is taken up. Errors are part of the outcome."""
    try:
        if job.version != vic_toolbox.__version__:
            raise VicError(
                f"the runner has vic_toolbox {job.version}, this worker ({platform.node()}) {vic_toolbox.__version__}; "
                "install the same version everywhere."
            )
        if _sees(job):
            return Outcome(job.cell.name, "done", seconds=_finish(job, Path(job.study)).seconds)
        if job.parcels is None:
            return Outcome(job.cell.name, "away")
        return _finish_elsewhere(job, job.parcels)
    except KeyboardInterrupt:
        return Outcome(job.cell.name, "failed", traceback="somebody stopped the process that did it")
    except Exception:
        return Outcome(job.cell.name, "failed", traceback=traceback.format_exc())


def _sees(job: Job) -> bool:
    try:
        return (Path(job.study) / TOKEN).read_text() == job.token
    except OSError:
        return False


def _finish_elsewhere(job: Job, parcels: Mapping[str, bytes]) -> Outcome:
    """Do the cell on a bench of this machine, and send its folder home."""
    with bench(job.study, job.digest) as study:
        for name, content in parcels.items():
            if not (study / "cells" / name).exists():  # else an earlier attempt got it, and went on with it
                unpack(content, study / "cells" / name)
        seconds = _finish(job, study).seconds
        return Outcome(job.cell.name, "done", seconds, parcel=pack(study / "cells" / job.cell.name))


def _finish(job: Job, study: Path) -> Result:
    folder = study / "cells" / job.cell.name
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder} cannot be made ({error}); free some space.") from error
    with Claim(folder, patience=PATIENCE, remedy="end it and try again."), one_thread():
        return read_result(folder) or _do(job, folder, study)


def _do(job: Job, folder: Path, study: Path) -> Result:
    identity = {
        "format": CELL_FORMAT,
        "version": vic_toolbox.__version__,
        "digest": job.digest,
        "cell": job.cell.to_json(),
    }
    if not (folder / "cell.json").exists():
        write_json(folder / "cell.json", identity)
    with present(folder) as spent:
        values = kind_of(job.cell).run(job.cell, folder, study)
    result = Result(job.cell, values, spent["seconds"], vic_toolbox.__version__, machine())
    write_result(folder, result)
    with contextlib.suppress(OSError):
        (folder / "failure.json").unlink()
    return result


def machine() -> str:
    """What the results were computed on, for the record: processor, number of cores, system."""
    return f"{_processor()}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}"


def _processor() -> str:
    with contextlib.suppress(OSError), Path("/proc/cpuinfo").open() as file:
        for line in file:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()
