"""Gains held by a computer: exact stability, passivity of a sampled wall, Z-width."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from vic_toolbox.errors import InputError
from vic_toolbox.stability.sampling.sampled import sampled_stability
from vic_toolbox.stability.sampling.sampled_characteristic import (
    characteristic,
    schur_stable,
    spectral_radius,
)
from vic_toolbox.stability.sampling.sampled_passivity import sampled_passivity
from vic_toolbox.stability.sampling.sampled_wall import passive_damping, required_damping
from vic_toolbox.stability.sampling.z_width import z_width
from vic_toolbox.stability.verdict import Certificate, CounterExample

WAYS = [
    {"velocity": velocity, "delay_steps": steps, "physical_damping": friction}
    for velocity in ("exact", "backward")
    for steps in (0, 1, 3)
    for friction in (0.0, 4.0)
]
positive = st.floats(0.05, 20)


def simulated(m, k, b, period, *, physical_damping=0.0, velocity="exact", delay_steps=0, samples=400):
    """Positions of a 1-DOF held loop, period by period with an ODE solver: slow and plain."""
    state, previous, queue = np.array([1e-3, 0.0]), 1e-3, [0.0] * delay_steps
    positions = []
    for _ in range(samples):
        rate = state[1] if velocity == "exact" else (state[0] - previous) / period
        queue.append(-k * state[0] - b * rate)
        force, previous = queue.pop(0), state[0]

        def field(_, x, force=force):
            return [x[1], (force - physical_damping * x[1]) / m]

        state = solve_ivp(field, (0, period), state, rtol=1e-9, atol=1e-15).y[:, -1]
        positions.append(state[0])
    return np.array(positions)


# stability --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mass", "stiffness", "period"), [(1, 1000, 0.02), (2.5, 400, 0.01), (0.05, 2000, 1e-3)]
)
def test_a_free_mass_with_exact_velocity(mass, stiffness, period):
    """ZOH1: stable iff K T/2 < B < 2 m/T."""
    low, high = stiffness * period / 2, 2 * mass / period
    for damping, stable in (
        (0.999 * low, False),
        (1.001 * low, True),
        (0.999 * high, True),
        (1.001 * high, False),
    ):
        verdict = sampled_stability(mass, stiffness, damping, period=period)
        assert verdict.status == ("proved" if stable else "disproved")
        assert (verdict.values["spectral_radius"] < 1) == stable
    np.testing.assert_allclose(verdict.values["damping_range"], [low, high], rtol=1e-9)


@pytest.mark.parametrize("way", WAYS)
def test_it_agrees_with_a_simulation(way):
    for damping in (5.0, 18.0, 60.0):
        verdict = sampled_stability(1.0, 400.0, damping, period=0.01, **way)
        path = np.abs(simulated(1.0, 400.0, damping, 0.01, **way))
        if abs(verdict.values["spectral_radius"] - 1) > 0.01:
            early, late = path[100:200].max(), path[300:].max()
            assert (late < early) == (verdict.status == "proved")
            # over 200 periods the envelope follows the spectral radius
            assert (late / early) ** (1 / 200) == pytest.approx(verdict.values["spectral_radius"], abs=0.01)


@pytest.mark.parametrize("way", WAYS)
def test_the_damping_range_is_the_edge(way):
    low, high = sampled_stability(1.0, 100.0, 15.0, period=0.01, **way).values["damping_range"]
    for edge, inside in ((low, 1.0001), (high, 0.9999)):
        if edge > 0:
            at = [sampled_stability(1.0, 100.0, b, period=0.01, **way) for b in (edge, inside * edge)]
            assert at[0].values["spectral_radius"] == pytest.approx(1, abs=1e-7)
            assert at[1].status == "proved"


@settings(max_examples=60, deadline=None)
@given(order=st.integers(2, 3), seed=st.integers(0, 10**6), size=st.floats(1e-3, 1e3))
def test_roots_in_closed_form_are_those_of_numpy(order, seed, size):
    """Quadratics and cubics, as well conditioned as their roots: also double, triple and zero ones."""
    rng = np.random.default_rng(seed)
    roots = size * rng.normal(size=order).astype(complex)
    case = rng.integers(5)
    if case == 0:
        roots[:2] = roots[0] + 1j * roots[1], roots[0] - 1j * roots[1]
    elif case == 1:
        roots[1] = roots[0]
    elif case == 2:
        roots[:] = roots[0]
    elif case == 3:
        roots[rng.random(order) < 0.7] = 0
    found = spectral_radius(np.poly(roots).real[:, None])[0]
    largest = np.abs(roots).max()
    assert found == pytest.approx(largest, rel=3e-5 if case in (1, 2) else 1e-6, abs=1e-300)


@settings(max_examples=60, deadline=None)
@given(
    stiffness=st.floats(0.01, 6),
    damping=st.floats(0, 3),
    friction=st.floats(0, 2),
    backward=st.booleans(),
    delay=st.integers(0, 3),
)
def test_the_polynomial_has_the_eigenvalues_of_the_map(stiffness, damping, friction, backward, delay):
    """And Schur-Cohn agrees with both."""
    coefficients = characteristic(friction, backward, delay)(np.array([stiffness]), np.array([damping]))
    verdict = sampled_stability(
        1,
        stiffness,
        damping,
        period=1,
        physical_damping=friction,
        velocity="backward" if backward else "exact",
        delay_steps=delay,
    )
    radius = verdict.values["spectral_radius"]
    assert spectral_radius(coefficients)[0] == pytest.approx(radius, abs=1e-6)
    if abs(radius - 1) > 1e-6:
        assert schur_stable(coefficients)[0] == (radius < 1)


@settings(max_examples=40, deadline=None)
@given(
    stiffness=positive, damping=st.floats(0.0, 5), of_mass=st.floats(1e-3, 1e3), of_time=st.floats(1e-3, 1e3)
)
def test_units_change_no_verdict(stiffness, damping, of_mass, of_time):
    verdict = sampled_stability(1, stiffness, damping, period=0.3)
    scaled = sampled_stability(
        of_mass, stiffness * of_mass / of_time**2, damping * of_mass / of_time, period=0.3 * of_time
    )
    assert scaled.status == verdict.status
    assert scaled.margin == pytest.approx(verdict.margin, abs=1e-9)


def test_matrices_are_their_axes_turned():
    rng = np.random.default_rng(0)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    axes = ([1, 2, 0.3], [900, 300, 50.0], [20, 40, 3.0])
    mass, stiffness, damping = (turn @ np.diag(a) @ turn.T for a in axes)
    verdict = sampled_stability(mass, stiffness, damping, period=0.01, velocity="backward", delay_steps=1)
    alone = [
        sampled_stability(*a, period=0.01, velocity="backward", delay_steps=1)
        for a in zip(*axes, strict=True)
    ]
    radius = max(one.values["spectral_radius"] for one in alone)
    assert verdict.values["spectral_radius"] == pytest.approx(radius, abs=1e-9)


def test_the_worst_of_several_decides():
    verdict = sampled_stability(1, [100, 1000, 200], [20, 5, 20], period=0.02)
    assert verdict.status == "disproved"
    assert verdict.values["index"] == 1
    assert verdict.values["spectral_radii"].shape == (3,)


@pytest.mark.parametrize("damping", [0.0, 9.0, 9.9999, 100.001, 500.0])
def test_the_counter_example_grows_when_replayed(damping):
    witness = sampled_stability(1, 1000, damping, period=0.02).witness
    assert isinstance(witness, CounterExample)
    assert witness.growth > 50
    _, state = witness.replay()
    np.testing.assert_allclose(state, witness.state, rtol=1e-5, atol=1e-6 * np.abs(witness.state).max())
    assert witness.energy_gained > 0


def test_a_proved_loop_dies_out_from_1000_starts():
    verdict = sampled_stability(1, 1000, 40, period=0.02, delay_steps=0)
    assert isinstance(verdict.witness, Certificate)
    step = verdict.witness.values["step"]
    state = np.random.default_rng(1).normal(size=(1000, 2))
    start = np.linalg.norm(state, axis=1)
    for _ in range(200):
        state = state @ step.T
    assert (np.linalg.norm(state, axis=1) < 1e-6 * start).all()


def test_on_the_edge_nothing_is_said():
    assert sampled_stability(1, 0, 0, period=0.01).status == "inconclusive"
    assert sampled_stability(1, 0, 5, period=0.01).status == "inconclusive"


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ((1, 1, 1), {"period": 0}),
        ((1, 1, 1), {"period": np.nan}),
        ((1, -1, 1), {"period": 1}),
        ((1, 1, -1), {"period": 1}),
        ((0, 1, 1), {"period": 1}),
        ((1, 1, 1), {"period": 1, "velocity": "forward"}),
        ((1, 1, 1), {"period": 1, "delay_steps": -1}),
        ((1, 1, 1), {"period": 1, "delay_steps": 0.5}),
        ((1, 1, 1), {"period": 1, "physical_damping": -1}),
        ((np.eye(2), np.eye(2), np.eye(2)), {"period": 1, "physical_damping": np.eye(3)}),
        ((np.eye(2), np.array([[1, 1], [0, 1]]), np.eye(2)), {"period": 1}),
    ],
)
def test_bad_questions_are_refused(arguments, options):
    with pytest.raises(InputError):
        sampled_stability(*arguments, **options)


# passivity --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stiffness", "damping", "period", "needed"),
    [(1000, 0, 1e-3, 0.5), (1000, 0.5, 1e-3, 1.0), (1000, -0.5, 1e-3, 1.0), (300, 2, 0.01, 3.5)],
)
def test_colgate_and_schenkel(stiffness, damping, period, needed):
    verdict = sampled_passivity(stiffness, damping, period=period)
    assert verdict.values["required_damping"] == pytest.approx(needed, rel=1e-12)
    assert verdict.margin == pytest.approx(-needed)
    assert verdict.status == "disproved"
    for share in (0.99, 1.01):
        verdict = sampled_passivity(stiffness, damping, period=period, physical_damping=share * needed)
        assert verdict.status == ("proved" if share > 1 else "disproved")


@pytest.mark.parametrize("steps", [1, 2, 5])
def test_a_late_spring_needs_its_delay_more(steps):
    """K (T/2 + delay) for whole periods."""
    verdict = sampled_passivity(1000, 0, period=1e-3, delay=steps * 1e-3)
    assert verdict.values["required_damping"] == pytest.approx(0.5 + steps, rel=1e-9)


def test_the_general_condition_at_each_frequency():
    """T/2 · 1/(1 − cos ωT) · Re{(1 − e^{−jωT}) H(e^{jωT})}, as printed, for two periods of delay."""
    period, stiffness, damping = 2e-3, 700.0, 1.3
    angles = np.linspace(0.01, math.pi, 500)
    z = np.exp(1j * angles)
    transfer = (stiffness + damping * (1 - 1 / z) / period) / z**2
    printed = period / 2 / (1 - np.cos(angles)) * ((1 - 1 / z) * transfer).real
    np.testing.assert_allclose(
        required_damping(stiffness * period, damping, 2.0, angles), printed, rtol=1e-10
    )
    found = sampled_passivity(stiffness, damping, period=period, delay=2 * period).values["required_damping"]
    slow = stiffness * 2.5 * period - damping
    assert found == pytest.approx(max(printed.max(), slow), rel=1e-4)


def most_energy(k, b, d, period, delay, *, periods=40, pieces=20):
    """Largest energy that any hand motion can draw in a while, over its ∫v² dt: an eigenvalue.

    The velocity is constant on `pieces` pieces of each period, zero outside; the work is a quadratic form of it.
    """
    n = periods * pieces
    h = period / pieces
    place = np.tril(np.ones((n + 1, n)), -1) * h  # x at the corners
    force = np.zeros((n, n))
    for i in range(n):
        sample = math.floor((i + 0.5) / pieces - delay / period)
        if sample >= 0:
            now, before = place[sample * pieces], place[max(sample - 1, 0) * pieces]
            force[i] = -k * now - b * (now - before) / period
    work = h * force - d * h * np.eye(n)
    return np.linalg.eigvalsh(0.5 * (work + work.T))[-1] / h


@pytest.mark.parametrize(
    ("stiffness", "damping", "delay"),
    [(1000, 0, 0), (1000, 0.5, 0), (1000, 0.5, 5e-4), (1000, -0.2, 3e-4), (0, 1, 1.5e-3), (1000, 0.5, 1e-3)],
)
def test_no_motion_at_all_draws_energy_with_the_damping_required(stiffness, damping, delay):
    """Over all piecewise constant velocities, delays between samples included; and some do with less."""
    needed = sampled_passivity(stiffness, damping, period=1e-3, delay=delay).values["required_damping"]
    assert most_energy(stiffness, damping, needed, 1e-3, delay) <= 1e-9
    assert most_energy(stiffness, damping, 0.9 * needed, 1e-3, delay) > 0


@settings(max_examples=40, deadline=None)
@given(
    stiffness=st.floats(0, 2000),
    damping=st.floats(-2, 2),
    delay=st.floats(0, 3e-3),
    of_force=st.floats(1e-3, 1e3),
)
def test_the_hand_draws_energy_exactly_where_it_is_not_passive(stiffness, damping, delay, of_force):
    """And the law as it is written, at small steps, gives the same energy; forces in other units change nothing."""
    if stiffness < 1 and abs(damping) < 1e-3:
        return
    needed = sampled_passivity(stiffness, damping, period=1e-3, delay=delay).values["required_damping"]
    for share in (0.9, 1.1):
        wall = of_force * stiffness, of_force * damping
        friction = of_force * share * needed
        verdict = sampled_passivity(*wall, period=1e-3, delay=delay, physical_damping=friction)
        assert verdict.status == ("proved" if share > 1 else "disproved")
        if share < 1:
            assert isinstance(verdict.witness, CounterExample)
            _, state = verdict.witness.replay()
            assert verdict.witness.energy_gained > 0
            assert state[-1, -1] == pytest.approx(verdict.witness.energy_gained, rel=1e-6)


def test_commuting_matrices_by_their_directions():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    k, b = np.array([1000, 500, 10.0]), np.array([0.5, -0.2, 0.01])
    verdict = sampled_passivity(
        turn @ np.diag(k) @ turn.T, turn @ np.diag(b) @ turn.T, period=1e-3, delay=7e-4
    )
    alone = [
        sampled_passivity(*gains, period=1e-3, delay=7e-4).values["required_damping"]
        for gains in zip(k, b, strict=True)
    ]
    assert verdict.values["exact"]
    np.testing.assert_allclose(
        turn.T @ verdict.values["required_damping"] @ turn, np.diag(alone), rtol=1e-9, atol=1e-9
    )


def test_matrices_that_do_not_commute():
    """Without delay and with B ⪰ 0, K T/2 + B is exact; late it is an upper bound, and says so."""
    stiffness, damping = np.array([[1000, 200], [200, 500.0]]), np.diag([1, 2.0])
    needed = stiffness * 5e-4 + damping
    verdict = sampled_passivity(stiffness, damping, period=1e-3, physical_damping=1.001 * needed)
    assert verdict.status == "proved"
    assert verdict.values["exact"]
    np.testing.assert_allclose(verdict.values["required_damping"], needed)
    less = needed - 0.01 * np.eye(2)
    assert sampled_passivity(stiffness, damping, period=1e-3, physical_damping=less).status == "disproved"
    late = sampled_passivity(stiffness, damping, period=1e-3, delay=4e-4, physical_damping=3.0)
    assert late.status == "proved"
    assert not late.values["exact"]


def test_several_walls_at_once():
    verdict = sampled_passivity([1000, 2000], [0.5, 0], period=1e-3, physical_damping=2)
    np.testing.assert_allclose(verdict.values["required_damping"], [1, 1])
    assert verdict.status == "proved"


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ((1, 1), {"period": 0}),
        ((-1, 1), {"period": 1}),
        ((1, np.nan), {"period": 1}),
        ((1, 1), {"period": 1, "delay": -1}),
        ((np.eye(2), 1), {"period": 1}),
        ((1, 1), {"period": 1, "physical_damping": -1}),
        (([1, 2], [1, 2, 3]), {"period": 1}),
    ],
)
def test_bad_walls_are_refused(arguments, options):
    with pytest.raises(InputError):
        sampled_passivity(*arguments, **options)


# Z-width ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
def test_the_map_is_the_verdict_at_each_point(way):
    found = z_width(0.8, period=2e-3, **way)
    assert found.stable.shape == (200, 200)
    rng = np.random.default_rng(0)
    for row, column in rng.integers(1, 200, size=(25, 2)):
        radius = sampled_stability(
            0.8, found.stiffness[column], found.damping[row], period=2e-3, **way
        ).values["spectral_radius"]
        assert found.spectral_radius[row, column] == pytest.approx(radius, abs=1e-5)
        if abs(radius - 1) > 1e-6:
            assert found.stable[row, column] == (radius < 1)


@pytest.mark.parametrize("way", WAYS)
def test_the_edge_has_a_root_on_the_circle_and_the_largest_is_largest(way):
    found = z_width(0.8, period=2e-3, **way)
    edge = found.edge[np.isfinite(found.edge).all(axis=1)][::200]
    for stiffness, damping in edge:
        if damping >= 0:
            radius = sampled_stability(0.8, stiffness, damping, period=2e-3, **way).values["spectral_radius"]
            assert radius == pytest.approx(1, abs=1e-6)
    stiffest = found.stiffness[found.stable.any(axis=0)].max()
    assert stiffest <= found.largest[0] <= stiffest + 2 * np.diff(found.stiffness)[0]


def test_exact_velocity_has_the_triangle():
    """ZOH1 again: K T/2 < B < 2 m/T, so the tip is at K = 4 m/T²."""
    found = z_width(1.0, period=1e-3, velocity="exact")
    np.testing.assert_allclose(found.largest, [4e6, 2e3], rtol=1e-4)
    k, b = np.meshgrid(found.stiffness, found.damping)
    inside = (k * 5e-4 < b * (1 - 1e-9)) & (b < 2e3 * (1 - 1e-9)) & (k > 0)
    np.testing.assert_array_equal(found.stable[:, 1:], inside[:, 1:])


def test_passive_gains_are_stable():
    for steps in (0, 2):
        found = z_width(1.0, period=1e-3, physical_damping=40.0, delay_steps=steps)
        assert found.passive.any()
        inside = found.passive[:, 1:]
        assert found.stable[:, 1:][inside].all()


def test_passive_damping_is_that_of_one_wall():
    found = passive_damping(np.array([1000.0, 500.0]), np.array([0.5, -0.3]), 1e-3, 2)
    for index, gains in enumerate(((1000, 0.5), (500, -0.3))):
        alone = sampled_passivity(*gains, period=1e-3, delay=2e-3).values["required_damping"]
        assert found[index] == pytest.approx(alone, rel=1e-4)


def test_the_figure_has_both_edges():
    figure = z_width(1.0, period=1e-3, physical_damping=40.0).plot()
    legend = figure.axes[0].get_legend()
    assert legend is not None
    texts = [text.get_text() for text in legend.get_texts()]
    assert any("edge" in text for text in texts)
    assert any("passive" in text for text in texts)


@pytest.mark.parametrize(
    "options",
    [
        {"period": 0},
        {"period": 1, "stiffness": [2, 1]},
        {"period": 1, "stiffness": [-1, 1]},
        {"period": 1, "damping": [1]},
        {"period": 1, "velocity": "?"},
        {"period": 1, "physical_damping": -1},
    ],
)
def test_bad_maps_are_refused(options):
    with pytest.raises(InputError):
        z_width(1.0, **options)
