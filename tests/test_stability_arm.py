"""The moving inertia of an arm: exact rates, the price of cancelling C, what a law leaves that forgets a term."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.arms import ARMS, arm, random_gains, random_reference, random_states, task_acceleration
from vic_toolbox.control import CartesianLaw, Reference, feedback_wrench, simulate
from vic_toolbox.errors import InputError
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.spatial import (
    pose_from,
    quat_wxyz_to_rotation,
    rotation_exp,
    rotation_log,
    rotation_to_quat_wxyz,
)
from vic_toolbox.stability.arms.arm import arm_passivity
from vic_toolbox.stability.arms.inertia_passivity import inertia_passivity
from vic_toolbox.stability.arms.orientation_stiffness import orientation_stiffness
from vic_toolbox.stability.arms.path_inertia import path_inertia
from vic_toolbox.stability.verdict import Certificate, CounterExample
from vic_toolbox.tasks import cup_scene
from vic_toolbox.tasks.cup_on_plate import GAINS

STIFF = np.diag([500.0] * 3 + [20.0] * 3)
DAMPED = np.diag([100.0] * 3 + [8.0] * 3)
TIME = np.linspace(0.0, 1.0, 101)


def swing(model) -> np.ndarray:
    """A smooth motion about the home posture, (101, nv)."""
    return model.home + 0.5 * np.sin(4 * TIME)[:, None] * np.cos(np.arange(model.nv))


# --------------------------------------------------------------------------------- the inertia along a path


@pytest.mark.parametrize("name", ARMS)
def test_the_rate_of_the_mass_is_that_of_differences(name: str):
    model = arm(name)
    q, v = random_states(model, 20)
    here, h = path_inertia(model, q, v), 1e-6
    ahead, behind = (path_inertia(model, q + s * h * v, v).mass for s in (1, -1))
    np.testing.assert_allclose(
        here.mass_rate, (ahead - behind) / (2 * h), atol=1e-5 * np.abs(here.mass_rate).max()
    )
    np.testing.assert_allclose(here.mass, model.operational_space(q, v).mass)
    drift = np.matvec(here.coriolis, model.twist(q, v))
    if model.nv == 6:  # with a free joint C ẋ has a part that ẋ does not know
        np.testing.assert_allclose(drift, -here.without_coriolis, atol=1e-9)


@pytest.mark.parametrize("name", ["fanuc", "ur5"])
def test_a_forgotten_term_is_a_force_on_the_right_hand_side(name: str):
    """M ë + B ė + K e = residual, by Pinocchio's forward dynamics under a law that leaves the term out."""
    model = arm(name)
    q, v = random_states(model, 20)
    generator = np.random.default_rng(2)
    reference, gains = random_reference(generator, model.pose(q)), random_gains(generator, 20)
    law, here = CartesianLaw(model=model), path_inertia(model, q, v)
    space = model.operational_space(q, v)
    torque = law.impedance(q, v, reference=reference, gains=gains).torque
    e, rate = law.error(q, v, reference=reference)
    shortcuts = {
        "coriolis": (-space.coriolis, here.without_coriolis),
        "jacobian rate": (
            np.matvec(space.mass, np.matvec(space.jacobian_dot, v)),
            here.without_jacobian_rate,
        ),
    }
    for change, residual in shortcuts.values():
        joint = model.acceleration(q, v, torque + np.vecmat(change, space.jacobian))
        acceleration = np.array([task_acceleration(model, *s) for s in zip(q, v, joint, strict=True)])
        left = np.matvec(space.mass, acceleration - reference.acceleration)
        left += np.matvec(gains.damping, rate) + np.matvec(gains.stiffness, e)
        np.testing.assert_allclose(left, residual, atol=1e-6 * np.abs(residual).max() + 1e-7)
    off, _ = here.displacement(gains.stiffness)
    np.testing.assert_allclose(np.matvec(gains.stiffness, off), here.without_coriolis, atol=1e-9)


def test_34_newtons_on_the_fast_reach():
    """The shortcut ``τ = C q̇ + g + Jᵀ F_fb``, with the stiffest and least damped gains of Cup-on-Plate."""
    model, down = arm("fanuc"), quat_wxyz_to_rotation(cup_scene.TOOL_DOWN_QUAT_WXYZ)
    start = model.inverse_kinematics(pose_from([0.35, -0.35, 0.45], down))
    goal, law = Reference(pose_from(cup_scene.GOAL, down)), CartesianLaw(model=model)
    gains = GAINS.to_gains([1.0] * 6 + [-1.0])

    def shortcut(_: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        wrench = feedback_wrench(*law.error(q, v, reference=goal), gains=gains)
        return model.bias(q, v) + np.vecmat(wrench, model.jacobian(q))

    motion = simulate(model, shortcut, q=start, duration=1.0, timestep=4e-3)
    residual = path_inertia(model, motion.q, motion.v).without_jacobian_rate
    assert np.linalg.norm(residual[:, :3], axis=1).max() == pytest.approx(34.2, abs=0.1)


# --------------------------------------------------------------------------------------------------- passivity


@pytest.mark.parametrize("b0", [0.5, 1.0, 1.99, 2.01, 4.0])
@pytest.mark.parametrize(("mass", "stiffness"), [(2.0, 500.0), (7.0, 3.0)])
def test_a_growing_mass_needs_half_its_rate(b0: float, mass: float, stiffness: float):
    """m = 2(1+t)², b = b₀(1+t), k = 500: stable iff b₀ > 2 (Cauchy-Euler), that is B = ½Ṁ; for m = c(1+t)², b₀ > c."""
    t = np.linspace(0.0, 20.0, 1001)
    b0 = b0 * mass / 2
    verdict = inertia_passivity(
        mass * (1 + t) ** 2, stiffness, b0 * (1 + t), time=t, mass_rate=2 * mass * (1 + t)
    )
    assert verdict.status == ("proved" if b0 > mass else "disproved")
    assert verdict.margin == pytest.approx(1 - mass / b0)
    np.testing.assert_allclose(verdict.values["share"], mass / b0)
    if b0 < mass:
        assert isinstance(verdict.witness, CounterExample)
        time, state = verdict.witness.replay()
        np.testing.assert_allclose(state, verdict.witness.state, atol=1e-5 * np.abs(state).max())
        e, rate = state.T
        energy = 0.5 * (mass * (1 + time) ** 2 * rate**2 + stiffness * e**2)
        assert energy[-1] > energy[0] * (1 + 1e-6)
        assert verdict.values["energy_gain"] >= energy[-1] / energy[0] * (1 - 1e-3)


def test_at_the_edge_nothing_is_claimed():
    t = np.linspace(0.0, 5.0, 501)
    assert (
        inertia_passivity(2 * (1 + t) ** 2, 500.0, 2 * (1 + t), time=t, mass_rate=4 * (1 + t)).status
        == "inconclusive"
    )


@pytest.mark.parametrize("name", ARMS)
def test_the_law_on_an_arm(name: str):
    model = arm(name)
    well = arm_passivity(model, STIFF, 3 * DAMPED, time=TIME, q=swing(model))
    assert well.status == "proved"
    assert isinstance(well.witness, Certificate)
    assert 0 < well.margin < 1
    share = well.values["damping_factor"]
    poor = arm_passivity(model, STIFF, 3 * DAMPED * share / 4, time=TIME, q=swing(model))
    assert poor.values["damping_factor"] == pytest.approx(4.0)
    assert poor.status == "disproved"
    assert poor.margin == pytest.approx(-3.0)
    kept = arm_passivity(
        model, STIFF, 3 * DAMPED * share / 4, time=TIME, q=swing(model), coriolis="reference"
    )
    assert kept.status == "proved", "with C ė in the loop every damping is enough"
    assert kept.margin == pytest.approx(1.0, abs=1e-9)
    for verdict in (well, poor, kept):
        assert verdict.values["without_jacobian_rate"] > 1
        assert verdict.to_dict()["status"] == verdict.status


def test_the_margin_knows_no_units():
    """In millimetres and milliseconds, the share is the same."""
    model = arm("fanuc")
    here = path_inertia(model, swing(model), np.gradient(swing(model), TIME, axis=0))
    length = np.diag([1e-3] * 3 + [1.0] * 3)

    def scaled(x: np.ndarray) -> np.ndarray:
        return length @ x @ length

    one = inertia_passivity(here.mass, STIFF, DAMPED, time=TIME, mass_rate=here.mass_rate)
    other = inertia_passivity(
        scaled(here.mass),
        1e-6 * scaled(STIFF),
        1e-3 * scaled(DAMPED),
        time=1e3 * TIME,
        mass_rate=1e-3 * scaled(here.mass_rate),
    )
    assert other.status == one.status
    assert other.margin == pytest.approx(one.margin)


def test_a_path_through_a_singularity_is_not_judged():
    model = arm("fanuc")
    q = np.zeros((len(TIME), 6))
    q[:, 4] = np.linspace(-0.3, 0.3, len(TIME))
    with pytest.warns(RuntimeWarning, match="singularity"):
        verdict = arm_passivity(model, STIFF, DAMPED, time=TIME, q=q)
    assert verdict.status == "inconclusive"
    assert "singularity" in verdict.reason


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time": TIME[:50]}, "shape"),
        ({"time": -TIME}, "time"),
        ({"q": np.full((101, 6), np.nan)}, "q"),
        ({"damping": -DAMPED}, "damping"),
        ({"damping": np.eye(5)}, "damping"),
        ({"stiffness": np.triu(np.ones((6, 6)))}, "symmetric"),
        ({"stiffness": np.tile(STIFF, (101, 1, 1))}, "kronander_billard"),
        ({"coriolis": "maybe"}, "reference"),
    ],
)
def test_bad_input_is_refused(change: dict, message: str):
    model = arm("fanuc")
    arguments = {"stiffness": STIFF, "damping": DAMPED, "time": TIME, "q": swing(model)} | change
    with pytest.raises(InputError, match=message):
        arm_passivity(model, **arguments)


def test_a_rate_of_another_mass_is_refused():
    with pytest.raises(InputError, match="rate of mass"):
        inertia_passivity(1 + TIME, 1.0, 1.0, time=TIME, mass_rate=-np.ones(101))
    with pytest.raises(InputError, match="as many"):
        inertia_passivity(1.0, 1.0, 1.0, time=TIME, mass_rate=0.0)


# --------------------------------------------------------------------------- orientation errors, and the peg


def test_stiffness_left_at_60_degrees():
    angle = np.deg2rad(60)
    assert orientation_stiffness(angle, error="sine") == pytest.approx(0.5)
    assert orientation_stiffness(angle, error="half-sine") == pytest.approx(0.8660, abs=5e-5)
    assert orientation_stiffness(angle) == 1.0
    with pytest.raises(InputError, match="half-sine"):
        orientation_stiffness(angle, error="euler")  # type: ignore[arg-type]


@given(st.floats(-3.1, 3.1), st.integers(0, 2**32 - 1))
def test_the_slopes_are_those_of_the_errors_of_a_rotation(angle: float, seed: int):
    axis = np.random.default_rng(seed).normal(size=3)
    axis /= np.linalg.norm(axis)

    def errors(theta: float) -> dict[str, float]:
        rotation = rotation_exp(theta * axis)
        skew = 0.5 * (rotation - rotation.T)
        quaternion = rotation_to_quat_wxyz(rotation)
        quaternion = quaternion * np.sign(quaternion[0])
        return {
            "sine": float(axis @ [skew[2, 1], skew[0, 2], skew[1, 0]]),
            "half-sine": float(2 * axis @ quaternion[1:]),
            "log": float(axis @ rotation_log(rotation)),
        }

    h = 1e-5
    ahead, behind = errors(angle + h), errors(angle - h)
    for name in ahead:
        slope = (ahead[name] - behind[name]) / (2 * h)
        assert orientation_stiffness(angle, error=name) == pytest.approx(slope, abs=1e-6)  # type: ignore[arg-type]


def test_a_diagonal_peg_spring_would_be_negative():
    """Tip 0.1 m below, k_x = 1000, e = 1 mm and 0.02 rad that swings the tip back by 2 mm: k₁ = −1000."""
    tip = ImpedanceGains.diagonal([1000.0, 1000.0, 1000.0, 10.0, 10.0, 10.0], [1.0] * 6)
    at_centre = tip.transported([0.0, 0.0, 0.1]).stiffness
    error = np.array([1e-3, 0.0, 0.0, 0.0, 0.02, 0.0])
    assert (at_centre @ error)[0] / error[0] == pytest.approx(-1000.0)
