"""MuJoCo scenes around an arm: the robot's own URDF, its tool, motors, and what it can touch.

Pinocchio and MuJoCo read the same URDF, so both see the same masses, joints and limits; the armature comes
from the robot's description too. The torques of the law enter through ideal motors with the URDF's effort
limits.
"""

from __future__ import annotations

from typing import Any

import mujoco

from vic_toolbox.errors import ModelError
from vic_toolbox.models import RobotModel
from vic_toolbox.tasks.callback import userdata_size

TIMESTEP = 1e-3
"""Period of physics and of the impedance law [s]."""

END_EFFECTOR = "end_effector"
"""Name of site 0."""

TOOL_PREFIX = "tool/"
"""What the names of the tool's bodies begin with in the scene."""

HIDDEN_GROUP = 3
"""Group of the collision shapes; MuJoCo draws groups 0 to 2 unless asked."""

_OBJECT, _FURNITURE = 1, 2  # collision classes: only the held object meets the furniture


def arm_spec(robot: RobotModel) -> mujoco.MjSpec:
    """Scene with the arm alone, its shapes for the eye, and motors for the compiled impedance law.

    Gravity is on, the integrator is semi-implicit Euler at :data:`TIMESTEP`, friction cones are elliptic. The
    frame of the robot becomes site 0. No part of the arm collides: :func:`make_solid` lets the held object do
    so.

    Raises
    ------
    ModelError
        MuJoCo cannot read the URDF, or the robot's frame is not one of its links.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(robot.urdf_path))
        if robot.tool_urdf_path is not None:
            tool = mujoco.MjSpec.from_file(str(robot.tool_urdf_path))
            spec.body(robot.mount).add_frame().attach_body(tool.worldbody.first_body(), TOOL_PREFIX, "")
    except ValueError as error:
        raise ModelError(f"MuJoCo cannot read the URDF of {robot.name}: {error}") from error
    _fix(spec, robot.locked_joints)
    spec.modelname = robot.name
    spec.option.timestep = TIMESTEP
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # a divergence must stay visible
    spec.nuserdata = userdata_size(robot.nv)
    for geom in spec.geoms:
        if geom.contype or geom.conaffinity:  # a URDF <collision>; a <visual> arrives with neither
            geom.group = HIDDEN_GROUP
            geom.contype = geom.conaffinity = 0
    for name, armature, effort in zip(robot.joint_names, robot.armature, robot.effort_limits, strict=True):
        joint = spec.joint(name)
        joint.armature = armature
        joint.actfrclimited = False  # the motor below limits the torque; one limit is enough
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_motor()
        motor.ctrllimited, motor.ctrlrange = True, (-effort, effort)
    body = spec.body(robot.frame) or spec.body(TOOL_PREFIX + robot.frame)
    if body is None:
        raise ModelError(
            f"frame {robot.frame!r} of {robot.name} is not a link of its URDF; choose a link as the frame."
        )
    body.add_site(name=END_EFFECTOR)
    return spec


def _fix(spec: mujoco.MjSpec, joints: tuple[str, ...]) -> None:
    """Weld joints at zero, as the robot model does with fingers, and drop what makes them mimic each other."""
    for equality in list(spec.equalities):
        if {equality.name1, equality.name2} & set(joints):
            spec.delete(equality)
    for name in joints:
        spec.delete(spec.joint(name))


def make_solid(spec: mujoco.MjSpec, body: str) -> None:
    """Let the collision shapes of one body meet the furniture, and measure the contact force on it.

    Sensor 0 then gives the number of contacts (1), and their net force (3) and torque (3), world axes.

    Raises
    ------
    ModelError
        The body has no collision shape.
    """
    solid = [geom for geom in spec.body(body).geoms if geom.group == HIDDEN_GROUP]
    if not solid:
        raise ModelError(f"body {body!r} has no collision shape; add one to its URDF.")
    for geom in solid:
        geom.contype, geom.conaffinity = _OBJECT, _FURNITURE
    field = mujoco.mjtConDataField
    wanted = (field.mjCONDATA_FOUND, field.mjCONDATA_FORCE, field.mjCONDATA_TORQUE)
    spec.add_sensor(
        name="contact",
        type=mujoco.mjtSensor.mjSENS_CONTACT,
        objtype=mujoco.mjtObj.mjOBJ_BODY,
        objname=body,
        intprm=[sum(1 << int(f) for f in wanted), _NET_FORCE, 1],
    )


_NET_FORCE = 3  # reduction of a contact sensor; has no name in the bindings


def add_furniture(spec: mujoco.MjSpec, name: str, **shape: Any) -> None:
    """Add a fixed shape that the held object can touch; ``shape`` are MuJoCo's attributes of a geom."""
    spec.worldbody.add_geom(name=name, contype=_FURNITURE, conaffinity=_OBJECT, **shape)


def physics_model(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a scene without what physics does not need.

    Shapes that touch nothing go, and links that cannot move against each other become one body. Joints,
    inertia and contacts stay, and with them every number; a step takes two thirds of the time.
    """
    lean = spec.copy()
    for geom in list(lean.geoms):
        if not geom.contype:
            lean.delete(geom)
    lean.fuse_static()
    return lean.compile()
