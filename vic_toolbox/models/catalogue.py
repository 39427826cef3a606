"""Which robots there are: the folders of ``robots/`` and the serial arms of example-robot-data.

A robot of this project is a folder ``robots/<name>`` with a URDF and a ``robot.toml`` that says what the URDF
cannot: the end-effector, where a tool goes, the home posture, the armature, and where the numbers come from.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import vic_toolbox
from vic_toolbox.errors import FileError, InputError, ModelError, finite_array, one_of
from vic_toolbox.models.urdf import read_arm, read_urdf

KINDS = ("arm", "tool", "object")
SMALLEST_ARM = 5
"""Joints that an arm of example-robot-data needs to be listed: with fewer it cannot aim a tool."""


@dataclass(frozen=True)
class RobotDescription:
    """What is known about a robot, a tool or an object besides its URDF."""

    name: str
    """Name in the catalogue."""
    urdf: Path
    """URDF file."""
    kind: str = "arm"
    """``arm`` (moves), ``tool`` (bolted to an arm) or ``object`` (free)."""
    title: str = ""
    """Name for people."""
    end_effector: str | None = None
    """Frame that is controlled; without it a frame at the end of the chain is chosen."""
    tool_mount: str | None = None
    """Arm: frame that a tool's root coincides with; without it the end-effector."""
    root: str | None = None
    """Tool or object: its root link."""
    home: tuple[float, ...] | None = None
    """Arm: rest posture [rad]; without it a posture away from singularities is chosen."""
    armature: tuple[float, ...] | None = None
    """Arm: rotor inertia on the joint side [kg m²]; without it zero."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Where the numbers come from, and which are assumed."""


def read_description(path: Path) -> RobotDescription:
    """Read a ``robot.toml``.

    Raises
    ------
    FileError
        No such file, or not TOML.
    ModelError
        An unknown key, a missing one, or a value of the wrong kind.
    """
    try:
        content: dict[str, Any] = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise FileError(f"cannot read {path} ({error.strerror}); pass the path of a robot.toml.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileError(f"{path} is not a TOML file ({error}); correct it.") from error
    known = {f.name for f in fields(RobotDescription)}
    unknown, missing = sorted(content.keys() - known), sorted({"name", "urdf"} - content.keys())
    if unknown or missing:
        raise ModelError(
            f"{path} has the unknown keys {unknown} and misses {missing}; the keys are {sorted(known)}."
        )
    for key, value in content.items():
        if key in ("home", "armature"):
            content[key] = tuple(finite_array(f"{key} in {path}", value, shape=(None,)).tolist())
        elif not isinstance(value, dict if key == "provenance" else str):
            wanted = "a table" if key == "provenance" else "a string"
            raise ModelError(f"{key} in {path} is {value!r}; write {wanted}.")
    one_of(f"kind in {path}", content.get("kind", "arm"), KINDS)
    content["urdf"] = path.parent / content["urdf"]
    return RobotDescription(**content)


def robots_directory() -> Path:
    """Folder of the project's own robots: inside the package when installed, beside it in the repository.

    Raises
    ------
    FileError
        The installation holds no robots.
    """
    package = Path(vic_toolbox.__file__).parent
    for folder in (package / "robots", package.parent / "robots"):
        if any(folder.glob("*/robot.toml")):
            return folder
    raise FileError(f"no robots beside {package}: the installation is incomplete; reinstall vic-toolbox.")


def example_robots_directory() -> Path | None:
    """Folder of the robots of example-robot-data, or None where it is not installed.

    The wheel puts its data under ``cmeel.prefix`` in site-packages, conda and ROS under the prefix itself.
    """
    prefixes = [*(Path(entry) / "cmeel.prefix" for entry in sys.path), Path(sys.prefix)]
    folders = (prefix / "share" / "example-robot-data" / "robots" for prefix in prefixes)
    return next((folder for folder in folders if folder.is_dir()), None)


def find_robot(name: str | Path, kind: str = "arm") -> RobotDescription:
    """Find the description of a robot, tool or object.

    Parameters
    ----------
    name : str or Path
        A name (a folder of ``robots/``, else a URDF of example-robot-data, ``ur5`` standing for
        ``ur5_robot``), or a path with a separator or an extension: of a folder with a ``robot.toml``, of the
        ``robot.toml``, or of a URDF.
    kind : str
        What it must be: ``arm``, ``tool`` or ``object``.

    Raises
    ------
    InputError
        Unknown name; the message lists the known ones.
    FileError
        The path leads nowhere.
    ModelError
        It is of another kind.
    """
    description = _find(name, kind)
    if description.kind != kind:
        raise ModelError(f"{description.name} is of kind {description.kind!r}; pass one of: {_names(kind)}.")
    return description


def available_robots(kind: str | None = "arm") -> dict[str, RobotDescription]:
    """All robots of the catalogue, by name: the project's own, then the serial arms of example-robot-data.

    Parameters
    ----------
    kind : {"arm", "tool", "object"} or None
        Which kind; None lists every kind.
    """
    if kind is not None:
        one_of("kind", kind, KINDS)
    own = [read_description(path) for path in sorted(robots_directory().glob("*/robot.toml"))]
    found = {robot.name: robot for robot in own if kind in (None, robot.kind)}
    if kind in (None, "arm"):
        for path in _example_urdfs():
            name = path.stem.removesuffix("_robot")
            if name not in found and _is_arm(path):
                found[name] = _from_urdf(path, name)
    return found


def _find(name: str | Path, kind: str) -> RobotDescription:
    path = Path(name)
    if path.suffix == ".urdf":
        return _from_urdf(path, path.stem, kind)
    if path.suffix == ".toml":
        return read_description(path)
    if isinstance(name, Path) or name != path.name:
        return read_description(path / "robot.toml")
    own = robots_directory() / name / "robot.toml"
    if own.is_file():
        return read_description(own)
    for stem in (name, f"{name}_robot"):
        for urdf in _example_urdfs(stem):
            if _is_readable(urdf):
                return _from_urdf(urdf, name)
    raise InputError(f"no robot is called {name!r}; pass the path of a URDF, or one of: {_names(kind)}.")


def _from_urdf(path: Path, name: str, kind: str = "arm") -> RobotDescription:
    return RobotDescription(name=name, urdf=path, kind=kind, title=path.stem)


def _names(kind: str) -> str:
    return ", ".join(available_robots(kind)) or "(none)"


def _example_urdfs(stem: str = "*") -> list[Path]:
    folder = example_robots_directory()
    return sorted(folder.rglob(f"{stem}.urdf")) if folder else []


def _is_readable(path: Path) -> bool:
    """Whether the file is a URDF at all: some of example-robot-data are templates of one."""
    try:
        read_urdf(path)
    except ModelError:
        return False
    return True


def _is_arm(path: Path) -> bool:
    try:
        return read_arm(path).model.nq >= SMALLEST_ARM
    except ModelError:
        return False
