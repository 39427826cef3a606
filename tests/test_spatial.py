"""Lie-group axioms, power, and finite differences of the spatial functions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vic_toolbox import spatial
from vic_toolbox.errors import Array, InputError

UNIT_INTERVAL = st.floats(-1, 1)
# Angles of every size: ordinary, down to the smallest, and up to the last bit before π.
ANGLES = st.one_of(
    st.floats(0, np.pi),
    st.floats(-300, 0).map(lambda exponent: 10.0**exponent),
    st.floats(-16, 0).map(lambda exponent: np.pi - 10.0**exponent),
)


@st.composite
def unit_vectors(draw: st.DrawFn) -> Array:
    cosine, azimuth = draw(UNIT_INTERVAL), draw(st.floats(-np.pi, np.pi))
    sine = np.sqrt(1 - cosine**2)
    return np.array([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine])


@st.composite
def rotation_vectors(draw: st.DrawFn) -> Array:
    return draw(ANGLES) * draw(unit_vectors())


def vectors(size: int, bound: float = 10.0) -> st.SearchStrategy[Array]:
    return arrays(np.float64, size, elements=st.floats(-bound, bound))


@st.composite
def poses(draw: st.DrawFn) -> Array:
    return spatial.pose_from(draw(vectors(3)), spatial.rotation_exp(draw(rotation_vectors())))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@given(vectors(3), vectors(3))
def test_skew_is_the_cross_product(a: Array, b: Array) -> None:
    np.testing.assert_allclose(spatial.skew(a) @ b, np.cross(a, b), atol=1e-13)


@given(rotation_vectors())
def test_exp_is_a_rotation_with_its_vector_as_axis(w: Array) -> None:
    rotation = spatial.rotation_exp(w)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-14)
    np.testing.assert_allclose(rotation @ w, w, atol=1e-14)


@given(rotation_vectors())
def test_exp_of_log_is_the_rotation(w: Array) -> None:
    rotation = spatial.rotation_exp(w)
    log = spatial.rotation_log(rotation)
    assert np.linalg.norm(log) <= np.pi + 1e-15
    np.testing.assert_allclose(spatial.rotation_exp(log), rotation, atol=4e-15)


@given(rotation_vectors())
def test_log_of_exp_is_the_vector(w: Array) -> None:
    log = spatial.rotation_log(spatial.rotation_exp(w))
    # Within rounding of π the axis may come back with the other sign: it is the same rotation.
    if np.pi - np.linalg.norm(w) < 1e-14 and log @ w < 0:
        log = -log
    np.testing.assert_allclose(log, w, atol=4e-15)


@given(unit_vectors(), st.floats(-300, -9))
def test_log_keeps_relative_accuracy_near_zero(axis: Array, exponent: float) -> None:
    w = 10.0**exponent * axis
    log = spatial.rotation_log(spatial.rotation_exp(w))
    assert np.linalg.norm(log - w) <= 1e-14 * np.linalg.norm(w)


@given(unit_vectors())
def test_log_at_exactly_pi_has_length_pi(axis: Array) -> None:
    half_turn = 2 * np.outer(axis, axis) - np.eye(3)
    log = spatial.rotation_log(half_turn)
    np.testing.assert_allclose(np.linalg.norm(log), np.pi, rtol=1e-14)
    np.testing.assert_allclose(np.abs(log @ axis), np.pi, rtol=1e-14)


@given(rotation_vectors(), rotation_vectors())
def test_log_is_equivariant_under_change_of_axes(w: Array, u: Array) -> None:
    change, rotation = spatial.rotation_exp(u), spatial.rotation_exp(w)
    if np.pi - np.linalg.norm(w) > 1e-6:
        log = spatial.rotation_log(change @ rotation @ change.T)
        np.testing.assert_allclose(log, change @ w, atol=1e-13)


@given(rotation_vectors())
def test_quaternion_round_trip(w: Array) -> None:
    rotation = spatial.rotation_exp(w)
    quaternion = spatial.rotation_to_quat_wxyz(rotation)
    assert quaternion[0] >= 0
    np.testing.assert_allclose(np.linalg.norm(quaternion), 1, rtol=1e-15)
    np.testing.assert_allclose(spatial.quat_wxyz_to_rotation(quaternion), rotation, atol=4e-15)
    np.testing.assert_allclose(spatial.quat_wxyz_to_rotation(-quaternion), rotation, atol=4e-15)


def test_quaternion_order_is_wxyz() -> None:
    quarter_turn = spatial.rotation_exp([0, 0, np.pi / 2])
    expected = np.array([1, 0, 0, 1]) / np.sqrt(2)
    np.testing.assert_allclose(spatial.rotation_to_quat_wxyz(quarter_turn), expected, atol=1e-15)
    np.testing.assert_allclose(quarter_turn @ [1, 0, 0], [0, 1, 0], atol=1e-15)


def test_quaternion_rounding_is_normalised_away() -> None:
    rounded = np.round(spatial.rotation_to_quat_wxyz(spatial.rotation_exp([0.3, -1.2, 0.8])), 3)
    rotation = spatial.quat_wxyz_to_rotation(rounded)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


@given(poses(), vectors(3), rotation_vectors())
def test_pose_error_is_the_displacement_in_world_axes(reference: Array, shift: Array, w: Array) -> None:
    if np.pi - np.linalg.norm(w) > 1e-6:
        moved = reference.copy()
        moved[:3, 3] += shift
        moved[:3, :3] = spatial.rotation_exp(w) @ reference[:3, :3]
        error = spatial.pose_error(moved, reference)
        np.testing.assert_allclose(error, np.concatenate([shift, w]), atol=1e-13)


@given(poses())
def test_pose_error_of_a_pose_with_itself_is_zero(pose: Array) -> None:
    np.testing.assert_allclose(spatial.pose_error(pose, pose), 0, atol=1e-14)


@given(poses(), vectors(6, 1.0))
def test_pose_error_rate_at_the_reference_is_the_twist(reference: Array, twist: Array) -> None:
    step = 1e-6
    after, before = (
        spatial.pose_from(
            reference[:3, 3] + time * twist[:3], spatial.rotation_exp(time * twist[3:]) @ reference[:3, :3]
        )
        for time in (step, -step)
    )
    rate = (spatial.pose_error(after, reference) - spatial.pose_error(before, reference)) / (2 * step)
    np.testing.assert_allclose(rate, twist, atol=1e-7)


@given(vectors(6), vectors(6), vectors(3))
def test_transport_preserves_power(wrench: Array, twist: Array, offset: Array) -> None:
    moved = spatial.transport_wrench(wrench, offset) @ spatial.transport_twist(twist, offset)
    np.testing.assert_allclose(moved, wrench @ twist, atol=1e-10)


@given(vectors(6), vectors(3), vectors(3))
def test_transports_add_up(six: Array, first: Array, second: Array) -> None:
    for transport in (spatial.transport_wrench, spatial.transport_twist):
        twice = transport(transport(six, first), second)
        np.testing.assert_allclose(twice, transport(six, first + second), atol=1e-11)
        np.testing.assert_allclose(transport(transport(six, first), -first), six, atol=1e-11)


@given(vectors(6), vectors(3))
def test_transport_matrix_carries_twists_forth_and_wrenches_back(six: Array, offset: Array) -> None:
    matrix = spatial.twist_transport_matrix(offset)
    np.testing.assert_allclose(matrix @ six, spatial.transport_twist(six, offset), atol=1e-12)
    np.testing.assert_allclose(matrix.T @ six, spatial.transport_wrench(six, -offset), atol=1e-12)


def test_transport_wrench_has_the_lever_arm_the_right_way_round() -> None:
    # A force along y, applied 1 m ahead along x of the point we move to, turns about +z there.
    moved = spatial.transport_wrench([0, 1, 0, 0, 0, 0], [-1, 0, 0])
    np.testing.assert_array_equal(moved, [0, 1, 0, 0, 0, 1])


def test_transport_twist_is_the_velocity_of_the_other_point() -> None:
    # Turning about z, the point 1 m ahead along x moves along y.
    moved = spatial.transport_twist([0, 0, 0, 0, 0, 1], [1, 0, 0])
    np.testing.assert_array_equal(moved, [0, 1, 0, 0, 0, 1])


@given(vectors(6), vectors(6), rotation_vectors())
def test_rotate_preserves_power_and_undoes(wrench: Array, twist: Array, w: Array) -> None:
    rotation = spatial.rotation_exp(w)
    rotated = spatial.rotate(wrench, rotation)
    np.testing.assert_allclose(rotated[:3], rotation @ wrench[:3], atol=1e-13)
    np.testing.assert_allclose(rotated[3:], rotation @ wrench[3:], atol=1e-13)
    np.testing.assert_allclose(rotated @ spatial.rotate(twist, rotation), wrench @ twist, atol=1e-11)
    np.testing.assert_allclose(spatial.rotate(rotated, rotation.T), wrench, atol=1e-13)


def samples(rng: np.random.Generator) -> dict[str, tuple[Callable[..., Array], tuple[Array, ...]]]:
    """Each function with a batch of 5 for every argument."""
    three, six = rng.normal(size=(5, 3)), rng.normal(size=(5, 6))
    rotation = spatial.rotation_exp(three)
    pose = spatial.pose_from(rng.normal(size=(5, 3)), rotation)
    return {
        "skew": (spatial.skew, (three,)),
        "rotation_exp": (spatial.rotation_exp, (three,)),
        "rotation_log": (spatial.rotation_log, (rotation,)),
        "rotation_to_quat_wxyz": (spatial.rotation_to_quat_wxyz, (rotation,)),
        "quat_wxyz_to_rotation": (
            spatial.quat_wxyz_to_rotation,
            (spatial.rotation_to_quat_wxyz(rotation),),
        ),
        "pose_from": (spatial.pose_from, (three, rotation)),
        "pose_error": (spatial.pose_error, (pose, pose[::-1])),
        "transport_twist": (spatial.transport_twist, (six, three)),
        "transport_wrench": (spatial.transport_wrench, (six, three)),
        "twist_transport_matrix": (spatial.twist_transport_matrix, (three,)),
        "rotate": (spatial.rotate, (six, rotation)),
    }


NAMES = sorted(samples(np.random.default_rng(0)))


@pytest.mark.parametrize("name", NAMES)
def test_a_batch_is_its_samples(name: str, rng: np.random.Generator) -> None:
    function, arguments = samples(rng)[name]
    batch = function(*arguments)
    for i in range(5):
        np.testing.assert_allclose(batch[i], function(*(a[i] for a in arguments)), atol=1e-15)
    nested = function(*(a.reshape(5, 1, *a.shape[1:]) for a in arguments))
    np.testing.assert_array_equal(nested[:, 0], batch)
    empty = function(*(a[:0] for a in arguments))
    assert empty.shape == (0, *batch.shape[1:])


@pytest.mark.parametrize("name", [n for n in NAMES if len(samples(np.random.default_rng(0))[n][1]) == 2])
def test_one_sample_serves_a_whole_batch(name: str, rng: np.random.Generator) -> None:
    function, (first, second) = samples(rng)[name]
    for i in range(5):
        np.testing.assert_allclose(function(first, second[0])[i], function(first[i], second[0]), atol=1e-15)
        np.testing.assert_allclose(function(first[0], second)[i], function(first[0], second[i]), atol=1e-15)
    with pytest.raises(InputError, match=r"\(5,\).*\(3,\)"):
        function(first, second[:3])


@pytest.mark.parametrize("name", NAMES)
def test_functions_refuse_nan_and_wrong_shapes_and_leave_arguments_alone(
    name: str, rng: np.random.Generator
) -> None:
    function, arguments = samples(rng)[name]
    before = [a.copy() for a in arguments]
    function(*arguments)
    for a, b in zip(arguments, before, strict=True):
        np.testing.assert_array_equal(a, b)
    for i, argument in enumerate(arguments):
        bad = argument.copy()
        bad[2, ..., 0] = np.nan
        for wrong in (bad, argument[..., :-1], "text", None):
            with pytest.raises(InputError):
                function(*arguments[:i], wrong, *arguments[i + 1 :])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: spatial.rotation_log(2 * np.eye(3)), "not a rotation matrix: R Rᵀ departs .* by 3"),
        (lambda: spatial.rotation_log(-np.eye(3)), "reflection"),
        (lambda: spatial.pose_from(np.zeros(3), np.diag([1.0, 1.0, -1.0])), "reflection"),
        (lambda: spatial.rotate(np.zeros(6), np.ones((3, 3))), "not a rotation matrix"),
        (lambda: spatial.pose_error(np.ones((4, 4)), np.eye(4)), "last row of pose"),
        (lambda: spatial.pose_error(np.eye(4), np.diag([2.0, 2, 2, 1])), "rotation of reference"),
        (lambda: spatial.quat_wxyz_to_rotation([0.0, 0, 0, 0]), "norm 0;"),
        (lambda: spatial.quat_wxyz_to_rotation([2.0, 0, 0, 0]), "norm 2; .* divide by the norm"),
    ],
)
def test_what_is_not_a_rotation_or_a_pose_is_refused(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()
