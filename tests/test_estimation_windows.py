"""Windows: exact without noise, at the bound with it, equal to CasADi, constrained where asked, silent where blind."""

from __future__ import annotations

import importlib.util
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import nnls

from tests.gain_data import NOISE, clock, diagonal, diagonals, recorded, rich_motion
from vic_toolbox.errors import DependencyError, InputError
from vic_toolbox.estimation import FitError, fit_smooth, fit_windows
from vic_toolbox.estimation.cones import clarabel_installed, solve_cones
from vic_toolbox.estimation.nonnegative import nonnegative, nonnegative_casadi
from vic_toolbox.estimation.windows_diagonal import window_sum
from vic_toolbox.estimation.windows_full import duplication, matrices, symmetric_index
from vic_toolbox.recordings import Recording

CONE_SOLVERS = [
    pytest.param("clarabel", marks=pytest.mark.skipif(not clarabel_installed(), reason="needs [lmi]")),
    "casadi",
]


def test_exact_without_noise():
    """Case A1: ten samples give constant gains to 1e-8."""
    data = diagonal(profile="constant", noise=0.0)
    found = fit_windows(data.recording, 10)
    assert found.observable.all()
    np.testing.assert_allclose(diagonals(found.stiffness), data.stiffness[:9991], rtol=1e-8)
    np.testing.assert_allclose(diagonals(found.damping), data.damping[:9991], rtol=1e-8)


def test_negative_gains_give_exactly_zero():
    """Case A3: data of K = −200, B = 30 fit best, among the non-negative, with K = 0 and B = Σvf / Σv²."""
    t = clock(1.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    f = -200 * e + 30 * v
    found = fit_windows(recorded(t, e, v, f), len(t), constraint="positive")
    assert (diagonals(found.stiffness) == 0).all()
    np.testing.assert_allclose(diagonals(found.damping)[0], np.sum(v * f, 0) / np.sum(v * v, 0), rtol=1e-12)


@pytest.mark.parametrize("solver", CONE_SOLVERS)
def test_constrain_do_not_project(solver: str):
    """Case A3b: the best PSD stiffness is not the projection of the unconstrained one."""
    t, e = clock(0.04), np.zeros((40, 6))
    e[::2, 0], e[1::2, 1] = 0.02, 0.002
    true = np.array([[300.0, 400.0], [400.0, 300.0]])
    f = np.zeros((40, 6))
    f[:, :2] = e[:, :2] @ true
    found = fit_windows(
        recorded(t, e, np.zeros_like(e), f), 40, structure="full", constraint="spd", solver=solver
    )
    stiffness = found.stiffness[0, :2, :2]
    np.testing.assert_allclose(stiffness, [[303.6, 394.5], [394.5, 512.7]], atol=0.05)
    assert np.linalg.norm(found.residuals[:2]) == pytest.approx(0.445, abs=5e-4)
    values, vectors = np.linalg.eigh(true)
    projected = (vectors * np.maximum(values, 0)) @ vectors.T
    assert np.linalg.norm(e[:2, :2] @ (projected - true)) == pytest.approx(1.421, abs=5e-4)
    assert found.stiffness_observable[0].tolist() == [True, True, False, False, False, False]
    assert not found.damping_observable.any()
    assert np.isnan(found.damping).all()
    assert np.isnan(found.stiffness[0, 2:]).all()


@pytest.mark.parametrize(("amplitude", "deviation"), [(0.01, 0.89), (0.001, 8.9), (0.0001, 89)])
def test_deviation_grows_as_the_motion_shrinks(amplitude: float, deviation: float):
    """Case A4: 1 s of 1 Hz at 1 kHz."""
    t = clock(1.0)[:, None]
    turn = 2 * np.pi * t * np.ones(6)
    e, v = amplitude * np.sin(turn), amplitude * 2 * np.pi * np.cos(turn)
    noise = 0.2 * np.random.default_rng(1).normal(size=e.shape)
    found = fit_windows(recorded(t[:, 0], e, v, 600 * e + 30 * v + noise), 1000, noise=np.full(6, 0.2))
    seen = found.stiffness_observable[0]
    assert seen.any()
    assert diagonals(found.stiffness_sd)[0, seen] == pytest.approx(deviation, rel=0.01)


def test_no_motion_is_flagged():
    """Case A4, last line: never a number."""
    t = clock(1.0)
    still = np.zeros((1000, 6))
    noise = 0.2 * np.random.default_rng(1).normal(size=still.shape)
    for structure in ("diagonal", "damping_factor", "full"):
        found = fit_windows(recorded(t, still, still, noise), 100, structure=structure, step=100)
        assert not found.observable.any()
        assert np.isnan(diagonals(found.stiffness)).all()
        assert np.isnan(diagonals(found.damping_sd)).all()
        assert np.isinf(found.condition).all()
        assert "x" in found.warnings[0]


def test_wrench_of_zeros_is_flagged():
    t = clock(1.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    found = fit_windows(recorded(t, e, v, np.zeros_like(e)), 10)
    assert not found.observable.any()


def test_at_the_cramer_rao_bound():
    """Window least squares attains the bound, and the bound of ten samples is poor."""
    t = clock(2.0)
    e, v = rich_motion(t, np.random.default_rng(3))
    k = np.array([600.0, 900, 400, 30, 40, 20])
    b = 1.4 * np.sqrt(k)
    rng = np.random.default_rng(4)
    a, s, c = (window_sum(x, 10, 10, 200) for x in (e * e, e * v, v * v))
    bound = NOISE * np.sqrt(c / (a * c - s * s))
    errors = []
    for _ in range(40):
        wrench = k * e + b * v + NOISE * rng.normal(size=e.shape)
        found = fit_windows(recorded(t, e, v, wrench), 10, step=10)
        errors.append(np.where(found.stiffness_observable, diagonals(found.stiffness) - k, np.nan))
    seen = np.isfinite(errors).all(axis=0)
    ratio = np.sqrt(np.mean(np.square(errors), axis=0))[seen] / bound[seen]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.05)


@pytest.mark.parametrize("constraint", ["none", "positive"])
def test_closed_form_equals_casadi(constraint: str):
    data = diagonal(1, duration=1.0)
    closed, program = (
        fit_windows(data.recording, 10, constraint=constraint, solver=solver)
        for solver in ("closed_form", "casadi")
    )
    for name in ("stiffness", "damping"):
        np.testing.assert_allclose(getattr(closed, name), getattr(program, name), rtol=1e-5, atol=1e-4)


def test_tied_damping_is_exact_without_noise_and_equals_casadi():
    t = clock(0.6)
    e, v = rich_motion(t, np.random.default_rng(0))
    k = np.array([600.0, 900, 400, 30, 40, 20])
    b = np.repeat([3.0, 0.4], 3) * np.sqrt(k)
    exact = fit_windows(recorded(t, e, v, k * e + b * v), 100, structure="damping_factor", step=50)
    np.testing.assert_allclose(diagonals(exact.stiffness), np.tile(k, (11, 1)), rtol=1e-6)
    np.testing.assert_allclose(diagonals(exact.damping), np.tile(b, (11, 1)), rtol=1e-6)
    noisy = recorded(t, e, v, k * e + b * v, noise=1.0)
    one, two = (
        fit_windows(noisy, 100, structure="damping_factor", step=100, solver=solver)
        for solver in ("closed_form", "casadi")
    )
    np.testing.assert_allclose(one.stiffness, two.stiffness, rtol=1e-4)
    # tying makes the damping surer than a free fit is
    free = fit_windows(noisy, 100, step=100)
    assert (diagonals(one.damping_sd) < diagonals(free.damping_sd)).all()


def test_full_windows_are_exact_and_need_rich_motion():
    t = clock(2.0)
    e, v = rich_motion(t, np.random.default_rng(5))
    rng = np.random.default_rng(6)
    k, b = (x @ x.T + np.eye(6) for x in rng.normal(size=(2, 6, 6)))
    data = recorded(t, e, v, e @ k + v @ b)
    found = fit_windows(data, 1000, structure="full", step=500)
    np.testing.assert_allclose(found.stiffness, np.broadcast_to(k, (3, 6, 6)), rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found.damping, np.broadcast_to(b, (3, 6, 6)), rtol=1e-7, atol=1e-7)
    short = fit_windows(data, 10, structure="full", step=500)
    assert not short.observable.any()
    rows = [np.einsum("rik,i->rk", duplication(), np.r_[e[n] / e.std(0), v[n] / v.std(0)]) for n in range(10)]
    size = np.linalg.svd(np.concatenate(rows), compute_uv=False)
    assert np.sum(size > 3e-10 * size[0]) == 30, "ten samples have rank 30 of 42"


@pytest.mark.parametrize("solver", CONE_SOLVERS)
def test_full_spd_windows_are_spd(solver: str):
    t = clock(1.0)
    e, v = rich_motion(t, np.random.default_rng(7))
    k, b = np.diag([800.0, 800, 300, 20, 30, 20]), np.diag([30.0, 30, 30, 1, 1, 1])
    k[0, 1] = k[1, 0] = 799.0
    data = recorded(t, e, v, e @ k + v @ b, noise=3.0, rng=np.random.default_rng(9))
    free = fit_windows(data, 500, structure="full", step=50)
    found = fit_windows(data, 500, structure="full", constraint="spd", solver=solver, step=50)
    assert found.method.endswith(solver)
    seen = found.stiffness_observable[:, :2].all(axis=1)
    smallest = [np.linalg.eigvalsh(fit.stiffness[seen, :2, :2])[:, 0] for fit in (free, found)]
    assert smallest[0].min() < -1
    assert smallest[1].min() > -1e-6
    assert np.abs(found.stiffness - free.stiffness)[seen, :2, :2].max() > 1


def spd_problem(seed: int, blocks: int = 2) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    n = 21 * blocks
    root = rng.normal(size=(n, n + 5))
    return root @ root.T / n, rng.normal(size=n)


@pytest.mark.skipif(not clarabel_installed(), reason="needs [lmi]")
@pytest.mark.parametrize("seed", range(3))
def test_casadi_equals_clarabel(seed: int):
    p, q = spd_problem(seed)
    one, two = (solve_cones(p, q, solver=solver) for solver in ("clarabel", "casadi"))
    np.testing.assert_allclose(one, two, atol=2e-4 * np.abs(one).max())


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15, deadline=None)
def test_cone_solution_meets_its_conditions(seed: int):
    """θ in the cone, gradient in the dual cone, and at a right angle to each other."""
    p, q = spd_problem(seed, blocks=1)
    theta = solve_cones(p, q, solver="clarabel" if clarabel_installed() else "casadi")
    rows, columns = symmetric_index()
    gradient = (p @ theta - q) * np.where(rows == columns, 1.0, 0.5)
    size = np.abs(theta).max()
    matrix, dual = (matrices(np.tile(x, 2))[0] for x in (theta, gradient))
    assert np.linalg.eigvalsh(matrix)[0] > -1e-5 * size
    assert np.linalg.eigvalsh(dual)[0] > -1e-4
    assert abs(np.sum(matrix * dual)) < 1e-4


@given(
    e=arrays(float, (12, 6), elements=st.floats(-1, 1).map(lambda x: round(x, 6))),
    v=arrays(float, (12, 6), elements=st.floats(-1, 1).map(lambda x: round(x, 6))),
    f=arrays(float, (12, 6), elements=st.floats(-10, 10)),
)
@settings(max_examples=40, deadline=None)
def test_non_negative_window_is_the_best(e: np.ndarray, v: np.ndarray, f: np.ndarray):
    """No other non-negative pair leaves less, by Lawson and Hanson's algorithm."""
    from vic_toolbox.estimation.samples import Samples
    from vic_toolbox.estimation.windows_diagonal import diagonal_windows

    found = diagonal_windows(Samples(np.arange(12.0), e, v, f), 12, positive=True)
    for i in range(6):
        columns = np.stack([e[:, i], v[:, i]], axis=1)
        gains = np.nan_to_num(np.array([found.stiffness[0, i], found.damping[0, i]]))
        if not np.isfinite(found.stiffness[0, i] + found.damping[0, i]):
            continue  # flagged
        assert (gains >= 0).all()
        left = np.linalg.norm(columns @ gains - f[:, i])
        assert left <= nnls(columns, f[:, i])[1] * (1 + 1e-6) + 1e-6


@given(seed=st.integers(0, 10**6), size=st.integers(1, 30))
@settings(max_examples=25, deadline=None)
def test_projected_newton_solves_the_bounded_problem(seed: int, size: int):
    """Against Lawson and Hanson, and against CasADi."""
    from scipy import sparse

    rng = np.random.default_rng(seed)
    a, y = rng.normal(size=(size + 3, size)), rng.normal(size=size + 3)
    h, b = sparse.csc_matrix(a.T @ a), a.T @ y
    everything = np.ones(size, bool)
    x = nonnegative(h, b, everything)
    np.testing.assert_allclose(x, nnls(a, y)[0], atol=1e-6 * max(1.0, np.abs(x).max()))
    try:
        other = nonnegative_casadi(h, b, everything)
    except FitError:  # `qrqp` gives up now and then, and has to say so
        return
    np.testing.assert_allclose(x, other, atol=1e-3 * max(1.0, np.abs(x).max()))


def test_casadi_is_not_believed_blindly():
    """Here `qrqp` reports success at a point that is infeasible."""
    from scipy import sparse

    rng = np.random.default_rng(32768)
    a, y = rng.normal(size=(29, 26)), rng.normal(size=29)
    h, b, everything = sparse.csc_matrix(a.T @ a), a.T @ y, np.ones(26, bool)
    np.testing.assert_allclose(nonnegative(h, b, everything), nnls(a, y)[0], atol=1e-6)
    with pytest.raises(FitError, match="closed_form"):
        nonnegative_casadi(h, b, everything)


def test_hard_steps_on_fine_knots_are_solved():
    """Gains that jump make the free fit ring below zero at many control points."""
    t = clock(4.0)
    e, v = rich_motion(t, np.random.default_rng(54))
    k = np.where(t < 1.2, 1.0, np.where(t < 2.4, 0.1, 1.1))[:, None] * np.array([600.0, 900, 400, 30, 40, 20])
    data = recorded(t, e, v, k * e + 0.02 * k * v, noise=1.0)
    for knots in (0.05, 0.02):
        found = fit_smooth(data, knots)
        known = diagonals(found.stiffness)[found.stiffness_observable]
        assert (known > 0).all()


def test_a_pure_damper_has_no_stiffness():
    """K = 0 lies on the bound throughout; it is known to be small, not unknown."""
    t = clock(3.0)
    e, v = rich_motion(t, np.random.default_rng(1))
    found = fit_smooth(recorded(t, e, v, 30 * v, noise=1.0))
    known = diagonals(found.stiffness)[found.stiffness_observable]
    assert known.size > 100
    assert 0 <= known.min() <= known.max() < 10
    np.testing.assert_allclose(np.nanmedian(diagonals(found.damping), axis=0), 30, rtol=0.02)


def test_noise_is_no_stiffness():
    """Rich motion and a wrench of nothing but noise: a small gain is found by chance, and not shown."""
    t = clock(3.0)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        e, v = rich_motion(t, rng)
        data = recorded(t, e, v, np.zeros_like(e), noise=1.0, rng=rng)
        assert not fit_smooth(data, None).observable.any()
        assert not fit_windows(data, 100, step=50).observable.any()


@given(scale=st.floats(1e-3, 1e3), shift=st.floats(-1e4, 1e4))
@settings(max_examples=20, deadline=None)
def test_units_and_clock_do_not_matter(scale: float, shift: float):
    data = diagonal(2, duration=0.2).recording
    one = fit_windows(data, 50, step=50, constraint="positive")
    two = fit_windows(
        Recording.from_errors(data.time + shift, data.error, data.error_rate, scale * data.wrench),
        50,
        step=50,
        constraint="positive",
    )
    np.testing.assert_allclose(two.stiffness, scale * one.stiffness, rtol=1e-7, atol=1e-9 * scale)
    np.testing.assert_allclose(two.stiffness_sd, scale * one.stiffness_sd, rtol=1e-7)
    np.testing.assert_allclose(two.time - shift, one.time, atol=1e-9)
    assert (one.observable == two.observable).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 2}, "window"),
        ({"window": 10**6}, "shorten"),
        ({"window": 10.0}, "integer"),
        ({"structure": "diag"}, "choose one of: diagonal, full"),
        ({"constraint": "psd"}, "choose one of: none, positive, spd"),
        ({"solver": "ipopt"}, "choose one of: auto"),
        ({"structure": "full", "constraint": "positive"}, "'spd'"),
        ({"structure": "full", "constraint": "spd", "solver": "closed_form"}, "clarabel"),
        ({"solver": "clarabel"}, "closed_form"),
        ({"structure": "full", "solver": "casadi"}, "closed form"),
        ({"noise": [1, 1]}, "noise"),
        ({"noise": [0.0] * 6}, "greater than zero"),
        ({"step": 0}, "step"),
    ],
)
def test_bad_options(options: dict, message: str):
    with pytest.raises(InputError, match=message):
        fit_windows(diagonal(duration=0.1).recording, **options)


def test_bad_recordings():
    with pytest.raises(InputError, match="not a recording"):
        fit_windows(np.zeros((10, 6)))  # type: ignore[arg-type]
    data = diagonal(duration=0.1).recording

    class Backwards:
        time, error, error_rate, wrench = data.time[::-1], data.error, data.error_rate, data.wrench

    with pytest.raises(InputError, match="sort"):
        fit_windows(Backwards())  # type: ignore[arg-type]


def test_without_clarabel_the_message_helps(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    p, q = spd_problem(0)
    with pytest.raises(DependencyError, match="lmi"):
        solve_cones(p, q, solver="clarabel")


def test_import_is_light():
    """Neither CasADi nor Clarabel nor matplotlib is loaded before it is needed."""
    code = "import vic_toolbox.estimation, sys; print(*{'casadi','clarabel','matplotlib','sklearn'} & set(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert loaded.split() == []
