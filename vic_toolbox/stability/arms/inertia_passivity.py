r"""Passivity with a mass that moves: ``B ⪰ ½Ṁ`` where its Coriolis forces are cancelled, any B ⪰ 0 where they stay.

The energy :math:`V = \tfrac12\dot e^T M\dot e + \tfrac12 e^T K e` of
:math:`M(t)\ddot e + (C + B)\dot e + K e = -F_{ext}` changes by

.. math:: \dot V = -\dot e^T\bigl(B + C - \tfrac12\dot M\bigr)\dot e - \dot e^T F_{ext} .

Without C, positive K and B alone prove nothing. A C with a skew-symmetric :math:`\dot M - 2C` takes Ṁ out of it.

References
----------
C. Ott, "Cartesian Impedance Control of Redundant and Flexible-Joint Robots", Springer, 2008, chapter 3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.linalg import eigh, expm

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.stability.arguments import matrices, positive_matrices, sample_times
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict

EDGE = 1e-9
"""Margin that is too small for a verdict."""
MISMATCH = 0.1
"""Largest departure of the mass from the integral of its rate, relative to its own change over the samples."""
STARTS = 6
"""Instants from which the worst motion is looked for."""
RADIANS = 0.2
"""Length of a step of that search, in radians of the fastest frequency."""


def inertia_passivity(
    mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    time: ArrayLike,
    mass_rate: ArrayLike,
    coriolis: ArrayLike | None = None,
) -> Verdict:
    """Does ``M(t) ë + (C + B) ė + K e = 0`` lose energy at every instant: ``B + C ⪰ ½Ṁ``?

    Parameters
    ----------
    mass, mass_rate : array_like, shape (n,) or (n, d, d)
        M and Ṁ at the samples.
    stiffness : array_like
        Constant K: a number, or (d, d).
    damping : array_like
        B: a number, (n,), (d, d) or (n, d, d).
    time : array_like, shape (n,)
        Instants [s].
    coriolis : array_like, shape (n, d, d), optional
        C that the law leaves in the loop.

    Returns
    -------
    Verdict
        Its margin is the share of the damping that the moving inertia leaves: ``1 − λmax(½Ṁ − C, B)``, without a
        unit. `values`: ``share`` (n,), that λmax at every sample (at ``share_time``); ``damping_factor``, by which B
        must be multiplied to be enough; ``energy_gain``, the largest factor by which energy can grow from one instant
        to another, over all motions from the worst few instants.

    Raises
    ------
    InputError
        Wrong shapes, matrices that are not symmetric (positive definite), or a rate that is not that of the mass.
    """
    instants = sample_times(time)
    m = positive_matrices("mass", mass)
    rate = matrices("mass_rate", mass_rate)
    if m.ndim != 3 or m.shape != rate.shape or len(m) != len(instants):
        raise InputError(
            f"time has {len(instants)} samples, mass has shape {np.shape(mass)} and mass_rate "
            f"{np.shape(mass_rate)}; pass as many of each."
        )
    d = m.shape[-1]
    kept = None if coriolis is None else finite_array("coriolis", coriolis, shape=(len(m), d, d))
    k, b = constant_gains(stiffness, damping, len(m), d)
    steps = np.diff(instants)[:, None, None]
    change = np.diff(m, axis=0)
    error = np.abs(change - 0.5 * steps * (rate[1:] + rate[:-1])).sum(axis=0).max()
    if error > MISMATCH * max(np.abs(change).sum(axis=0).max(), EDGE * np.abs(m).max()):
        raise InputError(
            "mass_rate is not the rate of mass: its integral departs from the mass by "
            f"{error:.3g}; check the units of time, or pass more samples."
        )
    # checked again with the slope of a spline through the masses, also between the samples
    spline = CubicSpline(instants, m)
    fine = np.linspace(instants[0], instants[-1], 4 * len(instants))
    driving = 0.5 * spline(fine, 1)
    if kept is not None:
        driving = driving - symmetric_part(interpolated(instants, kept, fine))
    checked = float(driving_share(driving, interpolated(instants, b, fine)).max())
    loop = MovingMass(instants, m, rate, k, b, kept)
    return passivity_verdict(instants, loop, checked=checked, name="M(t)", values={}, singular=False)


class MovingMass:
    """``M(t) ë + (C + B) ė + K e = 0`` between samples: M by a cubic through values and rates, B and C linearly."""

    def __init__(
        self, time: Array, mass: Array, rate: Array, stiffness: Array, damping: Array, kept: Array | None
    ) -> None:
        self.time, self.mass, self.rate, self.stiffness, self.damping = time, mass, rate, stiffness, damping
        self.kept = np.zeros_like(mass) if kept is None else kept
        self._mass = CubicHermiteSpline(time, mass, rate)
        self.size = mass.shape[-1]

    @property
    def driving(self) -> Array:
        """``½Ṁ − C``, symmetric part (n, d, d): what works against the damping."""
        return 0.5 * self.rate - symmetric_part(self.kept)

    def energy(self, time: Array, state: Array) -> Array:
        """V (n,) [J]."""
        e, rate = np.split(state, 2, axis=-1)
        mass = self._mass(time)
        return 0.5 * (np.vecdot(rate, np.matvec(mass, rate)) + np.vecdot(e, np.matvec(self.stiffness, e)))

    def systems(self, times: Array) -> Array:
        """A(t) (n, 2 d, 2 d)."""
        d = self.size
        a = np.zeros((len(times), 2 * d, 2 * d))
        a[:, :d, d:] = np.eye(d)
        both = interpolated(self.time, self.damping + self.kept, times)
        spring = np.broadcast_to(self.stiffness, both.shape)
        a[:, d:] = -np.linalg.solve(self._mass(times), np.concatenate([spring, both], axis=-1))
        return a

    def worst(self, first: int) -> tuple[float, int, Array]:
        """Largest energy gain from a sample on, the sample at which it is reached, and the start that has it."""
        d, times = self.size, self.time
        frequency = np.sqrt(
            np.linalg.norm(
                np.linalg.solve(self.mass, np.broadcast_to(self.stiffness, self.mass.shape)), 2, (1, 2)
            ).max()
        )
        pieces = max(1, int(np.ceil(frequency * np.diff(times).max() / RADIANS)))
        stored = np.zeros((len(times), 2 * d, 2 * d))
        stored[:, :d, :d], stored[:, d:, d:] = self.stiffness, self.mass
        edges = np.concatenate(
            [
                np.linspace(a, b, pieces, endpoint=False)
                for a, b in zip(times[first:-1], times[first + 1 :], strict=True)
            ]
            + [times[-1:]]
        )
        middle = 0.5 * (edges[1:] + edges[:-1])
        moved = expm(self.systems(middle) * np.diff(edges)[:, None, None])
        flow, best = np.eye(2 * d), (1.0, first, np.zeros(2 * d))
        for i, factor in enumerate(moved, start=1):
            flow = factor @ flow
            if i % pieces:
                continue
            k = first + i // pieces
            values, vectors = eigh(flow.T @ stored[k] @ flow, stored[first])
            if values[-1] > best[0]:
                best = (float(values[-1]), k, vectors[:, -1])
        return best

    def motion(self, start: Array, first: int, last: int, *, method: str, grid: Array) -> Array:
        """The motion from a start at one sample to another, on a grid of instants, (len(grid), 2 d)."""
        found = solve_ivp(
            lambda t, x: self.systems(np.array([t]))[0] @ x,
            (self.time[first], self.time[last]),
            start,
            method=method,
            t_eval=grid,
            rtol=1e-9,
            atol=1e-12 * np.abs(start).max(),
            max_step=float(np.diff(self.time).max()),
        )
        return found.y.T


def passivity_verdict(
    time: Array, loop: MovingMass, *, checked: float, name: str, values: dict[str, Any], singular: bool
) -> Verdict:
    """Judge a moving mass; `checked` is the worst share of the damping by another route, also between the samples."""
    share = driving_share(loop.driving, loop.damping)
    worst = float(share.max())
    kept = " + C ė" if loop.kept.any() else ""
    parts: dict[str, Any] = {
        "question": f"does {name} ë{kept} + B ė + K e = 0 lose energy at every instant of the motion?",
        "method": "B ⪰ ½Ṁ" + (" − C" if kept else "") + " at the samples (Ott, chapter 3)",
        "margin": 1.0 - worst,
        "margin_unit": "of the damping is left by the moving inertia",
        "assumptions": (
            "K is constant",
            "between two samples the motion is smooth",
            "free motion: what the environment does is its own energy",
        ),
    }
    numbers = {"share": share, "share_time": time, "damping_factor": worst, **values}
    if singular:
        reason = "the motion comes so close to a singularity that M(x) is bounded by hand there."
        return Verdict(status="inconclusive", values=numbers, reason=reason, **parts)
    if worst <= 1.0 - EDGE:
        certificate = Certificate(
            "B − ½Ṁ + C ⪰ 0" if kept else "B − ½Ṁ ⪰ 0", {"damping_factor": worst}, slack=1.0 - checked
        )
        numbers["energy_gain"] = 1.0
        if checked <= 1.0:
            return Verdict(status="proved", values=numbers, witness=certificate, **parts)
        reason = f"between the samples the damping would have to be {checked:.6g} times as large; pass more samples."
        return Verdict(status="inconclusive", values=numbers, witness=certificate, reason=reason, **parts)
    example, gain = _example(loop, share)
    numbers["energy_gain"] = gain
    if example is None:
        reason = "B ⪰ ½Ṁ fails, but no motion gains energy from one sample to another."
        return Verdict(status="inconclusive", values=numbers, reason=reason, **parts)
    return Verdict(status="disproved", values=numbers, witness=example, **parts)


def _example(loop: MovingMass, share: Array) -> tuple[CounterExample | None, float]:
    """The motion that gains most energy, from the instants where the inertia drives it most."""
    over = share > 1.0
    begins = np.nonzero(over & ~np.concatenate([[False], over[:-1]]))[0]
    begins = begins[np.argsort(-share[begins])][:STARTS]
    candidates = sorted({*begins.tolist(), int(share.argmax())})
    found = [(*loop.worst(first), first) for first in candidates if first < len(loop.time) - 1]
    if not found:
        return None, 1.0
    gain, last, start, first = max(found, key=lambda entry: entry[0])
    if gain <= 1.0 + EDGE:
        return None, gain
    grid = np.linspace(loop.time[first], loop.time[last], 401)
    grid[[0, -1]] = loop.time[first], loop.time[last]
    state = loop.motion(start, first, last, method="DOP853", grid=grid)
    energy = loop.energy(grid, state)

    def again(begin: Array) -> tuple[Array, Array]:
        return grid, loop.motion(np.asarray(begin, dtype=np.float64), first, last, method="LSODA", grid=grid)

    other = loop.energy(*again(start))
    if energy[-1] <= energy[0] * (1 + EDGE) or other[-1] <= other[0] * (1 + EDGE):
        return None, gain
    grown = energy[-1] / energy[0]
    text = f"the moving inertia multiplies the energy by {grown:.4g} from {grid[0]:.4g} s to {grid[-1]:.4g} s"
    gains = {
        "stiffness": np.broadcast_to(loop.stiffness, (len(grid), loop.size, loop.size)),
        "damping": interpolated(loop.time, loop.damping, grid),
    }
    return CounterExample(text, grid, state, energy, gains, {}, again), gain


def constant_gains(stiffness: ArrayLike, damping: ArrayLike, n: int, d: int) -> tuple[Array, Array]:
    """K (d, d) and B (n, d, d), checked."""
    k, b = positive_matrices("stiffness", stiffness), positive_matrices("damping", damping)
    if k.shape != (d, d):
        raise InputError(
            f"stiffness has shape {np.shape(stiffness)}; pass one constant ({d}, {d}) matrix. For gains that change, "
            "use kronander_billard."
        )
    if b.shape not in ((d, d), (n, d, d)):
        raise InputError(f"damping has shape {np.shape(damping)}; pass ({d}, {d}) or ({n}, {d}, {d}).")
    return k, np.broadcast_to(b, (n, d, d))


def driving_share(driving: Array, damping: Array) -> Array:
    """Largest generalised eigenvalue λ of ``driving x = λ damping x`` (n,)."""
    root = np.linalg.inv(np.linalg.cholesky(damping))
    return np.asarray(
        np.linalg.eigvalsh(symmetric_part(root @ driving @ np.swapaxes(root, 1, 2)))[:, -1], dtype=np.float64
    )


def symmetric_part(values: Array) -> Array:
    """``(X + Xᵀ)/2`` of matrices (n, d, d)."""
    return 0.5 * (values + np.swapaxes(values, 1, 2))


def interpolated(time: Array, values: Array, instants: Array) -> Array:
    """Values (n, ...) at other instants, linearly."""
    left = np.clip(np.searchsorted(time, instants, side="right") - 1, 0, len(time) - 2)
    weight = (instants - time[left]) / (time[left + 1] - time[left])
    weight = weight.reshape(-1, *[1] * (values.ndim - 1))
    return (1 - weight) * values[left] + weight * values[left + 1]
