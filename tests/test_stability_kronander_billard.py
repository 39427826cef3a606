"""Kronander and Billard's certificate with the best constant α: known answers, its edges, and what it must not say."""

from __future__ import annotations

import json

import numpy as np
import pytest

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability import Certificate, CounterExample
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping

ROUND = np.linspace(0, 2 * np.pi, 401)
WAVE = 12 + 10 * np.sin(ROUND)


def coupled_schedule(n: int, seed: int = 0) -> tuple[Array, Array, Array]:
    """Smooth full gains with three axes."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 8, n)
    basis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    size = np.array([500, 200, 30.0]) * (
        1 + 0.4 * np.sin(np.outer(t, [0.7, 1.1, 1.6]) + rng.uniform(0, 6, 3))
    )
    k = np.einsum("ij,nj,kj->nik", basis, size, basis)
    d = 30 * np.eye(3) + 3 * np.sin(t)[:, None, None] * np.ones((3, 3))
    return t, 0.5 * (k + np.swapaxes(k, 1, 2)), d


@pytest.mark.parametrize(("mass", "damping", "start"), [(10.0, 1.0, 5.0), (2.0, 3.0, 400.0)])
def test_kb1_exponential_stiffness(mass: float, damping: float, start: float):
    """Case KB1: k₀ exp(γ t) is certified up to γ = 2 d / m."""
    edge = 2 * damping / mass
    t = np.linspace(0, 10 / edge, 801)
    for factor, status in (
        (0.5, "proved"),
        (0.99999, "proved"),
        (1.00001, "inconclusive"),
        (1.5, "inconclusive"),
    ):
        verdict = kronander_billard(mass, start * np.exp(factor * edge * t), damping, time=t)
        assert verdict.status == status
        assert verdict.values["alpha"] == pytest.approx(0.5 * factor * edge, rel=1e-6)
        assert verdict.values["alpha_max"] == pytest.approx(damping / mass, rel=1e-12)
        assert np.sign(verdict.margin) == (1 if factor < 1 else -1)


@pytest.mark.parametrize("samples", [200, 401, 2000])
@pytest.mark.parametrize("closed", [True, False])
def test_kb2_needs_alpha_and_grows(samples: int, closed: bool):
    """Case KB2: needs α = 5/√44, has d/m = 0.1; repeated, the motion grows by 1.273093 per period."""
    t = np.linspace(0, 2 * np.pi, samples, endpoint=closed)
    verdict = kronander_billard(10, 12 + 10 * np.sin(t), 1, time=t)
    assert verdict.status == "disproved"
    assert verdict.values["alpha"] == pytest.approx(5 / np.sqrt(44), abs=5e-7)
    assert verdict.values["alpha_max"] == pytest.approx(0.1, rel=1e-12)
    assert verdict.values["spectral_radius"] == pytest.approx(1.273093, abs=5e-6)
    assert verdict.margin == pytest.approx(0.1 - 5 / np.sqrt(44), abs=5e-7)
    assert np.sin(verdict.values["worst_time"]) == pytest.approx(-10 / 12, abs=1e-3)
    assert isinstance(verdict.witness, CounterExample)
    time, state = verdict.witness.replay()
    assert np.linalg.norm(state[-1]) > 5 * np.linalg.norm(state[0])
    assert np.isfinite(time).all()


def test_kb2_smallest_damping():
    """Case KB2-d, constant α: 7.537784."""
    found = smallest_damping(kronander_billard, 10, WAVE, time=ROUND, tolerance=1e-8)
    assert found == pytest.approx(7.537784, abs=1e-6)


def test_a_schedule_that_does_not_close_is_not_disproved():
    """Finite time disproves nothing: the motion that gains most energy is shown, and no more is said."""
    t = np.linspace(0, 1.4, 400)
    verdict = kronander_billard(10, 12 + 10 * np.sin(t), 1, time=t)
    assert verdict.status == "inconclusive"
    assert verdict.values["energy_gain"] > 1
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.energy[-1] / verdict.witness.energy[0] == pytest.approx(
        verdict.values["energy_gain"], rel=1e-5
    )
    time, state = verdict.witness.replay()
    np.testing.assert_allclose(state, verdict.witness.state, atol=1e-7)
    assert time[-1] == 1.4


@pytest.mark.parametrize("samples", [200, 400, 1000, 10_000])
@pytest.mark.parametrize("length", [2 * np.pi, 10.0])
def test_kb2_to_six_digits_however_it_is_sampled(samples: int, length: float):
    """As samples or as functions of the time."""
    t = np.linspace(0, length, samples)
    verdict = kronander_billard(10, 12 + 10 * np.sin(t), 1, time=t)
    assert verdict.status != "proved"
    assert verdict.values["alpha"] == pytest.approx(5 / np.sqrt(44), abs=5e-7)
    of_time = kronander_billard(10, lambda s: 12 + 10 * np.sin(s), lambda _: 1.0, time=t)
    assert of_time.values["alpha"] == verdict.values["alpha"]


@pytest.mark.parametrize("rate", [0.1999, 0.199999, 0.200001, 0.2001])
@pytest.mark.parametrize("samples", [50, 4000])
def test_kb1_is_exact_on_both_sides(rate: float, samples: int):
    t = np.linspace(0, 10, samples)
    margin = abs(rate - 0.2) > 1e-5 or samples > 1000  # cubics through 50 samples are as exact as that
    verdict = kronander_billard(10, 12 * np.exp(rate * t), 1, time=t)
    if margin:
        assert (verdict.status == "proved") == (rate < 0.2)
    assert verdict.values["alpha"] == pytest.approx(rate / 2, abs=1e-6)


def test_damping_that_changes_counts_with_its_slope():
    """m = 1, k = 100, d = 2 + sin(3 t): α (2 k − ḋ) ≥ 0 needs no α, and α ≤ min d = 1."""
    t = np.linspace(0, 2 * np.pi, 301)
    verdict = kronander_billard(1, 100, 2 + np.sin(3 * t), time=t)
    assert verdict.status == "proved"
    assert verdict.values["alpha"] == 0
    assert verdict.values["alpha_max"] == pytest.approx(1, abs=1e-6)
    # ḋ > 2 k forbids every positive α, and α = 0 serves
    steep = 10 + 5 * np.sin(40 * t[::1])
    fast = np.linspace(0, 2 * np.pi / 40, 301)
    verdict = kronander_billard(1, 90, 10 + 5 * np.sin(40 * fast), time=fast)
    assert verdict.values["alpha"] == 0
    assert verdict.margin == pytest.approx(0, abs=1e-9)
    assert steep.min() > 0


def test_constant_gains_and_the_least_of_them():
    for gains, status in (((10, 5, 1), "proved"), ((10, 5, 0), "proved"), ((10, 0, 1), "proved")):
        assert kronander_billard(*gains, time=[0, 1]).status == status
    assert kronander_billard(10, 0, 0, time=[0, 1]).status != "proved"  # a free mass drifts away


@pytest.mark.parametrize("n", [40, 400])
def test_matrices_agree_with_the_definition(n: int):
    """α and α_max against eigenvalues of every sample; the certificate holds at instants in between."""
    t, k, d = coupled_schedule(n)
    mass = np.array([[4.0, 1, 0], [1, 3, 0.5], [0, 0.5, 2]])
    verdict = kronander_billard(mass, k, d, time=t)
    assert verdict.status == "proved"
    rates = np.gradient(k, t, axis=0, edge_order=2)
    d_rates = np.gradient(d, t, axis=0, edge_order=2)
    needed = max(
        np.linalg.eigvals(np.linalg.solve(2 * a - c, b)).real.max()
        for a, b, c in zip(k, rates, d_rates, strict=True)
    )
    assert verdict.values["alpha"] == pytest.approx(needed, rel=2e-2)
    allowed = min(np.linalg.eigvals(np.linalg.solve(mass, x)).real.min() for x in d)
    assert verdict.values["alpha_max"] == pytest.approx(allowed, rel=1e-3)
    assert isinstance(verdict.witness, Certificate)
    alpha = verdict.witness.values["alpha"]
    assert verdict.values["alpha"] < alpha < verdict.values["alpha_max"]


def test_axes_on_their_own_take_the_fast_path_to_the_same_numbers():
    """Gains turned by a rotation have the same α as the diagonal ones."""
    t = np.linspace(0, 6, 300)
    k = np.stack([300 + 100 * np.sin(t), 50 + 20 * np.cos(2 * t)], axis=1)[:, :, None] * np.eye(2)
    d, mass = np.diag([30.0, 12]), np.diag([3.0, 1])
    turn = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
    alone = kronander_billard(mass, k, d, time=t)
    turned = kronander_billard(turn @ mass @ turn.T, turn @ k @ turn.T, turn @ d @ turn.T, time=t)
    assert alone.status == turned.status == "proved"
    for name in ("alpha", "alpha_max", "worst_time"):
        assert turned.values[name] == pytest.approx(alone.values[name], rel=1e-6)
    np.testing.assert_allclose(
        np.abs(turn.T @ turned.values["worst_direction"]), alone.values["worst_direction"], atol=1e-6
    )


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_change_no_verdict(factor: float):
    """Newton or kilonewton for all, metre or millimetre for one axis: α, margin and verdict stay."""
    t, k, d = coupled_schedule(200)
    mass = np.diag([4.0, 3, 2])
    before = kronander_billard(mass, k, d, time=t)
    scaled = kronander_billard(factor * mass, factor * k, factor * d, time=t)
    one = np.diag([factor, 1.0, 1.0])
    mixed = kronander_billard(one @ mass @ one, one @ k @ one, one @ d @ one, time=t)
    for other in (scaled, mixed):
        assert other.status == before.status
        assert other.margin == pytest.approx(before.margin, rel=1e-6)


def test_jumps_are_not_differentiated():
    t = np.linspace(0, 5, 500)
    verdict = kronander_billard(1, np.where(t < 3, 100.0, 500.0), 5, time=t)
    assert verdict.status == "inconclusive"
    assert "held_gains" in verdict.reason
    np.testing.assert_array_equal(verdict.values["jumps"], [299])


def test_a_mass_that_moves_is_judged_with_its_rate():
    t = np.linspace(0, 3, 200)
    verdict = kronander_billard(2 * (1 + t) ** 2, 500, 3 * (1 + t), time=t)
    assert verdict.status == "proved"
    assert "Ṁ" in verdict.method


def test_long_and_mixed_lengths():
    t = np.linspace(0, 100, 20_000)
    gains = (500 + 100 * np.sin(t))[:, None, None] * np.eye(6)
    gains[:, 0, 1] = gains[:, 1, 0] = 20 * np.cos(t)
    assert kronander_billard(5 * np.eye(6), gains, 40 * np.eye(6), time=t).status == "proved"
    assert (
        kronander_billard(np.tile(5 * np.eye(6), (20_000, 1, 1)), gains, 40 * np.eye(6), time=t).status
        == "proved"
    )


@pytest.mark.parametrize(
    ("mass", "stiffness", "damping", "time", "text"),
    [
        (1, [1, 2, 3], 1, [0, 1], "as many"),
        (1, [1, 2, 3], [1, 2], [0, 1, 2], "numbers of samples"),
        (1, [1, np.nan, 3], 1, [0, 1, 2], "finite"),
        (1, [1, -2, 3], 1, [0, 1, 2], "eigenvalue -2"),
        (1, [1, 2, 3], -1, [0, 1, 2], "eigenvalue -1"),
        (0, [1, 2, 3], 1, [0, 1, 2], "positive definite"),
        (1, [1, 2, 3], 1, [0, 0, 2], "sort"),
        (np.eye(2), [1, 2, 3], 1, [0, 1, 2], "sizes differ"),
        ([[1, 0.5], [0, 1]], np.eye(2), np.eye(2), [0, 1, 2], "not symmetric"),
    ],
)
def test_bad_input_is_refused(mass: object, stiffness: object, damping: object, time: object, text: str):
    with pytest.raises(InputError, match=text):
        kronander_billard(mass, stiffness, damping, time=time)  # pyright: ignore[reportArgumentType]


def test_it_is_written_as_plain_json(tmp_path):
    for damping in (1, 9):
        verdict = kronander_billard(10, WAVE, damping, time=ROUND)
        verdict.save(tmp_path / "verdict.json")
        read = json.loads((tmp_path / "verdict.json").read_text())
        assert read["status"] == verdict.status
        assert read["values"]["alpha"] == pytest.approx(verdict.values["alpha"])
        assert "α" in verdict.summary()
