"""What the nullspace lets through does not move the end-effector, and keeps a redundant arm's posture."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.arms import (
    ARMS,
    arm,
    random_gains,
    random_reference,
    random_states,
    task_acceleration,
)
from vic_toolbox.control import (
    CartesianLaw,
    Posture,
    Reference,
    dynamically_consistent_inverse,
    nullspace_projector,
    simulate,
)
from vic_toolbox.errors import InputError
from vic_toolbox.gains import ImpedanceGains


@pytest.mark.parametrize("name", ARMS)
def test_inverse_and_projector_axioms(name: str) -> None:
    model = arm(name)
    q, _ = random_states(model, 20)
    mass, jacobian = model.mass_matrix(q), model.jacobian(q)
    inverse = dynamically_consistent_inverse(mass, jacobian)
    projector = nullspace_projector(mass, jacobian)
    np.testing.assert_allclose(jacobian @ inverse, np.broadcast_to(np.eye(6), (20, 6, 6)), atol=1e-9)
    np.testing.assert_allclose(projector @ projector, projector, atol=1e-9)
    np.testing.assert_allclose(jacobian @ np.linalg.solve(mass, projector), 0.0, atol=1e-9)
    np.testing.assert_allclose(np.trace(projector, axis1=-2, axis2=-1), model.nv - 6, atol=1e-9)


def test_inverse_is_the_models_own() -> None:
    model = arm("panda")
    q, v = random_states(model, 5)
    space = model.operational_space(q, v)
    for task_mass in (None, space.mass):
        inverse = dynamically_consistent_inverse(model.mass_matrix(q), space.jacobian, task_mass=task_mass)
        np.testing.assert_allclose(inverse, space.jacobian_inverse, atol=1e-10)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_nullspace_torque_has_no_task_acceleration(seed: int) -> None:
    model = arm("panda")
    q, v = (states[0] for states in random_states(model, 1, seed=seed))
    torque = np.random.default_rng(seed).normal(size=7) * 50.0
    projected = nullspace_projector(model.mass_matrix(q), model.jacobian(q)) @ torque
    assert np.linalg.norm(projected) > 1e-3
    moved, unmoved = (
        task_acceleration(model, q, v, model.acceleration(q, v, model.bias(q, v) + t))
        for t in (projected, np.zeros(7))
    )
    np.testing.assert_allclose(moved, unmoved, atol=1e-8)


def test_posture_does_not_disturb_the_impedance() -> None:
    model = arm("panda")
    q, v = random_states(model, 10)
    generator = np.random.default_rng(3)
    reference, gains = random_reference(generator, model.pose(q)), random_gains(generator, 10)
    posture = Posture(model.home, stiffness=30.0, damping=5.0)
    seen = []
    for law in (CartesianLaw(model=model), CartesianLaw(model=model, posture=posture)):
        torque = law.impedance(q, v, reference=reference, gains=gains).torque
        states = zip(q, v, model.acceleration(q, v, torque), strict=True)
        seen.append([task_acceleration(model, *state) for state in states])
    np.testing.assert_allclose(*seen, atol=1e-8)


def test_posture_brings_the_elbow_back_while_the_hand_stays() -> None:
    """The hand rests at its reference; the elbow, set in motion, returns, and the hand does not notice."""
    model = arm("panda")
    posture = Posture(model.home, stiffness=20.0, damping=6.0)
    law = CartesianLaw(model=model, posture=posture)
    reference = Reference(model.pose(model.home))
    gains = ImpedanceGains.diagonal([400.0] * 3 + [20.0] * 3, [80.0] * 3 + [4.0] * 3)
    free = np.linalg.svd(model.jacobian(model.home))[2][-1]
    motion = simulate(
        model,
        lambda t, q, v: law.impedance(q, v, reference=reference, gains=gains).torque,
        q=model.home,
        v=2.0 * free,
        duration=3.0,
        timestep=5e-3,
    )
    away = np.linalg.norm(motion.q - model.home, axis=1)
    assert away.max() > 0.05
    assert away[-1] < 0.1 * away.max()
    error, _ = motion.error(reference)
    assert np.linalg.norm(error, axis=1).max() < 1e-3


def test_posture_torque_is_a_spring_and_damper() -> None:
    posture = Posture(np.array([0.1, 0.2]), stiffness=3.0, damping=0.5)
    np.testing.assert_allclose(posture.torque([[0.0, 0.0]], [[1.0, -2.0]]), [[-0.2, 1.6]])


def test_bad_input_is_refused_with_a_way_out() -> None:
    with pytest.raises(InputError, match="posture angles"):
        Posture(np.full(7, np.nan))
    with pytest.raises(InputError, match="posture stiffness"):
        Posture(np.zeros(7), stiffness=-1.0)
    with pytest.raises(InputError, match="posture damping"):
        Posture(np.zeros(7), damping=np.inf)
    with pytest.raises(InputError, match="q has shape"):
        Posture(np.zeros(7)).torque(np.zeros(6), np.zeros(6))
    with pytest.raises(InputError, match="jacobian has shape"):
        nullspace_projector(np.eye(7), np.zeros((3, 7)))
    with pytest.raises(InputError, match="mass_matrix has shape"):
        nullspace_projector(np.eye(6), np.zeros((6, 7)))
    with pytest.raises(InputError, match="lost rank"):
        nullspace_projector(np.eye(7), np.zeros((6, 7)))
