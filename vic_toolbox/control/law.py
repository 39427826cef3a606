r"""The Cartesian impedance law, its general form with a chosen inertia, and the force law.

An arm that touches its environment obeys, at its end-effector, ``M(x) ẍ + C(x,ẋ) ẋ + G(x) = F − F_ext``: F is
what the joint torques amount to, F_ext the wrench that the robot exerts on its environment. The law sets

    τ = Jᵀ F,    F = F_ff + F_fb,    F_ff = M(x) ẍ_d + C(x,ẋ) ẋ + G(x),    F_fb = −K e − B ė

and the arm behaves as ``M(x) ë + B ė + K e = −F_ext``, with no force sensor. :class:`CartesianLaw` offers two
more behaviours:

========================  =========================================  =========================================
option                    closed loop                                use
========================  =========================================  =========================================
(default)                 M(x) ë + B ė + K e = −F_ext                the paper's law
``coriolis="reference"``  M(x) ë + (C(x,ẋ) + B) ė + K e = −F_ext     passive, also about a moving reference
``inertia=M_d``           M_d ë + B ė + K e = −F_ext                 decoupled axes; needs a measured F_ext
========================  =========================================  =========================================

Passive means that ``V = ½ ėᵀ M(x) ė + ½ eᵀ K e`` changes by ``V̇ = −ėᵀ B ė − ėᵀ F_ext``, because Ṁ − 2 C is
skew-symmetric. This holds for a constant K whose rotational part is isotropic and not coupled to the
translations; for any other K it holds to leading order in the angle. In the default law V̇ gains ½ ėᵀ Ṁ(x) ė, of
either sign.

References
----------
X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021.
N. Hogan, "Impedance control: an approach to manipulation", ASME J. Dyn. Sys. Meas. Control 107, 1985.
C. Ott, "Cartesian Impedance Control of Redundant and Flexible-Joint Robots", Springer, 2008, chapter 3.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.control.nullspace import Posture
from vic_toolbox.errors import Array, InputError, finite_array, one_of
from vic_toolbox.gains import ImpedanceGains, spd_matrix
from vic_toolbox.spatial import check_pose, pose_error

if TYPE_CHECKING:
    from vic_toolbox.models import OperationalSpace, RobotModel


def _zeros() -> Array:
    return np.zeros(6)


@dataclass(frozen=True, eq=False)
class Reference:
    """Where the end-effector should be, and how it should move there: x_d, ẋ_d, ẍ_d in world axes."""

    pose: Array
    """x_d: homogeneous matrix, shape (..., 4, 4)."""

    twist: Array = field(default_factory=_zeros)
    """ẋ_d = [v_d; ω_d] [m/s, rad/s], shape (..., 6)."""

    acceleration: Array = field(default_factory=_zeros)
    """ẍ_d = d/dt [v_d; ω_d] [m/s², rad/s²], shape (..., 6)."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "pose", check_pose("reference pose", self.pose))
        for name in ("twist", "acceleration"):
            checked = finite_array(f"reference {name}", getattr(self, name), shape=(..., 6))
            object.__setattr__(self, name, checked)


@dataclass(frozen=True, eq=False)
class Command:
    """What the law asks of the arm: joint torques, and the two wrenches behind them (world axes)."""

    torque: Array
    """τ [Nm], shape (..., nv)."""

    feedforward: Array
    """F_ff: what the motion itself needs, shape (..., 6)."""

    feedback: Array
    """F_fb: what the errors, or a force policy, ask for, shape (..., 6)."""


def feedback_wrench(error: ArrayLike, error_rate: ArrayLike, *, gains: ImpedanceGains) -> Array:
    """Return ``F_fb = −K e − B ė``.

    Parameters
    ----------
    error, error_rate : array_like, shape (..., 6)
        e and ė, see :func:`vic_toolbox.spatial.pose_error`.
    gains : ImpedanceGains
        K and B in the same axes, one pair or one for each sample.

    Returns
    -------
    ndarray, shape (..., 6)
    """
    e = finite_array("error", error, shape=(..., 6))
    rate = finite_array("error_rate", error_rate, shape=(..., 6))
    return -np.matvec(gains.stiffness, e) - np.matvec(gains.damping, rate)


def feedforward_wrench(space: OperationalSpace, acceleration: ArrayLike) -> Array:
    """Return ``F_ff = M(x) ẍ_d + C(x,ẋ) ẋ + G(x)``, the wrench that accelerates the end-effector by ẍ_d.

    Parameters
    ----------
    space : OperationalSpace
        Operational-space terms of the present state, from ``RobotModel.operational_space``.
    acceleration : array_like, shape (..., 6)
        ẍ_d.

    Returns
    -------
    ndarray, shape (..., 6)
    """
    wanted = finite_array("acceleration", acceleration, shape=(..., 6))
    return np.matvec(space.mass, wanted) + space.coriolis + space.gravity


@dataclass(frozen=True, kw_only=True, eq=False)
class CartesianLaw:
    """Impedance and force control of one frame of a serial arm; a redundant one keeps a posture beside it.

    Every method takes one state, ``q`` and ``v`` of shape (nv,), or a batch (n, nv); references, gains and
    wrenches are then shared by the batch or given for each sample. The joint torque is

        τ = Jᵀ F + N (C q̇ + g + τ₀)

    where N (see :mod:`~vic_toolbox.control.nullspace`) is zero for six joints away from singularities.
    """

    model: RobotModel
    """The arm. Its mass and tool decide how well gravity and inertia are compensated."""

    frame: str | None = None
    """Controlled frame; None: the model's end-effector."""

    coriolis: Literal["exact", "reference"] = "exact"
    """Feed-forward ``C ẋ`` (exact), or ``C ẋ_d`` (reference), which keeps the passivity argument."""

    inertia: Array | None = None
    """M_d: wanted inertia (6, 6), symmetric positive definite; None: the arm's own M(x)."""

    posture: Posture | None = None
    """What a redundant arm does with its free joints; None: they are compensated, and move undamped."""

    def __post_init__(self) -> None:
        one_of("coriolis", self.coriolis, ("exact", "reference"))
        if self.inertia is not None:
            object.__setattr__(self, "inertia", spd_matrix("inertia", self.inertia, size=6))
            if self.coriolis == "reference":
                raise InputError(
                    "coriolis='reference' keeps the arm's own inertia, so it cannot go with a chosen one; "
                    "pass inertia or coriolis='reference', not both."
                )
        if self.posture is not None and self.posture.angles.size != self.model.nv:
            raise InputError(
                f"posture has {self.posture.angles.size} angles; "
                f"pass {self.model.nv}, one for each joint of {self.model.name}."
            )

    def error(self, q: ArrayLike, v: ArrayLike, *, reference: Reference) -> tuple[Array, Array]:
        """Return ``e = [p − p_d; log(R R_dᵀ)]`` and ``ė = ẋ − ẋ_d``, shape (..., 6) each."""
        pose = self.model.pose(q, frame=self.frame)
        return pose_error(pose, reference.pose), self.model.twist(q, v, frame=self.frame) - reference.twist

    def impedance(
        self,
        q: ArrayLike,
        v: ArrayLike,
        *,
        reference: Reference,
        gains: ImpedanceGains,
        external_wrench: ArrayLike | None = None,
    ) -> Command:
        """Return the command that makes the end-effector a mass, spring and damper about the reference.

        Parameters
        ----------
        q, v : array_like, shape (..., nv)
            Joint angles [rad] and speeds [rad/s].
        reference : Reference
            x_d, ẋ_d and ẍ_d.
        gains : ImpedanceGains
            K and B in world axes.
        external_wrench : array_like, shape (..., 6), optional
            Measured F_ext that the robot exerts on its environment, at the controlled frame, world axes. It
            is needed with `inertia`, and has no place in the law without it.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            Wrong shapes, values that are not finite, or `external_wrench` missing or out of place.
        """
        e, rate = self.error(q, v, reference=reference)
        feedback = feedback_wrench(e, rate, gains=gains)
        space = self.model.operational_space(q, v, frame=self.frame)
        feedforward = feedforward_wrench(space, reference.acceleration)
        if self.coriolis == "reference":
            feedforward = feedforward - np.matvec(self._task_coriolis(q, v, space), rate)
        return self._command(q, v, space, feedforward, feedback, external_wrench)

    def force(
        self, q: ArrayLike, v: ArrayLike, *, wrench: ArrayLike, external_wrench: ArrayLike | None = None
    ) -> Command:
        """Return the command that puts `wrench` in the place of F_fb: ``M(x) ẍ = wrench − F_ext``.

        Parameters
        ----------
        q, v : array_like, shape (..., nv)
            Joint angles [rad] and speeds [rad/s].
        wrench : array_like, shape (..., 6)
            F_fb, as a force policy sets it, world axes.
        external_wrench : array_like, shape (..., 6), optional
            As in :meth:`impedance`; with `inertia`, ``M_d ẍ = wrench − F_ext``.

        Returns
        -------
        Command

        Raises
        ------
        InputError
            As :meth:`impedance`.
        """
        feedback = finite_array("wrench", wrench, shape=(..., 6))
        space = self.model.operational_space(q, v, frame=self.frame)
        return self._command(q, v, space, feedforward_wrench(space, np.zeros(6)), feedback, external_wrench)

    def _command(
        self,
        q: ArrayLike,
        v: ArrayLike,
        space: OperationalSpace,
        feedforward: Array,
        feedback: Array,
        external_wrench: ArrayLike | None,
    ) -> Command:
        """Joint torque ``τ = Jᵀ F + N (C q̇ + g + τ₀)``, with ``N τ = τ − Jᵀ J̄ᵀ τ``."""
        force = feedforward + self._shaped(space, feedback, external_wrench)
        rest = self.model.bias(q, v)
        if self.posture is not None:
            rest = rest + self.posture.torque(q, v)
        at_task = np.vecmat(rest, space.jacobian_inverse)
        torque = rest + np.vecmat(force - at_task, space.jacobian)
        return Command(torque=torque, feedforward=feedforward, feedback=feedback)

    def _shaped(self, space: OperationalSpace, feedback: Array, external_wrench: ArrayLike | None) -> Array:
        """What F must add to F_ff: F_fb itself, or with M_d ``M(x) M_d⁻¹ (F_fb − F_ext) + F_ext``."""
        if self.inertia is None:
            if external_wrench is not None:
                raise InputError(
                    "external_wrench was given to a law without inertia, which needs no force sensor; "
                    "leave it out, or choose the inertia."
                )
            return feedback
        if external_wrench is None:
            raise InputError(
                "a law with a chosen inertia needs the measured external_wrench; pass zeros in free motion."
            )
        measured = finite_array("external_wrench", external_wrench, shape=(..., 6))
        wanted = np.linalg.solve(self.inertia, (feedback - measured)[..., None])[..., 0]
        return np.matvec(space.mass, wanted) + measured

    def _task_coriolis(self, q: ArrayLike, v: ArrayLike, space: OperationalSpace) -> Array:
        """C(x,ẋ) = J̄ᵀ C J̄ − M(x) J̇ J̄, the one with Ṁ(x) − 2 C(x,ẋ) skew-symmetric; shape (..., 6, 6)."""
        inverse = space.jacobian_inverse
        joint = np.swapaxes(inverse, -1, -2) @ self.model.coriolis_matrix(q, v)
        return (joint - space.mass @ space.jacobian_dot) @ inverse
