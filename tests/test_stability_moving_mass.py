"""Certificates with a mass that moves: the case INR, frames that turn, and C kept or cancelled."""

from __future__ import annotations

import numpy as np
import pytest

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability import Certificate, CounterExample
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.schedules.moving_mass import moving_mass
from vic_toolbox.stability.schedules.smallest_damping import smallest_damping

TIME = np.linspace(0, 10, 500)
MASS = 2 * (1 + TIME) ** 2


def turning(t: Array, speed: float) -> tuple[Array, Array]:
    """M = R diag(1, 3) Rᵀ and a C with Ṁ = C + Cᵀ."""
    c, s = np.cos(speed * t), np.sin(speed * t)
    turn = np.stack([np.stack([c, -s], 1), np.stack([s, c], 1)], 1)
    mass = turn @ np.diag([1.0, 3.0]) @ np.swapaxes(turn, 1, 2)
    spin = np.array([[0, -speed], [speed, 0]])
    return mass, spin @ mass  # Ṁ = S M − M S, and (S M)ᵀ = −M S


def test_inr():
    """Case INR: m = 2 (1 + t)², b = b₀ (1 + t), k = 500 is proved iff b₀ > 2, which is B = ½ Ṁ."""
    for b0, status in ((1.5, "inconclusive"), (1.9999, "inconclusive"), (2.0001, "proved"), (3.0, "proved")):
        verdict = moving_mass(MASS, 500, b0 * (1 + TIME), time=TIME)
        assert verdict.status == status
        lowest = (0.5 * (b0 - 2) / (1 + TIME)).min()
        assert verdict.values["damping_margin"] == pytest.approx(lowest, rel=1e-4)
    assert smallest_damping(moving_mass, MASS, 500, 1 + TIME, time=TIME) == pytest.approx(2, rel=2e-6)
    assert moving_mass(MASS, 500, 1.5 * (1 + TIME), time=TIME).values["energy_gain"] > 1.5


def test_keeping_c_needs_no_such_damping():
    """One axis with C = ½ Ṁ: any damping will do."""
    verdict = moving_mass(MASS, 500, 0.01 * (1 + TIME), time=TIME, coriolis=2 * (1 + TIME))
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)


def test_a_turning_mass():
    """D ⪰ ½ Ṁ for M = R diag(1, 3) Rᵀ: Ṁ has eigenvalues ± 2 ω, so D = d I serves iff d > ω."""
    t = np.linspace(0, 2 * np.pi, 401)
    for speed in (0.5, 1.0):
        mass, coriolis = turning(t, speed)
        edge = smallest_damping(moving_mass, mass, 100 * np.eye(2), np.eye(2), time=t)
        assert edge == pytest.approx(speed, rel=1e-5)
        kept = moving_mass(mass, 100 * np.eye(2), 0.1 * np.eye(2), time=t, coriolis=coriolis)
        assert kept.status == "proved"


def test_a_mass_that_turns_in_tune_with_the_spring_is_disproved():
    """Positive gains and C cancelled: a turning mass pumps energy, and a round of it repeats."""
    found = set()
    for speed in (1.2, 1.5, 1.55, 1.6):
        t = np.linspace(0, np.pi / speed, 301)
        mass, coriolis = turning(t, speed)
        verdict = moving_mass(mass, 4 * np.eye(2), 0.001 * np.eye(2), time=t)
        found.add(verdict.status)
        if verdict.status == "disproved":
            assert isinstance(verdict.witness, CounterExample)
            state = verdict.witness.replay()[1]
            assert np.linalg.norm(state[-1]) > np.linalg.norm(state[0])
            kept = moving_mass(mass, 4 * np.eye(2), 0.001 * np.eye(2), time=t, coriolis=coriolis)
            assert kept.status == "proved"
    assert "disproved" in found


def test_a_constant_mass_is_the_other_method():
    t = np.linspace(0, 2 * np.pi, 400)
    gains = 12 + 10 * np.sin(t)
    one, other = moving_mass(10, gains, 8, time=t), kronander_billard(10, gains, 8, time=t)
    assert one.status == other.status == "proved"
    assert one.margin == other.margin


def test_a_slow_drift_of_the_mass_changes_little():
    """As Ṁ goes to zero the range of α becomes Kronander and Billard's."""
    t = np.linspace(0, 2 * np.pi, 400)
    gains = 12 + 10 * np.sin(t)
    still = kronander_billard(10, gains, 8, time=t)
    moving = moving_mass(10 * (1 + 1e-6 * t), gains, 8, time=t)
    assert moving.values["alpha"] == pytest.approx(still.values["alpha"], rel=1e-3)
    assert moving.values["alpha_max"] == pytest.approx(still.values["alpha_max"], rel=1e-3)


def test_where_no_alpha_serves_it_is_said():
    """Everything breathes together with coupled axes: no α, and a plain answer."""
    t = np.linspace(0, 2 * np.pi, 100)
    mass = np.array([[1.2, 0.1, 0.0], [0.1, 1.1, 0.05], [0.0, 0.05, 1.0]])
    swing = np.sin(t)[:, None, None]
    verdict = moving_mass(mass * (1 + 0.1 * swing), 5 * mass * (1 + 0.5 * swing), 0.3 * mass, time=t)
    assert verdict.status == "inconclusive"
    assert verdict.values["alpha"] == np.inf
    assert np.isnan(verdict.values["alpha_max"])
    assert "no constant α" in verdict.reason


def test_functions_of_the_time_are_sampled():
    verdict = moving_mass(lambda t: 2 * (1 + t) ** 2, 500, lambda t: 2.1 * (1 + t), time=TIME)
    assert verdict.status == "proved"
    assert verdict.margin == moving_mass(MASS, 500, 2.1 * (1 + TIME), time=TIME).margin


@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_units_change_no_verdict(factor: float):
    t = np.linspace(0, 2 * np.pi, 201)
    mass, _ = turning(t, 1.0)
    one = np.diag([factor, 1.0])
    for d in (0.9, 1.1):
        before = moving_mass(mass, 100 * np.eye(2), d * np.eye(2), time=t)
        after = moving_mass(one @ mass @ one, 100 * one @ one, d * one @ one, time=t)
        assert before.status == after.status
        assert after.values["damping_margin"] == pytest.approx(before.values["damping_margin"], rel=1e-5)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="differ from Ṁ"):
        moving_mass(MASS, 500, 3 * (1 + TIME), time=TIME, coriolis=1 + TIME)
    with pytest.raises(InputError, match="coriolis has shape"):
        moving_mass(MASS, 500, 3 * (1 + TIME), time=TIME, coriolis=[1.0, 2.0])
    with pytest.raises(InputError, match="positive definite"):
        moving_mass(MASS - 10, 500, 3 * (1 + TIME), time=TIME)
    jump = moving_mass(np.where(TIME < 3, 1.0, 2.0), 500, 3, time=TIME)
    assert jump.status == "inconclusive"
    assert "jump" in jump.reason
