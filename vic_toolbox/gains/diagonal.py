"""Parametrisations with one stiffness for each axis and no coupling between axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, positive
from vic_toolbox.gains.impedance import AXES, ImpedanceGains
from vic_toolbox.gains.parametrisation import Parametrisation, SixNumbers, require_diagonal


@dataclass(frozen=True, kw_only=True)
class DiagonalStiffness(Parametrisation):
    """Six stiffnesses; the damping stays fixed: ``K = diag(k)``, ``B = diag(damping)``."""

    damping: SixNumbers
    """Fixed damping of each axis: three in Ns/m, three in Nms/rad."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_positive("damping", size=6)

    def parameters_to_gains(self, parameters: ArrayLike) -> ImpedanceGains:
        """Return diag(k) and the fixed damping for the parameters (..., 6)."""
        return ImpedanceGains.diagonal(self._within_range(parameters), self.damping)

    def gains_to_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the six stiffnesses of diagonal gains that have the fixed damping."""
        self._require_damping(gains, np.diag(self.damping))
        stiffness, _ = require_diagonal(gains)
        return self._within_range(stiffness)

    def closest_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the diagonal of K, (..., 6)."""
        return np.array(gains.stiffness_diagonal)


@dataclass(frozen=True, kw_only=True)
class Diagonal(Parametrisation):
    """Six stiffnesses and six dampings: ``K = diag(k)``, ``B = diag(b)``."""

    damping_low: SixNumbers
    """Smallest damping of each axis: three in Ns/m, three in Nms/rad."""

    damping_high: SixNumbers
    """Largest damping of each axis: three in Ns/m, three in Nms/rad."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_range("damping_low", "damping_high", size=6)

    @property
    def names(self) -> tuple[str, ...]:
        """k_x … k_rz, then b_x … b_rz."""
        return super().names + tuple(f"b_{axis}" for axis in AXES)

    @property
    def minimum(self) -> Array:
        """Smallest stiffnesses, then dampings [SI], shape (12,)."""
        return np.array(self.stiffness_low + self.damping_low)

    @property
    def maximum(self) -> Array:
        """Largest stiffnesses, then dampings [SI], shape (12,)."""
        return np.array(self.stiffness_high + self.damping_high)

    def parameters_to_gains(self, parameters: ArrayLike) -> ImpedanceGains:
        """Return diag(k) and diag(b) for the parameters (..., 12)."""
        p = self._within_range(parameters)
        return ImpedanceGains.diagonal(p[..., :6], p[..., 6:])

    def gains_to_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the stiffnesses and dampings of diagonal gains, (..., 12)."""
        return self._within_range(np.concatenate(require_diagonal(gains), axis=-1))

    def closest_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the diagonals of K and B, (..., 12)."""
        return np.concatenate([gains.stiffness_diagonal, gains.damping_diagonal], axis=-1)


@dataclass(frozen=True, kw_only=True)
class DampingFactor(Parametrisation):
    """Six stiffnesses and one damping factor d: ``K = diag(k)``, ``B = d √K``.

    The gain action of Zhang et al. (2021). With `rotational_damping` set, the factor shapes the three
    translations only.
    """

    factor_low: float
    """Smallest damping factor d [√kg along, √(kg m²) about an axis]."""

    factor_high: float
    """Largest damping factor d [√kg along, √(kg m²) about an axis]."""

    rotational_damping: float | None = None
    """Fixed damping of the three rotations [Nms/rad]; None: d √K there too."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for field in ("factor_low", "factor_high"):
            object.__setattr__(self, field, positive(field, getattr(self, field)))
        if self.factor_low >= self.factor_high:
            raise InputError(
                f"factor_low is {self.factor_low:g} and factor_high is {self.factor_high:g}; "
                "the low end must be smaller."
            )
        if self.rotational_damping is not None:
            fixed = positive("rotational_damping", self.rotational_damping)
            object.__setattr__(self, "rotational_damping", fixed)

    @property
    def names(self) -> tuple[str, ...]:
        """k_x … k_rz, then d."""
        return (*super().names, "d")

    @property
    def minimum(self) -> Array:
        """Smallest stiffnesses, then damping factor [SI], shape (7,)."""
        return np.array((*self.stiffness_low, self.factor_low))

    @property
    def maximum(self) -> Array:
        """Largest stiffnesses, then damping factor [SI], shape (7,)."""
        return np.array((*self.stiffness_high, self.factor_high))

    def damping(self, parameters: ArrayLike) -> Array:
        """Return the diagonal of B, (..., 6), for the parameters (..., 7)."""
        return self._damping(self._within_range(parameters))

    def parameters_to_gains(self, parameters: ArrayLike) -> ImpedanceGains:
        """Return diag(k) and its damping for the parameters (..., 7)."""
        p = self._within_range(parameters)
        return ImpedanceGains.diagonal(p[..., :6], self._damping(p))

    def gains_to_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the stiffnesses and the factor of diagonal gains with B = d √K, (..., 7)."""
        stiffness, damping = require_diagonal(gains)
        factor = (damping[..., self._shaped] / np.sqrt(stiffness[..., self._shaped])).mean(
            axis=-1, keepdims=True
        )
        parameters = np.concatenate([stiffness, factor], axis=-1)
        self._require_damping(gains, self._damping(parameters)[..., None] * np.eye(6))
        return self._within_range(parameters)

    def closest_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the diagonal of K and the d with the least ``Σ (b − d √k)²`` over the axes it shapes, (..., 7)."""
        stiffness, damping = gains.stiffness_diagonal, gains.damping_diagonal
        k, b = stiffness[..., self._shaped], damping[..., self._shaped]
        factor = (b * np.sqrt(k)).sum(axis=-1, keepdims=True) / k.sum(axis=-1, keepdims=True)
        return np.concatenate([stiffness, factor], axis=-1)

    @property
    def _shaped(self) -> slice:
        """Axes whose damping the factor shapes."""
        return slice(0, 6 if self.rotational_damping is None else 3)

    def _damping(self, parameters: Array) -> Array:
        damping = parameters[..., 6:] * np.sqrt(parameters[..., :6])
        if self.rotational_damping is not None:
            damping[..., 3:] = self.rotational_damping
        return damping
