"""The arm's dynamics as the end-effector feels them: M(x), C(x,ẋ)ẋ and G(x)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array

SMALLEST_MOBILITY = 1e-4
"""Floor on the eigenvalues of ``J M⁻¹ Jᵀ`` [1/kg, 1/(kg m²)]: no direction counts as heavier than 10⁴ kg."""


class SingularityWarning(RuntimeWarning):
    """An operational-space quantity was evaluated so close to a singularity that it had to be damped."""


@dataclass(frozen=True)
class OperationalSpace:
    """Dynamics seen at a frame, ``M(x) ẍ + C(x,ẋ) ẋ + G(x) = J⁻ᵀ τ − F_ext``, world axes, linear part first.

    A batch of states puts its dimensions in front of every shape below.
    """

    mass: Array
    """``M(x) = (J M⁻¹ Jᵀ)⁻¹`` (6, 6) [kg, kg m, kg m²]."""
    coriolis: Array
    """``C(x,ẋ) ẋ = J̄ᵀ C q̇ − M(x) J̇ q̇`` (6,) [N, Nm]."""
    gravity: Array
    """``G(x) = J̄ᵀ g`` (6,) [N, Nm]."""
    jacobian: Array
    """``J`` (6, nv): ``ẋ = J q̇``."""
    jacobian_dot: Array
    """``J̇`` (6, nv): ``ẍ = J q̈ + J̇ q̇``."""
    jacobian_inverse: Array
    """``J̄ = M⁻¹ Jᵀ M(x)`` (nv, 6), the dynamically consistent inverse; ``J⁻¹`` for six joints."""
    damped: bool | np.ndarray
    """Whether a direction was damped, see :func:`operational_space`; one per sample."""
    singular_value: float | Array
    """Smallest singular value of ``J`` [metres and radians side by side]; zero with fewer than six joints."""


def operational_space(
    mass_matrix: Array,
    coriolis: Array,
    *,
    gravity: Array,
    jacobian: Array,
    jacobian_dot: Array,
    velocity: Array,
) -> OperationalSpace:
    r"""Carry joint-space dynamics over to the end-effector.

    With :math:`A = J M^{-1} J^T` (the mobility) and :math:`\bar J = M^{-1} J^T A^{-1}`,

    .. math::
        M(x) = A^{-1}, \qquad C(x,\dot x)\dot x = \bar J^T C\dot q - M(x)\dot J\dot q, \qquad
        G(x) = \bar J^T g ,

    so that with six joints and :math:`\ddot x_d = 0` the feed-forward is exactly
    :math:`J^T F_{ff} = C\dot q + g - J^T M(x) \dot J\dot q`. A redundant arm keeps the joint torques that do
    not reach the end-effector to itself.

    Next to a singularity some direction cannot be moved and its apparent mass grows without bound. There the
    eigenvalues of A are held at :data:`SMALLEST_MOBILITY`: M(x) stays bounded and continuous, all other
    directions stay exact, ``damped`` says so, and a :class:`SingularityWarning` is given. An arm with fewer
    than six joints is always in this state.

    Parameters
    ----------
    mass_matrix : ndarray, shape (..., nv, nv)
    coriolis, gravity, velocity : ndarray, shape (..., nv)
        Joint torques :math:`C\dot q` and g [Nm], and :math:`\dot q` [rad/s].
    jacobian, jacobian_dot : ndarray, shape (..., 6, nv)

    Returns
    -------
    OperationalSpace

    References
    ----------
    O. Khatib, "A unified approach for motion and force control of robot manipulators: the operational space
    formulation", IEEE Journal of Robotics and Automation 3(1), 1987.
    """
    reaction = np.linalg.solve(mass_matrix, np.swapaxes(jacobian, -1, -2))
    mobility = jacobian @ reaction
    values, vectors = np.linalg.eigh(0.5 * (mobility + np.swapaxes(mobility, -1, -2)))
    damped = values[..., 0] < SMALLEST_MOBILITY
    if np.any(damped):
        warnings.warn(
            "the arm is at a singularity (or has fewer than six joints): operational-space terms are damped "
            "there; see OperationalSpace.damped",
            SingularityWarning,
            stacklevel=3,
        )
    scaled = vectors / np.maximum(values, SMALLEST_MOBILITY)[..., None, :]
    mass = scaled @ np.swapaxes(vectors, -1, -2)
    inverse = reaction @ mass
    to_task = np.swapaxes(inverse, -1, -2)
    bias_acceleration = _apply(jacobian_dot, velocity)
    return OperationalSpace(
        mass=mass,
        coriolis=_apply(to_task, coriolis) - _apply(mass, bias_acceleration),
        gravity=_apply(to_task, gravity),
        jacobian=jacobian,
        jacobian_dot=jacobian_dot,
        jacobian_inverse=inverse,
        damped=damped if damped.ndim else bool(damped),
        singular_value=_smallest_singular_value(jacobian),
    )


def _apply(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]


def _smallest_singular_value(jacobian: Array) -> float | Array:
    if jacobian.shape[-1] < jacobian.shape[-2]:
        return np.zeros(jacobian.shape[:-2])[()]
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[..., -1], dtype=np.float64)[()]
