"""A serial arm as numbers: M, C, G, J, J̇ and the operational-space terms, by Pinocchio."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, ModelError, array_within, common_batch, finite_array, integer, positive
from vic_toolbox.models import inverse_kinematics
from vic_toolbox.models.catalogue import RobotDescription, find_robot
from vic_toolbox.models.home import choose_home
from vic_toolbox.models.operational_space import OperationalSpace, operational_space
from vic_toolbox.models.samples import map_samples, same_batch
from vic_toolbox.models.urdf import attach_tool, read_arm
from vic_toolbox.spatial import check_pose

WORLD_AXES = pin.LOCAL_WORLD_ALIGNED


class RobotModel:
    """Rigid-body model of a fixed-base serial arm, maybe with a tool, as ``load_robot`` makes it.

    Every numeric method takes one sample, ``q`` of shape (nq,), or a batch (..., nq), and returns results
    with the same leading dimensions. Units are SI, twists and wrenches are linear first, in world axes at the
    origin of the frame. The armature (rotor inertia on the joint side) is part of M, as in MuJoCo.

    One model holds one workspace: give each thread its own.

    Attributes
    ----------
    name : str
        Name in the catalogue.
    nq, nv : int
        Number of joints (equal: one coordinate a joint).
    joint_names, frame_names : tuple of str
        Joints from base to tip; links that can serve as `frame`.
    lower, upper, velocity_limits, effort_limits : ndarray, shape (nq,)
        Limits [rad, rad/s, Nm]; infinite where there are none.
    armature : ndarray, shape (nv,)
        Rotor inertia on the joint side [kg m²].
    home : ndarray, shape (nq,)
        Rest posture [rad].
    frame : str
        The end-effector: frame of all methods unless they are told another one.
    mount : str
        Frame of the arm that carries a tool.
    urdf_path, tool_urdf_path : Path, Path or None
        Where the model comes from.
    locked_joints : tuple of str
        Joints of the URDF that are no part of the arm (fingers), locked at zero.
    pinocchio : pinocchio.Model
        The model itself, for what is not offered here; treat it as read-only.
    """

    def __init__(
        self,
        description: RobotDescription,
        tool: RobotDescription | None = None,
        *,
        frame: str | None = None,
        armature: ArrayLike | None = None,
    ) -> None:
        arm = read_arm(description.urdf)
        self.name = description.name
        self.urdf_path = description.urdf
        self.tool_urdf_path = tool.urdf if tool else None
        self.locked_joints = arm.locked
        self.mount = description.tool_mount or description.end_effector or arm.tip
        self._frames = _links(arm.model)
        self._index(self.mount)
        self.pinocchio = attach_tool(arm.model, self.mount, tool=tool.urdf) if tool else arm.model
        self._frames = _links(self.pinocchio)
        self._description = description
        self._data = self.pinocchio.createData()
        end_effector = (tool and (tool.end_effector or tool.root)) or description.end_effector or arm.tip
        self.frame = end_effector if frame is None else frame
        self._index(self.frame)

        self.nq, self.nv = self.pinocchio.nq, self.pinocchio.nv
        self.joint_names = tuple(self.pinocchio.names)[1:]
        self.frame_names = tuple(self._frames)
        self.lower = _constant(self.pinocchio.lowerPositionLimit)
        self.upper = _constant(self.pinocchio.upperPositionLimit)
        self.velocity_limits = _constant(self.pinocchio.velocityLimit)
        self.effort_limits = _constant(self.pinocchio.effortLimit)
        given = next((a for a in (armature, description.armature) if a is not None), np.zeros(self.nv))
        self.armature = _constant(array_within("armature", given, low=0.0, high=np.inf, shape=(self.nv,)))
        self.pinocchio.armature = self.armature
        home = description.home
        if home is None:
            home = choose_home(self.pinocchio, self._frames[self.mount], urdf=description.urdf)
        limits = {"low": self.lower, "high": self.upper}
        self.home = _constant(array_within(f"home of {self.name}", home, **limits, shape=(self.nq,)))

    def __repr__(self) -> str:
        tool = f" with {self.tool_urdf_path.stem}" if self.tool_urdf_path else ""
        return f"RobotModel({self.name}{tool}, {self.nq} joints, end-effector {self.frame})"

    def with_tool(self, tool: str | Path, *, frame: str | None = None) -> RobotModel:
        """Return the bare arm of this model with a tool; the end-effector is the tool's, or `frame`.

        Raises
        ------
        InputError, FileError, ModelError
            As :func:`vic_toolbox.models.load_robot`.
        """
        return RobotModel(self._description, find_robot(tool, "tool"), frame=frame, armature=self.armature)

    def mass_matrix(self, q: ArrayLike) -> Array:
        """Joint-space inertia ``M(q)`` with the armature, (nv, nv) [kg m²]."""
        return self._evaluate(self._mass, q)

    def coriolis_matrix(self, q: ArrayLike, v: ArrayLike) -> Array:
        """``C(q, q̇)``, (nv, nv): ``C q̇`` holds the velocity torques, and ``Ṁ − 2C`` is skew-symmetric."""
        return self._evaluate(lambda q, v: pin.computeCoriolisMatrix(self.pinocchio, self._data, q, v), q, v)

    def gravity(self, q: ArrayLike) -> Array:
        """Joint torques ``g(q)`` that hold the arm against gravity, (nv,) [Nm]."""
        return self._evaluate(self._gravity, q)

    def bias(self, q: ArrayLike, v: ArrayLike) -> Array:
        """``C(q, q̇) q̇ + g(q)``, (nv,) [Nm]; ``M q̈ + bias = τ`` in free motion."""
        return self._evaluate(self._bias, q, v)

    def acceleration(
        self,
        q: ArrayLike,
        v: ArrayLike,
        torque: ArrayLike,
        *,
        external_wrench: ArrayLike | None = None,
        frame: str | None = None,
    ) -> Array:
        """Forward dynamics ``q̈ = M⁻¹ (τ − Jᵀ F_ext − C q̇ − g)``, (nv,) [rad/s²], by articulated bodies.

        Parameters
        ----------
        q, v, torque : array_like, shape (..., nv)
            Joint angles [rad], speeds [rad/s] and torques τ [Nm].
        external_wrench : array_like, shape (..., 6), optional
            F_ext that the robot exerts on its environment at the frame, world axes; a hand that pushes with
            the wrench w makes it −w.
        frame : str, optional
            Where `external_wrench` acts; the end-effector by default.

        Raises
        ------
        InputError
            Wrong shapes, values that are not finite, or batches that do not fit each other.
        ModelError
            Unknown frame.

        References
        ----------
        R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008, section 7.3.
        """
        q, v, torque = self._states(q, v, torque)
        if external_wrench is not None:
            wrench = finite_array("external_wrench", external_wrench, shape=(..., 6))
            common_batch(q=q.shape[:-1], external_wrench=wrench.shape[:-1])
            torque = torque - np.vecmat(wrench, self.jacobian(q, frame))
        return self._evaluate(self._acceleration, q, v, torque)

    def jacobian(self, q: ArrayLike, frame: str | None = None) -> Array:
        """``J(q)``, (6, nv): ``[v; ω] = J q̇`` at the frame's origin, world axes."""
        index = self._index(frame)
        return self._evaluate(lambda q: self._jacobian(q, index), q)

    def jacobian_dot(self, q: ArrayLike, v: ArrayLike, frame: str | None = None) -> Array:
        """``J̇(q, q̇)``, (6, nv): ``[v̇; ω̇] = J q̈ + J̇ q̇`` at the frame's origin, world axes."""
        index = self._index(frame)
        return self._evaluate(lambda q, v: self._jacobian_dot(q, v, index), q, v)

    def pose(self, q: ArrayLike, frame: str | None = None) -> Array:
        """Homogeneous matrix of the frame, (4, 4), seen from the base."""
        index = self._index(frame)
        return self._evaluate(lambda q: self._pose(q, index), q)

    def twist(self, q: ArrayLike, v: ArrayLike, frame: str | None = None) -> Array:
        """``[v; ω] = J q̇`` of the frame, (6,) [m/s, rad/s]."""
        index = self._index(frame)
        return self._evaluate(lambda q, v: self._jacobian(q, index) @ v, q, v)

    def operational_space(self, q: ArrayLike, v: ArrayLike, frame: str | None = None) -> OperationalSpace:
        """Dynamics at the frame, M(x), C(x,ẋ)ẋ and G(x): :func:`vic_toolbox.models.operational_space`."""
        index = self._index(frame)
        states = q, v = self._states(q, v)
        gravity = map_samples(self._gravity, q)
        return operational_space(
            map_samples(self._mass, q),
            map_samples(self._bias, *states) - gravity,
            gravity=gravity,
            jacobian=map_samples(lambda q: self._jacobian(q, index), q),
            jacobian_dot=map_samples(lambda q, v: self._jacobian_dot(q, v, index), *states),
            velocity=v,
        )

    def inverse_kinematics(
        self,
        pose: ArrayLike,
        *,
        start: ArrayLike | None = None,
        frame: str | None = None,
        attempts: int = 50,
        tolerance: float = 1e-9,
        seed: int = 0,
    ) -> Array:
        """Return a posture within the limits that puts the frame at a pose.

        The search starts at `start`, so a start near the wanted posture picks the branch (elbow up or down);
        if it fails there, it goes on from random postures, reproducibly. An arm with more than six joints
        ends at one of its infinitely many solutions.

        Parameters
        ----------
        pose : array_like, shape (4, 4)
            Wanted pose of the frame, seen from the base.
        start : array_like, shape (nq,), optional
            First start [rad]; the home posture by default.
        frame : str, optional
            The end-effector by default.
        attempts : int
            Number of starts before giving up.
        tolerance : float
            Largest norm of the pose error [m, rad] of a solution.
        seed : int
            Seed of the random starts.

        Returns
        -------
        ndarray, shape (nq,)

        Raises
        ------
        ReachError
            No solution found; the message names the residual, the reach and what to change. A position that
            can only be meant in another unit is refused at once.
        InputError
            `pose` is not one pose, or another argument is out of range.
        """
        target = check_pose("pose", finite_array("pose", pose, shape=(4, 4)))
        self.check_metres(target[:3, 3], frame=frame)
        first = self.home if start is None else finite_array("start", start, shape=(self.nq,))
        count = integer("attempts", attempts, low=1)
        generator = np.random.default_rng(integer("seed", seed, low=0))
        return inverse_kinematics.solve(
            self.pinocchio,
            self._index(frame),
            target,
            starts=itertools.chain([first], self.random_postures(generator, count - 1)),
            tolerance=positive("tolerance", tolerance),
            iterations=100,
        )

    def check_metres(self, position: ArrayLike, *, frame: str | None = None) -> None:
        """Refuse a position (3,) of the frame so far away that it was not meant in metres.

        Raises
        ------
        ReachError
            It lies farther from the first joint than three times the arm's reach.
        """
        point = finite_array("position", position, shape=(3,))
        inverse_kinematics.refuse_other_units(self.pinocchio, self._index(frame), point)

    def random_postures(self, generator: np.random.Generator, count: int) -> Array:
        """Uniform postures within the limits, (count, nq) [rad]; endless joints within ± π."""
        return inverse_kinematics.random_postures(self.pinocchio, generator, integer("count", count, low=0))

    # The kernels take one sample and do not check it. Pinocchio returns fresh arrays, so nothing is copied.

    def _mass(self, q: Array) -> Array:
        return pin.crba(self.pinocchio, self._data, q)

    def _gravity(self, q: Array) -> Array:
        return pin.computeGeneralizedGravity(self.pinocchio, self._data, q)

    def _bias(self, q: Array, v: Array) -> Array:
        return pin.nonLinearEffects(self.pinocchio, self._data, q, v)

    def _acceleration(self, q: Array, v: Array, torque: Array) -> Array:
        return pin.aba(self.pinocchio, self._data, q, v, torque)

    def _jacobian(self, q: Array, index: int) -> Array:
        return pin.computeFrameJacobian(self.pinocchio, self._data, q, index, WORLD_AXES)

    def _jacobian_dot(self, q: Array, v: Array, index: int) -> Array:
        pin.computeJointJacobiansTimeVariation(self.pinocchio, self._data, q, v)
        pin.updateFramePlacement(self.pinocchio, self._data, index)
        return pin.getFrameJacobianTimeVariation(self.pinocchio, self._data, index, WORLD_AXES)

    def _pose(self, q: Array, index: int) -> Array:
        pin.forwardKinematics(self.pinocchio, self._data, q)
        return pin.updateFramePlacement(self.pinocchio, self._data, index).homogeneous

    def _states(self, *states: ArrayLike) -> list[Array]:
        return same_batch(dict(zip(("q", "v", "torque"), states, strict=False)), size=self.nq)

    def _evaluate(self, kernel: Callable[..., Array], *states: ArrayLike) -> Array:
        return map_samples(kernel, *self._states(*states))

    def _index(self, frame: str | None) -> int:
        name = self.frame if frame is None else frame
        if name not in self._frames:
            raise ModelError(f"{self.name} has no frame {name!r}; choose one of: {', '.join(self._frames)}.")
        return self._frames[name]


def _links(model: pin.Model) -> dict[str, int]:
    """Frames that stand for a link, by name; joints have frames too, and may repeat a link's name."""
    return {f.name: i for i, f in enumerate(model.frames) if f.type == pin.FrameType.BODY}


def _constant(values: ArrayLike) -> Array:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
