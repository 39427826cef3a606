"""The twin's physics: without imperfections it is the model, with them it stays within its bounds."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vic_toolbox import twin
from vic_toolbox.errors import InputError
from vic_toolbox.spatial import rotate, transport_wrench
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.tasks.vector_environment import VectorEnvironment
from vic_toolbox.twin import Imperfections, Twin
from vic_toolbox.twin.loop import PERIOD, in_steps
from vic_toolbox.twin.plant import HAND, SENSOR_OFFSET, SENSOR_ROTATION, links, plant_model, sensor_columns

PERFECT = Twin(Imperfections.none())
START = cup_scene.start_angles(cup_scene.SCENARIOS["train"].start)


def random_state(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return START + 0.2 * rng.standard_normal(6), rng.standard_normal(6)


def at(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    return data


@pytest.mark.parametrize("seed", range(3))
def test_a_perfect_robot_moves_as_pinocchio_says_under_torque_and_hand(seed: int):
    model, arm = plant_model(PERFECT.specimen), cup_scene.robot()
    qpos, qvel = random_state(seed)
    rng = np.random.default_rng(seed)
    torque, hand = rng.standard_normal(6), rng.standard_normal(6)
    data = at(model, qpos, qvel)
    data.ctrl[:], data.xfrc_applied[model.body(HAND).id] = torque, hand
    mujoco.mj_forward(model, data)
    assert data.qacc == pytest.approx(
        arm.acceleration(qpos, qvel, torque, external_wrench=-hand), rel=1e-8, abs=1e-9
    )


def test_site_0_is_the_end_effector():
    model = plant_model(PERFECT.specimen)
    data = at(model, START, np.zeros(6))
    mujoco.mj_forward(model, data)
    assert data.site_xpos[0] == pytest.approx(cup_scene.robot().pose(START)[:3, 3], abs=1e-12)
    assert data.xipos[model.body(HAND).id] == pytest.approx(data.site_xpos[0], abs=1e-12)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31))
def test_every_robot_is_within_its_bounds_and_a_body(seed: int):
    nominal, other = plant_model(PERFECT.specimen), plant_model(Twin(seed=seed).specimen)
    moving = nominal.body_mass > 0
    assert np.abs(other.body_mass[moving] / nominal.body_mass[moving] - 1).max() <= 0.01
    assert np.abs(other.dof_armature / nominal.dof_armature - 1).max() <= 0.2
    assert (other.dof_damping > 0).all()
    assert (other.dof_frictionloss > 0).all()
    inertia = other.body_inertia[moving]
    assert (2 * inertia.max(axis=1) <= inertia.sum(axis=1) * (1 + 1e-9)).all()  # triangle inequality


def test_inertia_is_perturbed_too():
    specimen = Imperfections(mass=0.0).sample(links(), joints=6, seed=1)
    data = [at(plant_model(s), START, np.zeros(6)) for s in (PERFECT.specimen, specimen)]
    models = [plant_model(s) for s in (PERFECT.specimen, specimen)]
    matrices = []
    for model, state in zip(models, data, strict=True):
        mujoco.mj_forward(model, state)
        full = np.empty((6, 6))
        mujoco.mj_fullM(model, state, full)
        matrices.append(full)
    change = np.abs(matrices[1] - matrices[0]).max() / np.abs(matrices[0]).max()
    assert 0.01 < change < 0.2
    assert data[1].qfrc_bias == pytest.approx(data[0].qfrc_bias, abs=1e-9)  # weight has not changed


@pytest.mark.parametrize("seed", range(3))
def test_the_sensor_feels_hand_weight_and_inertia(seed: int):
    """Newton and Euler for gripper and cup: sensor = hand + m (g − a_c), and the rate of angular momentum."""
    model = plant_model(Twin(seed=seed).specimen)
    qpos, qvel = random_state(seed)
    hand = np.random.default_rng(seed).standard_normal(6) * [10, 10, 10, 1, 1, 1]
    data = at(model, qpos, qvel)
    data.xfrc_applied[model.body(HAND).id] = hand
    mujoco.mj_forward(model, data)
    mujoco.mj_rnePostConstraint(model, data)
    orientation = data.site_xmat[0].reshape(3, 3)
    sensor = data.site_xpos[0] + orientation @ SENSOR_OFFSET
    expected = transport_wrench(hand, sensor - data.site_xpos[0])
    for name in links()[-2:]:
        body = model.body(name).id
        mass, centre = model.body_mass[body], data.xipos[body]
        frame = data.ximat[body].reshape(3, 3)
        tensor = frame @ np.diag(model.body_inertia[body]) @ frame.T
        jacobian, rate = np.zeros((6, 6)), np.zeros((6, 6))
        mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], centre, body)
        mujoco.mj_jacDot(model, data, rate[:3], rate[3:], centre, body)
        twist, acceleration = jacobian @ qvel, jacobian @ data.qacc + rate @ qvel
        force = mass * (model.opt.gravity - acceleration[:3])
        moment = -tensor @ acceleration[3:] - np.cross(twist[3:], tensor @ twist[3:])
        expected += transport_wrench(np.concatenate([force, moment]), sensor - centre)
    axes = orientation @ np.array(SENSOR_ROTATION)
    assert -data.sensordata[sensor_columns(model)] == pytest.approx(rotate(expected, axes.T), abs=1e-8)


def test_a_perfect_twin_is_the_task():
    """Gains at 100 Hz on the twin without imperfections end where the task's own closed loop ends."""
    task = CupOnPlate()
    task.horizon = 150
    environment = VectorEnvironment(task, 2, start_noise=0.0)
    observations, _ = environment.reset(seed=0, options={"scenarios": ["train", "T2"]})
    for _ in range(task.horizon):
        observations, *_ = environment.step(task.expert_action(observations))
    ran = twin.run(PERFECT, task.expert_action, task=task, scenarios=["train", "T2"])
    assert ran.error[:, -1] == pytest.approx(observations, abs=1e-8)
    assert ran.observations == pytest.approx(ran.error, abs=1e-12)  # it sees the truth


def test_the_controller_sees_the_state_of_2_ms_ago():
    flaws = dataclasses.replace(Imperfections.none(), delay=2e-3)
    loop = Twin(flaws).loop(2, rng=np.random.default_rng(0))
    loop.reset(START)
    past = []
    for i in range(20):
        past.append((loop.arm.qpos.copy(), loop.arm.qvel.copy()))
        late = max(i - 2, 0)
        assert np.array_equal(loop.law.qpos, past[late][0])
        assert np.array_equal(loop.law.qvel, past[late][1])
        loop.step([0.0, 5.0 * i, 0.0, 0.0, 0.1, 0.0])
    assert loop.time == pytest.approx(20 * PERIOD)


def test_noise_has_the_stated_size_and_encoders_count_in_steps():
    flaws = dataclasses.replace(Imperfections(), angle_noise=1e-4, angle_resolution=3e-5)
    loop = Twin(flaws).loop(400, rng=np.random.default_rng(0))
    loop.reset(START)
    off = loop.law.qpos - loop.arm.qpos
    assert off.std() == pytest.approx(np.hypot(1e-4, 3e-5 / np.sqrt(12)), rel=0.05)
    assert loop.law.qvel.std() == pytest.approx(flaws.speed_noise, rel=0.05)
    assert np.abs(loop.law.qpos / 3e-5 - np.round(loop.law.qpos / 3e-5)).max() < 1e-6


def test_energy_is_what_hand_and_motors_put_in_less_friction():
    """Without friction the balance closes to the integrator's first order; with it, energy is lost."""
    lost = []
    for flaws in (Imperfections.none(), dataclasses.replace(Imperfections.none(), friction=1.0)):
        loop = Twin(flaws).loop(1, rng=np.random.default_rng(0))
        loop.reset(START)
        put_in, before = 0.0, energy(START, np.zeros(6))
        for i in range(300):
            hand = np.array([20.0 * np.sin(0.02 * i), 15.0, 5.0, 0.0, 0.05, 0.0])
            state = loop.arm.qpos[0].copy(), loop.arm.qvel[0].copy()
            loop.step(hand)
            speed = (state[1] + loop.arm.qvel[0]) / 2
            torque = loop.arm.batch.bind("ctrl")[0]
            put_in += PERIOD * (torque @ speed + hand @ cup_scene.robot().twist(state[0], speed))
        kept = energy(loop.arm.qpos[0], loop.arm.qvel[0]) - before
        lost.append((put_in - kept) / kept)
    assert abs(lost[0]) < 0.01 < 1.0 < lost[1]


def energy(q: np.ndarray, v: np.ndarray) -> float:
    arm = cup_scene.robot()
    data = arm.pinocchio.createData()
    return float(0.5 * v @ arm.mass_matrix(q) @ v + pin.computePotentialEnergy(arm.pinocchio, data, q))


@given(value=st.floats(-10, 10), step=st.floats(1e-6, 1.0))
def test_steps(value: float, step: float):
    rounded = in_steps(np.array(value), step)
    assert abs(rounded - value) <= step / 2 * (1 + 1e-6)
    assert in_steps(np.array(value), 0.0) == value


@pytest.mark.parametrize(
    ("field", "value"),
    [("inertia", 1.0), ("mass", -0.1), ("delay", 1.5e-3), ("delay", np.inf), ("speed_noise", np.nan)],
)
def test_bad_imperfections_are_refused(field: str, value: float):
    with pytest.raises(InputError, match=field):
        Imperfections(**{field: value})


# --- policies ------------------------------------------------------------------------------------------------


def test_gains_survive_the_step_to_another_robot_and_wrenches_do_not():
    """The paper's sim-to-real figure: replayed gains stay within millimetres, a replayed wrench goes astray."""
    task, starts = CupOnPlate(), ["train", "T1"]
    nominal = twin.run(PERFECT, task.expert_action, task=task, scenarios=starts)
    real = twin.run(Twin(seed=1), task.expert_action, task=task, scenarios=starts)
    mean, final = real.deviation(nominal)
    assert mean.max() < 6e-3
    assert final.max() < 8e-3
    assert not real.stopped.any()
    assert np.linalg.norm(real.position[:, -1] - cup_scene.GOAL, axis=-1).max() < 25e-3
    assert real.peak_force.max() < 25.0

    force = task.with_action("force")
    wrenches = iter(force.expert_action(nominal.observations[:, :-1]).swapaxes(0, 1))
    replayed = twin.run(Twin(seed=1), lambda _: next(wrenches), task=force, scenarios=starts)
    assert replayed.deviation(nominal)[1].min() > 50e-3


def test_a_history_begins_with_the_first_observation_and_moves_on():
    task = CupOnPlate(history=3)
    task.horizon = 4
    seen = twin.run(Twin(), task.expert_action, task=task).observations[0]
    assert np.array_equal(seen[0, :12], seen[0, 24:])
    assert np.array_equal(seen[1:, :24], seen[:-1, 12:])


def test_actions_of_a_wrong_shape_are_refused():
    with pytest.raises(InputError, match="actions"):
        twin.run(Twin(), lambda observations: np.zeros((1, 3)))
