"""A known push: the controller adds a small multi-sine wrench while the operator works.

A human who is left alone hardly excites anything but the path itself, and what moves the arm besides (sway,
tremor) also moves the wrench: a regression of one on the other is biased. A push that the operator did not make
has neither fault. It is the classical experiment on the impedance of arms.

References
----------
F. Mussa-Ivaldi, N. Hogan, E. Bizzi, "Neural, mechanical, and geometric factors subserving arm posture in humans",
Journal of Neuroscience 5(10), 1985.
H. Gomi, M. Kawato, "Equilibrium-point control hypothesis examined by measured arm stiffness during multijoint
movement", Science 272, 1996.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array, finite_number
from vic_toolbox.twin.signals import multisine, smoothstep

SHARES = (1.0, 1.0, 0.5, 0.05, 0.05, 0.05)
"""Of the force along x that each axis gets [1, m]; less of it upwards, towards the plate."""


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Multi-sine wrench at the end-effector, other phases in every demonstration."""

    force: float = 5.0
    """Root mean square of the force along x [N]; the other axes have the :data:`SHARES` of it."""
    band: tuple[float, float] = (0.3, 3.0)
    """[Hz]"""
    fade: float = 0.3
    """It rises and falls in this time [s]."""
    until: float = 2.7
    """When it has faded [s]: the cup is put down undisturbed."""

    def __post_init__(self) -> None:
        for name in ("force", "fade", "until"):
            object.__setattr__(self, name, finite_number(name, getattr(self, name), low=0.0))

    def wrench(self, time: Array, *, count: int, rng: np.random.Generator) -> Array:
        """Wrenches (T, count, 6) [N, Nm], world axes, at times (T,) [s]."""
        fade = max(self.fade, 1e-9)
        shape = smoothstep(time / fade) * smoothstep((self.until - time) / fade)
        rms = self.force * np.array(SHARES)
        return shape[:, None, None] * multisine(time, count=count, band=self.band, rms=rms, rng=rng)
