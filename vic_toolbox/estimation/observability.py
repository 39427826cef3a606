"""The gate: which gains the data determine, before anything is smoothed.

A gain is *observable* at a time when three things hold.

1. **Information.** Its standard deviation from the data alone, without smoothness penalty or constraint and at
   the asked resolution (a window, or one knot interval to either side), is below :data:`TOLERANCE` times its
   scale: it can be told from zero. The scale is what unregularised fits find for the axis as a whole, or a
   twentieth of the gain that would explain the axis' whole wrench, whichever is larger (so a gain that is known to
   be small is not refused).
2. **Rank.** It follows from the data in floating point, even where there is no noise.
3. **Evidence.** Over the recording, constant gains explain more of the axis' wrench than a constant wrench does, and
   more than they would of noise (where a bias is fitted: :data:`BIASED_EVIDENCE` of its variance). If not, what looks
   like stiffness may as well be the sensor's bias or its noise: a robot in free motion, a held push.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.estimation.samples import Samples, root_mean_square
from vic_toolbox.gains import AXES

TOLERANCE = 0.5
"""Largest standard deviation of an observable gain, relative to its scale."""
SMALL_SHARE = 0.05
"""Share of an axis' wrench below which a gain counts as small rather than unknown."""
BIASED_EVIDENCE = 0.35
"""Least share of the wrench about its mean that constant gains have to explain where a bias is fitted as well: a
sensor that drifts a little correlates with the motion a little."""
CHANCE = 12.0
"""By how many variances of the noise two gains explain more than a constant, before it is no chance (one in 400)."""


def gain_scales(parts: Sequence[Samples], stiffness: Array, damping: Array) -> tuple[Array, Array]:
    """Scale of K and of B for each axis, (6,) and (6,).

    Parameters
    ----------
    parts : sequence of Samples
    stiffness, damping : ndarray, shape (6,)
        What unregularised fits find for the axis as a whole; NaN where they find nothing.
    """
    e, v, w = (
        root_mean_square(np.concatenate([getattr(p, name) for p in parts]))
        for name in ("error", "rate", "wrench")
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        small = [SMALL_SHARE * np.nan_to_num(w / x, posinf=0.0) for x in (e, v)]
    return (
        np.maximum(np.nan_to_num(np.abs(stiffness)), small[0]),
        np.maximum(np.nan_to_num(np.abs(damping)), small[1]),
    )


def typical(values: Array, deviations: Array) -> Array:
    """Size of gains (m, 6) found at m times, (6,): their mean, the sure ones weighing more; zero if it is negative.

    A negative gain is no measure of how well a positive one is known: it says that something else is in the wrench.
    """
    known = np.isfinite(values) & np.isfinite(deviations)
    surest = np.min(np.where(known, deviations, np.inf), axis=0)
    known &= deviations <= 1e150 * surest
    divisor = np.where(known & (deviations > 0), deviations, 1.0)
    share = np.where(known & (deviations > 0), np.where(known, surest, 0.0) / divisor, known)
    total = np.sum(share**2, axis=0)
    return np.maximum(np.sum(share**2 * np.where(known, values, 0.0), axis=0), 0.0) / np.where(
        total > 0, total, 1.0
    )


class Constants(NamedTuple):
    """What constant gains without constraints make of whole recordings, (6,) each.

    Parameters
    ----------
    stiffness, damping : ndarray
        Diagonal of K and B; NaN where nothing moves.
    evident : ndarray of bool
        Whether they explain enough of each axis' wrench about its mean for a gain to be read from it.
    """

    stiffness: Array
    damping: Array
    evident: NDArray[np.bool_]


def constant_gains(parts: Sequence[Samples], *, bias: bool = False, coupled: bool = False) -> Constants:
    """Least squares over whole recordings, each wrench axis against its own motion, or against all of it.

    Parameters
    ----------
    parts : sequence of Samples
    bias : bool, optional
        Whether each recording may have an unknown constant wrench besides.
    coupled : bool, optional
        Whether the gains are full matrices.
    """
    columns = (np.concatenate([p.error, p.rate, p.wrench], axis=1) for p in parts)
    e, v, w = np.split(np.concatenate([x - x.mean(axis=0) if bias else x for x in columns]), 3, axis=1)
    gains, residuals = np.full((2, 6), np.nan), w.copy()
    motion = np.concatenate([e, v], axis=1)
    moving = np.any(motion, axis=0)
    for i in range(6):
        used = moving & (coupled | np.isin(np.arange(12), (i, i + 6)))
        if used.any():
            columns = motion[:, used]
            size = np.linalg.norm(columns, axis=0)
            found = np.full(12, np.nan)
            found[used] = np.linalg.lstsq(columns / size, w[:, i], rcond=1e-10)[0] / size
            gains[:, i] = found[[i, i + 6]]
            residuals[:, i] -= columns @ found[used]
    least = max(CHANCE / (CHANCE + len(w)), BIASED_EVIDENCE if bias else 0.0)
    return Constants(gains[0], gains[1], explained(parts, residuals) > least)


def explained(parts: Sequence[Samples], residuals: Array) -> Array:
    """Share of each axis' wrench that a fit explains beyond a constant: centred r², (6,).

    Zero or less where a constant (the sensor's bias) explains it as well; −inf where the wrench never changes.
    """
    about_mean = sum(np.sum((p.wrench - p.wrench.mean(axis=0)) ** 2, axis=0) for p in parts)
    wrench = np.concatenate([p.wrench for p in parts])
    left = np.sum(np.where(np.isfinite(residuals), residuals, wrench) ** 2, axis=0)
    smallest = 1e-24 * sum(np.sum(p.wrench**2, axis=0) for p in parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(about_mean > smallest, 1.0 - left / about_mean, -np.inf)


def correlation_inflation(residuals: Array, longest: int) -> Array:
    """How much less than n white samples n samples with these residuals are worth, (6,), at least one.

    ``1 + 2 Σ (1 − k/L) ρ_k`` with the autocorrelation ρ of the residuals up to lag L (Newey and West 1987):
    what multiplies the variance of an average over L samples and more.

    Parameters
    ----------
    residuals : ndarray, shape (n, 6)
    longest : int
        L, in samples.
    """
    n = len(residuals)
    longest = int(np.clip(longest, 1, max(n // 4, 1)))
    r = np.nan_to_num(residuals)
    r = r - r.mean(axis=0)
    size = 1 << int(np.ceil(np.log2(n + longest)))
    spectrum = np.abs(np.fft.rfft(r, size, axis=0)) ** 2
    covariance = np.fft.irfft(spectrum, size, axis=0)[:longest]
    power = np.where(covariance[0] > 0, covariance[0], 1.0)
    weights = (1 - np.arange(1, longest) / longest)[:, None]
    return np.maximum(1 + 2 * np.sum(weights * covariance[1:] / power, axis=0), 1.0)


def determined(sd: Array, scale: Array) -> NDArray[np.bool_]:
    """Axes (m, 6) whose standard deviations, (m, 6) or (m, 6, 6), are below the tolerance times their scale (6,)."""
    limit = TOLERANCE * scale
    if sd.ndim == 2:
        return sd < limit
    own = np.diagonal(sd, axis1=1, axis2=2) < limit
    # a coupling between two such axes has to be known as well, or neither is
    pairs = ~(sd < np.sqrt(limit[:, None] * limit)) & own[:, :, None] & own[:, None, :]
    return own & ~pairs.any(axis=2)


def remedies(
    stiffness: NDArray[np.bool_],
    damping: NDArray[np.bool_],
    evident: NDArray[np.bool_],
) -> tuple[str, ...]:
    """Sentences for a report: which axes are not determined, and what to do about it.

    Parameters
    ----------
    stiffness, damping : ndarray of bool, shape (m, 6)
        Where K and B are observable.
    evident : ndarray of bool, shape (6,)
        Of :class:`Constants`.
    """
    found = []
    without = [name for name, enough in zip(AXES, evident, strict=True) if not enough]
    if without:
        found.append(
            f"{', '.join(without)}: a constant explains the wrench as well as the motion does, so no gain can be "
            "read from it. Was there contact? Is the wrench in the frame of the pose, its bias removed?"
        )
    for name, seen in (("stiffness", stiffness), ("damping", damping)):
        part = [
            f"{axis} ({100 * share:.0f} %)"
            for axis, share, enough in zip(AXES, seen.mean(axis=0), evident, strict=True)
            if share < 1 and enough
        ]
        if part:
            found.append(
                f"{name} is determined only for part of the time: {', '.join(part)}. Move more (several "
                "frequencies, a centimetre or more), ask for a coarser resolution, or pool demonstrations."
            )
    return tuple(found)
