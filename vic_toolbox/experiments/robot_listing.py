"""The arms that models can load, as rows of text; needs no simulator."""

from __future__ import annotations

import numpy as np

from vic_toolbox.models import RobotModel, available_robots, load_robot

POSTURES = 4000
"""Random postures behind a robot's reach."""


def robot_rows(seed: int = 0) -> list[tuple[str, ...]]:
    """Name, joints, reach [m], tool frame and description of each arm, and whose description it is."""
    rows = []
    for name, description in available_robots().items():
        robot = load_robot(name)
        rows.append((name, str(robot.nq), f"{reach(robot, seed=seed):.2f}", robot.frame, description.title))
    return rows


def reach(robot: RobotModel, *, seed: int = 0) -> float:
    """Largest horizontal distance of the end-effector from the base over random postures [m]; a little too
    small.
    """
    rng = np.random.default_rng(seed)
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    poses = robot.pose(rng.uniform(low, high, (POSTURES, robot.nq)))
    return float(np.linalg.norm(poses[:, :2, 3], axis=1).max())
