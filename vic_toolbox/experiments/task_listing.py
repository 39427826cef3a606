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
    """Task, scenario and start of every scenario."""
    return [
        (name, label, ", ".join(f"{x:.2f}" for x in scenario.start))
        for name in tasks.names()
        for label, scenario in tasks.make(name).scenarios.items()
    ]
