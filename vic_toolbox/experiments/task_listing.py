"""The tasks with their scenarios, as rows of text."""

from __future__ import annotations

import gymnasium

from vic_toolbox import tasks


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
    """Task, name and description of every scenario, and how one of the user's own is written."""
    rows: list[tuple[str, ...]] = []
    for task in map(tasks.make, tasks.names()):
        rows += [(task.name, name, found.description) for name, found in task.scenarios.items()]
        rows.append((task.name, "your own", task.scenario_help))
    return rows
