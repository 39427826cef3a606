"""Start postures: from a point in space to joint angles that are safe to start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array, ReachError, finite_array
from vic_toolbox.models import RobotModel

SMALLEST_SINGULAR_VALUE = 0.05
"""Smallest singular value of the Jacobian [m, rad mixed] that a start may have."""

LIMIT_MARGIN = 0.1
"""Distance that a start keeps from every joint limit [rad]."""

OTHER_CONFIGURATION = np.pi / 2
"""Difference of a joint angle (the last one aside) at which elbow or wrist count as turned over [rad]."""


@dataclass(frozen=True)
class Scenario:
    """Where an episode starts.

    Attributes
    ----------
    start : tuple of float
        Position of the end-effector, tool down [m].
    name : str
        What tables and files call it; without one, its coordinates "x,y,z" [m] to a micrometre.
    """

    start: tuple[float, float, float]
    name: str = ""

    def __post_init__(self) -> None:
        start = finite_array("start", self.start, shape=(3,))
        object.__setattr__(self, "start", tuple(start.tolist()))
        if not self.name:
            object.__setattr__(self, "name", ",".join(_number(x) for x in self.start))

    @property
    def description(self) -> str:
        """Where it is, for people."""
        return ", ".join(f"{x:.2f}" for x in self.start).replace("-", "−") + " m"


def _number(x: float) -> str:
    """To a micrometre, without trailing zeros."""
    return f"{round(x, 6) + 0.0:.6f}".rstrip("0").rstrip(".")  # + 0.0: minus nothing is nothing


def start_posture(robot: RobotModel, position: Array, *, rotation: Array, like: Array) -> Array:
    """Joint angles that put the end-effector at a pose, away from limits and singularities.

    Parameters
    ----------
    robot : RobotModel
        Arm with its tool.
    position, rotation : ndarray, shapes (3,) and (3, 3)
        Wanted pose of the end-effector.
    like : ndarray, shape (nv,)
        Posture whose configuration (elbow, wrist) the solution keeps.

    Returns
    -------
    ndarray, shape (nv,)

    Raises
    ------
    ReachError
        Out of reach, next to a joint limit or a singularity, or only in another configuration.
    """
    where = f"the start ({', '.join(f'{x:.3f}' for x in position)}) m"
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    try:
        q = robot.inverse_kinematics(pose, start=like)
    except ReachError as error:
        raise ReachError(
            f"{where} is out of reach with the tool down ({error}); move it towards the arm."
        ) from error
    near = np.flatnonzero((q < robot.lower + LIMIT_MARGIN) | (q > robot.upper - LIMIT_MARGIN))
    if near.size:
        names = ", ".join(robot.joint_names[i] for i in near)
        raise ReachError(
            f"{where} is within {LIMIT_MARGIN} rad of a limit of {names}; move it away from there."
        )
    if (np.abs(q - like)[:-1] > OTHER_CONFIGURATION).any():
        raise ReachError(f"{where} is reached only with the elbow or the wrist turned over; move it.")
    smallest = np.linalg.svd(robot.jacobian(q), compute_uv=False)[-1]
    if smallest < SMALLEST_SINGULAR_VALUE:
        raise ReachError(
            f"{where} is next to a singularity (smallest singular value {smallest:.3f}, at least "
            f"{SMALLEST_SINGULAR_VALUE} is needed); move it away from full stretch and from the base's axis."
        )
    return q
