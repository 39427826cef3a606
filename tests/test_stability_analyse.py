"""``stability.analyse``: it asks what applies, and its answers are those of the methods."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox import stability
from vic_toolbox.errors import InputError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.gains import CholeskyStiffness, DampingFactor, Diagonal, DiagonalStiffness, ImpedanceGains
from vic_toolbox.models import load_robot
from vic_toolbox.stability import Certificate, CounterExample
from vic_toolbox.stability.analysis.findings import SEVERITY
from vic_toolbox.stability.analysis.sets import decay, hull
from vic_toolbox.stability.analysis.subject import of_parametrisation

T = np.linspace(0, 2 * np.pi, 401)
MASS = np.array([3.0, 3.0, 3.0, 0.05, 0.05, 0.05])
LOW, HIGH = (100.0, 100.0, 100.0, 5.0, 5.0, 5.0), (400.0, 400.0, 400.0, 10.0, 10.0, 10.0)
DAMPING = (40.0, 40.0, 40.0, 1.0, 1.0, 1.0)


def course(time, stiffness, damping, **more) -> SimpleNamespace:
    return SimpleNamespace(time=time, stiffness=stiffness, damping=damping, **more)


def pumping() -> SimpleNamespace:
    """KB2: positive gains, and unstable."""
    k = 12 + 10 * np.sin(T)
    k[-1] = k[0]
    return course(T, k, np.ones(len(T)))


def six(n: int = 60) -> SimpleNamespace:
    t = np.linspace(0, 3, n)
    k = np.array([600.0, 900, 400, 30, 40, 20]) * (1 + 0.3 * np.sin(2 * t[:, None]))
    return course(t, k, 1.4 * np.sqrt(k * MASS))


# --- gains over time -----------------------------------------------------------------------------------------


def test_a_schedule_that_pumps_is_disproved_with_a_motion_that_grows_again():
    found = stability.analyse(pumping(), 10.0)
    verdict = found["schedule"]
    assert verdict.status == "disproved"
    assert verdict.values["alpha"] == pytest.approx(5 / np.sqrt(44), rel=1e-4)
    assert isinstance(verdict.witness, CounterExample)
    _, state = verdict.witness.replay()
    assert np.linalg.norm(state[-1]) > 5 * np.linalg.norm(state[0])
    assert found.worst is not None
    assert found.worst.name == "schedule"
    assert "slowly" in found.worst.remedy


def test_smooth_gains_of_six_axes():
    found = stability.analyse(six(), MASS, period=1e-3)
    assert [f.name for f in found] == [
        "schedule", "switching", "worst switching", "sampled", "passivity", "contact",
    ]  # fmt: skip
    assert found["schedule"].status == found["switching"].status == found["sampled"].status == "proved"
    assert found["passivity"].status == "disproved"
    direct = stability.sampled_passivity(
        np.stack([np.diag(k) for k in six().stiffness]),
        np.stack([np.diag(b) for b in six().damping]),
        period=1e-3,
    )
    assert found["passivity"].margin == pytest.approx(direct.margin)


def test_what_one_alpha_does_not_decide_a_changing_one_does():
    """KB2-d: between the exact and the constant-α edge (7.54) the spline certifies."""
    steady = pumping()
    steady.damping = np.full(len(T), 5.5)
    found = next(iter(stability.analyse(steady, 10.0)))
    assert found.status == "proved"
    assert "alpha" in found.verdict.values
    assert found.tried
    assert found.tried[0].status == "inconclusive"


def test_jumping_gains_are_held():
    t = np.arange(100) * 0.01
    k = np.where(t < 0.5, 500.0, 100.0)
    found = stability.analyse(course(t, k, np.full(100, 30.0)), 1.0)
    assert found["schedule"].status == "proved"
    assert "injected_energy" in found["schedule"].values
    up = stability.analyse(course(t, k[::-1], np.full(100, 30.0)), 1.0)
    assert up["schedule"].status != "disproved"


def test_held_gains_account_for_the_recorded_motion():
    t = np.arange(0, 1, 0.001)
    k = np.where(t < 0.5, 100.0, 500.0)
    e = np.full(len(t), 0.1)
    found = stability.analyse(course(t, k, np.full(len(t), 20.0), error=e, error_rate=0 * e), 1.0, hold=0.01)
    assert found["held"].values["injected_energy"] == pytest.approx(2.0)
    with pytest.raises(InputError, match="shorter hold"):
        stability.analyse(course(t, k, k / 10), 1.0, hold=2.0)


def test_undetermined_axes_are_left_out_and_said():
    gains = six()
    k, b = gains.stiffness.copy(), gains.damping.copy()
    k[:, 4] = np.nan
    b[:10, 1] = np.nan
    found = stability.analyse(course(gains.time, k, b), MASS)
    assert found.axes == ("x", "y", "z", "rx", "rz")
    assert found.time is not None
    assert len(found.time) == 50
    text = found.summary()
    assert "ry left out" in text
    assert "judged from" in text
    whole = stability.analyse(course(gains.time, gains.stiffness, gains.damping), MASS, axes=["x", "z"])
    assert whole.axes == ("x", "z")
    with pytest.raises(InputError, match="nowhere determined"):
        stability.analyse(course(gains.time, k * np.nan, b), MASS)


def test_one_mass_is_that_of_the_translations():
    found = stability.analyse(six(), 3.0)
    assert found.axes == ("x", "y", "z")
    assert any("rotations" in text for text in found.assumptions)


def test_without_a_mass_only_what_needs_none_is_asked():
    found = stability.analyse(six(), period=1e-3)
    assert [f.name for f in found] == ["passivity"]
    assert any("mass" in text for text in found.assumptions)
    assert len(stability.analyse(six())) == 0


def test_coupled_gains_on_a_mass_that_moves():
    t = np.linspace(0, 1, 40)
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    k = turn @ np.diag([300.0, 500, 700]) @ turn.T * (1 + 0.2 * np.sin(3 * t))[:, None, None]
    mass = turn.T @ np.diag([2.0, 3, 4]) @ turn * (1 + 0.2 * t)[:, None, None]
    found = stability.analyse(course(t, k, np.broadcast_to(60 * np.eye(3), k.shape)), mass)
    assert found["inertia"].status == found["switching"].status == found["schedule"].status == "proved"
    witness = found["switching"].witness
    assert isinstance(witness, Certificate)
    rates = decay(witness.values["P"], mass, k, np.broadcast_to(60 * np.eye(3), k.shape))
    assert rates.min() == pytest.approx(found["switching"].margin)


def test_the_arm_on_its_way():
    arm = load_robot("fanuc_lrmate200id7l")
    gains = six(30)
    q = arm.home + 0.1 * np.sin(gains.time)[:, None]
    found = stability.analyse(gains, arm, q=q)
    assert {"schedule", "inertia", "switching"} <= set(found.verdicts)
    assert found["inertia"].values["without_coriolis"] > 0
    with pytest.raises(InputError, match="another mass in every posture"):
        stability.analyse(gains, arm)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_hull_that_is_proved_makes_no_motion_grow(seed: int):
    """Whatever switching: V decays at the rate that was promised."""
    rng = np.random.default_rng(seed)
    n, d = 40, 2
    k = np.stack([np.diag(x) for x in rng.uniform(50, 200, (n, d))])
    b = np.stack([np.diag(x) for x in rng.uniform(10, 30, (n, d))])
    verdict = hull(np.array([[1.0, 0.2], [0.2, 1.0]]), k, b)
    if verdict.status != "proved":
        return
    witness = verdict.witness
    assert isinstance(witness, Certificate)
    matrix = witness.values["P"]
    state, mass = rng.normal(size=2 * d), np.array([[1.0, 0.2], [0.2, 1.0]])
    values, dt = [state @ matrix @ state], 1e-3
    for i in rng.integers(0, n, 200):
        flow = np.block([
            [np.zeros((d, d)), np.eye(d)],
            [-np.linalg.solve(mass, k[i]), -np.linalg.solve(mass, b[i])],
        ])  # fmt: skip
        state = np.linalg.solve(np.eye(2 * d) - dt / 2 * flow, (np.eye(2 * d) + dt / 2 * flow) @ state)
        values.append(state @ matrix @ state)
    assert (np.diff(values) < 0).all()
    assert values[-1] <= values[0] * np.exp(-2 * verdict.margin * 200 * dt) * (1 + 1e-3)


# --- ranges, constants, policies -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "form",
    [
        DiagonalStiffness(stiffness_low=LOW, stiffness_high=HIGH, damping=DAMPING),
        Diagonal(
            stiffness_low=LOW,
            stiffness_high=HIGH,
            damping_low=DAMPING,
            damping_high=(50.0, 50.0, 50.0, 50.0, 50.0, 50.0),
        ),
        DampingFactor(stiffness_low=LOW, stiffness_high=HIGH, factor_low=3.0, factor_high=5.0),
        CholeskyStiffness(stiffness_low=LOW, stiffness_high=HIGH, damping_factor=4.0, coupling_limit=0.3),
    ],
    ids=lambda form: type(form).__name__,
)
def test_every_parametrisation_is_a_range(form):
    found = stability.analyse(form, MASS, period=1e-4)
    assert {"switching", "sampled", "passivity", "contact"} <= set(found.verdicts)
    free = not isinstance(form, CholeskyStiffness)
    assert ("worst switching" in found) == ("safe range" in found) == free
    assert free or found["switching"].status != "proved"  # the set is no polytope


@settings(max_examples=60, deadline=None)
@given(k=st.floats(100, 400), d=st.floats(3, 5))
def test_the_cover_of_a_damping_factor_holds_every_gain(k: float, d: float):
    form = DampingFactor(stiffness_low=LOW, stiffness_high=HIGH, factor_low=3.0, factor_high=5.0)
    cover = of_parametrisation(form).cover
    assert cover is not None
    points = np.column_stack([part[:, 0, 0] for part in cover])
    centre = points.mean(axis=0)
    order = np.argsort(np.arctan2(*((points - centre) / points.std(axis=0)).T[::-1]))
    turn = points[order]
    edges = np.roll(turn, -1, axis=0) - turn
    to = np.array([k, d * np.sqrt(k)]) - turn
    assert (edges[:, 0] * to[:, 1] - edges[:, 1] * to[:, 0] >= -1e-6 * np.abs(turn).max() ** 2).all()


@pytest.mark.parametrize("form", ["factor", "box"])
def test_a_range_on_a_coupled_mass_is_proved_for_every_gain_in_it(form: str):
    """Corners of all axes together, not of each alone: the certificate holds at gains drawn from the range."""
    rng = np.random.default_rng(0)
    mixed = np.diag(np.sqrt(MASS)) @ (np.eye(6) + 0.25 * (1 - np.eye(6))) @ np.diag(np.sqrt(MASS))
    if form == "factor":
        range_ = DampingFactor(stiffness_low=LOW, stiffness_high=HIGH, factor_low=3.0, factor_high=5.0)
        gains = range_.to_gains(rng.uniform(-1, 1, (500, 7)))
        k, b = gains.stiffness, gains.damping
    else:
        ends = (np.array(LOW), np.array(HIGH)), (np.array(DAMPING), 2 * np.array(DAMPING))
        range_ = tuple(ends)
        k, b = (rng.uniform(*end, (500, 6))[:, :, None] * np.eye(6) for end in ends)
    verdict = stability.analyse(range_, mixed)["switching"]
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)
    rates = decay(verdict.witness.values["P"], np.broadcast_to(mixed, k.shape), k, b)
    assert rates.min() >= verdict.margin * (1 - 1e-6)


def test_a_range_by_known_numbers():
    """LMI1: k in [1, 9] has a common Lyapunov function iff b > 2; the worst switching needs less."""
    safe, narrow = (stability.analyse(((1.0, 9.0), (b, b)), 1.0) for b in (2.05, 1.9))
    assert safe["switching"].status == "proved"
    decided = next(f for f in narrow if f.name == "switching")
    assert [v.status for v in decided.tried] == ["inconclusive"]
    assert narrow["worst switching"].status == decided.status == "proved"
    critical = narrow["worst switching"].values["critical_damping"]
    assert critical == pytest.approx(
        stability.worst_case_switching(1.0, (1.0, 9.0), 1.9).values["critical_damping"]
    )
    loose = stability.analyse(((1.0, 9.0), (critical / 2, 5.0)), 1.0)
    assert loose["worst switching"].status == loose["switching"].status == "disproved"
    assert "too wide" in next(f.remedy for f in loose if f.name == "safe range")


def test_constant_gains():
    found = stability.analyse((1000.0, 30.0), 1.0, period=20e-3)
    assert found["sampled"].status == "proved"  # K T/2 = 10 < B < 2 m/T = 100
    assert stability.analyse((1000.0, 9.0), 1.0, period=20e-3)["sampled"].status == "disproved"
    assert found["passivity"].values["required_damping"] == pytest.approx(40.0)
    remedy = next(f.remedy for f in found if f.name == "sampled")
    assert "Z-width" in remedy
    assert "ms" in remedy
    gains = ImpedanceGains.diagonal(HIGH, DAMPING)
    assert stability.analyse(gains, MASS, period=1e-3)["contact"].status == "proved"


def test_the_longest_period_is_the_edge():
    remedy = next(
        f.remedy for f in stability.analyse((1000.0, 30.0), 1.0, period=1e-3) if f.name == "sampled"
    )
    assert "60" in remedy or "59" in remedy  # K T/2 = 30 at T = 60 ms


def test_policies():
    soft = stability.analyse(lambda e, v: (1000 + 0 * e, 20 + 0 * e), 1.0)
    assert soft["policy"].status == "proved"
    falling = stability.analyse(
        lambda e, v: (1000 * np.exp(-((e / 0.01) ** 2) / 2), 20 + 0 * e), 1.0, region=[0.02, 0.1]
    )
    assert falling["policy"].values["largest_force"] == pytest.approx(6.06531, rel=1e-3)
    form = DiagonalStiffness(stiffness_low=LOW, stiffness_high=HIGH, damping=DAMPING)
    whatever = stability.analyse(lambda obs: np.sin(50 * obs[:, :6]), np.diag(MASS), parametrisation=form)
    assert whatever["policy"].status == "proved"
    assert "safe range" in whatever
    with pytest.raises(InputError, match="needs the mass"):
        stability.analyse(lambda e, v: (e, v))


# --- the result ----------------------------------------------------------------------------------------------


def test_the_result_is_a_table_and_json(tmp_path):
    found = stability.analyse(pumping(), 10.0, period=1e-3)
    text = found.summary()
    assert all(f.question in text and f.status in text for f in found)
    found.save(tmp_path / "found.json")
    told = json.loads((tmp_path / "found.json").read_text())
    assert told["worst"] == {"name": "schedule", "status": "disproved"}
    assert [one["name"] for one in told["findings"]] == list(found.verdicts)
    assert sum(found.count(status) for status in SEVERITY) == len(found)
    with pytest.raises(InputError, match="schedule"):
        found["nothing"]
    for finding in found:
        assert finding.plot().axes


def test_units_change_no_verdict():
    """Seconds in milliseconds: K, B and T scale with it."""
    k = 12 + 10 * np.sin(T)
    k[-1] = k[0]
    for b, status in ((1.0, "disproved"), (8.0, "proved")):
        for scale in (1.0, 1e3):
            gains = course(T / scale, k * scale**2, np.full(len(T), b) * scale)
            assert stability.analyse(gains, 10.0)["schedule"].status == status


@pytest.mark.parametrize(
    ("subject", "model", "options", "said"),
    [
        (3.0, 1.0, {}, "cannot be analysed"),
        ((1.0, 1.0), -1.0, {}, "mass"),
        ((1.0, 1.0), 1.0, {"period": 0.0}, "period"),
        ((-1.0, 1.0), 1.0, {}, "negative"),
        ((1.0, np.nan), 1.0, {}, "damping"),
        (((9.0, 1.0), (1.0, 1.0)), 1.0, {}, "lowest"),
        ((np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2)), 1.0, {}, "symmetric"),
        ((np.ones(3), np.ones(2)), 1.0, {}, "many"),
        ((1.0, 1.0), np.ones(4), {}, "mass"),
        ((1.0, 1.0), 1.0, {"axes": ["q"]}, "axis"),
        ((1.0, 1.0), 1.0, {"load": [1.0]}, "only a policy"),
        ((1.0, 1.0), 1.0, {"q": [1.0]}, "robot"),
        (course(T[::-1], np.ones(401), np.ones(401)), 1.0, {}, "sort"),
        (course(T, np.ones(400), np.ones(401)), 1.0, {}, "instants"),
        (course(T, -np.ones(401), np.ones(401)), 1.0, {}, "negative in 401 of 401"),
    ],
)
def test_bad_input_is_refused(subject, model, options, said):
    with pytest.raises(InputError, match=said):
        stability.analyse(subject, model, **options)


def test_a_constant_fit_is_constant_gains():
    nan = np.full((1, 6, 6), np.nan)
    nan[:, ~np.eye(6, dtype=bool)] = 0
    k, b = nan.copy(), nan.copy()
    k[0, 0, 0], b[0, 0, 0] = 500.0, 40.0
    seen = np.isfinite(k[:, np.arange(6), np.arange(6)])
    fit = GainEstimate(
        np.zeros(1),
        k,
        b,
        0 * k,
        0 * b,
        seen,
        seen,
        np.ones((1, 6)),
        np.zeros((3, 6)),
        np.ones(6),
        np.ones(6),
        "m",
    )
    found = stability.analyse(fit, 2.0, period=1e-3)
    assert found.axes == ("x",)
    assert found["sampled"].status == "proved"
