"""The paper's experiment on a robot, up to what there is to learn from: a human guides, gains are fitted, labels made.

The robot is the digital twin (:mod:`vic_toolbox.twin`), never called anything else. One session gives several sets of
demonstrations of the same motions, which differ in how the actions were found:

===========  ======  =======================================================================================
``windows``  gain    the paper: in each demonstration a sliding window of ten samples, least squares
``smooth``   gain    one smooth fit to all demonstrations
``wrench``   force   the hand's wrench as the F/T sensor measured it, which no fit has to find
===========  ======  =======================================================================================
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from vic_toolbox import estimation, recordings, tasks, twin
from vic_toolbox.errors import Array
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.recordings import Recording
from vic_toolbox.tasks.recorded import label
from vic_toolbox.twin.comparison import KNOTS, STOP, GainScore

DURATION = 5.1
"""Of a demonstration [s]: an episode of the task, and the last sample of it."""
WRENCH = "wrench"
"""Name of the demonstrations whose actions are the measured wrench."""


def _windows(logs: Sequence[Recording], settings: SessionSettings) -> list[GainEstimate]:
    """The paper's: each demonstration by itself, in the form in which the task's action writes gains, B = d √K."""
    return [estimation.fit_windows(log, settings.window, structure="damping_factor") for log in logs]


def _smooth(logs: Sequence[Recording], settings: SessionSettings) -> GainEstimate:
    return estimation.fit_smooth(logs, KNOTS)


Fit = Callable[[Sequence[Recording], SessionSettings], GainEstimate | list[GainEstimate]]
_FITS: Mapping[str, Fit] = MappingProxyType({"windows": _windows, "smooth": _smooth})


def record_session(settings: SessionSettings, folder: Path, *, seed: int, threads: int = 1) -> dict[str, Any]:
    """Guide the twin, fit the gains by every method, write demonstrations of Cup-on-Plate to ``folder/NAME.npz``.

    The gains are fitted up to 2.6 s, while the push lasts and before the cup is near the plate, and held after it. What
    a window does not determine is taken from the other demonstrations at that time. Gains outside the task's range are
    clipped to it.

    Parameters
    ----------
    settings : SessionSettings
    folder : Path
        Gets the recordings too, under ``recordings/``; an earlier session there is replaced.
    seed : int
        Of the robot and of the session.
    threads : int
        Threads of the physics; the numbers do not depend on it.

    Returns
    -------
    dict
        By fit: relative errors and bias of K and B for each axis and the share that was observable, what lay outside
        the task's range for each parameter, what was borrowed for each K and B; and how much of the wrench is M(x) ẍ.
    """
    robot = twin.Twin(seed=seed)
    session = twin.guide(
        robot,
        count=settings.count,
        seed=seed,
        excitation=twin.Excitation(force=settings.push),
        rate=settings.rate,
        duration=DURATION,
        threads=threads,
    )
    raw = folder / "recordings"
    shutil.rmtree(raw, ignore_errors=True)
    twin.save_session(session, robot, raw)
    fitted, whole = twin.load_session(raw, stop=STOP), twin.load_session(raw, whole=True)
    task = tasks.make("cup-on-plate")
    values: dict[str, Any] = {"inertia_share": _plain(recordings.inertia_share(fitted))}
    for name in settings.fits:
        found = _FITS[name](fitted, settings)
        labelled = label(whole, found, task=task, fallback="others", hold=True)
        tasks.Demonstrations.of(labelled, task).save(folder / f"{name}.npz")
        scores = twin.compare(found, session.truth)
        values[name] = {
            "stiffness": _score(scores.stiffness),
            "damping": _score(scores.damping),
            "outside": dict(zip(task.gains.names, _plain(labelled.outside(task)), strict=True)),
            "borrowed": _plain(labelled.borrowed),
        }
    force = task.with_action("force")
    tasks.Demonstrations.of(label(whole, None, task=force), force).save(folder / f"{WRENCH}.npz")
    return values


def _score(score: GainScore) -> dict[str, list[float | None]]:
    return {name: _plain(getattr(score, name)) for name in ("error", "bias", "observable", "coverage")}


def _plain(numbers: Array) -> list[float | None]:
    """For JSON: NaN, where nothing was observable, as null."""
    return [None if np.isnan(x) else float(x) for x in numbers]
