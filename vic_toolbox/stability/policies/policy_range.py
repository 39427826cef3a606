"""What is known of a policy beyond samples: the range of its gains. Whatever it does within it, is the loop stable?

A parametrisation clips the actions, so the gains stay in a box. Where mass and gains act on each axis alone, a common
quadratic Lyapunov function of the four corners (k, b) of every axis proves that every motion decays, for any policy
with these ranges, continuous or not.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from vic_toolbox.errors import Array, DependencyError
from vic_toolbox.gains import DampingFactor, Diagonal, DiagonalStiffness
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.ranges.common_lyapunov import common_lyapunov
from vic_toolbox.stability.ranges.gain_box import gain_box
from vic_toolbox.stability.verdict import Certificate


class GainRange(NamedTuple):
    """Smallest and largest diagonals of K and B, (d,) each."""

    stiffness_low: Array
    stiffness_high: Array
    damping_low: Array
    damping_high: Array


def gain_range(loop: PolicyLoop) -> GainRange | None:
    """Range in which a parametrisation keeps the gains; None where they are not known to be diagonal and bounded."""
    form = loop.parametrisation
    if not isinstance(form, (DiagonalStiffness, Diagonal, DampingFactor)):
        return None
    # every damping of these parametrisations rises with each of its parameters
    low, high = form.parameters_to_gains(form.minimum), form.parameters_to_gains(form.maximum)
    return GainRange(
        low.stiffness_diagonal, high.stiffness_diagonal, low.damping_diagonal, high.damping_diagonal
    )


def range_certificate(loop: PolicyLoop) -> tuple[Certificate, float] | None:
    """Certificate that every motion decays, and its rate [1/s]; None if there is none, or it cannot be looked for."""
    box = gain_range(loop)
    masses = np.diagonal(loop.mass)
    if box is None or loop.load.any() or (loop.mass != np.diag(masses)).any():
        return None
    whole, rates = np.zeros((2 * loop.size, 2 * loop.size)), []
    alike = functools.cache(_axis_certificate)
    for axis, mass in enumerate(masses.tolist()):
        found = alike(mass, *(float(end[axis]) for end in box))
        if found is None:
            return None
        rows = [axis, loop.size + axis]
        whole[np.ix_(rows, rows)], rate = found
        rates.append(rate)
    certificate = Certificate(
        "AᵀP + PA ≺ 0 at every corner of the range of the gains, P ≻ 0",
        {"P": whole, **box._asdict()},
        slack=min(rates),
    )
    return certificate, min(rates)


def _axis_certificate(
    mass: float, k_low: float, k_high: float, b_low: float, b_high: float
) -> tuple[Array, float] | None:
    """P (2, 2) and rate of decay of one axis."""
    try:
        found = common_lyapunov(mass, *gain_box((k_low, k_high), (b_low, b_high)))
    except DependencyError:  # without cvxpy the answer is what samples show
        return None
    if found.status != "proved" or not isinstance(found.witness, Certificate):
        return None
    return found.witness.values["P"], found.margin
