"""From the name of an arm, and maybe of a tool, to its model."""

from __future__ import annotations

from pathlib import Path

from numpy.typing import ArrayLike

from vic_toolbox.models.catalogue import find_robot
from vic_toolbox.models.robot import RobotModel


def load_robot(
    name: str | Path,
    *,
    tool: str | Path | None = None,
    frame: str | None = None,
    armature: ArrayLike | None = None,
) -> RobotModel:
    """Load a serial arm, maybe with a tool.

    Parameters
    ----------
    name : str or Path
        A name from :func:`available_robots` (``"fanuc_lrmate200id7l"``, ``"panda"``, ``"ur5"``), or the path
        of a URDF, or of a folder with a ``robot.toml``. The fingers of an arm that has them are locked.
    tool : str or Path, optional
        A tool of the catalogue (``"cup_gripper"``) or the path of a rigid URDF; its root link goes to the
        arm's mount.
    frame : str, optional
        End-effector; by default the tool's, else the arm's.
    armature : array_like, shape (nv,), optional
        Rotor inertia on the joint side [kg m²], instead of the described one.

    Returns
    -------
    RobotModel

    Raises
    ------
    InputError
        Unknown name, or an armature that is none.
    FileError
        The path leads nowhere.
    ModelError
        The URDF holds no serial arm, the tool is not rigid, or a frame is unknown.

    Examples
    --------
    >>> arm = load_robot("fanuc_lrmate200id7l", tool="cup_gripper")
    >>> arm
    RobotModel(fanuc_lrmate200id7l with cup_gripper, 6 joints, end-effector cup_bottom)
    >>> float(arm.pose(arm.home)[2, 3].round(3))
    0.509
    """
    carried = find_robot(tool, "tool") if tool is not None else None
    return RobotModel(find_robot(name), carried, frame=frame, armature=armature)
