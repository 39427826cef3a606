"""What hangs on the sensor: its bias, and mass and centre of mass of the tool, from poses at rest; compensation.

A sensor between flange and tool feels, besides the environment's wrench ``F`` on the tool, the tool's weight
and inertia, and its own bias. In its axes, about its own origin,

``f = b_f + R_sᵀ (F_f + m (g − a_c))``,   ``m = b_m + c × R_sᵀ m (g − a_c) + ...``,

where ``R_s`` is the sensor's orientation, ``c`` the centre of mass from the sensor's origin and ``a_c`` its
acceleration. At rest and untouched this is linear in ``(m, m c, b_f, b_m)``: ten numbers, six equations a
pose, so three poses with different directions of gravity identify all (Kubus, Kröger, Wahl, IROS 2008).
Everything here is about the end-effector's frame: a sensor that is mounted elsewhere is brought there first
(:func:`~vic_toolbox.recordings.wrench_to_world`), and the bias is then that of the transported wrench.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vic_toolbox.errors import Array, InputError, finite_array, positive
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.differentiation import WINDOW, pose_twist, second_derivative
from vic_toolbox.recordings.filtering import acceleration
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.transport import tool_wrench
from vic_toolbox.spatial import skew

GRAVITY = (0.0, 0.0, -9.80665)
MARGIN = 0.1
"""Left out at both ends of a rest [s]: the motion dies out there."""
LEAST_TILT = 0.05
"""Smallest singular value of the directions of gravity, relative to their largest, that tells mass from bias."""


@dataclass(frozen=True)
class Payload:
    """Bias of the sensor, and what hangs on it, in the end-effector's frame."""

    mass: float
    """[kg]"""
    centre: tuple[float, float, float]
    """Centre of mass from the end-effector's origin, in its axes [m]; zeros for a massless tool."""
    bias: tuple[float, ...]
    """``[b_f; b_m]`` in the end-effector's axes, about its origin [N, Nm]."""
    residual: tuple[float, float] = (0.0, 0.0)
    """Root mean square that the poses leave unexplained [N, Nm]."""
    poses: int = 0
    """Number of poses at rest that it was identified from."""


def static_poses(
    recording: Recording, *, speed: float = 2e-3, turning: float = 1e-2, duration: float = 0.3
) -> tuple[NDArray[np.intp], ...]:
    """Samples of every stretch in which the end-effector stands still, without a tenth of a second at its ends.

    Parameters
    ----------
    recording : Recording
    speed, turning : float
        Fastest motion that counts as rest [m/s, rad/s].
    duration : float
        Shortest stretch [s].

    Returns
    -------
    tuple of ndarray
        Indices of the samples of each stretch.
    """
    twist = recording.twist
    if twist is None:
        recording.check()
        twist = pose_twist(recording.time, recording.position, recording.quat_wxyz, window=WINDOW)
    still = np.linalg.norm(twist[:, :3], axis=1) < positive("speed", speed)
    still &= np.linalg.norm(twist[:, 3:], axis=1) < positive("turning", turning)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    ends = round(MARGIN * recording.rate)
    stretches = [np.arange(a + ends, b - ends) for a, b in edges.reshape(-1, 2) if b - a > 2 * ends + 1]
    return tuple(s for s in stretches if recording.time[s[-1]] - recording.time[s[0]] >= duration)


def identify_payload(
    recording: Recording, *, gravity: ArrayLike = GRAVITY, speed: float = 2e-3, duration: float = 0.3
) -> Payload:
    """Bias, mass and centre of mass from poses at rest in which nothing touches the tool.

    Parameters
    ----------
    recording : Recording
        Holds still in at least three poses with different directions of gravity (the tool tilted, not only
        turned about the vertical).
    gravity : array_like, shape (3,)
        ``g`` in world axes [m/s²].
    speed : float
        Fastest motion that counts as rest [m/s].
    duration : float
        Shortest rest [s], without a tenth of a second at its ends.

    Raises
    ------
    InputError
        Too few poses, or their directions of gravity do not tell the mass from the bias.
    """
    g = finite_array("gravity", gravity, shape=(3,))
    stretches = static_poses(recording, speed=speed, duration=duration)
    if len(stretches) < 3:
        raise InputError(
            f"the end-effector stands still in {len(stretches)} places; hold it untouched in at least three poses "
            f"with the tool tilted differently, {duration + 2 * MARGIN:g} s each."
        )
    wrench = tool_wrench(recording)
    measured = np.array([wrench[s].mean(axis=0) for s in stretches])
    down = np.array([_gravity_in_tool(recording, g)[s].mean(axis=0) for s in stretches])
    directions = (down - down.mean(axis=0)) / np.linalg.norm(g)
    spread = np.linalg.svd(directions, compute_uv=False) / np.sqrt(len(down))
    if spread[1] < LEAST_TILT:
        raise InputError(
            f"gravity points the same way, or turns in one plane too little, in all {len(down)} poses "
            f"(its direction spreads by {spread[0]:.2g} and {spread[1]:.2g}); "
            "tilt the tool by 20° or more about two axes."
        )
    # per pose: f = m γ + b_f;  m = −[γ] (m c) + b_m
    count = len(down)
    rows = np.zeros((count, 6, 10))
    rows[:, :3, 0] = down
    rows[:, 3:, 1:4] = -skew(down)
    rows[:, :, 4:] = np.eye(6)
    solution, *_ = np.linalg.lstsq(rows.reshape(-1, 10), measured.ravel(), rcond=None)
    left = measured - rows @ solution
    mass = float(solution[0])
    centre = solution[1:4] / mass if abs(mass) > 1e-6 else np.zeros(3)
    return Payload(
        mass=mass,
        centre=(float(centre[0]), float(centre[1]), float(centre[2])),
        bias=tuple(solution[4:].tolist()),
        residual=(float(np.sqrt(np.mean(left[:, :3] ** 2))), float(np.sqrt(np.mean(left[:, 3:] ** 2)))),
        poses=count,
    )


def compensate_payload(
    recording: Recording,
    payload: Payload,
    *,
    gravity: ArrayLike = GRAVITY,
    inertia: bool = True,
    window: float = WINDOW,
) -> Recording:
    """Take bias, weight and (for a point mass at its centre) inertia of the tool out of the wrench.

    ``f' = f − b_f − m (g − a_c)``,  ``m' = m − b_m − c × m (g − a_c)``,  ``a_c = p̈ + d²(R c)/dt²``.

    What is left is what the environment does to the tool.

    Parameters
    ----------
    recording : Recording
    payload : Payload
    gravity : array_like, shape (3,)
        ``g`` in world axes [m/s²].
    inertia : bool
        Without it the acceleration is taken for zero.
    window : float
        Of the acceleration [s].
    """
    recording.check()
    g = finite_array("gravity", gravity, shape=(3,))
    orientation = quaternions.normalised(recording.quat_wxyz)
    arm = quaternions.rotate(orientation, np.broadcast_to(payload.centre, recording.position.shape))
    felt = np.broadcast_to(g, arm.shape)
    if inertia:
        felt = g - second_derivative(recording.time, recording.position + arm, window=window)
    force = payload.mass * felt
    weight = np.hstack([force, np.cross(arm, force)])
    bias = quaternions.rotate_halves(orientation, np.broadcast_to(payload.bias, recording.wrench.shape))
    taken = weight + bias
    if recording.wrench_axes == "tool":
        taken = quaternions.rotate_halves(quaternions.conjugate(orientation), taken)
    note = f"took out bias and a payload of {payload.mass:.4g} kg{'' if inertia else ', at rest'}"
    return recording.noted(note, wrench=recording.wrench - taken)


def subtract_bias(recording: Recording, bias: ArrayLike) -> Recording:
    """Take a constant ``[f; m]`` (6,) [N, Nm], in the axes of the recording's wrench, out of it."""
    constant = finite_array("bias", bias, shape=(6,))
    note = f"took out the bias {np.round(constant, 4).tolist()}"
    return recording.noted(note, wrench=recording.wrench - constant)


def compensate_inertia(recording: Recording, inertia: ArrayLike, *, window: float = WINDOW) -> Recording:
    """Take ``M [p̈; ω̇]`` out of the wrench: what moved an inertia was not held by the spring.

    Where the measured wrench is applied to an inertia ``M`` on a spring, ``wrench = M ẍ + K e + B ė``: a fit
    that leaves M out finds ``K − M ω²`` at the frequency ω.

    Parameters
    ----------
    recording : Recording
        With the wrench in world axes.
    inertia : array_like, shape (6,) or (6, 6)
        Between the point where the wrench is measured and the spring, at the end-effector, world axes
        [kg, kg m²]; a vector is a diagonal.
    window : float
        Of the acceleration [s].

    Raises
    ------
    InputError
        Wrong shape, or the wrench is not in world axes.
    """
    matrix = np.asarray(inertia)
    matrix = finite_array("inertia", inertia, shape=(6,) if matrix.ndim == 1 else (6, 6))
    if recording.wrench_axes != "world":
        raise InputError("the wrench is in tool axes; bring it to world axes first (wrench_to_world).")
    moving = acceleration(recording, window=window)
    taken = moving * matrix if matrix.ndim == 1 else moving @ matrix.T
    return recording.noted("took out inertia", wrench=recording.wrench - taken)


def _gravity_in_tool(recording: Recording, gravity: Array) -> Array:
    inverse = quaternions.conjugate(quaternions.normalised(recording.quat_wxyz))
    return quaternions.rotate(inverse, np.broadcast_to(gravity, recording.position.shape))
