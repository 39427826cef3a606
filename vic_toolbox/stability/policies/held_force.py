"""What a policy can hold: the equilibrium under a constant load, and the largest force along each axis."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar

from vic_toolbox.errors import Array
from vic_toolbox.stability.policies.policy_jacobian import policy_jacobian
from vic_toolbox.stability.policies.policy_loop import PolicyLoop

POINTS = 257
"""Errors along each axis at which the force is looked at before the largest is refined."""
ITERATIONS = 60
BALANCED = 1e-9
"""Force that is left at an equilibrium, relative to the load."""


class HeldForce(NamedTuple):
    """Largest force that the spring holds along each axis, the weaker of both senses.

    `force` (d,) [N, Nm] and the `error` (d,) at which it holds it; `at_edge` (d,) tells where this is the end of the
    range, beyond which the spring may hold more.
    """

    force: Array
    error: Array
    at_edge: np.ndarray


def largest_force(loop: PolicyLoop, *, reach: Array) -> HeldForce:
    """Largest force ``w_i(e u_i)`` along each axis i, for errors up to ± reach, at rest.

    A load beyond it has no equilibrium on that axis: the arm is carried off.
    """
    d = loop.size
    force, error, at_edge = np.empty(d), np.empty(d), np.empty(d, bool)

    def along(axis: int, sign: float, size: Array) -> Array:
        states = np.zeros((len(size), 2 * d))
        states[:, axis] = sign * size
        return sign * loop(states).pull(states)[:, axis]

    for axis in range(d):
        sizes = np.linspace(0.0, reach[axis], POINTS)
        found = []
        for sign in (1.0, -1.0):
            values = along(axis, sign, sizes)
            best = int(values.argmax())
            left, right = sizes[max(best - 1, 0)], sizes[min(best + 1, POINTS - 1)]
            fine: Any = minimize_scalar(
                lambda x, sign=sign, axis=axis: -along(axis, sign, np.array([x]))[0],
                bounds=(left, right),
                method="bounded",
                options={"xatol": 1e-7 * reach[axis]},
            )
            # a search that runs into the end of the range knows no more than the end itself
            inside = 0 < best < POINTS - 1 and -fine.fun >= values[best]
            found.append((-fine.fun, sign * fine.x) if inside else (values[best], sign * sizes[best]))
        weaker = min(found, key=lambda pair: pair[0])
        force[axis], error[axis] = weaker
        at_edge[axis] = abs(weaker[1]) >= reach[axis] * (1 - 1e-9)
    return HeldForce(force, error, at_edge)


def equilibrium(loop: PolicyLoop, *, reach: Array | None = None) -> Array | None:
    """Error (d,) at which the spring balances the load, at rest; None if none is found.

    Newton's method with step halving from ``K(0)⁻¹ load``, and from a few errors within ± reach.
    """
    d = loop.size
    if not loop.load.any():
        origin = np.zeros((1, 2 * d))
        if not loop(origin).force.any():
            return np.zeros(d)
    origin = loop(np.zeros((1, 2 * d)))
    starts = [np.zeros(d)]
    if np.linalg.eigvalsh(origin.stiffness[0])[0] > 0:
        starts.insert(0, np.linalg.solve(origin.stiffness[0], loop.load - origin.force[0]))
    size = np.abs(starts[0]) if reach is None else reach
    if reach is not None:
        starts += [f * reach * np.sign(loop.load) for f in (0.1, 0.3, 0.6, 0.9)]
    scale = np.tile(np.where(size > 0, size, size.max() or 1.0), 2)
    weight = max(np.abs(loop.load).max(), np.abs(origin.force).max())
    for start in starts:
        found = _newton(loop, start, scale, weight)
        if found is not None and (reach is None or (np.abs(found) <= reach).all()):
            return found
    return None


def _newton(loop: PolicyLoop, error: Array, scale: Array, weight: float) -> Array | None:
    def rest(e: Array) -> tuple[Array, Array]:
        states = np.concatenate([e, np.zeros_like(e)])[None]
        return states, loop.load - loop(states).pull(states)[0]

    states, left = rest(error)
    for _ in range(ITERATIONS):
        if np.abs(left).max() <= BALANCED * weight:
            return error
        stiffness = policy_jacobian(loop, states, scale=scale).effective_stiffness[0]
        try:
            step = np.linalg.solve(stiffness, left)
        except np.linalg.LinAlgError:
            return None
        share = 1.0
        while share > 1e-4:
            there, then = rest(error + share * step)
            if np.linalg.norm(then) < np.linalg.norm(left):
                break
            share /= 2
        else:
            return None
        error, states, left = error + share * step, there, then
    return None
