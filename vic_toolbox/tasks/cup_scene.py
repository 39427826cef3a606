"""The scene of Cup-on-Plate: an arm with a cup, a table with a plate, and where the cup may start.

World axes are those of the arm's base, which stands on the table; the table's top is z = 0.
"""

from __future__ import annotations

import functools
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.models import RobotModel, load_robot
from vic_toolbox.tasks import scene
from vic_toolbox.tasks.starts import Scenario, start_posture

ARM, TOOL = "fanuc_lrmate200id7l", "cup_gripper"
CUP = scene.TOOL_PREFIX + "cup"
CUP_RADIUS = 0.04
"""[m]"""

PLATE = (0.40, 0.40)
"""Centre of the plate [m]."""
PLATE_RADIUS, PLATE_TOP = 0.08, 0.02
"""Radius and height of the plate [m]."""

GOAL = (*PLATE, PLATE_TOP - 0.003)
"""Reference of the centre of the cup's bottom [m]: 3 mm inside the plate, so that the cup presses lightly."""
TOOL_DOWN = np.diag([1.0, -1.0, -1.0])
"""Reference rotation: the tool's z axis points down."""
TOOL_DOWN_QUAT_WXYZ = (0.0, 1.0, 0.0, 0.0)

BASE_CLEARANCE = 0.2
"""Distance that the straight path from start to goal keeps from the arm's vertical axis [m]."""

SCENARIOS = MappingProxyType({
    name: Scenario(start, name)
    for name, start in {
        "train": (0.60, -0.05, 0.30),
        "T1": (0.35, -0.35, 0.45),
        "T2": (0.50, -0.20, 0.30),
        "T3": (0.25, -0.05, 0.50),
        "T4": (0.20, -0.15, 0.50),
    }.items()
})  # fmt: skip
"""The training start, and the four unseen ones."""

SCENARIO_HELP = 'a start "x,y,z" [m]'


def as_scenario(scenario: Any) -> Scenario:
    """A scenario from its name, from "x,y,z" or a point (x, y, z) [m], or from a scenario.

    Its name can be read back: a start that is none of :data:`SCENARIOS` is called by its coordinates.

    Raises
    ------
    InputError
        Unknown name, or not a point.
    """
    if isinstance(scenario, Scenario):
        known = SCENARIOS.get(scenario.name) == scenario
        return scenario if known else Scenario(scenario.start)
    if isinstance(scenario, str):
        if scenario in SCENARIOS:
            return SCENARIOS[scenario]
        scenario = _coordinates(scenario)
    x, y, z = finite_array("scenario", scenario, shape=(3,)).tolist()
    return Scenario((x, y, z))


def _coordinates(text: str) -> list[float]:
    """The numbers of "x,y,z"."""
    words = text.split(",")
    try:
        if len(words) == 3:
            return [float(word) for word in words]
    except ValueError:
        pass
    raise InputError(f'scenario is "{text}"; choose one of: {", ".join(SCENARIOS)}, or pass {SCENARIO_HELP}.')


@functools.cache
def robot() -> RobotModel:
    """The arm with its tool; the frame is the centre of the cup's bottom."""
    return load_robot(ARM, tool=TOOL)


@functools.lru_cache(maxsize=4096)
def start_angles(start: tuple[float, float, float]) -> Array:
    """Joint angles (6,) [rad] of a start, checked; read-only, and computed once in a process.

    All starts are reached in one configuration: elbow up, wrist down.

    Raises
    ------
    InputError
        The cup would start in the table or the plate, or pass through the arm's base on its way.
    ReachError
        Out of reach with the tool down, next to a joint limit or a singularity, or not in metres.
    """
    position = np.array(start)
    robot().check_metres(position)
    _check_room(position)
    like = np.array([np.arctan2(start[1], start[0]), 0.3, -0.3, 0.0, -1.2, 0.0])
    angles = start_posture(robot(), position, rotation=TOOL_DOWN, like=like)
    angles.flags.writeable = False
    return angles


def _check_room(start: Array) -> None:
    """Refuse a start inside the furniture, or whose straight path to the goal meets the arm's base."""
    over_plate = np.linalg.norm(start[:2] - PLATE) < PLATE_RADIUS + CUP_RADIUS
    ground = PLATE_TOP if over_plate else 0.0
    if start[2] <= ground:
        under = "plate" if over_plate else "table"
        raise InputError(
            f"the start height is {start[2]:.3f} m; above the {under} it must exceed {ground:.3f} m."
        )
    path = np.subtract(PLATE, start[:2])
    nearest = start[:2] + np.clip(-start[:2] @ path / max(path @ path, 1e-12), 0.0, 1.0) * path
    distance = float(np.linalg.norm(nearest))
    if distance < BASE_CLEARANCE:
        raise InputError(
            f"the straight path from the start {_metres(start)} to the plate comes within {distance:.3f} m "
            f"of the arm's vertical axis; choose a start from which it keeps {BASE_CLEARANCE} m."
        )


def _metres(point: Array) -> str:
    return f"({', '.join(f'{x:.3f}' for x in point)}) m"


def build_spec() -> mujoco.MjSpec:
    """All of the scene, with the shapes that only the eye needs.

    The contact between cup and furniture has MuJoCo's default compliance (time constant 20 ms); the peak
    force of a touch is inversely proportional to it.
    """
    spec = scene.arm_spec(robot())
    scene.make_solid(spec, CUP)
    box, cylinder = mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER
    scene.add_furniture(spec, "table", type=box, pos=[0.4, 0, -0.02], size=[0.65, 0.85, 0.02])
    centre, size = [*PLATE, PLATE_TOP / 2], [PLATE_RADIUS, PLATE_TOP / 2, 0]
    scene.add_furniture(spec, "plate", type=cylinder, pos=centre, size=size, rgba=[0.9, 0.9, 0.88, 1])
    return spec


@functools.cache
def physics_model(*, time_step: float = scene.TIMESTEP) -> mujoco.MjModel:
    """The model that is simulated with a time step [s], compiled once in a process."""
    spec = build_spec()
    spec.option.timestep = time_step
    return scene.physics_model(spec)
