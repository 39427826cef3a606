"""Designed experts: from what the arm sees to the gains that it should use.

An observation is ``(e, ė)`` in R¹², or several of them with the newest last (a history). An expert belongs to
a parametrisation of the gains and stays within its range, whatever it observes.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, positive, positive_array
from vic_toolbox.gains import DampingFactor, DiagonalStiffness, ImpedanceGains, Parametrisation, spd_matrix
from vic_toolbox.spatial import rotation_exp, transport_twist, transport_wrench


@dataclass(frozen=True, kw_only=True)
class Expert(ABC):
    """A source of gains, in three forms: parameters in SI units, normalised actions, gain matrices."""

    parametrisation: Parametrisation
    """How the gains are written, and in which range."""

    @abstractmethod
    def parameters(self, observation: ArrayLike) -> Array:
        """Return the parameters [SI], (..., size), for observations (..., 12 h) with the newest (e, ė) last.

        Raises
        ------
        InputError
            Wrong shape, or entries that are not finite.
        """

    def action(self, observation: ArrayLike) -> Array:
        """Return the same as an action in [−1, 1], (..., size), as a policy would give it."""
        return self.parametrisation.parameters_to_action(self.parameters(observation))

    def gains(self, observation: ArrayLike) -> ImpedanceGains:
        """Return the same as stiffness and damping matrices."""
        return self.parametrisation.parameters_to_gains(self.parameters(observation))


@dataclass(frozen=True, kw_only=True)
class ThreePhaseExpert(Expert):
    """Accelerate from far, blend, then reach softly: the expert of Cup-on-Plate.

    With the distance ``s = ‖p − p_d‖`` and the blend ``w = clip((s − near)/(far − near), 0, 1)``

        k = k_low + w (k_high − k_low),    d = d_high − w (d_high − d_low)

    so that far away (w = 1) the arm is stiff and lightly damped, and close by (w = 0) soft and well damped.
    The gains are continuous in the observation.

    References
    ----------
    X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
    Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021 (Cup-on-Plate).
    """

    parametrisation: DampingFactor
    """Range of the stiffnesses and of the damping factor."""

    far: float = 0.4
    """Distance [m] beyond which the arm accelerates."""

    near: float = 0.2
    """Distance [m] below which the arm reaches."""

    def __post_init__(self) -> None:
        if not isinstance(self.parametrisation, DampingFactor):
            raise InputError(
                f"parametrisation is {type(self.parametrisation).__name__}; the three-phase expert sets six "
                "stiffnesses and a damping factor: pass a DampingFactor."
            )
        for name in ("far", "near"):
            object.__setattr__(self, name, positive(name, getattr(self, name)))
        if self.near >= self.far:
            raise InputError(f"near is {self.near:g} m and far is {self.far:g} m; near must be smaller.")

    def parameters(self, observation: ArrayLike) -> Array:
        """Return six stiffnesses and the damping factor, (..., 7), see :meth:`Expert.parameters`."""
        distance = np.linalg.norm(_newest(observation)[..., :3], axis=-1, keepdims=True)
        weight = np.clip((distance - self.near) / (self.far - self.near), 0.0, 1.0)
        low, high = self.parametrisation.minimum, self.parametrisation.maximum
        close_by = np.append(low[:6], high[6])
        far_away = np.append(high[:6], low[6])
        return (1.0 - weight) * close_by + weight * far_away


@dataclass(frozen=True, kw_only=True)
class TipStiffnessExpert(Expert):
    r"""A fixed stiffness at another point of the body, its tip, written as gains of the end-effector.

    With the tip at :math:`r = R\,\mathrm{offset}` from the end-effector, the rotation :math:`R = \exp(e_{rot})`
    away from the reference, and :math:`J_{tip} = [I, -[r]_\times;\ 0, I]`, the wrench of the tip's spring is

    .. math:: w = K_{COM}\,e, \qquad K_{COM} = J_{tip}^T\,K_{tip}\,J_{tip}.

    Diagonal gains with the same effect solve :math:`k_i e_i = w_i`, which is singular at :math:`e_i = 0` and may
    be negative. So each is the ridge solution towards the tip's own stiffness, clipped to the range:

    .. math:: k_i = \frac{w_i e_i + \varepsilon_i^2\,K_{tip,ii}}{e_i^2 + \varepsilon_i^2}

    the minimiser of :math:`(k_i e_i - w_i)^2 + \varepsilon_i^2 (k_i - K_{tip,ii})^2`.

    References
    ----------
    X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
    Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021 (Peg-in-Hole).
    """

    parametrisation: DiagonalStiffness
    """Range of the six stiffnesses, and the fixed damping."""

    offset: tuple[float, float, float]
    """From the end-effector to the tip, axes of the body, which are those of the world at the reference [m]."""

    tip_stiffness: ArrayLike
    """K_tip: six stiffnesses, or a symmetric positive definite (6, 6) matrix [N/m, Nm/rad], world axes."""

    ridge: tuple[float, float] = (1e-4, 2e-3)
    """Error ε below which the gains lean towards K_tip: translations [m], rotations [rad]."""

    def __post_init__(self) -> None:
        if not isinstance(self.parametrisation, DiagonalStiffness):
            raise InputError(
                f"parametrisation is {type(self.parametrisation).__name__}; the tip-stiffness expert sets six "
                "stiffnesses: pass a DiagonalStiffness."
            )
        offset = finite_array("offset", self.offset, shape=(3,))
        object.__setattr__(self, "offset", tuple(offset.tolist()))
        stiffness = finite_array("tip_stiffness", self.tip_stiffness)
        if stiffness.shape == (6,):
            stiffness = np.diag(positive_array("tip_stiffness", stiffness))
        stiffness = spd_matrix("tip_stiffness", stiffness, size=6)
        stiffness.flags.writeable = False
        object.__setattr__(self, "tip_stiffness", stiffness)
        ridge = positive_array("ridge", self.ridge, shape=(2,))
        object.__setattr__(self, "ridge", tuple(ridge.tolist()))

    def tip_error(self, observation: ArrayLike) -> Array:
        """Pose error of the tip to first order, ``J_tip e``, (..., 6), for observations (..., 12 h)."""
        error = _newest(observation)[..., :6]
        return transport_twist(error, self._lever(error))

    def wrench(self, observation: ArrayLike) -> Array:
        """Wrench ``K_COM e`` at the end-effector, (..., 6) [N, Nm]; the spring pulls with its negative."""
        error = _newest(observation)[..., :6]
        lever = self._lever(error)
        at_tip = transport_twist(error, lever) @ np.asarray(self.tip_stiffness)
        return transport_wrench(at_tip, -lever)

    def parameters(self, observation: ArrayLike) -> Array:
        """Return six stiffnesses, (..., 6), see :meth:`Expert.parameters`."""
        error = _newest(observation)[..., :6]
        squared = np.repeat(np.square(self.ridge), 3)
        towards = np.diagonal(np.asarray(self.tip_stiffness))
        stiffness = (self.wrench(observation) * error + squared * towards) / (error**2 + squared)
        return np.clip(stiffness, self.parametrisation.minimum, self.parametrisation.maximum)

    def _lever(self, error: Array) -> Array:
        """From the end-effector to the tip, world axes, (..., 3) [m]."""
        return np.einsum("...ij,j->...i", rotation_exp(error[..., 3:]), np.array(self.offset))


@dataclass(frozen=True, kw_only=True)
class ConstantGains(Expert):
    """The same gains everywhere: the baseline that every learned schedule has to beat."""

    level: float = 0.5
    """Where in the range: 0 is the smallest value of every parameter, 1 the largest."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "level", finite_number("level", self.level, low=0.0, high=1.0))

    def parameters(self, observation: ArrayLike) -> Array:
        """Return the same parameters for every observation, see :meth:`Expert.parameters`."""
        low, high = self.parametrisation.minimum, self.parametrisation.maximum
        constant = (1.0 - self.level) * low + self.level * high
        return np.broadcast_to(constant, (*_newest(observation).shape[:-1], constant.size)).copy()


def _newest(observation: ArrayLike) -> Array:
    """Return the last (e, ė) of each row, (..., 12)."""
    rows = finite_array("observation", observation, shape=(..., None))
    if rows.shape[-1] == 0 or rows.shape[-1] % 12:
        raise InputError(
            f"observation has {rows.shape[-1]} numbers in a row; pass (e, ė), 12 numbers, or a history of it."
        )
    return rows[..., -12:]
