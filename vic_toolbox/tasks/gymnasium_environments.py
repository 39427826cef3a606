"""The tasks as Gymnasium environments, by the names under which this package registers them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

from vic_toolbox.tasks.cup_on_plate import CupOnPlate
from vic_toolbox.tasks.environment import Environment
from vic_toolbox.tasks.peg_in_hole import PegInHole
from vic_toolbox.tasks.task import Task
from vic_toolbox.tasks.vector_environment import VectorEnvironment

__all__ = ["CupOnPlateEnv", "CupOnPlateVectorEnv", "PegInHoleEnv", "PegInHoleVectorEnv"]


class _SingleEnv(Environment):
    """One environment of a task."""

    make_task: ClassVar[Callable[..., Task]]

    def __init__(
        self,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        start_noise: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        task = self.make_task(action=action, history=history, scenario=scenario)
        super().__init__(task, start_noise=start_noise, render_mode=render_mode)


class _BatchedEnv(VectorEnvironment):
    """Many environments of a task, stepped together."""

    make_task: ClassVar[Callable[..., Task]]

    def __init__(
        self,
        num_envs: int = 1,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        start_noise: float = 1.0,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        task = self.make_task(action=action, history=history, scenario=scenario)
        super().__init__(task, num_envs, start_noise=start_noise, threads=threads, render_mode=render_mode)


class CupOnPlateEnv(_SingleEnv):
    """Cup-on-Plate, ``vic/CupOnPlate-v0`` of ``gymnasium.make``: :class:`CupOnPlate` in the base class."""

    make_task = CupOnPlate


class CupOnPlateVectorEnv(_BatchedEnv):
    """Batched Cup-on-Plate, ``vic/CupOnPlate-v0`` of ``gymnasium.make_vec``: see :class:`CupOnPlateEnv`."""

    make_task = CupOnPlate


class PegInHoleEnv(_SingleEnv):
    """Peg-in-Hole, ``vic/PegInHole-v0`` of ``gymnasium.make``: :class:`PegInHole` in the base class."""

    make_task = PegInHole


class PegInHoleVectorEnv(_BatchedEnv):
    """Batched Peg-in-Hole, ``vic/PegInHole-v0`` of ``gymnasium.make_vec``: see :class:`PegInHoleEnv`."""

    make_task = PegInHole
