"""Periodic gains: multipliers, boundaries of Mathieu's and Meissner's equations, and counter-examples that grow."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.optimize import brentq
from scipy.special import mathieu_a, mathieu_b

from vic_toolbox.errors import InputError
from vic_toolbox.stability import CounterExample
from vic_toolbox.stability.schedules.floquet import floquet, multipliers
from vic_toolbox.stability.schedules.free_motion import FreeMotion
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping

PERIOD = 2 * np.pi


def wave(t: float) -> float:
    return 12 + 10 * np.sin(t)


def test_kb2():
    """Case KB2: spectral radius 1.273093, det Φ = 0.533488."""
    verdict = floquet(10, wave, 1, period=PERIOD)
    assert verdict.status == "disproved"
    assert verdict.values["spectral_radius"] == pytest.approx(1.273093, abs=5e-7)
    assert verdict.values["determinant"] == pytest.approx(0.533488, abs=5e-7)
    assert verdict.values["determinant"] == pytest.approx(verdict.values["liouville"], rel=1e-9)
    assert isinstance(verdict.witness, CounterExample)
    time, state = verdict.witness.replay()
    np.testing.assert_allclose(state, verdict.witness.state, atol=1e-6 * np.abs(state).max())
    assert verdict.witness.growth > 2
    phi = verdict.values["monodromy"]
    steps = len(time[time <= time[0] + PERIOD + 1e-9]) - 1
    np.testing.assert_allclose(phi @ state[0], state[steps], rtol=1e-6)


def test_kb2_smallest_damping():
    """Case KB2-d, exact: 1.805194."""
    found = smallest_damping(floquet, 10, wave, period=PERIOD, tolerance=2e-7)
    assert found == pytest.approx(1.805194, abs=1e-6)


@pytest.mark.parametrize(
    ("low", "high", "known", "exact"),
    [
        (-0.6, -0.3, -0.4551386, mathieu_a(0, 1)),
        (-0.2, 0.2, -0.1102488, mathieu_b(1, 1)),
        (1.7, 2.0, 1.8591081, mathieu_a(1, 1)),
    ],
)
def test_mathieu_boundaries(low: float, high: float, known: float, exact: float):
    """Case MAT: x″ + (a − 2 cos 2t) x = 0 changes between bounded and growing at these a."""

    def half_trace(a: float) -> float:
        motion = FreeMotion.given(1, lambda t: a - 2 * np.cos(2 * t), 0, stop=np.pi)
        trace = np.trace(multipliers(motion).scaled)
        return abs(trace) - 2

    found: Any = brentq(half_trace, low, high, xtol=1e-10)
    assert found == pytest.approx(known, abs=5e-8)
    assert found == pytest.approx(exact, abs=1e-8)
    below = floquet(1, lambda t: found - 1e-3 - 2 * np.cos(2 * t), 0, period=np.pi).status
    above = floquet(1, lambda t: found + 1e-3 - 2 * np.cos(2 * t), 0, period=np.pi).status
    assert {below, above} == {"proved", "disproved"}


def test_gains_that_jump():
    """Case SW1 as a schedule: √2 in each half cycle (Meissner)."""
    inward, outward = np.pi / 2 / np.sqrt(2), np.pi / 2
    whole = inward + outward
    verdict = floquet(1, lambda t: 2.0 if t % whole < inward else 1.0, 0, period=whole)
    assert verdict.status == "disproved"
    assert verdict.values["spectral_radius"] == pytest.approx(np.sqrt(2), abs=1e-8)


@settings(max_examples=15)
@given(k=st.floats(0.1, 50), d=st.floats(0.05, 5), m=st.floats(0.2, 5), period=st.floats(0.2, 4))
def test_constant_gains_have_the_multipliers_of_their_poles(k: float, d: float, m: float, period: float):
    verdict = floquet(m, k, d, period=period)
    poles = np.roots([m, d, k])
    assert verdict.status == "proved"
    assert verdict.values["spectral_radius"] == pytest.approx(np.exp(poles.real.max() * period), rel=1e-8)
    a = np.array([[0, 1], [-k / m, -d / m]])
    np.testing.assert_allclose(verdict.values["monodromy"], expm(a * period), atol=1e-8 * (1 + k))


def turning(speed: float) -> Callable[[float], np.ndarray]:
    def stiffness(t: float) -> np.ndarray:
        c, s = np.cos(speed * t), np.sin(speed * t)
        turn = np.array([[c, -s], [s, c]])
        return turn @ np.diag([1.0, 3.0]) @ turn.T

    return stiffness


def test_a_turning_spring_is_a_constant_system_in_turning_axes():
    """K(t) = R diag(1, 3) Rᵀ: in the turning axes ë + 2 S ė + (S² + K) e = 0 has constant poles."""
    for speed, status in ((0.3, "proved"), (1.3, "disproved")):
        spin = np.array([[0, -speed], [speed, 0]])
        damping = 0.02
        a = np.zeros((4, 4))
        a[:2, 2:] = np.eye(2)
        a[2:, :2] = -(spin @ spin + np.diag([1.0, 3.0]) + damping * spin)
        a[2:, 2:] = -2 * spin - damping * np.eye(2)
        period = np.pi / speed
        growth = np.exp(np.linalg.eigvals(a).real.max() * period)
        verdict = floquet(np.eye(2), turning(speed), damping * np.eye(2), period=period)
        assert verdict.values["spectral_radius"] == pytest.approx(growth, rel=1e-7)
        assert verdict.status == status


def test_complex_multipliers_that_grow():
    """A damper with a skew partner: two axes turn and grow; the counter-example is seen to grow all the same."""

    def stiffness(t: float) -> np.ndarray:
        return np.diag([1.0 + 0.9 * np.sin(2.05 * t), 1.3 + 0.9 * np.cos(2.05 * t)]) + 0.2 * np.cos(
            2.05 * t
        ) * np.ones((2, 2))

    verdict = floquet(np.eye(2), stiffness, 0.02 * np.eye(2), period=2 * np.pi / 2.05)
    assert verdict.status == "disproved"
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.growth > 1
    assert np.linalg.norm(verdict.witness.replay()[1][-1]) > np.linalg.norm(verdict.witness.state[0])


def test_the_border_is_inconclusive():
    assert floquet(1, 0, 1, period=1).status == "inconclusive"  # a mass and a damper stay where they are
    assert floquet(1, 0, 0, period=1).status == "inconclusive"  # a free mass drifts
    assert floquet(np.eye(2), np.eye(2), 0 * np.eye(2), period=1).status == "inconclusive"
    assert floquet(1, 2, 0, period=1).status == "proved"  # bounded for ever


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_change_no_verdict(factor: float):
    def scaled(t: float) -> float:
        return factor * wave(t)

    for damping in (1.0, 1.8, 1.81):
        one, other = (
            floquet(10, wave, damping, period=PERIOD),
            floquet(10 * factor, scaled, damping * factor, period=PERIOD),
        )
        assert one.status == other.status
        assert one.values["spectral_radius"] == pytest.approx(other.values["spectral_radius"], rel=1e-8)
    slow = floquet(10, lambda t: wave(factor * t) * factor**2, factor, period=PERIOD / factor)
    assert slow.values["spectral_radius"] == pytest.approx(1.273093, abs=5e-7)


@pytest.mark.parametrize(
    ("arguments", "period", "text"),
    [
        ((1, wave, 1), 0, "period"),
        ((1, wave, 1), -1, "period"),
        ((1, wave, 1), 3.0, "period"),
        ((1, lambda t: np.nan, 1), 1, "finite"),
        ((1, lambda t: [[1, 2], [0, 1]], np.eye(2)), 1, "not symmetric"),
        ((0, 1, 1), 1, "positive definite"),
        ((1, 1, lambda t: -1.0), 1, "positive semidefinite"),
        ((np.eye(2), 1, np.eye(2)), 1, "sizes differ"),
    ],
)
def test_bad_input_is_refused(arguments: tuple, period: float, text: str):
    with pytest.raises(InputError, match=text):
        floquet(*arguments, period=period)


def test_integrators_that_disagree_prove_nothing(monkeypatch: pytest.MonkeyPatch):
    """A lie of the second integrator turns a proof into no answer."""
    honest = FreeMotion.integrated

    def lying(self: FreeMotion, t: np.ndarray, *, method: str, rtol: float) -> np.ndarray:
        return honest(self, t, method=method, rtol=rtol) * (3.0 if method == "LSODA" else 1.0)

    monkeypatch.setattr(FreeMotion, "integrated", lying)
    assert floquet(10, wave, 3, period=PERIOD).status == "inconclusive"


def test_a_motion_that_cannot_be_integrated_is_no_answer(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("vic_toolbox.stability.schedules.free_motion.EVALUATIONS", 200)
    verdict = floquet(10, wave, 3, period=PERIOD)
    assert verdict.status == "inconclusive"
    assert "given up" in verdict.reason
