"""Ports: known indices, the classic example, and the environment that destabilises what is not passive."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import InputError
from vic_toolbox.stability.environments.port_passivity import port_passivity
from vic_toolbox.stability.environments.positive_real import positive_real, rational
from vic_toolbox.stability.verdict import CounterExample, Verdict


def two_masses(gain: float, *, first: float = 1.0, second: float = 1.0, stiffness: float = 1.0):
    """CH: velocity over force of two masses with a spring, the first driven by `gain` times the measured force."""
    return control.tf(
        [first, 0, stiffness * (1 + gain)], [first * second, 0, stiffness * (first + second), 0]
    )


def shown(verdict: Verdict) -> CounterExample:
    assert verdict.status == "disproved"
    assert isinstance(verdict.witness, CounterExample)
    return verdict.witness


def coupled_poles(system, environment) -> np.ndarray:
    """Poles of an admittance with a spring, a damper and a mass in parallel, by polynomials."""
    top, bottom = system.num[0][0], system.den[0][0]
    outer = [environment.get(name, 0.0) for name in ("mass", "damping", "stiffness")]
    return np.asarray(np.roots(np.polyadd(np.polymul(bottom, [1, 0]), np.polymul(top, outer))))


def test_known_indices():
    """PI: (s + 2)/(s + 1)."""
    verdict = port_passivity(control.tf([1, 2], [1, 1]))
    assert verdict.status == "proved"
    assert verdict.values["input_passivity_index"] == pytest.approx(1, abs=1e-12)
    assert verdict.values["output_passivity_index"] == pytest.approx(0.5, abs=1e-12)


@settings(max_examples=40, deadline=None)
@given(a=st.floats(0.1, 10), b=st.floats(0.1, 10), gain=st.floats(0.1, 10))
def test_indices_of_a_lead(a, b, gain):
    """κ (s + a)/(s + b): ν = κ min(1, a/b), ρ = min(1, b/a)/κ."""
    verdict = port_passivity(control.tf([gain, gain * a], [1, b]))
    assert verdict.values["input_passivity_index"] == pytest.approx(gain * min(1, a / b), rel=1e-6)
    assert verdict.values["output_passivity_index"] == pytest.approx(min(1, b / a) / gain, rel=1e-6)


@pytest.mark.parametrize(("first", "second", "stiffness"), [(1, 1, 1), (3, 2, 500), (0.2, 1.5, 1e4)])
def test_a_force_gain_is_passive_up_to_the_ratio_of_the_masses(first, second, stiffness):
    """CH: passive iff G ≤ m₁/m₂."""
    ratio = first / second
    for share in (0.2, 0.9, 0.999, 1.0, 1.001, 1.1, 3.0):
        verdict = port_passivity(two_masses(share * ratio, first=first, second=second, stiffness=stiffness))
        assert verdict.status == ("proved" if share <= 1 else "disproved")


def test_the_springs_that_destabilise_it():
    """CH: at G = 2 k_e ∈ (0.535898, 7.464102) = 4 ± √12."""
    verdict = port_passivity(two_masses(2))
    np.testing.assert_allclose(verdict.values["destabilising_stiffness"], [[0.535898, 7.464102]], atol=5e-7)
    assert 0.535898 < shown(verdict).environment["stiffness"] < 7.464102
    assert shown(verdict).growth > 50
    _, state = shown(verdict).replay()
    assert np.linalg.norm(state[-1]) > 50 * np.linalg.norm(state[0])
    for stiffness, stable in ((0.5358, True), (0.536, False), (7.464, False), (7.4642, True)):
        poles = coupled_poles(two_masses(2), {"stiffness": stiffness})
        assert (np.real(poles).max() < 1e-6) == stable


def test_an_impedance_is_the_same_port_seen_the_other_way():
    verdict = port_passivity(control.tf([1, 0, 2, 0], [1, 0, 3]), port="impedance")
    np.testing.assert_allclose(verdict.values["destabilising_stiffness"], [[0.535898, 7.464102]], atol=5e-7)
    assert verdict.status == "disproved"
    assert shown(verdict).environment.keys() == {"stiffness"}
    spring_damper = control.tf([3.0, 20.0], [1, 0])
    assert port_passivity(spring_damper, port="impedance").status == "proved"


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), order=st.integers(1, 4))
def test_a_port_is_passive_or_an_environment_shows_that_it_is_not(seed, order):
    """Random stable ports: the verdict against a sweep, and the witness against polynomials."""
    rng = np.random.default_rng(seed)
    poles = -rng.uniform(0.1, 3, order) + 1j * 0
    if order > 1:
        poles[:2] = poles[0].real + np.array([1j, -1j]) * rng.uniform(0, 4)
    top = np.real(np.poly(-rng.uniform(-0.3, 3, order - 1))) if order > 1 else np.ones(1)
    bottom = np.real(np.poly(poles))
    system = control.tf(np.atleast_1d(top), bottom)
    w = np.geomspace(1e-4, 1e4, 4001)
    response = np.polyval(np.atleast_1d(top), 1j * w) / np.polyval(bottom, 1j * w)
    least = (response.real / np.abs(response)).min()
    assume(abs(least) > 1e-3)
    verdict = port_passivity(system)
    if least > 0:
        assert verdict.status == "proved"
    else:
        assert verdict.status == "disproved"
        assert verdict.values["input_passivity_index"] <= response.real.min() + 1e-9
        poles = coupled_poles(system, shown(verdict).environment)
        assert np.real(poles).max() > 0
        _, state = shown(verdict).replay()
        assert np.linalg.norm(state[-1]) > np.linalg.norm(state[0])


def test_a_resonance_that_only_a_damped_spring_finds():
    """Re G < 0 in a narrow band: no spring alone, no mass alone, but both with a damper."""
    system = control.tf([1 - 0.25, 0.2 - 0.25, 9], np.polymul([1, 1], [1, 0.2, 9]))
    verdict = port_passivity(system)
    assert verdict.values["input_passivity_index"] < 0
    assert verdict.status == "disproved"
    assert np.real(coupled_poles(system, shown(verdict).environment)).max() > 0


@pytest.mark.parametrize(("of_mass", "of_rate"), [(1e-3, 1.0), (1e3, 1e-2), (1.0, 1e3)])
@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_units_change_no_verdict(of_mass, of_rate, gain):
    verdict = port_passivity(two_masses(gain))
    stiffness = of_mass * of_rate**2
    scaled = port_passivity(two_masses(gain, first=of_mass, second=of_mass, stiffness=stiffness))
    assert scaled.status == verdict.status
    np.testing.assert_allclose(
        scaled.values["destabilising_stiffness"],
        verdict.values["destabilising_stiffness"] * stiffness,
        rtol=1e-6,
    )


def test_poles_come_first():
    """An unstable port with a healthy Re G(jω) is not passive: it grows with nothing in hand."""
    system = control.tf([4, -8], [1, -1])  # 5 − (s + 3)/(s − 1): Re > 0 on the axis
    verdict = port_passivity(system)
    assert verdict.status == "disproved"
    assert not shown(verdict).environment
    assert verdict.values["input_passivity_index"] == -math.inf


@pytest.mark.parametrize(
    ("top", "bottom", "status"),
    [
        ([1], [1, 0], "proved"),  # a mass
        ([1, 0], [1], "proved"),  # a spring's admittance s/k
        ([2, 1], [1], "proved"),
        ([1], [1, 0, 0], "disproved"),
        ([-1], [1, 0], "disproved"),
        ([1], [1, 1, 1], "disproved"),
        ([1, 0], [1, 1, 1], "proved"),
        ([1, 0, 1], [1, 0, 2, 0], "proved"),  # lossless, poles and zeros alternate
    ],
)
def test_small_ports(top, bottom, status):
    assert port_passivity(control.tf(top, bottom)).status == status


def test_a_state_space_keeps_its_states():
    system = control.ss(two_masses(2))
    verdict = port_passivity(system)
    assert verdict.status == "disproved"
    assert shown(verdict).state.shape[1] == system.nstates + 1


def test_both_routes_find_the_same_least_real_part():
    rng = np.random.default_rng(3)
    for _ in range(20):
        bottom = np.real(np.poly(-rng.uniform(0.2, 2, 3)))
        found = positive_real(rational(rng.normal(size=4), bottom))
        assert found.swept == pytest.approx(found.least, abs=1e-6)


@pytest.mark.parametrize(
    "system",
    [
        [[1.0]],
        control.tf([1], [1, 1], 0.1),
        control.ss(-np.eye(2), np.eye(2), np.eye(2), 0),
        control.tf([0], [1, 1]),
    ],
)
def test_bad_systems_are_refused(system):
    with pytest.raises(InputError):
        port_passivity(system)


def test_an_unknown_port_is_refused():
    with pytest.raises(InputError):
        port_passivity(control.tf([1], [1, 1]), port="both")
