"""The result: gains with gaps for the law, whole files, pictures; and the interface of scikit-learn."""

from __future__ import annotations

import importlib.util
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from tests.gain_data import clock, diagonal, diagonals, recorded, rich_motion
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.estimation import GainEstimate, ImpedanceRegressor, fit_smooth, fit_windows
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.recordings import read

PLACES = [folder / "shared" / "recordings" / "kuka_iiwa" for folder in Path(__file__).parents]
KUKA = next((place for place in PLACES if place.is_dir()), PLACES[0])
MOUNTING = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
SPARE = ImpedanceGains.diagonal([100.0] * 6, [10.0] * 6)


@pytest.fixture(scope="module")
def partly() -> GainEstimate:
    """x to rz move, but for z; y rests in the second half."""
    t = clock(4.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    e[:, 2], v[:, 2] = 0, 0
    e[t > 2, 1], v[t > 2, 1] = 0, 0
    return fit_smooth(recorded(t, e, v, 600 * e + 40 * v, noise=1.0), bias=True)


def test_unknown_axes_are_refused_or_filled(partly: GainEstimate):
    with pytest.raises(InputError, match=r"stiffness along y, z \(first at t = 1 s\)"):
        partly.to_gains([1.0, 3.0], fallback=None)
    gains = partly.to_gains([1.0, 3.0], fallback=SPARE)
    np.testing.assert_allclose(gains.stiffness_diagonal[:, 2], 100)
    np.testing.assert_allclose(gains.stiffness_diagonal[1, 1], 100)
    np.testing.assert_allclose(gains.stiffness_diagonal[0, 1], 600, rtol=0.1)
    np.testing.assert_allclose(gains.damping_diagonal[0, 0], 40, rtol=0.1)
    assert partly.to_gains(1.0, fallback=SPARE).batch_shape == ()
    with pytest.raises(InputError, match="t"):
        partly.to_gains([np.nan], fallback=SPARE)


def test_gains_are_held_outside(partly: GainEstimate):
    ends = partly.to_gains([-5.0, partly.time[0]], fallback=SPARE)
    np.testing.assert_allclose(ends.stiffness[0], ends.stiffness[1])


def test_files_are_whole(partly: GainEstimate, tmp_path: Path):
    path = tmp_path / "fit.npz"
    partly.save(path)
    again = GainEstimate.load(path)
    for field in fields(GainEstimate):
        if field.name == "parameters":
            continue
        np.testing.assert_array_equal(getattr(again, field.name), getattr(partly, field.name), strict=False)
    assert again.parameters.keys() == partly.parameters.keys()
    np.testing.assert_array_equal(again.parameters["bias"], partly.parameters["bias"])
    assert [p.name for p in tmp_path.iterdir()] == ["fit.npz"]


def test_damaged_files_are_refused(partly: GainEstimate, tmp_path: Path):
    path = tmp_path / "fit.npz"
    with pytest.raises(FileError):
        GainEstimate.load(path)
    partly.save(path)
    content = path.read_bytes()
    for broken in (b"", b"PK\x03\x04", content[:500], b"\x00" * 100, content[:-200]):
        path.write_bytes(broken)
        with pytest.raises(FileError):
            GainEstimate.load(path)
    np.savez(path, format=1, text=np.frombuffer(b"{}", np.uint8))
    with pytest.raises(FileError):
        GainEstimate.load(path)
    np.savez(path, objects=np.array([{}], dtype=object))
    with pytest.raises(FileError):
        GainEstimate.load(path)
    np.savez(path, format=99)
    with pytest.raises(FileError, match="version"):
        GainEstimate.load(path)


def test_picture(partly: GainEstimate):
    figure = partly.plot()
    assert len(figure.axes) == 12
    text = [t.get_text() for axis in figure.axes for t in axis.texts]
    assert text == ["not determined"] * 2
    assert len(fit_windows(diagonal(duration=0.02).recording, 20).plot().axes) == 12


def columns(duration: float = 2.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    data = diagonal(0, duration=duration, profile="constant").recording
    return data.time, np.concatenate([data.error, data.error_rate], axis=1), data.wrench


def test_regressor_predicts():
    t, x, y = columns()
    model = ImpedanceRegressor().fit(x, y)
    assert model.score(x, y) > 0.99
    assert model.predict(x[:3]).shape == (3, 6)
    np.testing.assert_allclose(
        diagonals(model.estimate_.stiffness)[0], [600, 900, 400, 30, 40, 20], rtol=0.02
    )
    shuffled = np.random.default_rng(0).permutation(len(t))
    timed = np.column_stack([t, x])
    changing = ImpedanceRegressor(knots=0.2).fit(timed[shuffled], y[shuffled])
    assert changing.score(timed, y) > 0.99


def test_regressor_says_what_is_wrong():
    _, x, y = columns(0.5)
    with pytest.raises(ValueError, match="fit"):
        ImpedanceRegressor().predict(x)
    with pytest.raises(InputError, match="X"):
        ImpedanceRegressor().fit(x[:, :5], y)
    with pytest.raises(InputError, match="y"):
        ImpedanceRegressor().fit(x, y[:-1])
    with pytest.raises(InputError, match="X"):
        ImpedanceRegressor().fit(np.where(x == x[0, 0], np.nan, x), y)
    with pytest.raises(InputError, match="no parameter"):
        ImpedanceRegressor().set_params(knot=1)


def test_regressor_keeps_scikit_learn_s_rules():
    model = ImpedanceRegressor(knots=0.5, robust=True)
    twin = ImpedanceRegressor(**model.get_params())
    assert twin.get_params() == model.get_params()
    assert model.set_params(knots=0.1) is model
    assert model.knots == 0.1
    assert repr(model) == "ImpedanceRegressor(knots=0.1, robust=True)"
    t, x, y = columns(0.5)
    timed = np.column_stack([t, x])
    before = timed.copy(), y.copy(), dict(model.get_params())
    first = model.fit(timed, y).predict(timed)
    second = model.fit(timed, y).predict(timed)
    np.testing.assert_array_equal(first, second)
    np.testing.assert_array_equal(before[0], timed)
    np.testing.assert_array_equal(before[1], y)
    assert before[2] == model.get_params()


needs_sklearn = pytest.mark.skipif(
    importlib.util.find_spec("sklearn") is None, reason="scikit-learn is not installed"
)


@needs_sklearn
@pytest.mark.parametrize("knots", [None, 0.5])
def test_scikit_learn_checks_it(knots: float | None):
    """`check_estimator`: all that fails are the checks that fit X of a few columns, where this one needs twelve."""
    from sklearn.utils.estimator_checks import check_estimator  # pyright: ignore[reportMissingImports]

    results = check_estimator(ImpedanceRegressor(knots=knots), on_fail=None, on_skip=None)
    failed = {r["check_name"]: str(r["exception"]) for r in results if r["status"] == "failed"}
    narrow = {"check_positive_only_tag_during_fit", "check_estimators_nan_inf", "check_fit2d_1sample"}
    for name, message in failed.items():
        assert name in narrow or "feature(s) (shape=" in message, f"{name}: {message}"
    assert sum(r["status"] == "passed" for r in results) >= 20


@needs_sklearn
def test_scikit_learn_searches_over_it():
    from sklearn.base import is_regressor  # pyright: ignore[reportMissingImports]
    from sklearn.exceptions import NotFittedError  # pyright: ignore[reportMissingImports]
    from sklearn.model_selection import GridSearchCV  # pyright: ignore[reportMissingImports]
    from sklearn.pipeline import make_pipeline  # pyright: ignore[reportMissingImports]
    from sklearn.preprocessing import FunctionTransformer  # pyright: ignore[reportMissingImports]
    from sklearn.utils.validation import check_is_fitted  # pyright: ignore[reportMissingImports]

    model = ImpedanceRegressor()
    assert is_regressor(model)
    _, x, y = columns(0.5)
    with pytest.raises(NotFittedError):
        model.predict(x)
    search = GridSearchCV(model, {"robust": [False, True], "bias": [False, True]}, cv=2).fit(x, y)
    check_is_fitted(search.best_estimator_)
    assert search.best_score_ > 0.9
    assert make_pipeline(FunctionTransformer(), model).fit(x, y).score(x, y) > 0.99


# --- real recordings -----------------------------------------------------------------------------------------

real = pytest.mark.skipif(not KUKA.is_dir(), reason="the folder of real recordings is not here")


@real
@pytest.mark.parametrize(
    ("name", "stiffness"), [("circle", (117, 123, 137)), ("linear_table", (106, 88, 142))]
)
def test_stiffness_of_a_real_arm(name: str, stiffness: tuple[float, ...]):
    """Pressed samples of an iiwa, constant gains and a bias; the circle does not show the damping."""
    log = read(KUKA / f"{name}.txt", sensor_rotation=MOUNTING)
    pressed = log.rows(np.linalg.norm(log.wrench[:, :3], axis=1) > 2)
    found = fit_smooth(pressed, None, bias=True)
    np.testing.assert_allclose(diagonals(found.stiffness)[0, :3], stiffness, rtol=0.1)
    assert not found.stiffness_observable[0, 3:].any()
    if name == "circle":
        assert not found.damping_observable[0, :2].any()


@real
@pytest.mark.parametrize("knots", [None, 0.1, 0.5])
@pytest.mark.parametrize("bias", [False, True])
def test_free_motion_has_no_stiffness(knots: float | None, bias: bool):
    """No contact: nothing may be reported, whatever the options."""
    log = read(KUKA / "free.txt", sensor_rotation=MOUNTING)
    assert not fit_smooth(log, knots, bias=bias).stiffness_observable.any()
    assert not fit_windows(log, 10).stiffness_observable.any()
