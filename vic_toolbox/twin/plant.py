"""The twin's physics: the scene of Cup-on-Plate with another robot's inertia and friction, and an F/T sensor.

The sensor sits between joint 6 and the gripper. Its measuring face is where the gripper is bolted on, so gripper
and cup hang on it, and it is turned by a quarter about the tool's axis, as its cable outlet wants it.
"""

from __future__ import annotations

import mujoco
import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.tasks import cup_scene, scene
from vic_toolbox.twin.parameters import Specimen

HAND = scene.TOOL_PREFIX + "cup_bottom"
"""Body at the end-effector: wrenches on it act about the centre of the cup's bottom."""
TOOL_SIDE = scene.TOOL_PREFIX + "gripper"
"""Body whose connection to the arm the sensor measures."""
SENSOR_BODY = "ft_sensor"
SENSOR_ROTATION = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""Axes of the sensor, as columns, in those of the end-effector."""
SENSOR_OFFSET = (0.0, 0.0, -0.18)
"""From the centre of the cup's bottom to the sensor, axes of the end-effector [m]."""
FORCE, TORQUE = "ft_force", "ft_torque"


def links() -> tuple[str, ...]:
    """Bodies with mass of the nominal scene, base to tip."""
    return tuple(body.name for body in cup_scene.build_spec().bodies if body.mass > 0)


def plant_model(specimen: Specimen) -> mujoco.MjModel:
    """Compile the physics of one robot.

    Raises
    ------
    KeyError
        The specimen lacks a link.
    """
    spec = cup_scene.build_spec()
    for body in spec.bodies:
        if body.mass > 0:
            body.mass = body.mass * specimen.mass[body.name]
            body.inertia = body.inertia * specimen.inertia[body.name]
            if np.isfinite(body.fullinertia[0]):
                body.fullinertia = body.fullinertia * specimen.inertia[body.name]
    for i, name in enumerate(cup_scene.robot().joint_names):
        joint = spec.joint(name)
        joint.armature = joint.armature * specimen.armature[i]
        joint.frictionloss = specimen.coulomb[i]
        joint.damping = (specimen.viscous[i], 0.0, 0.0)
    _add_sensor(spec)
    _end_effector_first(spec)
    hand = spec.body(HAND)
    hand.fuse = 0  # keeps a massless body: MuJoCo takes external wrenches about the origin of its inertia
    model = scene.physics_model(spec)
    model.body_ipos[model.body(HAND).id] = 0.0
    return model


def nominal_model() -> mujoco.MjModel:
    """What the controller knows: the arm without friction, and nothing that it could touch."""
    model = scene.physics_model(cup_scene.build_spec())
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def sensor_columns(model: mujoco.MjModel) -> Array:
    """Where force and torque of the F/T sensor lie in ``sensordata``, (6,) integers."""
    starts = [model.sensor(name).adr[0] for name in (FORCE, TORQUE)]
    return np.concatenate([start + np.arange(3) for start in starts])


def _add_sensor(spec: mujoco.MjSpec) -> None:
    """MuJoCo's force and torque sensor at the gripper: the wrench that the arm exerts on the gripper."""
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, np.ravel(SENSOR_ROTATION))
    spec.body(TOOL_SIDE).add_site(name="ft", quat=quaternion)
    kinds = mujoco.mjtSensor.mjSENS_FORCE, mujoco.mjtSensor.mjSENS_TORQUE
    for name, kind in zip((FORCE, TORQUE), kinds, strict=True):
        spec.add_sensor(name=name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname="ft")


def _end_effector_first(spec: mujoco.MjSpec) -> None:
    """Move the site at the end-effector to the sensor's body, which comes before the gripper: it must be site 0."""
    arm = cup_scene.robot()
    base = arm.pose(arm.home, frame=SENSOR_BODY)
    place = np.linalg.inv(base) @ arm.pose(arm.home)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, place[:3, :3].ravel())
    spec.delete(spec.site(scene.END_EFFECTOR))
    spec.body(scene.TOOL_PREFIX + SENSOR_BODY).add_site(
        name=scene.END_EFFECTOR, pos=place[:3, 3], quat=quaternion
    )
