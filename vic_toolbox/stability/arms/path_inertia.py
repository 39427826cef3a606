r"""Operational-space inertia along a motion of an arm: M(x), its exact rate, and the Coriolis matrix behind it.

With :math:`A = J M^{-1} J^T`, :math:`M(x) = A^{-1}` and :math:`\bar J = M^{-1} J^T M(x)`,

.. math::
    C(x,\dot x) = \bigl(\bar J^T C(q,\dot q) - M(x)\,\dot J\bigr)\bar J, \qquad
    \dot M(x) = C(x,\dot x) + C(x,\dot x)^T .

The second follows from :math:`\dot M(q) = C + C^T` by differentiating A, for redundant arms too; no differences are
taken.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, finite_array

if TYPE_CHECKING:
    from vic_toolbox.models import RobotModel


@dataclass(frozen=True, eq=False)
class PathInertia:
    """What the end-effector weighs along a motion, world axes; n samples.

    Parameters
    ----------
    mass, mass_rate : ndarray, shape (n, 6, 6)
        M(x) and Ṁ(x).
    coriolis : ndarray, shape (n, 6, 6)
        C(x, ẋ).
    without_coriolis, without_jacobian_rate : ndarray, shape (n, 6)
        Wrench [N, Nm] that remains on the right-hand side, ``M ë + B ė + K e = residual − F_ext``, of a law that
        leaves out all of ``C(x,ẋ) ẋ``, or only its part ``−M(x) J̇ q̇`` (as laws do that take the joint bias as it
        is).
    damped : ndarray of bool, shape (n,)
        Where the arm is so close to a singularity that M(x) is bounded by hand and means little.
    """

    mass: Array
    mass_rate: Array
    coriolis: Array
    without_coriolis: Array
    without_jacobian_rate: Array
    damped: np.ndarray

    def displacement(self, stiffness: ArrayLike) -> tuple[Array, Array]:
        """``K⁻¹ residual`` [m, rad] of both: how far the arm stands off while it moves on slowly, (n, 6) each."""
        k = finite_array("stiffness", stiffness, shape=(..., 6, 6))

        def held(residual: Array) -> Array:
            return np.asarray(np.linalg.solve(k, residual[..., None])[..., 0], dtype=np.float64)

        return held(self.without_coriolis), held(self.without_jacobian_rate)


def path_inertia(model: RobotModel, q: ArrayLike, v: ArrayLike, *, frame: str | None = None) -> PathInertia:
    """Evaluate the operational-space inertia of an arm at states of a motion.

    Parameters
    ----------
    model : RobotModel
        The arm.
    q, v : array_like, shape (n, nv)
        Joint angles [rad] and speeds [rad/s].
    frame : str, optional
        The end-effector by default.

    Raises
    ------
    InputError
        Wrong shapes, or values that are not finite.
    ModelError
        Unknown frame.
    """
    angles = finite_array("q", q, shape=(None, model.nv))
    speeds = finite_array("v", v, shape=(None, model.nv))
    space = model.operational_space(angles, speeds, frame=frame)
    inverse = space.jacobian_inverse
    bias = np.swapaxes(inverse, 1, 2) @ model.coriolis_matrix(angles, speeds)
    coriolis = (bias - space.mass @ space.jacobian_dot) @ inverse
    drift = np.matvec(space.jacobian_dot, speeds)
    return PathInertia(
        mass=space.mass,
        mass_rate=coriolis + np.swapaxes(coriolis, 1, 2),
        coriolis=coriolis,
        without_coriolis=-space.coriolis,
        without_jacobian_rate=np.matvec(space.mass, drift),
        damped=np.asarray(space.damped),
    )
