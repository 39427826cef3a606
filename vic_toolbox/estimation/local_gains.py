"""What the samples around an instant say on their own: the unregularised information behind the gate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation.observability import gain_scales, typical
from vic_toolbox.estimation.samples import Samples, root_mean_square, weights
from vic_toolbox.estimation.windows_full import FullUnits, least_norm, matrices

MODEL_ERROR = 0.005
"""Share of the wrench that gains which bend within the resolution may leave: counted as noise, since over smooth
motion it imitates damping however good the sensor is."""


class Local(NamedTuple):
    """What the samples around each instant say on their own.

    Parameters
    ----------
    stiffness, damping : ndarray, shape (m, 6) or (m, 6, 6)
    stiffness_sd, damping_sd : ndarray, shaped alike
        Infinite where floating point does not determine them.
    condition : ndarray, shape (m, 6)
    """

    stiffness: Array
    damping: Array
    stiffness_sd: Array
    damping_sd: Array
    condition: Array

    def scales(self, parts: Sequence[Samples]) -> tuple[Array, Array]:
        """Scale of K and of B for each axis."""
        full = self.stiffness.ndim == 3
        k, b, k_sd, b_sd = (np.diagonal(x, axis1=1, axis2=2) if full else x for x in self[:4])
        return gain_scales(parts, typical(k, k_sd), typical(b, b_sd))


def local_gains(parts: Sequence[Samples], times: Array, half: float | None, noise: Array) -> Local:
    """Fit k, its rate of change and b of every axis to the samples around each instant.

    Why the rate of change: with a stiffness that drifts at the asked resolution, e and ė that are smooth look
    alike. Over a reaching motion ``k̇ τ e`` imitates ``b ė``, and a window that takes k for constant finds a
    damping that is precise and wrong by ``k̇ e² / (e ë − ė²)``, even without noise.

    Parameters
    ----------
    parts : sequence of Samples
    times : ndarray, shape (m,)
    half : float or None
        Half the width of the neighbourhood [s]; None: the whole recordings, and gains that do not change.
    noise : ndarray, shape (6,)
    """
    free = 2 if half is None else 3
    information, right = np.zeros((len(times), 6, free, free)), np.zeros((len(times), 6, free))
    for p in parts:
        e, v, f = p.error, p.rate, p.wrench
        if half is None:
            a, s, c, ef, vf = (np.sum(x, axis=0) for x in (e * e, e * v, v * v, e * f, v * f))
            information += np.stack([a, s, s, c], axis=-1).reshape(6, 2, 2)
            right += np.stack([ef, vf], axis=-1)
            continue
        clock = (p.time - p.time[0])[:, None]
        centre = (times - p.time[0])[:, None]
        te = clock * e
        a, s, c, ta, ts, tta, ef, vf, tef = window_sums_at(
            p.time,
            times,
            half,
            np.stack([e * e, e * v, v * v, te * e, te * v, te * te, e * f, v * f, te * f]),
        )
        # the moments about the instant from those about the start
        tta = np.maximum(tta - 2 * centre * ta + centre**2 * a, 0.0) / half**2
        ta, ts, tef = ((x - centre * y) / half for x, y in ((ta, a), (ts, s), (tef, ef)))
        information += np.stack([a, s, ta, s, c, ts, ta, ts, tta], axis=-1).reshape(-1, 6, 3, 3)
        right += np.stack([ef, vf, tef], axis=-1)
    gains, variance, _, condition = least_norm(information, right)
    if half is not None:
        size = root_mean_square(np.concatenate([p.wrench for p in parts]))
        noise = np.hypot(noise, MODEL_ERROR * size)
    with np.errstate(invalid="ignore"):
        sd = np.sqrt(variance) * noise[:, None]
    sd = np.where(np.isnan(sd), np.inf, sd)  # infinite variance, no noise
    return Local(gains[..., 0], gains[..., 1], sd[..., 0], sd[..., 1], condition)


def window_sums_at(time: Array, times: Array, half: float, x: Array) -> Array:
    """Sums of x (..., n, 6) over the samples within `half` of each instant, (..., m, 6)."""
    low, high = np.searchsorted(time, times - half), np.searchsorted(time, times + half, side="right")
    padded = np.concatenate([x, np.zeros((*x.shape[:-2], 1, x.shape[-1]))], axis=-2)
    sums = np.add.reduceat(padded, np.stack([low, high], axis=1).ravel(), axis=-2)[..., ::2, :]
    return np.where((high > low)[:, None], sums, 0.0)


def local_full_gains(parts: Sequence[Samples], times: Array, half: float | None, noise: Array) -> Local:
    """The same for full matrices, which are taken as constant around each instant."""
    units = FullUnits.of(list(parts))
    weight = weights(list(parts), noise)
    h, g = np.zeros((len(times), 12, 12)), np.zeros((len(times), 12, 6))
    for p in parts:
        x = np.concatenate([p.error, p.rate], axis=1)
        low = np.searchsorted(p.time, times - half) if half is not None else np.zeros(len(times), int)
        high = np.searchsorted(p.time, times + half) if half is not None else np.full(len(times), len(p))
        for m in range(len(times)):
            rows = slice(low[m], high[m])
            h[m] += x[rows].T @ x[rows]
            g[m] += x[rows].T @ p.wrench[rows]
    found = []
    for start in range(0, len(times), 256):
        rows = slice(start, start + 256)
        theta, variance, _, condition = least_norm(*units.normal_equations(h[rows], g[rows], weight))
        with np.errstate(invalid="ignore"):
            sd = np.sqrt(variance) * units.entries * float(np.max(noise / weight))
        sd = np.where(np.isnan(sd), np.inf, sd)
        found.append(
            (*matrices(theta * units.entries), *matrices(sd), np.repeat(condition[:, None], 6, axis=1))
        )
    return Local(*(np.concatenate(part) for part in zip(*found, strict=True)))
