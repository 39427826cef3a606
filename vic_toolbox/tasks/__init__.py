"""Tasks: batched MuJoCo simulations with scenarios, score, success, expert and Gymnasium environments.

>>> from vic_toolbox import tasks
>>> task = tasks.make("cup-on-plate", action="gain")
>>> environment = tasks.VectorEnvironment(task, num_envs=20)

Importing this package registers the Gymnasium ids ``vic/CupOnPlate-v0`` and ``vic/PegInHole-v0``. A new task is
a module with a class like :class:`~vic_toolbox.tasks.cup_on_plate.CupOnPlate`, and one line in :data:`TASKS`.
"""

from __future__ import annotations

import importlib
import os
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from vic_toolbox.errors import DependencyError, one_of, require

require("learn", "gymnasium", "mujoco")

import gymnasium

if TYPE_CHECKING:
    from vic_toolbox.tasks.cup_on_plate import CupOnPlate
    from vic_toolbox.tasks.demonstrations import Demonstrations, record
    from vic_toolbox.tasks.environment import Environment
    from vic_toolbox.tasks.gymnasium_environments import (
        CupOnPlateEnv,
        CupOnPlateVectorEnv,
        PegInHoleEnv,
        PegInHoleVectorEnv,
    )
    from vic_toolbox.tasks.peg_in_hole import PegInHole, PegScenario
    from vic_toolbox.tasks.starts import Scenario
    from vic_toolbox.tasks.task import Task
    from vic_toolbox.tasks.vector_environment import VectorEnvironment

TASKS = MappingProxyType({"cup-on-plate": "CupOnPlate", "peg-in-hole": "PegInHole"})
"""Name of each task → name of its class in this package."""

_HOME = {
    "CupOnPlate": "cup_on_plate",
    "CupOnPlateEnv": "gymnasium_environments",
    "CupOnPlateVectorEnv": "gymnasium_environments",
    "Demonstrations": "demonstrations",
    "Environment": "environment",
    "PegInHole": "peg_in_hole",
    "PegInHoleEnv": "gymnasium_environments",
    "PegInHoleVectorEnv": "gymnasium_environments",
    "PegScenario": "peg_scene",
    "Scenario": "starts",
    "Task": "task",
    "VectorEnvironment": "vector_environment",
    "record": "demonstrations",
}

__all__ = [
    "TASKS",
    "CupOnPlate",
    "CupOnPlateEnv",
    "CupOnPlateVectorEnv",
    "Demonstrations",
    "Environment",
    "PegInHole",
    "PegInHoleEnv",
    "PegInHoleVectorEnv",
    "PegScenario",
    "Scenario",
    "Task",
    "VectorEnvironment",
    "make",
    "names",
    "record",
]


def make(name: str, **options: Any) -> Task:
    """Make a task by name.

    Parameters
    ----------
    name : str
        One of :func:`names`.
    **options
        Options of the task's class: ``action``, ``history``, ``scenario`` and its own.

    Raises
    ------
    InputError
        Unknown name, or a value that the task refuses.
    """
    return __getattr__(TASKS[one_of("task", name, TASKS)])(**options)


def names() -> tuple[str, ...]:
    """Names of all tasks."""
    return tuple(TASKS)


def __getattr__(name: str) -> Any:
    """Import a public class on first use: the simulator and the compiler cost a second."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted(__all__)


def _check_opengl(named: str) -> None:
    """Import MuJoCo, which loads the OpenGL library that MUJOCO_GL names, and cannot be imported without it."""
    try:
        importlib.import_module("mujoco")
    except Exception as error:  # PyOpenGL fails with an AttributeError, an unknown name with a RuntimeError
        raise DependencyError(
            f"MuJoCo cannot be imported with MUJOCO_GL={named} ({error}). Unset MUJOCO_GL: pictures then use "
            "whatever OpenGL there is (on Linux: apt-get install libegl1 libgl1), and nothing else needs any."
        ) from error


if os.environ.get("MUJOCO_GL"):
    _check_opengl(os.environ["MUJOCO_GL"])


for _class in TASKS.values():
    gymnasium.register(
        id=f"vic/{_class}-v0",
        entry_point=f"{__name__}.gymnasium_environments:{_class}Env",
        vector_entry_point=f"{__name__}.gymnasium_environments:{_class}VectorEnv",
    )
