"""Recordings: the record itself, its validation and repairs, saving."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tests.recorded import RATE, recording_of_a_spring
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.recordings import Finding, Recording, quaternions, read, repair
from vic_toolbox.spatial import pose_error, pose_from, quat_wxyz_to_rotation, rotation_exp

VECTORS = arrays(float, (7, 3), elements=st.floats(-2.0, 2.0))


def kinds(recording: Recording) -> dict[str, Finding]:
    return {finding.kind: finding for finding in recording.findings}


def changed(name: str, index: object, value: object, **more: object) -> Recording:
    recording = recording_of_a_spring()
    array = getattr(recording, name).copy()
    array[index] = value
    return dataclasses.replace(recording, **{name: array}, **more)


# --- the record ----------------------------------------------------------------------------------------------


def test_from_errors_gives_back_what_it_was_given():
    rng = np.random.default_rng(0)
    time, error, rate, wrench = np.arange(9) / 100, *rng.normal(size=(3, 9, 6))
    recording = Recording.from_errors(time, error, rate, wrench)
    np.testing.assert_array_equal(recording.error, error)
    np.testing.assert_array_equal(recording.error_rate, rate)
    np.testing.assert_array_equal(recording.wrench, wrench)
    assert recording.findings == ()
    assert recording.rate == pytest.approx(100)


def test_the_poses_of_from_errors_have_these_errors():
    error = 0.5 * np.random.default_rng(1).normal(size=(9, 6))
    recording = Recording.from_errors(np.arange(9.0), error, error, error)
    poses = dataclasses.replace(recording, given_error=None)
    np.testing.assert_allclose(poses.error, error, atol=1e-14)


@given(VECTORS, VECTORS, VECTORS, VECTORS)
def test_error_is_the_pose_error_of_the_conventions(p, r, pd, rd):
    recording = Recording(
        time=np.arange(7.0),
        position=p,
        quat_wxyz=quaternions.exp(r),
        reference_position=pd,
        reference_quat_wxyz=-quaternions.exp(rd),  # the sign of a quaternion says nothing
        wrench=np.zeros((7, 6)),
    )
    expected = pose_error(pose_from(p, rotation_exp(r)), pose_from(pd, rotation_exp(rd)))
    turned = np.linalg.norm(expected[:, 3:], axis=1)
    sure = turned < np.pi - 1e-6  # at π both signs are right
    np.testing.assert_allclose(recording.error[sure], expected[sure], atol=1e-9)


def test_error_rate_is_the_derivative_of_the_error():
    recording = recording_of_a_spring()
    truth = recording.error_rate
    bare = dataclasses.replace(recording, twist=None, reference_twist=None)
    inside = slice(50, -50)
    np.testing.assert_allclose(bare.error_rate[inside], truth[inside], atol=2e-3 * np.abs(truth).max())


def test_twist_without_a_wanted_twist_uses_the_moving_reference():
    recording = recording_of_a_spring()
    half = dataclasses.replace(recording, reference_twist=None, given_error=None)
    np.testing.assert_allclose(half.error_rate, recording.error_rate, atol=1e-9)


def test_an_uneven_clock_gives_the_same_rate():
    recording = recording_of_a_spring()
    rng = np.random.default_rng(3)
    rows = np.sort(rng.choice(len(recording), len(recording) * 3 // 4, replace=False))
    bare = dataclasses.replace(recording.rows(rows), twist=None, reference_twist=None)
    error = (bare.error_rate - recording.rows(rows).error_rate)[60:-60]
    assert np.abs(error).max() < 0.02 * np.abs(recording.error_rate).max()


def test_arrays_are_copies_that_nobody_changes():
    time = np.arange(5.0)
    six = np.zeros((5, 6))
    recording = Recording.from_errors(time, six, six, six)
    time[0] = 9.0
    assert recording.time[0] == 0.0
    for array in (*recording.arrays().values(), recording.error, recording.error_rate):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"wrench": np.zeros((5, 5))}, r"wrench has shape \(5, 5\); pass real numbers of shape \(n, 6\)"),
        ({"wrench": np.zeros((4, 6))}, "wrench has 4 samples and time has 5"),
        ({"position": [["a"] * 3] * 5}, "position holds"),
        ({"time": np.zeros((5, 1))}, "time has shape"),
        ({"wrench_axes": "sensor"}, "wrench_axes is 'sensor'; choose one of: world, tool"),
        ({"position": [[1, 2, 3], [1, 2]]}, "position is not an array"),
    ],
)
def test_wrong_shapes_are_refused(changes, message):
    six = np.zeros((5, 6))
    good = Recording.from_errors(np.arange(5.0), six, six, six)
    with pytest.raises(InputError, match=message):
        dataclasses.replace(good, **changes)


def test_no_samples_are_refused():
    with pytest.raises(InputError, match="no samples"):
        Recording.from_errors([], np.zeros((0, 6)), np.zeros((0, 6)), np.zeros((0, 6)))


def test_between_and_one_sample():
    recording = recording_of_a_spring()
    piece = recording.between(0.5, 1.0)
    assert piece.time[0] == pytest.approx(0.5)
    assert len(piece) == RATE // 2 + 1
    assert len(recording.rows([3])) == 1
    assert "one sample" in repr(recording.rows([3]))
    assert recording.rows([3]).findings == ()
    with pytest.raises(InputError, match="no sample lies between"):
        recording.between(100.0, 101.0)
    with pytest.raises(InputError, match="too few"):
        _ = dataclasses.replace(recording.rows([3]), twist=None).error_rate


# --- findings ------------------------------------------------------------------------------------------------


def test_a_good_recording_has_no_findings():
    assert recording_of_a_spring(noise=0.2).findings == ()


@pytest.mark.parametrize(
    ("recording", "kind", "severity", "index"),
    [
        (lambda: changed("time", 100, 0.05), "time", "error", 100),
        (lambda: changed("time", 100, 99 / RATE), "duplicate", "error", 100),
        (lambda: changed("wrench", (7, 2), np.nan), "nan", "error", 7),
        (lambda: changed("position", (8, 2), np.inf), "nan", "error", 8),
        (lambda: changed("quat_wxyz", 9, 0.0), "quaternion", "error", 9),
        (lambda: changed("quat_wxyz", slice(11, None), -recording_of_a_spring().quat_wxyz[11:]), "flip", "warning", 11),
        (lambda: recording_of_a_spring().rows(np.r_[0:100, 200:400]), "gap", "warning", 100),
        (lambda: changed("position", slice(None), 1e3 * recording_of_a_spring().position), "units", "warning", 0),
        (lambda: changed("time", slice(None), 1e3 * recording_of_a_spring().time), "units", "warning", 0),
        (lambda: changed("wrench", slice(None), 1e4 * recording_of_a_spring().wrench + 1e5), "units", "warning", 0),
        (lambda: changed("wrench", (slice(None), slice(3, 6)), 1e3 * np.ones((2000, 3))), "units", "warning", 0),
        (lambda: changed("wrench", (slice(300, 900), 1), 0.123), "frozen", "warning", 300),
        (lambda: changed("wrench", (slice(300, 330), 1), 50.0), "saturated", "warning", 300),
        (lambda: changed("wrench", slice(None), 0.0), "zero", "warning", 0),
        (lambda: changed("wrench", (slice(None), 4), 0.0), "constant", "warning", 0),
        (lambda: changed("reference_position", slice(None), 5.0, given_error=None), "reference", "warning", 0),
    ],
)  # fmt: skip
def test_each_fault_is_found_where_it_is(recording, kind, severity, index):
    found = kinds(recording())
    assert kind in found
    assert found[kind].severity == severity
    assert found[kind].index == index or kind == "units"
    assert found[kind].remedy
    assert str(index) in str(found[kind]) or kind == "units"


def test_a_reference_turned_away_is_found():
    recording = recording_of_a_spring()
    turned = np.tile([0.0, 0.0, 1.0, 0.0], (len(recording), 1))
    found = kinds(dataclasses.replace(recording, reference_quat_wxyz=turned, given_error=None))
    assert "turned by" in found["reference"].message


def test_doubled_rows_are_found():
    recording = recording_of_a_spring()
    wrench, position, quat = (getattr(recording, n).copy() for n in ("wrench", "position", "quat_wxyz"))
    for array in (wrench, position, quat):
        array[41] = array[40]
    doubled = dataclasses.replace(recording, wrench=wrench, position=position, quat_wxyz=quat)
    assert kinds(doubled)["duplicate"].index == 41
    assert len(repair(doubled)) == len(recording) - 1


def test_errors_are_refused_before_anything_is_computed():
    recording = changed("time", 100, 0.05)
    with pytest.raises(InputError, match=r"time runs backwards 1 times.*sample 100\)"):
        _ = recording.error
    with pytest.raises(InputError, match="And 1 more"):
        dataclasses.replace(recording, wrench=np.full((len(recording), 6), np.nan)).check()


@given(st.integers(0, 2**32 - 1))
def test_what_is_repaired_has_no_errors_and_keeps_the_good_samples(seed):
    rng = np.random.default_rng(seed)
    recording = recording_of_a_spring(seconds=0.2)
    arrays_ = {name: array.copy() for name, array in recording.arrays().items()}
    count = len(recording)
    arrays_["time"][rng.integers(0, count, 3)] = rng.uniform(0, 0.2)
    arrays_["wrench"][rng.integers(0, count, 2), rng.integers(0, 6)] = np.nan
    arrays_["quat_wxyz"][rng.integers(0, count, 2)] *= rng.choice([0.0, 2.0, -1.0])
    mended = repair(dataclasses.replace(recording, **arrays_))
    assert [f for f in mended.findings if f.severity == "error"] == []
    assert "flip" not in kinds(mended)
    assert np.isin(mended.time, arrays_["time"]).all()
    assert repair(mended).notes == mended.notes  # nothing is left to mend


def test_repair_does_what_it_is_asked_and_says_so():
    recording = changed("wrench", (7, 2), np.nan)
    assert repair(recording, ["flip"]).notes == ()
    mended = recording.repaired(["nan"])
    assert len(mended) == len(recording) - 1
    assert mended.notes == ("dropped 1 samples: not finite",)
    with pytest.raises(InputError, match="kind is 'all'; choose one of: nan, time"):
        repair(recording, ["all"])
    with pytest.raises(InputError, match="no sample is left"):
        repair(changed("wrench", slice(None), np.nan))


# --- saving --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", [".npz", ".h5", ".hdf5"])
def test_what_is_saved_is_read_back(tmp_path: Path, suffix: str):
    recording = dataclasses.replace(
        recording_of_a_spring(), joint_position=np.ones((2000, 7)), notes=("from a test", "α")
    )
    recording.save(tmp_path / f"a{suffix}")
    again = read(tmp_path / f"a{suffix}")
    assert again.notes == recording.notes
    assert again.wrench_axes == recording.wrench_axes
    assert again.arrays().keys() == recording.arrays().keys()
    for name, array in recording.arrays().items():
        np.testing.assert_array_equal(again.arrays()[name], array)
    assert [path.name for path in tmp_path.iterdir()] == [f"a{suffix}"]  # no temporary file is left


def test_saving_refuses_other_suffixes(tmp_path: Path):
    with pytest.raises(InputError, match=r"choose one of: \.npz, \.h5"):
        recording_of_a_spring().save(tmp_path / "a.csv")


def test_damaged_recordings_are_refused(tmp_path: Path):
    path = tmp_path / "a.h5"
    recording_of_a_spring().save(path)
    with h5py.File(path, "r+") as file:
        del file["wrench"]
    with pytest.raises(FileError, match=r"damaged recording.*missing: wrench"):
        read(path)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = np.bytes_("vic-recording-9")
    with pytest.raises(FileError, match="this version reads vic-recording-1"):
        read(path)


# --- quaternions ---------------------------------------------------------------------------------------------


@given(VECTORS, VECTORS)
def test_quaternions_agree_with_rotation_matrices(a, b):
    qa, qb = quaternions.exp(a), quaternions.exp(b)
    np.testing.assert_allclose(quat_wxyz_to_rotation(qa), rotation_exp(a), atol=1e-13)
    product = quat_wxyz_to_rotation(quaternions.multiply(qa, qb))
    np.testing.assert_allclose(product, rotation_exp(a) @ rotation_exp(b), atol=1e-13)
    np.testing.assert_allclose(
        quaternions.rotate(qa, b), np.einsum("nij,nj->ni", rotation_exp(a), b), atol=1e-13
    )
    short = np.linalg.norm(a, axis=1) < np.pi - 1e-6
    np.testing.assert_allclose(quaternions.log(qa)[short], a[short], atol=1e-9)


def test_interpolation_turns_at_constant_speed():
    times, wanted = np.array([0.0, 1.0, 3.0]), np.linspace(-1, 4, 26)
    track = quaternions.exp(np.array([[0, 0, 0], [0, 0, 1.0], [0, 0, 0]]))
    track[1] *= -1  # the other sign, the same orientation
    angle = quaternions.log(quaternions.interpolate(times, track, wanted))[:, 2]
    np.testing.assert_allclose(angle, np.interp(wanted, times, [0, 1, 0]), atol=1e-12)
