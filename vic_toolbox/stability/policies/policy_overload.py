"""A load that is more than a policy holds: the motion that it carries off."""

from __future__ import annotations

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.stability.policies.growing_trajectory import fastest, grown_example
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.verdict import CounterExample

RADIANS = 60.0
"""How long it is followed, in radians of the spring at the goal."""


def carried_off(loop: PolicyLoop, box: Array | None) -> CounterExample | None:
    """The motion under the load from rest, where the spring at the goal would hold it; None if it does not grow.

    With a region it starts within it.
    """
    d = loop.size
    goal = np.zeros((1, 2 * d))
    origin, frequency = loop(goal), fastest(loop, goal)
    spring = origin.stiffness[0]
    if np.linalg.eigvalsh(spring)[0] <= 0:
        spring = frequency**2 * loop.mass
    start = np.linalg.solve(spring, loop.load - origin.force[0])
    if box is not None:
        start = start * min(1.0, float((box[:d] / np.maximum(np.abs(start), 1e-300)).min()))
    return grown_example(
        loop,
        np.concatenate([start, np.zeros(d)]),
        equilibrium=np.zeros(d),
        stiffness=spring,
        duration=RADIANS / frequency,
        description="the load is more than the spring holds, and carries the arm off",
    )
