"""A task as a single Gymnasium environment: the batched engine with one simulation."""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

import gymnasium
import numpy as np

from vic_toolbox.errors import DependencyError, InputError, finite_array, one_of
from vic_toolbox.tasks.rendering import Window
from vic_toolbox.tasks.task import Task
from vic_toolbox.tasks.vector_environment import VectorEnvironment


class Environment(gymnasium.Env):
    """One simulation of a task.

    Parameters
    ----------
    task : Task
        What is simulated.
    start_noise : float
        Variation of the starts: 1 is the task's usual one, 0 none at all.
    render_mode : {"rgb_array", "human"}, optional
        ``rgb_array``: :meth:`render` returns a picture. ``human``: a window shows every step.
    """

    metadata: ClassVar = {"render_modes": ["rgb_array", "human"]}

    def __init__(self, task: Task, *, start_noise: float = 1.0, render_mode: str | None = None) -> None:
        self.metadata = type(self).metadata | {"render_fps": round(1.0 / task.dt)}
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self.task = task
        pictures = "rgb_array" if render_mode == "rgb_array" else None
        self.engine = VectorEnvironment(task, 1, start_noise=start_noise, render_mode=pictures)
        self._window: Window | None = None
        self.observation_space = self.engine.single_observation_space
        self.action_space = self.engine.single_action_space
        self._over = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        """Start an episode; ``options``, for it alone, may have ``start_noise`` and ``scenario``."""
        super().reset(seed=seed)
        options = dict(options or {})
        if "scenario" in options:
            options["scenarios"] = [options.pop("scenario")]
        observation, _ = self.engine.reset(seed=seed, options=options)
        self._over = False
        self._show()
        return observation[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Hold an action (action_size,) for one policy step; see :meth:`VectorEnvironment.step`."""
        if self._over:
            raise InputError("the episode is over; call reset before the next step.")
        action = finite_array("action", action, shape=(self.task.action_size,))
        observation, reward, _, truncated, info = self.engine.step(action[None])
        self._over = bool(truncated[0])
        self._show()
        values = {name: value[0].item() for name, value in info.items() if not name.startswith("_")}
        return observation[0], float(reward[0]), False, self._over, values

    def render(self) -> np.ndarray | None:
        """A picture (height, width, 3) uint8 when the render mode is ``rgb_array``."""
        pictures = self.engine.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Close the window and free the renderer."""
        self.engine.close()
        if self._window is not None:
            self._window.close()
            self._window = None

    def _show(self) -> None:
        if self.render_mode == "human" and self._window is None:
            self._open_window()
        if self._window is not None:
            self._window.show(self.engine.simulation.qpos[0])

    def _open_window(self) -> None:
        """Open the window; where there is no display, say so once and go on without."""
        try:
            self._window = Window(self.task.picture_spec(), period=self.task.dt)
        except DependencyError as error:
            warnings.warn(f"{error} The episode goes on unseen.", stacklevel=2)
            self.render_mode = None
