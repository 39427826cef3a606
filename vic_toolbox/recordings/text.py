"""Text tables: CSV, TSV, semicolons or blanks, with one line of names."""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from vic_toolbox.errors import Array, FileError
from vic_toolbox.files import LARGEST_BYTES
from vic_toolbox.recordings.table import LARGEST_SAMPLES, Table, too_large

LONGEST_LINE = 1 << 16
MISSING = {"", "nan", "na", "n/a", "null", "none"}


def read_text(path: Path, *, repair: bool = False) -> Table:
    """Open a text table; its columns are parsed when they are loaded.

    Parameters
    ----------
    path : Path
    repair : bool
        Leave out a last line that breaks off.

    Raises
    ------
    FileError
        Not text, empty, without a line of names, or a line that does not fit (its number is named).
    """
    if path.stat().st_size > LARGEST_BYTES:
        raise too_large(path, f"has {path.stat().st_size >> 20} MiB")
    header, skipped, delimiter = _header(path)
    return Table(
        str(path),
        tuple(header),
        lambda names: _columns(path, header, names, skipped=skipped, delimiter=delimiter, repair=repair),
    )


def _header(path: Path) -> tuple[list[str], int, str | None]:
    """Names of the columns, number of lines above the numbers, and the delimiter."""
    with path.open("rb") as file:
        start = file.read(LONGEST_LINE)
    if not start.strip(b"# \t\r\n\xef\xbb\xbf"):
        raise FileError(f"{path} is empty; expected a line of names and lines of numbers.")
    if b"\0" in start:
        raise FileError(f"{path} is no text and no known format; expected CSV, npz, HDF5 or a ROS bag.")
    try:
        lines = start.decode(
            "utf-8-sig", errors="strict" if len(start) < LONGEST_LINE else "ignore"
        ).splitlines()
    except UnicodeDecodeError as error:
        raise FileError(f"{path} is no text in UTF-8 ({error}); save it as UTF-8 or ASCII.") from error
    number, line = next((i, line) for i, line in enumerate(lines) if line.strip("# \t\r\n"))
    text = line.strip().removeprefix("#").strip()
    delimiter = next((d for d in ("\t", ";", ",") if d in text), None)
    names = [
        name.strip().strip('"').strip() for name in (text.split(delimiter) if delimiter else text.split())
    ]
    if len(lines) < number + 2 and len(start) == LONGEST_LINE:
        raise FileError(
            f"{path} has a line of more than {LONGEST_LINE} characters; expected a table of numbers."
        )
    if all(_is_number(name) for name in names):
        raise FileError(
            f"{path} begins with numbers ({text[:40]}...); put a line with the names of the columns above them."
        )
    names = [name or f"column {i + 1}" for i, name in enumerate(names)]
    doubled = sorted({name for name in names if names.count(name) > 1}) if len(names) < 10_000 else []
    if doubled:
        raise FileError(
            f"{path} has more than one column called {', '.join(doubled)[:200]}; give each its own name."
        )
    return names, number + 1, delimiter


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|nan|[-+]?inf", text) is not None


def _columns(
    path: Path, header: list[str], names: Sequence[str], *, skipped: int, delimiter: str | None, repair: bool
) -> dict[str, Array]:
    wanted = [header.index(name) for name in names]
    # the limit is set only where the file can hold so much: loadtxt takes memory for all the rows it may read
    most = LARGEST_SAMPLES + 1 if path.stat().st_size > 2 * len(header) * LARGEST_SAMPLES else None
    # the last column is read too, so that a line that breaks off is noticed whichever columns are wanted
    usecols = [*wanted, len(header) - 1]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no data: told below
            numbers = np.loadtxt(
                path,
                delimiter=delimiter,
                skiprows=skipped,
                usecols=usecols,
                ndmin=2,
                max_rows=most,
                quotechar='"',
                encoding="utf-8-sig",
            )
    except (ValueError, OverflowError, IndexError):
        numbers = _patiently(path, header, usecols, skipped=skipped, delimiter=delimiter, repair=repair)
    except OSError as error:
        raise FileError(f"{path} cannot be read ({error})") from error
    if len(numbers) == 0:
        raise FileError(f"{path} has a line of names and no numbers; the log is empty.")
    if len(numbers) > LARGEST_SAMPLES:
        raise too_large(path, f"has more than {LARGEST_SAMPLES} lines")
    return {name: numbers[:, i] for i, name in enumerate(names)}


def _patiently(
    path: Path, header: list[str], usecols: list[int], *, skipped: int, delimiter: str | None, repair: bool
) -> Array:
    """The same line by line, for tables with empty cells; says which line does not fit."""
    rows: list[list[float]] = []
    broken = None
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            for _ in range(skipped):
                file.readline(LONGEST_LINE)
            lines = csv.reader(file, delimiter=delimiter) if delimiter else (line.split() for line in file)
            for number, cells in enumerate(lines, skipped + 1):
                if not cells or cells[0].lstrip().startswith("#"):
                    continue
                if broken is not None:
                    raise broken
                if len(cells) != len(header):
                    broken = FileError(
                        f"{path}, line {number}: {len(cells)} cells where there are {len(header)} columns; "
                        "the file is damaged or cut off there."
                    )
                    continue
                rows.append([_number(path, number, header[i], cells[i]) for i in usecols])
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path} is no table of text after line {len(rows) + skipped} ({error}).") from error
    except OSError as error:
        raise FileError(f"{path} cannot be read ({error})") from error
    if broken is not None and not (repair and rows):
        raise broken
    return np.array(rows, dtype=np.float64).reshape(len(rows), len(usecols))


def _number(path: Path, line: int, column: str, cell: str) -> float:
    text = cell.strip()
    if text.lower() in MISSING:
        return float("nan")
    try:
        return float(text)
    except ValueError:
        hint = " (write a point for the decimal comma)" if re.fullmatch(r"[-+]?\d+,\d+", text) else ""
        raise FileError(f"{path}, line {line}: {column} is {text[:40]!r}, not a number{hint}.") from None
