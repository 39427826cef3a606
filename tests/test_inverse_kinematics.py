"""Inverse kinematics: it inverts the forward kinematics, within the limits, or says why it cannot."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import InputError, ModelError, ReachError
from vic_toolbox.models import available_robots, load_robot
from vic_toolbox.models.inverse_kinematics import reach_bound
from vic_toolbox.spatial import pose_error, pose_from

FANUC = "fanuc_lrmate200id7l"
robot = functools.cache(load_robot)
TOOL_DOWN = np.diag([1.0, -1.0, -1.0])


@pytest.mark.parametrize("name", sorted(available_robots()))
@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_every_pose_of_the_arm_is_found_again(name: str, seed: int):
    model = robot(name)
    target = model.pose(model.random_postures(np.random.default_rng(seed), 1)[0])
    q = model.inverse_kinematics(target)
    assert np.linalg.norm(pose_error(model.pose(q), target)) <= 1e-9
    assert (model.lower <= q).all()
    assert (q <= model.upper).all()


@pytest.mark.parametrize(
    "position", [(0.6, -0.05, 0.3), (0.35, -0.35, 0.45), (0.2, -0.15, 0.5), (0.4, 0.4, 0.02)]
)
def test_the_cup_reaches_the_starts_of_its_task(position: tuple[float, float, float]):
    arm = robot(FANUC, tool="cup_gripper")
    target = pose_from(position, TOOL_DOWN)
    np.testing.assert_allclose(arm.pose(arm.inverse_kinematics(target)), target, atol=1e-9)


def test_a_start_picks_the_branch():
    arm = robot(FANUC)
    up = np.array([0.2, 0.3, -0.4, 0.0, -1.0, 0.0])
    target = arm.pose(up)
    near = arm.inverse_kinematics(target, start=up + 0.05)
    np.testing.assert_allclose(near, up, atol=1e-7)
    flipped = up * [1, 1, 1, 1, -1, 1] + np.pi * np.array([0, 0, 0, 1, 0, -1])
    np.testing.assert_allclose(arm.pose(flipped), target, atol=1e-12)
    np.testing.assert_allclose(arm.inverse_kinematics(target, start=flipped + 0.05), flipped, atol=1e-7)


def test_a_solution_may_lie_at_a_limit():
    arm = robot(FANUC)
    q = np.array([0.1, 0.2, 0.3, 0.4, arm.lower[4], 0.2])
    found = arm.inverse_kinematics(arm.pose(q), start=arm.home)
    np.testing.assert_allclose(arm.pose(found), arm.pose(q), atol=2e-9)
    assert (found >= arm.lower).all()


def test_another_frame_can_be_placed():
    arm = robot(FANUC, tool="cup_gripper")
    target = arm.pose(arm.home + 0.1, "tool0")
    q = arm.inverse_kinematics(target, frame="tool0")
    np.testing.assert_allclose(arm.pose(q, "tool0"), target, atol=1e-9)


def test_the_search_is_reproducible():
    arm = robot("ur5")
    target = arm.pose(arm.random_postures(np.random.default_rng(3), 1)[0])
    first, again = (arm.inverse_kinematics(target, seed=5) for _ in range(2))
    np.testing.assert_array_equal(first, again)


def test_out_of_reach_names_residual_reach_and_remedy():
    arm = robot(FANUC)
    with pytest.raises(ReachError, match=r"off by .* at most 1\.03 m; bring the target .* closer") as info:
        arm.inverse_kinematics(pose_from([2.0, 0, 0.33], TOOL_DOWN))
    assert info.value.residual is not None
    assert info.value.residual > 2.0 - 1.03


@pytest.mark.parametrize(
    ("position", "unit"),
    [
        ((600.0, -50.0, 300.0), "millimetres, divide it by 1000"),
        ((60.0, -5.0, 30.0), "centimetres, divide it by 100"),
    ],
)
def test_a_target_in_another_unit_is_recognised_at_once(position: tuple[float, float, float], unit: str):
    arm = robot(FANUC)
    with pytest.raises(ReachError, match=f"Positions are in metres; if this one is in {unit}"):
        arm.inverse_kinematics(pose_from(position, TOOL_DOWN), attempts=10**9)
    with pytest.raises(ReachError, match=unit):
        arm.check_metres(position)
    arm.check_metres([2.0, 0.0, 0.3])  # out of reach, but metres


def test_a_wrong_orientation_names_its_remedy():
    with pytest.raises(ReachError, match="change the orientation"):
        robot(FANUC).inverse_kinematics(pose_from([0.99, 0, 0.33], TOOL_DOWN), attempts=5)
    with pytest.raises(ReachError, match="5 joints"):
        robot("so100").inverse_kinematics(pose_from([0.1, 0.1, 0.1], TOOL_DOWN), attempts=5)


@pytest.mark.parametrize("name", [FANUC, "panda", "kinova"])
def test_no_posture_leaves_the_reach(name: str):
    model = robot(name)
    centre, radius = reach_bound(model.pinocchio, model.pinocchio.getFrameId(model.frame))
    positions = model.pose(model.random_postures(np.random.default_rng(0), 2000))[:, :3, 3]
    farthest = np.linalg.norm(positions - centre, axis=1).max()
    assert 0.6 * radius < farthest <= radius


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"pose": np.zeros((4, 4))}, InputError, "pose"),
        ({"pose": np.eye(4)[None]}, InputError, "shape"),
        ({"pose": np.full((4, 4), np.nan)}, InputError, "finite"),
        ({"start": np.zeros(5)}, InputError, "start"),
        ({"frame": "nose"}, ModelError, "nose"),
        ({"attempts": 0}, InputError, "attempts"),
        ({"tolerance": 0.0}, InputError, "tolerance"),
        ({"seed": -1}, InputError, "seed"),
    ],
)
def test_bad_input_is_refused(arguments: dict, error: type, message: str):
    arm = robot(FANUC)
    with pytest.raises(error, match=message):
        arm.inverse_kinematics(**{"pose": arm.pose(arm.home), **arguments})
