"""Conditioning of recordings: each step undoes exactly what was done to the wrench."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.recorded import DAMPING, NOISE, RATE, STIFFNESS, fitted, recording_of_a_spring, rich_motion
from vic_toolbox.errors import InputError
from vic_toolbox.recordings import (
    Recording,
    check_frame,
    compensate_inertia,
    compensate_payload,
    differentiate,
    find_latency,
    identify_payload,
    inspect,
    quaternions,
    read,
    shift_wrench,
    static_poses,
    subtract_bias,
    wrench_to_world,
)
from vic_toolbox.recordings.frame import mountings
from vic_toolbox.recordings.payload import GRAVITY
from vic_toolbox.spatial import (
    quat_wxyz_to_rotation,
    rotate,
    rotation_exp,
    transport_twist,
    transport_wrench,
)

PLACES = [folder / "shared" / "recordings" / "kuka_iiwa" for folder in Path(__file__).parents]
KUKA = next((place for place in PLACES if place.is_dir()), PLACES[0])
MOUNTING = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
OFFSET = np.array([0.02, -0.01, -0.12])
SEEDS = st.integers(0, 2**32 - 1)


# --- transport -----------------------------------------------------------------------------------------------


def as_sensor_logs_it(recording: Recording, mounting: np.ndarray, offset: np.ndarray) -> Recording:
    """The wrench in the axes of a sensor, about its own origin: what `wrench_to_world` undoes."""
    tool = quat_wxyz_to_rotation(recording.quat_wxyz)
    world = transport_wrench(recording.wrench, np.einsum("nij,j->ni", tool, offset))
    sensor = rotate(rotate(world, np.swapaxes(tool, -1, -2)), mounting.T)
    return dataclasses.replace(recording, wrench=sensor, wrench_axes="tool")


@given(SEEDS)
@settings(max_examples=20)
def test_a_sensor_anywhere_on_the_tool_gives_the_same_wrench(seed):
    rng = np.random.default_rng(seed)
    recording = recording_of_a_spring(seconds=0.05, seed=seed % 97)
    mounting, offset = rotation_exp(rng.normal(size=3)), rng.normal(size=3)
    logged = as_sensor_logs_it(recording, mounting, offset)
    again = wrench_to_world(logged, rotation=mounting, offset=offset)
    np.testing.assert_allclose(again.wrench, recording.wrench, atol=1e-12)
    assert again.wrench_axes == "world"
    assert len(again.notes) == len(recording.notes) + 1


def test_transport_keeps_the_power():
    rng = np.random.default_rng(5)
    logged = dataclasses.replace(
        recording_of_a_spring(seconds=0.1), wrench=rng.normal(size=(100, 6)), wrench_axes="tool"
    )
    world = wrench_to_world(logged, rotation=MOUNTING, offset=OFFSET)
    twist = rng.normal(size=(100, 6))  # of the end-effector, world axes
    tool = quat_wxyz_to_rotation(logged.quat_wxyz)
    local = rotate(transport_twist(twist, np.einsum("nij,j->ni", tool, OFFSET)), np.swapaxes(tool, -1, -2))
    local = rotate(local, MOUNTING.T)
    np.testing.assert_allclose((world.wrench * twist).sum(1), (logged.wrench * local).sum(1), atol=1e-12)


def test_a_mounting_that_the_log_forgot_is_mended_in_the_tool():
    recording = recording_of_a_spring(seconds=0.1)
    r = quat_wxyz_to_rotation(recording.quat_wxyz)
    mended = wrench_to_world(recording, rotation=MOUNTING).wrench[:, :3]
    expected = np.einsum("nij,jk,nlk,nl->ni", r, MOUNTING, r, recording.wrench[:, :3])
    np.testing.assert_allclose(mended, expected, atol=1e-12)


@pytest.mark.parametrize(
    "rotation", [np.eye(2), 2 * np.eye(3), np.diag([1, 1, -1]), np.tile(np.eye(3), (2, 1, 1))]
)
def test_what_is_no_rotation_is_refused(rotation):
    with pytest.raises(InputError):
        wrench_to_world(recording_of_a_spring(seconds=0.1), rotation=rotation)


# --- payload and bias ----------------------------------------------------------------------------------------


def weighed(
    mass: float, centre: np.ndarray, bias: np.ndarray, *, tilts: np.ndarray, noise: float = 0.0
) -> Recording:
    """A tool held still in several poses, with motion between them; nothing touches it."""
    rest, move = 700, 800
    tracks = []
    for a, b in zip(tilts, np.roll(tilts, -1, axis=0), strict=True):
        s = np.arange(move) / move
        blend = s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)
        tracks += [np.tile(a, (rest, 1)), a + blend[:, None] * (b - a)]
    vectors = np.concatenate(tracks)
    time = np.arange(len(vectors)) / RATE
    quat = quaternions.exp(vectors)
    position = 0.1 * vectors + np.array([0.5, 0.0, 0.4])
    bare = Recording(
        time=time,
        position=position,
        quat_wxyz=quat,
        reference_position=position,
        reference_quat_wxyz=quat,
        wrench=np.zeros((len(time), 6)),
    )
    r = quat_wxyz_to_rotation(quat)
    arm = np.einsum("nij,j->ni", r, centre)
    where = position + arm
    felt = np.array(GRAVITY) - np.gradient(np.gradient(where, time, axis=0), time, axis=0)
    world = np.hstack([mass * felt, np.cross(arm, mass * felt)])
    rng = np.random.default_rng(0)
    sensor = rotate(world, np.swapaxes(r, -1, -2)) + bias + noise * NOISE * rng.normal(size=world.shape)
    return dataclasses.replace(bare, wrench=sensor, wrench_axes="tool")


TILTS = np.array(
    [[np.pi, 0, 0], [np.pi - 0.6, 0, 0], [np.pi, 0.7, 0], [np.pi - 0.4, -0.5, 0.3], [np.pi, 0.3, -0.6]]
)
BIAS = np.array([3.0, -2.0, 1.0, 0.1, -0.2, 0.05])
CENTRE = np.array([0.01, -0.02, 0.08])


def test_payload_and_bias_are_found_exactly_without_noise():
    recording = weighed(1.3, CENTRE, BIAS, tilts=TILTS)
    payload = identify_payload(recording)
    assert payload.poses == len(TILTS)
    assert payload.mass == pytest.approx(1.3, rel=1e-6)
    np.testing.assert_allclose(payload.centre, CENTRE, atol=1e-6)
    np.testing.assert_allclose(payload.bias, BIAS, atol=1e-5)
    assert max(payload.residual) < 1e-5


def test_payload_and_bias_are_found_within_the_noise():
    payload = identify_payload(weighed(1.3, CENTRE, BIAS, tilts=TILTS, noise=0.2))
    assert payload.mass == pytest.approx(1.3, abs=0.01)
    np.testing.assert_allclose(payload.centre, CENTRE, atol=2e-3)
    np.testing.assert_allclose(payload.bias[:3], BIAS[:3], atol=0.1)


@pytest.mark.parametrize("axes", ["tool", "world"])
def test_nothing_is_left_of_a_free_tool(axes):
    recording = weighed(1.3, CENTRE, BIAS, tilts=TILTS)
    payload = identify_payload(recording)
    if axes == "world":
        recording = wrench_to_world(recording)
    left = compensate_payload(recording, payload).wrench
    still = compensate_payload(recording, payload, inertia=False).wrench
    moving = slice(50, -50)
    assert np.abs(left[moving, :3]).max() < 0.02 * np.abs(recording.wrench[:, :3]).max()
    assert (
        np.abs(still[moving, :3]).max() > 2 * np.abs(left[moving, :3]).max()
    )  # the inertia is felt in between
    for stretch in static_poses(recording):
        np.testing.assert_allclose(still[stretch], 0, atol=1e-2)


def test_poses_that_do_not_tell_mass_from_bias_are_refused():
    upright = np.array(
        [[0, 0, 0.0], [0, 0, 0.5], [0, 0, 1.0], [0, 0, -1.0]]
    )  # turned about the vertical only
    with pytest.raises(InputError, match="tilt the tool"):
        identify_payload(weighed(1.3, CENTRE, BIAS, tilts=upright))
    with pytest.raises(InputError, match="stands still in 0 places"):
        identify_payload(recording_of_a_spring())


def test_a_bias_in_the_fit_of_motion_about_one_side():
    """A5: 3 N of bias bends the stiffness of a fit without intercept; taken out, both agree."""
    time = np.arange(2000) / RATE
    error, rate, _ = rich_motion(time)
    error = error + 0.02
    recording = Recording.from_errors(time, error, rate, 600 * error + 3.0)
    assert fitted(recording, constant=False)[0] > 670
    assert fitted(recording)[0] == pytest.approx(600, abs=0.1)
    freed = subtract_bias(recording, np.full(6, 3.0))
    assert fitted(freed, constant=False)[0] == pytest.approx(600, rel=1e-12)


@pytest.mark.parametrize(("frequency", "stiffness"), [(0.5, 570.4), (1.0, 481.6), (2.0, 126.3)])
def test_inertia_left_out_softens_the_spring(frequency, stiffness):
    """A9: 3 kg left out give K − M ω²; compensated, K."""
    time = np.arange(4 * RATE) / RATE
    omega = 2 * np.pi * frequency
    shape = 0.015 * np.ones(6)
    error, rate = np.sin(omega * time)[:, None] * shape, omega * np.cos(omega * time)[:, None] * shape
    recording = Recording.from_errors(time, error, rate, 600 * error + 50 * rate - 3 * omega**2 * error)
    assert fitted(recording)[0] == pytest.approx(stiffness, abs=0.05)
    for inertia in (np.full(6, 3.0), 3 * np.eye(6)):
        whole = compensate_inertia(recording, inertia).rows(slice(100, -100))
        np.testing.assert_allclose(fitted(whole)[:2], [600, 50], rtol=2e-3)


def test_inertia_of_poses_is_the_inertia_of_errors():
    """A reference at constant speed: accelerations of pose and of error are the same."""
    recording = recording_of_a_spring(inertia=3.0)
    whole = compensate_inertia(recording, np.full(6, 3.0)).rows(slice(100, -100))
    for axis in range(3):
        np.testing.assert_allclose(fitted(whole, axis)[:2], [STIFFNESS[axis], DAMPING[axis]], rtol=5e-3)
    with pytest.raises(InputError, match="tool axes"):
        compensate_inertia(dataclasses.replace(recording, wrench_axes="tool"), np.ones(6))


# --- latency -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late", [-0.004, 0.0, 0.0023, 0.005, 0.02])
@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_a_late_wrench_is_found_to_a_tenth_of_a_millisecond(late, noise):
    """A7."""
    recording = recording_of_a_spring(seconds=10.0, late=late, noise=noise)
    found = find_latency(recording)
    assert found.certain
    assert found.seconds == pytest.approx(late, abs=1e-4 if noise else 1e-6)


def test_a_late_wrench_costs_damping_and_the_shift_gives_it_back():
    """A7: B falls by K τ (with B τ of acceleration, which looks like stiffness)."""
    recording = recording_of_a_spring(seconds=10.0, late=0.005, noise=0.2)
    before = fitted(recording)
    assert before[1] - DAMPING[0] == pytest.approx(-600 * 0.005, abs=0.5)
    shifted = shift_wrench(recording, find_latency(recording).seconds)
    np.testing.assert_allclose(fitted(shifted)[:2], [600, DAMPING[0]], rtol=2e-3)
    assert len(shifted) == len(recording) - 5 or len(shifted) == len(recording) - 6


def test_a_shift_by_whole_samples_is_exact():
    recording = recording_of_a_spring(seconds=1.0, late=0.005)
    shifted = shift_wrench(recording, 0.005)
    np.testing.assert_allclose(fitted(shifted), [600, DAMPING[0], 0], atol=1e-6)


def test_latency_of_nothing_is_refused():
    six = np.zeros((500, 6))
    with pytest.raises(InputError, match="no axis"):
        find_latency(Recording.from_errors(np.arange(500) / RATE, six, six, six))
    with pytest.raises(InputError, match="too short"):
        find_latency(recording_of_a_spring(seconds=0.1))
    with pytest.raises(InputError, match="cannot be shifted"):
        shift_wrench(recording_of_a_spring(seconds=0.1), 1.0)


def test_pure_noise_has_no_certain_latency():
    recording = recording_of_a_spring(seconds=5.0)
    noise = np.random.default_rng(0).normal(size=recording.wrench.shape)
    assert not find_latency(dataclasses.replace(recording, wrench=noise)).certain


# --- rates ---------------------------------------------------------------------------------------------------


def test_local_cubics_differentiate_cubics_exactly():
    time = np.arange(400) / RATE
    cubic = (time[:, None] ** np.arange(4)) @ np.random.default_rng(0).normal(size=(4, 6))
    slope = (np.arange(1, 4) * time[:, None] ** np.arange(3)) @ np.random.default_rng(0).normal(size=(4, 6))[
        1:
    ]
    recording = Recording.from_errors(time, cubic, 0 * cubic, cubic)
    found = differentiate(recording)
    np.testing.assert_allclose(found.error_rate, slope, atol=1e-9)
    np.testing.assert_allclose(found.error, cubic, atol=1e-12)
    np.testing.assert_allclose(found.wrench, cubic, atol=1e-12)


@pytest.mark.parametrize("window", [0.06, 0.08, 0.1])
def test_noise_of_the_encoder_does_not_bias_the_damping(window):
    """0.1 mm at 1 kHz: plain differences lose 37 % of B, local cubics of 60 to 100 ms next to nothing."""
    recording = recording_of_a_spring(seconds=10.0, noise=0.2)
    rng = np.random.default_rng(9)
    noisy = dataclasses.replace(
        recording,
        position=recording.position + 1e-4 * rng.normal(size=recording.position.shape),
        twist=None,
        reference_twist=None,
    )
    plain = np.diff(noisy.error, axis=0, prepend=noisy.error[:1]) * RATE
    rough = Recording.from_errors(noisy.time, noisy.error, plain, noisy.wrench)
    assert fitted(rough)[1] < 0.8 * DAMPING[0]
    fine = fitted(differentiate(noisy, window=window))
    np.testing.assert_allclose(fine[:2], [600, DAMPING[0]], rtol=1e-2)


def test_the_same_filter_on_both_sides_leaves_the_law_true():
    recording = differentiate(recording_of_a_spring(seconds=4.0), window=0.2)
    np.testing.assert_allclose(fitted(recording.rows(slice(200, -200)))[:2], [600, DAMPING[0]], rtol=1e-2)


def test_rates_of_poses_are_those_of_their_motion():
    recording = recording_of_a_spring()
    bare = dataclasses.replace(recording, twist=None, reference_twist=None)
    inside = slice(60, -60)
    found = differentiate(bare, smooth=False)
    np.testing.assert_allclose(found.twist[inside, :3], recording.twist[inside, :3], atol=1e-3)  # type: ignore[index]
    np.testing.assert_array_equal(found.wrench, recording.wrench)


# --- frame ---------------------------------------------------------------------------------------------------


def test_mountings_are_the_rotation_group_of_the_cube():
    turns = mountings()
    assert turns.shape == (24, 3, 3)
    np.testing.assert_array_equal(turns[0], np.eye(3))
    known = {turn.tobytes() for turn in turns + 0.0}
    assert len(known) == 24
    assert all((a @ b + 0.0).tobytes() in known for a in turns for b in turns)


def test_a_good_frame_is_left_alone():
    check = check_frame(recording_of_a_spring(noise=0.5))
    assert not check.suspicious
    assert check.judged
    np.testing.assert_array_equal(check.rotation, np.eye(3))
    assert check.explained_before > 0.5


def test_every_forgotten_mounting_is_noticed_and_undone():
    recording = recording_of_a_spring(seconds=4.0, noise=0.5)
    for turn in mountings()[1:]:
        wrong = wrench_to_world(recording, rotation=turn.T)
        check = check_frame(wrong)
        assert check.suspicious
        np.testing.assert_array_equal(check.rotation, turn)
        np.testing.assert_allclose(check.apply(wrong).wrench, recording.wrench, atol=1e-12)


def test_a_skew_mounting_is_refined():
    recording = recording_of_a_spring(seconds=4.0, noise=0.2)
    true = MOUNTING @ rotation_exp([0.0, 0.0, np.radians(12.0)])
    check = check_frame(wrench_to_world(recording, rotation=true.T))
    np.testing.assert_array_equal(check.rotation, MOUNTING)
    assert np.linalg.norm(check.refined - true) < 0.05
    assert check.explained_refined > check.explained


def test_the_opposite_sign_and_the_sensors_own_axes_are_noticed():
    recording = recording_of_a_spring(seconds=4.0, noise=0.5)
    flipped = check_frame(dataclasses.replace(recording, wrench=-recording.wrench))
    assert flipped.suspicious
    assert flipped.sign == -1
    assert "wrench_sign=-1" in flipped.message
    rng = np.random.default_rng(0)  # a tool that turns a lot: its axes are not those of the world
    turning = quaternions.exp(np.cumsum(rng.normal(scale=0.02, size=(len(recording), 3)), axis=0))
    swung = dataclasses.replace(
        recording,
        quat_wxyz=turning,
        reference_quat_wxyz=turning,
    )
    logged = as_sensor_logs_it(swung, MOUNTING, np.zeros(3))
    check = check_frame(dataclasses.replace(logged, wrench_axes="world"))
    assert check.suspicious
    assert check.wrench_axes == "tool"
    np.testing.assert_array_equal(check.rotation, MOUNTING)


def test_little_force_is_not_judged():
    recording = recording_of_a_spring(seconds=1.0)
    check = check_frame(dataclasses.replace(recording, wrench=0.01 * recording.wrench))
    assert not check.judged
    assert not check.suspicious
    assert "cannot be judged" in check.message


# --- inspection ----------------------------------------------------------------------------------------------


def test_inspection_tells_frame_and_latency():
    recording = recording_of_a_spring(seconds=5.0, noise=0.2, late=0.006)
    kinds = {finding.kind: finding for finding in inspect(recording).findings}
    assert re.search(r"late by (5\.9|6\.0|6\.1) ms", kinds["latency"].message)
    assert "frame" in {f.kind for f in inspect(wrench_to_world(recording, rotation=MOUNTING)).findings}
    assert inspect(recording_of_a_spring(seconds=5.0, noise=0.2)).findings == ()


def test_inspection_of_errors_shows_them_only():
    recording = recording_of_a_spring()
    seen = inspect(dataclasses.replace(recording, time=recording.time[::-1]))
    assert seen.rows == ()
    assert seen.findings[0].kind == "time"


# --- real recordings -----------------------------------------------------------------------------------------

real = pytest.mark.skipif(not KUKA.is_dir(), reason="the folder of real recordings is not here")


@real
@pytest.mark.parametrize(
    ("name", "stiffness"), [("circle", (117, 123, 137)), ("linear_table", (106, 88, 142))]
)
def test_the_frame_trap_of_a_real_log_is_noticed(name, stiffness):
    recording = read(KUKA / f"{name}.txt")
    check = check_frame(recording)
    assert check.suspicious
    np.testing.assert_array_equal(check.rotation, MOUNTING)
    assert check.sign == 1
    assert check.wrench_axes == "world"
    assert check.explained > check.explained_before + 0.2
    stated = read(KUKA / f"{name}.txt", sensor_rotation=MOUNTING)
    np.testing.assert_allclose(check.apply(recording).wrench, stated.wrench, atol=1e-12)
    assert not check_frame(stated).suspicious
    pressed = np.linalg.norm(stated.wrench[:, :3], axis=1) > 2
    found = [np.polyfit(stated.error[pressed, i], stated.wrench[pressed, i], 1)[0] for i in range(3)]
    np.testing.assert_allclose(found, stiffness, rtol=0.1)
    assert "turned by" in str(next(f for f in stated.findings if f.kind == "reference"))


@real
def test_a_real_log_without_contact_is_not_judged():
    assert not check_frame(read(KUKA / "free.txt")).judged
