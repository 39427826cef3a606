"""Z-width: the stiffness and damping that a computer can render, as a map over (K, B)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, integer, one_of, positive
from vic_toolbox.stability.sampling.sampled import VELOCITIES
from vic_toolbox.stability.sampling.sampled_characteristic import (
    Characteristic,
    characteristic,
    schur_stable,
    spectral_radius,
)
from vic_toolbox.stability.sampling.sampled_wall import passive_damping

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 200
"""Of a default grid along each axis."""
CURVE = 4001
"""Points of an edge of stability."""
ROOM = 1.15
"""How far a default grid reaches beyond the largest stable gains."""


@dataclass(frozen=True, eq=False)
class ZWidth:
    """What :func:`z_width` found; `plot` draws it.

    Parameters
    ----------
    stiffness : ndarray, shape (k,)
        K of the map's columns [N/m].
    damping : ndarray, shape (b,)
        B of the map's rows [Ns/m].
    stable : ndarray of bool, shape (b, k)
        Whether the held loop is asymptotically stable: exact, by the Schur-Cohn recursion.
    edge : ndarray, shape (n, 2)
        The edge of stability (K, B): where a pair of roots is on the unit circle, from ω → 0 to π/T, then where one
        is at −1; NaN between its pieces. With K = 0 it encloses the stable gains.
    frequency : ndarray, shape (n,)
        At which the loop oscillates on the edge [rad/s].
    largest : ndarray, shape (2,)
        The largest stable stiffness [N/m] and its damping [Ns/m]; NaN where nothing is stable.
    mass, period, physical_damping : float
        What it is for [kg, s, Ns/m].
    velocity : str
        'exact' or 'backward'.
    delay_steps : int
        Periods from measurement to force.
    """

    stiffness: Array
    damping: Array
    stable: np.ndarray
    edge: Array
    frequency: Array
    largest: Array
    mass: float
    period: float
    physical_damping: float
    velocity: str
    delay_steps: int

    @cached_property
    def spectral_radius(self) -> Array:
        """Largest ``|root|`` of the held loop at each (B, K), shape (b, k); below one it is stable."""
        return spectral_radius(_coefficients(self, *np.meshgrid(self.stiffness, self.damping)))

    @cached_property
    def passive(self) -> np.ndarray:
        """Whether the wall is passive with this physical damping (Colgate and Schenkel): stable with every hand."""
        return self.physical_damping > self.required_damping

    @cached_property
    def required_damping(self) -> Array:
        """Physical damping that makes the wall passive at each (B, K), shape (b, k) [Ns/m]."""
        k, b = np.meshgrid(self.stiffness, self.damping)
        return passive_damping(k, b, self.period, self.delay_steps)

    def plot(self) -> Figure:
        """Map of the decay per period with both edges, in SI units."""
        from vic_toolbox.stability.sampling.z_width_picture import draw

        return draw(self)


def z_width(
    mass: float,
    *,
    period: float,
    stiffness: ArrayLike | None = None,
    damping: ArrayLike | None = None,
    physical_damping: float = 0.0,
    velocity: str = "backward",
    delay_steps: int = 0,
) -> ZWidth:
    """Which (K, B) of ``u_k = −K x_{k−s} − B v_{k−s}``, held over T, are stable on a mass with friction, which passive.

    The characteristic polynomial is affine in K and B. So the map is one pass of the Schur-Cohn recursion over all
    points at once, and the edge is exact: at each ω two linear equations give K and B.

    Parameters
    ----------
    mass : float
        m of the device and the hand that holds it [kg].
    period : float
        T [s].
    stiffness, damping : array_like, shape (k,) and (b,), optional
        Grids of K [N/m] and B [Ns/m]; 200 points each over all stable gains unless given. B may be negative.
    physical_damping : float, optional
        Friction of the device [Ns/m].
    velocity : {'backward', 'exact'}, optional
        As in :func:`~vic_toolbox.stability.sampled_stability`.
    delay_steps : int, optional
        Whole periods from the measurement to the force.

    Returns
    -------
    ZWidth

    Raises
    ------
    InputError
        A mass or period that is not positive, friction that is negative, a negative K, grids that do not increase.

    References
    ----------
    J. E. Colgate, J. M. Brown, Factors affecting the Z-width of a haptic display, ICRA 1994.
    """
    mass, period = positive("mass", mass), positive("period", period)
    friction = finite_number("physical_damping", physical_damping, low=0.0)
    one_of("velocity", velocity, VELOCITIES)
    delay_steps = integer("delay_steps", delay_steps, low=0, high=100)
    family = characteristic(friction * period / mass, velocity == "backward", delay_steps)
    units = mass / period**2, mass / period
    edge, angles, largest = _edge(family)
    edge, largest = edge * units, largest * units
    columns = _grid("stiffness", stiffness, edge[:, 0], low=0.0)
    rows = _grid("damping", damping, edge[:, 1], low=-math.inf)
    k, b = columns[None, :] / units[0], rows[:, None] / units[1]
    return ZWidth(
        columns,
        rows,
        schur_stable(family(*np.broadcast_arrays(k, b))),
        edge,
        angles / period,
        largest,
        mass,
        period,
        friction,
        velocity,
        delay_steps,
    )


def _coefficients(found: ZWidth, stiffness: Array, damping: Array) -> Array:
    family = characteristic(
        found.physical_damping * found.period / found.mass, found.velocity == "backward", found.delay_steps
    )
    return family(stiffness * found.period**2 / found.mass, damping * found.period / found.mass)


def _edge(family: Characteristic) -> tuple[Array, Array, Array]:
    """Points (K', B') with a root at e^{jθ} that bound stable gains K' > 0, their θ, and the largest K'."""
    angles = np.linspace(0.0, math.pi, CURVE)[1:-1]
    points = _crossing(family, angles)
    kept = (points[:, 0] > 0) & _bounds(family, points)
    if not kept.any():
        return np.full((1, 2), np.nan), np.full(1, np.nan), np.full(2, np.nan)
    best = angles[int(np.argmax(np.where(kept, points[:, 0], -np.inf)))]
    width = angles[1] - angles[0]
    for _ in range(3):  # K' is flat at its top: a fine grid about it is enough
        finer = np.linspace(
            max(best - width, 0.5 * angles[0]), min(best + width, math.pi - 0.5 * angles[0]), 201
        )
        best = finer[int(np.argmax(_crossing(family, finer)[:, 0]))]
        width /= 100
    largest = _crossing(family, np.array([best]))[0]
    pieces, turns = [np.where(kept[:, None], points, np.nan)], [angles]
    line, on = _alternating(family, largest[0])
    if on.any():
        pieces += [np.full((1, 2), np.nan), np.where(on[:, None], line, np.nan)]
        turns += [np.full(1, np.nan), np.full(len(line), math.pi)]
    return np.concatenate(pieces), np.concatenate(turns), largest


def _alternating(family: Characteristic, stiffest: float) -> tuple[Array, np.ndarray]:
    """The line of (K', B') with a root at −1, from K' = 0 on, and where it bounds stable gains."""
    free, spring, damper = (float(np.polyval(p, -1.0)) for p in family)
    if (
        abs(damper) <= 1e-12 * np.abs(family.damper).max()
    ):  # a backward difference without friction: no such edge
        return np.full((1, 2), np.nan), np.zeros(1, dtype=bool)
    k = np.linspace(0.0, stiffest, CURVE // 10)[1:]
    line = np.column_stack([k, -(free + spring * k) / damper])
    return line, _bounds(family, line)


def _crossing(family: Characteristic, angles: Array) -> Array:
    """(K', B') with a root at e^{jθ}: real and imaginary part of ``free + K' spring + B' damper = 0``."""
    free, spring, damper = (np.polyval(p, np.exp(1j * angles)) for p in family)
    determinant = (np.conj(spring) * damper).imag
    with np.errstate(divide="ignore", invalid="ignore"):
        k = -(np.conj(free) * damper).imag / determinant
        b = -(np.conj(spring) * free).imag / determinant
    return np.stack([k, b], axis=-1)


def _bounds(family: Characteristic, points: Array) -> np.ndarray:
    """Whether stable gains lie on one side of each point, a millionth away."""
    ahead = np.gradient(points, axis=0)
    size = np.abs(points).max(axis=1, keepdims=True) * 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) / np.linalg.norm(ahead, axis=1, keepdims=True)
    sides = [schur_stable(family(*(points + sign * size * across).T)) for sign in (1, -1)]
    return sides[0] | sides[1]


def _grid(name: str, given: ArrayLike | None, edge: Array, *, low: float) -> Array:
    if given is None:
        if not np.isfinite(edge).any():
            raise InputError(f"no gains are stable here, so no range of {name} can be chosen; pass {name}.")
        return np.linspace(0.0, ROOM * float(np.nanmax(edge)), POINTS)
    grid = finite_array(name, given, shape=(None,))
    if len(grid) < 2 or (np.diff(grid) <= 0).any() or grid[0] < low:
        raise InputError(
            f"{name} must be two or more increasing numbers{'' if low < 0 else ', none negative'}; "
            f"it starts {np.array2string(grid[:4])}."
        )
    return grid
