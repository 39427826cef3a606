"""Damping design: which B belongs to a stiffness K."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, common_batch, positive_array
from vic_toolbox.gains.positive_definite import matrix_square_root, spd_matrix


def factor_damping(stiffness: ArrayLike, factor: ArrayLike) -> Array:
    """Return ``B = d √K``, with the matrix square root for a full K.

    The form of Zhang et al. (2021). It does not know the inertia: with mass m an axis gets the damping
    ratio ``d / (2 √m)``. See :func:`double_diagonalisation` for a design that does.

    Parameters
    ----------
    stiffness : array_like, shape (..., n, n)
        Symmetric positive definite K.
    factor : array_like, shape (...)
        Damping factor d > 0 [√kg along, √(kg m²) about an axis]; one number, or one for each K of the batch.

    Returns
    -------
    ndarray, shape (..., n, n)

    References
    ----------
    X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
    Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021.
    """
    d = positive_array("damping factor", factor)
    root = matrix_square_root(stiffness)
    common_batch(factor=d.shape, stiffness=root.shape[:-2])
    return d[..., None, None] * root


def double_diagonalisation(stiffness: ArrayLike, mass: ArrayLike, *, damping_ratio: ArrayLike = 1.0) -> Array:
    """Return the B that gives every mode of ``M ë + B ė + K e = 0`` the wanted damping ratio.

    The generalised eigenproblem of (K, M) yields one Q with ``M = Q Qᵀ`` and ``K = Q diag(λ) Qᵀ``; then
    ``B = 2 Q diag(ζ √λ) Qᵀ`` decouples into modes ``s² + 2 ζ √λ s + λ``. Unlike d√K it follows the inertia,
    and it does not depend on the units or the axes in which K and M are written.

    Parameters
    ----------
    stiffness : array_like, shape (..., n, n)
        Symmetric positive definite K.
    mass : array_like, shape (..., n, n)
        Symmetric positive definite M, e.g. the operational-space mass matrix M(x), at the same point and in
        the same axes as K.
    damping_ratio : array_like, optional
        ζ > 0: one number, or one for each mode, slowest first, shape (..., n). 1 is critical damping.

    Returns
    -------
    ndarray, shape (..., n, n)

    References
    ----------
    A. Albu-Schäffer, C. Ott, U. Frese, G. Hirzinger, "Cartesian impedance control of redundant robots: recent
    results with the DLR-light-weight-arms", ICRA 2003 (double diagonalization design).
    """
    k = spd_matrix("stiffness", stiffness)
    m = spd_matrix("mass", mass, size=k.shape[-1])
    ratio = positive_array("damping ratio", damping_ratio)
    batch = common_batch(stiffness=k.shape[:-2], mass=m.shape[:-2])
    common_batch(damping_ratio=ratio.shape, modes=(*batch, k.shape[-1]))

    root = np.linalg.cholesky(m)
    half = np.linalg.solve(root, k)
    normalised = np.linalg.solve(root, np.swapaxes(half, -1, -2))
    values, vectors = np.linalg.eigh(0.5 * (normalised + np.swapaxes(normalised, -1, -2)))
    modes = root @ vectors
    # Rounding can put an eigenvalue of an ill-conditioned pair a hair below zero.
    rates = 2 * ratio * np.sqrt(np.maximum(values, 0.0))
    damping = (modes * rates[..., None, :]) @ np.swapaxes(modes, -1, -2)
    return 0.5 * (damping + np.swapaxes(damping, -1, -2))
