"""Nullspace of a redundant arm: posture torques that do not accelerate the end-effector.

A joint torque moves the end-effector by ``ẍ = J M⁻¹ τ``. The dynamically consistent inverse and the projector

    J̄ = M⁻¹ Jᵀ Λ,    N = I − Jᵀ J̄ᵀ,    Λ = (J M⁻¹ Jᵀ)⁻¹

split every torque into ``τ = Jᵀ F + N τ`` with ``F = J̄ᵀ τ``, and ``J M⁻¹ N = 0``: what N lets through only
moves the arm around its end-effector. No other inverse of J has this property.

References
----------
O. Khatib, "A unified approach for motion and force control of robot manipulators: the operational space
formulation", IEEE Journal of Robotics and Automation 3(1), 1987, section VII.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, finite_number


@dataclass(frozen=True, eq=False)
class Posture:
    """Where a redundant arm should keep its joints, as far as the end-effector leaves them free.

    The torque is ``τ₀ = k₀ (q₀ − q) − b₀ q̇``; the law lets only ``N τ₀`` through.
    """

    angles: Array
    """q₀: wanted joint angles [rad], shape (nv,)."""

    stiffness: float = 10.0
    """k₀ ≥ 0: joint stiffness [Nm/rad]; zero leaves the posture free and only damps it."""

    damping: float = 2.0
    """b₀ ≥ 0: joint damping [Nms/rad]."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "angles", finite_array("posture angles", self.angles, shape=(None,)))
        for field in ("stiffness", "damping"):
            object.__setattr__(self, field, finite_number(f"posture {field}", getattr(self, field), low=0.0))

    def torque(self, q: ArrayLike, v: ArrayLike) -> Array:
        """Return τ₀ [Nm], before the projection, for q [rad] and v [rad/s] of shape (..., nv)."""
        angles = self.angles
        positions = finite_array("q", q, shape=(..., angles.size))
        velocities = finite_array("v", v, shape=(..., angles.size))
        return self.stiffness * (angles - positions) - self.damping * velocities


def dynamically_consistent_inverse(
    mass_matrix: ArrayLike, jacobian: ArrayLike, *, task_mass: ArrayLike | None = None
) -> Array:
    """Return ``J̄ = M⁻¹ Jᵀ Λ``, the inverse of J that spends the least kinetic energy: ``J J̄ = I``.

    Parameters
    ----------
    mass_matrix : array_like, shape (..., nv, nv)
        M(q).
    jacobian : array_like, shape (..., 6, nv)
        J of the end-effector.
    task_mass : array_like, shape (..., 6, 6), optional
        Λ, e.g. the damped one of ``RobotModel.operational_space``; without it ``(J M⁻¹ Jᵀ)⁻¹``.

    Returns
    -------
    ndarray, shape (..., nv, 6)

    Raises
    ------
    InputError
        Shapes that do not fit, entries that are not finite, or no `task_mass` at a singular posture.
    """
    j = finite_array("jacobian", jacobian, shape=(..., 6, None))
    nv = j.shape[-1]
    m = finite_array("mass_matrix", mass_matrix, shape=(..., nv, nv))
    mobile = np.linalg.solve(m, np.swapaxes(j, -1, -2))
    if task_mass is not None:
        return mobile @ finite_array("task_mass", task_mass, shape=(..., 6, 6))
    try:
        return mobile @ np.linalg.inv(j @ mobile)
    except np.linalg.LinAlgError:
        raise InputError(
            "the jacobian has lost rank, so J M⁻¹ Jᵀ cannot be inverted; pass task_mass, the damped inverse "
            "that RobotModel.operational_space gives at a singular posture."
        ) from None


def nullspace_projector(
    mass_matrix: ArrayLike, jacobian: ArrayLike, *, task_mass: ArrayLike | None = None
) -> Array:
    """Return ``N = I − Jᵀ J̄ᵀ``, which takes from a joint torque all that accelerates the end-effector.

    ``N N = N`` and ``J M⁻¹ N = 0``. An arm with six joints has no nullspace: N is zero, except where a damped
    `task_mass` frees the lost direction.

    Parameters
    ----------
    mass_matrix, jacobian, task_mass
        As in :func:`dynamically_consistent_inverse`.

    Returns
    -------
    ndarray, shape (..., nv, nv)
    """
    inverse = dynamically_consistent_inverse(mass_matrix, jacobian, task_mass=task_mass)
    j = np.asarray(jacobian, dtype=np.float64)
    return np.eye(j.shape[-1]) - np.swapaxes(inverse @ j, -1, -2)
