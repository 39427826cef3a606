"""A policy that has learned nothing: random weights, acting with their exploration noise. What dither alone does."""

from __future__ import annotations

import numpy as np

from vic_toolbox.experiments.configuration import default_configuration
from vic_toolbox.experiments.evaluation import Act
from vic_toolbox.experiments.training import untrained_policy
from vic_toolbox.learning.policy_search import random_stream
from vic_toolbox.tasks import Task


def untrained(task: Task, seed: int) -> Act:
    """The policy that AIRL begins with, as it explores: samples instead of its mean, drawn anew at each step."""
    run = default_configuration(task.name, "airl", action=task.action, history=task.history, seed=seed)
    policy, rng = untrained_policy(run, task), random_stream(seed, 8)
    deviation = np.exp(policy.log_std.numpy())

    def act(observations: np.ndarray) -> np.ndarray:
        noise = rng.standard_normal((len(observations), policy.action_size), dtype=np.float32)
        return policy.mean(observations) + deviation * noise

    return act
