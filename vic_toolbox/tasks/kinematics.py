"""Pose error and twist of a simulated arm between physics steps, compiled.

MuJoCo's derived fields are one step old after a step, and asking it for fresh ones costs a second kinematics,
collision and inertia pass. An observation needs only the end-effector, so this module walks the chain once
per simulation.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numba import njit

from vic_toolbox.control.compiled import LAW_FIELDS
from vic_toolbox.errors import ModelError

FASTEST_JOINT = 30.0
"""Joint speed [rad/s] beyond which a simulation counts as diverged (this arm's fastest joint reaches 17)."""


@dataclass(frozen=True)
class Chain:
    """Fixed geometry of a serial arm, base to tip.

    Row i < nv of ``offsets`` (nv+1, 3) [m] and ``quats_wxyz`` (nv+1, 4) places joint frame i in frame i − 1,
    the last row the end-effector in the last joint's frame. ``axes`` (nv, 3) are unit joint axes, each in its
    own joint frame.
    """

    offsets: np.ndarray
    quats_wxyz: np.ndarray
    axes: np.ndarray

    @classmethod
    def from_model(cls, model: mujoco.MjModel, site: int = 0) -> Chain:
        """Chain of hinge joints from the world to a site.

        Raises
        ------
        ModelError
            The path has a joint that is not a hinge at its body's origin, or more than one joint in a body.
        """
        frames = [(model.site_pos[site], model.site_quat[site])]
        joints: list[int] = []
        body = int(model.site_bodyid[site])
        while body:
            if model.body_jntnum[body]:
                joint = int(model.body_jntadr[body])
                hinge = (
                    model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_HINGE and not model.jnt_pos[joint].any()
                )
                if model.body_jntnum[body] != 1 or not hinge:
                    raise ModelError(
                        f"joint {model.joint(joint).name!r} is not a single hinge at its body's origin; "
                        "the compiled kinematics serve serial arms of revolute joints only."
                    )
                joints.append(joint)
                frames.append((np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])))
            frames[-1] = _compose((model.body_pos[body], model.body_quat[body]), frames[-1])
            body = int(model.body_parentid[body])
        if joints[::-1] != list(range(len(joints))):
            raise ModelError("the arm's joints must be the first of the model, base to tip.")
        frames.reverse()
        offsets, quats = (np.array([frame[k] for frame in frames]) for k in (0, 1))
        return cls(offsets, quats, np.array(model.jnt_axis[: len(joints)]))


def _compose(first, second):  # type: ignore[no-untyped-def]
    """Frame ``second``, given in frame ``first``, seen from where ``first`` is seen."""
    position, quat = np.empty(3), np.empty(4)
    mujoco.mju_rotVecQuat(position, second[0], first[1])
    mujoco.mju_mulQuat(quat, first[1], second[1])
    return position + first[0], quat


@njit(inline="always")
def _rotate(q, v):  # type: ignore[no-untyped-def]
    """Vector v turned by the unit quaternion q: v + 2 q_v × (q_v × v + q_w v)."""
    tx = q[2] * v[2] - q[3] * v[1] + q[0] * v[0]
    ty = q[3] * v[0] - q[1] * v[2] + q[0] * v[1]
    tz = q[1] * v[1] - q[2] * v[0] + q[0] * v[2]
    return (
        v[0] + 2.0 * (q[2] * tz - q[3] * ty),
        v[1] + 2.0 * (q[3] * tx - q[1] * tz),
        v[2] + 2.0 * (q[1] * ty - q[2] * tx),
    )


@njit(inline="always")
def _multiply(a, b):  # type: ignore[no-untyped-def]
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )


@functools.lru_cache(maxsize=1)
def compile_observation() -> Callable[..., bool]:
    """Numba function ``observe(offsets, quats, axes, qpos, qvel, blocks, out) -> bool``.

    For every simulation it writes ``e`` and ``ė`` (12 numbers, the law's own definition, with the reference
    of the simulation's law block) into a row of ``out`` (n, 12). It returns False when a joint speed is not
    finite or exceeds :data:`FASTEST_JOINT`: the simulation has diverged.
    """
    origin, quat, twist = (
        LAW_FIELDS[name].start for name in ("reference_position", "reference_quat_wxyz", "reference_twist")
    )
    fastest = FASTEST_JOINT

    @njit(cache=True, error_model="numpy")
    def observe(offsets, quats, axes, qpos, qvel, blocks, out):  # type: ignore[no-untyped-def]
        sane = True
        for s in range(out.shape[0]):
            block = blocks[s]
            p = (0.0, 0.0, 0.0)
            q = (1.0, 0.0, 0.0, 0.0)
            wx = wy = wz = mx = my = mz = 0.0  # angular velocity, and Σ q̇ (axis × anchor)
            for i in range(offsets.shape[0]):
                step = _rotate(q, offsets[i])
                p = (p[0] + step[0], p[1] + step[1], p[2] + step[2])
                q = _multiply(q, quats[i])
                if i < axes.shape[0]:
                    a = _rotate(q, axes[i])
                    speed = qvel[s, i]
                    sane = sane and abs(speed) <= fastest
                    wx, wy, wz = wx + a[0] * speed, wy + a[1] * speed, wz + a[2] * speed
                    mx += speed * (a[1] * p[2] - a[2] * p[1])
                    my += speed * (a[2] * p[0] - a[0] * p[2])
                    mz += speed * (a[0] * p[1] - a[1] * p[0])
                    half = 0.5 * qpos[s, i]
                    c, h = math.cos(half), math.sin(half)
                    q = _multiply(q, (c, h * axes[i, 0], h * axes[i, 1], h * axes[i, 2]))
            row = out[s]
            row[0], row[1], row[2] = p[0] - block[origin], p[1] - block[origin + 1], p[2] - block[origin + 2]
            d = _multiply(q, (block[quat], -block[quat + 1], -block[quat + 2], -block[quat + 3]))
            sine = math.sqrt(d[1] * d[1] + d[2] * d[2] + d[3] * d[3])
            # the shorter way round; 2 atan2(s, c)/s tends to 2/c at zero
            angle = 2.0 * math.atan2(sine, abs(d[0])) / sine if sine > 1e-12 else 2.0
            angle = -angle if d[0] < 0.0 else angle
            row[3], row[4], row[5] = angle * d[1], angle * d[2], angle * d[3]
            row[6] = wy * p[2] - wz * p[1] - mx - block[twist]
            row[7] = wz * p[0] - wx * p[2] - my - block[twist + 1]
            row[8] = wx * p[1] - wy * p[0] - mz - block[twist + 2]
            row[9], row[10], row[11] = wx - block[twist + 3], wy - block[twist + 4], wz - block[twist + 5]
        return sane

    return observe
