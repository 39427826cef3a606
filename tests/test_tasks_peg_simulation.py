"""The simulated peg obeys the impedance law and its contacts, the same on any machine, thread and process."""

from __future__ import annotations

import concurrent.futures
import math
import multiprocessing
from collections.abc import Iterator

import mujoco
import numpy as np
import pytest

from vic_toolbox import tasks
from vic_toolbox.control.law import feedback_wrench
from vic_toolbox.errors import InputError, SimulationError
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.spatial import (
    pose_error,
    pose_from,
    quat_wxyz_to_rotation,
    rotation_exp,
    rotation_to_quat_wxyz,
)
from vic_toolbox.tasks import collider, peg_scene, peg_simulation
from vic_toolbox.tasks.peg_in_hole import CONSTANTS, GAINS, PegInHole
from vic_toolbox.tasks.peg_simulation import HAND, PegSimulation

TRAIN = peg_scene.SCENARIOS["train"]
HIGH = (0.0, 0.0, 0.15)  # here the peg touches nothing


def floating(count: int, *, seed: int = 0, threads: int = 1) -> PegSimulation:
    """Pegs in the air in random poses and motions."""
    rng = np.random.default_rng(seed)
    simulation = PegSimulation(peg_scene.physics_model(TRAIN.geometry), count, threads=threads)
    rotations = rotation_exp(0.4 * rng.uniform(-1, 1, (count, 3)))
    simulation.reset(HIGH + 0.01 * rng.normal(size=(count, 3)), rotation_to_quat_wxyz(rotations))
    simulation.qvel[:] = 0.3 * rng.normal(size=(count, 6))
    return simulation


def poses(simulation: PegSimulation) -> np.ndarray:
    """Homogeneous matrices of the pegs."""
    return pose_from(simulation.qpos[:, :3], quat_wxyz_to_rotation(simulation.qpos[:, 3:]))


def stiffnesses(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform(GAINS.minimum, GAINS.maximum, (count, 6))


def run(task: PegInHole, count: int, *, which: str = "expert", seed: int = 0, threads: int = 1) -> dict:
    """Last info of an episode of the expert or of one of the constants."""
    environment = tasks.VectorEnvironment(task, count, threads=threads)
    observation, info = environment.reset(seed=seed)
    for _ in range(task.horizon):
        expert = which == "expert"
        action = task.expert_action(observation) if expert else task.constant_action(observation, which=which)
        observation, _, _, _, info = environment.step(action)
    return info


def path(scenario: str, *, threads: int = 1, steps: int = 200) -> np.ndarray:
    """Observations of the expert, (steps, 8, 12)."""
    task = PegInHole(scenario=scenario)
    environment = tasks.VectorEnvironment(task, 8, threads=threads)
    observations = [environment.reset(seed=5)[0]]
    for _ in range(steps):
        observations.append(environment.step(task.expert_action(observations[-1]))[0])
    return np.array(observations)


# --- the law --------------------------------------------------------------------------------------------------------


def test_the_actuators_are_the_impedance_law() -> None:
    simulation, rng = floating(30), np.random.default_rng(1)
    error = pose_error(poses(simulation), pose_from(simulation.model.site("goal").pos, np.eye(3)))
    rotations = poses(simulation)[:, :3, :3]
    rate = simulation.qvel.copy()
    rate[:, 3:] = np.einsum("nij,nj->ni", rotations, rate[:, 3:])
    simulation.set_stiffness(stiffnesses(rng, 30))
    simulation.wrench[:] = rng.normal(size=(30, 6)) * [5, 5, 50, 1, 1, 1]
    damping = np.broadcast_to(peg_scene.DAMPING, (30, 6))
    np.testing.assert_array_equal(simulation.damping, damping)
    gains = ImpedanceGains.diagonal(simulation.stiffness, damping)
    expected = feedback_wrench(error, rate, gains=gains) + simulation.wrench
    applied = simulation.batch.bind("qfrc_actuator")
    simulation.step(1)
    moments = np.einsum("nij,nj->ni", rotations, applied[:, 3:])  # a free joint's are in the body's axes
    tolerance = 1e-12 * np.abs(expected).max(axis=0)
    assert (np.abs(applied[:, :3] - expected[:, :3]) <= tolerance[:3]).all()
    assert (np.abs(moments - expected[:, 3:]) <= tolerance[3:]).all()


def test_observation_is_the_pose_error_and_twist_of_the_present_state() -> None:
    simulation, data = floating(40, seed=2), mujoco.MjData(peg_scene.physics_model(TRAIN.geometry))
    simulation.qpos[::2, 3:] *= -1.0  # the same rotations
    observed = simulation.observe()
    reference = pose_from(simulation.model.site("goal").pos, np.eye(3))
    np.testing.assert_allclose(observed[:, :6], pose_error(poses(simulation), reference), atol=1e-12)
    body, twist = simulation.model.body("peg").id, np.empty(6)
    for i in range(simulation.count):
        data.qpos[:], data.qvel[:] = simulation.qpos[i], simulation.qvel[i]
        mujoco.mj_forward(simulation.model, data)
        mujoco.mj_objectVelocity(simulation.model, data, mujoco.mjtObj.mjOBJ_BODY, body, twist, 0)
        np.testing.assert_allclose(observed[i, 6:], [*twist[3:], *twist[:3]], atol=1e-12)


def test_gravity_is_compensated() -> None:
    simulation = floating(5)
    simulation.qvel[:] = 0.0
    before = simulation.qpos.copy()
    simulation.step(500)
    np.testing.assert_allclose(simulation.qpos, before, atol=1e-12)


def test_each_axis_is_a_mass_a_spring_and_a_damper() -> None:
    """Overdamped motion of a small error, ``m ẍ + b ẋ + k x = 0`` from rest, against its solution."""
    simulation = floating(6)
    inertia = np.array([0.5, 0.5, 0.5, 8.2e-4, 8.2e-4, 3e-4])
    k, b = CONSTANTS["matched"], np.array(peg_scene.DAMPING)
    start = np.diag([1e-3] * 3 + [1e-2] * 3)
    goal = simulation.model.site("goal").pos
    simulation.reset(goal + [0, 0, 0.1] + start[:, :3], rotation_to_quat_wxyz(rotation_exp(start[:, 3:])))
    simulation.wrench[:, 2] = k[2] * 0.1  # balances the spring up there
    simulation.set_stiffness(np.tile(k, (6, 1)))
    time = 0.1
    simulation.step(round(time / peg_scene.TIMESTEP))
    root = np.sqrt(b**2 - 4 * inertia * k)
    slow, fast = (-b + root) / (2 * inertia), (-b - root) / (2 * inertia)
    expected = (fast * np.exp(slow * time) - slow * np.exp(fast * time)) / (fast - slow)
    moved = simulation.observe()[:, :6] - [0, 0, 0.1, 0, 0, 0]
    np.testing.assert_allclose(np.diagonal(moved) / np.diagonal(start), expected, atol=0.01)
    np.testing.assert_allclose(moved - np.diag(np.diagonal(moved)), 0.0, atol=1e-12)


def test_a_push_acts_at_the_hand() -> None:
    force = np.array([0.3, -0.2, 0.5])
    simulation, data = floating(3), mujoco.MjData(peg_scene.physics_model(TRAIN.geometry))
    simulation.reset(HIGH, (1.0, 0.0, 0.0, 0.0))
    simulation.set_push(np.tile(force, (3, 1)))
    data.qpos[:3] = HIGH
    mujoco.mj_forward(simulation.model, data)
    generalised, body = np.zeros(6), simulation.model.body("peg").id
    point = np.add(HIGH, (0.0, 0.0, HAND))
    mujoco.mj_applyFT(simulation.model, data, force, np.zeros(3), point, body, generalised)
    data.qfrc_applied[:] = generalised
    mujoco.mj_step(simulation.model, data)
    simulation.step(1)
    np.testing.assert_allclose(simulation.qvel, np.tile(data.qvel, (3, 1)), atol=1e-14)
    simulation.set_push(np.zeros(3))
    simulation.reset(HIGH, (1.0, 0.0, 0.0, 0.0))
    simulation.step(10)
    np.testing.assert_allclose(simulation.qvel, 0.0, atol=1e-14)
    with pytest.raises(InputError, match="force"):
        simulation.set_push([np.nan, 0.0, 0.0])


def test_a_push_ends_with_the_reset() -> None:
    simulation = floating(2)
    simulation.set_push([1.0, 1.0, 1.0])
    simulation.step(1)
    simulation.reset(HIGH, (1.0, 0.0, 0.0, 0.0))
    simulation.step(1)
    np.testing.assert_allclose(simulation.qvel, 0.0, atol=1e-14)


def test_contact_force_holds_what_presses_on_the_block() -> None:
    simulation = floating(1)
    simulation.reset((5e-3, 0.0, peg_scene.TIP_DISTANCE + 1e-4), (1.0, 0.0, 0.0, 0.0))
    simulation.set_stiffness(np.array([[1.0, 1.0, 450.0, 12.0, 12.0, 12.0]]))
    simulation.wrench[:, 2] = -8.0
    simulation.step(3000)
    pressed = 8.0 + 450.0 * simulation.observe()[0, 2]
    assert simulation.contact_force[0] == pytest.approx(pressed, rel=0.01)
    assert abs(simulation.qpos[0, 2] - peg_scene.TIP_DISTANCE) < 0.1e-6  # the block does not give way
    assert simulation.peak_force[0] >= simulation.contact_force[0]
    simulation.reset(HIGH, (1.0, 0.0, 0.0, 0.0))
    assert simulation.peak_force[0] == 0.0


# --- the protective stop --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [50.0, 1e300, np.inf, np.nan])
def test_runaway_peg_is_halted_and_named_and_the_others_go_on(bad: float) -> None:
    simulation, undisturbed = floating(4), floating(4)
    for each in (simulation, undisturbed):
        each.set_stiffness(stiffnesses(np.random.default_rng(0), 4))
        each.step(5)
    before = simulation.qpos[2].copy()
    simulation.step(1)
    undisturbed.step(1)
    simulation.qvel[2, 0] = bad
    observed = simulation.observe()
    np.testing.assert_array_equal(simulation.stopped, [False, False, True, False])
    for _ in range(5):
        simulation.step(20)
        undisturbed.step(20)
        observed = simulation.observe()
    np.testing.assert_array_equal(simulation.qpos[2], before)
    np.testing.assert_array_equal(observed[2, 6:], 0.0)
    np.testing.assert_array_equal(observed[[0, 1, 3]], undisturbed.observe()[[0, 1, 3]])
    assert np.isfinite(simulation.peak_force).all()
    simulation.reset(HIGH, (1.0, 0.0, 0.0, 0.0))
    assert not simulation.stopped.any()


def test_a_peg_that_starts_out_of_order_stays_where_it_was_put() -> None:
    simulation = floating(2)
    simulation.reset([(0.0, 0.0, 0.1), (5.0, 0.0, 0.1)], (1.0, 0.0, 0.0, 0.0))
    observed = simulation.observe()
    np.testing.assert_array_equal(simulation.stopped, [False, True])
    assert observed[1, 0] == 5.0


@pytest.mark.parametrize("extreme", ["scale=3,tilt=30,offset=10", "scale=0.2,tilt=-30", "tilt=30,offset=10"])
def test_no_scenario_begins_in_a_protective_stop(extreme: str) -> None:
    environment = tasks.VectorEnvironment(PegInHole(scenario=extreme), 3)
    environment.reset(seed=0, options={"start_noise": 10.0})
    assert not environment.simulation.stopped.any()


def test_a_runaway_episode_is_no_success() -> None:
    task = PegInHole(action="force")
    environment = tasks.VectorEnvironment(task, 2)
    observation, info = environment.reset(seed=0)
    for _ in range(task.horizon):
        action = task.expert_action(observation)
        action[1] = [1e9, 0.0, 1e9, 0.0, 0.0, 0.0]
        observation, _, _, _, info = environment.step(action)
    np.testing.assert_array_equal(info["stopped"], [False, True])
    np.testing.assert_array_equal(info["success"], [True, False])
    assert all(np.isfinite(info[name]).all() for name in ("score", "distance", "peak_force"))
    assert info["distance"][1] <= peg_simulation.FARTHEST


@pytest.mark.parametrize(("count", "threads"), [(0, 1), (-1, 1), (1.5, 1), (2, -1)])
def test_batch_sizes_are_checked(count: int, threads: int) -> None:
    with pytest.raises(InputError):
        PegInHole().simulation(count, threads=threads)


# --- the same numbers everywhere ------------------------------------------------------------------------------------


@pytest.fixture
def round_again() -> Iterator[None]:
    yield
    collider.install()


@pytest.mark.usefixtures("round_again")
def test_a_flat_hole_is_never_simulated() -> None:
    environment = tasks.VectorEnvironment(PegInHole(), 2)
    observation, _ = environment.reset(seed=0)
    first = environment.step(environment.expert_action(observation))[0]
    collider.uninstall()
    with pytest.raises(SimulationError, match="collider was uninstalled.*reset the simulation"):
        environment.step(environment.expert_action(first))
    observation, _ = environment.reset(seed=0)
    assert collider.installed()
    np.testing.assert_array_equal(environment.step(environment.expert_action(observation))[0], first)


def test_threads_and_processes_do_not_change_a_bit() -> None:
    expected = path("tilt=-6")
    np.testing.assert_array_equal(path("tilt=-6", threads=4), expected)
    spawn = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawn) as workers:
        np.testing.assert_array_equal(workers.submit(path, "tilt=-6").result(), expected)


def test_two_geometries_side_by_side_are_as_each_alone() -> None:
    scenarios = ("tilt=-4", "tilt=-4,scale=0.5,clearance=30,friction=0.1")
    alone = [path(scenario) for scenario in scenarios]
    environments = [tasks.VectorEnvironment(PegInHole(scenario=scenario), 8) for scenario in scenarios]
    observations = [environment.reset(seed=5)[0] for environment in environments]
    assert np.abs(environments[0].simulation.qpos - environments[1].simulation.qpos).max() > 1e-3
    for t in range(1, 201):
        for i, environment in enumerate(environments):
            action = environment.expert_action(observations[i])
            observations[i] = environment.step(action)[0]
            np.testing.assert_array_equal(observations[i], alone[i][t])


# --- contact physics ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("scenario", ["tilt=-6", "train", "tilt=-6,scale=0.3"])
def test_the_peg_hardly_sinks_into_the_block(scenario: str) -> None:
    """Depth of every contact at every physics step of expert episodes, where a clearance is 15 µm."""
    task = PegInHole(scenario=scenario)
    simulation, depths = task.simulation(5), []
    task.start(simulation, [task.scenario] * 5, noise=1.0, rng=np.random.default_rng(0))
    data = mujoco.MjData(simulation.model)
    for _ in range(task.horizon):
        task.act(simulation, task.expert_action(simulation.observe() / task.observation_unit))
        for _ in range(task.substeps):
            simulation.step(1)
            for qpos in simulation.qpos:
                data.qpos[:] = qpos
                mujoco.mj_fwdPosition(simulation.model, data)
                depths.extend(-data.contact.dist)
    assert len(depths) > 200
    assert np.percentile(depths, 95) <= 10e-6


def test_a_pressed_peg_is_held_by_friction_up_to_the_cone() -> None:
    """On the block, a lateral force moves the peg if it exceeds μ times the normal force, and only then."""
    simulation = floating(2)
    simulation.reset((5e-3, 0.0, peg_scene.TIP_DISTANCE + 1e-5), (1.0, 0.0, 0.0, 0.0))
    simulation.set_stiffness(np.tile([0.0, 0.0, 0.0, 12.0, 12.0, 12.0], (2, 1)))
    simulation.wrench[:, 2] = -8.0
    simulation.step(300)
    settled = simulation.qpos[:, 1].copy()
    simulation.wrench[:, 1] = [0.8 * TRAIN.friction * 8.0, 1.2 * TRAIN.friction * 8.0]
    simulation.step(100)
    held, slid = simulation.qpos[:, 1] - settled
    assert abs(held) < 2e-5
    assert slid > 1e-4


class HalfStep(PegInHole):
    """The same task with half the time step."""

    substeps = 2 * PegInHole.substeps

    def simulation(self, count: int, *, threads: int = 1) -> PegSimulation:
        spec = peg_scene.build_spec(self.scenario)
        spec.option.timestep = peg_scene.TIMESTEP / 2
        return PegSimulation(spec.compile(), count, threads=threads)


CLEAR_CASES = [("tilt=-6", "expert", 1.0), ("tilt=-6", "middle", 0.0), ("train", "matched", 1.0)]


@pytest.mark.parametrize(("scenario", "which", "rate"), CLEAR_CASES)
def test_half_the_time_step_gives_the_same_success(scenario: str, which: str, rate: float) -> None:
    for kind in (PegInHole, HalfStep):
        info = run(kind(scenario=scenario), 5, which=which)
        assert info["success"].mean() == rate


@pytest.mark.slow
@pytest.mark.parametrize("which", ["expert", "constant"])
def test_success_rates_converge_with_the_time_step(which: str) -> None:
    intervals = []
    for kind in (PegInHole, HalfStep):
        rate = float(run(kind(), 40, which=which, seed=1)["success"].mean())
        intervals.append((rate, wilson_interval(rate, 40)))
    (coarse, around_coarse), (fine, around_fine) = intervals
    assert around_coarse[0] <= fine <= around_coarse[1]
    assert around_fine[0] <= coarse <= around_fine[1]


# --- the polygon ----------------------------------------------------------------------------------------------------


def wedge_profiles(count: int) -> Iterator[np.ndarray]:
    """Vertices of each wedge in the world, (10, 3) [m]."""
    model = peg_scene.physics_model(TRAIN.geometry, count)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    vertices = model.mesh_vert.astype(np.float64)
    for i in range(count):
        geom = data.geom(f"block_{i}")
        yield vertices @ geom.xmat.reshape(3, 3).T + geom.xpos


@pytest.mark.parametrize("count", [3, 16, 64])
def test_the_round_hole_is_inscribed_in_the_polygon(count: int) -> None:
    corners = []
    for i, vertices in enumerate(wedge_profiles(count)):
        angle = 2.0 * math.pi * i / count
        along = vertices @ [math.cos(angle), math.sin(angle), 0.0]
        across = vertices @ [-math.sin(angle), math.cos(angle), 0.0]
        assert along.min() == pytest.approx(peg_scene.HOLE_RADIUS, abs=1e-8)
        mouth = vertices[:, 2] > vertices[:, 2].max() - 1e-9
        assert along[mouth].min() == pytest.approx(peg_scene.HOLE_RADIUS + peg_scene.CHAMFER, abs=1e-8)
        assert vertices[:, 2].max() == pytest.approx(0.0, abs=1e-8)
        assert vertices[:, 2].min() == pytest.approx(-peg_scene.BORE_DEPTH, abs=1e-8)
        corners.append(np.abs(across).max())
    closed = (peg_scene.HOLE_RADIUS + peg_scene.CHAMFER) * math.tan(math.pi / count)
    assert min(corners) >= closed  # no gap between neighbours


def deepest(model: mujoco.MjModel, position: tuple[float, float, float]) -> float:
    """Deepest contact of an upright peg, negative where it overlaps [m]."""
    data = mujoco.MjData(model)
    data.qpos[:] = (*position, 1.0, 0.0, 0.0, 0.0)
    mujoco.mj_forward(model, data)
    return data.contact.dist.min()


def test_an_upright_peg_meets_both_holes_alike() -> None:
    collider.install()
    models = [peg_scene.physics_model(TRAIN.geometry, count) for count in (None, 64)]
    height, shift = peg_scene.TIP_DISTANCE - peg_scene.GOAL_DEPTH, 20e-6
    for k in range(8):  # along the middles of wedges
        angle = 2.0 * math.pi * k / 8
        place = (shift * math.cos(angle), shift * math.sin(angle), height)
        for model in models:
            assert deepest(model, place) == pytest.approx(1e-6 * TRAIN.clearance - shift, abs=2e-8)
    corner = math.pi / 64
    place = (shift * math.cos(corner), shift * math.sin(corner), height)
    flatter = 1e-6 * TRAIN.clearance - shift * math.cos(corner)
    assert deepest(models[1], place) == pytest.approx(flatter, abs=2e-8)


def test_a_centred_upright_peg_goes_into_either_hole_the_same_way() -> None:
    paths = []
    for wedges in (None, 64):
        task = PegInHole(scenario="tilt=0", wedges=wedges)
        environment = tasks.VectorEnvironment(task, 1, start_noise=0.0)
        observations = [environment.reset(seed=0)[0]]
        for _ in range(task.horizon):
            observations.append(environment.step(task.expert_action(observations[-1]))[0])
        paths.append(np.array(observations))
    np.testing.assert_allclose(*paths, atol=1e-9)
