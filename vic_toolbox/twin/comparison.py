"""Estimated gains against the truth that a twin knows: errors, how much was observable, whether bands are honest."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array, InputError
from vic_toolbox.estimation import fit_smooth, fit_windows
from vic_toolbox.estimation.estimate import GainEstimate
from vic_toolbox.gains import AXES
from vic_toolbox.recordings import Recording
from vic_toolbox.twin.excitation import Excitation
from vic_toolbox.twin.session import TRUTH, load_session
from vic_toolbox.twin.truth import Truth

STOP = Excitation().until - 0.1
"""Fits end here [s]: the push has gone, and the cup has not landed yet."""
KNOTS = 0.2
"""Distance of the knots of the smooth fits [s]."""
Z95 = 1.959964
HEAD = ("", *AXES)
"""Of the table that :func:`compare_session` makes."""


@dataclass(frozen=True, eq=False)
class GainScore:
    """How one kind of gain, K or B, was found, for each axis (6,)."""

    error: Array
    """Root mean square error over the observable instants, relative to that of the true gain there."""
    bias: Array
    """Mean error, relative to the same."""
    observable: Array
    """Share of the instants at which the data determine the axis."""
    coverage: Array
    """Share of the observable instants at which the 95 % band holds the truth."""


@dataclass(frozen=True, eq=False)
class Comparison:
    """Stiffness and damping of an estimate against the truth; NaN where nothing was observable."""

    stiffness: GainScore
    damping: GainScore


def compare(estimates: GainEstimate | Iterable[GainEstimate], truth: Truth) -> Comparison:
    """Compare the diagonals of an estimate, or of several taken together, with the truth.

    Parameters
    ----------
    estimates : GainEstimate, or iterable of them
        Their times are those of the demonstrations.
    truth : Truth

    Raises
    ------
    InputError
        No estimate.
    """
    several = [estimates] if isinstance(estimates, GainEstimate) else list(estimates)
    if not several:
        raise InputError("no estimate was given; pass one, or a list of them.")
    true = [truth.gains_at(estimate.time) for estimate in several]
    return Comparison(
        _score(
            [e.stiffness for e in several],
            [e.stiffness_sd for e in several],
            [e.stiffness_observable for e in several],
            np.concatenate([gains[0] for gains in true]),
        ),
        _score(
            [e.damping for e in several],
            [e.damping_sd for e in several],
            [e.damping_observable for e in several],
            np.concatenate([gains[1] for gains in true]),
        ),
    )


def _score(
    gains: Sequence[Array], deviations: Sequence[Array], seen: Sequence[NDArray[np.bool_]], true: Array
) -> GainScore:
    """Score of diagonals: `gains` and `deviations` are matrices (m, 6, 6), `seen` (m, 6), `true` (Σ m, 6)."""
    found, sd = (
        np.concatenate([np.diagonal(g, axis1=1, axis2=2) for g in many]) for many in (gains, deviations)
    )
    known = np.concatenate(seen)
    count = known.sum(axis=0)
    off = np.where(known, found - true, 0.0)
    inside = known & (np.abs(off) <= Z95 * np.where(known, sd, 0.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.sqrt(np.sum(np.where(known, true, 0.0) ** 2, axis=0) / count)
        return GainScore(
            error=np.sqrt(np.sum(off**2, axis=0) / count) / size,
            bias=np.sum(off, axis=0) / count / size,
            observable=known.mean(axis=0),
            coverage=inside.sum(axis=0) / count,
        )


def methods(
    logs: Sequence[Recording], *, window: int = 10, knots: float = KNOTS
) -> dict[str, Callable[[], list[GainEstimate]]]:
    """The estimators that are compared, by name: the paper's window, and smooth fits of all demonstrations."""
    return {
        f"window of {window}": lambda: [fit_windows(log, window) for log in logs],
        "smooth, K and B": lambda: [fit_smooth(logs, knots)],
        "smooth, B = d √K": lambda: [fit_smooth(logs, knots, structure="damping_factor")],
    }


def compare_session(
    folder: str | os.PathLike[str],
    truth: str | os.PathLike[str] | None = None,
    *,
    window: int = 10,
    knots: float = KNOTS,
    stage: Callable[[str], None] = lambda title: None,
) -> list[tuple[str, ...]]:
    """Fit a session on disk by every method and compare with the truth: rows of text under :data:`HEAD`.

    Parameters
    ----------
    folder : path-like
    truth : path-like, optional
        By default ``truth/truth.npz`` in the folder.
    window : int
        Samples in a window.
    knots : float
        Distance of the smooth fits' knots [s].
    stage : callable, optional
        Told what begins.

    Raises
    ------
    FileError
        A file is missing or damaged.
    """
    stage("logs")
    known = Truth.load(truth if truth is not None else Path(folder) / TRUTH)
    logs = load_session(folder, stop=STOP)
    rows = []
    for name, fit in methods(logs, window=window, knots=knots).items():
        stage(name)
        rows += table(name, compare(fit(), known))
    return rows


def table(name: str, comparison: Comparison) -> list[tuple[str, ...]]:
    """Rows of text, in per cent, one number for each axis."""
    rows = []
    for gain, score in (("K", comparison.stiffness), ("B", comparison.damping)):
        for what, values in (
            ("error", score.error),
            ("bias", score.bias),
            ("observable", score.observable),
            ("bands that hold", score.coverage),
        ):
            cells = ("-" if np.isnan(x) else f"{100 * x:.{0 if abs(x) >= 0.0995 else 1}f}" for x in values)
            rows.append((f"{name}: {gain}, {what} [%]", *cells))
    return rows
