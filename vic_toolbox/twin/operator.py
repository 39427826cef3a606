r"""The simulated human: a hand on the gripper, whose impedance changes over time, and which is never quite still.

The wrench on the end-effector, about its origin and in world axes, is the paper's :math:`F_{fb}`,

.. math::
    F_{hand} = -K(t)\,\big(e - s(t)\big) - B(t)\,\dot e + n(t),

with the pose error :math:`e` to the goal, a slow sway :math:`s` of where the hand wants to be, and tremor
:math:`n`. :math:`K(t)` and :math:`B(t)` are the same in every demonstration, so pooled demonstrations have one
truth; sway, tremor and start differ.

The hand knows the true pose and reacts at once: its reflexes are in the impedance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array, InputError, finite_array, finite_number
from vic_toolbox.twin.signals import multisine, smoothstep

_Six = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Schedule:
    """Impedance of the hand over time: lean in, carry stiffly, soften, place softly.

    Between phases the stiffness follows a minimum-jerk rise; ``B = d √K`` along the axes with a factor d that
    follows the same course from `factor_carry` to `factor_place`.
    """

    start: _Six = (60.0, 60.0, 60.0, 4.0, 4.0, 4.0)
    """K when the arm is released [N/m, Nm/rad]; with more, a hand would jerk half a metre away from the goal."""
    carry: _Six = (200.0, 170.0, 85.0, 6.0, 5.0, 5.0)
    """K while the cup is carried."""
    place: _Six = (80.0, 70.0, 75.0, 3.0, 2.5, 2.5)
    """K while it is put down."""
    carried: float = 0.6
    """When K has risen [s]."""
    soften: float = 0.9
    """When it begins to fall [s]."""
    soft: float = 1.7
    """When it has fallen [s]."""
    factor_carry: tuple[float, float] = (9.0, 4.0)
    """d of translation and rotation until the hand softens [√kg, √(kg m²)]."""
    factor_place: tuple[float, float] = (10.0, 4.0)
    """d after that."""

    def __post_init__(self) -> None:
        for name in ("start", "carry", "place"):
            finite_array(f"{name} stiffness", getattr(self, name), shape=(6,))
        if not 0 < self.carried <= self.soften < self.soft:
            raise InputError(
                f"the phases end at {self.carried:g}, {self.soften:g} and {self.soft:g} s; they must follow each other."
            )

    def gains(self, time: Array) -> tuple[Array, Array]:
        """Diagonals of K and B at times (T,), each (T, 6)."""
        t = np.asarray(time)[:, None]
        rise, fall = smoothstep(t / self.carried), smoothstep((t - self.soften) / (self.soft - self.soften))
        start, carry, place = (np.array(level) for level in (self.start, self.carry, self.place))
        stiffness = start + rise * (carry - start) + fall * (place - carry)
        first, last = (np.repeat(f, 3) for f in (self.factor_carry, self.factor_place))
        return stiffness, (first + fall * (last - first)) * np.sqrt(stiffness)


@dataclass(frozen=True, kw_only=True)
class Operator:
    """A human operator; every field that is zero leaves that part of being human out."""

    schedule: Schedule = Schedule()
    """K(t) and B(t)."""
    tremor: tuple[float, float] = (0.3, 0.02)
    """Physiological tremor: root mean square of force and moment along each axis [N, Nm]."""
    tremor_band: tuple[float, float] = (8.0, 12.0)
    """[Hz]"""
    sway: tuple[float, float] = (2e-3, 5e-3)
    """Wander of where the hand wants to be: root mean square along each axis [m, rad]."""
    sway_band: tuple[float, float] = (0.1, 0.7)
    """[Hz]"""

    def __post_init__(self) -> None:
        for name in ("tremor", "sway", "tremor_band", "sway_band"):
            for value in getattr(self, name):
                finite_number(name, value, low=0.0)

    def take(self, time: Array, *, count: int, rng: np.random.Generator) -> Hands:
        """Hands of `count` demonstrations, at times (T,) [s]."""
        stiffness, damping = self.schedule.gains(time)
        sway, tremor = (
            multisine(time, count=count, band=band, rms=np.repeat(rms, 3), rng=rng)
            for band, rms in ((self.sway_band, self.sway), (self.tremor_band, self.tremor))
        )
        return Hands(stiffness, damping, tremor + stiffness[:, None, :] * sway)


CALM = Operator(tremor=(0.0, 0.0), sway=(0.0, 0.0))
"""A human who is nothing but spring and damper."""


@dataclass(frozen=True, eq=False)
class Hands:
    """The same operator in several demonstrations."""

    stiffness: Array
    """Diagonal of K(t), (T, 6)."""
    damping: Array
    """Diagonal of B(t), (T, 6)."""
    unrest: Array
    """``K s + n``: what is not spring and damper, (T, count, 6) [N, Nm]."""

    def wrench(self, index: int, motion: Array) -> Array:
        """Wrench (count, 6) on the end-effector at sample `index`, where (e, ė) is `motion` (count, 12)."""
        spring = self.stiffness[index] * motion[:, :6] + self.damping[index] * motion[:, 6:]
        return self.unrest[index] - spring
