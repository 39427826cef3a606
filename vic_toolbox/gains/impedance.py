"""The impedance gains themselves: stiffness and damping, checked once and never changed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, common_batch, finite_array, positive_array
from vic_toolbox.gains.positive_definite import spd_matrix
from vic_toolbox.spatial import check_rotation, twist_transport_matrix

AXES = ("x", "y", "z", "rx", "ry", "rz")
"""The six directions of a pose error, a twist or a wrench, in order."""


@dataclass(frozen=True, eq=False)
class ImpedanceGains:
    """Stiffness K and damping B of the law ``F_fb = −K e − B ė``.

    Both are symmetric positive definite, so the closed loop stores and dissipates energy and never makes any.
    They act at the end-effector, in world axes unless said otherwise. The arrays are read-only copies.

    Parameters
    ----------
    stiffness : array_like, shape (..., 6, 6)
        K: blocks in N/m, N/rad, Nm/m and Nm/rad.
    damping : array_like, shape (..., 6, 6)
        B: blocks in Ns/m, Ns/rad, Nms/m and Nms/rad.

    Raises
    ------
    InputError
        Not finite, not symmetric, not positive definite, or batch shapes that do not fit each other.
    """

    stiffness: Array
    damping: Array

    def __post_init__(self) -> None:
        stiffness = spd_matrix("stiffness", self.stiffness, size=6)
        damping = spd_matrix("damping", self.damping, size=6)
        batch = common_batch(stiffness=stiffness.shape[:-2], damping=damping.shape[:-2])
        for name, matrix in (("stiffness", stiffness), ("damping", damping)):
            frozen = np.array(np.broadcast_to(matrix, (*batch, 6, 6)))
            frozen.flags.writeable = False
            object.__setattr__(self, name, frozen)

    @classmethod
    def diagonal(cls, stiffness: ArrayLike, damping: ArrayLike) -> ImpedanceGains:
        """Return gains that act on each axis alone.

        Parameters
        ----------
        stiffness : array_like, shape (..., 6)
            Positive: N/m for x, y, z, then Nm/rad.
        damping : array_like, shape (..., 6)
            Positive: Ns/m for x, y, z, then Nms/rad.
        """
        k = positive_array("stiffness", stiffness, shape=(..., 6))
        b = positive_array("damping", damping, shape=(..., 6))
        return cls(k[..., None] * np.eye(6), b[..., None] * np.eye(6))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Leading dimensions: ``()`` for one sample, ``(n,)`` for a batch."""
        return self.stiffness.shape[:-2]

    @property
    def stiffness_diagonal(self) -> Array:
        """Diagonal of K, shape (..., 6)."""
        return np.diagonal(self.stiffness, axis1=-2, axis2=-1)

    @property
    def damping_diagonal(self) -> Array:
        """Diagonal of B, shape (..., 6)."""
        return np.diagonal(self.damping, axis1=-2, axis2=-1)

    def rotated(self, rotation: ArrayLike) -> ImpedanceGains:
        """Return the same gains in other axes: ``diag(R, R) K diag(R, R)ᵀ``, and B alike.

        Parameters
        ----------
        rotation : array_like, shape (..., 3, 3)
            Orientation, in the new axes, of the frame in which these gains are written: with gains in a
            compliance frame and its orientation in the world, the result is in world axes.
        """
        r = check_rotation("rotation", rotation)
        both = np.zeros((*r.shape[:-2], 6, 6))
        both[..., :3, :3] = both[..., 3:, 3:] = r
        return self._congruent(both)

    def transported(self, offset: ArrayLike) -> ImpedanceGains:
        """Return what these gains feel like at another point of the same body: ``Tᵀ K T``, and B alike.

        T carries a twist from the new point to the one where these gains act (see
        :func:`vic_toolbox.spatial.twist_transport_matrix`), for small displacements.

        Parameters
        ----------
        offset : array_like, shape (..., 3)
            From the point where these gains act to the new one [m], in the axes of the gains.
        """
        back = twist_transport_matrix(-finite_array("offset", offset, shape=(..., 3)))
        return self._congruent(np.swapaxes(back, -1, -2))

    def _congruent(self, a: Array) -> ImpedanceGains:
        common_batch(gains=self.batch_shape, transformation=a.shape[:-2])
        transposed = np.swapaxes(a, -1, -2)
        return ImpedanceGains(
            _symmetric(a @ self.stiffness @ transposed), _symmetric(a @ self.damping @ transposed)
        )


def _symmetric(matrix: Array) -> Array:
    """Drop the rounding that a product of matrices leaves in the antisymmetric part."""
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))
