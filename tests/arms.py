"""Arms, states and accelerations that the tests of the control law share."""

from __future__ import annotations

import functools

import numpy as np
import pinocchio as pin

from vic_toolbox.control import Reference
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.models import RobotModel, load_robot
from vic_toolbox.spatial import pose_from, rotation_exp

ARMS = ("fanuc", "ur5", "panda")
SMALLEST_SINGULAR_VALUE = 0.05


@functools.cache
def arm(name: str) -> RobotModel:
    """The study's arm with its cup, or an arm of example-robot-data with some armature."""
    if name == "fanuc":
        return load_robot("fanuc_lrmate200id7l", tool="cup_gripper")
    bare = load_robot(name)
    return load_robot(name, armature=np.full(bare.nv, 0.1))


def random_states(
    model: RobotModel, count: int, *, seed: int = 0, speed: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Postures within the limits and away from singularities, and joint speeds [rad/s], (count, nv) each."""
    generator = np.random.default_rng(seed)
    postures = model.random_postures(generator, 8 * count)
    values = np.linalg.svd(model.jacobian(postures), compute_uv=False)[:, -1]
    kept = postures[values > SMALLEST_SINGULAR_VALUE][:count]
    assert len(kept) == count
    return kept, speed * generator.normal(size=kept.shape)


def random_gains(generator: np.random.Generator, count: int) -> ImpedanceGains:
    """Full stiffness and damping matrices that couple all axes, as stiff as the tasks use them."""
    scale = np.sqrt([150.0, 150.0, 150.0, 4.0, 4.0, 4.0])

    def spd() -> np.ndarray:
        root = np.eye(6) + 0.2 * generator.normal(size=(count, 6, 6))
        return scale[:, None] * (root @ np.swapaxes(root, -1, -2)) * scale

    return ImpedanceGains(spd(), 0.3 * spd())


def random_reference(generator: np.random.Generator, pose: np.ndarray) -> Reference:
    """A moving reference next to each of the poses (count, 4, 4)."""
    count = len(pose)
    turned = rotation_exp(0.5 * generator.normal(size=(count, 3))) @ pose[:, :3, :3]
    return Reference(
        pose_from(pose[:, :3, 3] + 0.2 * generator.normal(size=(count, 3)), turned),
        twist=0.3 * generator.normal(size=(count, 6)),
        acceleration=generator.normal(size=(count, 6)),
    )


def task_acceleration(
    model: RobotModel, q: np.ndarray, v: np.ndarray, acceleration: np.ndarray
) -> np.ndarray:
    """Acceleration ẍ of the end-effector, (6,), from Pinocchio's forward kinematics (no Jacobian)."""
    data = model.pinocchio.createData()
    pin.forwardKinematics(model.pinocchio, data, q, v, acceleration)
    index = model.pinocchio.getFrameId(model.frame)
    pin.updateFramePlacement(model.pinocchio, data, index)
    motion = pin.getFrameClassicalAcceleration(model.pinocchio, data, index, pin.LOCAL_WORLD_ALIGNED)
    return motion.vector.copy()
