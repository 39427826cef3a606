"""The wrench of a sensor, brought to the end-effector's origin and to world axes."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import InputError, finite_array
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.spatial import check_rotation, rotate, transport_wrench

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def wrench_to_world(
    recording: Recording, *, rotation: ArrayLike = IDENTITY, offset: ArrayLike = (0.0, 0.0, 0.0)
) -> Recording:
    """Bring the wrench from the sensor to the tool and to the world: ``f = R Q f_s``, ``m = R (Q m_s + r × Q f_s)``.

    ``R`` is the measured orientation of the end-effector. A wrench that the log has turned into world axes
    already, but without knowing how the sensor is mounted, is first turned back with ``Rᵀ``; so
    ``f' = R Q Rᵀ f`` mends it.

    Parameters
    ----------
    recording : Recording
        Its ``wrench_axes`` says which of both it is.
    rotation : array_like, shape (3, 3)
        ``Q``: axes of the sensor, as columns, in those of the end-effector.
    offset : array_like, shape (3,)
        ``r``: from the end-effector's origin to the point that the moment is taken about, in the end-effector's
        axes [m].

    Returns
    -------
    Recording
        With the wrench in world axes, about the end-effector's origin.

    Raises
    ------
    InputError
        `rotation` is no rotation, or the recording has errors.
    """
    recording.check()
    turn = check_rotation("rotation", rotation)
    if turn.shape != (3, 3):
        raise InputError(f"rotation has shape {turn.shape}; pass one rotation (3, 3).")
    r = finite_array("offset", offset, shape=(3,))
    orientation = quaternions.normalised(recording.quat_wxyz)
    wrench = recording.wrench
    if recording.wrench_axes == "world":
        wrench = quaternions.rotate_halves(quaternions.conjugate(orientation), wrench)
    wrench = transport_wrench(rotate(wrench, turn), -r)
    note = f"wrench turned by the sensor's mounting {np.round(turn, 4).tolist()}, moved by {r.tolist()} m"
    return dataclasses.replace(
        recording,
        wrench=quaternions.rotate_halves(orientation, wrench),
        wrench_axes="world",
        notes=(*recording.notes, note),
    )


def tool_wrench(recording: Recording) -> np.ndarray:
    """The wrench (n, 6) in the axes of the end-effector, about its origin [N, Nm]."""
    if recording.wrench_axes == "tool":
        return recording.wrench
    inverse = quaternions.conjugate(quaternions.normalised(recording.quat_wxyz))
    return quaternions.rotate_halves(inverse, recording.wrench)
