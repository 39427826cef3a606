"""Rotations, poses, pose error, and the change of point and of axes of twists and wrenches.

A pose is a homogeneous matrix ``(..., 4, 4)``: rotation ``R`` and position ``p`` [m] of a frame, seen from
the world. A twist is ``[v; ω]`` [m/s, rad/s], a wrench ``[f; m]`` [N, Nm], linear part first, both *at* a
point and *in* some axes. Every function takes one sample or a batch with any leading dimensions, which
broadcast against each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, common_batch, finite_array

ROTATION_TOLERANCE = 1e-6
"""Largest entry of ``R Rᵀ − I`` that still counts as a rotation matrix."""

QUATERNION_TOLERANCE = 1e-2
"""Largest departure from unit norm that is taken for rounding and normalised away."""


def skew(vector: ArrayLike) -> Array:
    """Return the matrix (..., 3, 3) of the cross product: ``skew(a) @ b = a × b``.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
    """
    a = finite_array("vector", vector, shape=(..., 3))
    matrix = np.zeros((*a.shape, 3))
    matrix[..., 2, 1] = a[..., 0]
    matrix[..., 0, 2] = a[..., 1]
    matrix[..., 1, 0] = a[..., 2]
    return matrix - np.swapaxes(matrix, -1, -2)


def rotation_exp(vector: ArrayLike) -> Array:
    """Return the rotation by the angle ``‖w‖`` about the axis ``w/‖w‖``.

    Rodrigues' formula ``R = I + sin θ/θ [w] + (1 − cos θ)/θ² [w]²``, written with ``sinc`` so that it is
    exact down to θ = 0.

    Parameters
    ----------
    vector : array_like, shape (..., 3)
        Rotation vector ``w`` [rad], of any length.

    Returns
    -------
    ndarray, shape (..., 3, 3)
    """
    w = finite_array("rotation vector", vector, shape=(..., 3))
    angle = np.linalg.norm(w, axis=-1)[..., None, None]
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    generator = skew(w)
    return np.eye(3) + first * generator + second * (generator @ generator)


def rotation_log(rotation: ArrayLike) -> Array:
    """Return the rotation vector ``w`` of a rotation matrix, with ``‖w‖ ≤ π``.

    It goes through the unit quaternion, ``w = 2 atan2(‖q_v‖, q_w) q_v/‖q_v‖``, which keeps full accuracy
    both near 0 and near π. At exactly π both signs are right, and one of them is returned.

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 3)
        Rotation vector [rad].
    """
    quaternion = rotation_to_quat_wxyz(rotation)
    scalar, vector = quaternion[..., :1], quaternion[..., 1:]
    sine = np.linalg.norm(vector, axis=-1, keepdims=True)
    small = sine < 1e-12  # there atan2(s, c)/s = 1/c to double precision
    ratio = np.where(small, 1.0, np.arctan2(sine, scalar)) / np.where(small, 1.0, sine)
    return 2.0 * ratio * vector


def rotation_to_quat_wxyz(rotation: ArrayLike) -> Array:
    """Return the unit quaternion (w, x, y, z), ``w ≥ 0``, of a rotation matrix.

    The matrix ``4 q qᵀ`` is linear in R; its row with the largest diagonal entry is the best conditioned
    multiple of q (Shepperd's method without branches).

    Parameters
    ----------
    rotation : array_like, shape (..., 3, 3)

    Returns
    -------
    ndarray, shape (..., 4)
    """
    r = check_rotation("rotation", rotation)
    outer = np.empty((*r.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1 + r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        outer[..., i + 1, i + 1] = 1 + r[..., i, i] - r[..., j, j] - r[..., k, k]
        outer[..., 0, i + 1] = outer[..., i + 1, 0] = r[..., k, j] - r[..., j, k]
        outer[..., j + 1, k + 1] = outer[..., k + 1, j + 1] = r[..., j, k] + r[..., k, j]
    largest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    quaternion = np.take_along_axis(outer, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return np.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def quat_wxyz_to_rotation(quaternion: ArrayLike) -> Array:
    """Return the rotation matrix of a unit quaternion (w, x, y, z).

    Parameters
    ----------
    quaternion : array_like, shape (..., 4)
        Rounding is normalised away; a norm farther than 1e-2 from one is refused.

    Returns
    -------
    ndarray, shape (..., 3, 3)

    Raises
    ------
    InputError
        Not a unit quaternion.
    """
    q = finite_array("quaternion", quaternion, shape=(..., 4))
    norm = np.linalg.norm(q, axis=-1, keepdims=True)
    off = np.abs(norm - 1)
    if (off > QUATERNION_TOLERANCE).any():
        raise InputError(
            f"quaternion has norm {norm.flat[off.argmax()]:.4g}; "
            "pass unit quaternions (w, x, y, z): divide by the norm."
        )
    q = q / norm
    generator = skew(q[..., 1:])
    return np.eye(3) + 2 * (q[..., :1, None] * generator + generator @ generator)


def check_rotation(name: str, value: ArrayLike) -> Array:
    """Return `value` as rotation matrices (..., 3, 3): orthonormal and right-handed.

    Raises
    ------
    InputError
        ``R Rᵀ`` departs from the identity by more than 1e-6, or R is a reflection.
    """
    r = finite_array(name, value, shape=(..., 3, 3))
    departure = np.abs(r @ np.swapaxes(r, -1, -2) - np.eye(3)).max(initial=0.0)
    if departure > ROTATION_TOLERANCE:
        raise InputError(
            f"{name} is not a rotation matrix: R Rᵀ departs from the identity by {departure:.2g}; "
            "pass orthonormal matrices (rotation_exp and quat_wxyz_to_rotation make them)."
        )
    if (np.linalg.det(r) < 0).any():
        raise InputError(f"{name} is a reflection (determinant −1); pass a right-handed rotation matrix.")
    return r


def check_pose(name: str, value: ArrayLike) -> Array:
    """Return `value` as poses (..., 4, 4): a rotation, a position, and the last row (0, 0, 0, 1).

    Raises
    ------
    InputError
        Wrong shape, wrong last row, or the upper left block is not a rotation.
    """
    pose = finite_array(name, value, shape=(..., 4, 4))
    if not (pose[..., 3, :] == (0.0, 0.0, 0.0, 1.0)).all():
        raise InputError(
            f"the last row of {name} must be (0, 0, 0, 1); pass a homogeneous matrix (see pose_from)."
        )
    check_rotation(f"the rotation of {name}", pose[..., :3, :3])
    return pose


def pose_from(position: ArrayLike, rotation: ArrayLike) -> Array:
    """Return the homogeneous matrix of a position and a rotation.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Origin of the frame [m].
    rotation : array_like, shape (..., 3, 3)
        Its columns are the axes of the frame.

    Returns
    -------
    ndarray, shape (..., 4, 4)
    """
    p = finite_array("position", position, shape=(..., 3))
    r = check_rotation("rotation", rotation)
    pose = np.zeros((*common_batch(position=p.shape[:-1], rotation=r.shape[:-2]), 4, 4))
    pose[..., :3, :3] = r
    pose[..., :3, 3] = p
    pose[..., 3, 3] = 1.0
    return pose


def pose_error(pose: ArrayLike, reference: ArrayLike) -> Array:
    """Return ``e = [p − p_d ; log(R R_dᵀ)]`` in world axes.

    Parameters
    ----------
    pose, reference : array_like, shape (..., 4, 4)
        Actual pose (p, R) and wanted pose (p_d, R_d).

    Returns
    -------
    ndarray, shape (..., 6)
        Translation [m], then rotation vector [rad], of at most π.
    """
    actual, wanted = check_pose("pose", pose), check_pose("reference", reference)
    batch = common_batch(pose=actual.shape[:-2], reference=wanted.shape[:-2])
    error = np.empty((*batch, 6))
    error[..., :3] = actual[..., :3, 3] - wanted[..., :3, 3]
    error[..., 3:] = rotation_log(actual[..., :3, :3] @ np.swapaxes(wanted[..., :3, :3], -1, -2))
    return error


def transport_twist(twist: ArrayLike, offset: ArrayLike) -> Array:
    """Return the twist of the same body at another of its points: ``v' = v + ω × r``, ``ω' = ω``.

    Parameters
    ----------
    twist : array_like, shape (..., 6)
        Twist at the old point.
    offset : array_like, shape (..., 3)
        ``r``: from the old point to the new one [m], in the axes of the twist.

    Returns
    -------
    ndarray, shape (..., 6)
    """
    old = finite_array("twist", twist, shape=(..., 6))
    r = finite_array("offset", offset, shape=(..., 3))
    common_batch(twist=old.shape[:-1], offset=r.shape[:-1])
    linear = old[..., :3] + np.cross(old[..., 3:], r)
    return np.concatenate([linear, np.broadcast_to(old[..., 3:], linear.shape)], axis=-1)


def transport_wrench(wrench: ArrayLike, offset: ArrayLike) -> Array:
    """Return the same wrench about another point: ``f' = f``, ``m' = m − r × f``.

    Power is the same at both points: ``transport_wrench(w, r) · transport_twist(t, r) = w · t``.

    Parameters
    ----------
    wrench : array_like, shape (..., 6)
        Wrench about the old point.
    offset : array_like, shape (..., 3)
        ``r``: from the old point to the new one [m], in the axes of the wrench.

    Returns
    -------
    ndarray, shape (..., 6)
    """
    old = finite_array("wrench", wrench, shape=(..., 6))
    r = finite_array("offset", offset, shape=(..., 3))
    common_batch(wrench=old.shape[:-1], offset=r.shape[:-1])
    moment = old[..., 3:] - np.cross(r, old[..., :3])
    return np.concatenate([np.broadcast_to(old[..., :3], moment.shape), moment], axis=-1)


def twist_transport_matrix(offset: ArrayLike) -> Array:
    """Return the matrix T (..., 6, 6) of :func:`transport_twist`: ``T = [[I, −[r]], [0, I]]``.

    Its transpose takes a wrench about the new point back to the old one, so gains that act at the new point
    are felt at the old one as ``Tᵀ K T``.

    Parameters
    ----------
    offset : array_like, shape (..., 3)
        ``r``: from the old point to the new one [m].
    """
    r = finite_array("offset", offset, shape=(..., 3))
    matrix = np.zeros((*r.shape[:-1], 6, 6))
    matrix[...] = np.eye(6)
    matrix[..., :3, 3:] = -skew(r)
    return matrix


def rotate(vector: ArrayLike, rotation: ArrayLike) -> Array:
    """Return a twist, wrench or pose error in other axes, at the same point: ``[R a; R b]``.

    Parameters
    ----------
    vector : array_like, shape (..., 6)
        ``[a; b]`` in the axes of a frame.
    rotation : array_like, shape (..., 3, 3)
        ``R``: orientation of that frame in the new axes (its transpose goes the other way).

    Returns
    -------
    ndarray, shape (..., 6)
    """
    six = finite_array("vector", vector, shape=(..., 6))
    r = check_rotation("rotation", rotation)
    batch = common_batch(vector=six.shape[:-1], rotation=r.shape[:-2])
    halves = six.reshape(*six.shape[:-1], 2, 3) @ np.swapaxes(r, -1, -2)
    return halves.reshape(*batch, 6)
