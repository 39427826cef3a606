"""α(t) by a cone program: the known answer, the ladder, and a solver that is not believed."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability import Certificate
from vic_toolbox.stability.schedules.alpha_program import AlphaProgram
from vic_toolbox.stability.schedules.alpha_schedule import alpha_schedule
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping

pytest.importorskip("clarabel")
ROUND = np.linspace(0, 2 * np.pi, 400)
WAVE = 12 + 10 * np.sin(ROUND)


@pytest.mark.parametrize("closed", [True, False])
def test_kb2_smallest_damping(closed: bool):
    """Case KB2-d, α(t) on a 400-point grid: 4.798."""
    t = np.linspace(0, 2 * np.pi, 400, endpoint=closed)
    found = smallest_damping(alpha_schedule, 10, 12 + 10 * np.sin(t), time=t, tolerance=1e-5)
    assert found == pytest.approx(4.798, abs=1e-3)


def test_the_certificate_is_one():
    """The spline in the witness satisfies the inequalities, written out again."""
    verdict = alpha_schedule(10, WAVE, 5.0, time=ROUND)
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)
    coefficients, h = verdict.witness.values["coefficients"], verdict.witness.values["spacing"]
    from scipy.interpolate import BSpline

    count = len(coefficients)
    knots = h * np.arange(-3, count + 4)
    alpha = BSpline(knots, np.append(coefficients, coefficients[:3]), 3)
    t = np.linspace(0, 2 * np.pi, 7001)[:-1]
    np.testing.assert_allclose(alpha(ROUND[:-1]), verdict.values["alpha"][:-1], rtol=1e-9)
    a, rate, bend = alpha(t), alpha(t, 1), alpha(t, 2)
    k, k_rate = 12 + 10 * np.sin(t), 10 * np.cos(t)
    assert (10 * a <= 5.0).all()
    assert (k_rate + rate * 5 - 2 * a * k - 10 * bend <= 0).all()
    assert (k + 5 * a - 10 * rate - 10 * a**2 > 0).all()
    assert alpha(0) == pytest.approx(alpha(2 * np.pi), rel=1e-9)


def full(n: int, damping: float) -> tuple[Array, Array, Array, Array]:
    rng = np.random.default_rng(3)
    t = np.linspace(0, 2 * np.pi, n)
    basis = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    size = 12 + 9 * np.sin(t[:, None] + rng.uniform(0, 6, 3))
    k = np.einsum("ij,nj,kj->nik", basis, size, basis)
    mass = 10 * np.eye(3) + rng.uniform(-1, 1, (3, 3))
    return t, 0.5 * (mass + mass.T), 0.5 * (k + np.swapaxes(k, 1, 2)), damping * np.eye(3)


def test_matrices():
    """Three coupled axes: α(t) proves what a constant α does not."""
    t, m, k, d = full(150, 5.5)
    assert kronander_billard(m, k, d, time=t).status == "inconclusive"
    verdict = alpha_schedule(m, k, d, time=t)
    assert verdict.status == "proved"
    assert verdict.values["alpha"].shape == (150,)


def test_what_a_constant_alpha_proves_is_proved():
    for gains, damping, time in ((5, 1, [0, 1]), (5, 0, [0, 1]), (WAVE, 7.5378, ROUND)):
        assert kronander_billard(10, gains, damping, time=time).status == "proved"
        assert alpha_schedule(10, gains, damping, time=time).status == "proved"


def test_instability_is_still_shown():
    verdict = alpha_schedule(10, WAVE, 1.0, time=ROUND)
    assert verdict.status == "disproved"
    assert verdict.margin < 0
    assert verdict.values["spectral_radius"] == pytest.approx(1.273093, abs=5e-6)


@pytest.mark.parametrize("factor", [1e-5, 1e5])
def test_units_change_no_verdict(factor: float):
    t, m, k, d = full(100, 5.5)
    one = np.diag([factor, 1.0, 1.0])
    for scale in (1.0, 0.7):
        before = alpha_schedule(m, k, scale * d, time=t)
        mixed = alpha_schedule(one @ m @ one, one @ k @ one, scale * one @ d @ one, time=t)
        slow = alpha_schedule(m, k * factor**2, scale * d * factor, time=t / factor)
        assert before.status == mixed.status == slow.status
        assert mixed.margin == pytest.approx(before.margin, abs=1e-5)


@pytest.mark.parametrize("lie", ["noise", "status", "nan"])
def test_a_solver_that_lies_or_fails_proves_nothing(monkeypatch: pytest.MonkeyPatch, lie: str):
    def lying(self: AlphaProgram) -> tuple[Array | None, float, str]:
        if lie == "status":
            return None, float("nan"), "Clarabel stopped with MaxIterations"
        noise = np.random.default_rng(0).normal(size=self.count)
        return noise if lie == "noise" else np.full(self.count, np.nan), 0.1, ""

    monkeypatch.setattr(AlphaProgram, "solved", lying)
    verdict = alpha_schedule(10, WAVE, 5.0, time=ROUND)
    assert verdict.status == "inconclusive"
    assert ("MaxIterations" if lie == "status" else "does not hold") in verdict.reason


def test_bad_input_is_refused():
    calls: list[tuple[Any, Any, Any, Any, str]] = [
        (1 + ROUND, WAVE, 5, ROUND, "mass changes"),
        (10, WAVE[:-1], 5, ROUND, "as many"),
        (10, -WAVE, 5, ROUND, "eigenvalue"),
    ]
    for mass, stiffness, damping, time, text in calls:
        with pytest.raises(InputError, match=text):
            alpha_schedule(mass, stiffness, damping, time=time)
    with pytest.raises(InputError, match="intervals"):
        alpha_schedule(10, WAVE, 5, time=ROUND, intervals=2)
    jump = alpha_schedule(10, np.where(ROUND < 3, 1.0, 9.0), 5, time=ROUND)
    assert jump.status == "inconclusive"
