"""What can be analysed: gains over time, a range of gains, a policy, or constant gains."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.gains import AXES, CholeskyStiffness, DampingFactor, ImpedanceGains, Parametrisation
from vic_toolbox.stability.arguments import matrices, sample_times

MOST = 20_000
"""Corners of a range of axes that act on each other."""
EXTREMES = 24
"""Extreme gains of a parametrisation whose range is no polytope."""


class Course(NamedTuple):
    """Gains over time; NaN where they are not determined."""

    time: Array
    stiffness: Array
    damping: Array
    error: Array | None = None
    error_rate: Array | None = None


class GainRange(NamedTuple):
    """Gains that may occur in any order.

    `members` can all occur; everything that can occur lies in the hull of `cover`, or, where it is None, is not known
    to lie in any. With `apart` every axis varies on its own, and the gains have all its extremes among them; that is
    enough where nothing couples the axes, and else :meth:`spread` makes every combination.
    """

    members: tuple[Array, Array]
    cover: tuple[Array, Array] | None
    named: str
    apart: bool = False

    def spread(self) -> GainRange:
        """The same range for axes that act on each other."""
        if not self.apart or self.cover is None:
            return self
        cover = _combined(*self.cover)
        members = cover if self.cover is self.members else self.members
        return self._replace(members=members, cover=cover, apart=False)


class Constant(NamedTuple):
    """One pair of gains."""

    stiffness: Array
    damping: Array


class Policy(NamedTuple):
    """Gains as a function of the state."""

    call: Any


Subject = Course | GainRange | Constant | Policy


def read_subject(subject: Any, time: ArrayLike | None) -> Subject:
    """What a subject is.

    Raises
    ------
    InputError
        It is none of those, or its parts do not fit.
    """
    if isinstance(subject, Parametrisation):
        return of_parametrisation(subject)
    if isinstance(subject, ImpedanceGains):
        return _of_matrices(subject.stiffness.reshape(-1, 6, 6), subject.damping.reshape(-1, 6, 6), time)
    if all(hasattr(subject, name) for name in ("time", "stiffness", "damping")):
        if np.size(subject.time) == 1:  # constant gains, NaN where they are not determined
            return Constant(*(_square(n, getattr(subject, n), 1)[0] for n in ("stiffness", "damping")))
        rate = getattr(subject, "error_rate", getattr(subject, "rate", None))
        return course(
            subject.time,
            subject.stiffness,
            subject.damping,
            error=getattr(subject, "error", None),
            error_rate=rate,
        )
    if isinstance(subject, tuple) and len(subject) == 2:
        return _of_pair(subject, time)
    if callable(subject) or hasattr(subject, "gains") or hasattr(subject, "mean"):
        return Policy(subject)
    raise InputError(
        f"a {type(subject).__name__} cannot be analysed; pass something with time, stiffness and damping (a fit, a "
        "rollout), a parametrisation, a pair of ranges ((k_low, k_high), (b_low, b_high)), a pair (K, B), gains, or a "
        "policy that can be called."
    )


def course(
    time: ArrayLike, stiffness: ArrayLike, damping: ArrayLike, *, error: Any = None, error_rate: Any = None
) -> Course:
    """Gains over time as matrices; diagonals (n, d) become matrices, and what is written once is repeated.

    Raises
    ------
    InputError
        Shapes or lengths that do not fit; instants that do not increase; a matrix that is not symmetric.
    """
    instants = sample_times(time)
    n = len(instants)
    gains = [_square(name, value, n) for name, value in (("stiffness", stiffness), ("damping", damping))]
    d = max(len(gain[0]) for gain in gains)
    if any(len(gain[0]) != d for gain in gains):
        raise InputError(
            f"stiffness has {len(gains[0][0])} axes and damping {len(gains[1][0])}; pass as many of each."
        )
    motion = [_motion(name, value, n, d) for name, value in (("error", error), ("error_rate", error_rate))]
    return Course(instants, gains[0], gains[1], *motion)


def _motion(name: str, value: Any, n: int, d: int) -> Array | None:
    if value is None:
        return None
    array = finite_array(name, value)
    array = array[:, None] if array.ndim == 1 else array
    if array.shape != (n, d):
        raise InputError(
            f"{name} has shape {array.shape}; pass ({n}, {d}), as many samples and axes as the gains."
        )
    return array


def _square(name: str, value: ArrayLike, n: int) -> Array:
    """(n, d, d) from (n,), (n, d), (n, d, d), or from something constant; NaN stays."""
    array = np.asarray(value, dtype=np.float64)
    if array.ndim == 0:
        array = np.full((n, 1, 1), array)
    elif array.ndim == 1:
        array = array[:, None, None]
    elif array.ndim == 2 and len(array) == n:
        array = array[:, :, None] * np.eye(array.shape[1])
    elif array.ndim == 2:
        array = np.broadcast_to(array, (n, *array.shape)).copy()
    if array.ndim != 3 or len(array) != n or array.shape[1] != array.shape[2] or np.isinf(array).any():
        raise InputError(
            f"{name} has shape {np.shape(value)} (or is infinite) and there are {n} instants; pass (n,), diagonals "
            "(n, d) or matrices (n, d, d)."
        )
    return array


def _of_matrices(stiffness: Array, damping: Array, time: ArrayLike | None) -> Subject:
    if time is not None and len(stiffness) > 1:
        return course(time, stiffness, damping)
    if len(stiffness) == 1:
        return Constant(stiffness[0], damping[0])
    return GainRange((stiffness, damping), (stiffness, damping), f"the hull of {len(stiffness)} gains")


def _of_pair(subject: tuple[Any, Any], time: ArrayLike | None) -> Subject:
    if all(isinstance(part, tuple) and len(part) == 2 for part in subject):
        boxes = _box(*subject)
        return GainRange(boxes, boxes, "every gain within the range", apart=True)
    parts = []
    for name, value in zip(("stiffness", "damping"), subject, strict=True):
        array = finite_array(name, value)
        if array.ndim == 1 and time is None:
            array = np.diag(array)
        parts.append(array)
    if time is not None:
        return course(time, *parts)
    k, b = (matrices(name, value) for name, value in zip(("stiffness", "damping"), parts, strict=True))
    if k.shape[-1] != b.shape[-1]:
        raise InputError(f"stiffness has {k.shape[-1]} axes and damping {b.shape[-1]}; pass as many of each.")
    if k.ndim == b.ndim == 2:
        return Constant(k, b)
    count = max(len(a) if a.ndim == 3 else 1 for a in (k, b))
    if any(a.ndim == 3 and len(a) != count for a in (k, b)):
        raise InputError(f"stiffness holds {len(k)} matrices and damping {len(b)}; pass as many of each.")
    k, b = (np.broadcast_to(a, (count, *a.shape[-2:])) for a in (k, b))
    return _of_matrices(k, b, None)


def _box(stiffness: tuple[Any, Any], damping: tuple[Any, Any]) -> tuple[Array, Array]:
    """Four gains that have every corner (k, b) of every axis among them: enough, as axes do not act on each other."""
    ends = []
    for name, (low, high) in (("stiffness", stiffness), ("damping", damping)):
        first, last = (np.atleast_1d(finite_array(f"{name} range", end)) for end in (low, high))
        if first.shape != last.shape or first.ndim != 1 or (first > last).any():
            raise InputError(
                f"the {name} goes from {low} to {high}; pass (lowest, highest) numbers or diagonals, of one length."
            )
        ends.append((first, last))
    d = max(len(end[0]) for end in ends)
    (k_low, k_high), (b_low, b_high) = ([np.broadcast_to(end, (d,)) for end in pair] for pair in ends)
    return _diagonal([k_low, k_low, k_high, k_high]), _diagonal([b_low, b_high, b_low, b_high])


def _diagonal(rows: Sequence[Array]) -> Array:
    array = np.stack(rows)
    return array[:, :, None] * np.eye(array.shape[1])


def _combined(stiffness: Array, damping: Array) -> tuple[Array, Array]:
    """Every combination of the (k, b) that the axes have, (n, d, d) each.

    Raises
    ------
    InputError
        Too many.
    """
    k, b = (np.diagonal(a, axis1=1, axis2=2) for a in (stiffness, damping))
    pairs = []
    for i in range(k.shape[1]):
        some = np.unique(np.column_stack([k[:, i], b[:, i]]), axis=0)
        pairs.append(some[[0, -1]] if np.ptp(some[:, 1]) == 0 and len(some) > 1 else some)
    count = int(np.prod([len(some) for some in pairs]))
    if count > MOST:
        raise InputError(f"the range has {count} corners with axes that act on each other; judge fewer axes.")
    index = np.stack(np.meshgrid(*(np.arange(len(some)) for some in pairs), indexing="ij"), axis=-1)
    rows = np.stack([pairs[i][part] for i, part in enumerate(index.reshape(-1, len(pairs)).T)], axis=1)
    return _diagonal(list(rows[:, :, 0])), _diagonal(list(rows[:, :, 1]))


def of_parametrisation(form: Parametrisation) -> GainRange:
    """The gains that a parametrisation can write."""
    named = f"every gain of this {type(form).__name__}"
    if isinstance(form, CholeskyStiffness):
        return _of_cholesky(form, named)
    low, high = form.parameters_to_gains(form.minimum), form.parameters_to_gains(form.maximum)
    ends = [(g.stiffness_diagonal, g.damping_diagonal) for g in (low, high)]
    if not isinstance(form, DampingFactor):
        boxes = _box((ends[0][0], ends[1][0]), (ends[0][1], ends[1][1]))
        return GainRange(boxes, boxes, named, apart=True)
    return _of_factor(form, named)


def _of_factor(form: DampingFactor, named: str) -> GainRange:
    """B = d √k: corners that occur, and of each axis one more that closes their hull over the curve of the largest d.

    The tangents of ``d √k`` at both ends meet at ``k = √(k₁ k₂)``; the chord of the smallest d lies below its curve.
    """
    low, high = np.array(form.stiffness_low), np.array(form.stiffness_high)
    ends = np.array(list(itertools.product((0, 1), repeat=6)))
    rows = [
        np.append(np.where(end, high, low), d) for end in ends for d in (form.factor_low, form.factor_high)
    ]
    gains = form.parameters_to_gains(np.stack(rows))
    members = np.array(gains.stiffness), np.array(gains.damping)
    middle = np.sqrt(low * high)
    beyond = form.factor_high * (middle + low) / (2 * np.sqrt(low))
    if form.rotational_damping is not None:
        beyond[3:] = form.rotational_damping
    paired = [0, 1, -2, -1]  # all axes at their lowest, and all at their highest, with both d
    cover = (
        np.concatenate([members[0][paired], np.diag(middle)[None]]),
        np.concatenate([members[1][paired], np.diag(beyond)[None]]),
    )
    return GainRange(members, cover, named, apart=True)


def _of_cholesky(form: CholeskyStiffness, named: str) -> GainRange:
    """Extreme gains: every axis at an end, with couplings at theirs; no polytope holds exactly these."""
    generator = np.random.default_rng(0)
    ends = np.stack([form.minimum, form.maximum])
    rows = [ends[0].copy(), ends[1].copy()]
    for row in rows:
        row[6:] = 0.0
    for _ in range(EXTREMES - 2):
        rows.append(ends[generator.integers(0, 2, form.size), np.arange(form.size)])
    gains = form.parameters_to_gains(np.stack(rows))
    return GainRange((np.array(gains.stiffness), np.array(gains.damping)), None, named)


def axis_names(size: int) -> tuple[str, ...]:
    """Names of d axes."""
    if size in (3, 6):
        return AXES[:size]
    return ("axis",) if size == 1 else tuple(f"axis {i + 1}" for i in range(size))
