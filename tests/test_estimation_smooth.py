"""Smooth gains: exact in the spline space, honest bands, constraints everywhere, and what else enters the wrench."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks import estimation_cases
from tests.gain_data import (
    MASS,
    NOISE,
    STIFFNESS,
    biased,
    clock,
    diagonal,
    diagonals,
    full,
    reach,
    recorded,
    relative_rms,
    rich_motion,
    struck,
)
from vic_toolbox.errors import Array, InputError
from vic_toolbox.estimation import GainEstimate, fit_smooth
from vic_toolbox.estimation.cones import clarabel_installed
from vic_toolbox.estimation.differences import log_determinant, squared_differences
from vic_toolbox.estimation.penalised import Problem
from vic_toolbox.estimation.samples import pooled
from vic_toolbox.estimation.selected_inverse import pointwise
from vic_toolbox.estimation.smooth_fit import SmoothModel
from vic_toolbox.estimation.splines import Basis, normal_equations
from vic_toolbox.gains import ImpedanceGains


def truth(found: GainEstimate, gain: Array, rate: float = 1000.0) -> Array:
    return gain[np.clip(np.rint(found.time * rate).astype(int), 0, len(gain) - 1)]


def errors(found: GainEstimate, stiffness: Array, damping: Array) -> tuple[Array, Array]:
    pick = diagonals if stiffness.ndim == 2 else np.asarray
    return pick(found.stiffness) - truth(found, stiffness), pick(found.damping) - truth(found, damping)


# --- the algebra ----------------------------------------------------------------------------------------------


@given(
    seed=st.integers(0, 10**6),
    spacing=st.sampled_from([None, 0.07, 0.3, 0.9]),
    splines=st.integers(1, 3),
    constants=st.integers(0, 2),
)
@settings(max_examples=25, deadline=None)
def test_banded_algebra_equals_dense(seed: int, spacing: float | None, splines: int, constants: int):
    """Solution, determinant, least value and pointwise variances against plain linear algebra."""
    rng = np.random.default_rng(seed)
    n = 300
    t = np.sort(rng.uniform(0, 1, n))
    x, y, z = rng.normal(size=(n, 2, splines)), rng.normal(size=(n, 2)), rng.normal(size=(n, 2, constants))
    weight = rng.uniform(0.5, 2, (n, 2))
    basis = Basis.spaced(0.0, 1.0, spacing)
    problem = Problem.of(normal_equations(basis, t, x=x, y=y, z=z, weight=weight), 1, np.arange(splines))
    logs = rng.uniform(-2, 2, splines)
    m = basis.size
    first, values = basis(t)
    dense = np.zeros((n, m))
    for a in range(values.shape[1]):
        dense[np.arange(n), first + a] += values[:, a]
    np.testing.assert_allclose(dense.sum(axis=1), 1)
    design = np.concatenate([(dense[:, :, None] * x[:, 1, None, :]).reshape(n, -1), z[:, 1]], axis=1)
    bend = np.diff(np.eye(m), 2, axis=0) if m > 2 else np.zeros((0, m))
    penalty = np.zeros((design.shape[1],) * 2)
    for k in range(splines):
        penalty[k : m * splines : splines, k : m * splines : splines] = np.exp(logs[k]) * bend.T @ bend
    h = design.T @ (weight[:, 1:] * design) + penalty
    right = design.T @ (weight[:, 1] * y[:, 1])
    c = np.linalg.solve(h, right)
    found = problem.solve(logs)
    assert found is not None
    np.testing.assert_allclose(np.r_[found.coefficients.ravel(), found.beta], c, rtol=1e-6, atol=1e-7)
    assert found.logdet == pytest.approx(np.linalg.slogdet(h)[1], rel=1e-8)
    assert found.least == pytest.approx(weight[:, 1] @ y[:, 1] ** 2 - right @ c, rel=1e-7)
    np.testing.assert_allclose(problem.matrix(logs).toarray(), h, rtol=1e-9, atol=1e-9 * np.abs(h).max())
    inverse = np.linalg.inv(h)
    variance = pointwise(problem.variances(logs, found), first, values)
    for k in range(splines):
        own = inverse[k : m * splines : splines, k : m * splines : splines]
        np.testing.assert_allclose(variance[:, k], np.einsum("ni,ij,nj->n", dense, own, dense), rtol=1e-6)
    trace = design.shape[1] - np.trace(inverse @ penalty)
    assert problem.effective(logs, found) == pytest.approx(trace, rel=1e-6)


@pytest.mark.parametrize("order", [2, 3])
def test_determinant_of_the_differences(order: int):
    d = np.diff(np.eye(20), order, axis=0)
    assert log_determinant(20, order) == pytest.approx(np.linalg.slogdet(d @ d.T)[1])


@pytest.mark.parametrize(("profile", "order"), [("smooth", 3), ("steps", 2), ("constant", 2)])
def test_the_likelier_order_of_differences_is_taken(profile: str, order: int):
    """Sines are smoother than what second differences expect, steps are rougher than third ones do."""
    parts = pooled(diagonal(5, profile=profile).recording)
    model = SmoothModel(Basis.spaced(0.0, parts[0].time[-1], 0.1), parts, bias=False)
    assert [problem.order for problem in model.fit(noise=None).problems] == [order] * 6


def test_straight_lines_cost_nothing():
    bands = squared_differences(9)
    penalty = np.diag(bands[0]) + sum(np.diag(bands[d, :-d], d) + np.diag(bands[d, :-d], -d) for d in (1, 2))
    line = np.arange(9.0)
    np.testing.assert_allclose(penalty @ line, 0, atol=1e-12)
    np.testing.assert_allclose(penalty @ np.ones(9), 0, atol=1e-12)
    assert line**2 @ penalty @ line**2 > 0


# --- known answers ---------------------------------------------------------------------------------------------


def test_exact_in_the_spline_space():
    """Case A2: K(t) and B(t) that are splines come back to 1e-10."""
    t = clock(10.0)
    rng = np.random.default_rng(1)
    e, v = rich_motion(t, rng)
    basis = Basis.spaced(t[0], t[-1], 0.1)
    k = basis.evaluate(600 + 150 * rng.uniform(-1, 1, (basis.size, 6)), t)
    b = basis.evaluate(40 + 10 * rng.uniform(-1, 1, (basis.size, 6)), t)
    found = fit_smooth(recorded(t, e, v, k * e + b * v), at=t[::50])
    assert found.observable.all()
    np.testing.assert_allclose(diagonals(found.stiffness), k[::50], rtol=1e-10)
    np.testing.assert_allclose(diagonals(found.damping), b[::50], rtol=1e-10)


def test_bias_needs_an_intercept():
    """Case A5: 3 N of bias make 690 N/m of 600 N/m, and 600 with an intercept."""
    data = biased()
    without, with_bias = fit_smooth(data, None), fit_smooth(data, None, bias=True)
    assert diagonals(without.stiffness)[0] == pytest.approx(690, abs=1)
    assert diagonals(with_bias.stiffness)[0] == pytest.approx(600, abs=1)
    assert with_bias.parameters["bias"] == pytest.approx(3, abs=0.05)
    off = (with_bias.parameters["bias"] - 3) / with_bias.parameters["bias_sd"]
    assert np.abs(off).max() < 4


@pytest.mark.parametrize("knots", [None, 0.1])
def test_latency(knots: float | None):
    """Case A7: a wrench that is 5 ms late takes K τ off the damping, and is found to 0.1 ms."""
    t = clock(10.0)
    e, v = rich_motion(t, np.random.default_rng(5))
    wrench = 600 * e + 59.4 * v
    late = np.concatenate([np.repeat(wrench[:1], 5, axis=0), wrench[:-5]])
    data = recorded(t, e, v, late + 0.2 * np.random.default_rng(0).normal(size=e.shape))
    blind = fit_smooth(data, knots)
    assert np.nanmedian(diagonals(blind.damping)) == pytest.approx(56.3, abs=0.3)
    found = fit_smooth(data, knots, latency=True)
    assert float(found.parameters["latency"]) == pytest.approx(5e-3, abs=1e-4)
    assert np.nanmedian(diagonals(found.damping)) == pytest.approx(59.4, abs=0.1)
    assert np.nanmedian(diagonals(found.stiffness)) == pytest.approx(600, abs=1)


def test_huber_shrugs_at_outliers():
    """Case A10: 2 % outliers of 20 ± 30 N pull least squares by 2 %, Huber's estimate by less than 0.1 %."""
    data = struck()
    squares, huber = (
        diagonals(fit_smooth(data, None, robust=robust).stiffness)[0] for robust in (False, True)
    )
    assert squares.mean() == pytest.approx(612, abs=4)
    assert huber == pytest.approx(np.full(6, 600.2), abs=0.6)
    assert fit_smooth(data, 0.2, robust=True).noise == pytest.approx(np.full(6, 0.2), rel=0.06)


def test_a_spring_at_the_tip_is_coupled_at_the_hand():
    """Case A6: rotational 18.0, coupling 120; diag(800, 400) turned by 30°."""
    found = estimation_cases.tip_stiffness()
    assert found == pytest.approx(
        {
            "a6_rotational": 18.0,
            "a6_coupling": 120.0,
            "a6_yaw_x": 700.0,
            "a6_yaw_y": 500.0,
            "a6_yaw_xy": 173.2,
        },
        rel=1e-3,
    )


def test_inertia_is_read_as_negative_stiffness():
    """Case A9: K − M ω² at 0.5, 1 and 2 Hz, and K once the inertia is taken out."""
    found = list(estimation_cases.inertia().values())
    assert found == pytest.approx([570.4, 481.6, 126.3, 600.0], abs=0.06)


# --- honest bands -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("profile", "knots", "limit"), [("smooth", 0.1, 0.005), ("steps", 0.05, 0.02)])
def test_error_bands_and_coverage(profile: str, knots: float, limit: float):
    """Rich 10 s at 1 kHz: 0.5 % (2 % for steps), error within 1.3 deviations, 95 % bands that cover."""
    worse, sure, inside = [], [], []
    for seed in range(3):
        data = diagonal(seed, profile=profile)
        found = fit_smooth(data.recording, knots)
        wrong = np.concatenate(errors(found, data.stiffness, data.damping), axis=1)
        size = np.concatenate([truth(found, data.stiffness), truth(found, data.damping)], axis=1)
        sd = np.concatenate([diagonals(found.stiffness_sd), diagonals(found.damping_sd)], axis=1)
        assert found.observable.mean() > 0.95
        assert np.median(np.sqrt(np.nanmean(wrong**2, axis=0) / np.mean(size**2, axis=0))) < limit
        worse.append(np.nanmean((wrong / size) ** 2))
        sure.append(np.nanmean((sd / size) ** 2))
        seen = np.isfinite(wrong)
        inside.append(np.mean(np.abs(wrong[seen]) < 1.96 * sd[seen]))
    assert np.sqrt(np.mean(worse) / np.mean(sure)) < 1.3
    assert 0.9 < np.mean(inside) < 0.99 + 0.01


def test_reaching_does_not_identify_damping():
    """While K may vary, B is anybody's guess over a reach: flagged, and found once it is tied to K."""
    for profile in ("constant", "smooth", "steps"):
        data = diagonal(3, profile=profile, motion="reach", duration=5.0)
        found = fit_smooth(data.recording)
        assert found.damping_observable.mean() < 0.02
        assert any("damping" in warning for warning in found.warnings)
    t = clock(5.0)
    data = diagonal(7, motion="reach", duration=5.0)
    damping = np.repeat([3.0, 0.4], 3) * np.sqrt(data.stiffness)
    e, v = data.recording.error, data.recording.error_rate
    tied = fit_smooth(
        recorded(t, e, v, data.stiffness * e + damping * v, noise=1.0), 0.2, structure="damping_factor"
    )
    assert tied.observable.mean() > 0.8
    assert tied.parameters["damping_factor"] == pytest.approx([3.0, 0.4], rel=0.15)


def test_a_straight_line_costs_nothing():
    """Coefficients of a straight line lie on one, up to the ends: the penalty leaves it alone."""
    basis = Basis(2.0, 5.0, 12)
    t = np.linspace(2.0, 5.0, 400)
    first, values = basis(t)
    design = np.zeros((len(t), basis.size))
    np.put_along_axis(design, first[:, None] + np.arange(values.shape[1]), values, axis=1)
    line = np.linalg.lstsq(design, 3.0 - 0.7 * t, rcond=None)[0]
    assert np.abs(np.diff(line, 2)).max() < 1e-12


@pytest.mark.parametrize("share", [0.0, 0.2, 0.8])
def test_bands_hold_over_a_reach(share):
    """One reach while the spring gets softer, a badly conditioned fit: what is shown is inside its band."""
    t = clock(2.0)
    e, v = reach(t)
    softer = STIFFNESS * (1 + share / 2 - share * t / t[-1])[:, None]
    damping = 1.4 * np.sqrt(softer * MASS)
    inside, wrong = [], []
    for seed in range(4):
        noisy = recorded(t, e, v, softer * e + damping * v, noise=1.0, rng=np.random.default_rng(seed))
        found = fit_smooth(noisy)
        true = truth(found, softer)
        off, sd = diagonals(found.stiffness) - true, diagonals(found.stiffness_sd)
        shown = np.isfinite(off)
        inside.append(np.abs(off[shown]) < 2.6 * sd[shown])
        wrong.append(off[shown] / true[shown])
    assert np.mean(np.concatenate(inside)) > 0.85
    assert np.sqrt(np.mean(np.concatenate(wrong) ** 2)) < 0.05
    exact = fit_smooth(recorded(t, e, v, softer * e + damping * v))
    off = diagonals(exact.stiffness) / truth(exact, softer) - 1
    assert np.sqrt(np.nanmean(off**2)) < 0.03


def test_rest_in_the_middle_is_a_gap():
    """Where nothing moves, nothing is said; before and after, everything is."""
    t = clock(6.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    still = (t > 2) & (t < 4)
    e[still], v[still] = 0, 0
    found = fit_smooth(recorded(t, e, v, 600 * e + 40 * v, noise=1.0))
    rest = (found.time > 2.2) & (found.time < 3.8)
    busy = (found.time < 1.9) | (found.time > 4.1)
    assert not found.observable[rest].any()
    assert np.isnan(diagonals(found.stiffness)[rest]).all()
    assert found.observable[busy].mean() > 0.95


def test_correlated_residuals_widen_the_bands():
    """Drift of the sensor is not white noise: bands must not shrink with the square root of the samples."""
    t = clock(10.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    drift = np.cumsum(np.random.default_rng(1).normal(size=e.shape), axis=0)
    drift = drift - np.convolve(drift[:, 0], np.ones(400) / 400, mode="same")[:, None]
    drift = 0.2 * drift / drift.std(axis=0)
    coloured = fit_smooth(recorded(t, e, v, 600 * e + 40 * v + drift), None)
    white = fit_smooth(recorded(t, e, v, 600 * e + 40 * v, noise=1.0), None)
    assert (diagonals(coloured.stiffness_sd)[0, :3] > 3 * diagonals(white.stiffness_sd)[0, :3]).all()
    assert any("correlated" in warning for warning in coloured.warnings)


# --- structure and constraint --------------------------------------------------------------------------------


def test_constraint_holds_at_every_instant_and_equals_casadi():
    """Gains that would dip below zero are held above; projected Newton and CasADi agree."""
    t = clock(3.0)
    e, v = rich_motion(t, np.random.default_rng(2))
    stiffness = 300 + 400 * np.cos(2 * np.pi * 0.7 * t)[:, None] * np.ones(6)
    data = recorded(t, e, v, stiffness * e + 40 * v, noise=1.0)
    free = fit_smooth(data, constraint="none")
    assert np.nanmin(diagonals(free.stiffness)) < -50
    one, two = (fit_smooth(data, solver=solver, at=t[::10]) for solver in ("closed_form", "casadi"))
    seen = one.observable.all(axis=1)
    assert (diagonals(one.stiffness)[seen] > 0).all()
    np.testing.assert_allclose(one.stiffness, two.stiffness, rtol=1e-4, atol=1e-2)
    one.to_gains(one.time[seen])


def test_full_matrices_stay_positive_definite():
    data = full(3)
    found = fit_smooth(data.recording, 0.5, structure="full")
    seen = found.observable.all(axis=1)
    assert seen.mean() > 0.9
    for gain, true in ((found.stiffness, data.stiffness), (found.damping, data.damping)):
        assert (np.linalg.eigvalsh(gain[seen]) > 0).all()
        assert relative_rms(gain[seen], truth(found, true)[seen]) < 0.15
    inside = np.abs(found.stiffness - truth(found, data.stiffness))[seen] < 1.96 * found.stiffness_sd[seen]
    assert 0.85 < inside.mean() <= 1
    found.to_gains(found.time[seen])


@pytest.mark.parametrize(
    "solver",
    [
        pytest.param("clarabel", marks=pytest.mark.skipif(not clarabel_installed(), reason="needs [lmi]")),
        "casadi",
    ],
)
def test_full_constraint_bites(solver: str):
    """A stiffness of rank three, on its edge all the time: SPD at every instant and close to the truth."""
    t = clock(3.0)
    e, v = rich_motion(t, np.random.default_rng(4))
    k = np.zeros((6, 6))
    k[0, 0] = k[1, 1] = 800.0
    k[0, 1] = k[1, 0] = 790.0
    k[2, 2], k[3, 3], k[4, 4], k[5, 5] = 400, 20, 20, 20
    b = np.diag([40.0, 40, 40, 2, 2, 2])
    data = recorded(t, e, v, e @ k + v @ b, noise=3.0, rng=np.random.default_rng(1))
    free = fit_smooth(data, 1.0, structure="full", constraint="none")
    assert np.nanmin(np.linalg.eigvalsh(np.nan_to_num(free.stiffness))) < 0 or free.observable.any()
    found = fit_smooth(data, 1.0, structure="full", solver=solver)
    seen = found.observable.all(axis=1)
    assert seen.any()
    assert (np.linalg.eigvalsh(found.stiffness[seen]) > 0).all()
    np.testing.assert_allclose(np.median(found.stiffness[seen], axis=0), k, atol=60)


def test_pooling_narrows_the_bands():
    """Four demonstrations of the same gains are worth four times the information of one."""
    parts = []
    for seed in range(4):
        t = clock(3.0)
        e, v = rich_motion(t, np.random.default_rng(seed))
        stiffness = (600 * (1 + 0.3 * np.sin(t)))[:, None] * np.ones(6)
        parts.append(
            recorded(
                t + 100 * seed, e, v, stiffness * e + 40 * v, noise=1.0, rng=np.random.default_rng(seed + 9)
            )
        )
    one, all_four = fit_smooth(parts[0], 0.3), fit_smooth(iter(parts), 0.3)
    assert all_four.time[0] == 0
    assert all_four.residuals.shape == (12000, 6)
    ratio = np.nanmedian(diagonals(one.stiffness_sd)) / np.nanmedian(diagonals(all_four.stiffness_sd))
    assert 1.4 < ratio < 3
    assert (
        np.nanmax(np.abs(diagonals(all_four.stiffness) - 600 * (1 + 0.3 * np.sin(all_four.time))[:, None]))
        < 20
    )


def test_pooled_recordings_have_their_own_bias():
    t = clock(2.0)
    parts = []
    for seed, bias in enumerate((2.0, -5.0)):
        e, v = rich_motion(t, np.random.default_rng(seed))
        parts.append(recorded(t, e, v, 600 * e + 40 * v + bias, noise=1.0, rng=np.random.default_rng(seed)))
    for structure in ("diagonal", "full"):
        found = fit_smooth(parts, 0.5, structure=structure, bias=True)
        assert found.parameters["bias"][0] == pytest.approx(2.0, abs=0.1)
        assert found.parameters["bias"][1] == pytest.approx(-5.0, abs=0.1)


# --- the joint program ----------------------------------------------------------------------------------------


def joint_data(*, attractor: Array, lag: int, tied: bool, bias: float = 0.0):
    data = diagonal(7, duration=6.0, noise=0.0)
    k = data.stiffness
    b = np.repeat([3.0, 0.4], 3) * np.sqrt(k) if tied else data.damping
    e, v, t = data.recording.error, data.recording.error_rate, data.recording.time
    wrench = k * (e - attractor) + b * v
    wrench = np.concatenate([np.repeat(wrench[:1], lag, axis=0), wrench[: len(wrench) - lag]])
    noise = np.random.default_rng(1).normal(size=e.shape)
    return recorded(t, e, v, wrench + bias + NOISE * noise), k, b


ATTRACTOR = np.array([0.01, -0.005, 0.02, 0.05, 0.02, -0.04])


def test_tied_damping_attractor_and_latency_at_once():
    data, k, b = joint_data(attractor=ATTRACTOR, lag=4, tied=True)
    found = fit_smooth(data, 0.2, structure="damping_factor", attractor=True, latency=True)
    wrong = errors(found, k, b)
    assert found.observable.all()
    assert relative_rms(wrong[0] + truth(found, k), truth(found, k)) < 0.005
    p = found.parameters
    assert p["damping_factor"] == pytest.approx([3.0, 0.4], rel=2e-3)
    assert p["attractor"] == pytest.approx(ATTRACTOR, abs=2e-4)
    assert float(p["latency"]) == pytest.approx(4e-3, abs=1e-4)
    for name, true in (("damping_factor", [3.0, 0.4]), ("attractor", ATTRACTOR), ("latency", 4e-3)):
        assert (np.abs(p[name] - true) < 5 * p[f"{name}_sd"]).all()
    ratio = np.sqrt(np.mean(wrong[0] ** 2, axis=0) / np.mean(diagonals(found.stiffness_sd) ** 2, axis=0))
    assert ratio.max() < 2


@pytest.mark.parametrize("share", [0.0, 0.3])
@pytest.mark.parametrize(
    "options", [{"structure": "damping_factor"}, {"structure": "damping_factor", "latency": True}]
)
def test_the_joint_program_is_exact_without_noise(share: float, options: dict):
    t = clock(3.0)
    e, v = rich_motion(t, np.random.default_rng(3))
    k = STIFFNESS * (1 + share * np.sin(t))[:, None]
    found = fit_smooth(recorded(t, e, v, k * e + 3 * np.sqrt(k) * v), 0.3, **options)
    assert found.observable.all()
    assert found.parameters["damping_factor"] == pytest.approx([3.0, 3.0], rel=1e-4)
    np.testing.assert_allclose(diagonals(found.stiffness), truth(found, k), rtol=1e-3)


def test_attractor_with_free_damping():
    data, k, b = joint_data(attractor=ATTRACTOR, lag=0, tied=False)
    found = fit_smooth(data, 0.2, attractor=True)
    assert found.parameters["attractor"] == pytest.approx(ATTRACTOR, abs=2e-4)
    wrong = errors(found, k, b)
    assert relative_rms(wrong[0] + truth(found, k), truth(found, k)) < 0.01
    assert relative_rms(wrong[1] + truth(found, b), truth(found, b)) < 0.01


def test_tied_with_bias_and_outliers():
    data, k, _ = joint_data(attractor=np.zeros(6), lag=0, tied=True, bias=1.0)
    wrench = data.wrench.copy()
    struck = np.random.default_rng(0).random(wrench.shape) < 0.02
    wrench[struck] += 100 * np.broadcast_to(NOISE, wrench.shape)[struck]
    struck_data = recorded(data.time, data.error, data.error_rate, wrench)
    found = fit_smooth(struck_data, 0.2, structure="damping_factor", bias=True, robust=True)
    assert found.parameters["bias"] == pytest.approx(np.ones((1, 6)), abs=0.05)
    assert relative_rms(diagonals(found.stiffness), truth(found, k)) < 0.01
    assert found.noise == pytest.approx(NOISE, rel=0.1)


def test_one_program_equals_the_closed_form():
    """Without anything nonlinear in effect (an attractor that is zero), the program finds the linear fit."""
    data, _, _ = joint_data(attractor=np.zeros(6), lag=0, tied=False)
    linear = fit_smooth(data, 0.2, constraint="none")
    joint = fit_smooth(data, 0.2, attractor=True)
    assert np.abs(joint.parameters["attractor"]).max() < 2e-4
    distance = np.abs(diagonals(joint.stiffness) - diagonals(linear.stiffness))
    assert (distance < diagonals(linear.stiffness_sd) + diagonals(joint.stiffness_sd)).mean() > 0.95


# --- input -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"knots": 0}, "knots"),
        ({"knots": 100}, "smaller"),
        ({"knots": 1e-5}, "larger"),
        ({"knots": np.nan}, "knots"),
        ({"structure": "banded"}, "choose one of"),
        ({"structure": "full", "attractor": True}, "diagonal"),
        ({"structure": "damping_factor", "solver": "clarabel"}, "CasADi"),
        ({"at": [0.3, 0.2]}, "sort"),
        ({"at": [5.0]}, "covers"),
        ({"noise": [-1] * 6}, "greater than zero"),
    ],
)
def test_bad_options(options: dict, message: str):
    with pytest.raises(InputError, match=message):
        fit_smooth(diagonal(duration=0.5).recording, **options)


def test_no_recording():
    with pytest.raises(InputError, match="no recording"):
        fit_smooth([])


@given(scale=st.floats(1e-2, 1e2), shift=st.floats(-1e3, 1e3))
@settings(max_examples=8, deadline=None)
def test_units_and_clock_do_not_matter(scale: float, shift: float):
    data = diagonal(2, duration=1.0).recording
    one = fit_smooth(data, 0.2)
    two = fit_smooth(recorded(data.time + shift, data.error, data.error_rate, scale * data.wrench), 0.2)
    known = np.isfinite(one.stiffness) & np.isfinite(two.stiffness)
    assert known.mean() > 0.9
    tolerance = 0.1 * scale * one.stiffness_sd[known] + 1e-9
    assert (np.abs(two.stiffness[known] - scale * one.stiffness[known]) <= tolerance).all()


def test_gains_for_the_law():
    data = diagonal(1, duration=2.0)
    found = fit_smooth(data.recording)
    times = np.linspace(0.5, 1.5, 7)
    gains = found.to_gains(times)
    assert isinstance(gains, ImpedanceGains)
    assert gains.batch_shape == (7,)
    rows = np.rint(times * 1000).astype(int)
    assert relative_rms(gains.stiffness_diagonal, data.stiffness[rows]) < 0.05
