"""Gains that change within a range: common quadratic functions, the worst switching, the largest safe range."""

from __future__ import annotations

import math

import cvxpy
import numpy as np
import pytest
from cvxpy.error import SolverError
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from vic_toolbox.errors import InputError
from vic_toolbox.stability.ranges.common_lyapunov import common_lyapunov
from vic_toolbox.stability.ranges.gain_box import gain_box
from vic_toolbox.stability.ranges.safe_range import safe_range
from vic_toolbox.stability.ranges.switching import critical_damping, half_turn_growth, worst_case_switching
from vic_toolbox.stability.verdict import Certificate, CounterExample

UNITS = [(1.0, 1.0), (1e-3, 1.0), (1.0, 1e3), (1e3, 1e-3)]
"""Scales of mass and of rate: k grows as m r², b as m r."""


def replayed(witness) -> float:
    """Norm at the end of the replay over that at its start."""
    _, state = witness.replay()
    return float(np.linalg.norm(state[-1]) / np.linalg.norm(witness.initial_state))


def random_switching(systems, p, seed: int, *, count: int = 1000, steps: int = 150, step: float = 0.05):
    """V along random switching of `count` random states: (steps + 1, count)."""
    rng = np.random.default_rng(seed)
    maps = expm(systems * step)
    state = rng.normal(size=(count, systems.shape[-1]))
    values = [np.einsum("ni,ij,nj->n", state, p, state)]
    for _ in range(steps):
        state = np.einsum("nij,nj->ni", maps[rng.integers(len(maps), size=count)], state)
        values.append(np.einsum("ni,ij,nj->n", state, p, state))
    return np.array(values)


# common quadratic Lyapunov function -------------------------------------------------------------------------------


@pytest.mark.parametrize(("mass", "low", "high"), [(1.0, 1.0, 9.0), (4.0, 100.0, 400.0), (0.2, 5.0, 6.0)])
@pytest.mark.parametrize("share", [0.9, 0.999, 1.001, 1.1])
def test_one_axis_needs_the_difference_of_the_roots(mass, low, high, share):
    """LMI1: a common quadratic function exists iff b > √m (√k_max − √k_min)."""
    needed = math.sqrt(mass) * (math.sqrt(high) - math.sqrt(low))
    verdict = common_lyapunov(mass, [low, high], share * needed)
    assert (verdict.status == "proved") == (share > 1)
    assert (verdict.margin > 0) == (share > 1)


def test_vertices_as_people_write_them():
    """Numbers, lists, a list of one that stands with all, matrices."""
    for mass, stiffness, damping in [
        (1.0, [1.0, 9.0], 2.1),
        (1.0, [1.0, 9.0], [2.1, 2.1]),
        ([1.0], [1.0, 9.0], [2.1]),
        ([1.0, 1.0], [1.0, 4.0], [2.1, 2.1]),
        (np.eye(2), [np.eye(2), 9 * np.eye(2)], [2.1 * np.eye(2)]),
        ([np.eye(1)], [np.eye(1), 9 * np.eye(1)], [[[2.1]], [[2.1]]]),
    ]:
        assert common_lyapunov(mass, stiffness, damping).status == "proved"


def test_between_both_thresholds_it_is_inconclusive_and_says_why():
    verdict = common_lyapunov(1, [1, 9], 1.9)
    assert verdict.status == "inconclusive"
    assert "not necessary" in verdict.reason
    assert worst_case_switching(1, (1, 9), 1.9).status == "proved"


def test_the_certificate_holds_along_1000_random_switchings():
    masses = np.diag([2.0, 1.0])
    stiffness = np.array([np.diag([100.0, 50.0]), [[150, 20], [20, 80]], [[120, -10], [-10, 60]]])
    damping = np.diag([25.0, 14.0])
    verdict = common_lyapunov(masses, stiffness, damping)
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)
    p = verdict.witness.values["P"]
    systems = np.zeros((3, 4, 4))
    systems[:, :2, 2:] = np.eye(2)
    systems[:, 2:, :2] = -np.linalg.solve(masses, stiffness)
    systems[:, 2:, 2:] = -np.linalg.solve(masses, damping)
    values = random_switching(systems, p, 0)
    times = 0.05 * np.arange(len(values))[:, None]
    assert (np.diff(values, axis=0) <= 1e-12 * values[:-1]).all()
    assert (values <= values[0] * np.exp(-2 * verdict.margin * times) * (1 + 1e-9)).all()


@pytest.mark.parametrize("damping", [0.05, 0.5, 1.0])
def test_a_destabilising_switching_grows_when_replayed(damping):
    """Every vertex is stable; rotating the stiff direction with the motion is not."""
    stiffness = 3 * np.array([[[2, 1], [1, 2]], [[2, -1], [-1, 2]], [[9, 0], [0, 1]]])
    verdict = common_lyapunov(np.eye(2), stiffness, damping * np.eye(2))
    assert verdict.status == "disproved"
    assert isinstance(verdict.witness, CounterExample)
    assert verdict.witness.growth > 10
    assert replayed(verdict.witness) == pytest.approx(verdict.witness.growth, rel=1e-6)
    assert verdict.witness.gains["stiffness"].shape == (len(verdict.witness.time), 2, 2)


def test_one_axis_of_many_is_shown_with_the_others_at_rest():
    verdict = common_lyapunov(np.eye(2), gain_box(([1.0, 1.0], [9.0, 1.0])), np.diag([0.5, 1.0]))
    assert verdict.status == "disproved"
    assert isinstance(verdict.witness, CounterExample)
    assert np.abs(verdict.witness.state[:, [1, 3]]).max() == 0
    assert replayed(verdict.witness) > 10


def test_axes_that_do_not_act_on_each_other_are_judged_alone():
    stiffness = gain_box(([200, 200, 200, 5, 5, 5], [1000, 1000, 1000, 20, 20, 20]))
    damping = np.diag([60, 60, 60, 3, 3, 3.0])
    mass = np.diag([2, 2, 2, 0.05, 0.05, 0.05])
    verdict = common_lyapunov(mass, stiffness, damping)
    alone = [common_lyapunov(m, [low, high], b) for m, low, high, b in ((2, 200, 1000, 60), (0.05, 5, 20, 3))]
    assert verdict.margin == pytest.approx(min(one.margin for one in alone), rel=1e-6)
    assert verdict.values["group"].tolist() == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("of_mass", "of_rate"), UNITS)
@pytest.mark.parametrize("damping", [1.0, 1.6, 2.02])
def test_units_change_no_verdict(of_mass, of_rate, damping):
    verdict = common_lyapunov(1, [1, 9], damping)
    scaled = common_lyapunov(of_mass, of_mass * of_rate**2 * np.array([1, 9]), of_mass * of_rate * damping)
    assert scaled.status == verdict.status
    assert scaled.margin == pytest.approx(of_rate * verdict.margin, rel=1e-3, abs=1e-6 * of_rate)


@pytest.mark.parametrize("seed", range(6))
def test_units_change_no_search(seed):
    """The switching sequence of coupled axes is searched in numbers that no unit changes."""
    rng = np.random.default_rng(seed)
    d = int(rng.integers(2, 5))
    a, b, c = (x @ x.T for x in rng.normal(size=(3, d, d)))
    vertices = np.stack([b + 0.1 * np.eye(d), 3 * b + 0.5 * c])
    before = common_lyapunov(a + np.eye(d), vertices, 0.05 * c)
    after = common_lyapunov(1e-9 * (a + np.eye(d)), 1e-1 * vertices, 1e-5 * 0.05 * c)
    assert after.status == before.status


@pytest.mark.parametrize("lie", [-1.0, 0.0, "skewed"])
def test_a_solver_that_lies_is_not_believed(monkeypatch, lie):
    """Status optimal, P indefinite (or with the wrong sign of the rate)."""

    def solve(self, *_, **__):
        for variable in self.variables():
            size = variable.shape
            variable.value = np.ones(size) if not size else lie * np.eye(*size) if lie != "skewed" else np.diag(
                np.linspace(-1, 1, size[0])
            )  # fmt: skip
        self._status = "optimal"
        return 1.0

    monkeypatch.setattr(cvxpy.Problem, "solve", solve)
    verdict = common_lyapunov(1, [1, 9], 5.0)
    assert verdict.status == "inconclusive"
    assert "solver" in verdict.reason


def test_a_solver_that_fails_is_inconclusive(monkeypatch):
    def solve(*_, **__):
        raise SolverError("no")

    monkeypatch.setattr(cvxpy.Problem, "solve", solve)
    verdict = common_lyapunov(1, [1, 9], 5.0)
    assert verdict.status == "inconclusive"
    assert "failed" in verdict.reason


@pytest.mark.parametrize(
    "arguments",
    [
        (1, [1, -9], 2),
        (0, [1, 9], 2),
        (1, [1, np.nan], 2),
        (np.eye(2), np.eye(3), np.eye(2)),
        (np.eye(2), np.array([[1, 2], [0, 1]]), np.eye(2)),
        (1, [1, 2, 3], [1, 2]),
        (1, [1, 9], -1),
    ],
)
def test_bad_gains_are_refused(arguments):
    with pytest.raises(InputError):
        common_lyapunov(*arguments)


# boxes ------------------------------------------------------------------------------------------------------------


def test_a_box_has_all_corners_paired():
    stiffness, damping = gain_box(([1, 2], [3, 2]), ([4, 5], [6, 7]))
    assert stiffness.shape == damping.shape == (8, 2, 2)
    corners = {(*np.diag(k), *np.diag(b)) for k, b in zip(stiffness, damping, strict=True)}
    assert corners == {(k, 2.0, b, c) for k in (1.0, 3.0) for b in (4.0, 6.0) for c in (5.0, 7.0)}
    assert np.ravel(gain_box((1, 9))).tolist() == [1, 9]


@pytest.mark.parametrize("ranges", [[(2, 1)], [([1, 2], [3])], [(np.zeros(13), np.ones(13))], []])
def test_bad_boxes_are_refused(ranges):
    with pytest.raises(InputError):
        gain_box(*ranges)


# worst-case switching ---------------------------------------------------------------------------------------------


def test_an_undamped_spring_that_is_soft_on_the_way_out_grows_by_root_two():
    """SW1."""
    verdict = worst_case_switching(1, (1, 2), 0)
    assert verdict.status == "disproved"
    assert verdict.values["growth_per_half_turn"] == pytest.approx(math.sqrt(2), abs=1e-12)
    assert verdict.values["growth_per_cycle"] == pytest.approx(2, abs=1e-12)
    assert isinstance(verdict.witness, CounterExample)
    assert replayed(verdict.witness) == pytest.approx(verdict.witness.growth, rel=1e-6)


def test_less_damping_is_enough_than_a_common_quadratic_function_needs():
    verdict = worst_case_switching(1, (1, 9), 2)
    assert verdict.values["critical_damping"] == pytest.approx(1.252828, abs=1e-6)
    assert verdict.values["common_quadratic_damping"] == pytest.approx(2)


positive = st.floats(0.1, 10)


@settings(max_examples=25, deadline=None)
@given(mass=positive, low=positive, width=st.floats(1.05, 50), share=st.floats(0.3, 1.7))
def test_the_critical_damping_is_the_edge(mass, low, width, share):
    critical = critical_damping(mass, low, low * width)
    assert half_turn_growth(mass, low, low * width, critical) == pytest.approx(1, abs=1e-9)
    verdict = worst_case_switching(mass, (low, low * width), share * critical)
    if abs(share - 1) > 1e-3:
        assert verdict.status == ("proved" if share > 1 else "disproved")
        assert verdict.margin == pytest.approx((share - 1) * critical, rel=1e-9)
    assert critical < math.sqrt(mass) * (math.sqrt(low * width) - math.sqrt(low))
    if verdict.status == "disproved":
        assert isinstance(verdict.witness, CounterExample)
        assert verdict.witness.growth > 1
        assert replayed(verdict.witness) > 1


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 10**6), damping=st.floats(1.26, 1.9))
def test_no_random_switching_grows_where_the_worst_does_not(seed, damping):
    """1000 random bang-bang motions; none leaves the ellipse that the worst one stays in."""
    rng = np.random.default_rng(seed)
    systems = np.array([[[0, 1], [-k, -damping]] for k in (1.0, 9.0)])
    maps = expm(systems * 0.02)
    state = rng.normal(size=(1000, 2))
    start = np.linalg.norm(state, axis=1)
    which = rng.integers(2, size=1000)
    for _ in range(1500):
        switch = rng.random(1000) < 0.04
        which = np.where(switch, 1 - which, which)
        state = np.einsum("nij,nj->ni", maps[which], state)
    assert (np.linalg.norm(state, axis=1) < 3 * start).all()
    assert np.median(np.linalg.norm(state, axis=1) / start) < 1e-2


def test_the_orbit_of_the_certificate_is_crossed_inwards():
    """On the critical orbit every field of k in the range, and more damping, points inwards."""
    verdict = worst_case_switching(2.0, (3.0, 30.0), 6.5)
    assert verdict.status == "proved"
    assert isinstance(verdict.witness, Certificate)
    orbit = verdict.witness.values["orbit"]
    middle, along = 0.5 * (orbit[1:] + orbit[:-1]), np.diff(orbit, axis=0)
    length = np.linalg.norm(along, axis=1)
    keep = length > 1e-4
    for k in (3.0, 12.0, 30.0):
        field = np.column_stack([middle[:, 1], -(k * middle[:, 0] + 6.5 * middle[:, 1]) / 2.0])
        cross = along[:, 0] * field[:, 1] - along[:, 1] * field[:, 0]
        size = np.linalg.norm(field, axis=1) * length
        assert (cross[keep] <= 2e-3 * size[keep]).all()


@pytest.mark.parametrize(("of_mass", "of_rate"), UNITS)
@pytest.mark.parametrize("damping", [0.5, 1.5, 7.0])
def test_units_change_no_switching_verdict(of_mass, of_rate, damping):
    verdict = worst_case_switching(1, (1, 9), damping)
    k, b = of_mass * of_rate**2, of_mass * of_rate
    scaled = worst_case_switching(of_mass, (k, 9 * k), b * damping)
    assert scaled.status == verdict.status
    assert scaled.margin == pytest.approx(b * verdict.margin)
    assert scaled.values["growth_per_cycle"] == pytest.approx(verdict.values["growth_per_cycle"], abs=1e-12)


def test_a_spring_that_can_vanish():
    assert worst_case_switching(1, (0, 9), 1.7).status == "disproved"
    assert worst_case_switching(1, (0, 9), 1.73).status == "proved"
    assert worst_case_switching(1, (0, 9), 0).status == "disproved"


def test_an_overdamped_motion_cannot_turn():
    verdict = worst_case_switching(1, (1, 9), 6)
    assert verdict.status == "proved"
    assert verdict.values["growth_per_cycle"] == 0


def test_on_the_edge_nothing_is_said():
    assert worst_case_switching(1, (4, 4), 0).status == "inconclusive"


@pytest.mark.parametrize(
    "arguments", [(0, (1, 9), 1), (1, (9, 1), 1), (1, (-1, 1), 1), (1, (1, 9), -1), (1, 3, 1)]
)
def test_bad_ranges_are_refused(arguments):
    with pytest.raises(InputError):
        worst_case_switching(*arguments)


# largest safe range -----------------------------------------------------------------------------------------------


def test_the_largest_quadratic_range_is_the_closed_form():
    """√k_max = √k_min + b/√m."""
    verdict = safe_range(1, 1.0, 2.0, method="common_lyapunov")
    assert verdict.status == "proved"
    assert verdict.values["factor"] == pytest.approx(9, rel=2e-4)


@pytest.mark.parametrize("side", ["up", "around"])
def test_the_largest_switching_range_has_this_critical_damping(side):
    verdict = safe_range(1, 2.0, 1.5, side=side, tolerance=1e-6)
    assert verdict.status == "proved"
    low, high = verdict.values["stiffness_low"], verdict.values["stiffness_high"]
    assert critical_damping(1, low, high) == pytest.approx(1.5, rel=1e-5)


def test_matrices_vary_together_or_each():
    mass, stiffness, damping = np.diag([1, 2.0]), np.diag([100, 200.0]), np.diag([20, 30.0])
    each = safe_range(mass, stiffness, damping, tolerance=1e-3)
    together = safe_range(mass, stiffness, damping, vary="all", tolerance=1e-3)
    assert each.status == together.status == "proved"
    assert each.values["factor"] == pytest.approx(
        together.values["factor"], rel=1e-2
    )  # axes do not act on each other
    assert np.allclose(each.values["stiffness_high"], each.values["factor"] * stiffness)


def test_a_nominal_that_is_not_stable_has_no_range():
    verdict = safe_range(1, 4.0, 0.0)
    assert verdict.status == "inconclusive"
    assert math.isnan(verdict.values["factor"])


@pytest.mark.parametrize(
    "change",
    [
        {"method": "switching", "mass": np.eye(2), "stiffness": np.eye(2), "damping": np.eye(2)},
        {"stiffness": 0.0},
        {"side": "down"},
        {"tolerance": 0},
        {"stiffness": [1.0, 2.0]},
        {"mass": np.eye(2), "stiffness": np.array([[2, 1], [1, 2.0]]), "damping": np.eye(2)},
    ],
)
def test_bad_questions_are_refused(change):
    with pytest.raises(InputError):
        safe_range(**({"mass": 1.0, "stiffness": 1.0, "damping": 2.0} | change))
