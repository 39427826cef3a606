"""From raw logs to gains: the chain, what it says about itself, and the folder that it leaves."""

from __future__ import annotations

import hashlib
import json
import re
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fit_data import KUKA, LAYOUT, MOUNTING, TOOL, at_rest, guided, raw
from tests.gain_data import diagonal, diagonals, full, recorded
from tests.recorded import DAMPING, STIFFNESS, recording_of_a_spring
from vic_toolbox.control import CartesianLaw, Reference, simulate
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments import fit_report
from vic_toolbox.experiments.fit_advice import frame_options
from vic_toolbox.experiments.fit_report import FILES, next_steps, write_fit
from vic_toolbox.experiments.fit_settings import FitSettings
from vic_toolbox.experiments.fit_summary import axis_summaries, in_one_number, plus_minus, rounded, verdict
from vic_toolbox.experiments.fitting import Fit, fit_logs, fit_recordings
from vic_toolbox.experiments.gain_table import GainTable
from vic_toolbox.experiments.result_folder import new_folder
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.models import load_robot
from vic_toolbox.recordings import Layout, Recording, check_frame, read
from vic_toolbox.recordings.frame import mountings

CONSTANT = FitSettings(constant=True)
TURNED = Layout(sensor_rotation=LAYOUT.sensor_rotation)


def warned(fit: Fit) -> str:
    return "\n".join(str(a) for a in fit.advice if a.severity != "note")


@pytest.fixture(scope="module")
def partly() -> Fit:
    """Five axes move, z does not."""
    known = diagonal(duration=2.0, profile="constant").recording
    e, v, w = (np.array(x) for x in (known.error, known.error_rate, known.wrench))
    e[:, 2] = v[:, 2] = 0.0
    return fit_recordings([recorded(known.time, e, v, w)], FitSettings(knots=0.5))


@pytest.fixture(scope="module")
def folder(partly: Fit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("fit") / "out"
    write_fit(partly, path)
    return path


# --- the chain -----------------------------------------------------------------------------------------------


def test_a_raw_log_with_its_calibration_gives_the_gains(tmp_path: Path):
    log, rest = guided(tmp_path / "log.npz"), at_rest(tmp_path / "rest.npz")
    fit = fit_logs([log], CONSTANT, layout=LAYOUT, calibration=rest)
    assert fit.payload is not None
    assert fit.payload.mass == pytest.approx(TOOL.mass, abs=1e-6)
    np.testing.assert_allclose(diagonals(fit.estimate.stiffness)[0], STIFFNESS, rtol=0.02)
    np.testing.assert_allclose(diagonals(fit.estimate.damping)[0], DAMPING, rtol=0.05)
    assert "bias" not in warned(fit)
    without = fit_logs([log], CONSTANT, layout=LAYOUT)
    assert "--calibration" in warned(without)
    found = np.nan_to_num(diagonals(without.estimate.stiffness)[0])
    assert np.abs(found / STIFFNESS - 1).max() > 0.1


def test_inertia_is_taken_out_where_the_mass_is_given():
    log = recording_of_a_spring(seconds=4.0, inertia=3.0)
    plain = fit_recordings([log], CONSTANT).estimate
    mended = fit_recordings([log], replace(CONSTANT, mass=3.0, inertia=(3.0, 3.0, 3.0))).estimate
    np.testing.assert_allclose(diagonals(mended.stiffness)[0], STIFFNESS, rtol=0.05)
    assert np.nan_to_num(diagonals(plain.stiffness))[0, 0] < 0.9 * STIFFNESS[0]


def test_a_late_wrench_is_told_and_estimated():
    log = recording_of_a_spring(seconds=4.0, noise=0.1, late=0.005)
    told = fit_recordings([log], CONSTANT)
    assert re.search(r"late by (4\.9|5\.0|5\.1) ms.*--latency", warned(told))
    for settings in (
        replace(CONSTANT, latency=True),
        FitSettings(method="windows", window=400, step=50, latency=True),
    ):
        fit = fit_recordings([log], settings)
        assert "ms" not in warned(fit)
        np.testing.assert_allclose(
            np.nanmean(diagonals(fit.estimate.damping), axis=0)[0], DAMPING[0], rtol=0.02
        )


def test_a_bias_is_told_and_estimated():
    log = recording_of_a_spring(seconds=4.0, noise=0.2)
    off = log.noted(wrench=log.wrench + np.array([3.0, 0, 0, 0, 0, 0]))
    assert "bias" not in warned(fit_recordings([log], CONSTANT))
    assert re.search(r"bias \((2\.9|3|3\.1) N along x\).*--bias", warned(fit_recordings([off], CONSTANT)))
    fit = fit_recordings([off], replace(CONSTANT, bias=True))
    assert "bias" not in warned(fit)
    np.testing.assert_allclose(diagonals(fit.estimate.stiffness)[0, 0], STIFFNESS[0], rtol=0.01)


def test_only_a_part_of_a_log_is_fitted():
    known = diagonal(duration=4.0, profile="steps")
    fit = fit_recordings([known.recording], FitSettings(constant=True, between=(0.0, 1.0)))
    assert fit.recordings[0].duration <= 1.0
    np.testing.assert_allclose(diagonals(fit.estimate.stiffness)[0], known.stiffness[500], rtol=0.02)


def test_contact_only():
    log = recording_of_a_spring(seconds=4.0, noise=0.1)
    fit = fit_recordings([log], replace(CONSTANT, contact=5.0))
    assert (np.linalg.norm(fit.recordings[0].wrench[:, :3], axis=1) >= 5.0).all()
    np.testing.assert_allclose(diagonals(fit.estimate.stiffness)[0], STIFFNESS, rtol=0.03)
    with pytest.raises(InputError, match="lower --contact"):
        fit_recordings([log], replace(CONSTANT, contact=1e4))


def test_logs_are_pooled_from_their_starts():
    logs = [diagonal(seed, duration=1.5, profile="constant").recording for seed in range(3)]
    logs = [log.noted(time=log.time + 100.0 * i) for i, log in enumerate(logs)]
    fit = fit_recordings(logs, FitSettings(knots=0.5))
    assert fit.estimate.time[0] == 0.0
    assert fit.estimate.time[-1] < 1.6
    assert len(fit.estimate.residuals) == 4500
    longer = [*logs[:2], diagonal(3, duration=4.0, profile="constant").recording]
    assert "--constant" in warned(fit_recordings(longer, FitSettings(knots=0.5)))


@pytest.mark.parametrize("settings", [
    FitSettings(structure="full", knots=0.5),
    FitSettings(structure="damping_factor", knots=0.5),
    FitSettings(method="windows", window=300, step=100),
    FitSettings(robust=True, bias=True, knots=0.5),
    FitSettings(smoothing=0.02, knots=0.5),
])  # fmt: skip
def test_every_kind_of_fit_has_a_verdict(settings: FitSettings):
    known = diagonal(duration=1.5)
    fit = fit_recordings([known.recording], settings)
    axes = axis_summaries(fit)
    assert fit.determined
    assert "The stiffness" in " ".join(verdict(fit, axes))
    assert abs(axes[0].stiffness.mean / known.stiffness[:, 0].mean() - 1) < 0.15


def test_gains_that_are_hardly_ever_known_are_drawn_all_the_same(tmp_path: Path):
    log = diagonal(duration=1.0).recording
    late = log.noted(time=log.time + np.where(log.time > 0.5, 30.0, 0.0))
    fit = fit_recordings([late], FitSettings(constraint="none"))
    assert fit.determined
    assert fit.estimate.stiffness_observable.mean() < 0.1
    assert "gap" in warned(fit)
    write_fit(fit, tmp_path / "out")
    assert (tmp_path / "out" / "figures" / "gains.svg").exists()


# --- the frame -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stated", [np.eye(3), mountings()[7]])
@pytest.mark.parametrize("turned", [True, False])
def test_the_options_for_a_wrong_frame_mend_it(stated: np.ndarray, turned: bool, tmp_path: Path):
    path = raw(recording_of_a_spring(seconds=2.0, noise=0.2), tmp_path / "log.npz", turned=turned)
    layout = Layout(
        sensor_rotation=tuple(map(tuple, stated.tolist())), wrench_axes="world" if turned else "tool"
    )
    fit = fit_logs([path], CONSTANT, layout=layout)
    assert fit.advice[0].severity == "alarm"
    assert verdict(fit, axis_summaries(fit))[0].startswith("Do not use these gains yet")
    frame = fit.inspections[0].frame
    assert frame is not None
    options = frame_options(frame, layout)
    assert options is not None
    assert options in fit.advice[0].remedy
    assert any(options in line for line, _ in next_steps(fit, tmp_path))
    numbers = [float(x) for x in options.split("--sensor-rotation ")[1].split()[:9]]
    np.testing.assert_allclose(np.reshape(numbers, (3, 3)), MOUNTING)
    again = fit_logs([path], CONSTANT, layout=replace(layout, sensor_rotation=np.reshape(numbers, (3, 3))))  # type: ignore[arg-type]
    assert not [a for a in again.advice if a.severity == "alarm"]
    np.testing.assert_allclose(diagonals(again.estimate.stiffness)[0], STIFFNESS, rtol=0.05)


def test_axes_and_sign_are_options_too(tmp_path: Path):
    log = recording_of_a_spring(seconds=2.0, noise=0.2)
    flipped = raw(log.noted(wrench=-log.wrench), tmp_path / "log.npz")
    frame = check_frame(read(flipped))
    options = frame_options(frame, Layout())
    assert options is not None
    words = options.split()
    mended = Layout(
        wrench_axes=words[words.index("--wrench-axes") + 1] if "--wrench-axes" in words else "world",
        wrench_sign=-1 if "--wrench-sign" in words else 1,
        sensor_rotation=np.reshape(
            [float(x) for x in words[words.index("--sensor-rotation") + 1 :][:9]], (3, 3)
        ),  # type: ignore[arg-type]
    )
    assert not check_frame(read(flipped, mended)).suspicious


# --- what cannot be fitted -----------------------------------------------------------------------------------


def test_a_log_that_is_inertia_only_is_told():
    """A free mass led by hand: whatever the hand's gains are, its force is mass times acceleration."""
    time = np.arange(0.0, 4.0, 2e-3)
    speed = 2 * np.pi * np.linspace(0.5, 1.5, 6)
    phase = speed * time[:, None]
    error, rate = 0.02 * np.sin(phase), 0.02 * speed * np.cos(phase)
    told = {}
    for name, wrench in (("led", -4.0 * speed**2 * error), ("damped", 30.0 * rate + 50.0 * error)):
        found = fit_recordings([Recording.from_errors(time, error, rate, wrench)], FitSettings(knots=0.5))
        told[name] = [str(a) for a in found.advice if "mass times" in a.text]
    assert len(told["led"]) == 1
    assert "100 % of the force" in told["led"][0]
    assert not told["damped"]


def test_settings_are_checked():
    for wrong in (
        {"knots": 0.0},
        {"window": 2},
        {"step": 0},
        {"mass": -1.0},
        {"inertia": (1.0, -1.0, 1.0)},
        {"between": (2.0, 1.0)},
        {"method": "wavelets"},
        {"method": "windows", "bias": True},
        {"smoothing": np.nan},
    ):
        with pytest.raises(InputError):
            fit_logs([], FitSettings(**wrong))  # type: ignore[arg-type]


def test_logs_that_do_not_go_together(tmp_path: Path):
    one, two = guided(tmp_path / "one.npz", seconds=1.0), guided(tmp_path / "two.npz", seconds=1.0, seed=1)
    with pytest.raises(InputError, match="windows are fitted to one log"):
        fit_logs([one, two], FitSettings(method="windows"), layout=LAYOUT)
    (tmp_path / "copy.npz").write_bytes(one.read_bytes())
    with pytest.raises(InputError, match="same bytes"):
        fit_logs([one, tmp_path / "copy.npz"], layout=LAYOUT)
    other = tmp_path / "other.npz"
    columns = dict(np.load(two))
    np.savez(other, **{k: v for k, v in columns.items() if not k.startswith("quat")})
    with pytest.raises(InputError, match="no orientation.*inspect FILE --layout"):
        fit_logs([one, other], layout=LAYOUT)
    np.savez(other, **{("force" if k == "wrench" else f"a_{k}"): v for k, v in columns.items()})
    with pytest.raises(InputError, match=r"other\.npz.*inspect FILE --layout"):
        fit_logs([one, other], layout=replace(LAYOUT, columns={"wrench": ("wrench",)}))
    with pytest.raises(InputError, match="no log was given"):
        fit_logs([])
    with pytest.raises(FileError, match="cannot be opened"):
        fit_logs([tmp_path / "none.csv"])


def test_a_clock_in_milliseconds_is_refused(tmp_path: Path):
    log = recording_of_a_spring(seconds=1.0)
    slow = raw(log.noted(time=1e3 * log.time), tmp_path / "log.npz")
    with pytest.raises(InputError, match=r"milliseconds.*--units time=ms"):
        fit_logs([slow], layout=LAYOUT)
    fit = fit_logs([slow], CONSTANT, layout=replace(LAYOUT, units={"time": "ms"}))
    np.testing.assert_allclose(diagonals(fit.estimate.damping)[0, 0], DAMPING[0], rtol=0.05)


def test_a_log_with_errors_is_refused_with_the_option_that_mends_it():
    log = recording_of_a_spring(seconds=1.0)
    time = log.time.copy()
    time[70] = 0.0
    with pytest.raises(InputError, match=r"runs backwards.*--repair"):
        fit_recordings([log.noted(time=time)])


def test_free_motion_has_no_gains(tmp_path: Path):
    log = diagonal(duration=2.0).recording
    rng = np.random.default_rng(0)
    free = recorded(log.time, log.error, log.error_rate, 0.1 * rng.normal(size=log.wrench.shape))
    fit = fit_recordings([free])
    assert not fit.determined
    assert "No gain is determined" in " ".join(verdict(fit, axis_summaries(fit)))
    assert "Was there contact?" in warned(fit)
    write_fit(fit, tmp_path / "out")
    assert "No gain is determined" in (tmp_path / "out" / "report.html").read_text()
    assert not GainTable.read(tmp_path / "out" / "gains.csv").stiffness_observable.any()


# --- the folder ----------------------------------------------------------------------------------------------


def test_the_folder_holds_everything(folder: Path, partly: Fit):
    assert {path.name for path in folder.iterdir()} == FILES.keys()
    again = GainEstimate.load(folder / "estimate.npz")
    np.testing.assert_array_equal(again.stiffness, partly.estimate.stiffness)
    page = (folder / "report.html").read_text()
    assert page.count("<figure>") == 5
    assert "http" not in re.sub(r'"data:[^"]*"', "", page)  # needs nothing else
    assert all(f"K_{axis}" in page for axis in ("x", "y", "rz"))
    assert sorted(path.name for path in folder.parent.iterdir()) == ["out"]


def test_the_table_is_read_back(folder: Path, partly: Fit):
    table, estimate = GainTable.read(folder / "gains.csv"), partly.estimate
    for name in GainTable.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(table, name), getattr(estimate, name), err_msg=name)
    head, first, *_ = (folder / "gains.csv").read_text().splitlines()
    assert head.startswith("time [s],K_x [N/m],K_y [N/m],K_z [N/m],K_rx [Nm/rad]")
    assert "sd B_rz [Nms/rad]" in head
    cells = dict(zip(head.split(","), first.split(","), strict=True))
    assert (cells["K_z [N/m]"], cells["sd K_z [N/m]"], cells["K_z observable"]) == ("", "", "0")
    assert cells["K_x observable"] == "1"


@given(st.integers(0, 2**32 - 1), st.integers(0, 5), st.booleans())
def test_every_table_is_read_back(seed: int, rows: int, coupled: bool):
    rng = np.random.default_rng(seed)
    matrices: dict[str, Any] = {}
    for name in ("stiffness", "damping", "stiffness_sd", "damping_sd"):
        values = rng.normal(size=(rows, 6, 6)) * 10.0 ** rng.integers(-300, 300, (rows, 6, 6))
        values = np.where(rng.uniform(size=values.shape) < 0.2, np.nan, values)
        values = np.triu(values) + np.swapaxes(np.triu(values, 1), 1, 2)
        matrices[name] = values if coupled else np.where(np.eye(6, dtype=bool), values, 0.0)
    flags: dict[str, Any] = {
        f"{name}_observable": rng.uniform(size=(rows, 6)) < 0.5 for name in ("stiffness", "damping")
    }
    table = GainTable(rng.normal(size=rows), **matrices, **flags)
    with tempfile.TemporaryDirectory() as place:
        table.write(Path(place) / "gains.csv")
        again = GainTable.read(Path(place) / "gains.csv")
    for name in GainTable.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(table, name), err_msg=name)


def test_full_matrices_have_their_upper_triangle(tmp_path: Path):
    fit = fit_recordings([full(duration=1.5).recording], FitSettings(structure="full", constant=True))
    GainTable.of(fit.estimate).write(tmp_path / "gains.csv")
    head = (tmp_path / "gains.csv").read_text().splitlines()[0].split(",")
    assert [h for h in head if h.startswith("K_x")][:4] == [
        "K_x [N/m]", "K_x_y [N/m]", "K_x_z [N/m]", "K_x_rx [N/rad]",
    ]  # fmt: skip
    assert len(head) == 1 + 4 * 21 + 12
    np.testing.assert_array_equal(GainTable.read(tmp_path / "gains.csv").damping, fit.estimate.damping)


@pytest.mark.parametrize("text", ["", "a,b\n1,2\n", "time [s]\n1\n", "time [s],K_x [N/m]\n1\n", "\0\n"])
def test_what_is_no_table_is_refused(text: str, tmp_path: Path):
    (tmp_path / "gains.csv").write_text(text)
    with pytest.raises(FileError):
        GainTable.read(tmp_path / "gains.csv")


def test_the_json_says_where_the_numbers_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fit_report, "_figures", lambda *_: [])
    log, rest = guided(tmp_path / "log.npz", seconds=2.0), at_rest(tmp_path / "rest.npz")
    fit = fit_logs([log], replace(CONSTANT, bias=True), layout=LAYOUT, calibration=rest)
    write_fit(fit, tmp_path / "out")
    told = json.loads((tmp_path / "out" / "fit.json").read_text(), parse_constant=pytest.fail)
    assert told["inputs"][0]["sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert told["settings"]["constant"] is True
    assert told["layout"]["wrench_axes"] == "tool"
    assert told["payload"]["mass"] == pytest.approx(TOOL.mass)
    assert told["axes"]["x"]["stiffness"]["mean"] == fit.estimate.stiffness[0, 0, 0]
    assert np.shape(told["parameters"]["bias"]) == (1, 6)
    write_fit(fit, tmp_path / "again")
    for name in ("gains.csv", "fit.json"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "out" / name).read_bytes()


def test_a_foreign_folder_is_left_alone(partly: Fit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(fit_report, "_figures", lambda *_: [])
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").write_text("years")
    for overwrite in (False, True):
        with pytest.raises(FileError, match=r"not empty \(thesis.tex\)"):
            write_fit(partly, tmp_path / "mine", overwrite=overwrite)
    (tmp_path / "empty").mkdir()
    write_fit(partly, tmp_path / "empty")
    with pytest.raises(FileError, match="--overwrite"):
        write_fit(partly, tmp_path / "empty")
    write_fit(partly, tmp_path / "empty", overwrite=True)
    with pytest.raises(FileError, match="is a file"):
        write_fit(partly, tmp_path / "mine" / "thesis.tex")
    assert {path.name for path in tmp_path.iterdir()} == {"mine", "empty"}
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


def _write(path: Path, text: str, then: Callable[[], object]) -> None:
    """Write a folder; `then` happens before it is in place."""
    with new_folder(path, marker="fit.json", what="fit", overwrite=True) as folder:
        (folder / "fit.json").write_text(text)
        if isinstance(ended := then(), BaseException):
            raise ended


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError, FileError])
def test_a_folder_appears_whole_or_not_at_all(error: type[BaseException], tmp_path: Path):
    old = tmp_path / "old"
    old.mkdir()
    (old / "fit.json").write_text("{}")
    for path in (tmp_path / "new", old):
        with pytest.raises(error):
            _write(path, "half", error)
    assert [path.name for path in tmp_path.iterdir()] == ["old"]
    assert (old / "fit.json").read_text() == "{}"


def test_a_folder_that_filled_up_meanwhile_is_left_alone(tmp_path: Path):
    def meanwhile() -> None:
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "other").write_text("")

    with pytest.raises(FileError, match="not empty"):
        _write(tmp_path / "out", "{}", meanwhile)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["other"]


# --- words and what follows ----------------------------------------------------------------------------------


def test_numbers_have_the_digits_that_their_deviation_leaves():
    assert plus_minus(117.34, 3.2) == "117 ± 3"
    assert plus_minus(117.34, 0.16) == "117.34 ± 0.16"
    assert plus_minus(-1234.0, 120.0) == "−1230 ± 120"
    assert plus_minus(np.nan, 1.0) == "–"
    assert plus_minus(5.0, np.inf) == "5"
    assert plus_minus(600.0, 0.0) == "600 ± 0"
    assert rounded(0.00312, 0.0004) == "0.0031"


def test_the_verdict_says_what_is_not_determined(partly: Fit):
    text = verdict(partly, axis_summaries(partly))
    assert re.search(r"K_x \d{3}\.\d ± \d", text[0])
    assert text[0].endswith("not determined, or hardly ever: z.")
    (number,) = in_one_number(partly, axis_summaries(partly))
    assert "K_z" not in text[0] + number
    (constant,) = [a.constant for a in axis_summaries(partly) if a.axis == "x"]
    assert constant[0] == pytest.approx(600, rel=0.02)


def test_the_next_steps_run(folder: Path, partly: Fit):
    (code,) = [line for line, _ in next_steps(partly, folder) if "GainEstimate" in line]
    names: dict[str, object] = {}
    exec(code, names)
    schedule = names["schedule"]
    assert isinstance(schedule, ImpedanceGains)
    assert schedule.batch_shape == partly.estimate.time.shape


def test_fitted_gains_drive_the_law():
    estimate = fit_recordings([diagonal(duration=2.0).recording]).estimate
    arm = load_robot("fanuc_lrmate200id7l")
    law, here = CartesianLaw(model=arm), Reference(arm.pose(arm.home))
    spare = ImpedanceGains.diagonal([400.0] * 3 + [30.0] * 3, [60.0] * 3 + [5.0] * 3)

    def controller(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        return law.impedance(q, v, reference=here, gains=estimate.to_gains(t, fallback=spare)).torque

    push = [0.0, 0.0, 10.0, 0.0, 0.0, 0.0]
    motion = simulate(
        arm, controller, q=arm.home, duration=1.0, timestep=4e-3, external_wrench=lambda *_: push
    )
    stiffness = estimate.to_gains(1.0, fallback=spare).stiffness_diagonal[2]
    assert motion.error(here)[0][-1, 2] == pytest.approx(-10.0 / stiffness, rel=0.3)


# --- a real arm ----------------------------------------------------------------------------------------------

real = pytest.mark.skipif(not KUKA.is_dir(), reason="the recordings of the KUKA are not here")
AS_PUBLISHED = FitSettings(constant=True, bias=True, contact=2.0)


@real
@pytest.mark.parametrize(
    ("name", "stiffness"), [("circle", (117, 123, 137)), ("linear_table", (106, 88, 142))]
)
def test_real_contact(name: str, stiffness: tuple[float, float, float]):
    fit = fit_logs([KUKA / f"{name}.txt"], AS_PUBLISHED, layout=TURNED)
    np.testing.assert_allclose(diagonals(fit.estimate.stiffness)[0, :3], stiffness, rtol=0.1)
    assert not [a for a in fit.advice if a.severity == "alarm"]
    # whatever the settings, the constants for comparison are the same
    axes = axis_summaries(fit_logs([KUKA / f"{name}.txt"], layout=TURNED))
    np.testing.assert_allclose([a.constant[0] for a in axes[:3]], stiffness, rtol=0.1)


@real
def test_real_free_motion_has_no_gains():
    fit = fit_logs([KUKA / "free.txt"], layout=TURNED)
    assert not fit.determined
    assert "Was there contact?" in warned(fit)


@real
@pytest.mark.parametrize("name", ["circle", "linear_table"])
def test_the_real_frame_trap_is_noticed(name: str):
    fit = fit_logs([KUKA / f"{name}.txt"])
    assert fit.advice[0].severity == "alarm"
    assert "--sensor-rotation 0 1 0 -1 0 0 0 0 1" in fit.advice[0].remedy
