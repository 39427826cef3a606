"""Cup-on-Plate: score, success, expert and starts."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vic_toolbox import tasks
from vic_toolbox.errors import InputError, ReachError
from vic_toolbox.tasks import cup_on_plate, cup_scene, starts
from vic_toolbox.tasks.starts import Scenario

STUDY_SCORES = {"train": -343, "T1": -631, "T2": -429, "T3": -480, "T4": -579}


def expert_run(action: str) -> tuple[np.ndarray, dict, tasks.VectorEnvironment]:
    """Observations (501, 5, 12) of the expert from the five starts, and the last info."""
    task = tasks.make("cup-on-plate", action=action)
    environment = tasks.VectorEnvironment(task, len(task.scenarios), start_noise=0.0)
    observation, info = environment.reset(seed=0, options={"scenarios": list(task.scenarios)})
    path = [observation]
    for _ in range(task.horizon):
        observation, _, _, _, info = environment.step(task.expert_action(observation))
        path.append(observation)
    return np.array(path), info, environment


@pytest.fixture(scope="module", params=["gain", "force"])
def run(request: pytest.FixtureRequest) -> tuple[np.ndarray, dict, tasks.VectorEnvironment]:
    return expert_run(request.param)


def test_expert_scores_are_those_of_the_study(run) -> None:
    path, info, environment = run
    np.testing.assert_allclose(info["score"], list(STUDY_SCORES.values()), rtol=0.06)
    np.testing.assert_allclose(environment.task.score(path[:-1]), info["score"], rtol=1e-12)


def test_expert_arrives_softly_upright_and_succeeds(run) -> None:
    path, info, _ = run
    assert info["success"].all()
    assert (info["distance"] < 0.016).all()
    assert (info["peak_force"] < 8.0).all()
    np.testing.assert_allclose(np.linalg.norm(path[-1, :, :3], axis=-1), info["distance"])


def test_held_wrench_reproduces_the_gain_expert() -> None:
    gain, force = expert_run("gain")[1]["score"], expert_run("force")[1]["score"]
    assert (np.abs(force - gain) / np.abs(gain) < 0.02).all()


def test_random_starts_keep_the_expert_successful() -> None:
    task = tasks.make("cup-on-plate")
    environment = tasks.VectorEnvironment(task, 50)
    starts = [list(task.scenarios)[i % 5] for i in range(50)]
    observation, info = environment.reset(seed=3, options={"scenarios": starts})
    for _ in range(task.horizon):
        observation, _, _, _, info = environment.step(task.expert_action(observation))
    assert info["success"].all()


@given(st.lists(st.floats(-2, 2), min_size=12, max_size=12))
def test_reward_is_the_published_formula(row: list[float]) -> None:
    o = np.array(row)
    near, error, rate = np.linalg.norm(o[:3]), o[:6] @ o[:6], o[6:] @ o[6:]
    expected = -15.78 * (error * (near**2 > 0.2**2) + rate * (near**2 <= 0.4**2))
    for history in (1, 3):
        task = tasks.make("cup-on-plate", history=history)
        padded = np.concatenate([np.full(12 * (history - 1), 9.0), o])
        assert task.reward(padded) == pytest.approx(expected, rel=1e-12)
        assert task.reward(np.tile(padded, (4, 2, 1))).shape == (4, 2)


def test_success_needs_every_condition() -> None:
    task = tasks.CupOnPlate()
    good = np.zeros(12)
    assert task.success(good, 5.0)
    for index, value in ((0, 0.03), (4, 0.2), (8, 0.03)):
        bad = good.copy()
        bad[index] = value
        assert not task.success(bad, 5.0)
    assert not task.success(good, 30.0)
    turned = good.copy()
    turned[5] = 1.0  # a turn about the vertical does not spill
    assert task.success(turned, 5.0)


@given(st.floats(-1, 1), st.floats(-0.5, 0.5), st.floats(-1, 1))
def test_actions_of_the_expert_stay_in_their_bounds(position: float, angle: float, speed: float) -> None:
    observation = np.repeat([position, angle, speed, speed], 3)
    for action in ("gain", "force"):
        task = tasks.make("cup-on-plate", action=action)
        for chosen in (task.expert_action(observation), task.constant_action(observation)):
            assert (task.action_low <= chosen).all()
            assert (chosen <= task.action_high).all()


def test_force_and_gain_actions_put_the_same_torques_on_the_arm() -> None:
    torques = []
    for action in ("gain", "force"):
        task = tasks.make("cup-on-plate", action=action)
        loop = task.simulation(5)
        task.start(loop, list(task.scenarios), noise=1.0, rng=np.random.default_rng(0))
        loop.qvel[:] = 0.1
        task.act(loop, task.expert_action(loop.observe()))
        loop.step(1)
        torques.append(loop.batch.bind("ctrl").copy())
    np.testing.assert_allclose(*torques, atol=1e-9)


def test_actions_beyond_the_bounds_are_clipped() -> None:
    for action in ("gain", "force"):
        task = tasks.make("cup-on-plate", action=action)
        loop = task.simulation(1)
        seen = []
        for scale in (1.0, 5.0):
            task.start(loop, ["train"], noise=0.0, rng=np.random.default_rng(0))
            task.act(loop, scale * task.action_high[None])
            loop.step(1)
            seen.append(loop.batch.state.copy())
        np.testing.assert_array_equal(*seen)


def test_starts_are_in_one_configuration() -> None:
    goal = cup_scene.start_angles((*cup_scene.PLATE, 0.05))
    for scenario in cup_scene.SCENARIOS.values():
        q = cup_scene.start_angles(scenario.start)
        np.testing.assert_allclose(cup_scene.robot().pose(q)[:3, 3], scenario.start, atol=1e-8)
        assert q[4] < 0
        assert abs(q[3]) < 0.01
        assert np.abs(q - goal).max() < np.pi


def test_any_start_in_reach_is_accepted_in_every_form() -> None:
    point = (0.45, 0.1, 0.4)
    for scenario in (
        point,
        np.array(point),
        Scenario(point),
        Scenario(point, "T2"),
        "0.45,0.1,0.4",
        " 0.450, .1,4e-1",
    ):
        task = tasks.make("cup-on-plate", scenario=scenario)
        assert task.scenario.name == "0.45,0.1,0.4"
        environment = tasks.VectorEnvironment(task, start_noise=0.0)
        observation, _ = environment.reset(seed=0)
        np.testing.assert_allclose(
            observation[0, :3], np.subtract((0.45, 0.1, 0.4), cup_scene.GOAL), atol=1e-7
        )


@pytest.mark.parametrize(
    ("scenario", "error", "message"),
    [
        ("T9", InputError, 'choose one of: train, T1.*or pass a start "x,y,z"'),
        ("1,2", InputError, "x,y,z"),
        ("0.4,0.1,high", InputError, "x,y,z"),
        ("0.4,0.1,nan", InputError, "finite"),
        ((1.2, 0.0, 0.3), ReachError, "out of reach.*move it"),
        ((600.0, -50.0, 300.0), ReachError, "Positions are in metres; if this one is in millimetres"),
        ((-400, -400, -300), ReachError, "in millimetres, divide it by 1000"),
        ((0.34, 0.13, 0.71), ReachError, "within 0.1 rad of a limit of joint_"),
        ((-0.4, -0.4, 0.3), InputError, "arm's vertical axis"),
        ((0.4, 0.4, 0.01), InputError, "must exceed 0.020 m"),
        ((0.5, 0.0, -0.1), InputError, "must exceed 0.000 m"),
        ((0.5, np.nan, 0.3), InputError, "finite"),
        ((0.5, 0.3), InputError, "shape"),
        (3, InputError, "shape"),
        ("", InputError, "choose one of"),
        (None, InputError, "numbers"),
    ],
)
def test_starts_that_cannot_be_used_are_refused(scenario, error, message) -> None:
    with pytest.raises(error, match=message):
        tasks.make("cup-on-plate", scenario=scenario)


def test_singular_and_turned_over_postures_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    where = np.array(cup_scene.SCENARIOS["train"].start)
    like = cup_scene.start_angles(cup_scene.SCENARIOS["train"].start)
    same = starts.start_posture(cup_scene.robot(), where, rotation=cup_scene.TOOL_DOWN, like=like)
    np.testing.assert_allclose(same, like, atol=1e-9)
    turned = like + np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    with pytest.raises(ReachError, match="turned over"):
        starts.start_posture(cup_scene.robot(), where, rotation=cup_scene.TOOL_DOWN, like=turned)
    monkeypatch.setattr(starts, "SMALLEST_SINGULAR_VALUE", 0.5)
    with pytest.raises(ReachError, match="singular value 0.231, at least 0.5"):
        starts.start_posture(cup_scene.robot(), where, rotation=cup_scene.TOOL_DOWN, like=like)


COORDINATE = st.floats(-2, 2)


@given(COORDINATE, COORDINATE, COORDINATE)
def test_the_name_of_a_scenario_can_be_read_back(x: float, y: float, z: float) -> None:
    name = Scenario((x, y, z)).name
    again = cup_scene.as_scenario(name)
    assert again.name == name
    np.testing.assert_allclose(again.start, (x, y, z), atol=0.5000001e-6)


def test_known_scenarios_keep_their_names() -> None:
    for name, scenario in cup_scene.SCENARIOS.items():
        assert cup_scene.as_scenario(name) is scenario
        assert cup_scene.as_scenario(scenario) is scenario
    assert cup_scene.SCENARIOS["train"].description == "0.60, −0.05, 0.30 m"


def test_start_noise_is_relative_to_the_usual_variation() -> None:
    task = tasks.make("cup-on-plate")
    loop, exact = task.simulation(2000), cup_scene.start_angles(task.scenario.start)
    for noise in (0.5, 1.0):
        task.start(loop, [task.scenario] * 2000, noise=noise, rng=np.random.default_rng(0))
        assert (loop.qpos - exact).std() == pytest.approx(0.02 * noise, rel=0.03)


def test_the_skeleton_runs_from_the_base_to_the_cup() -> None:
    task = tasks.make("cup-on-plate")
    q = np.array([cup_scene.start_angles(s.start) for s in cup_scene.SCENARIOS.values()])
    points = task.skeleton(q)
    assert points.shape == (5, 9, 3)
    np.testing.assert_allclose(points[:, 0], 0.0)
    np.testing.assert_allclose(points[:, -1], [s.start for s in cup_scene.SCENARIOS.values()], atol=1e-7)


@pytest.mark.parametrize(
    "options", [{"action": "torque"}, {"history": 0}, {"history": 1.5}, {"history": True}, {"action": None}]
)
def test_bad_options_are_refused(options: dict) -> None:
    with pytest.raises(InputError):
        tasks.make("cup-on-plate", **options)


def test_constant_gains_are_the_middle_of_the_range() -> None:
    gain, force = (tasks.make("cup-on-plate", action=action) for action in ("gain", "force"))
    observation = np.linspace(-0.1, 0.1, 24).reshape(2, 12)
    np.testing.assert_array_equal(gain.constant_action(), np.zeros(7))
    np.testing.assert_allclose(gain.constant_action(observation), np.zeros((2, 7)), atol=1e-15)
    expected = -130 * observation[:, :3] - 10.5 * np.sqrt(130) * observation[:, 6:9]
    np.testing.assert_allclose(
        force.constant_action(observation)[:, :3] * cup_on_plate.WRENCH_UNIT[:3], expected
    )


def test_an_unknown_constant_gain_is_refused() -> None:
    with pytest.raises(InputError, match="constant gain is 'soft'; choose one of: constant"):
        tasks.make("cup-on-plate").constant_action(which="soft")


def test_unknown_task_and_missing_observations_are_refused() -> None:
    with pytest.raises(InputError, match="cup-on-plate"):
        tasks.make("cup-on-table")
    with pytest.raises(InputError, match="pass the observations"):
        tasks.make("cup-on-plate", action="force").constant_action()
    with pytest.raises(InputError):
        tasks.make("cup-on-plate").expert_action(np.full(12, np.nan))
