"""The batched engine as a Gymnasium vector environment: many simulations, no loop over environments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from vic_toolbox.errors import InputError, finite_array, finite_number, integer, one_of
from vic_toolbox.tasks.rendering import Renderer
from vic_toolbox.tasks.task import Task

MOST_NOISE = 10.0
"""Largest start noise, in units of the task's usual variation; beyond it a start may be no start any more."""


class VectorEnvironment(VectorEnv):
    """``num_envs`` simulations of one task that start and end together.

    There is no early termination: every episode lasts ``task.horizon`` steps and is then *truncated*. The
    step after that starts the next episode (Gymnasium's next-step autoreset); learning code calls
    :meth:`reset` itself.

    Parameters
    ----------
    task : Task
        What is simulated.
    num_envs : int
        Number of simulations.
    start_noise : float
        Variation of the starts: 1 is the task's usual one, 0 none at all.
    threads : int
        Threads of the physics; 0 takes every processor. The numbers do not depend on it.
    render_mode : {"rgb_array"}, optional
        Makes :meth:`render` return one picture of each simulation.
    """

    metadata: ClassVar = {
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        task: Task,
        num_envs: int = 1,
        *,
        start_noise: float = 1.0,
        threads: int = 1,
        render_mode: str | None = None,
    ) -> None:
        self.task = task
        self.metadata = type(self).metadata | {"render_fps": round(1.0 / task.dt)}
        self.num_envs = integer("num_envs", num_envs, low=1)
        self.start_noise = finite_number("start_noise", start_noise, low=0.0, high=MOST_NOISE)
        if render_mode is not None:
            one_of("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode = render_mode
        self._renderer: Renderer | None = None
        self.simulation = task.simulation(self.num_envs, threads=threads)
        self.single_observation_space = spaces.Box(-np.inf, np.inf, (task.observation_size,), np.float64)
        self.single_action_space = spaces.Box(task.action_low, task.action_high, dtype=np.float64)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._never = np.zeros(self.num_envs, dtype=bool)
        self._observation: np.ndarray | None = None
        self._elapsed = 0
        self._score = np.zeros(self.num_envs)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict]:
        """Start an episode in every simulation.

        Parameters
        ----------
        seed : int, optional
            Draws the start noise; the same seed gives the same numbers.
        options : dict, optional
            ``start_noise`` and ``scenarios`` (one for each simulation), for this episode only.
        """
        super().reset(seed=None if seed is None else integer("seed", seed, low=0))
        options = {} if options is None else options
        for name in options:
            one_of("option", name, ("start_noise", "scenarios"))
        noise = finite_number(
            "start_noise", options.get("start_noise", self.start_noise), low=0.0, high=MOST_NOISE
        )
        scenarios = self._scenarios(options.get("scenarios"))
        self.task.start(self.simulation, scenarios, noise=noise, rng=self.np_random)
        self._elapsed = 0
        self._score[:] = 0.0
        self._observation = np.tile(self._newest(), self.task.history)
        return self._observation.copy(), {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Hold the actions (num_envs, action_size) for one policy step.

        Actions beyond the bounds are clipped. The reward judges the state in which the action was chosen, so
        that the rewards of an episode add up to the task's score. The last step's ``info`` has ``score``,
        ``success`` and the task's figures behind it, (num_envs,) each.

        Raises
        ------
        InputError
            Wrong shape, an action that is not finite, or no reset before the first step.
        SimulationError
            MuJoCo itself failed. (A simulation whose joints run away is halted where it last was in order,
            and stays there; at the end ``info["stopped"]`` names it, and it has not succeeded.)
        """
        if self._observation is None:
            raise InputError("step was called before reset; call reset first.")
        if self._elapsed >= self.task.horizon:
            observation, info = self.reset()
            return observation, np.zeros(self.num_envs), self._never.copy(), self._never.copy(), info
        actions = finite_array("actions", actions, shape=(self.num_envs, self.task.action_size))
        reward = self.task.reward(self._observation)
        self.task.act(self.simulation, actions)
        self.simulation.step(self.task.substeps)
        newest = self._newest()
        if self.task.history > 1:
            newest = np.concatenate([self._observation[:, newest.shape[1] :], newest], axis=1)
        self._observation = newest
        self._elapsed += 1
        self._score += reward
        over = self._elapsed >= self.task.horizon
        info = self._episode_info() if over else {}
        return newest.copy(), reward, self._never.copy(), np.full(self.num_envs, over), info

    def set_push(self, force: np.ndarray) -> None:
        """Push what is moved by (num_envs, 3) [N], world axes, until the next call or reset."""
        self.simulation.set_push(finite_array("force", force, shape=(self.num_envs, 3)))

    def expert_action(self, observations: np.ndarray) -> np.ndarray:
        """Action of the task's expert, (num_envs, action_size)."""
        return self.task.expert_action(observations)

    def render(self) -> tuple[np.ndarray, ...] | None:
        """One picture of each simulation, (height, width, 3) uint8, when the render mode is ``rgb_array``."""
        if self.render_mode is None:
            return None
        if self._renderer is None:
            self._renderer = Renderer(self.task.picture_spec())
        return tuple(self._renderer.picture(qpos) for qpos in self.simulation.qpos)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer; called by ``close``."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _newest(self) -> np.ndarray:
        """What the simulations show now, in the task's units."""
        seen = self.simulation.observe()
        return np.divide(seen, self.task.observation_unit, out=seen)

    def _episode_info(self) -> dict[str, np.ndarray]:
        assert self._observation is not None
        figures = {"score": self._score.copy(), **self.task.outcome(self.simulation, self._observation)}
        return figures | {f"_{name}": ~self._never for name in figures}

    def _scenarios(self, scenarios: Sequence[Any] | None) -> Sequence[Any]:
        if scenarios is None:
            return [self.task.scenario] * self.num_envs
        if (
            not isinstance(scenarios, Sequence)
            or isinstance(scenarios, str)
            or len(scenarios) != self.num_envs
        ):
            raise InputError(
                f"scenarios is {scenarios!r}; pass a list of {self.num_envs}, one for each simulation."
            )
        return scenarios
