"""Runtime filters: whatever gains are wanted, the loop makes no energy; where nothing is at stake they do nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import eigh, expm

from vic_toolbox.control import EnergyTank, GainFilter, TankState, replay_filter
from vic_toolbox.errors import InputError

seeds = st.integers(0, 2**32 - 1)


def spd(generator: np.random.Generator, size: int, low: float, high: float) -> np.ndarray:
    turned = np.linalg.qr(generator.normal(size=(size, size)))[0]
    return turned * np.exp(generator.uniform(np.log(low), np.log(high), size)) @ turned.T


def flow(mass: np.ndarray, stiffness: np.ndarray, damping: np.ndarray, elapsed: float) -> np.ndarray:
    """Exact motion of [e, ė] over a step with held gains."""
    d = len(mass)
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    return expm(elapsed * np.vstack([np.hstack([np.zeros((d, d)), np.eye(d)]), lower]))


def energy(mass: np.ndarray, stiffness: np.ndarray, state: np.ndarray) -> float:
    e, rate = np.split(state, 2)
    return 0.5 * float(rate @ mass @ rate + e @ stiffness @ e)


# -------------------------------------------------------------------------------------------------- the tank


def test_a_step_costs_two_joules_and_one_and_a_half_buy_400():
    for joules, allowed, left in ((1.5, 400.0, 0.0), (2.0, 500.0, 0.0), (3.0, 500.0, 1.0), (0.0, 100.0, 0.0)):
        tank = EnergyTank(energy=joules)
        state = tank.start(error=[0.1], stiffness=[100.0], damping=[20.0])
        state = tank.step(state, error=[0.1], stiffness=[500.0], damping=[20.0], elapsed=0.01)
        assert state.stiffness[0] == pytest.approx(allowed, rel=1e-12)
        assert state.energy == pytest.approx(left, abs=1e-12)


def test_reserve_power_and_capacity_limit_what_is_given():
    def changed(tank: EnergyTank, before: float, after: float) -> TankState:
        state = tank.start(error=[0.1], stiffness=[before], damping=[20.0])
        return tank.step(state, error=[0.1], stiffness=[after], damping=[20.0], elapsed=0.01)

    for tank in (EnergyTank(energy=1.5, reserve=0.5), EnergyTank(energy=5.0, power=100.0)):
        assert changed(tank, 100.0, 500.0).stiffness[0] == pytest.approx(300.0), "one joule may be drawn"
    fallen = changed(EnergyTank(energy=1.0, capacity=1.2), 500.0, 100.0)
    assert fallen.energy == 1.2, "of the 2 J that a fall frees, 0.2 J fit in"


@given(seeds, st.booleans(), st.floats(0.0, 2.0), st.floats(0.0, 1.0))
def test_a_loop_with_a_tank_never_holds_more_than_it_began_with(
    seed: int, matrices: bool, start: float, refill: float
):
    """Mass and springs hold at most the energy at the start plus the tank's, under any switching of the gains."""
    generator = np.random.default_rng(seed)
    d = 3
    mass = spd(generator, d, 0.5, 5.0)
    tank = EnergyTank(energy=start, refill=refill, capacity=generator.choice([np.inf, 3.0]))

    def wanted() -> tuple[np.ndarray, np.ndarray]:
        if matrices:
            return spd(generator, d, 10.0, 2000.0), spd(generator, d, 0.1, 30.0)
        return generator.uniform(10.0, 2000.0, d), generator.uniform(0.0, 30.0, d)

    def full(gains: np.ndarray) -> np.ndarray:
        return gains if matrices else np.diag(gains)

    x = generator.normal(size=2 * d) * np.repeat([0.1, 1.0], d)
    k, b = wanted()
    state = tank.start(error=x[:d], stiffness=k, damping=b)
    bound = energy(mass, full(k), x) + start
    limited = 0
    for _ in range(40):
        elapsed = generator.uniform(1e-3, 0.05)
        x = flow(mass, full(state.stiffness), full(state.damping), elapsed) @ x
        k, b = wanted()
        state = tank.step(state, error=x[:d], stiffness=k, damping=b, elapsed=elapsed)
        limited += state.share < 1
        held = energy(mass, full(state.stiffness), x) + state.energy
        assert held <= bound * (1 + 1e-9)
        bound = held
    assert np.linalg.eigvalsh(full(state.stiffness)).min() > 0


def test_without_a_tank_the_same_switching_pumps():
    """Stiff on the way in, soft on the way out: every frozen loop is stable, and energy grows, but for the tank."""
    mass, soft, stiff, b, elapsed = np.eye(1), 100.0, 400.0, 0.05, 2e-3
    x, free = np.array([0.1, 0.0]), np.array([0.1, 0.0])
    tank = EnergyTank(energy=0.5)
    state = tank.start(error=x[:1], stiffness=[stiff], damping=[b])
    for _ in range(2000):
        k = stiff if free[0] * free[1] < 0 else soft
        free = flow(mass, np.array([[k]]), np.array([[b]]), elapsed) @ free
        x = flow(mass, state.stiffness[:, None], state.damping[:, None], elapsed) @ x
        k = stiff if x[0] * x[1] < 0 else soft
        state = tank.step(state, error=x[:1], stiffness=[k], damping=[b], elapsed=elapsed)
    assert energy(mass, np.eye(1) * soft, free) > 100 * 2.0
    assert energy(mass, np.diag(state.stiffness), x) <= 2.0 + 0.5


def test_a_batch_is_its_samples():
    generator = np.random.default_rng(0)
    errors, k, b = (generator.uniform(0.1, 1.0, (2, 5, 3)) for _ in range(3))
    tank = EnergyTank(energy=0.05)
    many = tank.step(
        tank.start(error=errors[0], stiffness=k[0], damping=b[0]),
        error=errors[1],
        stiffness=k[1],
        damping=b[1],
        elapsed=0.1,
    )
    for i in range(5):
        one = tank.start(error=errors[0, i], stiffness=k[0, i], damping=b[0, i])
        one = tank.step(one, error=errors[1, i], stiffness=k[1, i], damping=b[1, i], elapsed=0.1)
        np.testing.assert_allclose(many.stiffness[i], one.stiffness, rtol=1e-14)
        assert many.energy[i] == pytest.approx(float(one.energy))


# ------------------------------------------------------------------------------------------------ the filter


@given(seeds, st.booleans())
def test_no_motion_gains_under_the_filter(seed: int, matrices: bool):
    """V of the filtered gains never grows over a step, for any state: ``Φᵀ P⁺ Φ ⪯ P``, whatever is wanted."""
    generator = np.random.default_rng(seed)
    d = 3
    mass = spd(generator, d, 0.5, 5.0) if matrices else np.diag(generator.uniform(0.5, 5.0, d))
    law = GainFilter(mass=mass, alpha=generator.uniform(0.5, 2.0), matrices=matrices)

    def wanted(least: float) -> tuple[np.ndarray, np.ndarray]:
        if matrices:
            return spd(generator, d, 10.0, 2000.0), spd(generator, d, least, 60.0)
        return generator.uniform(10.0, 2000.0, d), generator.uniform(least, 60.0, d)

    def full(gains: np.ndarray) -> np.ndarray:
        return gains if matrices else np.diag(gains)

    k, b = wanted(20.0)
    state = law.start(stiffness=k, damping=b)
    for _ in range(10):
        elapsed = generator.uniform(1e-3, 0.05)
        k, b = wanted(0.1)
        later = law.step(state, stiffness=k, damping=b, elapsed=elapsed)
        before = law.lyapunov(stiffness=state.stiffness, damping=state.damping)
        after = law.lyapunov(stiffness=later.stiffness, damping=later.damping)
        assert np.linalg.eigvalsh(after)[0] > 0
        moved = flow(mass, full(state.stiffness), full(state.damping), elapsed)
        growth = eigh(moved.T @ after @ moved, before, eigvals_only=True)[-1]
        assert growth <= 1 + 1e-8
        state = later


@pytest.mark.parametrize("alpha", [1.0, 5.0])
def test_the_filter_lets_through_all_that_the_theorem_allows(alpha: float):
    """With short steps the stiffness may rise at the rate 2αK of Kronander and Billard, and at no more."""
    elapsed, law = 1e-4, GainFilter(mass=1.0, alpha=alpha)
    state = law.start(stiffness=[100.0], damping=[20.0])
    for _ in range(1000):
        state = law.step(state, stiffness=[1e6], damping=[20.0], elapsed=elapsed)
    assert state.stiffness[0] == pytest.approx(100.0 * np.exp(2 * alpha * 0.1), rel=2e-3)


def test_harmless_gains_pass_unchanged():
    law = GainFilter(mass=[1.0, 2.0], alpha=2.0)
    state = law.start(stiffness=[400.0, 300.0], damping=[20.0, 30.0])
    later = law.step(state, stiffness=[100.0, 301.0], damping=[20.0, 30.0], elapsed=0.01)
    np.testing.assert_array_equal(later.stiffness, [100.0, 301.0])
    np.testing.assert_array_equal(later.damping, [20.0, 30.0])
    np.testing.assert_array_equal(later.share, 1.0)


def test_axes_are_filtered_alone_and_as_matrices_alike():
    """One axis as a number, as a diagonal among others, and as a (1, 1) matrix."""
    numbers = GainFilter(mass=[1.0, 7.0], alpha=3.0)
    matrix = GainFilter(mass=1.0, alpha=3.0, matrices=True)
    one = numbers.step(
        numbers.start(stiffness=[100.0, 50.0], damping=[20.0, 90.0]),
        stiffness=[900.0, 50.0],
        damping=[15.0, 90.0],
        elapsed=0.02,
    )
    other = matrix.step(
        matrix.start(stiffness=[[100.0]], damping=[[20.0]]),
        stiffness=[[900.0]],
        damping=[[15.0]],
        elapsed=0.02,
    )
    assert one.stiffness[0] == pytest.approx(other.stiffness[0, 0], rel=1e-12)
    assert one.damping[0] == pytest.approx(other.damping[0, 0], rel=1e-12)
    assert one.stiffness[1] == 50.0


def test_a_coupled_mass_with_diagonal_gains():
    law = GainFilter(mass=[[2.0, 0.5], [0.5, 1.0]], alpha=2.0)
    state = law.start(stiffness=[100.0, 80.0], damping=[20.0, 20.0])
    later = law.step(state, stiffness=[900.0, 90.0], damping=[20.0, 20.0], elapsed=0.01)
    assert later.stiffness.shape == (2,)
    assert later.share.shape == ()
    assert 0 < later.share < 1


def test_damping_below_the_certificate_is_approached_only():
    law = GainFilter(mass=1.0, alpha=5.0)
    state = law.start(stiffness=[100.0], damping=[20.0])
    for _ in range(5000):
        state = law.step(state, stiffness=[100.0], damping=[1.0], elapsed=0.01)
    assert 5.0 < state.damping[0] < 5.1


# ------------------------------------------------------------------------------------------------ the replay


def recorded(count: int = 200) -> dict[str, np.ndarray]:
    time = 0.01 * np.arange(count)
    error = 0.1 * np.exp(-time)[:, None] * np.array([1.0, 0.5, 0.3, 1.0, 0.4, 0.2])
    stiffness = np.array([200.0] * 3 + [5.0] * 3) * (1 + 0.8 * np.sin(20 * time))[:, None]
    damping = np.array([40.0] * 3 + [3.0] * 3) * np.ones((count, 1))
    return {"time": time, "error": error, "stiffness": stiffness, "damping": damping}


def replayed(law: EnergyTank | GainFilter, data: dict[str, np.ndarray]):
    return replay_filter(
        law, data["time"], **{name: data[name] for name in ("error", "stiffness", "damping")}
    )


@pytest.mark.parametrize("law", [EnergyTank(energy=0.05), GainFilter(mass=[5.0] * 3 + [0.1] * 3, alpha=2.0)])
def test_a_replay_says_what_would_have_changed(law: EnergyTank | GainFilter):
    found = replayed(law, recorded())
    assert 0 < found.share_changed < 1
    assert found.energy_saved > 0
    assert (found.share[found.changed & (np.arange(200) > 0)] < 1).any()
    jumps = 0.5 * np.einsum("ni,ni->n", np.diff(found.stiffness, axis=0), recorded()["error"][1:] ** 2)
    assert found.injected[-1] == pytest.approx(jumps[jumps > 0].sum())
    assert f"{found.energy_saved:.4g} J saved" in found.summary()
    figure = found.plot()
    assert "J kept out" in figure.get_suptitle()
    assert len(figure.axes) == 5
    np.testing.assert_array_equal(figure.axes[-1].lines[0].get_ydata(), found.injected)


def test_matrices_and_diagonals_replay_alike():
    data = recorded(50)
    full = data | {name: data[name][:, :, None] * np.eye(6) for name in ("stiffness", "damping")}
    one, other = replayed(EnergyTank(energy=0.01), data), replayed(EnergyTank(energy=0.01), full)
    np.testing.assert_allclose(
        np.diagonal(other.filtered_stiffness, axis1=1, axis2=2), one.filtered_stiffness
    )
    assert one.tank is not None
    assert other.tank == pytest.approx(one.tank)


def test_a_full_tank_changes_nothing():
    found = replayed(EnergyTank(energy=1e3), recorded())
    assert found.share_changed == 0.0
    assert found.energy_saved == 0.0
    np.testing.assert_array_equal(found.filtered_stiffness, found.stiffness)


def test_one_axis_may_be_plain_numbers():
    data = {name: values[:, 0] if values.ndim > 1 else values for name, values in recorded().items()}
    found = replayed(EnergyTank(energy=0.05), data)
    assert found.stiffness.shape == (200, 1)
    assert len(found.plot().axes) == 3


# ------------------------------------------------------------------------------------------------- bad input

TANK = EnergyTank(energy=1.0)
STATE = TANK.start(error=[0.1], stiffness=[100.0], damping=[20.0])


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: EnergyTank(energy=-1.0), "energy"),
        (lambda: EnergyTank(energy=float("nan")), "energy"),
        (lambda: EnergyTank(energy=2.0, capacity=1.0), "capacity"),
        (lambda: EnergyTank(energy=1.0, reserve=2.0), "reserve"),
        (lambda: EnergyTank(energy=1.0, refill=1.5), "refill"),
        (lambda: EnergyTank(energy=1.0, power=0.0), "power"),
        (lambda: TANK.start(error=[0.1], stiffness=[-1.0], damping=[1.0]), "stiffness"),
        (lambda: TANK.start(error=[0.1], stiffness=[1.0], damping=[-1.0]), "damping"),
        (
            lambda: TANK.start(error=[0.1, 0.2], stiffness=[[1.0, 0.5], [0.0, 1.0]], damping=[1.0, 1.0]),
            "symmetric",
        ),
        (lambda: TANK.start(error=[0.1], stiffness=[1.0, 2.0], damping=[1.0]), "shape"),
        (lambda: TANK.step(STATE, error=[0.1], stiffness=[1.0], damping=[1.0], elapsed=0.0), "elapsed"),
        (lambda: TANK.step(STATE, error=[np.nan], stiffness=[1.0], damping=[1.0], elapsed=0.1), "error"),
        (
            lambda: TANK.step(STATE, error=[0.1, 0.1], stiffness=[1.0] * 2, damping=[1.0] * 2, elapsed=0.1),
            "form",
        ),
        (lambda: GainFilter(mass=-1.0, alpha=1.0), "mass"),
        (lambda: GainFilter(mass=1.0, alpha=0.0), "alpha"),
        (lambda: GainFilter(mass=1.0, alpha=30.0).start(stiffness=[100.0], damping=[20.0]), "up to 19.98"),
        (lambda: GainFilter(mass=1.0, alpha=3.0).start(stiffness=[0.0], damping=[20.0]), "stiffness"),
        (lambda: GainFilter(mass=1.0, alpha=3.0).start(stiffness=[1.0, 2.0], damping=[2.0, 3.0]), "shape"),
        (
            lambda: replay_filter(TANK, [0.0, 0.0], error=[1.0] * 2, stiffness=[1.0] * 2, damping=[1.0] * 2),
            "increase",
        ),
        (
            lambda: replay_filter(TANK, [0.0, 0.1], error=[1.0] * 3, stiffness=[1.0] * 3, damping=[1.0] * 3),
            "as many",
        ),
        (lambda: replay_filter("tank", [0, 1], error=[1, 1], stiffness=[1, 1], damping=[1, 1]), "Tank"),  # type: ignore[arg-type]
    ],
)
def test_bad_input_is_refused(call, message: str):
    with pytest.raises(InputError, match=message):
        call()
