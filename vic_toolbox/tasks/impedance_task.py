r"""What every task with an impedance law has in common: two action spaces, a history, units, and a score.

In the ``gain`` space an action sets the gains of the law, normalised to [-1, 1] over their range; in the ``force``
space it is the feedback wrench itself. In both the law adds the same damping, :attr:`ImpedanceTask.law_damping`, at its
own rate, because a wrench that is held between two policy steps cannot damp a small inertia.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, integer, one_of
from vic_toolbox.gains import Parametrisation


class Expert(Protocol):
    """Gains as a function of the error."""

    def parameters(self, error: ArrayLike, /) -> Array:
        """Gain parameters (..., p) at (e, ė) (..., 12) in SI units."""
        ...


def newest(observations: ArrayLike) -> Array:
    """The last (e, ė) of each row, (..., 12), in the task's units; contiguous."""
    return np.ascontiguousarray(np.asarray(observations, dtype=np.float64)[..., -12:])


class ImpedanceTask(ABC):
    """Base of the tasks: what follows from gains, expert and units alone.

    Parameters
    ----------
    action, history, substeps
        As of the task; ``None`` substeps are the class's own.
    observation_scale : array_like, shape (12,)
        Typical size of one (e, ė), in the task's units.
    observation_unit : array_like, shape (12,)
        What 1 stands for in one (e, ė) [m, rad, m/s, rad/s].
    wrench_unit : array_like, shape (6,)
        Wrench that a force action of 1 stands for [N, Nm].
    largest_force_action : float
        Bound of force actions.

    Raises
    ------
    InputError
        Unknown action space, history or substeps below 1.
    """

    gains: Parametrisation
    constants: Mapping[str, Array]
    substeps: int
    expert: Expert
    law_damping: Array
    """(6,) damping that the law adds in the force space [Ns/m, Nms/rad]."""

    def __init__(
        self,
        *,
        action: str,
        history: int,
        substeps: int | None,
        observation_scale: ArrayLike,
        observation_unit: ArrayLike,
        wrench_unit: ArrayLike,
        largest_force_action: float,
    ) -> None:
        self.action = one_of("action", action, ("gain", "force"))
        self.history = integer("history", history, low=1)
        self.substeps = integer("substeps", type(self).substeps if substeps is None else substeps, low=1)
        self.observation_size = 12 * self.history
        self.observation_unit = np.asarray(observation_unit, dtype=np.float64)
        self.observation_scale = np.tile(observation_scale, self.history)
        self.wrench_unit = np.asarray(wrench_unit, dtype=np.float64)
        self.action_size, bound = (self.gains.size, 1.0) if action == "gain" else (6, largest_force_action)
        self.action_high = np.full(self.action_size, bound)
        self.action_low = -self.action_high
        low, high = self.gains.minimum, self.gains.maximum
        self._middle, self._half = (high + low) / 2, (high - low) / 2

    @abstractmethod
    def reward(self, observations: ArrayLike) -> Array:
        """Reward of a policy step that begins at the observations (..., 12 h), shape (...)."""

    def score(self, observations: ArrayLike) -> Array:
        """Sum of the rewards of T steps, (...), from the observations (T, ..., 12 h) at which they begin."""
        return self.reward(observations).sum(axis=0)

    def expert_action(self, observations: ArrayLike) -> Array:
        """Action of the expert, (..., action_size), for observations (..., 12 h)."""
        return self.gains_to_action(self.expert.parameters(self._error(observations)), observations)

    def constant_action(self, observations: ArrayLike | None = None, *, which: str = "constant") -> Array:
        """Action of one of the constant gains of ``constants``.

        Without observations (gain space only) one action, (action_size,); with them (..., 12 h) one for each.
        """
        parameters = self.constants[one_of("constant gain", which, self.constants)]
        if observations is None:
            if self.action == "force":
                raise InputError(
                    "a constant gain gives another wrench at each observation; pass the observations."
                )
            return self.gains.parameters_to_action(parameters)
        many = np.broadcast_to(parameters, (*np.shape(observations)[:-1], self.gains.size))
        return self.gains_to_action(many, observations)

    def gains_to_action(self, parameters: Array, observations: ArrayLike) -> Array:
        """Action with the effect of gain parameters (..., p) at the observations (..., 12 h).

        In the force space it is −K e − B ė without the damping that the law adds itself.
        """
        if self.action == "gain":
            return self.gains.parameters_to_action(parameters)
        return self._force_action(self._feedback(parameters, self._error(observations)))

    def wrench_to_action(self, wrench: Array, observations: ArrayLike) -> Array:
        """Force action with which the law gives the whole feedback wrench (..., 6) [N, Nm] at the observations.

        The law adds its damping itself.
        """
        return self._force_action(wrench + self.law_damping * self._error(observations)[..., 6:])

    @abstractmethod
    def _feedback(self, parameters: Array, error: Array) -> Array:
        """−K e − B ė (..., 6) without the law's own damping, at (e, ė) (..., 12) in SI units."""

    def _error(self, observations: ArrayLike) -> Array:
        """The newest (e, ė), (..., 12), in SI units."""
        return newest(observations) * self.observation_unit

    def _force_action(self, wrench: Array) -> Array:
        return np.clip(wrench / self.wrench_unit, self.action_low, self.action_high)
