"""Peg-in-Hole: scenarios, starts, score, success, expert and constant gains."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from vic_toolbox import tasks
from vic_toolbox.errors import InputError
from vic_toolbox.spatial import quat_wxyz_to_rotation, rotation_exp, rotation_log, rotation_to_quat_wxyz
from vic_toolbox.tasks import peg_in_hole, peg_scene
from vic_toolbox.tasks.peg_in_hole import CONSTANTS, GAINS, OBSERVATION_SCALE, TIP_STIFFNESS, PegInHole
from vic_toolbox.tasks.peg_scene import LIMITS, SCENARIOS, PegScenario, as_scenario
from vic_toolbox.tasks.peg_simulation import PegSimulation

observations = arrays(np.float64, 12, elements=st.floats(-3.0, 3.0)).map(lambda row: row * OBSERVATION_SCALE)
scenarios = st.builds(PegScenario, **{name: st.floats(*limits) for name, limits in LIMITS.items()})


def started(scenario: str, count: int, *, noise: float, seed: int = 0) -> tuple[PegInHole, PegSimulation]:
    task = PegInHole(scenario=scenario)
    simulation = task.simulation(count)
    task.start(simulation, [task.scenario] * count, noise=noise, rng=np.random.default_rng(seed))
    return task, simulation


def tip_of(task: PegInHole, simulation: PegSimulation) -> np.ndarray:
    """Centre of the lower face, (count, 3) [m]."""
    rotations = quat_wxyz_to_rotation(simulation.qpos[:, 3:])
    return simulation.qpos[:, :3] + rotations @ np.array(task.tip)


def rim_height(task: PegInHole, simulation: PegSimulation) -> np.ndarray:
    """Height of the lowest point of the lower rim, found among many of its points, (count,) [m]."""
    angle = np.linspace(0.0, 2.0 * np.pi, 20001)
    radius = simulation.model.geom("peg").size[0]
    rim = radius * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle])
    rotations = quat_wxyz_to_rotation(simulation.qpos[:, 3:])
    return (tip_of(task, simulation)[:, 2, None] + (rotations @ rim)[:, 2]).min(axis=1)


def episode(scenario: str, which: str, *, action: str = "gain", count: int = 10) -> tuple[np.ndarray, dict]:
    """Observations (201, count, 12) and last info of the expert or of a constant gain."""
    task = PegInHole(action=action, scenario=scenario)
    environment = tasks.VectorEnvironment(task, count)
    observation, info = environment.reset(seed=4)
    path = [observation]
    for _ in range(task.horizon):
        expert = which == "expert"
        actions = (
            task.expert_action(observation) if expert else task.constant_action(observation, which=which)
        )
        observation, _, _, _, info = environment.step(actions)
        path.append(observation)
    return np.array(path), info


# --- scenarios ------------------------------------------------------------------------------------------------------


@given(scenarios)
def test_the_name_of_a_scenario_can_be_read_back(scenario: PegScenario) -> None:
    assert as_scenario(scenario.name) == scenario
    assert as_scenario(scenario) is scenario
    assert scenario.description


def test_known_scenarios_keep_their_names() -> None:
    assert list(SCENARIOS)[:5] == ["train", "tilt=-6", "tilt=-4", "tilt=0", "tilt=2"]
    for name, scenario in SCENARIOS.items():
        assert as_scenario(name) == scenario
        assert scenario.name == name
    assert SCENARIOS["train"] == PegScenario() == as_scenario("tilt=-2")
    assert SCENARIOS["train"].description == "tilt −2 deg, scale 1"
    assert as_scenario(" friction = .1, tilt=-3 ").name == "tilt=-3,friction=0.1"
    assert as_scenario("tilt=-3,clearance=20").description == "tilt −3 deg, clearance 20 µm"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("T1", "choose one of: train, tilt=-6"),
        ("", "choose one of: train"),
        ("angle=3", "quantity of a scenario is 'angle'; choose one of: tilt, scale"),
        ("tilt=-4,", "quantity of a scenario is ''"),
        ("tilt=steep", "tilt is 'steep'; pass a number, as in .*tilt=-4"),
        ("tilt=", "tilt is ''; pass a number"),
        ("tilt=1,tilt=2", "it gives tilt twice"),
        ("tilt=nan", "tilt is nan.*finite"),
        ("tilt=inf", "finite"),
        ("tilt=31", r"tilt is 31 deg; it must be within \[-30, 30\]"),
        ("scale=0", "scale is 0"),
        ("scale=-1", "scale is -1"),
        ("scale=50", "scale is 50"),
        ("offset=50", "offset is 50 mm"),
        ("friction=-0.1", "friction is -0.1"),
        ("clearance=0", r"clearance is 0 µm; it must be within \[1, 1000\]"),
        ("clearance=-15", "clearance is -15 µm"),
        ("clearance=15e-6", "clearance is 1.5e-05 µm"),
        (3.0, "pass a name or"),
        (None, "pass a name or"),
        ({"tilt": 3}, "pass a name or"),
    ],
)
def test_scenarios_that_cannot_be_used_are_refused(text, message: str) -> None:
    with pytest.raises(InputError, match=message):
        tasks.make("peg-in-hole", scenario=text)


@pytest.mark.parametrize("value", ["-2", None, [1.0, 2.0], True])
def test_quantities_must_be_numbers(value) -> None:
    with pytest.raises(InputError, match="tilt"):
        PegScenario(tilt=value)


def test_sweeps_change_their_own_quantity_only() -> None:
    for name, axis in PegInHole.sweeps.items():
        assert list(axis.values) == sorted(set(axis.values))
        for value in axis.values:
            assert axis.scenario(value) == PegScenario(**{name: value})
    assert set(PegInHole.sweeps) == set(LIMITS)


# --- starts ---------------------------------------------------------------------------------------------------------


@given(scenario=scenarios)
def test_without_noise_the_start_is_the_scenario(scenario: PegScenario) -> None:
    same_model = PegScenario(tilt=scenario.tilt, offset=scenario.offset, scale=0.5)
    task, simulation = started(same_model.name, 1, noise=0.0)
    tilt = rotation_log(quat_wxyz_to_rotation(simulation.qpos[:, 3:]))
    np.testing.assert_allclose(tilt, [[0.0, np.radians(scenario.tilt), 0.0]], atol=1e-9)
    np.testing.assert_allclose(tip_of(task, simulation)[0, :2], [0.5e-3 * scenario.offset, 0.0], atol=1e-10)
    np.testing.assert_allclose(rim_height(task, simulation), 0.5 * 2e-3, atol=1e-9)
    assert not simulation.qvel.any()


@pytest.mark.parametrize(("scenario", "scale"), [("tilt=-6", 1.0), ("scale=0.3,offset=1", 0.3)])
def test_usual_noise_fills_its_range_and_stays_within_it(scenario: str, scale: float) -> None:
    task, simulation = started(scenario, 300, noise=1.0)
    rotation = rotation_log(quat_wxyz_to_rotation(simulation.qpos[:, 3:]))
    tip = tip_of(task, simulation)[:, :2] / scale
    off = {
        "tilt": (rotation[:, :2] - [0.0, np.radians(task.scenario.tilt)]) / np.radians(0.2),
        "tip": (tip - [1e-3 * task.scenario.offset, 0.0]) / 0.3e-3,
        "gap": (rim_height(task, simulation)[:, None] / scale - 2e-3) / 1e-3,
    }
    for values in off.values():
        assert np.abs(values).max() <= 1.0 + 1e-6
        assert (np.abs(values).max(axis=0) > 0.95).all()
        assert (np.abs(values.mean(axis=0)) < 0.15).all()
    np.testing.assert_allclose(rotation[:, 2], 0.0, atol=1e-12)


def test_more_noise_never_starts_inside_the_block() -> None:
    task, simulation = started("train", 300, noise=10.0)
    assert rim_height(task, simulation).min() > 0.99e-3
    rotation = rotation_log(quat_wxyz_to_rotation(simulation.qpos[:, 3:]))
    assert np.abs(rotation[:, 0]).max() == pytest.approx(np.radians(2.0), rel=0.05)


def test_a_seed_is_a_start() -> None:
    first, again, other = (started("train", 5, noise=1.0, seed=seed)[1].qpos for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_each_simulation_may_have_its_own_tilt_but_not_its_own_hole() -> None:
    environment = tasks.PegInHoleVectorEnv(3)
    own = ["tilt=-6", PegScenario(tilt=5.0, offset=1.0), "train"]
    observation, _ = environment.reset(options={"start_noise": 0.0, "scenarios": own})
    np.testing.assert_allclose(observation[:, 4], np.radians([-6, 5, -2]), atol=1e-12)
    for other in ("scale=0.5", "friction=0.1", "clearance=20"):
        with pytest.raises(
            InputError, match=f"'{other}' has another scale, friction or clearance.*make a task"
        ):
            environment.reset(options={"scenarios": ["train", other, "train"]})


# --- reward, score, success -----------------------------------------------------------------------------------------


@given(row=observations, scale=st.sampled_from([0.3, 1.0]))
def test_the_tip_is_where_the_pose_puts_it(row: np.ndarray, scale: float) -> None:
    task = PegInHole(scenario=PegScenario(scale=scale))
    qpos = np.append(scale * row[:3] + task.goal, rotation_to_quat_wxyz(rotation_exp(row[3:6])))
    top, com, tip = task.skeleton(qpos)
    np.testing.assert_allclose(task.tip_position(row), tip, atol=1e-15)
    np.testing.assert_array_equal(com, qpos[:3])
    np.testing.assert_allclose(top + tip, 2 * com, atol=1e-15)
    assert np.linalg.norm(tip - com) == pytest.approx(scale * peg_scene.TIP_DISTANCE)


@given(
    row=observations,
    beside=st.floats(0.0, 2.0).filter(lambda x: abs(x - 1.0) > 1e-6),
    scale=st.sampled_from([0.3, 1.0]),
)
def test_reward_is_minus_the_depth_to_go_while_the_tip_is_aligned(
    row: np.ndarray, beside: float, scale: float
) -> None:
    task = PegInHole(scenario=PegScenario(scale=scale), history=2)
    history = np.concatenate([np.full(12, 9.0), row])
    wanted = beside * peg_scene.CHAMFER * np.array([0.6, -0.8])
    history[12:14] += wanted - task.tip_position(history)[:2] / scale
    depth = abs(task.tip_position(history)[2] / scale + peg_scene.GOAL_DEPTH)
    expected = -depth if beside < 1.0 else -0.05
    assert task.reward(history) == pytest.approx(expected, abs=1e-12)
    many = np.tile(history, (4, 3, 1))
    np.testing.assert_allclose(task.reward(many), np.full((4, 3), expected), atol=1e-12)
    np.testing.assert_allclose(task.score(many), np.full(3, 4 * expected), atol=1e-12)


def test_the_best_reward_is_that_of_the_goal() -> None:
    assert PegInHole().reward(np.zeros(12)) == 0.0
    with pytest.raises(InputError, match="finite"):
        PegInHole().reward(np.full(12, np.nan))


def test_success_is_the_right_height_at_the_end() -> None:
    task, rows = PegInHole(), np.zeros((4, 12))
    rows[:, 2] = [0.99e-3, -0.99e-3, 1.01e-3, -1.01e-3]
    rows[0, [0, 5]] = 0.1  # nothing else counts
    np.testing.assert_array_equal(task.success(rows), [True, True, False, False])


def test_outcome_reports_the_end_of_an_episode() -> None:
    path, info = episode("tilt=-2", "expert", count=3)
    task = PegInHole()
    np.testing.assert_array_equal(info["success"], task.success(path[-1]))
    np.testing.assert_allclose(info["distance"], np.linalg.norm(path[-1, :, :3], axis=-1))
    np.testing.assert_allclose(info["score"], task.score(path[:-1]), rtol=1e-12)
    assert not info["stopped"].any()
    assert (info["peak_force"] > 0.0).all()
    simulation = task.simulation(3)
    simulation.stopped[1] = True  # a peg that had to be halted has not been inserted
    np.testing.assert_array_equal(task.outcome(simulation, path[-1])["success"], [True, False, True])


@pytest.mark.parametrize("scale", [0.3, 1.0, 2.0])
def test_lengths_are_seen_in_units_of_the_part(scale: float) -> None:
    task = PegInHole(scenario=PegScenario(scale=scale), history=2)
    environment = tasks.VectorEnvironment(task, 3)
    environment.reset(seed=1)
    for _ in range(30):
        seen, *_ = environment.step(np.zeros((3, 6)))
    unit = np.repeat([scale, 1.0, scale, 1.0], 3)
    np.testing.assert_array_equal(seen[:, 12:], environment.simulation.observe() / unit)
    com = task.goal + unit[:3] * seen[:, 12:15]
    np.testing.assert_allclose(com, environment.simulation.qpos[:, :3], atol=1e-15)


def test_similar_parts_look_alike_and_are_judged_alike() -> None:
    starts = []
    for scale in (0.3, 1.0):
        environment = tasks.VectorEnvironment(PegInHole(scenario=PegScenario(scale=scale)), 20)
        starts.append(environment.reset(seed=4)[0])
        assert environment.task.observation_unit[0] == scale
    np.testing.assert_allclose(*starts, atol=1e-12)
    small, whole = PegInHole(scenario="scale=0.3"), PegInHole()
    for judge in ("reward", "strata", "success"):
        np.testing.assert_array_equal(*(getattr(task, judge)(starts[1]) for task in (small, whole)))


@given(row=observations, scale=st.floats(0.2, 3.0))
def test_the_expert_of_a_scaled_part_acts_on_its_own_lengths(row: np.ndarray, scale: float) -> None:
    task = PegInHole(scenario=PegScenario(scale=scale))
    parameters = GAINS.action_to_parameters(task.expert_action(row))
    np.testing.assert_allclose(parameters, task.expert.parameters(row * task.observation_unit), rtol=1e-9)


@given(rows=arrays(np.float64, (20, 12), elements=st.floats(-0.2, 0.2)), grow=st.floats(1.0, 4.0))
def test_strata_are_octaves_of_the_misalignment(rows: np.ndarray, grow: float) -> None:
    task = PegInHole()
    strata = task.strata(rows)
    assert strata.shape == (20,)
    assert ((strata >= 0) & (strata <= 5)).all()
    assert (task.strata(grow * rows) >= strata).all()
    aligned = rows.copy()
    aligned[:, [0, 1, 3, 4]] = 0.0
    assert not task.strata(aligned).any()


def test_strata_begin_at_2_mrad_and_end_at_32() -> None:
    task, rows = PegInHole(), np.zeros((6, 12))
    rows[:, 4] = [1.99e-3, 2.01e-3, 4.01e-3, 8.01e-3, 31.9e-3, 0.5]
    np.testing.assert_array_equal(task.strata(rows), [0, 1, 2, 3, 4, 5])
    lateral = np.zeros(12)
    lateral[1] = 4.01e-3 * peg_scene.TIP_DISTANCE
    assert task.strata(lateral) == 2


# --- actions --------------------------------------------------------------------------------------------------------


@given(row=observations)
def test_actions_stay_in_their_bounds(row: np.ndarray) -> None:
    for action in ("gain", "force"):
        task = PegInHole(action=action)
        chosen = [task.constant_action(row, which=which) for which in CONSTANTS]
        for each in (task.expert_action(row), *chosen):
            assert each.shape == (6,)
            assert ((task.action_low <= each) & (each <= task.action_high)).all()


def test_constants_are_what_they_are_called() -> None:
    assert next(iter(CONSTANTS)) == "constant"
    np.testing.assert_array_equal(CONSTANTS["constant"], TIP_STIFFNESS)
    gain, force = PegInHole(), PegInHole(action="force")
    np.testing.assert_allclose(gain.constant_action(which="middle"), 0.0, atol=1e-15)
    rows = np.linspace(-1e-3, 1e-3, 24).reshape(2, 12)
    for which, parameters in CONSTANTS.items():
        action = gain.constant_action(which=which)
        np.testing.assert_allclose(GAINS.action_to_parameters(action), parameters)
        np.testing.assert_array_equal(gain.constant_action(rows, which=which), np.tile(action, (2, 1)))
        wrench = force.constant_action(rows, which=which) * peg_in_hole.WRENCH_UNIT
        np.testing.assert_allclose(wrench, -parameters * rows[:, :6])
    np.testing.assert_array_equal(gain.constant_action(), gain.constant_action(which="constant"))


def test_force_and_gain_actions_put_the_same_wrench_on_the_peg() -> None:
    wrenches = []
    for action in ("gain", "force"):
        task = PegInHole(action=action)
        simulation = task.simulation(5)
        task.start(simulation, ["tilt=-6"] * 5, noise=1.0, rng=np.random.default_rng(0))
        simulation.qvel[:] = 0.05
        applied = simulation.batch.bind("qfrc_actuator")
        task.act(simulation, task.expert_action(simulation.observe()))
        simulation.step(1)
        wrenches.append(applied.copy())
    np.testing.assert_allclose(*wrenches, atol=1e-12)


@pytest.mark.parametrize("scale", [0.3, 1.0])
def test_force_and_gain_actions_agree_on_scaled_parts(scale: float) -> None:
    scenario, wrenches = PegScenario(scale=scale, tilt=-6.0), []
    for action in ("gain", "force"):
        task = PegInHole(action=action, scenario=scenario)
        environment = tasks.VectorEnvironment(task, 5)
        observed, _ = environment.reset(seed=2)
        applied = environment.simulation.batch.bind("qfrc_actuator")
        task.act(environment.simulation, task.expert_action(observed))
        environment.simulation.step(1)
        wrenches.append(applied.copy())
    np.testing.assert_allclose(*wrenches, atol=1e-12)


@pytest.mark.parametrize("action", ["gain", "force"])
def test_actions_beyond_the_bounds_are_clipped(action: str) -> None:
    task, seen = PegInHole(action=action), []
    simulation = task.simulation(1)
    for scale in (1.0, 5.0):
        task.start(simulation, ["train"], noise=0.0, rng=np.random.default_rng(0))
        task.act(simulation, scale * task.action_high[None])
        simulation.step(1)
        seen.append(simulation.batch.state.copy())
    np.testing.assert_array_equal(*seen)


@pytest.mark.parametrize("action", ["gain", "force"])
@pytest.mark.parametrize("scenario", ["tilt=-6", "train", "scale=0.3"])
def test_the_expert_succeeds_also_as_a_held_wrench(scenario: str, action: str) -> None:
    _, info = episode(scenario, "expert", action=action)
    assert info["success"].all()


def test_held_wrench_reproduces_the_score_of_the_gain_expert() -> None:
    gain, force = (episode("train", "expert", action=action)[1]["score"] for action in ("gain", "force"))
    np.testing.assert_allclose(force.mean(), gain.mean(), rtol=0.05)


@pytest.mark.parametrize(
    ("scenario", "which", "rate"),
    [
        ("tilt=-6", "constant", 0.0),
        ("tilt=-6", "middle", 0.0),
        ("tilt=0", "middle", 1.0),
        ("tilt=-2", "matched", 1.0),
    ],
)
def test_constant_gains_need_an_upright_peg_or_a_still_tip(scenario: str, which: str, rate: float) -> None:
    path, info = episode(scenario, which)
    assert info["success"].mean() == rate
    if rate == 0.0:  # it stands on the block beside the mouth
        tip = PegInHole().tip_position(path[-1])
        assert (tip[:, 2] > -1e-3).all()


def test_equal_time_constants_keep_the_tip_still() -> None:
    """With K/B alike across and about, the tip's error x − ℓ θ decays as it began."""
    damping = np.array(peg_scene.DAMPING)
    rate = TIP_STIFFNESS[4] / damping[4]
    stiffness = {"equal": np.array([*rate * damping[:2], 818.0, *rate * damping[3:]])} | dict(CONSTANTS)
    swing, task = {}, PegInHole(scenario="tilt=-6")
    for which in ("equal", "middle"):
        environment = tasks.VectorEnvironment(task, 1, start_noise=0.0)
        path = [environment.reset()[0]]
        for _ in range(task.horizon):
            path.append(environment.step(GAINS.parameters_to_action(stiffness[which])[None])[0])
        tip = task.tip_position(np.array(path))
        swing[which] = np.linalg.norm(tip[tip[..., 2] > 0.5e-3][:, :2], axis=-1).max()
    assert swing["equal"] < peg_scene.CHAMFER
    assert swing["middle"] > 3e-3


# --- the task object ------------------------------------------------------------------------------------------------


def test_another_action_space_keeps_everything_else() -> None:
    task = PegInHole(history=3, scenario="tilt=-4,scale=0.5", wedges=8).with_action("force")
    assert (task.action, task.history, task.wedges) == ("force", 3, 8)
    assert task.scenario == PegScenario(tilt=-4.0, scale=0.5)
    assert task.observation_size == 36


@pytest.mark.parametrize(
    "options",
    [{"action": "torque"}, {"action": None}, {"history": 0}, {"history": 1.5}, {"history": True}],
)
def test_bad_options_are_refused(options: dict) -> None:
    with pytest.raises(InputError):
        tasks.make("peg-in-hole", **options)


@pytest.mark.parametrize("wedges", [2, 513, 16.5, "many"])
def test_bad_wedges_are_refused(wedges) -> None:
    with pytest.raises(InputError, match="number of wedges"):
        tasks.make("peg-in-hole", wedges=wedges).simulation(1)


def test_missing_and_bad_observations_are_refused() -> None:
    with pytest.raises(InputError, match="pass the observations"):
        PegInHole(action="force").constant_action()
    with pytest.raises(InputError, match="constant gain is 'soft'; choose one of: constant, middle, matched"):
        PegInHole().constant_action(which="soft")
    with pytest.raises(InputError):
        PegInHole().expert_action(np.full(12, np.nan))
    environment = tasks.PegInHoleVectorEnv(1, action="force")
    environment.reset(seed=0)
    with pytest.raises(InputError, match="actions"):
        environment.step(np.full((1, 6), np.nan))
