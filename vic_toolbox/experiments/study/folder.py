"""A study on disk.

====================================  ================================================================================
``study.json``                        the complete definition and the package's version
``cells/NAME/cell.json``              what the cell is, written when it was begun
``cells/NAME/run/``                   the run of a cell that trains or transfers; other files belong to its kind
``cells/NAME/running.json``           who works on it, renewed every few seconds; gone when it ended
``cells/NAME/result.json``            its result: it is done, and never done again
``cells/NAME/failure.json``           why it failed, twice; tried again when the study is taken up
====================================  ================================================================================

A process may be killed at any moment: every file is old or new, never a part. Reading needs no lock, so that a study
can be looked at while it runs.
"""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import vic_toolbox
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.claimed_folder import ClaimedFolder
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.experiments.study.cell import Cell, digests
from vic_toolbox.experiments.study.definition import Study, parse
from vic_toolbox.experiments.study.plan import Plan, make_plan
from vic_toolbox.files import read_json, write_atomically, write_json

STUDY_FORMAT = "vic-study/1"
CELL_FORMAT = "vic-cell/1"
TOKEN = ".token"
"""File by which a worker of a cluster knows the folder: it holds what the runner told it."""


@dataclass(frozen=True)
class Result:
    """What came out of a cell."""

    cell: Cell
    values: dict[str, Any]
    """Numbers for the tables, as JSON values; the same whenever and wherever the cell is done."""
    seconds: float
    """Time that it took, all pieces together [s]."""
    version: str
    """Of the package."""
    machine: str
    """Where it was done."""


@dataclass(frozen=True)
class Failure:
    """Why a cell failed."""

    name: str
    reason: str
    """The last line of the last traceback."""
    tracebacks: tuple[str, ...]
    """Of each attempt."""


class StudyFolder(ClaimedFolder):
    """The folder of a study; make it with :meth:`create` (to run) or :meth:`open` (to read).

    Attributes
    ----------
    path : Path
        The folder.
    definition : Study
        What the study consists of.
    version : str
        The package's version that it is made with.
    token : str
        Of the runner that holds the folder.
    """

    marker = "study.json"
    content = "study"
    remedy = "wait for it (vic study status {path} shows how far it is) or choose another folder."

    def __init__(self, path: Path, definition: Study, version: str):
        super().__init__(path)
        self.definition = definition
        self.version = version
        self.token = ""

    @classmethod
    def create(cls, path: str | os.PathLike[str], definition: Study, *, resume: bool = False) -> Self:
        """Begin a study in an empty or new folder, or with `resume` take up the one that is there.

        Use it as a context manager: it keeps other runners out of the folder. A definition that differs from the
        stored one is taken over as long as every cell that was begun is still the same.

        Raises
        ------
        FileError
            The folder holds something else, a study (without `resume`), cells that the definition or the package's
            version would make differently (they are named), is in use by another runner, or cannot be written.
        """
        folder = cls(Path(path), definition, vic_toolbox.__version__)
        folder.plan  # noqa: B018  a definition that cannot be planned is refused before a folder is made
        folder.claim()
        try:
            if (folder.path / "study.json").exists():
                folder._take_up(resume=resume)
            write_json(folder.path / "study.json", folder._identity())
            folder.token = secrets.token_hex(8)
            write_atomically(folder.path / TOKEN, folder.token)
        except BaseException:
            folder.close()
            raise
        return folder

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> Self:
        """A study to read.

        Raises
        ------
        FileError
            No such folder, no study in it, or its ``study.json`` is damaged.
        """
        path = Path(path)
        if not (path / "study.json").is_file():
            raise FileError(f"{path} holds no study (no study.json); pass the folder given to --out.")
        identity = _read_identity(path)
        try:
            definition = parse(identity["definition"], where=f"{path / 'study.json'}")
        except InputError as error:
            raise FileError(f"{error} The study is of another version of the toolbox.") from error
        return cls(path, definition, identity["version"])

    @cached_property
    def plan(self) -> Plan:
        """Cells and table entries of the study."""
        return make_plan(self.definition)

    @property
    def cells(self) -> tuple[Cell, ...]:
        """Every cell, each after those that it needs."""
        return self.plan.cells

    @cached_property
    def digests(self) -> dict[str, str]:
        """Fingerprint of each cell."""
        return digests(self.cells)

    def cell_path(self, name: str) -> Path:
        """Folder of a cell."""
        return self.path / "cells" / name

    def result(self, name: str) -> Result | None:
        """Result of a cell, or None if it is not done.

        Raises
        ------
        FileError
            Its ``result.json`` is damaged.
        """
        return read_result(self.cell_path(name))

    def results(self) -> dict[str, Result]:
        """Results of all cells that are done, by name."""
        found = ((cell.name, self.result(cell.name)) for cell in self.cells)
        return {name: result for name, result in found if result is not None}

    def failure(self, name: str) -> Failure | None:
        """Why a cell failed, or None if it did not."""
        path = self.cell_path(name) / "failure.json"
        if not path.exists():
            return None
        value = _table(path)
        tracebacks = value.get("tracebacks", [])
        if not isinstance(tracebacks, list):
            raise FileError(f"{path} does not describe a failure; delete it.")
        return Failure(name, str(value.get("reason", "")), tuple(map(str, tracebacks)))

    def write_failure(self, name: str, tracebacks: list[str]) -> Failure:
        """Write down why a cell failed."""
        lines = [line for line in tracebacks[-1].splitlines() if line.strip()] or ["unknown"]
        failure = Failure(name, lines[-1], tuple(tracebacks))
        write_json(
            self.cell_path(name) / "failure.json", {"reason": failure.reason, "tracebacks": tracebacks}
        )
        return failure

    # --- beginning ----------------------------------------------------------------------------------------

    def _identity(self) -> dict[str, Any]:
        return {
            "format": STUDY_FORMAT,
            "version": self.version,
            "definition": self.definition.to_json(),
        }

    def _take_up(self, *, resume: bool) -> None:
        self.check_resume(resume=resume)
        identity = _read_identity(self.path)
        changed = [text for cell in self.cells if (text := self._change(cell))]
        if changed:
            version = identity["version"]
            other = "" if version == self.version else f" It was made with version {version}."
            raise FileError(
                f"{len(changed)} of the cells in {self.path} were made from other settings than they would be now: "
                f"{'; '.join(changed[:3])}{'; ...' if len(changed) > 3 else ''}.{other} Results are never mixed: "
                "restore the settings, choose another --out, or delete the folders of these cells below "
                f"{self.path / 'cells'}."
            )

    def _change(self, cell: Cell) -> str:
        """What makes a cell that was begun differ from the one of this plan; empty if nothing does."""
        path = self.cell_path(cell.name) / "cell.json"
        if not path.exists():
            return ""
        there = _table(path)
        was = Cell.from_json(there.get("cell"), where=str(path))
        changes = []
        if there.get("version") != self.version:
            changes.append(f"version {there.get('version')} there, {self.version} now")
        before, now = flatten(was.to_json()), flatten(cell.to_json())
        changes += [
            f"{name.removeprefix('settings.')} {before.get(name, 'nothing')!r} there, {now.get(name, 'nothing')!r} now"
            for name in sorted(before.keys() | now.keys())
            if before.get(name) != now.get(name)
        ]
        if not changes and there.get("digest") != self.digests[cell.name]:
            changes.append("a cell that it needs has changed")
        more = ", ..." if len(changes) > 3 else ""
        return f"{cell.name} ({', '.join(changes[:3])}{more})" if changes else ""


def read_result(path: Path) -> Result | None:
    """The result in a cell's folder, or None if it is not done."""
    file = path / "result.json"
    if not file.exists():
        return None
    value = _table(file)
    cell = Cell.from_json(value.get("cell"), where=str(file))
    values, seconds = value.get("values"), value.get("seconds")
    if (
        value.get("format") != CELL_FORMAT
        or not isinstance(values, dict)
        or not isinstance(seconds, int | float)
    ):
        raise FileError(
            f"{file} is no result of this version (format {CELL_FORMAT!r}); delete the cell's folder."
        )
    return Result(cell, values, float(seconds), str(value.get("version")), str(value.get("machine")))


def write_result(path: Path, result: Result) -> None:
    """Write a result into its cell's folder: the cell is done."""
    write_json(
        path / "result.json",
        {
            "format": CELL_FORMAT,
            "version": result.version,
            "machine": result.machine,
            "seconds": float(f"{result.seconds:.4g}"),
            "cell": result.cell.to_json(),
            "values": result.values,
        },
    )


def _table(path: Path) -> dict[str, Any]:
    value = read_json(path)
    if not isinstance(value, dict):
        raise FileError(
            f"{path} holds {json.dumps(value)[:40]} instead of a table; delete the cell's folder."
        )
    return value


def _read_identity(path: Path) -> Mapping[str, Any]:
    identity = read_json(path / "study.json")
    if not isinstance(identity, dict) or identity.get("format") != STUDY_FORMAT:
        raise FileError(
            f"{path / 'study.json'} does not describe a study of this version (format {STUDY_FORMAT!r}); use the "
            "version that made it, or run it anew."
        )
    if not isinstance(identity.get("version"), str) or not isinstance(identity.get("definition"), dict):
        raise FileError(f"{path / 'study.json'} lacks the version or the definition of the study.")
    return identity
