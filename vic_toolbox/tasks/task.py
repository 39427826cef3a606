"""What a task is: the one interface between simulation and learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np

from vic_toolbox.tasks.starts import Scenario


class Task(Protocol):
    """A manipulation task. Observations and actions are (n, ·) arrays, actions normalised."""

    name: str
    action: str  # "gain" or "force"
    history: int  # observations that the policy sees at once, oldest first
    horizon: int  # policy steps in an episode
    substeps: int  # physics steps in a policy step
    dt: float  # period of the policy [s]
    observation_size: int
    action_size: int
    observation_scale: np.ndarray  # (observation_size,) typical size of each entry
    action_low: np.ndarray
    action_high: np.ndarray
    scenarios: Mapping[str, Scenario]
    scenario: Scenario

    def with_action(self, action: str) -> Task:
        """The same task in another action space."""
        ...

    def simulation(self, count: int, *, threads: int = 1) -> Any:
        """A new batch of simulations of this task."""
        ...

    def start(
        self, simulation: Any, scenarios: Sequence[Any], *, noise: float, rng: np.random.Generator
    ) -> None:
        """Put every simulation at its start."""
        ...

    def act(self, simulation: Any, actions: np.ndarray) -> None:
        """Apply actions (n, action_size), clipped to their bounds, until the next call."""
        ...

    def picture_spec(self) -> Any:
        """Decorated scene, with the joints of the simulation, for a renderer."""
        ...

    def reward(self, observations: np.ndarray) -> np.ndarray:
        """Reward of being where the observations (..., observation_size) are."""
        ...

    def score(self, observations: np.ndarray) -> np.ndarray:
        """Sum of the rewards along paths (T, ..., observation_size)."""
        ...

    def success(self, observations: np.ndarray, peak_force: Any) -> np.ndarray:
        """Whether episodes that end at the observations have done the task."""
        ...

    def outcome(self, simulation: Any, observations: np.ndarray) -> dict[str, np.ndarray]:
        """What an episode ended with: ``success`` (n,) and the figures behind it."""
        ...

    def strata(self, observations: np.ndarray) -> np.ndarray:
        """Part of the way, (...) small integers, that each observation belongs to; learning looks at all alike."""
        ...

    def expert_action(self, observations: np.ndarray) -> np.ndarray:
        """The expert's action, (..., action_size)."""
        ...

    def constant_action(self, observations: np.ndarray | None = None) -> np.ndarray:
        """Action of constant gains, the baseline."""
        ...
