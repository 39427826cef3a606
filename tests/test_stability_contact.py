"""An arm on an environment: edges against Routh, delays and held loops against simulations, systems to go on with."""

from __future__ import annotations

import math

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox.errors import InputError
from vic_toolbox.stability.environments.axis_crossings import axis_crossings
from vic_toolbox.stability.environments.contact import contact
from vic_toolbox.stability.environments.contact_edges import held_step
from vic_toolbox.stability.environments.contact_loop import ContactLoop, quasipolynomial
from vic_toolbox.stability.environments.delay_loop import rightmost_root, unstable_roots
from vic_toolbox.stability.verdict import CounterExample

FLEXIBLE = {"joint_stiffness": 2e4, "joint_inertia": 0.8, "joint_damping": 3.0}
LOOPS = {
    "filter": {"mass": 5, "damping": 100, "filter_time": 0.02},
    "delay": {"mass": 5, "damping": 100, "filter_time": 0.02, "delay": 0.003},
    "damping control": {"mass": 0, "damping": 60, "delay": 0.01},
    "damping, filter": {"mass": 0, "damping": 60, "stiffness": 20, "filter_time": 0.01, "delay": 0.01},
    "held": {"mass": 5, "damping": 100, "filter_time": 0.02, "period": 0.004},
    "held and late": {"mass": 5, "damping": 100, "filter_time": 0.02, "period": 0.004, "delay": 0.0055},
    "soft": {"mass": 5, "damping": 100, "stiffness": 50, "environment_damping": 4, "filter_time": 0.03},
    "flexible": {"mass": 5, "damping": 60, "filter_time": 0.005, **FLEXIBLE},
    "flexible, late": {"mass": 5, "damping": 60, "filter_time": 0.005, "delay": 0.002, **FLEXIBLE},
    "impedance, late": {"kind": "impedance", "mass": 2, "stiffness": 500, "damping": 40, "delay": 0.004},
    "impedance, held": {"kind": "impedance", "mass": 2, "stiffness": 500, "damping": 40, "period": 0.008},
    "impedance, flexible, late": {
        "kind": "impedance", "mass": 2, "stiffness": 500, "damping": 60, "delay": 0.003, **FLEXIBLE, "joint_damping": 0,
    },
}  # fmt: skip


def numbers(**options) -> ContactLoop:
    kind = options.pop("kind", "admittance")
    loop = ContactLoop(
        kind, float(options.pop("mass")), float(options.pop("stiffness", 0)), float(options.pop("damping", 0))
    )
    from dataclasses import replace

    return replace(loop, **options)


def simulated(loop: ContactLoop, environment: float, *, duration: float, steps: int) -> np.ndarray:
    """Norm of the state in small explicit steps; the force late, and held where there is a period."""
    plant = loop.plant(environment)
    h = duration / steps
    state = np.zeros(len(plant.push))
    state[0] = 1e-4
    path, computed, held = [state], [], 0.0
    late, every = round(loop.delay / h), round(loop.period / h) if loop.period else 1
    for i in range(steps):
        computed.append(-plant.law @ state)
        index = (i - late) // every * every
        held = computed[index] if index >= 0 else 0.0
        rate = plant.dynamics @ state + plant.push * held
        state = state + h * (plant.dynamics @ (state + 0.5 * h * rate) + plant.push * held)
        path.append(state)
    return np.abs(np.array(path)[:, 0])


# known answers ----------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(mass=st.floats(0.1, 50), damping=st.floats(1, 500), filter_time=st.floats(1e-3, 0.1))
def test_admittance_behind_a_filter(mass, damping, filter_time):
    """ADM1: K_e,max = B (M + B t_f)/(M t_f)."""
    verdict = contact(mass, 0, damping, kind="admittance", filter_time=filter_time)
    wanted = damping * (mass + damping * filter_time) / (mass * filter_time)
    assert verdict.values["max_environment_stiffness"] == pytest.approx(wanted, rel=1e-9)
    assert verdict.status == "disproved"


def test_the_printed_case():
    verdict = contact(5, 0, 100, filter_time=0.02)
    assert verdict.values["max_environment_stiffness"] == pytest.approx(7000, abs=1e-6)
    assert contact(5, 0, 100, filter_time=0.02, environment_stiffness=6999).status == "proved"
    assert contact(5, 0, 100, filter_time=0.02, environment_stiffness=7001).status == "disproved"


def test_damping_control_with_a_delay():
    """DLY1: B_min = 2 K_e τ/π = 63.6620, exact, without a Padé approximation."""
    verdict = contact(0, 0, 70, delay=0.01, environment_stiffness=1e4)
    assert verdict.values["minimum_damping"] == pytest.approx(63.6620, abs=5e-5)
    assert verdict.values["minimum_damping"] == pytest.approx(2e2 / math.pi, rel=1e-9)
    assert verdict.values["max_environment_stiffness"] == pytest.approx(70 * math.pi / 0.02, rel=1e-9)
    assert verdict.status == "proved"
    assert verdict.margin == pytest.approx(70 * math.pi / 0.02 - 1e4)
    assert contact(0, 0, 63.66, delay=0.01, environment_stiffness=1e4).status == "disproved"
    assert contact(0, 0, 63.67, delay=0.01, environment_stiffness=1e4).status == "proved"


def test_damping_control_needs_no_mass():
    named = contact(damping=70, delay=0.01, environment_stiffness=1e4)
    assert named.values["minimum_damping"] == pytest.approx(63.6620, abs=5e-5)


def test_a_short_delay_acts_like_a_filter_and_a_short_period_like_half_of_it():
    plain = contact(5, 0, 100, filter_time=0.02).values["max_environment_stiffness"]
    late = contact(5, 0, 100, filter_time=0.02, delay=1e-6).values["max_environment_stiffness"]
    assert late == pytest.approx(plain, rel=1e-3)
    held = contact(5, 0, 100, filter_time=0.02, period=1e-3).values["max_environment_stiffness"]
    late = contact(5, 0, 100, filter_time=0.02, delay=5e-4).values["max_environment_stiffness"]
    assert held == pytest.approx(late, rel=1e-3)


def test_plain_impedance_control_is_stable_on_everything():
    verdict = contact(2, 500, 40, kind="impedance")
    assert verdict.status == "proved"
    assert verdict.values["max_environment_stiffness"] == math.inf
    assert contact(2, 500, 40, kind="impedance", **FLEXIBLE).status == "proved"


def test_nothing_decays_without_damping():
    verdict = contact(2, 500, 0, kind="impedance")
    assert verdict.status == "inconclusive"
    assert verdict.values["max_environment_stiffness"] == 0


def test_a_late_loop_that_holds_nothing_is_disproved_on_everything():
    verdict = contact(2, 500, 60, kind="impedance", delay=0.01, **FLEXIBLE)
    assert verdict.status == "disproved"
    assert verdict.values["max_environment_stiffness"] == 0
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.growth > 5


# edges, by another route ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOOPS)
def test_the_largest_stiffness_separates_decay_from_growth(name):
    """The verdict just below and just above, and a simulation further away."""
    options = LOOPS[name]
    largest = contact(**options).values["max_environment_stiffness"]
    assert 0 < largest < math.inf
    below = contact(**options, environment_stiffness=0.999 * largest)
    above = contact(**options, environment_stiffness=1.001 * largest)
    assert below.status == "proved"
    assert below.margin == pytest.approx(0.001 * largest, rel=1e-6)
    assert above.status == "disproved"
    assert above.margin < 0
    loop = numbers(**options)
    turn = 2 * math.pi / above.values["edge_frequency"]
    for share, grows in ((0.85, False), (1.15, True)):
        decay = contact(**options, environment_stiffness=share * largest).values["decay_rate"]
        duration = max(20 * turn, 3 / abs(decay))
        unit = loop.period / 20 if loop.period else loop.delay / 40 if loop.delay else turn / 2000
        if duration / unit > 60_000:
            continue  # slow growth of a fast loop: the replay of the witness shows it
        path = simulated(loop, share * largest, duration=duration, steps=max(round(duration / unit), 1))
        third = len(path) // 3
        assert (path[-third:].max() > path[third : 2 * third].max()) == grows


@pytest.mark.parametrize("name", LOOPS)
def test_the_bounce_grows_when_replayed(name):
    verdict = contact(**LOOPS[name])
    assert verdict.status == "disproved"
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.environment["stiffness"] > verdict.values["max_environment_stiffness"]
    assert verdict.witness.growth > 5
    assert verdict.witness.energy_gained > 0
    _, state = verdict.witness.replay()
    np.testing.assert_allclose(state, verdict.witness.state, atol=2e-3 * np.abs(verdict.witness.state).max())


@settings(max_examples=25, deadline=None)
@given(name=st.sampled_from(sorted(LOOPS)), of_mass=st.floats(1e-3, 1e3), of_time=st.floats(1e-3, 1e3))
def test_units_change_no_verdict(name, of_mass, of_time):
    """Force and stiffness in other units, time in other units."""
    powers = {
        "mass": (1, 0), "joint_inertia": (1, 0), "stiffness": (1, -2), "joint_stiffness": (1, -2), "damping": (1, -1),
        "environment_damping": (1, -1), "joint_damping": (1, -1), "filter_time": (0, 1), "delay": (0, 1),
        "period": (0, 1),
    }  # fmt: skip
    options = LOOPS[name]
    scaled = {
        key: value * of_mass ** powers[key][0] * of_time ** powers[key][1] if key in powers else value
        for key, value in options.items()
    }
    found, other = contact(**options), contact(**scaled)
    unit = of_mass / of_time**2
    assert other.status == found.status
    wanted = found.values["max_environment_stiffness"] * unit
    assert other.values["max_environment_stiffness"] == pytest.approx(wanted, rel=1e-7)


@pytest.mark.parametrize("name", ["filter", "soft", "flexible", "damping, filter"])
def test_the_polynomials_are_the_determinant(name):
    loop = numbers(**LOOPS[name]).dimensionless()
    plant = loop.plant(1.7)
    characteristic = quasipolynomial(plant, loop.delay)
    for s in (0.3j, 1 + 2j, -0.4 + 0.1j):
        matrix = s * np.eye(len(plant.push)) - plant.dynamics
        matrix = matrix + np.exp(-s * loop.delay) * np.outer(plant.push, plant.law)
        assert complex(characteristic(np.array(s))) == pytest.approx(complex(np.linalg.det(matrix)), rel=1e-9)


def test_roots_on_the_right_are_counted():
    """Against the roots of a high Padé approximation, over many environments."""
    loop = numbers(**LOOPS["flexible, late"]).dimensionless()
    top, bottom = control.pade(loop.delay, 10)
    for environment in np.geomspace(1e-2, 1e2, 25):
        plant = loop.plant(environment)
        own, late, delay = characteristic = quasipolynomial(plant, loop.delay)
        roots = np.roots(np.polyadd(np.polymul(own, bottom), np.polymul(late, top)))
        count = int((roots[np.abs(roots) < 10 / delay].real > 0).sum())
        assert unstable_roots(characteristic) == count
        found = rightmost_root(characteristic, plant.dynamics, -np.outer(plant.push, plant.law))
        assert found is not None
        assert found.real == pytest.approx(roots.real.max(), rel=1e-5, abs=1e-8)


def test_a_held_loop_is_that_of_python_control():
    """Zero-order hold of the cut loop by python-control, whole periods of delay as z⁻ᵈ."""
    loop = numbers(mass=5, damping=100, filter_time=0.02, period=0.004, delay=0.008)
    plant = loop.plant(3000.0)
    sampled = control.c2d(control.ss(plant.dynamics, plant.push[:, None], plant.law[None], 0), 0.004)
    late = control.ss([[0, 0], [1, 0]], [[1], [0]], [[0, 1]], 0, 0.004)
    wanted = control.StateSpace(control.feedback(control.series(sampled, late), 1)).poles()
    found = np.linalg.eigvals(held_step(plant, loop))
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(wanted), atol=1e-8)


@pytest.mark.parametrize(
    ("first", "second", "gains"),
    [
        ([1, 2, 1, 0], [1.0], [2.0]),  # s³ + 2 s² + s + κ: Routh
        ([1, 0, 2, 0, 0], [1, 0, 3], [4 - math.sqrt(12), 4 + math.sqrt(12)]),  # CH: roots on the axis meet
        ([1, -1], [1.0], [1.0]),  # through zero
    ],
)
def test_axis_crossings(first, second, gains):
    np.testing.assert_allclose(
        [edge.gain for edge in axis_crossings(np.array(first), np.array(second))], gains
    )


# what the user goes on with ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", LOOPS)
def test_the_systems_agree_with_the_verdict(name):
    verdict = contact(**LOOPS[name], environment_stiffness=800.0)
    closed, loop = verdict.closed_loop(), verdict.loop
    assert loop is not None
    poles = np.asarray(closed.poles())
    discrete = "period" in LOOPS[name]
    stable = (np.abs(poles) < 1).all() if discrete else (np.real(poles) < 0).all()
    assert stable == (verdict.status == "proved")
    looped = control.StateSpace(control.feedback(verdict.open_loop(), 1)).poles()
    np.testing.assert_allclose(
        np.sort_complex(looped), np.sort_complex(poles), rtol=1e-5, atol=1e-5 * np.abs(poles).max()
    )
    stiffness = LOOPS[name].get("stiffness", 0)
    if stable and not (loop.kind == "impedance" and loop.joint_stiffness):
        assert float(np.real(control.dcgain(closed))) == pytest.approx(800 / (800 + stiffness), rel=1e-6)
    s = 3.0
    at = np.exp(1j * s * loop.period) if discrete else 1j * s
    assert complex(verdict.open_loop()(at)) == pytest.approx(
        complex(verdict.frequency_response(np.array([s]))[0]), rel=1e-6
    )


def test_the_root_locus_system_has_the_poles():
    verdict = contact(**LOOPS["flexible, late"], environment_stiffness=900.0)
    system = verdict.root_locus_system()
    found = np.roots(np.polyadd(system.den[0][0], 900.0 * system.num[0][0]))
    slow = np.sort_complex(found[np.argsort(np.abs(found))[:4]])
    poles = verdict.closed_loop().poles()
    np.testing.assert_allclose(slow, np.sort_complex(poles[np.argsort(np.abs(poles))[:4]]), rtol=1e-6)
    with pytest.raises(InputError):
        contact(**LOOPS["held"]).root_locus_system()


@pytest.mark.parametrize("name", ["filter", "damping control", "held", "impedance, late"])
def test_the_figure_has_four_pictures(name):
    figure = contact(**LOOPS[name]).plot()
    titles = [axes.get_title() for axes in figure.axes]
    assert sum(bool(title) for title in titles) == 4


def test_it_is_a_verdict():
    verdict = contact(**LOOPS["delay"], environment_stiffness=1000.0)
    assert "max_environment_stiffness" in verdict.summary()
    assert verdict.to_dict()["status"] == "proved"
    assert contact(2, 500, 40, kind="impedance").to_dict()["values"]["max_environment_stiffness"] is None


@pytest.mark.parametrize(
    "options",
    [
        {"mass": -1, "damping": 1},
        {"mass": 0},
        {"mass": 0, "damping": 1, "kind": "impedance"},
        {"mass": 1, "damping": 1, "kind": "force"},
        {"mass": 1, "damping": 1, "period": 0},
        {"mass": 1, "damping": np.nan},
        {"mass": 1, "damping": 1, "joint_stiffness": 1},
        {"mass": 1, "damping": 1, "joint_damping": 1},
        {"mass": 0, "damping": 1, "environment_damping": 1},
        {"mass": 1, "damping": 1, "environment_stiffness": -1},
        {"mass": 1, "damping": 1, "delay": -1},
    ],
)
def test_bad_contacts_are_refused(options):
    with pytest.raises(InputError):
        contact(**options)
