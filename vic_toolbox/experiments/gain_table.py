"""Gains over time as a table that any program reads: one row for each instant, SI units in the head."""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array, FileError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.files import write_atomically
from vic_toolbox.gains import AXES

TIME = "time [s]"
KINDS = {"K": ("stiffness", ("N/m", "N/rad", "Nm/rad")), "B": ("damping", ("Ns/m", "Ns/rad", "Nms/rad"))}
"""Letter of a gain: its name, and its units between two translations, a translation and a rotation, two rotations."""


def gain_name(kind: str, row: int, column: int) -> str:
    """``K_x`` on the diagonal, ``K_x_ry`` off it."""
    return f"{kind}_{AXES[row]}" if row == column else f"{kind}_{AXES[row]}_{AXES[column]}"


def gain_unit(kind: str, row: int, column: int) -> str:
    """Unit of an entry of the upper triangle of K or B."""
    return KINDS[kind][1][(row > 2) + (column > 2)]


@dataclass(frozen=True, eq=False)
class GainTable:
    """What ``gains.csv`` holds; NaN where the data do not determine a gain.

    Attributes
    ----------
    time : ndarray, shape (m,)
        [s].
    stiffness, damping, stiffness_sd, damping_sd : ndarray, shape (m, 6, 6)
        K and B, and their standard deviations.
    stiffness_observable, damping_observable : ndarray of bool, shape (m, 6)
        Whether the data determine the axis.
    """

    time: Array
    stiffness: Array
    damping: Array
    stiffness_sd: Array
    damping_sd: Array
    stiffness_observable: NDArray[np.bool_]
    damping_observable: NDArray[np.bool_]

    @classmethod
    def of(cls, estimate: GainEstimate) -> GainTable:
        """The part of an estimate that fits into a table."""
        return cls(**{name: getattr(estimate, name) for name in cls.__dataclass_fields__})

    @property
    def full(self) -> bool:
        """Whether axes are coupled: the table then has the upper triangles, else the diagonals."""
        apart = ~np.eye(6, dtype=bool)
        return bool((self.stiffness[:, apart] != 0).any() or (self.damping[:, apart] != 0).any())

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write it as CSV: time, gains, their standard deviations, and flags (1: determined); NaN is an empty cell.

        Numbers are written with as many digits as it takes to read the same ones back.

        Raises
        ------
        FileError
            The file cannot be written.
        """
        names, columns = zip(*self._columns(), strict=True)
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(names)
        flags = [column.dtype == bool for column in columns]
        lists = [column.tolist() for column in columns]
        for row in zip(*lists, strict=True):
            writer.writerow([
                int(x) if flag else "" if x != x else repr(x) for x, flag in zip(row, flags, strict=True)
            ])  # fmt: skip
        write_atomically(path, text.getvalue())

    def _columns(self) -> Iterator[tuple[str, NDArray]]:
        entries = [(i, j) for i in range(6) for j in range(i, 6) if self.full or i == j]
        yield TIME, self.time
        for prefix, suffix in (("", ""), ("sd ", "_sd")):
            for kind, (name, _) in KINDS.items():
                for i, j in entries:
                    head = f"{prefix}{gain_name(kind, i, j)} [{gain_unit(kind, i, j)}]"
                    yield head, getattr(self, f"{name}{suffix}")[:, i, j]
        for kind, (name, _) in KINDS.items():
            for i in range(6):
                yield f"{gain_name(kind, i, i)} observable", getattr(self, f"{name}_observable")[:, i]

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> GainTable:
        """Read what :meth:`write` wrote; the order of the columns does not matter.

        Raises
        ------
        FileError
            Missing, or not such a table.
        """
        try:
            with Path(path).open(newline="", encoding="utf-8") as file:
                rows = list(csv.reader(file))
        except (OSError, UnicodeDecodeError, csv.Error, ValueError) as error:
            raise FileError(f"{path} cannot be read as a table of gains ({error})") from error
        if not rows or TIME not in rows[0] or any(len(row) != len(rows[0]) for row in rows):
            raise FileError(f"{path} is no table of gains: no column {TIME!r}, or rows of different lengths.")
        body = list(zip(*rows[1:], strict=True)) or [()] * len(rows[0])
        cells = dict(zip(rows[0], body, strict=True))
        try:
            return cls(np.array(cells[TIME], dtype=float), **_matrices(cells), **_flags(cells))
        except (KeyError, ValueError) as error:
            raise FileError(f"{path} is no table of gains ({error}); write it again with vic fit.") from error


def _matrices(cells: dict[str, tuple[str, ...]]) -> dict[str, Any]:
    count, found = len(cells[TIME]), {}
    for prefix, suffix in (("", ""), ("sd ", "_sd")):
        for kind, (name, _) in KINDS.items():
            matrix = np.zeros((count, 6, 6))
            for i in range(6):
                for j in range(i, 6):
                    head = f"{prefix}{gain_name(kind, i, j)} [{gain_unit(kind, i, j)}]"
                    if i == j or head in cells:
                        column = [float(cell) if cell else np.nan for cell in cells[head]]
                        matrix[:, i, j] = matrix[:, j, i] = column
            found[name + suffix] = matrix
    return found


def _flags(cells: dict[str, tuple[str, ...]]) -> dict[str, Any]:
    return {
        f"{name}_observable": np.column_stack([
            np.array(cells[f"{gain_name(kind, i, i)} observable"], dtype=int) == 1 for i in range(6)
        ])
        for kind, (name, _) in KINDS.items()
    }  # fmt: skip
