"""What every parametrisation of the gains has in common: parameters in SI units, and actions in [−1, 1].

    action  ⇄  parameters  ⇄  gains
      affine      each parametrisation's own map

An action is what a policy outputs; the parameters are what an engineer reads (N/m, Nm/rad, damping factor);
the gains are what the impedance law uses.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, positive_array
from vic_toolbox.gains.impedance import AXES, ImpedanceGains

RANGE_TOLERANCE = 1e-6
"""Departure from [−1, 1], in units of the action, that is taken for rounding and clipped away."""

MATCH_TOLERANCE = 1e-6
"""Largest relative difference between two dampings that still count as the same."""

OTHER_UNITS = {
    "k": (("N/mm", 1e3),),
    "kr": (("Nm/deg", 180 / np.pi), ("Nmm/rad", 1e-3)),
    "b": (("Ns/mm", 1e3),),
    "br": (("Nms/deg", 180 / np.pi), ("Nmms/rad", 1e-3)),
}
"""Units in which gains are often written, by kind of parameter ("r": about an axis), with their factor to SI."""

SixNumbers = tuple[float, float, float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Parametrisation(ABC):
    """A way to write impedance gains as a vector of bounded parameters.

    The first six parameters are the diagonal of the stiffness matrix; a subclass adds its own after them.
    Every method takes one sample or a batch.
    """

    stiffness_low: SixNumbers
    """Smallest stiffness of each axis: three in N/m, three in Nm/rad."""

    stiffness_high: SixNumbers
    """Largest stiffness of each axis: three in N/m, three in Nm/rad."""

    def __post_init__(self) -> None:
        self._set_range("stiffness_low", "stiffness_high", size=6)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each parameter."""
        return tuple(f"k_{axis}" for axis in AXES)

    @property
    def minimum(self) -> Array:
        """Smallest value of each parameter [SI], shape (size,)."""
        return np.array(self.stiffness_low)

    @property
    def maximum(self) -> Array:
        """Largest value of each parameter [SI], shape (size,)."""
        return np.array(self.stiffness_high)

    @property
    def size(self) -> int:
        """Number of parameters, and length of an action."""
        return len(self.names)

    @property
    def low(self) -> Array:
        """Lower bound of an action: −1 everywhere, shape (size,)."""
        return -np.ones(self.size)

    @property
    def high(self) -> Array:
        """Upper bound of an action: 1 everywhere, shape (size,)."""
        return np.ones(self.size)

    @abstractmethod
    def parameters_to_gains(self, parameters: ArrayLike) -> ImpedanceGains:
        """Return the gains that a vector of parameters (..., size) stands for.

        Raises
        ------
        InputError
            Wrong shape, not finite, or outside [minimum, maximum].
        """

    @abstractmethod
    def gains_to_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the parameters (..., size) that give these gains.

        Raises
        ------
        InputError
            This parametrisation cannot write such gains, or only with parameters outside its range.
        """

    @abstractmethod
    def closest_parameters(self, gains: ImpedanceGains) -> Array:
        """Return parameters (..., size) that come close to any gains: measured ones, say.

        What the parametrisation cannot write, couplings or a damping of its own, is left out; the parameters may
        lie outside its range. Gains that it can write give the same as :meth:`gains_to_parameters`.
        """

    def action_to_parameters(self, action: ArrayLike) -> Array:
        """Return the parameters [SI] of an action, by the affine map of [−1, 1] onto [minimum, maximum].

        Raises
        ------
        InputError
            Wrong shape, not finite, or outside [−1, 1]: clip a policy's sample first.
        """
        a = finite_array("action", action, shape=(..., self.size))
        worst = np.abs(a).max(initial=0.0)
        if worst > 1 + RANGE_TOLERANCE:
            raise InputError(
                f"action has an entry of size {worst:g}; clip it to [-1, 1] first, or, if these are "
                "parameters in SI units, turn them into an action with parameters_to_action."
            )
        a = np.clip(a, -1.0, 1.0)
        return 0.5 * ((1 - a) * self.minimum + (1 + a) * self.maximum)

    def parameters_to_action(self, parameters: ArrayLike) -> Array:
        """Return the action in [−1, 1] that stands for a vector of parameters [SI].

        Raises
        ------
        InputError
            Wrong shape, not finite, or outside [minimum, maximum] (the parameter is named).
        """
        p = self._within_range(parameters)
        minimum, maximum = self.minimum, self.maximum
        return np.clip((2 * p - minimum - maximum) / (maximum - minimum), -1.0, 1.0)

    def to_gains(self, action: ArrayLike) -> ImpedanceGains:
        """Return the gains of an action (..., size) in [−1, 1].

        Raises
        ------
        InputError
            Wrong shape, not finite, or outside [−1, 1]: clip a policy's sample first.
        """
        return self.parameters_to_gains(self.action_to_parameters(action))

    def to_action(self, gains: ImpedanceGains) -> Array:
        """Return the action (..., size) in [−1, 1] that gives these gains: the inverse of :meth:`to_gains`.

        Raises
        ------
        InputError
            This parametrisation cannot write such gains, or only with parameters outside its range.
        """
        return self.parameters_to_action(self.gains_to_parameters(gains))

    def _within_range(self, parameters: ArrayLike) -> Array:
        """Return the parameters, checked, with rounding beyond the range clipped away."""
        p = finite_array("parameters", parameters, shape=(..., self.size))
        minimum, maximum = self.minimum, self.maximum
        slack = RANGE_TOLERANCE * (maximum - minimum) / 2
        outside = (p < minimum - slack) | (p > maximum + slack)
        if outside.any():
            i = int(np.nonzero(outside.reshape(-1, self.size).any(axis=0))[0][0])
            received = p[..., i][outside[..., i]].flat[0]
            raise InputError(
                f"{self.names[i]} is {received:g}; this {type(self).__name__} covers "
                f"[{minimum[i]:g}, {maximum[i]:g}]. "
                + _unit_mistake(self.names[i], float(received), low=minimum[i], high=maximum[i])
                + "Check the units (N/m, Nm/rad, Ns/m, Nms/rad), or widen the range of the parametrisation."
            )
        return np.clip(p, minimum, maximum)

    def _set_range(self, low_field: str, high_field: str, *, size: int) -> None:
        """Check a pair of range fields, and store them as tuples of floats."""
        low = self._set_positive(low_field, size=size)
        high = self._set_positive(high_field, size=size)
        if (low >= high).any():
            i = int(np.argmax(low >= high))
            raise InputError(
                f"{low_field}[{i}] is {low[i]:g} and {high_field}[{i}] is {high[i]:g}; "
                "the low end must be smaller."
            )

    def _set_positive(self, field: str, *, size: int) -> Array:
        values = positive_array(field, getattr(self, field), shape=(size,))
        object.__setattr__(self, field, tuple(values.tolist()))
        return values

    def _require_damping(self, gains: ImpedanceGains, expected: Array) -> None:
        """Refuse gains whose damping is not the one that this parametrisation would give."""
        scale = np.sqrt(np.diagonal(expected, axis1=-2, axis2=-1))
        difference = np.abs(gains.damping - expected) / (scale[..., :, None] * scale[..., None, :])
        if (difference > MATCH_TOLERANCE).any():
            raise InputError(
                f"the damping departs by a relative {difference.max():.2g} from the one that this "
                f"{type(self).__name__} gives to the stiffness; use Diagonal to set both freely."
            )


def _unit_mistake(name: str, value: float, *, low: float, high: float) -> str:
    """Say which unit a value looks like, if there is one that brings it into the range or next to it."""
    kind, _, axis = name.partition("_")  # "k_rx" → "k", "rx"
    for unit, factor in OTHER_UNITS.get(kind + axis[:-1], ()):
        if low / 3 <= factor * value <= 3 * high:
            return f"It looks like {unit}: multiply it by {factor:.4g}. "
    return ""


def require_diagonal(gains: ImpedanceGains) -> tuple[Array, Array]:
    """Return the diagonals of K and B, (..., 6) each, or refuse gains that couple the axes."""
    for name, matrix in (("stiffness", gains.stiffness), ("damping", gains.damping)):
        scale = np.sqrt(np.diagonal(matrix, axis1=-2, axis2=-1))
        coupling = np.abs(matrix) / (scale[..., :, None] * scale[..., None, :]) * (1 - np.eye(6))
        if (coupling > MATCH_TOLERANCE).any():
            raise InputError(
                f"the {name} couples the axes (relative entry {coupling.max():.2g} off the diagonal); "
                "use CholeskyStiffness for full matrices."
            )
    return gains.stiffness_diagonal, gains.damping_diagonal
