"""Full symmetric positive definite stiffness, through its Cholesky factor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vic_toolbox.errors import Array, InputError, finite_number, positive
from vic_toolbox.gains.damping import double_diagonalisation, factor_damping
from vic_toolbox.gains.impedance import AXES, ImpedanceGains
from vic_toolbox.gains.parametrisation import Parametrisation
from vic_toolbox.gains.positive_definite import spd_matrix

ROWS, COLUMNS = np.tril_indices(6, -1)
LARGEST_COUPLING = 0.99

MassMatrix = tuple[tuple[float, ...], ...]


@dataclass(frozen=True, kw_only=True)
class CholeskyStiffness(Parametrisation):
    """All 21 numbers of a symmetric stiffness ``K = L Lᵀ``; the damping follows from K by design.

    Six parameters are the diagonal of K, in SI units as everywhere else. The other fifteen are the partial
    correlations z_ij of the factor's rows,

        L_ij = √k_i z_ij √(Π_{m<j} (1 − z_im²)),  i > j,      L_ii = √k_i √(Π_{m<i} (1 − z_im²)),

    so that row i of L has norm √k_i whatever z is. Every ``|z| < 1`` gives a positive definite K, every
    positive definite K has exactly one z, the range of ``K_ii`` holds exactly, and z = 0 (the middle of the
    action) is the diagonal stiffness.

    The damping is ``d √K`` (set `damping_factor`), or a double diagonalisation with an inertia (set `mass`).

    References
    ----------
    D. Lewandowski, D. Kurowicka, H. Joe, "Generating random correlation matrices based on vines and extended
    onion method", Journal of Multivariate Analysis 100, 2009 (partial correlations as coordinates).
    """

    coupling_limit: float = 0.9
    """Largest partial correlation between two axes, above 0 and at most 0.99."""

    damping_factor: float | None = None
    """Damping factor d of B = d √K [√kg along, √(kg m²) about an axis]."""

    mass: MassMatrix | None = None
    """Inertia M, 6 × 6, that the damping is designed for (kg, kg m, kg m²)."""

    damping_ratio: float = 1.0
    """Damping ratio of every mode of M ë + B ė + K e = 0; used with `mass`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.damping_factor is None) == (self.mass is None):
            raise InputError(
                f"damping_factor and mass are {'both missing' if self.mass is None else 'both set'}; "
                "set exactly one of them, to say how the damping follows from the stiffness."
            )
        positive("coupling_limit", self.coupling_limit)
        limit = finite_number("coupling_limit", self.coupling_limit, high=LARGEST_COUPLING)
        object.__setattr__(self, "coupling_limit", limit)
        object.__setattr__(self, "damping_ratio", positive("damping_ratio", self.damping_ratio))
        if self.damping_factor is not None:
            object.__setattr__(self, "damping_factor", positive("damping_factor", self.damping_factor))
        if self.mass is not None:
            rows = spd_matrix("mass", self.mass, size=6).tolist()
            object.__setattr__(self, "mass", tuple(tuple(row) for row in rows))

    @property
    def names(self) -> tuple[str, ...]:
        """k_x … k_rz, then z_i_j for every pair of axes."""
        return super().names + tuple(f"z_{AXES[i]}_{AXES[j]}" for i, j in zip(ROWS, COLUMNS, strict=True))

    @property
    def minimum(self) -> Array:
        """Smallest stiffnesses [SI], then −coupling_limit, shape (21,)."""
        return np.concatenate([self.stiffness_low, np.full(ROWS.size, -self.coupling_limit)])

    @property
    def maximum(self) -> Array:
        """Largest stiffnesses [SI], then coupling_limit, shape (21,)."""
        return np.concatenate([self.stiffness_high, np.full(ROWS.size, self.coupling_limit)])

    def damping(self, stiffness: ArrayLike) -> Array:
        """Return the designed B (..., 6, 6) of a stiffness (..., 6, 6)."""
        if self.damping_factor is not None:
            return factor_damping(stiffness, self.damping_factor)
        return double_diagonalisation(stiffness, np.array(self.mass), damping_ratio=self.damping_ratio)

    def parameters_to_gains(self, parameters: ArrayLike) -> ImpedanceGains:
        """Return K = L Lᵀ and its designed B for the parameters (..., 21)."""
        p = self._within_range(parameters)
        factor = np.sqrt(p[..., :6, None]) * _correlation_factor(p[..., 6:])
        stiffness = factor @ np.swapaxes(factor, -1, -2)
        return ImpedanceGains(stiffness, self.damping(stiffness))

    def gains_to_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the parameters (..., 21) of a full K whose B is the designed one."""
        parameters = self._within_range(self.closest_parameters(gains))
        self._require_damping(gains, self.damping(gains.stiffness))
        return parameters

    def closest_parameters(self, gains: ImpedanceGains) -> Array:
        """Return the parameters (..., 21) of the stiffness; its designed damping stands for the gains' own."""
        correlations = _partial_correlations(np.linalg.cholesky(gains.stiffness))
        return np.concatenate([gains.stiffness_diagonal, correlations], axis=-1)


def _correlation_factor(correlations: Array) -> Array:
    """Cholesky factor with rows of norm one, (..., 6, 6), from its partial correlations (..., 15)."""
    z = np.zeros((*correlations.shape[:-1], 6, 6))
    z[..., ROWS, COLUMNS] = correlations
    z[...] += np.eye(6)
    # What is left of each row's unit norm before column j.
    left = np.cumprod(1 - z**2, axis=-1)
    z[..., 1:] *= np.sqrt(left[..., :-1])
    return z


def _partial_correlations(factor: NDArray[np.floating]) -> Array:
    """Partial correlations (..., 15) of a Cholesky factor (..., 6, 6): the inverse, for rows of any norm."""
    left = np.cumsum(factor[..., ::-1] ** 2, axis=-1)[..., ::-1]
    return factor[..., ROWS, COLUMNS] / np.sqrt(left[..., ROWS, COLUMNS])
