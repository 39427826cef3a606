"""What a task is: the one interface between simulation and learning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from vic_toolbox.gains import Parametrisation


class Scenario(Protocol):
    """One variant of a task: where it starts, and what is changed."""

    @property
    def name(self) -> str:
        """Text from which the task's `as_scenario` makes this scenario again; what tables and files call it."""
        ...

    @property
    def description(self) -> str:
        """The same in words, with units."""
        ...


@dataclass(frozen=True)
class SweepAxis:
    """One quantity that makes a task harder or easier.

    Attributes
    ----------
    label : str
        The quantity with its unit.
    values : tuple of float
        Values to judge at, ascending.
    scenario : callable
        From a value to the scenario.
    """

    label: str
    values: tuple[float, ...]
    scenario: Callable[[float], Scenario]


class Task(Protocol):
    """A manipulation task. Observations and actions are (n, ·) arrays, actions normalised."""

    name: str
    title: str  # as headings call it
    action: str  # "gain" or "force"
    history: int  # observations that the policy sees at once, oldest first
    horizon: int  # policy steps in an episode
    substeps: int  # physics steps in a policy step
    dt: float  # period of the policy [s]
    observation_size: int
    action_size: int
    observation_unit: np.ndarray  # (n,) what a 1 in each of the n numbers of one observation stands for [SI]
    observation_scale: np.ndarray  # (observation_size,) typical size of each entry
    action_low: np.ndarray
    action_high: np.ndarray
    scenarios: Mapping[str, Any]  # by name; the first, "train", is where the demonstrations are
    scenario: Any  # a Scenario
    scenario_help: str  # how a scenario of the user's own is written
    sweeps: Mapping[str, SweepAxis]
    goal: np.ndarray  # (3,) reference position of the end-effector [m]
    gains: Parametrisation  # range of the gain action
    constants: Mapping[str, np.ndarray]  # parameters [SI] of the constant-gain baselines, the usual one first
    push: float  # standard deviation of the pushes on a demonstrating expert, along each axis [N]
    outcome_text: tuple[str, str]  # success and failure in words

    def with_action(self, action: str) -> Task:
        """The same task in another action space."""
        ...

    @staticmethod
    def as_scenario(scenario: Any) -> Any:
        """A scenario from its name or text; a scenario stays as it is."""
        ...

    def simulation(self, count: int, *, threads: int = 1) -> Any:
        """A new batch of simulations of this task."""
        ...

    def start(
        self, simulation: Any, scenarios: Sequence[Any], *, noise: float, rng: np.random.Generator
    ) -> None:
        """Put every simulation at its start, varied by `noise` times the task's usual variation."""
        ...

    def act(self, simulation: Any, actions: np.ndarray) -> None:
        """Apply actions (n, action_size), clipped to their bounds, until the next call."""
        ...

    def picture_spec(self) -> Any:
        """Decorated scene, with the joints of the simulation, for a renderer."""
        ...

    def skeleton(self, qpos: np.ndarray) -> np.ndarray:
        """Points (..., n, 3) [m] of a line that stands for what moves, where there is no renderer."""
        ...

    def reward(self, observations: np.ndarray) -> np.ndarray:
        """Reward of being where the observations (..., observation_size) are."""
        ...

    def score(self, observations: np.ndarray) -> np.ndarray:
        """Sum of the rewards along paths (T, ..., observation_size)."""
        ...

    def outcome(self, simulation: Any, observations: np.ndarray) -> dict[str, np.ndarray]:
        """What an episode ended with, (n,) each: ``success``, ``stopped``, ``distance`` [m], ``peak_force`` [N]."""
        ...

    def strata(self, observations: np.ndarray) -> np.ndarray:
        """Part of the way, (...) small integers, that each observation belongs to; learning looks at all alike."""
        ...

    def expert_action(self, observations: np.ndarray) -> np.ndarray:
        """The expert's action, (..., action_size)."""
        ...

    def gains_to_action(self, parameters: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Action with the effect of gain parameters [SI] at the observations."""
        ...

    def wrench_to_action(self, wrench: np.ndarray, observations: np.ndarray) -> np.ndarray:
        """Force action with which the law gives the whole feedback wrench (..., 6) at the observations."""
        ...

    def constant_action(
        self, observations: np.ndarray | None = None, *, which: str = "constant"
    ) -> np.ndarray:
        """Action of constant gains, the baseline."""
        ...
