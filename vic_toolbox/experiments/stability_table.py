"""Gains over time from a table that anybody may write: ``time,K_x,B_x,…``; empty cells are not determined."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vic_toolbox.errors import Array, FileError, InputError
from vic_toolbox.experiments.gain_table import gain_unit
from vic_toolbox.gains import AXES

COLUMN = re.compile(r"(K|B|stiffness|damping)(?:_?(rx|ry|rz|x|y|z)(?:_(rx|ry|rz|x|y|z))?)?", re.IGNORECASE)
MOTION = re.compile(r"(e|error|de|error_rate)_?(rx|ry|rz|x|y|z)?", re.IGNORECASE)
TIME = ("time", "t")
MISSING = ("", "nan")
UNITS = {"e": ("m", "rad"), "de": ("m/s", "rad/s")}


@dataclass(frozen=True, eq=False)
class GainCourse:
    """Gains over time, with the motion if the table has it.

    Parameters
    ----------
    time : ndarray, shape (n,)
        [s].
    stiffness, damping : ndarray, shape (n, 6, 6), or (n, 1, 1) of a table with columns K and B
        NaN where they are not determined.
    error, error_rate : ndarray, shape (n, 6) or (n, 1), optional
        e and ė, where the table has columns ``e_x`` … and ``de_x`` …
    """

    time: Array
    stiffness: Array
    damping: Array
    error: Array | None = None
    error_rate: Array | None = None


def read_gains(path: str | os.PathLike[str]) -> GainCourse:
    """Read a CSV with a column for the time, and K and B of each axis: ``K_x``, ``Kx`` or ``K_x [N/m]``.

    Columns ``K_x_ry`` couple axes. Plain ``K`` and ``B`` are those of a single axis. Others are not looked at.

    Raises
    ------
    FileError
        It cannot be read.
    InputError
        Columns are missing, a cell is no number, time runs back, or a unit is not SI.
    """
    names, rows = _cells(path)
    columns = {name: i for i, name in enumerate(names)}
    time_at = next((i for name, i in columns.items() if _bare(name).lower() in TIME), None)
    found = {name: match for name in names if (match := COLUMN.fullmatch(_bare(name)))}
    if time_at is None or not _has_both(found):
        raise InputError(
            f"{path} needs a column time [s], and for each axis one K and one B, e.g. time,K_x,B_x,K_y,B_y; "
            f"its columns are {', '.join(names) or 'none'}."
        )
    numbers = _numbers(path, names, rows, [time_at, *(columns[name] for name in found)])
    time = numbers[:, time_at]
    _refuse_wrong_time(path, names[time_at], time)
    single = all(match[2] is None for match in found.values())
    if not single and any(match[2] is None for match in found.values()):
        raise InputError(
            f"{path} has columns with and without an axis ({', '.join(found)}); name the axis of each."
        )
    d = 1 if single else 6
    gains = {kind: np.full((len(time), d, d), np.nan) for kind in "KB"}
    for matrix in gains.values():
        matrix[:, ~np.eye(d, dtype=bool)] = 0.0
    for name, match in found.items():
        kind = "K" if match[1].lower() in ("k", "stiffness") else "B"
        row = 0 if match[2] is None else AXES.index(match[2].lower())
        column = row if match[3] is None else AXES.index(match[3].lower())
        if not single:
            _refuse_unit(path, name, (gain_unit(kind, *sorted((row, column))),))
        gains[kind][:, row, column] = gains[kind][:, column, row] = numbers[:, columns[name]]
    return GainCourse(time, gains["K"], gains["B"], *_motion(path, names, rows, d))


def _has_both(found: Mapping[str, re.Match[str]]) -> bool:
    """Whether there is a K and a B of the same axis on the diagonal."""
    axes: dict[str, set[str | None]] = {"k": set(), "b": set()}
    for match in found.values():
        if match[3] is None or match[3] == match[2]:
            axes["k" if match[1].lower() in ("k", "stiffness") else "b"].add(match[2] and match[2].lower())
    return bool(axes["k"] & axes["b"])


def _cells(path: str | os.PathLike[str]) -> tuple[list[str], list[list[str]]]:
    try:
        with Path(path).open(newline="", encoding="utf-8-sig") as file:
            lines = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except (OSError, UnicodeDecodeError, csv.Error, ValueError) as error:
        raise FileError(f"{path} cannot be read as a table of gains ({error}).") from error
    if len(lines) < 2:
        raise InputError(f"{path} has no rows; the first line names the columns: time,K_x,B_x,…")
    names = [cell.strip() for cell in lines[0]]
    if len(set(names)) < len(names):
        raise InputError(f"{path} names a column twice: {', '.join(names)}.")
    for number, row in enumerate(lines[1:], 2):
        if len(row) != len(names):
            raise InputError(f"{path}, row {number}, has {len(row)} cells and the first line {len(names)}.")
    return names, lines[1:]


def _numbers(
    path: str | os.PathLike[str], names: Sequence[str], rows: list[list[str]], used: list[int]
) -> Array:
    numbers = np.full((len(rows), len(names)), np.nan)
    for i in used:
        for number, row in enumerate(rows, 2):
            cell = row[i].strip()
            try:
                numbers[number - 2, i] = np.nan if cell.lower() in MISSING else float(cell)
            except ValueError:
                raise InputError(f"{path}, row {number}, column {names[i]}: {cell!r} is no number.") from None
    if np.isinf(numbers).any():
        row, column = (int(i) for i in np.argwhere(np.isinf(numbers))[0])
        raise InputError(f"{path}, row {row + 2}, column {names[column]} is infinite.")
    return numbers


def _refuse_wrong_time(path: str | os.PathLike[str], name: str, time: Array) -> None:
    _refuse_unit(path, name, ("s",))
    if np.isnan(time).any():
        raise InputError(f"{path}, row {int(np.argmax(np.isnan(time))) + 2} has no time.")
    if (np.diff(time) <= 0).any():
        row = int(np.argmax(np.diff(time) <= 0)) + 1
        raise InputError(
            f"{path}, row {row + 2}: time {time[row]:g} s does not follow {time[row - 1]:g} s; sort the rows, and "
            "drop those that are there twice."
        )


def _motion(
    path: str | os.PathLike[str], names: Sequence[str], rows: list[list[str]], d: int
) -> tuple[Array | None, Array | None]:
    """E and ė, each only if all cells of all its axes are there."""
    found: dict[str, Array] = {}
    for name in names:
        match = MOTION.fullmatch(_bare(name))
        if match is None or (match[2] is None) != (d == 1):
            continue
        kind = "de" if match[1].lower() in ("de", "error_rate") else "e"
        axis = 0 if match[2] is None else AXES.index(match[2].lower())
        _refuse_unit(path, name, UNITS[kind] if d == 1 else (UNITS[kind][axis > 2],))
        column = _numbers(path, names, rows, [names.index(name)])[:, names.index(name)]
        found.setdefault(kind, np.zeros((len(rows), d)))[:, axis] = column
    return tuple(a if a is not None and np.isfinite(a).all() else None for a in map(found.get, ("e", "de")))  # type: ignore[return-value]


def _bare(name: str) -> str:
    """Without its unit."""
    return re.sub(r"\s*[\[(].*[\])]\s*$", "", name).strip()


def _refuse_unit(path: str | os.PathLike[str], name: str, expected: Sequence[str]) -> None:
    unit = re.search(r"[\[(](.*)[\])]\s*$", name)
    if unit is not None and unit[1].strip() not in expected:
        raise InputError(
            f"{path}: column {name} is in {unit[1].strip()}; write it in {' or '.join(expected)}."
        )
