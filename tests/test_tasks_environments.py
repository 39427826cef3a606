"""Gymnasium environments, the batched engine, demonstrations and pictures."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from vic_toolbox import tasks
from vic_toolbox.errors import DependencyError, FileError, InputError
from vic_toolbox.tasks import cup_scene, rendering
from vic_toolbox.tasks.demonstrations import random_push

ID = "vic/CupOnPlate-v0"
BATCHED = (tasks.CupOnPlateVectorEnv, tasks.PegInHoleVectorEnv)
every_task = pytest.mark.parametrize("batched", BATCHED, ids=lambda kind: kind.__name__)


def rollout(environment: tasks.VectorEnvironment, steps: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Observations and rewards under random actions that depend on the seed only."""
    rng = np.random.default_rng(seed)
    observations, rewards = [environment.reset(seed=seed)[0]], []
    for _ in range(steps):
        action = rng.uniform(-1.5, 1.5, environment.action_space.shape)
        observation, reward, _, _, _ = environment.step(action)
        observations.append(observation)
        rewards.append(reward)
    return np.array(observations), np.array(rewards)


def opengl_works() -> bool:
    try:
        rendering.Renderer(tasks.CupOnPlate().picture_spec(), width=32, height=32).close()
    except DependencyError:
        return False
    return True


needs_opengl = pytest.mark.skipif(not opengl_works(), reason="no OpenGL on this machine")


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", [ID, "vic/PegInHole-v0"])
@pytest.mark.parametrize(("action", "history"), [("gain", 1), ("force", 5)])
def test_gymnasium_accepts_the_environment(name: str, action: str, history: int) -> None:
    environment = gymnasium.make(name, action=action, history=history)
    check_env(environment.unwrapped, skip_render_check=not opengl_works())


@pytest.mark.parametrize(
    ("name", "scenario", "kind"), [(ID, "T2", BATCHED[0]), ("vic/PegInHole-v0", "scale=0.5", BATCHED[1])]
)
def test_make_vec_gives_the_batched_engine_itself(name: str, scenario: str, kind: type) -> None:
    environment = gymnasium.make_vec(
        name,
        num_envs=7,
        vectorization_mode="vector_entry_point",
        action="force",
        history=5,
        scenario=scenario,
    )
    assert type(environment) is kind
    assert isinstance(environment, tasks.VectorEnvironment)
    assert environment.num_envs == 7
    assert environment.task.scenario.name == scenario
    assert environment.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    observation, _ = environment.reset(seed=0)
    assert observation in environment.observation_space
    results = environment.step(environment.action_space.sample())
    assert [np.shape(r) for r in results[:4]] == [(7, 60), (7,), (7,), (7,)]
    environment.close()


def test_films_run_at_the_rate_of_the_policy() -> None:
    for made in (gymnasium.make(ID).unwrapped, tasks.CupOnPlateVectorEnv(2)):
        assert made.metadata["render_fps"] == 100
    assert tasks.PegInHoleVectorEnv(2).metadata["render_fps"] == 50


@pytest.mark.parametrize(("name", "kind"), [(ID, BATCHED[0]), ("vic/PegInHole-v0", BATCHED[1])])
def test_single_environment_is_one_row_of_the_batch(name: str, kind: Any) -> None:
    single = gymnasium.make(name, start_noise=0.0)
    batched = kind(3, start_noise=0.0)
    one, _ = single.reset(seed=0)
    many, _ = batched.reset(seed=0)
    for _ in range(20):
        np.testing.assert_array_equal(many, np.tile(one, (3, 1)))
        action = batched.expert_action(many)
        one, reward, _, _, _ = single.step(action[0])
        many, rewards, _, _, _ = batched.step(action)
        np.testing.assert_array_equal(rewards, reward)


@every_task
def test_same_seed_same_numbers_on_any_number_of_threads(batched: Any) -> None:
    first = rollout(batched(6), 40, seed=5)
    again = rollout(batched(6, threads=4), 40, seed=5)
    other = rollout(batched(6), 40, seed=6)
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first[0], other[0])


@every_task
def test_history_is_the_last_observations_oldest_first(batched: Any) -> None:
    now, _ = rollout(batched(4), 12, seed=1)
    past, _ = rollout(batched(4, history=5), 12, seed=1)
    for t in range(13):
        expected = np.concatenate([now[max(t - k, 0)] for k in (4, 3, 2, 1, 0)], axis=1)
        np.testing.assert_array_equal(past[t], expected)


@every_task
def test_episodes_end_together_and_the_next_step_starts_anew(batched: Any) -> None:
    environment = batched(3)
    start, _ = environment.reset(seed=0)
    observation, total, horizon = start, np.zeros(3), environment.task.horizon
    for t in range(horizon):
        observation, reward, terminated, truncated, info = environment.step(
            environment.expert_action(observation)
        )
        total += reward
        assert not terminated.any()
        assert truncated.all() == (t == horizon - 1)
        assert bool(info) == (t == horizon - 1)
    np.testing.assert_allclose(info["score"], total)
    assert info["_score"].all()
    fresh, reward, _, truncated, _ = environment.step(np.zeros(environment.action_space.shape))
    assert (reward == 0).all()
    assert not truncated.any()
    assert (np.abs(fresh[:, 6:]) < 1e-12).all()
    far = np.linalg.norm(start[:, :3], axis=1)
    np.testing.assert_allclose(np.linalg.norm(fresh[:, :3], axis=1), far, rtol=0.2)


def test_each_simulation_may_have_its_own_start() -> None:
    environment = tasks.CupOnPlateVectorEnv(3)
    starts = ["T1", (0.45, 0.1, 0.4), tasks.Scenario((0.5, 0.0, 0.3))]
    observation, _ = environment.reset(options={"start_noise": 0.0, "scenarios": starts})
    expected = np.subtract([(0.35, -0.35, 0.45), (0.45, 0.1, 0.4), (0.5, 0.0, 0.3)], cup_scene.GOAL)
    np.testing.assert_allclose(observation[:, :3], expected, atol=1e-7)
    one = gymnasium.make(ID)
    observation, _ = one.reset(options={"start_noise": 0.0, "scenario": "T1"})
    np.testing.assert_allclose(observation[:3], expected[0], atol=1e-7)


@every_task
def test_returned_arrays_belong_to_the_caller(batched: Any) -> None:
    environment = batched(2)
    nothing = np.zeros(environment.action_space.shape)
    observation, _ = environment.reset(seed=0)
    kept = observation.copy()
    observation[:] = np.nan
    after, _, _, _, _ = environment.step(nothing)
    environment.reset(seed=0)
    np.testing.assert_array_equal(after, environment.step(nothing)[0])
    np.testing.assert_array_equal(kept, environment.reset(seed=0)[0])


@pytest.mark.parametrize(
    "actions", [np.zeros((2, 6)), np.zeros(7), np.full((2, 7), np.nan), np.full((2, 7), np.inf), None, "up"]
)
def test_bad_actions_are_refused(actions) -> None:
    environment = tasks.CupOnPlateVectorEnv(2)
    environment.reset(seed=0)
    with pytest.raises(InputError, match="actions"):
        environment.step(actions)


@pytest.mark.parametrize(
    "options",
    [
        {"start_noise": -0.1},
        {"start_noise": np.nan},
        {"start_noise": 10.1},
        {"scenarios": ["train"]},
        {"scenarios": "T1"},
        {"scenarios": ["train", "T9"]},
        {"noise": 0.1},
    ],
)
def test_bad_reset_options_are_refused(options: dict) -> None:
    with pytest.raises(InputError):
        tasks.CupOnPlateVectorEnv(2).reset(options=options)


def test_misuse_says_what_to_do() -> None:
    with pytest.raises(InputError, match="call reset first"):
        tasks.CupOnPlateVectorEnv(2).step(np.zeros((2, 7)))
    with pytest.raises(InputError, match="rgb_array"):
        tasks.CupOnPlateVectorEnv(2, render_mode="text")
    with pytest.raises(InputError, match="num_envs"):
        tasks.CupOnPlateVectorEnv(0)
    environment = tasks.CupOnPlateVectorEnv(2)
    environment.reset(seed=0)
    with pytest.raises(InputError, match="force"):
        environment.set_push(np.zeros((2, 2)))
    assert environment.render() is None


def test_importing_tasks_loads_no_simulator() -> None:
    code = (
        "import sys, vic_toolbox.tasks; sys.exit(any(m in sys.modules for m in ('mujoco', 'numba', 'torch')))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- demonstrations ---


@pytest.fixture(scope="module")
def demonstrations() -> tasks.Demonstrations:
    return tasks.record(tasks.make("cup-on-plate"), 6, seed=2)


def test_every_peg_of_the_demonstrations_goes_in_though_it_is_pushed() -> None:
    task = tasks.PegInHole()
    pegs = tasks.record(task, 10, seed=2)
    assert (pegs.task, pegs.push, pegs.start_noise) == ("peg-in-hole", task.push, 1.0)
    assert (task.tip_position(pegs.observations[:, -1])[:, 2] < -5e-3).all()
    np.testing.assert_array_equal(pegs.actions, task.expert_action(pegs.observations[:, :-1]))
    np.testing.assert_allclose(pegs.scores, task.score(np.swapaxes(pegs.observations[:, :-1], 0, 1)))
    forces = tasks.record(task.with_action("force"), 10, seed=2)
    np.testing.assert_array_equal(forces.observations, pegs.observations)


def test_demonstrations_hold_the_experts_actions(demonstrations: tasks.Demonstrations) -> None:
    assert demonstrations.observations.shape == (6, 501, 12)
    assert demonstrations.actions.shape == (6, 500, 7)
    expected = tasks.make("cup-on-plate").expert_action(demonstrations.observations[:, :-1])
    np.testing.assert_array_equal(demonstrations.actions, expected)
    assert (np.abs(demonstrations.scores + 343) < 0.25 * 343).all()


def test_by_default_they_are_pushed_and_varied_as_the_task_says(demonstrations: tasks.Demonstrations) -> None:
    task = tasks.make("cup-on-plate")
    assert (demonstrations.push, demonstrations.start_noise) == (task.push, 1.0)
    same = tasks.record(task, 6, seed=2, push=5.0, start_noise=1.0)
    np.testing.assert_array_equal(same.observations, demonstrations.observations)


def test_every_action_space_gets_the_same_motions(demonstrations: tasks.Demonstrations) -> None:
    forces = tasks.record(tasks.make("cup-on-plate", action="force", history=2), 6, seed=2, threads=3)
    np.testing.assert_array_equal(forces.observations[..., 12:], demonstrations.observations)
    assert forces.actions.shape == (6, 500, 6)


def test_push_has_the_stated_strength_and_memory() -> None:
    forces = random_push(2000, 40, std=5.0, dt=0.01, rng=np.random.default_rng(0))
    assert forces.std() == pytest.approx(5.0, rel=0.03)
    for lag in (1, 10, 30):
        correlation = (forces[lag:] * forces[:-lag]).mean() / 25
        assert correlation == pytest.approx(np.exp(-lag * 0.01 / 0.1), abs=0.05)


def test_without_push_and_noise_all_demonstrations_are_one(demonstrations: tasks.Demonstrations) -> None:
    calm = tasks.record(tasks.make("cup-on-plate"), 2, push=0.0, start_noise=0.0)
    np.testing.assert_array_equal(calm.observations[0], calm.observations[1])
    assert np.ptp(demonstrations.observations[:, -1, 0]) > 1e-3


def test_demonstrations_survive_the_disk(demonstrations: tasks.Demonstrations, tmp_path: Path) -> None:
    demonstrations.save(tmp_path / "demos.npz")
    loaded = tasks.Demonstrations.load(tmp_path / "demos.npz")
    for name in ("observations", "actions", "scores"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(demonstrations, name))
    for name in ("task", "action", "scenario", "history", "push", "start_noise", "seed"):
        assert getattr(loaded, name) == getattr(demonstrations, name)
    assert [path.name for path in tmp_path.iterdir()] == ["demos.npz"]


def test_split_keeps_every_trajectory_once(demonstrations: tasks.Demonstrations) -> None:
    training, held_out = demonstrations.split(2)
    assert (len(training), len(held_out)) == (4, 2)
    together = np.concatenate([training.actions, held_out.actions])
    np.testing.assert_array_equal(together, demonstrations.actions)
    for bad in (0, 6, 1.5):
        with pytest.raises(InputError, match="held_out"):
            demonstrations.split(bad)  # type: ignore[arg-type]


def test_damaged_files_are_refused(demonstrations: tasks.Demonstrations, tmp_path: Path) -> None:
    path = tmp_path / "demos.npz"
    with pytest.raises(FileError, match="cannot be read"):
        tasks.Demonstrations.load(path)
    demonstrations.save(path)
    whole = path.read_bytes()
    for damage in (b"", b"no zip", whole[: len(whole) // 2]):
        path.write_bytes(damage)
        with pytest.raises(FileError, match="record them again"):
            tasks.Demonstrations.load(path)
    fields = {name: np.asarray(getattr(demonstrations, name)) for name in demonstrations.__dataclass_fields__}
    for change in (
        {"actions": fields["actions"][:, :-1]},
        {"scores": np.full(6, np.nan)},
        {"format": np.int64(9)},
        {"format": np.zeros(2)},
        {"extra": np.zeros(1)},
        {"seed": np.zeros(3)},
        {"observations": np.array([{"a": 1}], dtype=object)},
    ):
        content: dict[str, Any] = {"format": np.int64(2)} | fields | change
        np.savez(path, **content)
        with pytest.raises(FileError):
            tasks.Demonstrations.load(path)


def test_demonstrations_that_cannot_be_written_leave_the_old_file(
    demonstrations: tasks.Demonstrations, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(FileError):
        demonstrations.save(tmp_path / "file" / "demos.npz")


@pytest.mark.parametrize("options", [{"count": 0}, {"push": -1.0}, {"push": np.nan}, {"seed": -1}])
def test_bad_recordings_are_refused(options: dict) -> None:
    with pytest.raises(InputError):
        tasks.record(tasks.make("cup-on-plate"), **options)


# --- pictures ---


@needs_opengl
def test_pictures_show_the_arm_where_it_is() -> None:
    with rendering.Renderer(tasks.CupOnPlate().picture_spec(), width=160, height=96) as renderer:
        pictures = [
            renderer.picture(cup_scene.start_angles(cup_scene.SCENARIOS[n].start)) for n in ("train", "T4")
        ]
    assert pictures[0].shape == (96, 160, 3)
    assert pictures[0].dtype == np.uint8
    yellow = (pictures[0][..., 0] > 150) & (pictures[0][..., 1] > 110) & (pictures[0][..., 2] < 80)
    assert yellow.mean() > 0.01
    assert (pictures[0] != pictures[1]).any(axis=-1).mean() > 0.02
    with pytest.raises(InputError, match="closed"):
        renderer.picture(np.zeros(6))


@needs_opengl
def test_vector_environment_renders_each_simulation() -> None:
    environment = tasks.CupOnPlateVectorEnv(2, render_mode="rgb_array", start_noise=0.0)
    environment.reset(options={"scenarios": ["train", "T1"]})
    pictures = environment.render()
    assert pictures is not None
    assert len(pictures) == 2
    assert (pictures[0] != pictures[1]).any()
    environment.close()


def _missing(name: str) -> None:
    raise ImportError(f"no module {name}")


def test_missing_opengl_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    spec = tasks.CupOnPlate().picture_spec()
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setattr(rendering.importlib, "import_module", _missing)
    with pytest.raises(DependencyError, match="no OpenGL.*apt-get install.*MUJOCO_GL"):
        rendering.Renderer(spec)


@pytest.mark.parametrize(
    "line", ["from vic_toolbox.tasks import CupOnPlate", "import vic_toolbox.tasks.cup_on_plate"]
)
def test_an_opengl_that_mujoco_cannot_load_is_named(line: str, tmp_path: Path) -> None:
    """With MUJOCO_GL=osmesa and no OSMesa, ``import mujoco`` ends in an AttributeError of PyOpenGL."""
    (tmp_path / "mujoco.py").write_text("None.glGetError")
    environment = os.environ | {"MUJOCO_GL": "osmesa", "PYTHONPATH": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", line], env=environment, capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert "DependencyError: MuJoCo cannot be imported with MUJOCO_GL=osmesa" in last
    assert "Unset MUJOCO_GL" in last


@pytest.mark.parametrize(
    ("part", "package"), [("tasks", "gymnasium"), ("tasks", "mujoco"), ("learning", "torch")]
)
def test_a_missing_package_is_named_with_its_group(part: str, package: str) -> None:
    code = f"import sys; sys.modules[{package!r}] = None\nimport vic_toolbox.{part}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    last = done.stderr.splitlines()[-1]
    assert last.startswith(f"vic_toolbox.errors.DependencyError: {package} is not installed")
    assert "pip install 'vic-toolbox[learn]'" in last


def test_missing_display_is_a_warning_for_the_human_mode(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering.sys, "platform", "linux")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    environment = tasks.CupOnPlateEnv(render_mode="human")
    with pytest.warns(UserWarning, match="no display.*unseen"):
        environment.reset(seed=0)
    environment.step(np.zeros(7))
    environment.close()


def test_films_are_whole_or_absent(tmp_path: Path) -> None:
    pictures = [np.full((32, 48, 3), shade, np.uint8) for shade in range(0, 250, 10)]
    rendering.write_video(tmp_path / "film.mp4", pictures)
    assert (tmp_path / "film.mp4").stat().st_size > 500
    for bad, message in (
        ([], "no pictures"),
        ([pictures[0], pictures[0][:16]], "one size"),
        ([pictures[0][:31]], "even"),
        ([pictures[0].astype(float)], "uint8"),
    ):
        with pytest.raises(InputError, match=message):
            rendering.write_video(tmp_path / "bad.mp4", bad)
    with pytest.raises(InputError, match="mp4"):
        rendering.write_video(tmp_path / "film.gif", pictures)
    assert [path.name for path in tmp_path.iterdir()] == ["film.mp4"]
