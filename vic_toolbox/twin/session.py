"""A session on disk: demonstrations and calibration in one folder, the truth in another place."""

from __future__ import annotations

import os
from pathlib import Path

from vic_toolbox import recordings
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.recordings import Recording
from vic_toolbox.tasks.cup_scene import GOAL
from vic_toolbox.twin.calibration import calibrate
from vic_toolbox.twin.guiding import Session
from vic_toolbox.twin.logs import CALIBRATION, LAYOUT, demonstration_paths, write_layout
from vic_toolbox.twin.robot import Twin

TRUTH = "truth/truth.npz"
"""Where the truth goes by default, from the folder of the demonstrations."""
ABOVE = 8e-3
"""The part of a demonstration before the cup is first this close above the goal counts as free motion [m]."""


def session_paths(
    folder: str | os.PathLike[str], truth: str | os.PathLike[str] | None = None
) -> tuple[Path, Path]:
    """Folder and file of the truth of a session to be written; refuses what would mix two sessions, or give it away.

    Raises
    ------
    FileError
        The folder holds demonstrations already.
    InputError
        The truth would lie among the demonstrations.
    """
    folder = Path(folder)
    hidden = folder / TRUTH if truth is None else Path(truth)
    if hidden.parent.resolve() == folder.resolve():
        raise InputError(
            f"the truth {hidden} would lie among the demonstrations; choose another folder for it."
        )
    if any(folder.glob("demonstration_*.npz")):
        raise FileError(f"{folder} holds demonstrations already; choose another folder, or remove them.")
    return folder, hidden


def save_session(
    session: Session,
    twin: Twin,
    folder: str | os.PathLike[str],
    *,
    truth: str | os.PathLike[str] | None = None,
) -> list[Path]:
    """Write ``demonstration_00.npz`` ..., ``calibration.npz`` and ``layout.toml``, and the truth elsewhere.

    Parameters
    ----------
    session : Session
    twin : Twin
        The robot of the session, whose sensor is calibrated too.
    folder : path-like
    truth : path-like, optional
        File of the truth; by default ``truth/truth.npz`` in the folder.

    Raises
    ------
    InputError, FileError
        As :func:`session_paths`, or something cannot be written.
    """
    folder, hidden = session_paths(folder, truth)
    write_layout(folder / LAYOUT)
    calibrate(twin).save(folder / CALIBRATION)
    paths = [folder / f"demonstration_{i:02d}.npz" for i in range(len(session.logs))]
    for log, path in zip(session.logs, paths, strict=True):
        log.save(path)
    session.truth.save(hidden)
    return paths


def load_session(
    folder: str | os.PathLike[str], *, window: float = 0.08, stop: float | None = None, whole: bool = False
) -> list[Recording]:
    """Demonstrations as an experimenter prepares them for a fit; nothing here knows the truth.

    Bias and payload come from the calibration and are taken out, inertia included. Each demonstration ends where the
    cup comes close to the plate, because from there on the sensor feels the plate too. The rates are local cubics of
    the pose; the wrench stays as it is, since its noise is what tells an estimator how sure it may be.

    Parameters
    ----------
    folder : path-like
        As :func:`save_session` wrote it.
    window : float
        Of the rates [s].
    stop : float, optional
        Leave out what comes later [s].
    whole : bool
        Keep all of the motion, the plate and what comes after it: to learn from, not to fit.

    Raises
    ------
    FileError
        Something is missing or damaged.
    """
    folder = Path(folder)
    layout = recordings.Layout.load(folder / LAYOUT)
    payload = recordings.identify_payload(recordings.read(folder / CALIBRATION, layout))
    found = []
    for path in demonstration_paths(folder):
        log = recordings.compensate_payload(recordings.read(path, layout), payload)
        log = recordings.differentiate(log, window=window, smooth=False)
        low = (log.position[:, 2] < GOAL[2] + ABOVE) & (not whole)
        end = log.time[low.argmax()] if low.any() else log.time[-1]
        found.append(log.between(0.0, min(end, end if stop is None else stop)))
    return found
