"""The constant α that serve a schedule with constant mass: an interval, from samples and what lies between them.

    α M ⪯ D    and    K̇ + α Ḋ ⪯ 2 α K    at every instant.

The ends of the interval are found at the samples, to the last digit (:mod:`.pencil`), and then around the instant that
decides. An α in its middle is shown to serve at every instant (:mod:`.between_samples`). Axes that nothing couples are
taken on their own, which is faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array
from vic_toolbox.stability.arguments import Source, impedance_rows, sample_times, sampled
from vic_toolbox.stability.schedules.between_samples import Coefficient, Pieces, failing
from vic_toolbox.stability.schedules.definite import ROUNDING, least_ratio, pack, relative_slack, size, unpack
from vic_toolbox.stability.schedules.pencil import SAMPLE, Edge, Pick, Samples, largest, least
from vic_toolbox.stability.schedules.schedule import Index, Schedule, Share
from vic_toolbox.stability.verdict import Certificate

STATEMENT = "α M ⪯ D, K̇ + α Ḋ ⪯ 2 α K and K + α D − α² M ≻ 0 at every instant"
SMOOTH = "between the samples the gains are the cubics through them: they do not jump"
ZOOMS, ZOOM = 5, 33
"""Rounds and instants of the search around the worst sample."""
ATTEMPTS = 4
"""How often α is moved because of what lies between samples."""
PROFILE = 301
"""Instants of the picture."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A schedule with constant mass, ready for the two inequalities.

    Parameters
    ----------
    mass : ndarray, shape (p, 1)
    stiffness, damping : Schedule
    diagonal : bool
        Nothing couples the axes: rows are axes and not entries of matrices.
    """

    mass: Array
    stiffness: Schedule
    damping: Schedule
    diagonal: bool

    @classmethod
    def of(cls, mass: Source, stiffness: Source, damping: Source, *, time: ArrayLike) -> Problem | None:
        """Check and pack what a method was given; None if the mass changes.

        Raises
        ------
        InputError
            Gains that are not symmetric, not positive, not finite, or not as many as the instants.
        """
        instants = sample_times(time)
        given, alone = impedance_rows(*(sampled(x, instants) for x in (mass, stiffness, damping)))
        lengths = [len(x) for x in given if x.ndim == 3]
        sample_times(instants, count=lengths[0] if lengths else None)
        if given.mass.ndim == 3 and (given.mass != given.mass[0]).any():
            return None
        m, k, b = alone if alone is not None else (pack(x) for x in given)
        parts = (Schedule.of(instants, x, diagonal=alone is not None) for x in (k, b))
        return cls(m[:, :1], *parts, diagonal=alone is not None)

    @property
    def parts(self) -> tuple[Schedule, Schedule]:
        """What may change: stiffness and damping."""
        return self.stiffness, self.damping

    def of_parts(self, parts: Sequence[Schedule]) -> Problem:
        """The same with another stiffness and damping."""
        stiffness, damping = parts
        return Problem(self.mass, stiffness, damping, self.diagonal)

    @property
    def time(self) -> Array:
        """Instants of the samples [s]."""
        return self.stiffness.time

    @property
    def samples(self) -> int:
        """How many of them differ: one if nothing changes."""
        return 1 if self.stiffness.constant and self.damping.constant else len(self.time)

    @property
    def axes(self) -> Samples:
        """Rows that are on the diagonal."""
        rows = np.arange(len(self.mass))
        return rows if self.diagonal else np.cumsum(rows[: size(self.mass)] + 1) - 1

    def matrices(self, rows: Array) -> Array:
        """Matrices (m, d, d) of rows (p, m)."""
        return rows.T[:, :, None] * np.eye(len(rows)) if self.diagonal else unpack(rows)

    def at(self, t: Array) -> tuple[Array, Array, Array]:
        """M, K and D at instants (m,), (m, d, d) each."""
        mass = np.repeat(self.mass, len(t), axis=1)
        rows = (mass, self.stiffness.at(t)[0], self.damping.at(t)[0])
        m, k, d = (self.matrices(x) for x in rows)
        return m, k, d

    def rising(self, k: Array, k_slope: Array, d_slope: Array) -> tuple[Array, Array]:
        """``−K̇ + α (2 K − Ḋ) ⪰ 0``, as A and B."""
        return np.broadcast_arrays(-k_slope, 2 * k - d_slope)  # pyright: ignore[reportReturnType]

    def damped(self, d: Array) -> tuple[Array, Array]:
        """``D − α M ⪰ 0``, as A and B."""
        return np.broadcast_arrays(d, -self.mass)  # pyright: ignore[reportReturnType]

    def rising_at(self, samples: Samples | slice) -> tuple[Array, Array]:
        """Of some samples."""
        k, d = self.stiffness, self.damping
        return self.rising(_of(k, k.values, samples), _of(k, k.slopes, samples), _of(d, d.slopes, samples))

    def damped_at(self, samples: Samples | slice) -> tuple[Array, Array]:
        """Of some samples."""
        return self.damped(_of(self.damping, self.damping.values, samples))

    def rising_on(self, t: Array) -> tuple[Array, Array]:
        """At instants (m,)."""
        (k, k_slope), (_, d_slope) = self.stiffness.at(t), self.damping.at(t)
        return self.rising(k, k_slope, d_slope)

    def damped_on(self, t: Array) -> tuple[Array, Array]:
        """At instants (m,)."""
        return self.damped(self.damping.at(t)[0])

    def pieces(self, alpha: float) -> Pieces:
        """Bernstein coefficients of the three inequalities."""

        def coefficients(index: Index, low: Share, high: Share) -> Iterator[Coefficient]:
            k, d = self.stiffness.cubics(index, low, high), self.damping.cubics(index, low, high)
            count = 3 if isinstance(index, slice) else 4
            for i in range(1 if self.damping.constant else count):
                yield Coefficient((d.values[i], -alpha * self.mass))
            for i in range(1 if self.samples == 1 else count):
                k_i, d_i = k.values[i], alpha * d.values[i]
                yield Coefficient((2 * alpha * k_i, -k.slopes[i], -alpha * d.slopes[i]))
                yield Coefficient((k_i, d_i, -(alpha**2) * self.mass), strict=True)

        return coefficients

    def settled(self, alpha: float) -> Callable[[slice], bool]:
        """Whether bounds alone show the three inequalities over some intervals, of axes on their own."""

        def shown(index: slice) -> bool:
            (k, k_slope), (d, d_slope) = self.stiffness.bounds(index), self.damping.bounds(index)
            damped = d - alpha * self.mass[:, 0]
            rising = 2 * alpha * k - k_slope - alpha * d_slope
            return bool(min(damped.min(), rising.min(), (k + alpha * damped).min()) > 0)

        return shown if self.diagonal else lambda _: False


def profile(given: Problem) -> dict[str, Array]:
    """The α that each instant needs (inf: none serves) and allows, for a picture."""
    t = np.linspace(given.time[0], given.time[-1], PROFILE)
    a, b = (given.matrices(x) for x in given.rising_on(t))
    size = np.sqrt(np.abs(np.diagonal(b, axis1=1, axis2=2)))
    size = np.where(size > 0, size, 1.0)
    values, vectors = np.linalg.eigh(b / (size[:, :, None] * size[:, None, :]))
    definite = values[:, 0] > ROUNDING
    half = vectors / (np.sqrt(np.where(definite[:, None], values, 1.0))[:, None, :] * size[:, :, None])
    needed = -np.linalg.eigvalsh(np.swapaxes(half, 1, 2) @ a @ half)[:, 0]
    still = ~np.any(a, axis=(1, 2))
    damping, mass = (given.matrices(x) for x in given.damped_on(t))
    return {
        "profile_time": t,
        "profile_needed": np.where(definite, needed, np.where(still, 0.0, np.inf)),
        "profile_allowed": least_ratio(damping, -mass),
    }


def needed(given: Problem) -> tuple[Edge, float]:
    """Smallest α ≥ 0 for the changing gains, over samples and around the worst of them; and when [s]."""
    edge = least(given.rising_at, given.samples, diagonal=given.diagonal)

    def look(t: Array, start: float) -> Edge:
        return least(*_rows(given.rising_on(t)), start=start, diagonal=given.diagonal)

    return _zoomed(given.time, edge, look)


def allowed(given: Problem) -> tuple[Edge, float]:
    """Largest α for the damping, at least zero, over samples and around the worst of them; and when [s]."""
    damping, axes = given.damping.values, given.axes
    ceiling = min(float(damping[i].min() / given.mass[i, 0]) for i in axes) * (1 + 1e-9)
    count = damping.shape[1]
    edge = largest(given.damped_at, count, start=ceiling, diagonal=given.diagonal)

    def look(t: Array, start: float) -> Edge:
        return largest(*_rows(given.damped_on(t)), start=start, diagonal=given.diagonal)

    edge, when = _zoomed(given.time, edge, look) if count > 1 else (edge, float(given.time[0]))
    return Edge(max(edge.value, 0.0), edge.index, edge.direction), when


def _zoomed(time: Array, edge: Edge, look: Callable[[Array, float], Edge]) -> tuple[Edge, float]:
    """Between the samples beside the deciding one, ever closer."""
    when = float(time[max(edge.index, 0)])
    if edge.index < 0 or not np.isfinite(edge.value):
        return edge, when
    low, high = time[max(edge.index - 1, 0)], time[min(edge.index + 1, len(time) - 1)]
    for _ in range(ZOOMS):
        t = np.linspace(low, high, ZOOM)
        found = look(t, edge.value)
        if found.index < 0 or not np.isfinite(found.value):
            break
        edge, when = Edge(found.value, edge.index, found.direction), float(t[found.index])
        low, high = t[max(found.index - 1, 0)], t[min(found.index + 1, ZOOM - 1)]
    return edge, when


def certified(given: Problem, alpha: float, top: float) -> tuple[Certificate | None, str]:
    """An α in the middle of [alpha, top] that serves at every instant; or None, and why not."""
    intervals = 1 if given.samples == 1 else len(given.time) - 1
    for _ in range(ATTEMPTS):
        if alpha > top:
            break
        middle = 0.5 * (alpha + top)
        left = failing(
            given.pieces(middle), intervals, diagonal=given.diagonal, settled=given.settled(middle)
        )
        if not len(left.index):
            slack = _slack(given, middle)
            if slack < 0:
                return None, f"its eigenvalues, taken one by one, are negative by {-slack:.2g}"
            return Certificate(STATEMENT, {"alpha": middle}, slack), ""
        t = left.instants(given.time)
        rising, damped = _rows(given.rising_on(t)), _rows(given.damped_on(t))
        before = (alpha, top)
        alpha = least(*rising, start=alpha, diagonal=given.diagonal).value
        if not np.isfinite(alpha):
            break
        top = largest(*rising, start=top, diagonal=given.diagonal).value
        top = largest(*damped, start=top, diagonal=given.diagonal).value
        if (alpha, top) == before:
            break
    return (
        None,
        "the inequalities could not be shown between the samples; sample more finely, or K + α D − α² M ≻ 0 fails",
    )


def _slack(given: Problem, alpha: float) -> float:
    """Of the two inequalities at other instants, by eigenvalues."""
    time = given.time
    count = 1 if given.samples == 1 else min(4 * SAMPLE, 2 * len(time))
    t = np.linspace(time[0], time[-1], count)
    pencils = (given.rising_on(t), given.damped_on(t))
    return min(relative_slack(given.matrices(a), alpha * given.matrices(b)) for a, b in pencils)


def _rows(pencil: tuple[Array, Array]) -> tuple[Pick, int]:
    """A and B that are at hand, as the pencil's functions take them."""
    a, b = pencil
    return (lambda samples: (a[:, samples], b[:, samples])), a.shape[1]


def _of(schedule: Schedule, rows: Array, samples: Samples | slice) -> Array:
    return rows if schedule.constant else rows[:, samples]
