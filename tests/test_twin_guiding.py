"""Guided demonstrations: the chain of conditioning gives the hand's wrench back, and the fit its gains."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vic_toolbox import recordings
from vic_toolbox.cli.twin import Twin as Command
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.estimation import fit_smooth, fit_windows
from vic_toolbox.files import write_arrays
from vic_toolbox.recordings import inertia_share
from vic_toolbox.tasks import cup_scene
from vic_toolbox.tasks.cup_on_plate import GAINS
from vic_toolbox.twin import (
    Excitation,
    Imperfections,
    Operator,
    Schedule,
    Truth,
    Twin,
    calibrate,
    compare,
    guide,
    load_session,
    save_session,
    study,
)
from vic_toolbox.twin.comparison import STOP
from vic_toolbox.twin.logs import LAYOUT, write_layout
from vic_toolbox.twin.signals import multisine
from vic_toolbox.twin.study import CALM, Case, measure

PERFECT = Twin(Imperfections.none())
GRAVITY = (0.0, 0.0, -9.81)
"""MuJoCo's; the recordings' is 9.80665."""
HANGING_INERTIA = (0.00170476, 0.00193226, 0.00063917)
"""Of gripper and cup about their common centre of mass [kg m²], from their URDF."""
EXAMPLE = Path(recordings.__file__).parent / "example"


# --- the operator ------------------------------------------------------------------------------------------------


@given(t=st.floats(0.0, 10.0))
def test_the_hand_is_as_stiff_as_the_task_allows_and_damps_with_the_root(t: float):
    schedule = Schedule()
    stiffness, damping = schedule.gains(np.array([t]))
    low, high = GAINS.minimum[:6], GAINS.maximum[:6]
    assert (stiffness >= low - 1e-9).all()
    assert (stiffness <= high + 1e-9).all()
    factor = (damping / np.sqrt(stiffness))[0]
    assert factor[:3] == pytest.approx(factor[0])
    assert 9.0 <= factor[0] <= 12.0
    assert factor[3:] == pytest.approx(4.0)


def test_gains_change_smoothly():
    time = np.arange(0.0, 3.0, 1e-3)
    stiffness, _ = Schedule().gains(time)
    assert np.abs(np.diff(stiffness, n=2, axis=0)).max() < 0.01


def test_a_calm_hand_is_spring_and_damper_alone():
    time = np.arange(0.0, 1.0, 1e-3)
    hands = CALM.take(time, count=2, rng=np.random.default_rng(0))
    motion = np.random.default_rng(1).standard_normal((2, 12))
    expected = -hands.stiffness[300] * motion[:, :6] - hands.damping[300] * motion[:, 6:]
    assert hands.wrench(300, motion) == pytest.approx(expected)


def test_a_signal_has_its_power_and_band():
    time = np.arange(0.0, 60.0, 5e-3)
    rms = np.array([2.0, 0.5])
    signal = multisine(time, count=3, band=(0.5, 3.0), rms=rms, rng=np.random.default_rng(0))
    assert signal.std(axis=0) == pytest.approx(np.tile(rms, (3, 1)), rel=0.05)
    power = np.abs(np.fft.rfft(signal[:, 0, 0] * np.hanning(len(time)))) ** 2
    frequency = np.fft.rfftfreq(len(time), 5e-3)
    inside = (frequency > 0.4) & (frequency < 3.1)
    assert power[inside].sum() > 0.999 * power.sum()


def test_the_push_fades_in_and_out():
    time = np.arange(0.0, 5.0, 1e-3)
    push = Excitation(force=4.0, until=2.0).wrench(time, count=2, rng=np.random.default_rng(0))
    assert not push[0].any()
    assert not push[time >= 2.0].any()
    assert push[1000].any()


# --- the chain -----------------------------------------------------------------------------------------------------


def test_at_rest_the_sensor_reads_weight_and_the_calibration_finds_it(tmp_path: Path):
    write_layout(tmp_path / LAYOUT)
    for robot in (
        PERFECT,
        Twin(dataclasses.replace(Imperfections.none(), force_bias=4.0, moment_bias=0.2), seed=3),
    ):
        calibrate(robot).save(tmp_path / "exact.npz", single=False)
        payload = recordings.identify_payload(
            recordings.read(tmp_path / "exact.npz", tmp_path / LAYOUT), gravity=GRAVITY
        )
        assert payload.poses == 12
        assert payload.mass == pytest.approx(
            -0.85, abs=1e-9
        )  # the sign of the wrench is the sign of the weight
        assert payload.centre == pytest.approx((0.0, 0.0, -0.1158824), abs=1e-6)
        with np.load(tmp_path / "exact.npz") as raw:
            first = raw["wrench"][:50] - robot.specimen.bias
        assert np.linalg.norm(first[:, :3], axis=1) == pytest.approx(0.85 * 9.81, rel=1e-9)


@pytest.mark.parametrize("push", [0.0, 5.0])
def test_the_chain_gives_back_what_the_hand_did(tmp_path: Path, push: float):
    """Exact but for the step of the integrator: 1 mN of 30 N."""
    session = guide(PERFECT, count=2, excitation=Excitation(force=push), rate=1000, duration=1.5)
    save_session(session, PERFECT, tmp_path)
    calibrate(PERFECT).save(tmp_path / "exact.npz", single=False)
    session.logs[1].save(tmp_path / "log.npz", single=False)
    layout = tmp_path / LAYOUT
    payload = recordings.identify_payload(recordings.read(tmp_path / "exact.npz", layout), gravity=GRAVITY)
    log = recordings.read(tmp_path / "log.npz", layout)
    assert not [finding for finding in log.findings if finding.severity == "error"]
    log = recordings.compensate_payload(log, payload, gravity=GRAVITY, window=9e-3)
    log = recordings.compensate_inertia(log, [0.0, 0.0, 0.0, *HANGING_INERTIA], window=9e-3)
    off = (log.wrench + session.truth.hand[1])[20:-20]
    assert np.abs(off).max(axis=0) == pytest.approx(np.zeros(6), abs=2e-3)
    assert np.abs(session.truth.hand[1]).max() > 20.0


def test_without_imperfections_the_fit_finds_the_hand():
    found = measure(Case(operator=CALM, imperfections=Imperfections.none(), count=15)).gains
    assert found.stiffness.error.max() < 0.06
    assert found.damping.error.max() < 0.05
    assert np.abs(found.stiffness.bias).max() < 0.02
    assert min(found.stiffness.observable.min(), found.damping.observable.min()) > 0.9


def test_with_all_imperfections_it_is_a_few_per_cent_off():
    found = measure(Case(count=15)).gains
    assert np.median(found.stiffness.error) < 0.06
    assert np.median(found.damping.error) < 0.06
    assert found.stiffness.error.max() < 0.2
    assert found.damping.error.max() < 0.1


def test_without_a_push_unrest_hides_the_hand():
    """Identification in closed loop: what the human does besides moves the arm, and pulls both gains to zero."""
    alone, pushed = (measure(Case(push=push, count=10)) for push in (0.0, 5.0))
    assert np.median(alone.gains.stiffness.bias[:3]) < -0.5
    assert np.median(alone.gains.damping.bias[:3]) < -0.5
    assert np.abs(pushed.gains.stiffness.bias[:3]).max() < 0.06
    assert alone.inertia[:3].min() > 0.85 > 0.6 > pushed.inertia[:3].max()  # and the recordings show it


def test_inertia_alone_is_all_of_it_and_a_spring_is_not():
    time = np.arange(0.0, 4.0, 2e-3)
    matrix = np.random.default_rng(0).standard_normal((6, 6))
    phase = 2 * np.pi * np.outer(time, np.linspace(0.5, 1.5, 6))
    error, rate, bend = (f(phase) for f in (np.sin, np.cos, lambda x: -np.sin(x)))
    speed = 2 * np.pi * np.linspace(0.5, 1.5, 6)
    moved = recordings.Recording.from_errors(time, error, speed * rate, (speed**2 * bend) @ matrix)
    assert inertia_share([moved]) == pytest.approx(np.ones(6), abs=1e-3)
    damped = recordings.Recording.from_errors(time, error, speed * rate, speed * rate)
    assert inertia_share([damped]).max() < 0.3
    assert inertia_share([moved, damped]) == pytest.approx((1 + inertia_share([damped])) / 2, abs=1e-3)
    with pytest.raises(InputError, match="no recording"):
        inertia_share([])
    with pytest.raises(InputError, match="samples"):
        inertia_share([moved.rows(slice(0, 50))])


def test_the_window_of_ten_is_far_off(tmp_path: Path):
    robot = Twin()
    session = guide(robot, count=8, duration=3.0)
    save_session(session, robot, tmp_path)
    logs = load_session(tmp_path, stop=STOP)
    windows = compare([fit_windows(log, 10) for log in logs], session.truth)
    smooth = compare(fit_smooth(logs, 0.2), session.truth)
    assert (windows.stiffness.error[:3] > 5 * smooth.stiffness.error[:3]).all()
    assert windows.stiffness.observable.max() < 0.7


def test_spring_and_damper_nearly_cancel_in_an_overdamped_reach():
    """Why an undisturbed reach says so little: after the first half second the hand hardly pulls."""
    session = guide(PERFECT, CALM, count=1, excitation=Excitation(force=0.0), duration=2.6)
    pose = cup_scene.robot().pose(session.logs[0].joint_position)
    spring = session.truth.stiffness[:, :3] * (pose[:, :3, 3] - cup_scene.GOAL)
    half = slice(250, None)
    pull, tension = (np.linalg.norm(x[half]) for x in (session.truth.hand[0][:, :3], spring))
    assert pull < 0.15 * tension


# --- sessions --------------------------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_numbers_on_any_threads():
    one, two = (guide(Twin(seed=2), count=3, seed=5, duration=0.3, threads=threads) for threads in (1, 2))
    other = guide(Twin(seed=2), count=3, seed=6, duration=0.3)
    for a, b, c in zip(one.logs, two.logs, other.logs, strict=True):
        assert np.array_equal(a.wrench, b.wrench)
        assert np.array_equal(a.joint_position, b.joint_position)
        assert not np.array_equal(a.wrench, c.wrench)


def test_the_cup_is_put_down_softly():
    session = guide(Twin(), count=4, excitation=Excitation(force=0.0))
    end = cup_scene.robot().pose(np.array([log.joint_position[-1] for log in session.logs]))
    assert np.linalg.norm(end[:, :3, 3] - cup_scene.GOAL, axis=1).max() < 15e-3
    assert (session.truth.landing > STOP).all()
    assert (session.truth.landing < 5.0).all()
    assert session.truth.contact.max() < 15.0


def test_a_session_goes_to_disk_and_hides_its_truth(tmp_path: Path):
    robot, out = Twin(seed=1), tmp_path / "session"
    session = guide(robot, count=2, duration=0.6)
    paths = save_session(session, robot, out)
    assert [path.name for path in paths] == ["demonstration_00.npz", "demonstration_01.npz"]
    assert sorted(path.name for path in out.iterdir() if path.is_file()) == [
        "calibration.npz", "demonstration_00.npz", "demonstration_01.npz", "layout.toml",
    ]  # fmt: skip
    for path in paths:
        with np.load(path, allow_pickle=False) as file:
            assert not {"stiffness", "damping", "hand", "contact", "bias"} & set(file.files)
    truth = Truth.load(out / "truth" / "truth.npz")
    for field in dataclasses.fields(Truth):
        assert np.array_equal(getattr(truth, field.name), getattr(session.truth, field.name))
    read = recordings.read(paths[0], out / LAYOUT)
    assert read.wrench_axes == "world"
    assert read.reference_position[0] == pytest.approx(cup_scene.GOAL)
    with pytest.raises(InputError, match="among the demonstrations"):
        save_session(session, robot, out, truth=out / "demonstration_99.npz")
    with pytest.raises(FileError, match="already"):
        save_session(session, robot, out)
    with pytest.raises(FileError, match="truth"):
        Truth.load(paths[0])
    write_arrays(tmp_path / "bent.npz", vars(truth) | {"time": np.zeros((3, 2))})
    with pytest.raises(FileError, match=r"bent\.npz is not the truth of a session"):
        Truth.load(tmp_path / "bent.npz")
    with pytest.raises(FileError, match="vic twin record"):
        load_session(_with_calibration_only(out, tmp_path / "empty"))


def _with_calibration_only(session: Path, folder: Path) -> Path:
    folder.mkdir()
    for name in ("calibration.npz", LAYOUT):
        (folder / name).write_bytes((session / name).read_bytes())
    return folder


@pytest.mark.parametrize(
    ("options", "match"),
    [({"rate": 300.0}, "1000 Hz"), ({"count": 0}, "count"), ({"start_noise": -1.0}, "start_noise")],
)
def test_bad_sessions_are_refused(options: dict, match: str):
    with pytest.raises(InputError, match=match):
        guide(PERFECT, **options)


def test_bad_operators_are_refused():
    with pytest.raises(InputError, match="follow each other"):
        Schedule(soften=3.0)
    with pytest.raises(InputError, match="tremor"):
        Operator(tremor=(-1.0, 0.0))


# --- comparison ------------------------------------------------------------------------------------------------------


@given(factor=st.floats(0.5, 2.0))
def test_a_factor_on_the_truth_is_that_error(factor: float):
    time = np.linspace(0.0, 2.0, 41)
    stiffness, damping = Schedule().gains(time)
    hand = np.zeros((1, 41, 6))
    truth = Truth(time, stiffness, damping, hand, np.zeros((1, 41)), np.zeros(6), np.array(0.85))
    log = recordings.Recording.from_errors(time, np.ones((41, 6)), np.ones((41, 6)), np.ones((41, 6)))
    shape = fit_windows(log, 10)
    seen = np.ones((41, 6), dtype=bool)
    seen[:10, 2] = seen[:, 5] = False
    matrices = [factor * np.einsum("ij,jk->ijk", gains, np.eye(6)) for gains in (stiffness, damping)]
    deviation = np.broadcast_to(0.3 * np.eye(6) * stiffness.mean(), (41, 6, 6))
    estimate = dataclasses.replace(
        shape, time=time, stiffness=matrices[0], damping=matrices[1], stiffness_sd=deviation,
        damping_sd=0 * deviation, stiffness_observable=seen, damping_observable=seen,
    )  # fmt: skip
    found = compare(estimate, truth)
    assert found.stiffness.error[:5] == pytest.approx(abs(factor - 1), abs=1e-12)
    assert (found.damping.bias[:5] * (factor - 1) >= -1e-12).all()
    assert found.stiffness.observable == pytest.approx([1, 1, 31 / 41, 1, 1, 0])
    assert np.isnan(found.stiffness.error[5])
    assert np.isnan(found.stiffness.coverage[5])
    both = compare([estimate, estimate], truth)
    assert both.stiffness.error[:5] == pytest.approx(found.stiffness.error[:5])


def test_comparing_nothing_is_refused():
    with pytest.raises(InputError, match="no estimate"):
        compare([], guide(PERFECT, count=1, duration=0.01).truth)


# --- the command and the example ---------------------------------------------------------------------------------


def test_the_command_records_and_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    folder = tmp_path / "guided"
    Command(what="record", out=folder, count=4, duration=2.8, threads=1).run()
    Command(what="compare", out=folder, threads=1).run()
    out = capsys.readouterr().out
    assert "4 demonstrations" in out
    assert "window of 10: K, error [%]" in out
    assert "smooth, B = d √K: B, bands that hold [%]" in out


def test_the_shipped_example_is_what_its_command_makes(tmp_path: Path):
    Command(what="record", out=tmp_path, count=1, seed=7, threads=1).run()
    for name, made in (("guided", "demonstration_00"), ("calibration", "calibration")):
        file = EXAMPLE / f"{name}.npz"
        assert file.stat().st_size < 300_000
        with np.load(file, allow_pickle=False) as shipped, np.load(tmp_path / f"{made}.npz") as fresh:
            assert shipped.files == fresh.files
            for key in shipped.files:
                assert shipped[key] == pytest.approx(fresh[key], abs=0.05 if key == "wrench" else 1e-4)
    assert (EXAMPLE / "guided.toml").read_text() == (tmp_path / LAYOUT).read_text()


def test_the_shipped_example_is_good_to_fit():
    layout = EXAMPLE / "guided.toml"
    payload = recordings.identify_payload(recordings.read(EXAMPLE / "calibration.npz", layout))
    assert payload.mass == pytest.approx(-0.85, rel=0.02)
    log = recordings.read(EXAMPLE / "guided.npz", layout)
    assert not [finding for finding in log.findings if finding.severity == "error"]
    log = recordings.compensate_payload(log, payload).between(0.0, STOP)
    fit = fit_smooth(log, 0.25)
    assert fit.stiffness_observable[:, :3].mean() > 0.8


def test_a_second_session_is_not_mixed_into_the_first(tmp_path: Path):
    (tmp_path / "demonstration_03.npz").touch()
    with pytest.raises(FileError, match="already"):
        Command(what="record", out=tmp_path).run()
    assert [path.name for path in tmp_path.iterdir()] == ["demonstration_03.npz"]


def test_the_study_tells_sessions_and_replays(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(study, "CASES", {"a few": Case(count=2), "singly": Case(count=2, pooled=False)})
    monkeypatch.setattr(study, "ROBOTS", 1)
    Command(what="study", threads=1).run()
    out = capsys.readouterr().out
    assert "a few" in out
    assert "singly" in out
    gains, wrench = (
        next(line for line in out.splitlines() if name in line) for name in ("gains,", "wrench,")
    )
    ends = [float(line.split("/")[1].split()[0]) for line in (gains, wrench)]
    assert ends[0] < 10.0 < 50.0 < ends[1]
