"""What of a schedule is known: axes that the data determine, and the stretch of time in which they are."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability.analysis.setting import listed
from vic_toolbox.stability.analysis.subject import Course

LEAST = 8
"""Fewest instants that are a schedule."""


def determined(
    course: Course, wanted: Sequence[int], names: Sequence[str]
) -> tuple[list[int], slice, list[str]]:
    """Axes, and instants, that hold the most of what is known together: as many axes for as long as possible.

    Gains are never made up: an axis that is seldom determined is left out, and what lies before and after the longest
    stretch without a gap is not judged.

    Returns
    -------
    axes : list of int
    window : slice
        Of the instants.
    notes : list of str
        What was left out.

    Raises
    ------
    InputError
        Nothing is determined for long enough.
    """
    known = np.stack([_known(course.stiffness, i) & _known(course.damping, i) for i in wanted], axis=1)
    best: tuple[float, tuple[int, ...], slice] | None = None
    candidates = [i for i in range(len(wanted)) if known[:, i].sum() >= min(LEAST, len(known))]
    for count in range(len(candidates), 0, -1):
        for some in itertools.combinations(candidates, count):
            run = _longest_run(known[:, some].all(axis=1) & _coupled(course, [wanted[i] for i in some]))
            length = run.stop - run.start
            if length >= min(LEAST, len(known)) and (best is None or count * length > best[0]):
                best = (count * length, some, run)
    if best is None:
        raise InputError(
            f"the gains of {listed([names[i] for i in wanted])} are nowhere determined (K and B both) for "
            f"{LEAST} instants on end; fit a log with more motion, or constant gains."
        )
    _, some, window = best
    axes = [wanted[i] for i in some]
    notes = []
    if lost := [names[i] for i in wanted if i not in axes]:
        notes.append(
            f"{listed(lost)} left out: not determined for long enough by the data, and never guessed"
        )
    if window.stop - window.start < len(course.time):
        first, last = course.time[window.start], course.time[window.stop - 1]
        notes.append(
            f"judged from {first:.4g} to {last:.4g} s, the longest stretch in which {listed([names[i] for i in axes])} "
            "are determined together"
        )
    return axes, window, notes


def refuse_negative(stiffness: Array, damping: Array, names: Sequence[str], time: Array | None) -> None:
    """Say which axis has a negative gain, and when; coupled gains are checked by every method.

    Raises
    ------
    InputError
        A negative diagonal entry.
    """
    for letter, gains in (("K", stiffness), ("B", damping)):
        diagonal = np.diagonal(gains, axis1=1, axis2=2)
        if (diagonal < 0).any():
            row, axis = (int(i) for i in np.argwhere(diagonal < 0)[0])
            when = "" if time is None else f" at {time[row]:.4g} s"
            count = f"{int((diagonal[:, axis] < 0).sum())} of {len(diagonal)}"
            raise InputError(
                f"{letter}_{names[axis]} is {diagonal[row, axis]:.4g}{when} (negative in {count} samples): such a gain "
                "makes energy by itself. Fit with a constraint that keeps it positive, or judge the other axes."
            )


def _known(gains: Array, axis: int) -> np.ndarray:
    return np.isfinite(gains[:, axis, axis])


def _coupled(course: Course, axes: list[int]) -> np.ndarray:
    """Instants at which what couples these axes is known too."""
    index = np.array(axes)
    return np.all(
        [
            np.isfinite(g[:, index[:, None], index]).all(axis=(1, 2))
            for g in (course.stiffness, course.damping)
        ],
        axis=0,
    )


def _longest_run(known: np.ndarray) -> slice:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]])))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return slice(0, 0)
    longest = int(np.argmax(stops - starts))
    return slice(int(starts[longest]), int(stops[longest]))
