r"""Energy tank: a stiffness may rise only on energy that the damper has taken out before.

With gains held over each control step, the energy :math:`V = \tfrac12\dot e^T M\dot e + \tfrac12 e^T K e` only falls
between two steps, by what the damper takes; at a step it jumps by :math:`\tfrac12 e^T\Delta K e`. The tank pays for
every jump upward and takes what a jump downward frees, so that

.. math:: V(t) + \text{tank}(t) \le V(0) + \text{tank}(0) \quad\text{in free motion, whatever gains are wanted.}

What the damper took over a step is known only from samples. Because of
:math:`\int\dot e^T B\,\dot e\,dt \ge \Delta e^T B\,\Delta e\,/\,\Delta t` (Jensen), the tank is credited with the
right-hand side: never more than was really dissipated, and nothing but positions are measured. The decision is
latched: it is taken once a step and holds until the next, so that it cannot chatter within one. (Between two steps the
law itself runs as in continuous time; its own sampling is the business of ``stability.sampled_stability``.)

References
----------
F. Ferraguti, C. Secchi, C. Fantuzzi, "A tank-based approach to impedance control with variable stiffness", ICRA 2013.
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE Transactions on Robotics
32(5), 2016.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.control.gain_arrays import checked_gains, is_diagonal, quadratic
from vic_toolbox.errors import Array, InputError, finite_array, finite_number, positive


class TankState(NamedTuple):
    """The tank at a control step, and the gains that hold until the next; a batch puts its dimensions first."""

    energy: Array
    """In the tank [J], (...)."""
    stiffness: Array
    """Allowed K, as the wanted one was given: (..., d) or (..., d, d)."""
    damping: Array
    """B, passed on as wanted."""
    error: Array
    """e at this step (..., d)."""
    share: Array
    """Part of the wanted change of stiffness that was allowed (...): 1 where the tank does not interfere."""


@dataclass(frozen=True, kw_only=True)
class EnergyTank:
    """How much energy a stiffness may borrow.

    Examples
    --------
    A step from 100 to 500 N/m at an error of 0.1 m wants 2 J; with 1.5 J in the tank only 400 N/m are allowed:

    >>> from vic_toolbox.control import EnergyTank
    >>> tank = EnergyTank(energy=1.5)
    >>> state = tank.start(error=[0.1], stiffness=[100.0], damping=[20.0])
    >>> state = tank.step(state, error=[0.1], stiffness=[500.0], damping=[20.0], elapsed=0.01)
    >>> float(state.stiffness[0].round(6)), float(state.energy.round(6))
    (400.0, 0.0)
    """

    energy: float
    """In the tank at the start [J]."""

    capacity: float = float("inf")
    """Largest energy that it keeps [J]; what would overflow is gone. It bounds how much can be injected at once."""

    reserve: float = 0.0
    """Energy that stays in the tank [J]: the stiffness gets none of it."""

    refill: float = 1.0
    """Share of the dissipated energy that goes into the tank, 0 to 1."""

    power: float = float("inf")
    """Largest power that the stiffness may draw [W]: a step takes at most this times its length."""

    def __post_init__(self) -> None:
        for name in ("energy", "reserve"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name), low=0.0))
        object.__setattr__(self, "refill", finite_number("refill", self.refill, low=0.0, high=1.0))
        for name in ("capacity", "power"):
            if getattr(self, name) != np.inf:
                object.__setattr__(self, name, positive(name, getattr(self, name)))
        if not self.reserve <= self.energy <= self.capacity:
            raise InputError(
                f"reserve is {self.reserve:g} J, energy {self.energy:g} J and capacity {self.capacity:g} J; "
                "they must not fall in this order."
            )

    def start(self, *, error: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> TankState:
        """Return the state at the first step, with the gains as they are.

        Parameters
        ----------
        error : array_like, shape (..., d)
            e [m, rad].
        stiffness, damping : array_like, shape (..., d) or (..., d, d)
            Positive diagonals, or symmetric positive definite matrices; the damping may be zero.

        Raises
        ------
        InputError
            Wrong shapes, not finite, or not positive.
        """
        e, k, b = _checked(error, stiffness, damping)
        batch = e.shape[:-1]
        return TankState(np.full(batch, self.energy), k, b, e, np.ones(batch))

    def step(
        self,
        state: TankState,
        *,
        error: ArrayLike,
        stiffness: ArrayLike,
        damping: ArrayLike,
        elapsed: float,
    ) -> TankState:
        """Return the state at the next step: the tank filled by what the damper took, and the stiffness allowed.

        The allowed stiffness is ``K + s (K_wanted − K)`` with the largest s in [0, 1] that the tank can pay: it is
        positive definite, because both ends are.

        Parameters
        ----------
        state : TankState
            Of the step before.
        error : array_like, shape (..., d)
            e now.
        stiffness, damping : array_like
            Wanted now, in the form of the start.
        elapsed : float
            Time since the step before [s].

        Raises
        ------
        InputError
            As :meth:`start`, or another shape than there.
        """
        e, wanted, b = _checked(error, stiffness, damping)
        dt = positive("elapsed", elapsed)
        if e.shape != state.error.shape or wanted.shape != state.stiffness.shape:
            raise InputError(
                f"errors {e.shape} and stiffness {wanted.shape} follow {state.error.shape} and "
                f"{state.stiffness.shape}; keep the form of the start."
            )
        taken = quadratic(state.damping, e - state.error) / dt
        energy = np.minimum(state.energy + self.refill * taken, self.capacity)
        change = wanted - state.stiffness
        cost = 0.5 * quadratic(change, e)
        budget = np.minimum(np.maximum(energy - self.reserve, 0.0), self.power * dt)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.where(cost > budget, budget / cost, 1.0)
        spread = share[..., None] if is_diagonal(change, e) else share[..., None, None]
        allowed = np.where(spread == 1.0, wanted, state.stiffness + spread * change)
        energy = np.minimum(energy - np.minimum(cost, budget), self.capacity)
        return TankState(energy, allowed, b, e, share)


def _checked(error: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> tuple[Array, Array, Array]:
    e = finite_array("error", error, shape=(..., None))
    return (
        e,
        checked_gains("stiffness", stiffness, error=e),
        checked_gains("damping", damping, error=e, definite=False),
    )
