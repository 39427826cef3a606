r"""The impedance law as compiled code, for a simulator that asks for the torque at every physics step.

:func:`compile_law` builds, for an arm of ``nv`` revolute joints, a numba function that reads plain arrays
(joint axes and anchors, the end-effector's pose, joint speeds, bias torque, mass matrix) and one *law block*,
and writes torques:

.. math::
    F_{fb} &= F - K e - B \dot e \\
    \tau &= C\dot q + g + \tau_0
            + J^T\left(F_{fb} + \Lambda\,(\ddot x_d - \dot J\dot q - J M^{-1}\tau_0)\right),
    \qquad \Lambda = (J M^{-1} J^T)^{-1}

with :math:`e = [p - p_d;\ \log(R R_d^T)]`, :math:`\dot e = \dot x - \dot x_d` and the posture torque
:math:`\tau_0 = k_0 (q_0 - q) - b_0 \dot q`, whose part that would move the end-effector is taken out
(:mod:`vic_toolbox.control.nullspace`). It is :class:`vic_toolbox.control.law.CartesianLaw` in one pass,
without memory allocation. A gain policy writes ``stiffness`` and ``damping``, a force policy ``wrench``
with ``stiffness`` zero.

The law block is a flat float64 array of ``law_block_size(nv)`` numbers, laid out by :data:`LAW_FIELDS`. It
fits in any memory that a simulator keeps for each simulation (MuJoCo: ``userdata``). This module knows no
simulator.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from vic_toolbox.errors import integer

LAW_MAGIC = float(int.from_bytes(b"VICLAW", "big"))
"""Value of the field ``magic`` in a valid law block; callbacks leave every other model alone."""

SMALLEST_PIVOT = 1e-4
"""Floor on the pivots of ``J M⁻¹ Jᵀ`` [1/kg, 1/(kg m²)]; only states next to a singularity meet it.

It adds the least diagonal that keeps every pivot at the floor: the torque stays continuous and bounded there.
The NumPy law floors the eigenvalues instead, at the same value; no pivot is smaller than the smallest
eigenvalue, so the two agree wherever ``OperationalSpace.damped`` is false.
"""


def _layout() -> tuple[Mapping[str, slice], int]:
    """Places the fields one after the other; the matrices also get a slice of their diagonal (step 7)."""
    widths = {
        "magic": 1,
        "stiffness": 36,
        "damping": 36,
        "reference_position": 3,
        "reference_quat_wxyz": 4,
        "reference_twist": 6,
        "reference_acceleration": 6,
        "wrench": 6,
        "error": 6,
        "error_rate": 6,
        "feedback": 6,
        "posture_stiffness": 1,
        "posture_damping": 1,
    }
    fields, start = {}, 0
    for name, width in widths.items():
        fields[name] = slice(start, start + width)
        if width == 36:
            fields[f"{name}_diagonal"] = slice(start, start + width, 7)
        start += width
    fields["posture"] = slice(start, None)
    return MappingProxyType(fields), start


LAW_FIELDS, _POSTURE = _layout()
"""Name → slice of the law block. SI units, world axes, linear part first.

===============================================  ==========  =================================================
name                                             size        meaning
===============================================  ==========  =================================================
``magic``                                        1           :data:`LAW_MAGIC`
``stiffness``, ``stiffness_diagonal``            36, 6       K, row-major 6 × 6, and a view of its diagonal
``damping``, ``damping_diagonal``                36, 6       B, likewise
``reference_position``, ``reference_quat_wxyz``  3, 4        pose x_d (the quaternion need not be normalised)
``reference_twist``, ``reference_acceleration``  6, 6        ẋ_d and ẍ_d
``wrench``                                       6           F, added to −K e − B ė
``error``, ``error_rate``, ``feedback``          6, 6, 6     written by the law: e, ė and F − K e − B ė
``posture_stiffness``, ``posture_damping``       1, 1        k₀ (Nm/rad) and b₀ (Nms/rad), both ≥ 0
``posture``                                      nv          q₀ (rad)
===============================================  ==========  =================================================
"""

# Globals of this file: numba keeps compiled code on disk until the file that it came from changes.
_STIFFNESS, _DAMPING = LAW_FIELDS["stiffness"].start, LAW_FIELDS["damping"].start
_POSITION, _QUAT = LAW_FIELDS["reference_position"].start, LAW_FIELDS["reference_quat_wxyz"].start
_TWIST, _ACCELERATION = LAW_FIELDS["reference_twist"].start, LAW_FIELDS["reference_acceleration"].start
_WRENCH, _FEEDBACK = LAW_FIELDS["wrench"].start, LAW_FIELDS["feedback"].start
_ERROR, _RATE = LAW_FIELDS["error"].start, LAW_FIELDS["error_rate"].start
_SPRING, _DAMPER = LAW_FIELDS["posture_stiffness"].start, LAW_FIELDS["posture_damping"].start


def law_block_size(nv: int) -> int:
    """Numbers in the law block of an arm with ``nv`` joints."""
    return _POSTURE + integer("nv", nv, low=1)


def law_block(nv: int, batch: int | None = None) -> np.ndarray:
    """A law block at rest: magic number set, reference at the origin, all gains and wrenches zero.

    Parameters
    ----------
    nv : int
        Number of joints of the arm.
    batch : int, optional
        Number of simulations; without it one block.

    Returns
    -------
    numpy.ndarray
        Shape (size,) or (batch, size), with size = ``law_block_size(nv)``.
    """
    leading = () if batch is None else (integer("batch", batch, low=0),)
    block = np.zeros((*leading, law_block_size(nv)))
    block[..., LAW_FIELDS["magic"]] = LAW_MAGIC
    block[..., LAW_FIELDS["reference_quat_wxyz"]] = (1.0, 0.0, 0.0, 0.0)
    return block


def _stack_pointer(typingctx, size):
    """Pointer to ``size`` (a constant) float64 on the caller's stack; numpy.empty would use the heap."""
    if not isinstance(size, types.IntegerLiteral):
        return None
    count = size.literal_value

    def generate(context, builder, signature, arguments):
        return cgutils.alloca_once(builder, context.get_value_type(types.float64), size=count)

    return types.CPointer(types.float64)(size), generate


_stack: Any = intrinsic(_stack_pointer)

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "reassoc", "nsz", "arcp"}}


@njit(inline="always", **_OPTIONS)
def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(inline="always", **_OPTIONS)
def _quaternion(r):
    """Unit quaternion (w, x, y, z) of a row-major rotation matrix, by its largest component (Shepperd)."""
    trace = r[0] + r[4] + r[8]
    if trace > 0.0:
        s = math.sqrt(1.0 + trace)
        f = 0.5 / s
        return 0.5 * s, f * (r[7] - r[5]), f * (r[2] - r[6]), f * (r[3] - r[1])
    if r[0] >= r[4] and r[0] >= r[8]:
        s = math.sqrt(1.0 + r[0] - r[4] - r[8])
        f = 0.5 / s
        return f * (r[7] - r[5]), 0.5 * s, f * (r[1] + r[3]), f * (r[2] + r[6])
    if r[4] >= r[8]:
        s = math.sqrt(1.0 - r[0] + r[4] - r[8])
        f = 0.5 / s
        return f * (r[2] - r[6]), f * (r[1] + r[3]), 0.5 * s, f * (r[5] + r[7])
    s = math.sqrt(1.0 - r[0] - r[4] + r[8])
    f = 0.5 / s
    return f * (r[3] - r[1]), f * (r[2] + r[6]), f * (r[5] + r[7]), 0.5 * s


@njit(inline="always", **_OPTIONS)
def _rotation_error(rotation, reference):
    """log(R R_dᵀ) from the row-major R and the quaternion of R_d; accurate from 0 to π."""
    a, b, c, d = _quaternion(rotation)
    w, x, y, z = reference[0], -reference[1], -reference[2], -reference[3]
    qw = a * w - b * x - c * y - d * z
    qx = a * x + b * w + c * z - d * y
    qy = a * y - b * z + c * w + d * x
    qz = a * z + b * y - c * x + d * w
    sine = math.sqrt(qx * qx + qy * qy + qz * qz)
    # atan2 takes the ratio only, so the reference needs no normalisation; the shorter way round has w ≥ 0.
    if sine > 1e-12 * abs(qw):
        scale = 2.0 * math.atan2(sine, abs(qw)) / sine
    else:
        scale = 2.0 / abs(qw)
    if qw < 0.0:
        scale = -scale
    return scale * qx, scale * qy, scale * qz


@njit(inline="always", **_OPTIONS)
def _kinematics(nv, axes, anchors, position, qvel, jacobian_t, motion):
    """Write Jᵀ (nv × 6) and motion = [J q̇; J̇ q̇] in one sweep from base to tip."""
    wx = wy = wz = ax = ay = az = 0.0  # angular velocity and acceleration (at q̈ = 0) of the current link
    vx = vy = vz = bx = by = bz = 0.0  # linear velocity and acceleration of the point reached so far
    for i in range(nv):
        axis = (axes[i, 0], axes[i, 1], axes[i, 2])
        px, py, pz = anchors[i, 0], anchors[i, 1], anchors[i, 2]
        lever = (position[0] - px, position[1] - py, position[2] - pz)
        linear = _cross(axis, lever)
        for k in range(3):
            jacobian_t[i, k] = linear[k]
            jacobian_t[i, 3 + k] = axis[k]
        speed = qvel[i]
        cx, cy, cz = _cross((wx, wy, wz), axis)
        ax, ay, az = ax + cx * speed, ay + cy * speed, az + cz * speed
        wx, wy, wz = wx + axis[0] * speed, wy + axis[1] * speed, wz + axis[2] * speed
        # Both ends of the segment to the next anchor (or to the end-effector) are fixed to this link.
        if i + 1 < nv:
            segment = (anchors[i + 1, 0] - px, anchors[i + 1, 1] - py, anchors[i + 1, 2] - pz)
        else:
            segment = lever
        ux, uy, uz = _cross((wx, wy, wz), segment)
        tx, ty, tz = _cross((ax, ay, az), segment)
        nx, ny, nz = _cross((wx, wy, wz), (ux, uy, uz))
        vx, vy, vz = vx + ux, vy + uy, vz + uz
        bx, by, bz = bx + tx + nx, by + ty + ny, bz + tz + nz
    motion[0], motion[1], motion[2], motion[3], motion[4], motion[5] = vx, vy, vz, wx, wy, wz
    motion[6], motion[7], motion[8], motion[9], motion[10], motion[11] = bx, by, bz, ax, ay, az


@njit(inline="always", **_OPTIONS)
def _factorise(n, matrix, inverse, floor):
    """Turn the lower triangle of a symmetric matrix into L of L D Lᵀ, and write 1 / max(D, floor)."""
    for i in range(n):
        for j in range(i):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]  # row i holds L D until it is finished
        for j in range(i):
            scaled = matrix[i, j] * inverse[j]
            matrix[i, i] -= matrix[i, j] * scaled
            matrix[i, j] = scaled
        inverse[i] = 1.0 / max(matrix[i, i], floor)


@njit(inline="always", **_OPTIONS)
def _forward(n, columns, lower, right):
    """Overwrite the n × columns array with L⁻¹ times it."""
    for i in range(n):
        for k in range(i):
            for c in range(columns):
                right[i, c] -= lower[i, k] * right[k, c]


@njit(inline="always", **_OPTIONS)
def _feedback(block, position, rotation, motion, force):
    """Write error, error rate and F − K e − B ė into the block, the last into ``force`` too."""
    for k in range(3):
        block[_ERROR + k] = position[k] - block[_POSITION + k]
    turn = _rotation_error(rotation, block[_QUAT : _QUAT + 4])
    for k in range(3):
        block[_ERROR + 3 + k] = turn[k]
    for k in range(6):
        block[_RATE + k] = motion[k] - block[_TWIST + k]
    for k in range(6):
        total = block[_WRENCH + k]
        for j in range(6):
            total -= block[_STIFFNESS + 6 * k + j] * block[_ERROR + j]
            total -= block[_DAMPING + 6 * k + j] * block[_RATE + j]
        block[_FEEDBACK + k] = total
        force[k] = total


@functools.cache
def compile_law(nv: int) -> Callable[..., None]:
    """Impedance law of a serial arm with ``nv`` revolute joints, as a numba function that allocates nothing.

    Parameters
    ----------
    nv : int
        Number of joints. An arm with fewer than six cannot realise all six directions of the impedance; the
        law then follows those that it has. With more than six, ``posture_*`` acts in the nullspace.

    Returns
    -------
    Callable
        ``law(block, qpos, qvel, axes, anchors, position, rotation, bias, mass, torque)``, callable from
        Python and from other numba functions. All arguments are contiguous float64 arrays, SI, world axes:

        - ``block``: (size,), see :data:`LAW_FIELDS`; ``error``, ``error_rate`` and ``feedback`` are written;
        - ``qpos``, ``qvel``: (≥ nv,) joint angles and speeds, base to tip;
        - ``axes``, ``anchors``: (≥ nv, 3) unit joint axes and a point on each;
        - ``position``, ``rotation``: (3,) and (9,), the end-effector, rotation row-major;
        - ``bias``: (≥ nv,) C q̇ + g;
        - ``mass``: (≥ nv (nv + 1) / 2,) lower triangle of M(q) row by row (MuJoCo's ``M`` of a serial arm);
        - ``torque``: (≥ nv,), written.

    Raises
    ------
    InputError
        ``nv`` is not a positive integer.

    Notes
    -----
    The first call on a machine compiles for some seconds, later ones load the result. The columns of J are
    ``[a × (p − c); a]``; J̇q̇ is the end-effector's acceleration at q̈ = 0, carried from anchor to anchor.
    """
    nv = integer("nv", nv, low=1)
    count, task_count = nv * nv, 6 * nv

    def law(block, qpos, qvel, axes, anchors, position, rotation, bias, mass, torque):
        jacobian_t = carray(_stack(task_count), (nv, 6))
        motion = carray(_stack(12), (12,))
        force = carray(_stack(6), (6,))
        _kinematics(nv, axes, anchors, position, qvel, jacobian_t, motion)
        _feedback(block, position, rotation, motion, force)

        # M = L D Lᵀ and X = L⁻¹ Jᵀ, hence A = J M⁻¹ Jᵀ = Xᵀ D⁻¹ X.
        lower = carray(_stack(count), (nv, nv))
        weight = carray(_stack(nv), (nv,))
        for i in range(nv):
            for j in range(i + 1):
                lower[i, j] = mass[i * (i + 1) // 2 + j]
        _factorise(nv, lower, weight, 0.0)
        half = carray(_stack(task_count), (nv, 6))
        for i in range(nv):
            for c in range(6):
                half[i, c] = jacobian_t[i, c]
        _forward(nv, 6, lower, half)

        # What the feed-forward must add to the end-effector's acceleration: ẍ_d − J̇q̇ − J M⁻¹ τ₀.
        missing = carray(_stack(6), (6, 1))
        for c in range(6):
            missing[c, 0] = block[_ACCELERATION + c] - motion[6 + c]
        for i in range(nv):
            torque[i] = bias[i]
        if block[_SPRING] != 0.0 or block[_DAMPER] != 0.0:
            posture = carray(_stack(nv), (nv, 1))
            for i in range(nv):
                posture[i, 0] = block[_SPRING] * (block[_POSTURE + i] - qpos[i]) - block[_DAMPER] * qvel[i]
                torque[i] += posture[i, 0]
            _forward(nv, 1, lower, posture)
            for i in range(nv):
                for c in range(6):
                    missing[c, 0] -= half[i, c] * weight[i] * posture[i, 0]

        mobility = carray(_stack(36), (6, 6))
        inverse = carray(_stack(6), (6,))
        for i in range(6):
            for j in range(i + 1):
                mobility[i, j] = 0.0
        for k in range(nv):
            for i in range(6):
                scaled = half[k, i] * weight[k]
                for j in range(i + 1):
                    mobility[i, j] += scaled * half[k, j]
        _factorise(6, mobility, inverse, SMALLEST_PIVOT)
        _forward(6, 1, mobility, missing)
        for i in range(5, -1, -1):
            missing[i, 0] *= inverse[i]
            for k in range(i + 1, 6):
                missing[i, 0] -= mobility[k, i] * missing[k, 0]
            force[i] += missing[i, 0]

        for i in range(nv):
            for c in range(6):
                torque[i] += jacobian_t[i, c] * force[c]

    try:
        return njit(cache=True, **_OPTIONS)(law)
    except RuntimeError:  # no folder that numba may write its cache to
        return njit(**_OPTIONS)(law)
