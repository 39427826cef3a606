"""Evaluations, traces, sweeps: what they say must follow from the task's own numbers."""

from __future__ import annotations

import csv
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tests.experiment_runs import copy, finished
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments import task_views
from vic_toolbox.experiments.evaluation import (
    Evaluation,
    Policy,
    evaluate,
    judge,
    run_episodes,
)
from vic_toolbox.experiments.figures.reward import reward_landscape
from vic_toolbox.experiments.intervals import NORMAL_QUANTILE, wilson_interval
from vic_toolbox.experiments.results import read_evaluation, write_evaluation
from vic_toolbox.experiments.reward_slices import reward_slice
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.skill import Skill, load_skill
from vic_toolbox.experiments.stability_rollout import action_policy
from vic_toolbox.experiments.start_sweep import StartGrid, sweep_runs, sweep_starts
from vic_toolbox.experiments.trace import record_trace
from vic_toolbox.learning import GaussianPolicy, RewardNetwork
from vic_toolbox.tasks.cup_on_plate import CupOnPlate
from vic_toolbox.tasks.cup_scene import GOAL


@pytest.fixture(scope="module")
def task() -> CupOnPlate:
    return CupOnPlate()


def test_the_expert_is_no_different_from_himself(task: CupOnPlate):
    row = evaluate(task, Policy.expert(task), episodes=3, threads=1)
    assert row.relative_difference == row.signed_difference == 0.0
    assert row.score_mean == row.expert_score
    assert row.success_rate == 1.0


def test_every_policy_meets_the_same_starts(task: CupOnPlate):
    policies = {"again": Policy(task.expert_action, "airl"), "constant": Policy.constant(task)}
    rows = judge(task, policies, episodes=3, threads=1)
    assert rows["again"].score_mean == rows["again"].expert_score == rows["constant"].expert_score
    assert rows["constant"].signed_difference > 0.05


@pytest.mark.parametrize("action", ["gain", "force"])
def test_constant_gains_score_alike_in_both_action_spaces(action: str):
    task = CupOnPlate(action=action)
    row = evaluate(task, Policy.constant(task), episodes=2, threads=1)
    assert row.score_mean == pytest.approx(-381.0, rel=0.05)


def test_scores_do_not_depend_on_threads_or_on_how_many_run_at_once(task: CupOnPlate, monkeypatch):
    whole = run_episodes(task, task.expert_action, episodes=6, threads=3)
    assert np.array_equal(whole.score, run_episodes(task, task.expert_action, episodes=6, threads=1).score)
    assert np.unique(whole.score).size == 6
    monkeypatch.setattr("vic_toolbox.experiments.evaluation._AT_ONCE", 4)
    parts = run_episodes(task, task.expert_action, episodes=6, threads=1)
    assert parts.score.shape == (6,)
    assert np.array_equal(
        parts.score[:4], run_episodes(task, task.expert_action, episodes=4, threads=1).score
    )


@pytest.mark.parametrize(
    "options",
    [{"episodes": 0}, {"episodes": 1.5}, {"seed": -1}, {"start_noise": -0.1}, {"start_noise": float("nan")}],
)
def test_bad_numbers_are_refused(task: CupOnPlate, options: dict):
    with pytest.raises(InputError):
        partial(run_episodes, task, task.expert_action, episodes=1)(**options)


def test_a_policy_that_outputs_nan_is_refused(task: CupOnPlate):
    with pytest.raises(InputError, match="actions"):
        run_episodes(task, lambda seen: np.full((len(seen), 7), np.nan), episodes=1)


def test_evaluations_come_back_from_disk(tmp_path: Path, task: CupOnPlate):
    row = evaluate(task, Policy.constant(task), episodes=1, threads=1)
    with RunFolder.create(tmp_path, "training", {}) as folder:
        write_evaluation(folder, row)
        assert read_evaluation(folder, "train") == row
        assert Evaluation(**json.loads((tmp_path / "evaluation.json").read_text())) == row
        (tmp_path / "evaluations" / "train" / "evaluation.json").write_text('{"task": "cup-on-plate"}')
        with pytest.raises(FileError, match=r"evaluation.json"):
            read_evaluation(folder, "train")


def test_a_start_of_ones_own_is_written_out():
    assert CupOnPlate(scenario="T2").scenario.name == "T2"
    assert CupOnPlate(scenario=(0.5, -0.1, 0.30005)).scenario.name == "0.5,-0.1,0.30005"


@given(st.integers(1, 400), st.floats(0, 1))
def test_the_interval_of_a_rate_holds_exactly_the_chances_that_it_does_not_contradict(n: int, share: float):
    """Its ends are the p at which the rate lies 1.96 standard deviations away: the score test, inverted."""
    rate = round(share * n) / n
    low, high = wilson_interval(rate, n)
    assert 0.0 <= low <= rate <= high <= 1.0
    for end in (low, high):
        if 1e-9 < end < 1.0 - 1e-9:
            assert (rate - end) ** 2 == pytest.approx(NORMAL_QUANTILE**2 * end * (1.0 - end) / n, rel=1e-6)
    assert wilson_interval(1.0 - rate, n) == pytest.approx((1.0 - high, 1.0 - low), abs=1e-12)


def test_an_evaluation_knows_how_sure_its_success_is(task: CupOnPlate):
    row = evaluate(task, Policy.expert(task), episodes=3, threads=1)
    assert (row.success_rate, row.success_high) == (1.0, 1.0)
    assert row.success_low == pytest.approx(3 / (3 + NORMAL_QUANTILE**2))


# --- traces --------------------------------------------------------------------------------------------------


def test_a_trace_holds_the_episode(task: CupOnPlate):
    trace = record_trace(task, task.expert_action)
    assert np.allclose(trace.path[0], task.scenario.start, atol=1e-6)
    assert np.allclose(trace.goal, GOAL, atol=1e-6)
    assert trace.score == pytest.approx(task.reward(trace.observations).sum())
    assert trace.distance[-1] < 0.02
    expected = -trace.stiffness * trace.error - trace.damping * trace.rate
    assert np.allclose(trace.feedback, expected)
    wanted = task.expert.parameters(trace.observations)
    assert np.allclose(trace.stiffness, wanted[:, :6])
    assert np.allclose(trace.damping_factor, wanted[:, 6])


def test_a_force_trace_has_a_wrench_and_no_stiffness():
    task = CupOnPlate(action="force")
    trace = record_trace(task, task.expert_action)
    assert not trace.stiffness.any()
    assert np.isnan(trace.damping_factor).all()
    gain = record_trace(CupOnPlate(), CupOnPlate().expert_action)
    assert np.abs(trace.feedback[0, :3] - gain.feedback[0, :3]).max() < 1e-9


def test_a_trace_of_a_scaled_part_is_in_si_units_whatever_is_seen():
    skill = load_skill(finished("airl", "peg-in-hole"))
    task = skill.task("scale=0.5")
    trace = record_trace(task, skill.policy.mean)
    np.testing.assert_array_equal(trace.error[:, :3], 0.5 * trace.observations[:, :3])
    np.testing.assert_allclose(trace.path, trace.joints[:, :3], atol=1e-15)
    motion = np.hstack([trace.error, trace.rate])
    np.testing.assert_array_equal(action_policy(skill, task)(motion), skill.policy.mean(trace.observations))


def test_with_history_the_trace_still_reads_the_newest_observation():
    task = CupOnPlate(history=5)
    trace = record_trace(task, task.expert_action)
    assert trace.observations.shape == (task.horizon, 60)
    assert trace.score == record_trace(CupOnPlate(), CupOnPlate().expert_action).score


# --- the reward's slices -------------------------------------------------------------------------------------


def test_the_slice_turns_all_gains_together(task: CupOnPlate):
    skill = load_skill(finished("airl"))
    assert skill.reward is not None
    expert = record_trace(task, task.expert_action)
    part = reward_slice(task, skill.reward, skill.policy, expert, name="airl")
    assert (part.value[0], part.value[-1]) == (60.0, 200.0)
    assert part.reward.shape == (len(part.distance), len(part.value))
    near, far = np.argmin(part.distance), np.argmax(part.distance)
    assert part.chosen["expert"][near] == pytest.approx(60.0)
    assert part.chosen["expert"][far] == pytest.approx(200.0)
    # at its ends the line runs through the expert's own actions: soft and well damped, stiff and lightly damped
    for row, column in ((near, 0), (far, -1)):
        state = expert.observations[np.argmin(np.abs(expert.distance - part.distance[row]))]
        assert part.reward[row, column] == pytest.approx(
            reward_of(skill, state, task.expert_action(state)), abs=1e-4
        )
    assert len(reward_landscape([part]).axes) == 2


def reward_of(skill: Skill, state: np.ndarray, action: np.ndarray) -> float:
    assert skill.reward is not None
    sample = torch.cat(
        [skill.policy.scaled(state[None]), torch.tensor(action[None], dtype=torch.float32)], dim=1
    )
    return float(skill.reward.value(sample)[0])


def test_a_task_without_a_knob_is_cut_through_the_experts_own_action(task: CupOnPlate, monkeypatch):
    skill = load_skill(finished("airl"))
    assert skill.reward is not None
    monkeypatch.setattr(task_views, "VIEWS", {})
    expert = record_trace(task, task.expert_action)
    part = reward_slice(task, skill.reward, skill.policy, expert, name="airl")
    assert (part.value[0], part.value[-1]) == (-1.0, 1.0)
    far = np.argmax(part.distance)
    assert part.chosen["expert"] == pytest.approx(np.ones(len(part.distance)))
    state = expert.observations[np.argmax(expert.distance)]
    assert part.reward[far, -1] == pytest.approx(reward_of(skill, state, task.expert_action(state)), abs=1e-5)
    assert part.reward[far, 0] == pytest.approx(reward_of(skill, state, -task.expert_action(state)), abs=1e-5)
    assert "mirror image" in task_views.knob(task).caption


def test_the_reward_of_a_wrench_is_cut_along_the_experts():
    task = CupOnPlate(action="force")
    reward = RewardNetwork.for_task(task, seed=3)
    policy = GaussianPolicy.for_task(task, hidden=8, log_std=0.0, seed=0)
    expert = record_trace(task, task.expert_action)
    part = reward_slice(task, reward, policy, expert, name="airl")
    assert (part.value[0], part.value[-1]) == (0.0, 2.0)
    assert part.chosen["expert"] == pytest.approx(np.ones(len(part.distance)))
    state, action = expert.observations[0], task.expert_action(expert.observations[0])
    sample = torch.cat(
        [policy.scaled(state[None]), torch.tensor(2.0 * action[None], dtype=torch.float32)], dim=1
    )
    assert part.reward[0, -1] == pytest.approx(float(reward.value(sample)[0]), abs=1e-5)


# --- sweeps --------------------------------------------------------------------------------------------------


def test_the_grid_lies_on_rings_around_the_goal():
    grid = StartGrid(nearest=0.3, farthest=0.9, rings=3, bearings=8, elevation=40.0)
    offset = grid.starts() - GOAL
    distance = np.linalg.norm(offset, axis=1).reshape(3, 8)
    assert np.allclose(distance, [[0.3], [0.6], [0.9]])
    assert np.allclose(np.degrees(np.arcsin(offset[:, 2] / distance.ravel())), 40.0)


@pytest.mark.parametrize(
    "options", [{"nearest": 0.0}, {"farthest": 0.1}, {"rings": 0}, {"bearings": 0}, {"elevation": 90.0}]
)
def test_a_bad_grid_is_refused(options: dict):
    with pytest.raises(InputError):
        StartGrid(**options)


def test_a_sweep_judges_every_reachable_start(tmp_path: Path, task: CupOnPlate):
    grid = StartGrid(nearest=0.4, farthest=1.2, rings=2, bearings=4)
    swept = sweep_starts(task, {"constant": Policy.constant(task)}, grid=grid, threads=1)
    assert len(swept.starts) + len(swept.unreachable) == 8
    assert len(swept.starts) >= 2
    assert len(swept.unreachable) >= 1
    alone = record_trace(CupOnPlate(scenario=tuple(swept.starts[0])), task.expert_action)
    assert swept.score["expert"][0] == pytest.approx(alone.score, rel=1e-9)
    swept.write(tmp_path)
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert [float(row["score_constant"]) for row in rows] == pytest.approx(swept.score["constant"], rel=1e-5)
    summary = json.loads((tmp_path / "sweep.json").read_text())
    expected = swept.relative_difference["constant"].mean()
    assert summary["methods"]["constant"]["relative_difference_mean"] == pytest.approx(expected)
    assert (tmp_path / "sweep.svg").stat().st_size > 10_000


def test_a_sweep_without_a_start_in_reach_is_refused(task: CupOnPlate):
    grid = StartGrid(nearest=3.0, farthest=4.0, rings=1, bearings=4)
    with pytest.raises(InputError, match="none of the grid's starts"):
        sweep_starts(task, {}, grid=grid)


def test_runs_of_different_tasks_cannot_share_a_sweep(tmp_path: Path):
    run = copy(finished("bc"), tmp_path / "bc")
    text = (run / "config.json").read_text()
    (run / "config.json").write_text(text.replace('"history": 1', '"history": 5'))
    first, other = load_skill(finished("airl")), load_skill(finished("bc"))
    with pytest.raises(FileError):
        load_skill(run)
    object.__setattr__(other, "run", load_configuration(run))
    with pytest.raises(InputError, match="Sweep each alone"):
        sweep_runs([first, other])


def load_configuration(run: Path):  # type: ignore[no-untyped-def]
    from vic_toolbox.experiments.configuration import RunConfiguration, from_json

    return from_json(RunConfiguration, RunFolder.open(run).configuration, where="run")
