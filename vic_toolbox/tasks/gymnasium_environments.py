"""The tasks as Gymnasium environments, by the names under which this package registers them."""

from __future__ import annotations

from typing import Any

from vic_toolbox.tasks.cup_on_plate import CupOnPlate
from vic_toolbox.tasks.environment import Environment
from vic_toolbox.tasks.peg_in_hole import PegInHole
from vic_toolbox.tasks.vector_environment import VectorEnvironment

__all__ = ["CupOnPlateEnv", "CupOnPlateVectorEnv", "PegInHoleEnv", "PegInHoleVectorEnv"]


class CupOnPlateEnv(Environment):
    """Cup-on-Plate, ``vic/CupOnPlate-v0`` of ``gymnasium.make``: :class:`CupOnPlate` in the base class."""

    def __init__(
        self,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        start_noise: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        task = CupOnPlate(action=action, history=history, scenario=scenario)
        super().__init__(task, start_noise=start_noise, render_mode=render_mode)


class CupOnPlateVectorEnv(VectorEnvironment):
    """Batched Cup-on-Plate, ``vic/CupOnPlate-v0`` of ``gymnasium.make_vec``: see :class:`CupOnPlateEnv`."""

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
        task = CupOnPlate(action=action, history=history, scenario=scenario)
        super().__init__(task, num_envs, start_noise=start_noise, threads=threads, render_mode=render_mode)


class PegInHoleEnv(Environment):
    """Peg-in-Hole, ``vic/PegInHole-v0`` of ``gymnasium.make``: :class:`PegInHole` in the base class."""

    def __init__(
        self,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        start_noise: float = 1.0,
        render_mode: str | None = None,
    ) -> None:
        task = PegInHole(action=action, history=history, scenario=scenario)
        super().__init__(task, start_noise=start_noise, render_mode=render_mode)


class PegInHoleVectorEnv(VectorEnvironment):
    """Batched Peg-in-Hole, ``vic/PegInHole-v0`` of ``gymnasium.make_vec``: see :class:`PegInHoleEnv`."""

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
        task = PegInHole(action=action, history=history, scenario=scenario)
        super().__init__(task, num_envs, start_noise=start_noise, threads=threads, render_mode=render_mode)
