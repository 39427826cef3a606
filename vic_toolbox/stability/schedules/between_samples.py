"""Does a matrix inequality hold at every instant, and not just at the samples.

Gains between samples are cubics (:mod:`.schedule`), so an inequality that is linear in them and
in their slopes asks for ``X(s) ≻ 0`` of a matrix whose entries are cubics. In Bernstein form X(s) is a mean of four
coefficient matrices: where these are positive definite, X is so on the whole interval. Where one is not, the interval
is halved, which brings the coefficients closer to X.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.definite import CHUNK, ROUNDING, Mask, positive_definite
from vic_toolbox.stability.schedules.pencil import lifted
from vic_toolbox.stability.schedules.schedule import Index, Share

HALVINGS = 7
"""How often an interval is halved before it counts as failed."""
MOST = 65536
"""Parts looked at together; more of them means that the inequality does not hold."""


class Coefficient(NamedTuple):
    """One Bernstein coefficient X of every piece: a sum of packed terms (p, m), or (p, 1)."""

    terms: tuple[Array, ...]
    strict: bool = False
    """X must be ≻ 0, and not just ⪰ 0 up to the rounding of its terms."""


Pieces = Callable[[Index, Share, Share], Iterable[Coefficient]]
"""Coefficients over the part [low, high] of each of some intervals. Over whole neighbouring intervals (a slice) the
last coefficient may be left out: the gains and their slopes are continuous, and it is the next one's first."""


class Parts(NamedTuple):
    """Parts of intervals in which an inequality could not be shown: interval, and its shares."""

    index: NDArray[np.intp]
    low: Array
    high: Array

    def instants(self, time: Array) -> Array:
        """Their midpoints [s]."""
        width = time[self.index + 1] - time[self.index]
        return time[self.index] + 0.5 * (self.low + self.high) * width


def failing(
    pieces: Pieces,
    intervals: int,
    *,
    diagonal: bool = False,
    settled: Callable[[slice], bool] = lambda _: False,
) -> Parts:
    """Where the inequality could not be shown to hold; empty if it holds at every instant.

    Parameters
    ----------
    pieces : callable
    intervals : int
    diagonal : bool, optional
        The rows are diagonal entries.
    settled : callable, optional
        Whether the inequality is already known to hold over some neighbouring intervals.
    """
    bad = [np.array([intervals - 1])]  # whose end is no other interval's start
    for start in range(0, intervals, CHUNK):
        stop = min(start + CHUNK, intervals)
        if settled(slice(start, stop)):
            continue
        good = _positive(pieces(slice(start, stop), 0.0, 1.0), stop - start, diagonal)
        bad.append(start + np.flatnonzero(~good))
    index = np.unique(np.concatenate(bad))
    parts = Parts(index, np.zeros(len(index)), np.ones(len(index)))
    for _ in range(HALVINGS):
        if not 0 < len(parts.index) <= MOST:
            break
        index, middle = np.repeat(parts.index, 2), 0.5 * (parts.low + parts.high)
        low = np.stack([parts.low, middle], axis=1).reshape(-1)
        high = np.stack([middle, parts.high], axis=1).reshape(-1)
        bad = ~_positive(pieces(index, low, high), len(index), diagonal)
        parts = Parts(index[bad], low[bad], high[bad])
    return parts


def _positive(coefficients: Iterable[Coefficient], count: int, diagonal: bool) -> Mask:
    good = np.ones(count, dtype=bool)
    for terms, strict in coefficients:
        total = sum(terms[1:], start=terms[0])
        if diagonal and total.min() > 0:
            continue
        found: Mask = np.asarray((total > 0).all(axis=0) if diagonal else positive_definite(total))
        doubtful = np.flatnonzero(~found)
        if len(doubtful) and not strict:
            some = [x if x.shape[1] == 1 else x[:, doubtful] for x in terms]
            size = np.broadcast_to(sum(np.abs(x) for x in some), (len(total), len(doubtful)))
            again = total[:, doubtful] if total.shape[1] > 1 else total
            found = found.copy()
            if diagonal:
                found[doubtful] = (again >= -ROUNDING * size).all(axis=0)
            else:
                found[doubtful] = positive_definite(lifted(again, size))
        good &= found
    return good
