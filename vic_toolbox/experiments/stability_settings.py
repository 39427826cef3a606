"""What ``vic stability`` is told: the mass, the computer, and the filters to try."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, integer, one_of, positive

Numbers = tuple[float, ...]
PERIOD = 1e-3
"""Of the control loop, where nothing else is known [s]."""


@dataclass(frozen=True, kw_only=True)
class StabilitySettings:
    """What the gains act on, and how."""

    mass: Numbers = ()
    """One mass [kg] for x, y, z, or six: three in kg, three in kg m²."""
    robot: str | None = None
    """Arm whose M(x) is the mass, see vic robots; along the log's joints, or in one posture."""
    tool: str | None = None
    """Tool of that arm."""
    posture: Numbers = ()
    """Its joint angles [rad]; by default the joints of the log, else its home."""
    axes: tuple[str, ...] = ()
    """Axes to judge: x y z rx ry rz; by default all that are known."""
    period: float | None = None
    """Control period [s]; by default 0.001, or the task's."""
    delay_steps: int = 0
    """Control periods from the measurement to the force."""
    velocity: Literal["exact", "backward"] = "exact"
    """Velocity as it is at the sample, or the difference of two positions."""
    physical_damping: Numbers = ()
    """Friction of the mechanism: one number for x, y, z [Ns/m], or six."""
    environment: float = 1e5
    """Stiffness of what is touched [N/m]."""
    hold: float | None = None
    """How long gains are held before they jump [s]; by default they change smoothly, or as a run's task holds them."""
    tank: float | None = None
    """Replay an energy tank with this much energy at the start [J]."""
    filter: float | None = None
    """Replay the gain filter with this rate α [1/s]."""
    scenario: str | None = None
    """Of a run: where it starts; by default as it was trained."""
    episodes: int = 1
    """Of a run: the exact start, and further ones that vary."""
    seed: int = 0
    """Of the starts and of the search for growing motions; the same seed gives the same numbers."""

    def check(self) -> None:
        """Refuse numbers that make no sense.

        Raises
        ------
        InputError
        """
        for name in ("mass", "physical_damping"):
            values = getattr(self, name)
            if len(values) not in (0, 1, 6):
                raise InputError(
                    f"{name} has {len(values)} numbers; pass one for x, y, z, or six for x, y, z, rx, ry, rz."
                )
            if (values and (finite_array(name, values) < 0).any()) or (name == "mass" and 0.0 in values):
                raise InputError(f"{name} is {' '.join(f'{x:g}' for x in values)}; pass positive numbers.")
        for name in ("period", "hold", "tank", "filter"):
            if getattr(self, name) is not None:
                positive(name, getattr(self, name))
        finite_number("environment", self.environment, low=0.0)
        integer("delay_steps", self.delay_steps, low=0, high=100)
        integer("episodes", self.episodes, low=1, high=1000)
        integer("seed", self.seed, low=0)
        from vic_toolbox.gains import AXES  # the help of the command line is quick without it

        for axis in self.axes:
            one_of("axis", axis, AXES)
        if self.mass and self.robot is not None:
            raise InputError("both a mass and a robot were given; pass one of them.")
        if self.robot is None and (self.tool is not None or self.posture):
            raise InputError("a tool or a posture belongs to an arm; pass --robot NAME too (see vic robots).")

    @property
    def numbers(self) -> float | Array | None:
        """The mass as the analysis takes it; None if none was given."""
        if not self.mass:
            return None
        return self.mass[0] if len(self.mass) == 1 else np.array(self.mass)

    @property
    def friction(self) -> float | Array:
        """The friction as the analysis takes it."""
        if not self.physical_damping:
            return 0.0
        return (
            self.physical_damping[0] if len(self.physical_damping) == 1 else np.array(self.physical_damping)
        )
