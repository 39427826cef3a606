"""What there is: robots and tasks, as rows of text."""

from __future__ import annotations

import gymnasium
import numpy as np

from vic_toolbox import tasks
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


def task_rows() -> list[tuple[str, ...]]:
    """Name, Gymnasium id, action spaces and length of an episode of each task."""
    rows = []
    for name in tasks.names():
        spaces = [tasks.make(name, action=action) for action in ("gain", "force")]
        actions = ", ".join(f"{task.action} ({task.action_size})" for task in spaces)
        task = spaces[0]
        length = f"{task.horizon} steps, {task.horizon * task.dt:g} s"
        rows.append((name, gymnasium_id(task), actions, length))
    return rows


def gymnasium_id(task: tasks.Task) -> str:
    """The id under which Gymnasium makes the task."""
    wanted = type(task).__name__
    return next((key for key in gymnasium.registry if key.startswith(f"vic/{wanted}-")), "")


def scenario_rows() -> list[tuple[str, ...]]:
    """Task, scenario and start of every scenario."""
    return [
        (name, label, ", ".join(f"{x:.2f}" for x in scenario.start))
        for name in tasks.names()
        for label, scenario in tasks.make(name).scenarios.items()
    ]
