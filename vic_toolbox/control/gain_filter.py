r"""Gain filter: wanted gains are followed only as fast as a Lyapunov function of chosen rate α allows.

Kronander and Billard show that ``M ë + D ė + K e = 0`` with smooth gains is stable if, for some α,
:math:`\alpha M - D \preceq 0` and :math:`\dot K + \alpha\dot D - 2\alpha K \preceq 0`: then

.. math:: V = \tfrac12(\dot e + \alpha e)^T M(\dot e + \alpha e) + \tfrac12 e^T(K + \alpha D - \alpha^2 M)e = x^T P x

never grows. A controller holds its gains, and they *jump*; the exact condition over a step of length Δt is then

.. math:: \Phi^T P_{next}\,\Phi \preceq P, \qquad \Phi = \exp(A\,\Delta t), \quad A \text{ of the gains that are held.}

The filter passes the largest part of the wanted change that satisfies it. No state is measured, and the bound holds
for every motion; the :class:`~vic_toolbox.control.EnergyTank` looks at the actual error instead, and allows more.

References
----------
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE Transactions on Robotics
32(5), 2016, theorem 1. The form for held gains follows from it by integrating over a step.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import expm

from vic_toolbox.control.gain_arrays import checked_gains
from vic_toolbox.errors import Array, InputError, finite_array, positive
from vic_toolbox.gains import spd_matrix

EXCESS = 1e-3
"""By how much the damping stays above αM, relative to it: at αM itself nothing decays, and no gain may change."""
ROUNDING = 1e-9
"""By how much less than the exact bound is passed, so that rounding does not break it."""


class FilterState(NamedTuple):
    """Gains that hold until the next step, as they were given: (..., d) or (..., d, d)."""

    stiffness: Array
    """Allowed K."""
    damping: Array
    """Allowed D."""
    share: Array
    """Part of the wanted change that was allowed, of each axis (..., d), or (...) where axes are coupled."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GainFilter:
    """A filter of gains that keeps the Kronander-Billard certificate.

    With a diagonal mass and diagonal gains every axis is filtered on its own, otherwise all together.

    Examples
    --------
    >>> from vic_toolbox.control import GainFilter
    >>> calm = GainFilter(mass=1.0, alpha=5.0)
    >>> state = calm.start(stiffness=[100.0], damping=[20.0])
    >>> state = calm.step(state, stiffness=[500.0], damping=[20.0], elapsed=0.01)
    >>> float(state.stiffness[0].round(3))  # about 2 α K Δt more, whatever is wanted
    110.035
    """

    mass: ArrayLike
    """M: a number for one axis, d numbers (a diagonal), or a (d, d) symmetric positive definite matrix."""

    alpha: float
    """α [1/s]: a large one lets the stiffness rise fast, but asks for a damping of more than αM."""

    matrices: bool = False
    """Whether gains are given as matrices (..., d, d) rather than as diagonals (..., d)."""

    def __post_init__(self) -> None:
        mass = finite_array("mass", self.mass)
        object.__setattr__(
            self, "mass", spd_matrix("mass", mass if mass.ndim > 1 else np.diag(np.atleast_1d(mass)))
        )
        object.__setattr__(self, "alpha", positive("alpha", self.alpha))

    def start(self, *, stiffness: ArrayLike, damping: ArrayLike) -> FilterState:
        """Return the state at the first step, with the gains as they are.

        Parameters
        ----------
        stiffness, damping : array_like, shape (..., d), or (..., d, d) with `matrices`
            Positive definite.

        Raises
        ------
        InputError
            Wrong shapes, not positive, or a damping that is not greater than αM: this α has no certificate for it.
        """
        k, b = self._checked(stiffness, damping)
        blocks = self._blocks(b)
        fraction = _largest_share((1 + EXCESS) * self.alpha * self._mass_blocks, blocks, limit=np.inf)
        if (fraction < 1).any():
            raise InputError(
                f"alpha is {self.alpha:g} 1/s, and the damping at the start is less than αM; choose alpha up to "
                f"{self.alpha * fraction.min():.6g} 1/s, or more damping."
            )
        return FilterState(k, b, np.ones(fraction.shape))

    def step(
        self, state: FilterState, *, stiffness: ArrayLike, damping: ArrayLike, elapsed: float
    ) -> FilterState:
        """Return the gains for the next step: the wanted ones, or as far towards them as the certificate allows.

        Parameters
        ----------
        state : FilterState
            Gains held since the step before.
        stiffness, damping : array_like
            Wanted now, in the form of the start. A damping below αM is approached, not reached.
        elapsed : float
            Time since the step before [s].

        Raises
        ------
        InputError
            As :meth:`start`, or another shape than there.
        """
        wanted_k, wanted_b = self._checked(stiffness, damping)
        dt = positive("elapsed", elapsed)
        if wanted_k.shape != state.stiffness.shape:
            raise InputError(
                f"stiffness {wanted_k.shape} follows {state.stiffness.shape}; keep the form of the start."
            )
        mass, k, b = self._mass_blocks, self._blocks(state.stiffness), self._blocks(state.damping)
        change_k, change_b = self._blocks(wanted_k) - k, self._blocks(wanted_b) - b
        damped = _largest_share(-change_b, b - (1 + EXCESS) * self.alpha * mass)
        change_b = damped[..., None, None] * change_b
        stored, flow = _stored(mass, k, b, self.alpha), _flow(mass, k, b, dt)
        jump, d = np.zeros_like(stored), k.shape[-1]
        jump[..., :d, :d] = 0.5 * (change_k + self.alpha * change_b)
        back = np.swapaxes(flow, -1, -2)
        share = _largest_share(back @ jump @ flow, stored - back @ stored @ flow)
        part = share[..., None, None]
        # what is passed whole is passed without rounding
        new_k = np.where(part == 1, self._blocks(wanted_k), k + part * change_k)
        whole = part * damped[..., None, None] == 1
        new_b = np.where(whole, self._blocks(wanted_b), b + part * change_b)
        return FilterState(self._gains(new_k), self._gains(new_b), share * damped)

    def lyapunov(self, *, stiffness: ArrayLike, damping: ArrayLike) -> Array:
        """Return P (..., 2 d, 2 d) of ``V = xᵀ P x`` [J] with ``x = [e; ė]``."""
        k, b = self._checked(stiffness, damping)
        if not self.matrices:
            k, b = k[..., None] * np.eye(k.shape[-1]), b[..., None] * np.eye(b.shape[-1])
        return _stored(np.asarray(self.mass), k, b, self.alpha)

    def _checked(self, stiffness: ArrayLike, damping: ArrayLike) -> tuple[Array, Array]:
        d = len(np.asarray(self.mass))
        k = finite_array("stiffness", stiffness, shape=(..., d, d) if self.matrices else (..., d))
        like = np.empty(k.shape[:-1] if self.matrices else k.shape)
        return (
            checked_gains("stiffness", k, error=like),
            checked_gains("damping", damping, error=like, definite=False),
        )

    @property
    def _alone(self) -> bool:
        """Whether every axis is a problem of its own."""
        mass = np.asarray(self.mass)
        return not self.matrices and not (mass * (1 - np.eye(len(mass)))).any()

    @property
    def _mass_blocks(self) -> Array:
        """M as (d, d), or (d, 1, 1) where axes are alone."""
        mass = np.asarray(self.mass)
        return np.diagonal(mass)[:, None, None] if self._alone else mass

    def _blocks(self, gains: Array) -> Array:
        """Gains as (..., d, d), or (..., d, 1, 1) where axes are alone."""
        if self.matrices:
            return gains
        return gains[..., None, None] if self._alone else gains[..., None] * np.eye(gains.shape[-1])

    def _gains(self, blocks: Array) -> Array:
        if self.matrices:
            return blocks
        return blocks[..., 0, 0] if self._alone else np.diagonal(blocks, axis1=-2, axis2=-1).copy()


def _stored(mass: Array, stiffness: Array, damping: Array, alpha: float) -> Array:
    """P (..., 2 d, 2 d)."""
    cross = np.broadcast_to(alpha * mass, stiffness.shape)
    top = np.concatenate([stiffness + alpha * damping, cross], axis=-1)
    low = np.concatenate([cross, np.broadcast_to(mass, stiffness.shape)], axis=-1)
    return 0.5 * np.concatenate([top, low], axis=-2)


def _flow(mass: Array, stiffness: Array, damping: Array, elapsed: float) -> Array:
    """Φ (..., 2 d, 2 d)."""
    identity = np.broadcast_to(np.eye(stiffness.shape[-1]), stiffness.shape)
    top = np.concatenate([np.zeros_like(identity), identity], axis=-1)
    low = -np.linalg.solve(mass, np.concatenate([stiffness, damping], axis=-1))
    return np.asarray(expm(elapsed * np.concatenate([top, low], axis=-2)), dtype=np.float64)


def _largest_share(change: Array, room: Array, *, limit: float = 1.0) -> Array:
    """Largest s in [0, limit] (...) with ``room − s change ⪰ 0``, for matrices (..., n, n); 0 without room."""
    diagonal = np.diagonal(room, axis1=-2, axis2=-1)
    open_ = (diagonal > 0).all(axis=-1)
    scale = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    both = scale[..., :, None] * scale[..., None, :]
    values, vectors = np.linalg.eigh(both * room)
    open_ &= values[..., 0] > 0
    half = vectors / np.sqrt(np.where(open_[..., None], values, 1.0))[..., None, :]
    relative = np.swapaxes(half, -1, -2) @ (both * change) @ half
    largest = np.linalg.eigvalsh(0.5 * (relative + np.swapaxes(relative, -1, -2)))[..., -1]
    with np.errstate(divide="ignore"):
        share = np.where(largest > 0, (1 - ROUNDING) / np.maximum(largest, 1e-300), limit)
    falls = np.linalg.eigvalsh(both * change)[..., -1] <= 0  # such a change needs no room
    return np.asarray(np.where(open_ | falls, np.minimum(share, limit), 0.0), dtype=np.float64)
