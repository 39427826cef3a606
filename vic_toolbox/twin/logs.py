"""What a session leaves on disk: logs as the controller wrote them, and how their sensor is mounted."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from vic_toolbox.errors import Array, FileError
from vic_toolbox.files import write_arrays, write_atomically
from vic_toolbox.spatial import rotation_to_quat_wxyz
from vic_toolbox.tasks import cup_scene
from vic_toolbox.twin.loop import in_steps
from vic_toolbox.twin.parameters import Imperfections
from vic_toolbox.twin.plant import SENSOR_OFFSET, SENSOR_ROTATION

LAYOUT = "layout.toml"
CALIBRATION = "calibration.npz"


@dataclass(frozen=True, eq=False)
class Log:
    """One log of the controller: joint angles as measured, and the F/T sensor as it reads."""

    time: Array
    """(n,) [s]"""
    joint_position: Array
    """(n, 6) [rad]"""
    wrench: Array
    """(n, 6) in the sensor's axes about its origin: what the outside does to the tool, weight and bias [N, Nm]."""

    def save(self, path: str | os.PathLike[str], *, single: bool = True) -> None:
        """Write an ``.npz`` that :func:`vic_toolbox.recordings.read` understands with the layout beside it.

        The pose of the cup's bottom comes from the measured angles and the nominal geometry, as a controller
        computes it; the reference is the goal.

        Parameters
        ----------
        path : path-like
        single : bool
            Numbers of 4 bytes, as loggers write them (time keeps 8); enough for 0.1 µm.
        """
        pose = cup_scene.robot().pose(self.joint_position)
        count = len(self.time)
        content = {
            "joint_position": self.joint_position,
            "position": pose[:, :3, 3],
            "quat_wxyz": rotation_to_quat_wxyz(pose[:, :3, :3]),
            "reference_position": np.tile(cup_scene.GOAL, (count, 1)),
            "reference_quat_wxyz": np.tile(cup_scene.TOOL_DOWN_QUAT_WXYZ, (count, 1)),
            "wrench": self.wrench,
        }
        kind = np.float32 if single else np.float64
        numbers = {name: array.astype(kind) for name, array in content.items()}
        write_arrays(path, {"time": self.time} | numbers)


def sensed(transmitted: Array, bias: Array, flaws: Imperfections, rng: np.random.Generator) -> Array:
    """What the F/T sensor logs of the wrench that it transmits, (..., 6): bias, noise, steps."""
    noise = np.repeat([flaws.force_noise, flaws.moment_noise], 3)
    steps = np.repeat([flaws.force_resolution, flaws.moment_resolution], 3)
    return in_steps(transmitted + bias + noise * rng.standard_normal(transmitted.shape), steps)


def write_layout(path: str | os.PathLike[str]) -> None:
    """Write how to read these logs: mounting, axes and sign of the sensor."""
    rows = ", ".join(f"[{', '.join(f'{x:g}' for x in row)}]" for row in SENSOR_ROTATION)
    write_atomically(
        path,
        "# How to read these logs: vic_toolbox.recordings.read(log, layout=this_file)\n"
        'wrench_axes = "tool"        # as the sensor gave it, never turned\n'
        f"sensor_rotation = [{rows}]\n"
        f"sensor_offset = [{', '.join(f'{x:g}' for x in SENSOR_OFFSET)}]  # [m], from the cup's bottom\n"
        "# The sensor reports what the hand does to the gripper, F_fb = -K e - B de/dt of the guiding human;\n"
        "# a recording holds K e + B de/dt.\n"
        "wrench_sign = -1\n\n"
        "[columns]\n"
        + "".join(
            f'{name} = "{name}"\n'
            for name in (
                "time", "joint_position", "position", "quat_wxyz",
                "reference_position", "reference_quat_wxyz", "wrench",
            )
        ),
    )  # fmt: skip


def demonstration_paths(folder: str | os.PathLike[str]) -> list[Path]:
    """The demonstrations of a session, in order.

    Raises
    ------
    FileError
        There is none.
    """
    found = sorted(Path(folder).glob("demonstration_*.npz"))
    if not found:
        raise FileError(f"{folder} holds no demonstration_*.npz; make some: vic twin record --out {folder}")
    return found
