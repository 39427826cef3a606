r"""Energy that a spring gives away on a closed path: zero for a potential, the mark of a non-conservative spring.

Moved slowly round a closed path, a policy's spring takes the energy :math:`\oint w(e)\cdot de`. A stiffness with a
skew part, also an effective one of a policy whose K(e) is diagonal and positive, makes it positive one way round and
negative the other; whoever guides the arm round the second way gains that energy on every loop, and a slow enough
loop loses nothing to the damper.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.stability.policies.policy_loop import PolicyLoop

POINTS = 128
"""Points on a loop; the trapezium rule on a smooth closed path converges faster than any power of them."""


class LoopEnergy(NamedTuple):
    """The loop that gives most energy, among the ellipses in the planes of two axes.

    `energy` [J] is what the spring gives away in one turn, in the better sense; `plane` are the two axes.
    """

    energy: float
    plane: tuple[int, int]


def loop_energy(loop: PolicyLoop, centre: Array, *, radius: Array) -> LoopEnergy:
    """Energy per slow turn on ellipses about an error, in every plane of two axes.

    Parameters
    ----------
    loop : PolicyLoop
        Policy and mass.
    centre : ndarray, shape (d,)
        Middle of the loops.
    radius : ndarray, shape (d,)
        Semi-axis of the ellipses along each axis.
    """
    d = loop.size
    planes = [(i, j) for i in range(d) for j in range(i + 1, d)]
    if not planes:
        return LoopEnergy(0.0, (0, 0))
    angle = np.linspace(0.0, 2 * np.pi, POINTS, endpoint=False)
    path = np.tile(centre, (len(planes), POINTS, 1))
    tangent = np.zeros_like(path)
    for row, (i, j) in enumerate(planes):
        path[row, :, i] += radius[i] * np.cos(angle)
        path[row, :, j] += radius[j] * np.sin(angle)
        tangent[row, :, i] = -radius[i] * np.sin(angle)
        tangent[row, :, j] = radius[j] * np.cos(angle)
    states = np.concatenate([path, np.zeros_like(path)], axis=-1).reshape(-1, 2 * d)
    pull = loop(states).pull(states).reshape(path.shape)
    work = np.abs((pull * tangent).sum(axis=(1, 2))) * (2 * np.pi / POINTS)
    worst = int(work.argmax())
    return LoopEnergy(float(work[worst]), planes[worst])
