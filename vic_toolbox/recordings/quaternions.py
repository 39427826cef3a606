"""Long tracks of unit quaternions (w, x, y, z): products, logarithm, interpolation, angular velocity.

Recordings have hundreds of thousands of orientations. Quaternions need less than half the memory of rotation
matrices, so these few functions work on them directly; :mod:`vic_toolbox.spatial` has everything else.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def multiply(a: Array, b: Array) -> Array:
    """Product ``a ⊗ b`` (..., 4): the rotation b, then a."""
    aw, av, bw, bv = a[..., :1], a[..., 1:], b[..., :1], b[..., 1:]
    scalar = aw * bw - (av * bv).sum(axis=-1, keepdims=True)
    return np.concatenate([scalar, aw * bv + bw * av + np.cross(av, bv)], axis=-1)


def conjugate(quat_wxyz: Array) -> Array:
    """Inverse rotation (..., 4) of unit quaternions."""
    return quat_wxyz * np.array([1.0, -1.0, -1.0, -1.0])


def rotate(quat_wxyz: Array, vector: Array) -> Array:
    """``R v`` (..., 3): ``v + 2 q_w (q_v × v) + 2 q_v × (q_v × v)``."""
    twice = 2.0 * np.cross(quat_wxyz[..., 1:], vector)
    return vector + quat_wxyz[..., :1] * twice + np.cross(quat_wxyz[..., 1:], twice)


def rotate_halves(quat_wxyz: Array, six: Array) -> Array:
    """``[R a; R b]`` (..., 6) of a wrench, twist or pose error ``[a; b]``."""
    return np.concatenate([rotate(quat_wxyz, six[..., :3]), rotate(quat_wxyz, six[..., 3:])], axis=-1)


def exp(vector: Array) -> Array:
    """Unit quaternion (..., 4) of a rotation vector [rad]."""
    half = np.linalg.norm(vector, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), np.sinc(half / np.pi) * vector / 2], axis=-1)


def log(quat_wxyz: Array) -> Array:
    """Rotation vector (..., 3) [rad], of length at most π."""
    q = np.where(quat_wxyz[..., :1] < 0, -quat_wxyz, quat_wxyz)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    small = sine < 1e-12
    ratio = np.where(small, 1.0, np.arctan2(sine, q[..., :1])) / np.where(small, 1.0, sine)
    return 2.0 * ratio * q[..., 1:]


def normalised(quat_wxyz: Array) -> Array:
    """The same directions with unit norm; rows of zeros stay as they are."""
    norm = np.linalg.norm(quat_wxyz, axis=-1, keepdims=True)
    return quat_wxyz / np.where(norm == 0, 1.0, norm)


def sign_flips(track: Array) -> NDArray[np.intp]:
    """Indices of the samples where a track (n, 4) jumps to the antipode, ``q_i · q_{i−1} < 0``."""
    return 1 + np.flatnonzero((track[1:] * track[:-1]).sum(axis=-1) < 0)


def continuous(track: Array) -> Array:
    """The same orientations (n, 4) without jumps from ``q`` to ``−q``."""
    sign = np.ones(len(track))
    sign[sign_flips(track)] = -1.0
    return np.cumprod(sign)[:, None] * track


def interpolate(times: Array, track: Array, wanted: Array) -> Array:
    """Orientations (m, 4) at other times, by slerp; before the first and after the last sample they are held.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Increasing [s].
    track : ndarray, shape (n, 4)
        Unit quaternions.
    wanted : ndarray, shape (m,)
        Times [s].
    """
    if len(times) == 1:
        return np.broadcast_to(track, (len(wanted), 4)).copy()
    before = np.clip(np.searchsorted(times, wanted, side="right") - 1, 0, len(times) - 2)
    share = np.clip((wanted - times[before]) / (times[before + 1] - times[before]), 0.0, 1.0)[:, None]
    step = log(multiply(track[before + 1], conjugate(track[before])))
    return multiply(exp(share * step), track[before])
