"""Where a log keeps what: columns or topics of each field, units, frame and sign of the wrench."""

from __future__ import annotations

import dataclasses
import difflib
import os
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vic_toolbox.errors import FileError, InputError, finite_array, one_of, positive
from vic_toolbox.recordings.recording import WRENCH_AXES
from vic_toolbox.recordings.transport import IDENTITY
from vic_toolbox.spatial import check_rotation

ORIENTATIONS = {
    "quat_wxyz": (4,),
    "quat_xyzw": (4,),
    "axis_angle": (4,),
    "rotation_vector": (3,),
    "roll_pitch_yaw": (3,),
}
WIDTHS: dict[str, tuple[int, ...] | None] = {
    "time": (1,),
    "position": (3,),
    **ORIENTATIONS,
    "reference_position": (3,),
    **{f"reference_{name}": width for name, width in ORIENTATIONS.items()},
    "wrench": (3, 6),
    "twist": (6,),
    "reference_twist": (6,),
    "stiffness": (6,),
    "damping": (6,),
    "joint_position": None,
    "joint_velocity": None,
}
"""Fields of a layout, with the numbers of columns that each may have (None: any)."""
TOPICS = ("wrench", "pose", "reference", "twist", "joints")
UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "angle": {"rad": 1.0, "deg": np.pi / 180},
    "force": {"N": 1.0, "kN": 1e3, "mN": 1e-3},
    "moment": {"Nm": 1.0, "Nmm": 1e-3, "Ncm": 1e-2, "mNm": 1e-3},
}
REFERENCES = ("logged", "start", "mean")


@dataclass(frozen=True)
class Layout:
    """Where a log keeps what. Whatever is left out is guessed from the names, and the guess is noted.

    As a TOML file::

        wrench_axes = "tool"                     # the sensor's own axes: the log never turned it
        sensor_rotation = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
        sensor_offset = [0, 0, -0.1]
        [columns]
        time = "t"
        wrench = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
        position = ["x", "y", "z"]
        quat_xyzw = ["qx", "qy", "qz", "qw"]
        reference_position = ["xd", "yd", "zd"]
        [units]
        time = "ms"
        length = "mm"

    Raises
    ------
    InputError
        Unknown field, unit or choice, or a wrong number of columns.
    """

    columns: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Columns of a field: time, position, quat_wxyz (or quat_xyzw, axis_angle, rotation_vector, roll_pitch_yaw),
    the same with ``reference_`` before it, wrench, twist, joint_position, joint_velocity, stiffness, damping."""
    topics: Mapping[str, str] = field(default_factory=dict)
    """Topics of a bag: wrench, pose, reference, twist, joints."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units of time, length, angle, force, moment where they are not SI."""
    wrench_axes: str = "world"
    """``world``: the log turned the wrench into world axes; ``tool``: it is in the sensor's own axes."""
    sensor_rotation: tuple[tuple[float, ...], ...] = IDENTITY
    """Q: axes of the sensor, as columns, in those of the end-effector; f_tool = Q f_sensor."""
    sensor_offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    """From the end-effector's origin to the point that the moment is taken about, end-effector's axes [m]."""
    wrench_sign: int = 1
    """-1 for a sensor that reports what the robot does to the environment."""
    reference: str = "logged"
    """``logged``; or a reference that stands still where the pose was at the ``start`` or in the ``mean``."""
    rate: float | None = None
    """Samples per second [Hz], for a log without a column of time."""

    def __post_init__(self) -> None:
        columns = {}
        for name, value in _mapping("columns", self.columns).items():
            one_of("field of columns", name, WIDTHS)
            wanted = (value,) if isinstance(value, str | int) else tuple(value)
            if not all(isinstance(column, str) for column in wanted):
                raise InputError(f"columns of {name} are {value!r}; write their names, as text.")
            columns[name] = wanted
        for name, topic in _mapping("topics", self.topics).items():
            one_of("field of topics", name, TOPICS)
            if not isinstance(topic, str):
                raise InputError(f"the topic of {name} is {topic!r}; write its name, as text.")
        for name, unit in _mapping("units", self.units).items():
            one_of(f"unit of {one_of('units', name, UNITS)}", unit, UNITS[name])
        one_of("wrench_axes", self.wrench_axes, WRENCH_AXES)
        one_of("reference", self.reference, REFERENCES)
        if self.wrench_sign not in (1, -1):
            raise InputError(f"wrench_sign is {self.wrench_sign!r}; it must be 1 or -1.")
        if self.rate is not None:
            positive("rate", self.rate)
        rotation = check_rotation("sensor_rotation", self.sensor_rotation)
        if rotation.shape != (3, 3):
            raise InputError(f"sensor_rotation has shape {rotation.shape}; pass one rotation (3, 3).")
        offset = finite_array("sensor_offset", self.sensor_offset, shape=(3,))
        object.__setattr__(self, "columns", columns)
        object.__setattr__(self, "sensor_rotation", tuple(tuple(row) for row in rotation.tolist()))
        object.__setattr__(self, "sensor_offset", tuple(offset.tolist()))

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Layout:
        """Read a layout from TOML.

        Raises
        ------
        FileError
            Missing, or not TOML.
        InputError
            An unknown key or value.
        """
        path = Path(path)
        try:
            content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
            raise FileError(
                f"{path} cannot be read as TOML ({error}); see vic recording inspect --help."
            ) from error
        try:
            return cls.of(content)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    @classmethod
    def of(cls, content: Layout | Mapping[str, Any] | str | os.PathLike[str] | None) -> Layout:
        """A layout from a layout, a mapping of its fields, the path of a TOML file, or nothing."""
        if content is None:
            return cls()
        if isinstance(content, Layout):
            return content
        if isinstance(content, str | os.PathLike):
            return cls.load(content)
        known = [f.name for f in dataclasses.fields(cls)]
        for name in content:
            one_of("key of the layout", name, known)
        return cls(**content)

    def factor(self, quantity: str) -> float:
        """What turns a number of the log into SI units."""
        return UNITS[quantity][self.units[quantity]] if quantity in self.units else 1.0


def resolve(wanted: Sequence[str], names: Sequence[str], field_name: str) -> tuple[str, ...]:
    """Columns of a table that a layout asks for; the name of an array stands for all its columns.

    Raises
    ------
    InputError
        There is no such column (those found and the nearest are named), or their number is wrong.
    """
    found: list[str] = []
    for name in wanted:
        parts = [column for column in names if column.startswith(f"{name}.")]
        if name in names:
            found.append(name)
        elif parts:
            found += parts
        else:
            raise InputError(f"there is no column {name!r} for {field_name}; {nearest(name, names)}")
    widths = WIDTHS[field_name]
    if widths is not None and len(found) not in widths:
        expected = " or ".join(map(str, widths))
        raise InputError(f"{field_name} has {len(found)} columns ({', '.join(found)}); it needs {expected}.")
    return tuple(found)


def nearest(name: str, names: Iterable[str]) -> str:
    """What there is instead of a name that is not there."""
    names = list(names)
    lower = {other.lower(): other for other in names}
    close = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.4)
    hint = f" The nearest is {lower[close[0]]!r}." if close else ""
    return f"there {'are' if len(names) != 1 else 'is'}: {listed(names)}.{hint}"


def listed(names: Sequence[str], most: int = 60) -> str:
    """Names out of a file, on one line of reasonable length."""
    plain = [ascii(name)[1:-1] for name in names[:most]]
    short = [name if len(name) <= 60 else name[:57] + "..." for name in plain]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(short) + more if names else "none"


def _mapping(name: str, value: Any) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{name} is {value!r}; write a table of names, e.g. [{name}].")
    return value
