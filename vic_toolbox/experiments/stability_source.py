"""What ``vic stability`` is pointed at: a fit, a table of gains, or the folder of a run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vic_toolbox import recordings
from vic_toolbox.errors import Array, FileError, InputError, VicError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments.fitting import digest
from vic_toolbox.experiments.stability_table import GainCourse, read_gains
from vic_toolbox.files import read_json

ESTIMATE, FIT, RUN = "estimate.npz", "fit.json", "config.json"
LATE = 0.5
"""A log whose instants are this many of its steps away from those of the fit is another log."""


@dataclass(frozen=True, eq=False)
class Source:
    """Gains over time, and what is known about where they come from.

    Parameters
    ----------
    path : Path
        As given.
    title, described : str
        For the head of the report.
    gains : GainEstimate or GainCourse
        To analyse.
    joints : ndarray, shape (n, nv), optional
        Joint angles of the log at the instants of the gains [rad].
    notes : tuple of str
        What was looked for and not found.
    """

    path: Path
    title: str
    described: str
    gains: Any
    joints: Array | None = None
    notes: tuple[str, ...] = ()


def is_run(path: str | os.PathLike[str]) -> bool:
    """Whether this is the folder of a run."""
    return (Path(path) / RUN).is_file()


def read_source(path: str | os.PathLike[str]) -> Source:
    """Read a fit (its folder or ``estimate.npz``) or a table of gains.

    Raises
    ------
    FileError
        Nothing there, or it cannot be read.
    InputError
        It is none of these.
    """
    path = Path(path)
    if not path.exists():
        raise FileError(
            f"{path} does not exist; pass a folder of vic fit, an estimate.npz, a CSV of gains, or a run."
        )
    if path.is_dir():
        if not (path / ESTIMATE).is_file():
            listed = ", ".join(sorted(entry.name for entry in path.iterdir())[:5]) or "nothing"
            raise InputError(
                f"{path} holds neither a fit ({ESTIMATE}) nor a run ({RUN}), but {listed}; pass the folder of vic fit "
                "or vic train."
            )
        return _of_fit(path, path / ESTIMATE)
    if path.suffix.lower() == ".npz":
        return _of_fit(path, path)
    if path.suffix.lower() not in (".csv", ".txt"):
        raise InputError(
            f"{path} is no {ESTIMATE} and no .csv; pass one of them, or the folder of a fit or a run."
        )
    gains = read_gains(path)
    shown = f"{len(gains.time)} rows from {gains.time[0]:.4g} to {gains.time[-1]:.4g} s"
    return Source(path, f"Stability of {path.name}", f"a table of gains: {shown}", gains)


def _of_fit(given: Path, file: Path) -> Source:
    estimate = GainEstimate.load(file)
    name = given.name if given.is_dir() else given.resolve().parent.name
    notes: list[str] = []
    error = rate = joints = None
    if (file.parent / FIT).is_file():
        error, rate, joints, note = _motion_of(read_json(file.parent / FIT), estimate)
        notes += [note] if note else []
    gains: Any = estimate
    if error is not None:
        gains = GainCourse(estimate.time, estimate.stiffness, estimate.damping, error, rate)
    described = f"fitted gains ({estimate.method}), {len(estimate.time)} instants"
    return Source(given, f"Stability of the fit {name}", described, gains, joints, tuple(notes))


def _motion_of(fit: Any, estimate: GainEstimate) -> tuple[Array | None, Array | None, Array | None, str]:
    """e, ė and the joints of the log that a fit is from, at its instants; or why not."""
    inputs = fit.get("inputs", []) if isinstance(fit, Mapping) else []
    if len(inputs) != 1 or len(estimate.time) < 2:
        return None, None, None, ""
    file = Path(str(inputs[0].get("file")))
    note = f"the motion of the log is not used: {file} "
    if not file.exists():
        return None, None, None, f"{note}is not there"
    try:
        if digest(file) != inputs[0].get("sha256"):
            return None, None, None, f"{note}is not the file that was fitted"
        log = recordings.read(file, fit.get("layout"))
        error, rate = log.error, log.error_rate
    except (VicError, TypeError, ValueError, KeyError) as trouble:
        return None, None, None, f"{note}cannot be read again ({trouble})"
    step = float(np.median(np.diff(log.time)))
    if estimate.time[0] < log.time[0] - LATE * step or estimate.time[-1] > log.time[-1] + LATE * step:
        return None, None, None, f"{note}has another clock"

    def there(column: Array) -> Array:
        return np.column_stack([np.interp(estimate.time, log.time, x) for x in column.T])

    joints = None if log.joint_position is None else there(log.joint_position)
    return there(error), there(rate), joints, ""
