"""Recordings with fitted gains as demonstrations of a task: what a policy would have seen and done."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from tests.gain_data import clock, recorded, rich_motion
from vic_toolbox import tasks
from vic_toolbox.errors import InputError
from vic_toolbox.estimation import GainEstimate, fit_smooth
from vic_toolbox.gains import CholeskyStiffness, DampingFactor, Diagonal, DiagonalStiffness, ImpedanceGains
from vic_toolbox.learning import ExpertData, GaussianPolicy, clone, recipe
from vic_toolbox.recordings import Recording

STIFFNESS = np.array([120.0, 100.0, 80.0, 3.0, 4.0, 5.0])
FACTOR = 10.0
DAMPING = np.concatenate([FACTOR * np.sqrt(STIFFNESS[:3]), np.full(3, 12 * np.sqrt(3.0))])


def log(
    seed: int = 0, *, seconds: float = 2.0, stiffness: np.ndarray = STIFFNESS, start: float = 0.0
) -> Recording:
    t = clock(seconds, 500.0)
    e, v = rich_motion(t, np.random.default_rng(seed))
    return recorded(t + start, e, v, stiffness * e + DAMPING * v)


def constant(*logs: Recording) -> GainEstimate:
    return fit_smooth(list(logs), None)


@pytest.fixture(scope="module")
def task() -> tasks.Task:
    return tasks.make("cup-on-plate", history=3)


def test_observations_and_actions_are_those_of_the_task(task: tasks.Task):
    source = log()
    found = tasks.Demonstrations.from_recordings(source, constant(source), task=task)
    steps = int(source.duration / task.dt)
    assert found.observations.shape == (1, steps + 1, 36)
    every = source.rows(slice(None, None, 5))  # 500 Hz to 100 Hz
    now = np.hstack([every.error, every.error_rate])
    np.testing.assert_allclose(found.observations[0, :, -12:], now[: steps + 1], atol=1e-9)
    np.testing.assert_allclose(found.observations[0, 2:, :12], now[: steps - 1], atol=1e-9)
    np.testing.assert_allclose(found.observations[0, 0], np.tile(now[0], 3), atol=1e-9)
    wanted = task.gains.parameters_to_action([*STIFFNESS, FACTOR])
    np.testing.assert_allclose(found.actions[0], np.tile(wanted, (steps, 1)), atol=1e-4)
    np.testing.assert_allclose(found.scores, task.score(found.observations[:, :-1].swapaxes(0, 1)))
    assert (found.task, found.action, found.history, found.scenario) == ("cup-on-plate", "gain", 3, "train")


def test_in_the_force_space_the_action_is_the_wrench_of_the_law():
    force = tasks.make("cup-on-plate", action="force")
    source = log()
    found = tasks.Demonstrations.from_recordings(source, constant(source), task=force)
    e, rate = np.split(found.observations[:, :-1], 2, axis=-1)
    wrench = -STIFFNESS * e - np.concatenate([DAMPING[:3], np.zeros(3)]) * rate
    np.testing.assert_allclose(found.actions * np.repeat([5.0, 0.1], 3), wrench, atol=1e-3)


def test_a_peg_learns_stiffness_alone():
    peg = tasks.make("peg-in-hole")
    stiff = np.array([1000.0, 1000.0, 900.0, 6.0, 6.0, 6.0])
    source = log(stiffness=stiff)
    found = tasks.Demonstrations.from_recordings(source, constant(source), task=peg)
    np.testing.assert_allclose(peg.gains.action_to_parameters(found.actions)[0, 0], stiff, rtol=1e-4)


def test_pooled_gains_are_on_the_clock_of_each_recording(task: tasks.Task):
    rising = np.linspace(70.0, 190.0, 1000)[:, None] * np.array([1, 1, 1, 0, 0, 0]) + np.array(
        [0, 0, 0, 3.0, 3, 3]
    )
    logs = [log(seed, stiffness=rising, start=50.0 * seed) for seed in range(2)]
    estimate = fit_smooth(logs, 0.5)
    found = tasks.Demonstrations.from_recordings(logs, estimate, task=task)
    first, last = (task.gains.action_to_parameters(found.actions[:, i]) for i in (0, -1))
    np.testing.assert_allclose(first[:, :3], 70.0, atol=3.0)
    np.testing.assert_allclose(last[:, :3], 189.0, atol=3.0)
    # one estimate for each keeps the clock that it was fitted on
    each = tasks.Demonstrations.from_recordings(logs, [fit_smooth(one, 0.5) for one in logs], task=task)
    np.testing.assert_allclose(each.actions, found.actions, atol=0.05)


def test_what_the_task_cannot_set_is_clipped_and_told(task: tasks.Task):
    source = log(stiffness=STIFFNESS * np.array([3.0, 1, 1, 1, 1, 1]))
    with pytest.warns(
        UserWarning, match=r"29 % of the fitted gains.*k_x 360 to 360 \(range 60 to 200\) in 100 %; d 7.18"
    ):
        found = tasks.Demonstrations.from_recordings(source, constant(source), task=task)
    assert found.actions[..., 0].max() == 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tasks.Demonstrations.from_recordings(log(), constant(log()), task=task)


def test_gains_that_are_not_known_need_a_fallback(task: tasks.Task):
    e, v = (np.array(x) for x in (log().error, log().error_rate))
    e[:, 2] = v[:, 2] = 0.0
    source = recorded(log().time, e, v, STIFFNESS * e + DAMPING * v)
    with pytest.raises(InputError, match="stiffness along z"):
        tasks.Demonstrations.from_recordings(source, constant(source), task=task)
    spare = ImpedanceGains.diagonal(np.full(6, 66.0), np.full(6, 66.0))
    found = tasks.Demonstrations.from_recordings(source, constant(source), task=task, fallback=spare)
    np.testing.assert_allclose(task.gains.action_to_parameters(found.actions)[..., 2], 66.0)


def test_what_does_not_fit_together_is_refused(task: tasks.Task):
    source = log()
    with pytest.raises(InputError, match="2 estimates for 1"):
        tasks.Demonstrations.from_recordings(source, [constant(source)] * 2, task=task)
    with pytest.raises(InputError, match="no recording"):
        tasks.Demonstrations.from_recordings([], constant(source), task=task)
    with pytest.raises(InputError, match="pass the recordings that they were fitted to"):
        tasks.Demonstrations.from_recordings(log(start=90.0), fit_smooth(source, 0.5), task=task)


def test_a_policy_is_cloned_from_recordings(task: tasks.Task):
    logs = [log(seed) for seed in range(4)]
    found = tasks.Demonstrations.from_recordings(logs, constant(*logs), task=task)
    again = ExpertData.from_demonstrations(
        found,
        task,
        policy=(policy := GaussianPolicy.for_task(task, hidden=8, log_std=0.0, seed=0)),
        held_out=1,
    )
    torch.set_num_threads(1)
    before = again.action_error(policy)
    settings = recipe("cup-on-plate", action="gain", history=3).cloning
    clone(policy, again, configuration=replace(settings, steps=200), rng=np.random.default_rng(0))
    assert again.action_error(policy) < 0.3 * before


DAMPED: dict[str, Any] = {"damping_low": (0.1,) * 6, "damping_high": (1e3,) * 6}
RANGE: dict[str, Any] = {"stiffness_low": (1.0,) * 6, "stiffness_high": (1e3,) * 6}


@pytest.mark.parametrize("parametrisation", [
    DiagonalStiffness(**RANGE, damping=(5.0, 5.0, 5.0, 0.5, 0.5, 0.5)),
    Diagonal(**RANGE, **DAMPED),
    DampingFactor(**RANGE, factor_low=0.1, factor_high=20.0),
    DampingFactor(**RANGE, factor_low=0.1, factor_high=20.0, rotational_damping=7.0),
    CholeskyStiffness(**RANGE, damping_factor=2.0),
])  # fmt: skip
def test_closest_parameters_of_gains_that_can_be_written_are_theirs(parametrisation):
    rng = np.random.default_rng(0)
    gains = parametrisation.to_gains(rng.uniform(-0.9, 0.9, (5, parametrisation.size)))
    wanted = parametrisation.gains_to_parameters(gains)
    np.testing.assert_allclose(parametrisation.closest_parameters(gains), wanted, rtol=1e-9)


def test_the_closest_factor_is_the_best():
    factor = DampingFactor(**RANGE, factor_low=0.1, factor_high=20.0)
    rng = np.random.default_rng(1)
    k, b = rng.uniform(10, 500, 6), rng.uniform(10, 200, 6)
    best = factor.closest_parameters(ImpedanceGains.diagonal(k, b))[-1]
    tried = np.linspace(0.1, 20.0, 400)
    left = ((b - tried[:, None] * np.sqrt(k)) ** 2).sum(axis=1)
    assert abs(tried[left.argmin()] - best) < 0.06
