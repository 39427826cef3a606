"""What tells a real arm from its model: drawn once for each twin, within bounds that are stated here.

The numbers are assumptions with reasons (docs/twin.md); no identified parameters of this arm are published under
a free licence.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array, InputError, finite_number, integer

RAW_COULOMB = (6.0, 8.0, 5.0, 2.0, 2.0, 1.5)
RAW_VISCOUS = (8.0, 8.0, 5.0, 1.5, 1.5, 1.0)
"""Friction of the geared joints before any compensation, guessed from arms of this size [Nm, Nms/rad]."""


@dataclass(frozen=True, kw_only=True)
class Imperfections:
    """How far a twin may be from the nominal model. Bounds are of uniform, deviations of normal distributions.

    Raises
    ------
    InputError
        A number is negative or not finite, or a relative error is one or more.
    """

    inertia: float = 0.2
    """Largest relative error of each link's inertia tensor and each rotor's inertia."""
    mass: float = 0.01
    """Largest relative error of each link's mass; the weight that the model does not know follows from it."""
    friction: float = 0.01
    """Share of the joints' friction that the drives' own compensation leaves; drawn between half and all of it."""
    delay: float = 2e-3
    """Age of the joint angles and speeds that a torque is computed from [s]; whole steps of 1 ms."""
    angle_noise: float = 1e-5
    """Deviation of a measured joint angle [rad]."""
    angle_resolution: float = 2.0 * math.pi / 2**19
    """Step of the encoders, on the joint's side [rad]."""
    speed_noise: float = 2e-3
    """Deviation of a measured joint speed, which the drives derive from their motor encoders [rad/s]."""
    force_noise: float = 0.2
    """Deviation of the F/T sensor's forces, sample by sample [N]."""
    moment_noise: float = 0.01
    """Deviation of its moments [Nm]."""
    force_resolution: float = 0.02
    """Step of its forces [N]."""
    moment_resolution: float = 1e-3
    """Step of its moments [Nm]."""
    force_bias: float = 4.0
    """Largest zero error of a force [N]; it stays the same while the sensor is warm."""
    moment_bias: float = 0.2
    """Largest zero error of a moment [Nm]."""

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            high = 0.9 if field.name in ("inertia", "mass") else math.inf
            number = finite_number(field.name, getattr(self, field.name), low=0.0, high=high)
            object.__setattr__(self, field.name, number)
        if abs(1e3 * self.delay - round(1e3 * self.delay)) > 1e-6:
            raise InputError(f"delay is {self.delay:g} s; pass a whole number of milliseconds.")

    @classmethod
    def none(cls) -> Imperfections:
        """A robot that is its model."""
        return cls(**dict.fromkeys((field.name for field in dataclasses.fields(cls)), 0.0))

    @property
    def delay_steps(self) -> int:
        """The delay in steps of 1 ms."""
        return round(1e3 * self.delay)

    def sample(self, links: tuple[str, ...], *, joints: int, seed: int) -> Specimen:
        """Draw one robot: the same seed gives the same one.

        Parameters
        ----------
        links : tuple of str
            Bodies with mass, in the order in which they are drawn.
        joints : int
            Number of joints.
        seed : int
            Robot to draw.
        """
        rng = np.random.default_rng([integer("seed", seed, low=0), 0x7417])

        def factors(largest: float, size: int) -> Array:
            return 1.0 + rng.uniform(-largest, largest, size)

        return Specimen(
            mass=dict(zip(links, factors(self.mass, len(links)).tolist(), strict=True)),
            inertia=dict(zip(links, factors(self.inertia, len(links)).tolist(), strict=True)),
            armature=factors(self.inertia, joints),
            coulomb=self.friction * rng.uniform(0.5, 1.0, joints) * RAW_COULOMB,
            viscous=self.friction * rng.uniform(0.5, 1.0, joints) * RAW_VISCOUS,
            bias=rng.uniform(-1.0, 1.0, 6) * np.repeat([self.force_bias, self.moment_bias], 3),
        )


@dataclass(frozen=True, eq=False)
class Specimen:
    """One robot, as it is."""

    mass: Mapping[str, float]
    """Factor on the mass of each link."""
    inertia: Mapping[str, float]
    """Factor on the inertia tensor of each link; a common factor keeps a tensor that of a body."""
    armature: Array
    """Factor on the rotor inertia of each joint, (nv,)."""
    coulomb: Array
    """Friction torque of each joint, (nv,) [Nm]."""
    viscous: Array
    """Friction torque per speed, (nv,) [Nms/rad]."""
    bias: Array
    """What the F/T sensor reads without load, its own axes, (6,) [N, Nm]."""
