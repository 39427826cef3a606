"""Experts stay in their range, change continuously, and do in each phase what the task wants."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vic_toolbox.control import ConstantGains, ThreePhaseExpert
from vic_toolbox.errors import InputError
from vic_toolbox.gains import DampingFactor, Diagonal

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
