r"""An arm in closed loop, integrated with its own rigid-body model: what a law does, without a simulator.

.. math:: M(q)\,\ddot q + C(q,\dot q)\,\dot q + g(q) = \tau(t, q, \dot q) - J^T F_{ext}(t, q, \dot q)

Joint limits, joint friction and the shapes of links are not part of it; contact with shapes is the business of
:mod:`vic_toolbox.tasks`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.control.law import Reference
from vic_toolbox.errors import Array, InputError, SimulationError, finite_array, one_of, positive
from vic_toolbox.spatial import pose_error

if TYPE_CHECKING:
    from vic_toolbox.models import RobotModel

FASTEST_JOINT = 1e3
"""Joint speed [rad/s] beyond which the integration counts as diverged; no arm comes near it."""

TimedFunction = Callable[[float, Array, Array], ArrayLike]
"""Function of the time [s], the joint angles [rad] and the joint speeds [rad/s], (..., nv) each."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What an arm, or a batch of them, did: T samples in time, the last one at the end."""

    time: Array
    """[s], shape (T,)."""

    q: Array
    """Joint angles [rad], shape (T, ..., nv)."""

    v: Array
    """Joint speeds [rad/s], shape (T, ..., nv)."""

    torque: Array
    """τ that the controller asked for [Nm], shape (T, ..., nv)."""

    external_wrench: Array
    """F_ext that the robot exerted on its environment at the frame, world axes, shape (T, ..., 6)."""

    pose: Array
    """Pose of the frame, shape (T, ..., 4, 4)."""

    twist: Array
    """[v; ω] of the frame, world axes, shape (T, ..., 6)."""

    def error(self, reference: Reference) -> tuple[Array, Array]:
        """Return ``e = [p − p_d; log(R R_dᵀ)]`` and ``ė = ẋ − ẋ_d``, shape (T, ..., 6) each.

        The reference is one for all, or one for each sample: its arrays broadcast against (T, ...).
        """
        return pose_error(self.pose, reference.pose), self.twist - reference.twist


def simulate(
    model: RobotModel,
    controller: TimedFunction,
    *,
    q: ArrayLike,
    v: ArrayLike | None = None,
    duration: float,
    timestep: float = 1e-3,
    external_wrench: TimedFunction | None = None,
    frame: str | None = None,
    method: Literal["runge-kutta", "semi-implicit"] = "runge-kutta",
) -> Motion:
    """Integrate an arm, or a batch of arms, under a controller.

    Parameters
    ----------
    model : RobotModel
        The arm.
    controller : callable
        ``controller(t, q, v)`` returns the joint torques τ [Nm], (..., nv). One start serves a batch of
        controllers: the arms are as many as its torques.
    q : array_like, shape (..., nv)
        Joint angles at the start [rad].
    v : array_like, shape (..., nv), optional
        Joint speeds at the start [rad/s]; at rest by default.
    duration : float
        Length of the motion [s], rounded to whole steps.
    timestep : float
        Length of a step [s].
    external_wrench : callable, optional
        ``external_wrench(t, q, v)`` returns F_ext that the robot exerts on its environment, (..., 6), world
        axes. A hand that pushes with the wrench w makes it −w; a spring of stiffness k about p_0 makes its
        force k (p − p_0).
    frame : str, optional
        Where `external_wrench` acts, and whose pose and twist are recorded; the end-effector by default.
    method : {"runge-kutta", "semi-implicit"}
        Runge-Kutta of fourth order, for a law in continuous time; or semi-implicit Euler with the torque held
        during each step, as a controller with this period has it.

    Returns
    -------
    Motion

    Raises
    ------
    InputError
        Wrong shapes (also of what the callables return), values that are not finite, or no whole step.
    ModelError
        Unknown frame.
    SimulationError
        The motion diverges; the message says when.

    Examples
    --------
    Push a soft arm with 10 N for a second:

    >>> from vic_toolbox.control import CartesianLaw, Reference, simulate
    >>> from vic_toolbox.gains import ImpedanceGains
    >>> from vic_toolbox.models import load_robot
    >>> arm = load_robot("fanuc_lrmate200id7l")
    >>> law, here = CartesianLaw(model=arm), Reference(arm.pose(arm.home))
    >>> gains = ImpedanceGains.diagonal([500.0] * 3 + [50.0] * 3, [120.0] * 3 + [10.0] * 3)
    >>> motion = simulate(
    ...     arm,
    ...     lambda t, q, v: law.impedance(q, v, reference=here, gains=gains).torque,
    ...     q=arm.home,
    ...     duration=1.0,
    ...     timestep=4e-3,
    ...     external_wrench=lambda t, q, v: [0, 0, 10.0, 0, 0, 0],  # the hand pushes downward
    ... )
    >>> error, _ = motion.error(here)
    >>> float(error[-1, 2].round(3))  # 10 N over 500 N/m
    -0.02
    """
    step = _STEPS[one_of("method", method, _STEPS)]
    dt = positive("timestep", timestep)
    count = round(positive("duration", duration) / dt)
    if count < 1:
        raise InputError(f"duration is {duration:g} s and timestep {dt:g} s; pass at least one whole step.")
    dynamics = _Dynamics(model, controller, external_wrench, frame)
    angles = finite_array("q", q, shape=(..., model.nv))
    speeds = np.zeros(model.nv) if v is None else finite_array("v", v, shape=(..., model.nv))
    *_, acceleration = dynamics(0.0, angles, speeds)
    batch = acceleration.shape
    angles, speeds = np.broadcast_to(angles, batch), np.broadcast_to(speeds, batch)

    time, samples = dt * np.arange(count + 1, dtype=np.float64), []
    for i, t in enumerate(time.tolist()):
        if i > 0:
            angles, speeds = step(dynamics.acceleration, time[i - 1], angles, speeds, acceleration, dt)
            _refuse_divergence(t, speeds, dt)
        torque, wrench, acceleration = dynamics(t, angles, speeds)
        samples.append((angles, speeds, np.broadcast_to(torque, batch), wrench))
    angles, speeds, torque, wrench = (np.array(column) for column in zip(*samples, strict=True))
    return Motion(
        time=time,
        q=angles,
        v=speeds,
        torque=torque,
        external_wrench=wrench,
        pose=model.pose(angles, frame=frame),
        twist=model.twist(angles, speeds, frame=frame),
    )


@dataclass(frozen=True, eq=False)
class _Dynamics:
    """The arm, its controller and its environment."""

    model: RobotModel
    controller: TimedFunction
    environment: TimedFunction | None
    frame: str | None

    def __call__(self, t: float, q: Array, v: Array) -> tuple[Array, Array, Array]:
        """Return τ, F_ext and q̈."""
        torque = finite_array("the controller's torque", self.controller(t, q, v), shape=(..., self.model.nv))
        if self.environment is None:
            acceleration = self.model.acceleration(q, v, torque)
            return torque, np.zeros((*acceleration.shape[:-1], 6)), acceleration
        wrench = finite_array("external_wrench", self.environment(t, q, v), shape=(..., 6))
        acceleration = self.model.acceleration(q, v, torque, external_wrench=wrench, frame=self.frame)
        return torque, np.broadcast_to(wrench, (*acceleration.shape[:-1], 6)), acceleration

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return q̈."""
        return self(t, q, v)[2]


def _refuse_divergence(t: float, speeds: Array, dt: float) -> None:
    if not (np.abs(speeds) <= FASTEST_JOINT).all():  # NaN included
        raise SimulationError(
            f"the motion diverges at {t:.4g} s: a joint is faster than {FASTEST_JOINT:g} rad/s. Shorten the "
            f"timestep ({dt:g} s), or lower the damping: a law needs timestep · λmax(M(x)⁻¹B) < 2."
        )


Acceleration = Callable[[float, Array, Array], Array]


def _runge_kutta(
    acceleration: Acceleration, t: float, q: Array, v: Array, first: Array, dt: float
) -> tuple[Array, Array]:
    """The classical method of fourth order; ``first`` is the acceleration at the beginning of the step."""
    half = dt / 2
    second_v = v + half * first
    second = acceleration(t + half, q + half * v, second_v)
    third_v = v + half * second
    third = acceleration(t + half, q + half * second_v, third_v)
    fourth_v = v + dt * third
    fourth = acceleration(t + dt, q + dt * third_v, fourth_v)
    return (
        q + dt / 6 * (v + 2 * second_v + 2 * third_v + fourth_v),
        v + dt / 6 * (first + 2 * second + 2 * third + fourth),
    )


def _semi_implicit(
    acceleration: Acceleration, t: float, q: Array, v: Array, first: Array, dt: float
) -> tuple[Array, Array]:
    """Euler's method for the speeds, and with the new speeds for the angles: first order, and robust."""
    v = v + dt * first
    return q + dt * v, v


_STEPS = {"runge-kutta": _runge_kutta, "semi-implicit": _semi_implicit}
