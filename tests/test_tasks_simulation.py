"""The simulated arm obeys the impedance law, mechanics, and nobody else's model is touched."""

from __future__ import annotations

import ctypes
import functools

import mujoco
import numpy as np
import pytest

from vic_toolbox import tasks
from vic_toolbox.control import CartesianLaw, Reference
from vic_toolbox.control.compiled import LAW_FIELDS, LAW_MAGIC, law_block
from vic_toolbox.errors import InputError, ModelError, SimulationError
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.models import available_robots, load_robot
from vic_toolbox.spatial import pose_error, pose_from
from vic_toolbox.tasks import callback, cup_on_plate, cup_scene, mujoco_structs, scene
from vic_toolbox.tasks.kinematics import Chain
from vic_toolbox.tasks.simulation import ArmSimulation

GOAL_POSE = pose_from(cup_scene.GOAL, cup_scene.TOOL_DOWN)
STARTS = [cup_scene.start_angles(s.start) for s in cup_scene.SCENARIOS.values()]
ROBOT = cup_scene.robot()


def simulation(count: int = len(STARTS), threads: int = 1) -> ArmSimulation:
    """Arms at the five starts, one after the other."""
    made = ArmSimulation(cup_scene.physics_model(), count, threads=threads, push_body=cup_scene.CUP)
    qpos = np.array([STARTS[i % len(STARTS)] for i in range(count)])
    made.reset(qpos, position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
    return made


def schedule(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Random stiffnesses and dampings in the task's range."""
    stiffness = rng.uniform([60] * 3 + [1] * 3, [200] * 3 + [6] * 3, (count, 6))
    damping = rng.uniform(9, 12, (count, 1)) * np.sqrt(stiffness)
    damping[:, 3:] = cup_on_plate.ROTATIONAL_DAMPING
    return stiffness, damping


def test_compiled_law_equals_the_numpy_law_after_20_policy_steps() -> None:
    law, reference = CartesianLaw(model=ROBOT), Reference(GOAL_POSE)
    compiled, rng = simulation(), np.random.default_rng(0)
    gains = [schedule(rng, compiled.count) for _ in range(20)]
    for stiffness, damping in gains:
        compiled.stiffness[:], compiled.damping[:] = stiffness, damping
        compiled.step(10)
    for i, start in enumerate(STARTS):
        data = mujoco.MjData(
            compiled.model
        )  # its law block has no magic number: the callback leaves it alone
        data.qpos[:] = start
        for stiffness, damping in gains:
            for _ in range(10):
                mujoco.mj_step1(compiled.model, data)
                diagonal = ImpedanceGains.diagonal(stiffness[i], damping[i])
                command = law.impedance(data.qpos, data.qvel, reference=reference, gains=diagonal)
                data.ctrl[:] = command.torque
                mujoco.mj_step2(compiled.model, data)
        np.testing.assert_allclose(compiled.qpos[i], data.qpos, rtol=0, atol=1e-12)


def test_closed_loop_is_a_mass_a_spring_and_a_damper() -> None:
    loop, rng = simulation(), np.random.default_rng(1)
    worst = 0.0
    for _ in range(60):
        loop.stiffness[:], loop.damping[:] = schedule(rng, loop.count)
        loop.step(10)
        for i in range(loop.count):
            data = loop.batch.get_data(i)
            mujoco.mj_forward(loop.model, data)
            q, v = data.qpos, data.qvel
            space = ROBOT.operational_space(q, v)
            acceleration = space.jacobian @ data.qacc + ROBOT.jacobian_dot(q, v) @ v
            error, rate = pose_error(ROBOT.pose(q), GOAL_POSE), ROBOT.twist(q, v)
            residual = space.mass @ acceleration + loop.damping[i] * rate + loop.stiffness[i] * error
            worst = max(worst, np.abs(residual).max())
    assert worst < 1e-2


def test_energy_changes_by_the_work_of_the_torques() -> None:
    loop, rng = simulation(), np.random.default_rng(2)
    model = loop.model
    for _ in range(30):
        loop.stiffness[:], loop.damping[:] = schedule(rng, loop.count)
        loop.step(10)
    probe, flags = mujoco.MjData(model), model.opt.enableflags
    model.opt.enableflags = flags | int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    try:
        for i in range(loop.count):
            data = loop.batch.get_data(i)
            mujoco.mj_forward(model, data)
            energy, h = [], 1e-5
            for sign in (-1, 1):
                probe.qpos[:] = data.qpos + sign * h * data.qvel + h**2 / 2 * data.qacc
                probe.qvel[:] = data.qvel + sign * h * data.qacc
                mujoco.mj_forward(model, probe)
                energy.append(probe.energy.sum())
            power = (energy[1] - energy[0]) / (2 * h)
            assert power == pytest.approx(data.qvel @ data.ctrl, abs=1e-4)
    finally:
        model.opt.enableflags = flags


@pytest.mark.parametrize("name", sorted(available_robots()))
def test_scene_of_every_arm_has_its_dynamics_and_fixed_fingers(name: str) -> None:
    robot = load_robot(name)
    model = scene.arm_spec(robot).compile()
    assert (model.nq, model.neq) == (robot.nq, 0)
    data, mass, rng = mujoco.MjData(model), np.empty((robot.nv, robot.nv)), np.random.default_rng(4)
    data.qpos[:], data.qvel[:] = robot.random_postures(rng, 1)[0], rng.normal(size=robot.nv)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    np.testing.assert_allclose(mass, robot.mass_matrix(data.qpos), atol=1e-9)
    np.testing.assert_allclose(data.qfrc_bias, robot.bias(data.qpos, data.qvel), atol=1e-9)
    np.testing.assert_allclose(data.site_xpos[0], robot.pose(data.qpos)[:3, 3], atol=1e-9)


def test_scene_has_the_dynamics_of_the_robot_model() -> None:
    model, rng = cup_scene.physics_model(), np.random.default_rng(3)
    data, mass = mujoco.MjData(model), np.empty((6, 6))
    full = cup_scene.build_spec().compile()
    full_data, full_mass = mujoco.MjData(full), np.empty((6, 6))
    for _ in range(50):
        q, v = rng.uniform(ROBOT.lower, ROBOT.upper), rng.normal(size=6)
        for m, d, out in ((model, data, mass), (full, full_data, full_mass)):
            d.qpos[:], d.qvel[:] = q, v
            mujoco.mj_forward(m, d)
            mujoco.mj_fullM(m, d, out)
            np.testing.assert_allclose(out, ROBOT.mass_matrix(q), atol=1e-9)
            np.testing.assert_allclose(d.qfrc_bias, ROBOT.bias(q, v), atol=1e-9)
            np.testing.assert_allclose(d.site_xpos[0], ROBOT.pose(q)[:3, 3], atol=1e-9)


def test_observation_is_the_pose_error_and_twist_of_the_present_state() -> None:
    loop, rng = simulation(), np.random.default_rng(4)
    loop.qpos[:] += rng.normal(size=loop.qpos.shape)
    loop.qvel[:] = rng.normal(size=loop.qvel.shape)
    observed = loop.observe()
    np.testing.assert_allclose(observed[:, :6], pose_error(ROBOT.pose(loop.qpos), GOAL_POSE), atol=1e-12)
    np.testing.assert_allclose(observed[:, 6:], ROBOT.twist(loop.qpos, loop.qvel), atol=1e-12)


def test_threads_do_not_change_a_bit() -> None:
    states = []
    for threads in (1, 4):
        loop, rng = simulation(40, threads), np.random.default_rng(5)
        for _ in range(30):
            loop.stiffness[:], loop.damping[:] = schedule(rng, loop.count)
            loop.step(10)
        states.append(loop.batch.state.copy())
    np.testing.assert_array_equal(*states)


def test_wrench_is_a_force_on_the_end_effector() -> None:
    loop = simulation()
    loop.wrench[:, 1] = 5.0
    loop.step(1)
    for i, start in enumerate(STARTS):
        space = ROBOT.operational_space(start, np.zeros(6))
        expected = 1e-3 * np.linalg.solve(space.mass, [0, 5, 0, 0, 0, 0])
        np.testing.assert_allclose(ROBOT.twist(loop.qpos[i], loop.qvel[i]), expected, atol=1e-6)


def test_push_acts_on_the_cup_and_ends_with_the_reset() -> None:
    loop = simulation()
    loop.set_push([0.0, 0.0, -3.0])
    loop.step(1)
    assert (loop.observe()[:, 8] < 0).all()
    loop.reset(STARTS[0], position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
    loop.step(1)
    np.testing.assert_allclose(loop.qvel, 0.0, atol=1e-12)


def test_contact_force_holds_what_presses_on_the_plate() -> None:
    loop = simulation(1)
    above = [cup_scene.PLATE[0], cup_scene.PLATE[1], cup_scene.PLATE_TOP + 1e-3]
    q = ROBOT.inverse_kinematics(pose_from(above, cup_scene.TOOL_DOWN), start=STARTS[0])
    loop.reset(q, position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
    loop.stiffness[:], loop.damping[:] = [200] * 3 + [6] * 3, [200] * 3 + [20] * 3
    loop.wrench[:, 2] = -8.0
    loop.step(4000)
    pressed = 8.0 + 200 * loop.observe()[0, 2]
    assert loop.contact_force[0] == pytest.approx(pressed, rel=0.02)
    assert loop.peak_force[0] >= loop.contact_force[0]


@pytest.mark.parametrize("bad", [50.0, np.nan])
def test_runaway_simulation_is_halted_and_named_and_the_others_go_on(bad: float) -> None:
    loop, undisturbed = simulation(), simulation()
    for each in (loop, undisturbed):
        each.stiffness[:], each.damping[:] = [100] * 3 + [3] * 3, [100] * 3 + [20] * 3
        each.step(10)
    before = loop.qpos[2].copy()
    loop.step(1)
    undisturbed.step(1)
    loop.qvel[2, 3] = bad
    observed = loop.observe()
    np.testing.assert_array_equal(loop.stopped, [False, False, True, False, False])
    for _ in range(5):
        loop.step(10)
        undisturbed.step(10)
        observed = loop.observe()
    np.testing.assert_array_equal(loop.qpos[2], before)
    np.testing.assert_array_equal(observed[2, 6:], 0.0)
    others = [0, 1, 3, 4]
    np.testing.assert_array_equal(observed[others], undisturbed.observe()[others])
    loop.reset(STARTS[0], position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
    assert not loop.stopped.any()


def test_runaway_episode_is_reported_and_no_success() -> None:
    environment = tasks.CupOnPlateVectorEnv(2)
    observation, info = environment.reset(seed=0)
    for _ in range(environment.task.horizon):
        environment.simulation.qvel[1, 0] = 99.0 if environment.simulation.time > 4.9 else 0.0
        observation, _, _, _, info = environment.step(environment.expert_action(observation))
    np.testing.assert_array_equal(info["stopped"], [False, True])
    assert not info["success"][1]


def test_other_models_are_left_alone() -> None:
    simulation().step(1)
    xml = (
        "<mujoco><size nuserdata='{n}'/><worldbody><body><joint name='j'/><geom size='.1'/></body>"
        "</worldbody><actuator><motor joint='j'/></actuator></mujoco>"
    )
    for length in (0, 3, callback.userdata_size(6)):
        model = mujoco.MjModel.from_xml_string(xml.format(n=length))
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.5
        data.userdata[:] = 7.0
        mujoco.mj_step(model, data)
        assert data.ctrl[0] == 0.5
        assert (data.userdata == 7.0).all()


def test_arms_of_different_size_share_one_callback() -> None:
    links = 7
    body = "".join(
        f"<body pos='0 0 .2'><joint axis='{i % 2} {1 - i % 2} .3'/><geom size='.05' mass='1'/>"
        for i in range(links)
    )
    motors = "".join(f"<motor joint='j{i}' gear='1'/>" for i in range(links))
    for i in range(links):
        body = body.replace("<joint axis", f"<joint name='j{i}' axis", 1)
    xml = (
        f"<mujoco><size nuserdata='{callback.userdata_size(links)}'/><worldbody>{body}"
        f"<site name='tip'/>{'</body>' * links}</worldbody><actuator>{motors}</actuator></mujoco>"
    )
    callback.install(links)
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    data.qpos[:] = np.linspace(0.1, 0.7, links)
    data.userdata[: len(law_block(links))] = law_block(links)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.userdata[LAW_FIELDS["error"]][:3], data.site_xpos[0], atol=1e-12)
    loop = simulation(1)
    loop.stiffness[:] = 100.0
    loop.step(1)
    assert np.abs(loop.batch.bind("ctrl")).max() > 1.0


def test_struct_offsets_lead_to_the_live_fields() -> None:
    data = mujoco_structs.struct_offsets("mjData", callback.DATA_FIELDS)
    model = mujoco_structs.struct_offsets("mjModel", callback.MODEL_FIELDS)
    check = functools.partial(mujoco_structs.check_offsets, callback.PROBE)
    check(data=data, model=model)
    with pytest.raises(SimulationError, match=r"mjData.qvel is not at byte \d+.*mujoco"):
        check(data=data | {"qvel": data["qvel"] + 8}, model=model)
    with pytest.raises(SimulationError, match="mjModel.nuserdata is not at byte"):
        check(data=data, model={"nuserdata": model["nuserdata"] + 8})
    with pytest.raises(SimulationError, match="mjData has changed"):
        mujoco_structs.struct_offsets("mjData", ("no_such_field",))


def test_foreign_callback_is_refused_not_replaced() -> None:
    simulation(1)
    foreign = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(lambda model, data: None)
    ours = mujoco.get_mjcb_control()
    mujoco.set_mjcb_control(foreign)
    try:
        with pytest.raises(SimulationError, match="mjcb_control is taken.*set_mjcb_control"):
            simulation(1)
        mujoco.set_mjcb_control(lambda model, data: None)
        with pytest.raises(SimulationError, match="mjcb_control is taken"):
            callback.uninstall()
    finally:
        mujoco.set_mjcb_control(ours)
    callback.uninstall()
    assert mujoco.get_mjcb_control() is None
    loop = simulation(1)
    loop.stiffness[:] = 100.0
    loop.step(1)
    assert loop.batch.bind("userdata")[0, LAW_FIELDS["magic"]] == LAW_MAGIC
    assert np.abs(loop.batch.bind("ctrl")).max() > 0


def test_kinematics_refuse_what_is_no_serial_arm_of_hinges() -> None:
    slide = (
        "<mujoco><worldbody><body><joint type='slide'/><geom size='.1'/><site/></body></worldbody></mujoco>"
    )
    with pytest.raises(ModelError, match="not a single hinge"):
        Chain.from_model(mujoco.MjModel.from_xml_string(slide))
    second = (
        "<mujoco><worldbody><body><joint/><geom size='.1'/></body>"
        "<body><joint/><geom size='.1'/><site/></body></worldbody></mujoco>"
    )
    with pytest.raises(ModelError, match="first of the model"):
        Chain.from_model(mujoco.MjModel.from_xml_string(second))


@pytest.mark.parametrize(("count", "threads"), [(0, 1), (-1, 1), (1.5, 1), (2, -1)])
def test_batch_sizes_are_checked(count: int, threads: int) -> None:
    with pytest.raises(InputError):
        simulation(count, threads)


def test_solid_body_needs_a_shape() -> None:
    with pytest.raises(ModelError, match="no collision shape"):
        scene.make_solid(scene.arm_spec(ROBOT), "flange")
