"""Policies as people write them: for many states or for one, of e and ė or of both, and never misread."""

from __future__ import annotations

import math

import numpy as np
import pytest

from vic_toolbox.errors import InputError
from vic_toolbox.stability.policies.policy import policy_stability
from vic_toolbox.stability.policies.policy_loop import PolicyLoop

STATES = np.random.default_rng(0).normal(scale=0.01, size=(7, 2))
PLANE = np.random.default_rng(1).normal(scale=0.3, size=(7, 4))


@pytest.mark.parametrize(
    "policy",
    [
        lambda e: 1000 * np.exp(-(e**2) / 2e-4),
        lambda e, v: 1000 * np.exp(-(e**2) / 2e-4),
        lambda e, v: 1000 * math.exp(-(e**2) / 2e-4),
        lambda x: 1000 * np.exp(-(x[:, 0] ** 2) / 2e-4),
        lambda x: 1000 * math.exp(-(x[0] ** 2) / 2e-4),
        lambda e, v: [1000 * np.exp(-(e**2) / 2e-4)] if np.ndim(e) == 0 else 1 / 0,
    ],
    ids=["e", "e and v", "one e and v", "states", "one state", "a list"],
)
def test_one_axis_is_read_alike(policy):
    """POL1 in six ways: 6.06531 N at most, and the same stiffness everywhere."""
    answer = PolicyLoop(policy, 1.0, damping=20.0)(STATES)
    np.testing.assert_allclose(answer.stiffness[:, 0, 0], 1000 * np.exp(-(STATES[:, 0] ** 2) / 2e-4))
    verdict = policy_stability(policy, 1.0, damping=20.0, region=[0.03, 0.3], samples=2)
    assert verdict.values["largest_force"] == pytest.approx(6.06531, abs=5e-6)


@pytest.mark.parametrize(
    "policy",
    [
        lambda e, v: (500 * np.exp(-(np.linalg.norm(e) ** 2)) * np.eye(2), 20 * np.eye(2)),
        lambda e, v: (500 * np.exp(-(e @ e)), 20.0),
        lambda x: (500 * np.exp(-(x[0] ** 2 + x[1] ** 2)) * np.ones(2), [20.0, 20.0]),
        lambda e, v: (500 * np.exp(-(e**2).sum(axis=-1)), 20.0),
        lambda x: (500 * np.exp(-(x[:, :2] ** 2).sum(axis=1))[:, None, None] * np.eye(2), 20 * np.eye(2)),
    ],
    ids=["norm", "product", "one state", "sums", "matrices"],
)
@pytest.mark.parametrize("count", [1, 2, 7])
def test_several_axes_are_read_alike(policy, count: int):
    """A norm over all that a policy is given is not that of each; and as many states as axes are no matrix."""
    answer = PolicyLoop(policy, np.eye(2))(PLANE[:count])
    wanted = 500 * np.exp(-(PLANE[:count, :2] ** 2).sum(axis=1))
    np.testing.assert_allclose(answer.stiffness, wanted[:, None, None] * np.eye(2))
    np.testing.assert_allclose(answer.damping, np.tile(20 * np.eye(2), (count, 1, 1)))
    assert answer.admissible.all()


@pytest.mark.parametrize("count", [1, 2, 5])
def test_one_matrix_for_all_states_is_a_matrix(count: int):
    stiffness = np.array([[500.0, 100.0], [100.0, 300.0]])
    answer = PolicyLoop(lambda x: (stiffness, 20.0), np.eye(2))(PLANE[:count])
    np.testing.assert_array_equal(answer.stiffness, np.tile(stiffness, (count, 1, 1)))


def test_branches_on_numbers():
    """A policy that lets go beyond 10 mm, written with `if`: no motion from outside is held."""
    verdict = policy_stability(
        lambda e, v: (800.0 if abs(e) < 0.01 else 80.0, 10.0), 1.0, region=[0.02, 0.1], samples=4
    )
    assert verdict.values["largest_force"] == pytest.approx(8.0, rel=1e-2)


def test_a_function_of_e_and_its_rate_has_no_memory():
    with pytest.raises(InputError, match="no memory"):
        policy_stability(lambda e, v: (100.0, 10.0), 1.0, history=2)


def test_answers_that_are_no_gains_are_refused():
    for policy in (lambda e, v: "soft", lambda e, v: ([[1, 2], [3]], 1.0), lambda e, v: 1 / 0, lambda: 1.0):
        with pytest.raises(InputError):
            policy_stability(policy, 1.0)
