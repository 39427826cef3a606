"""The kinds of cells: how each is done, and about what it costs."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol, cast

from vic_toolbox.errors import one_of
from vic_toolbox.experiments.study.cell import Cell

KINDS: Mapping[str, str] = MappingProxyType({
    "train": "training",
    "transfer": "transferring",
    "judge": "judging",
    "sweep": "sweeping",
    "session": "session",
    "deploy": "deploy",
})  # fmt: skip
"""Kind of a cell → module in this package. A new kind is a module that offers what :class:`Kind` says, and a line."""


class Kind(Protocol):
    """What the module of a kind offers."""

    def run(self, cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
        """Do the cell on one thread and return its values (JSON), the same ones every time.

        Files may be kept below `folder`; what a killed process left there is taken up again. The cells that this one
        needs are done, in ``study/cells/NAME``.
        """
        ...

    def effort(self, settings: Mapping[str, Any]) -> float:
        """About the seconds that a cell takes on one core."""
        ...


def kind_of(cell: Cell) -> Kind:
    """The module that does a cell.

    Raises
    ------
    InputError
        Unknown kind.
    """
    name = KINDS[one_of(f"kind of the cell {cell.name}", cell.kind, KINDS)]
    return cast(Kind, importlib.import_module(f"vic_toolbox.experiments.study.{name}"))


def effort(cell: Cell) -> float:
    """About the seconds that a cell takes on one core."""
    return kind_of(cell).effort(cell.settings)


def needed_folder(study: Path, name: str) -> Path:
    """Folder of the run in a cell that trained or transferred a policy."""
    return study / "cells" / name / "run"
