"""The compiled law is the NumPy law, to rounding, with six joints and with seven, and uses no heap."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numba import njit
from numba.core.runtime import _nrt_python, rtsys  # pyright: ignore[reportAttributeAccessIssue]

from tests.arms import ARMS, arm, random_gains, random_reference, random_states
from vic_toolbox.control import CartesianLaw, Posture
from vic_toolbox.control.compiled import (
    LAW_FIELDS,
    LAW_MAGIC,
    SMALLEST_PIVOT,
    compile_law,
    law_block,
    law_block_size,
)
from vic_toolbox.errors import InputError
from vic_toolbox.models import RobotModel
from vic_toolbox.spatial import pose_error, pose_from, rotation_exp, rotation_to_quat_wxyz

COUNT = 50


def simulator_view(model: RobotModel, q: np.ndarray, v: np.ndarray) -> dict[str, np.ndarray]:
    """What a simulator would hand to the law at this state, from Pinocchio."""
    data = model.pinocchio.createData()
    pin.forwardKinematics(model.pinocchio, data, q)
    pose = model.pose(q)
    return {
        "qpos": q.copy(),
        "qvel": v.copy(),
        "axes": np.ascontiguousarray(model.jacobian(q)[3:].T),
        "anchors": np.array([data.oMi[i + 1].translation for i in range(model.nv)]),
        "position": pose[:3, 3].copy(),
        "rotation": np.ascontiguousarray(pose[:3, :3]).ravel(),
        "bias": model.bias(q, v),
        "mass": model.mass_matrix(q)[np.tril_indices(model.nv)],
    }


def run(model: RobotModel, block: np.ndarray, view: dict[str, np.ndarray]) -> np.ndarray:
    torque = np.full(model.nv, np.nan)
    compile_law(model.nv)(block, *view.values(), torque)
    return torque


def write(block: np.ndarray, **fields: object) -> np.ndarray:
    for name, value in fields.items():
        block[..., LAW_FIELDS[name]] = np.asarray(value).reshape(*block.shape[:-1], -1)
    return block


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("kind", ["impedance", "force"])
def test_compiled_law_is_the_numpy_law(name: str, kind: str) -> None:
    model = arm(name)
    q, v = random_states(model, COUNT)
    generator = np.random.default_rng(1)
    reference, gains = random_reference(generator, model.pose(q)), random_gains(generator, COUNT)
    posture = Posture(model.home, stiffness=7.0, damping=3.0)
    law = CartesianLaw(model=model, posture=posture)
    error, rate = law.error(q, v, reference=reference)
    blocks = write(
        law_block(model.nv, COUNT),
        reference_position=reference.pose[:, :3, 3],
        reference_quat_wxyz=rotation_to_quat_wxyz(reference.pose[:, :3, :3]),
        posture_stiffness=np.full(COUNT, 7.0),
        posture_damping=np.full(COUNT, 3.0),
        posture=np.tile(model.home, (COUNT, 1)),
    )
    if kind == "impedance":
        command = law.impedance(q, v, reference=reference, gains=gains)
        write(
            blocks,
            stiffness=gains.stiffness,
            damping=gains.damping,
            reference_twist=reference.twist,
            reference_acceleration=reference.acceleration,
        )
    else:
        wrench = 10.0 * generator.normal(size=(COUNT, 6))
        command = law.force(q, v, wrench=wrench)
        write(blocks, wrench=wrench)
        rate = rate + reference.twist  # the block's reference is at rest

    for i in range(COUNT):
        torque = run(model, blocks[i], simulator_view(model, q[i], v[i]))
        assert np.abs(torque - command.torque[i]).max() < 1e-12 * np.abs(torque).max()
    for field, expected in (("error", error), ("error_rate", rate), ("feedback", command.feedback)):
        np.testing.assert_allclose(blocks[:, LAW_FIELDS[field]], expected, atol=1e-11)


rotation_vectors = arrays(np.float64, 3, elements=st.floats(-3.1, 3.1))


@settings(max_examples=200, deadline=None)
@given(actual=rotation_vectors, wanted=rotation_vectors, norm=st.floats(0.1, 10.0), flip=st.booleans())
def test_pose_error_is_that_of_spatial_for_every_quaternion(actual, wanted, norm: float, flip: bool) -> None:
    model = arm("fanuc")
    view = simulator_view(model, model.home, np.zeros(6))
    rotation, reference = rotation_exp(actual), rotation_exp(wanted)
    view["rotation"] = np.ascontiguousarray(rotation).ravel()
    quaternion = rotation_to_quat_wxyz(reference) * (-norm if flip else norm)
    block = write(law_block(6), reference_quat_wxyz=quaternion)
    run(model, block, view)
    expected = pose_error(pose_from(view["position"], rotation), pose_from(np.zeros(3), reference))
    error = block[LAW_FIELDS["error"]]
    if np.linalg.norm(expected[3:]) > np.pi - 1e-6:  # at π both signs are right
        error[3:] *= np.sign(error[3:] @ expected[3:])
    np.testing.assert_allclose(error, expected, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-9, 1e-4, 1.0, np.pi - 1e-4, np.pi - 1e-9])
def test_rotation_error_keeps_its_accuracy_from_zero_to_half_a_turn(angle: float) -> None:
    model = arm("fanuc")
    view = simulator_view(model, model.home, np.zeros(6))
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    view["rotation"] = np.ascontiguousarray(rotation_exp(angle * axis)).ravel()
    block = law_block(6)
    run(model, block, view)
    np.testing.assert_allclose(block[LAW_FIELDS["error"]][3:], angle * axis, rtol=1e-10, atol=1e-16)


@pytest.mark.parametrize("name", ["ur5", "panda"])
def test_torque_is_finite_and_continuous_through_a_singularity(name: str) -> None:
    """Along a path through a stretched elbow the pivots pass below their floor and the torque has no jump."""
    model = arm(name)
    posture = model.home.copy()
    elbow = 2 if name == "ur5" else 3
    v = np.full(model.nv, 0.3)
    torques, pivots = [], []
    for angle in np.linspace(-0.4, 0.0, 401):
        posture[elbow] = angle
        torques.append(run(model, law_block(model.nv), simulator_view(model, posture, v)))
        jacobian = model.jacobian(posture)
        mobility = jacobian @ np.linalg.solve(model.mass_matrix(posture), jacobian.T)
        pivots.append((np.diag(np.linalg.cholesky(mobility + 1e-15 * np.eye(6))) ** 2).min())
    assert np.isfinite(torques).all()
    assert np.abs(torques).max() < 1e4
    if name == "ur5":
        assert min(pivots) < SMALLEST_PIVOT < max(pivots)


def test_the_law_allocates_nothing() -> None:
    model = arm("panda")
    arguments = tuple(simulator_view(model, model.home, np.ones(7)).values())
    block, torque = write(law_block(7), posture_stiffness=1.0), np.zeros(7)
    law = compile_law(7)

    @njit
    def repeat(times, block, arguments, torque):
        for _ in range(times):
            law(block, *arguments, torque)

    def allocations(times: int) -> int:
        before = rtsys.get_allocation_stats().alloc
        repeat(times, block, arguments, torque)
        return rtsys.get_allocation_stats().alloc - before

    repeat(1, block, arguments, torque)
    _nrt_python.memsys_enable_stats()
    try:
        assert allocations(1000) == allocations(1)
    finally:
        _nrt_python.memsys_disable_stats()


def test_fields_tile_the_block() -> None:
    nv = 7
    size = law_block_size(nv)
    owner = np.zeros(size, int)
    for name, place in LAW_FIELDS.items():
        if not name.endswith("_diagonal"):
            owner[place] += 1
    np.testing.assert_array_equal(owner, 1)
    block = law_block(nv)
    for name in ("stiffness", "damping"):
        block[LAW_FIELDS[f"{name}_diagonal"]] = range(1, 7)
        np.testing.assert_array_equal(block[LAW_FIELDS[name]].reshape(6, 6), np.diag(range(1, 7)))
    assert block[LAW_FIELDS["posture"]].shape == (nv,)
    with pytest.raises(TypeError):
        LAW_FIELDS["magic"] = slice(0)  # type: ignore[index]


def test_a_new_block_is_at_rest() -> None:
    blocks = law_block(6, 3)
    assert blocks.shape == (3, law_block_size(6))
    np.testing.assert_array_equal(blocks[:, LAW_FIELDS["magic"]], LAW_MAGIC)
    np.testing.assert_array_equal(law_block(6), blocks[0])
    model = arm("fanuc")
    view = simulator_view(model, model.home, np.zeros(6))
    np.testing.assert_allclose(run(model, blocks[0], view), view["bias"], atol=1e-12)


@pytest.mark.parametrize("nv", [0, -1, 6.0, True, None])
def test_bad_joint_count_is_refused(nv) -> None:
    for function in (compile_law, law_block, law_block_size):
        with pytest.raises(InputError, match="nv"):
            function(nv)
