"""Gains that are held and jump: energy to the joule, exact growth, and certificates for jumps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import InputError
from vic_toolbox.stability import Certificate, CounterExample
from vic_toolbox.stability.schedules.held_gains import held_gains

INWARD, OUTWARD = np.pi / 2 / np.sqrt(2), np.pi / 2
SWITCHED = [0.0, INWARD, INWARD + OUTWARD]


def test_sw1():
    """Case SW1: k = 2 moving in, 1 moving out: √2 in velocity for each half cycle, energy doubled."""
    verdict = held_gains(1, [2, 1, 2], 0, time=SWITCHED)
    assert verdict.status == "disproved"
    assert verdict.values["spectral_radius"] == pytest.approx(np.sqrt(2), rel=1e-12)
    assert isinstance(verdict.witness, CounterExample)
    start, end = verdict.witness.state[0], verdict.witness.state[256]
    assert np.linalg.norm(end) == pytest.approx(np.sqrt(2) * np.linalg.norm(start), rel=1e-9)
    assert verdict.values["injected_energy"] == pytest.approx(verdict.witness.energy[0], rel=1e-9)
    np.testing.assert_allclose(verdict.witness.replay()[1], verdict.witness.state, rtol=1e-8, atol=1e-9)


def test_a_step_of_stiffness():
    """Case TNK: 100 to 500 N/m at 0.1 m puts in ½ ΔK e² = 2 J."""
    verdict = held_gains(1, [100, 500], [4, 4], time=[0, 0.1], error=[0.1, 0.1], error_rate=[0, 0])
    np.testing.assert_allclose(verdict.values["injected"], [0, 2])
    assert verdict.values["largest_injection_time"] == 0.1
    assert verdict.values["lowest_balance"] == pytest.approx(-2)
    assert verdict.status == "inconclusive"


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), d=st.integers(1, 3), n=st.integers(2, 12))
def test_the_account_closes(seed: int, d: int, n: int):
    """Energy at the end = energy at the start + what the jumps put in − what the damping takes (by quadrature)."""
    rng = np.random.default_rng(seed)
    k = np.exp(rng.uniform(0, 2, n))[:, None, None] * np.eye(d)
    b = np.exp(rng.uniform(-2, 0, n))[:, None, None] * np.eye(d)
    coarse = np.cumsum(rng.uniform(0.1, 0.6, n))
    # the same holds seen at many more samples, along a motion of the system
    fine = np.concatenate([np.linspace(s, e, 200, endpoint=False) for s, e in pairwise(coarse)])
    fine = np.append(fine, coarse[-1])
    which = np.searchsorted(coarse, fine + 1e-12) - 1
    verdict = held_gains(np.eye(d), k[which], b[which], time=fine)
    start = held_gains(np.eye(d), k, b, time=coarse)
    assert start.values["injected_energy"] == pytest.approx(
        verdict.values["injected_energy"], rel=1e-6, abs=1e-9
    )
    assert verdict.values["dissipated_energy"] >= -1e-9
    gain = verdict.values.get("energy_gain")
    if gain is not None:
        assert gain == pytest.approx(start.values["energy_gain"], rel=1e-7)


def test_recorded_motion_is_accounted_for():
    """A motion e = cos t of m = k = 1: a stiffness that steps up where e is large and down where it is zero."""
    t = np.linspace(0, np.pi, 2001)
    e, rate = np.cos(t), -np.sin(t)
    stiffness = np.where(t < np.pi / 2, 1.0, 3.0)
    verdict = held_gains(1, stiffness, 0.2, time=t, error=e, error_rate=rate)
    assert verdict.values["injected_energy"] == pytest.approx(0, abs=1e-5)
    assert verdict.values["dissipated_energy"] == pytest.approx(0.2 * np.pi / 2, rel=1e-6)
    stiffness[-1] = 5.0
    verdict = held_gains(1, stiffness, 0.2, time=t, error=e, error_rate=rate)
    assert verdict.values["injected_energy"] == pytest.approx(1.0, abs=1e-5)
    assert np.isnan(held_gains(1, stiffness, 0.2, time=t, error=e).values["dissipated_energy"])


def test_falling_stiffness_is_proved():
    verdict = held_gains(1, [9, 5, 5, 2], [3, 2, 2, 1], time=[0, 1, 2, 3])
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)
    assert verdict.values["alpha"] == 0
    assert verdict.values["alpha_max"] == pytest.approx(1, rel=1e-8)


def test_rising_stiffness_needs_falling_damping():
    """ΔK = 1 with ΔD = −2 asks for α ≥ ½."""
    verdict = held_gains(1, [4, 5], [4, 2], time=[0, 1])
    assert verdict.status == "proved"
    assert verdict.values["alpha"] == pytest.approx(0.5, rel=1e-9)
    assert held_gains(1, [4, 5], [4, 4], time=[0, 1]).status == "inconclusive"


@pytest.mark.parametrize(("damping", "status"), [(0.2, "disproved"), (0.4, "proved")])
def test_repeated_jumps_with_damping(damping: float, status: str):
    verdict = held_gains(1, [2, 1, 2], damping, time=SWITCHED)
    assert verdict.status == status
    if status == "disproved":
        assert isinstance(verdict.witness, CounterExample)
        end = verdict.witness.replay()[1][-1]
        assert np.linalg.norm(end) > np.linalg.norm(verdict.witness.state[0])


def test_a_finely_held_schedule_tends_to_the_smooth_one():
    t = np.append(np.arange(0, 2 * np.pi, 0.005), 2 * np.pi)
    verdict = held_gains(10, 12 + 10 * np.sin(t), 1, time=t)
    assert verdict.status == "disproved"
    assert verdict.values["spectral_radius"] == pytest.approx(1.273093, abs=1e-5)


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_change_no_verdict(factor: float):
    for damping in (0.0, 0.2, 0.4):
        one = held_gains(1, [2, 1, 2], damping, time=SWITCHED)
        other = held_gains(factor, np.array([2, 1, 2]) * factor, damping * factor, time=SWITCHED)
        assert one.status == other.status
        assert one.values["spectral_radius"] == pytest.approx(other.values["spectral_radius"], rel=1e-9)


def test_a_spring_without_stiffness_along_some_direction():
    """Turned axes leave rounding where there is none: the gain of energy has no bound, and the round still closes."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    k = (turn * [1.0, 0.0, 2.0]) @ turn.T
    k = 0.5 * (k + k.T)
    growing_ = held_gains(np.eye(3), np.stack([k, 2 * k]), 0.1 * np.eye(3), time=[0, 1])
    assert growing_.status == "inconclusive"
    assert growing_.values["energy_gain"] == np.inf
    closed = held_gains(np.eye(3), np.stack([k, 2 * k, k * (1 + 1e-15)]), 0.1 * np.eye(3), time=[0, 1, 2])
    assert "spectral_radius" in closed.values


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="error has shape"):
        held_gains(1, [1, 2], 1, time=[0, 1], error=[1, 2, 3])
    with pytest.raises(InputError, match="without error"):
        held_gains(1, [1, 2], 1, time=[0, 1], error_rate=[1, 2])
    with pytest.raises(InputError, match="mass changes"):
        held_gains([1, 2], [1, 2], 1, time=[0, 1])
    with pytest.raises(InputError, match="as many"):
        held_gains(1, [1, 2], 1, time=[0, 1, 2])


def test_too_many_oscillations_are_no_answer():
    verdict = held_gains(1, [1e6, 1e9, 1e6], 0, time=[0, 100, 2000])
    assert verdict.status == "inconclusive"
    assert "oscillations" in verdict.reason
