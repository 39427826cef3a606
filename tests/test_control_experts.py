"""Experts stay in their range, change continuously, and do in each phase what the task wants."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vic_toolbox.control import ConstantGains, ThreePhaseExpert
from vic_toolbox.control.experts import TipStiffnessExpert
from vic_toolbox.errors import InputError
from vic_toolbox.gains import DampingFactor, Diagonal, DiagonalStiffness
from vic_toolbox.spatial import rotate, rotation_exp, twist_transport_matrix

RANGE = DampingFactor(
    stiffness_low=(60.0, 60.0, 60.0, 1.0, 1.0, 1.0),
    stiffness_high=(200.0, 200.0, 200.0, 6.0, 6.0, 6.0),
    factor_low=9.0,
    factor_high=12.0,
)
DIAGONAL = Diagonal(
    stiffness_low=(60.0, 60.0, 60.0, 1.0, 1.0, 1.0),
    stiffness_high=(200.0, 200.0, 200.0, 6.0, 6.0, 6.0),
    damping_low=(20.0, 20.0, 20.0, 1.0, 1.0, 1.0),
    damping_high=(90.0, 90.0, 90.0, 9.0, 9.0, 9.0),
)
EXPERT = ThreePhaseExpert(parametrisation=RANGE)
BOTH = (EXPERT, ConstantGains(parametrisation=RANGE))

finite = st.floats(-1e3, 1e3)
observations = arrays(np.float64, (4, 12), elements=finite)


def at_distance(distance: float) -> np.ndarray:
    """An observation at this distance from the goal, in some direction."""
    direction = np.array([2.0, -1.0, 2.0]) / 3.0
    return np.concatenate([distance * direction, np.zeros(9)])


@pytest.mark.parametrize("expert", BOTH, ids=lambda e: type(e).__name__)
@given(observation=observations)
def test_every_form_stays_in_range_and_tells_the_same(expert, observation: np.ndarray) -> None:
    parameters, action, gains = (f(observation) for f in (expert.parameters, expert.action, expert.gains))
    assert parameters.shape == action.shape == (4, 7)
    assert (RANGE.minimum <= parameters).all()
    assert (parameters <= RANGE.maximum).all()
    assert (np.abs(action) <= 1.0).all()
    np.testing.assert_allclose(RANGE.action_to_parameters(action), parameters, rtol=1e-12)
    np.testing.assert_allclose(gains.stiffness_diagonal, parameters[:, :6], rtol=1e-12)
    factor = gains.damping_diagonal / np.sqrt(gains.stiffness_diagonal)
    np.testing.assert_allclose(factor, np.broadcast_to(parameters[:, 6:], (4, 6)), rtol=1e-12)


def test_accelerates_stiff_and_light_and_reaches_soft_and_damped() -> None:
    np.testing.assert_array_equal(EXPERT.parameters(at_distance(0.41)), [200.0] * 3 + [6.0] * 3 + [9.0])
    np.testing.assert_allclose(EXPERT.parameters(at_distance(0.3)), [130.0] * 3 + [3.5] * 3 + [10.5])
    np.testing.assert_array_equal(EXPERT.parameters(at_distance(0.19)), [60.0] * 3 + [1.0] * 3 + [12.0])
    np.testing.assert_array_equal(EXPERT.parameters(np.zeros(12))[6], 12.0)


@given(distance=st.floats(0.0, 1.0), step=st.floats(0.0, 1e-3))
def test_continuous_across_the_phases(distance: float, step: float) -> None:
    """Lipschitz in the distance, with the slope of the blend, on both sides of each boundary."""
    change = EXPERT.parameters(at_distance(distance + step)) - EXPERT.parameters(at_distance(distance))
    slope = (RANGE.maximum - RANGE.minimum) / (EXPERT.far - EXPERT.near)
    assert (np.abs(change) <= slope * step + 1e-9).all()


@given(distances=st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2))
def test_monotone_in_the_distance(distances: list[float]) -> None:
    nearer, farther = (EXPERT.parameters(at_distance(d)) for d in sorted(distances))
    assert (nearer[:6] <= farther[:6] + 1e-12).all()
    assert nearer[6] >= farther[6] - 1e-12


@given(observation=observations)
def test_only_the_position_error_of_the_newest_observation_counts(observation: np.ndarray) -> None:
    history = np.concatenate([np.roll(observation, 1, axis=0), observation], axis=-1)
    altered = observation.copy()
    altered[:, 3:] = 1.0
    for expert in BOTH:
        parameters = expert.parameters(observation)
        np.testing.assert_array_equal(expert.parameters(history), parameters)
        np.testing.assert_array_equal(expert.parameters(altered), parameters)
        np.testing.assert_array_equal(expert.parameters(observation[2]), parameters[2])


def test_constant_gains_serve_every_parametrisation_at_every_level() -> None:
    for level, action in ((0.0, -1.0), (0.5, 0.0), (1.0, 1.0)):
        expert = ConstantGains(parametrisation=DIAGONAL, level=level)
        np.testing.assert_allclose(expert.action(np.zeros((3, 60))), np.full((3, 12), action), atol=1e-12)


def test_bad_input_is_refused_with_a_way_out() -> None:
    with pytest.raises(InputError, match="pass a DampingFactor"):
        ThreePhaseExpert(parametrisation=DIAGONAL)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="near must be smaller"):
        ThreePhaseExpert(parametrisation=RANGE, far=0.2, near=0.2)
    with pytest.raises(InputError, match="near"):
        ThreePhaseExpert(parametrisation=RANGE, near=0.0)
    with pytest.raises(InputError, match="level"):
        ConstantGains(parametrisation=RANGE, level=1.5)
    for expert in BOTH:
        with pytest.raises(InputError, match="12 numbers"):
            expert.parameters(np.zeros(11))
        with pytest.raises(InputError, match="12 numbers"):
            expert.parameters(np.zeros((2, 0)))
        with pytest.raises(InputError, match="observation"):
            expert.parameters(np.full(12, np.nan))


# --- the tip-stiffness expert ---

UNIT = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)
WIDE = DiagonalStiffness(
    stiffness_low=(1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3),
    stiffness_high=(1e5, 1e5, 1e5, 1e5, 1e5, 1e5),
    damping=UNIT,
)
K_TIP = np.array([3000.0, 3000.0, 900.0, 12.0, 12.0, 12.0])

offsets = arrays(np.float64, 3, elements=st.floats(-0.2, 0.2))
errors = arrays(np.float64, 6, elements=st.floats(-0.5, 0.5))
roots = arrays(np.float64, (6, 6), elements=st.floats(-1.0, 1.0))


def tip_expert(**options: Any) -> TipStiffnessExpert:
    usual: dict[str, Any] = {"parametrisation": WIDE, "offset": (0.0, 0.0, -0.06), "tip_stiffness": K_TIP}
    return TipStiffnessExpert(**usual | options)


def observed(error: np.ndarray) -> np.ndarray:
    """An observation with this pose error; the rate does not matter."""
    return np.concatenate([error, np.full((*error.shape[:-1], 6), 7.0)], axis=-1)


def stiffness_matrix(root: np.ndarray) -> np.ndarray:
    """A symmetric positive definite matrix that couples all axes, as stiff as K_tip."""
    scale = np.sqrt(K_TIP)
    return scale[:, None] * (root @ root.T + 0.1 * np.eye(6)) * scale


def jacobian(expert: TipStiffnessExpert, error: np.ndarray) -> np.ndarray:
    """J_tip from the definition: the change of point by the lever in world axes."""
    return twist_transport_matrix(rotation_exp(error[3:]) @ np.array(expert.offset))


@given(root=roots, offset=offsets, error=errors)
def test_the_stiffness_at_the_com_is_the_tips_congruence(
    root: np.ndarray, offset: np.ndarray, error: np.ndarray
) -> None:
    stiffness = stiffness_matrix(root)
    expert = tip_expert(offset=tuple(offset), tip_stiffness=stiffness)
    j = jacobian(expert, error)
    np.testing.assert_allclose(expert.tip_error(observed(error)), j @ error, atol=1e-14)
    np.testing.assert_allclose(expert.wrench(observed(error)), j.T @ stiffness @ j @ error, atol=1e-9)


@given(root=roots, offset=offsets, error=errors)
def test_both_springs_store_the_same_energy(root: np.ndarray, offset: np.ndarray, error: np.ndarray) -> None:
    stiffness = stiffness_matrix(root)
    expert, observation = tip_expert(offset=tuple(offset), tip_stiffness=stiffness), observed(error)
    at_tip = expert.tip_error(observation)
    stored = 0.5 * at_tip @ stiffness @ at_tip
    assert 0.5 * error @ expert.wrench(observation) == pytest.approx(stored, rel=1e-9, abs=1e-12)
    assert stored >= 0.0


@given(offset=offsets, error=errors)
def test_the_tip_error_is_the_displacement_of_the_tip_to_first_order(
    offset: np.ndarray, error: np.ndarray
) -> None:
    tip = tip_expert(offset=tuple(offset)).tip_error(observed(error))
    moved = error[:3] + rotation_exp(error[3:]) @ offset - offset
    assert np.linalg.norm(tip[:3] - moved) <= error[3:] @ error[3:] * np.linalg.norm(offset) + 1e-15
    np.testing.assert_array_equal(tip[3:], error[3:])


@given(root=roots, offset=offsets, error=errors)
def test_without_a_ridge_the_gains_give_the_tips_wrench_wherever_the_range_lets_them(
    root: np.ndarray, offset: np.ndarray, error: np.ndarray
) -> None:
    error = error + np.copysign(1e-3, error)
    expert = tip_expert(offset=tuple(offset), tip_stiffness=stiffness_matrix(root), ridge=(1e-12, 1e-12))
    stiffness, wrench = expert.parameters(observed(error)), expert.wrench(observed(error))
    exact = wrench / error
    free = (WIDE.minimum < exact) & (exact < WIDE.maximum)
    np.testing.assert_allclose((stiffness * error)[free], wrench[free], rtol=1e-9)
    np.testing.assert_array_equal(stiffness[~free], np.clip(exact, WIDE.minimum, WIDE.maximum)[~free])


@given(root=roots, error=errors, change=st.sampled_from([-1e-3, 1e-3]))
def test_the_ridge_solution_is_the_minimum(root: np.ndarray, error: np.ndarray, change: float) -> None:
    expert = tip_expert(tip_stiffness=stiffness_matrix(root))
    wrench, k_tip = expert.wrench(observed(error)), np.diagonal(np.asarray(expert.tip_stiffness))
    ridge = np.repeat(expert.ridge, 3)

    def cost(k: np.ndarray) -> np.ndarray:
        return (k * error - wrench) ** 2 + ridge**2 * (k - k_tip) ** 2

    stiffness = expert.parameters(observed(error))
    moved = np.clip(stiffness * (1.0 + change), WIDE.minimum, WIDE.maximum)
    best = cost(stiffness)
    assert (best <= cost(moved) + 1e-12 * (1.0 + best)).all()


@given(root=roots, offset=offsets, error=errors)
def test_where_there_is_nothing_to_transport_the_gains_are_those_of_the_tip(
    root: np.ndarray, offset: np.ndarray, error: np.ndarray
) -> None:
    stiffness = stiffness_matrix(root)
    diagonal = np.diagonal(stiffness)
    at_goal = tip_expert(offset=tuple(offset), tip_stiffness=stiffness).parameters(np.zeros(12))
    np.testing.assert_allclose(at_goal, diagonal, rtol=1e-12)
    at_com = tip_expert(offset=(0.0, 0.0, 0.0), tip_stiffness=diagonal)
    np.testing.assert_allclose(at_com.parameters(observed(error)), diagonal, rtol=1e-9)
    narrow = DiagonalStiffness(
        stiffness_low=UNIT, stiffness_high=(2000.0, 2000.0, 800.0, 9.0, 9.0, 9.0), damping=UNIT
    )
    np.testing.assert_allclose(tip_expert(parametrisation=narrow).parameters(np.zeros(12)), narrow.maximum)


@given(error=errors, yaw=st.floats(-np.pi, np.pi), distance=st.floats(-0.2, 0.2))
def test_turning_everything_about_an_isotropic_axis_turns_the_wrench(
    error: np.ndarray, yaw: float, distance: float
) -> None:
    expert, turn = tip_expert(offset=(0.0, 0.0, distance)), rotation_exp([0.0, 0.0, yaw])
    turned = expert.wrench(observed(rotate(error, turn)))
    np.testing.assert_allclose(turned, rotate(expert.wrench(observed(error)), turn), atol=1e-9)


@given(observation=observations)
def test_the_tip_expert_stays_in_range_and_looks_at_the_newest_pose_only(observation: np.ndarray) -> None:
    expert = tip_expert()
    parameters, action = expert.parameters(observation), expert.action(observation)
    assert parameters.shape == action.shape == (4, 6)
    assert ((WIDE.minimum <= parameters) & (parameters <= WIDE.maximum)).all()
    assert (np.abs(action) <= 1.0).all()
    np.testing.assert_allclose(expert.gains(observation).stiffness_diagonal, parameters)
    history = np.concatenate([np.roll(observation, 1, axis=0), observation], axis=-1)
    history[:, 18:] = -1.0
    np.testing.assert_array_equal(expert.parameters(history), parameters)
    np.testing.assert_array_equal(expert.parameters(observation[2]), parameters[2])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"parametrisation": RANGE}, "pass a DiagonalStiffness"),
        ({"offset": (0.0, 0.06)}, r"offset has shape \(2,\)"),
        ({"offset": (0.0, 0.0, np.nan)}, "offset.*finite"),
        ({"tip_stiffness": np.ones(5)}, "tip_stiffness"),
        ({"tip_stiffness": np.append(K_TIP[:5], 0.0)}, r"tip_stiffness\[5\] is 0"),
        ({"tip_stiffness": np.append(K_TIP[:5], np.inf)}, "finite"),
        ({"tip_stiffness": -np.diag(K_TIP)}, "tip_stiffness"),
        ({"tip_stiffness": np.diag(K_TIP) + np.triu(np.ones((6, 6)), 1)}, "tip_stiffness.*symmetric"),
        ({"tip_stiffness": np.ones((6, 6))}, "tip_stiffness.*positive definite"),
        ({"tip_stiffness": "stiff"}, "tip_stiffness"),
        ({"ridge": (0.0, 1e-3)}, "ridge"),
        ({"ridge": (1e-4,)}, "ridge"),
    ],
)
def test_tips_that_cannot_be_used_are_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tip_expert(**options)


def test_the_tip_expert_refuses_bad_observations() -> None:
    for method in (tip_expert().parameters, tip_expert().wrench, tip_expert().tip_error):
        with pytest.raises(InputError, match="12 numbers"):
            method(np.zeros(11))
        with pytest.raises(InputError, match="observation"):
            method(np.full(12, np.nan))


def test_the_tip_stiffness_cannot_be_changed_later() -> None:
    given_matrix = np.diag(K_TIP)
    expert = tip_expert(tip_stiffness=given_matrix)
    given_matrix[0, 0] = 1.0
    np.testing.assert_array_equal(expert.parameters(np.zeros(12)), K_TIP)
    with pytest.raises(ValueError, match="read-only"):
        np.asarray(expert.tip_stiffness)[0, 0] = 1.0
