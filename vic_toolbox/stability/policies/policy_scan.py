"""What samples of a region, and of a rollout, show about a policy without integrating anything."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, positive_array
from vic_toolbox.stability.policies.held_force import largest_force
from vic_toolbox.stability.policies.loop_energy import loop_energy
from vic_toolbox.stability.policies.policy_jacobian import policy_jacobian
from vic_toolbox.stability.policies.policy_local import one_or_many
from vic_toolbox.stability.policies.policy_loop import PolicyLoop

SAMPLES = 256
FOLLOWED = 16
"""States of a rollout that the search starts from."""
NARROWEST = 1e-3
"""Width of an axis along which a rollout did not move, relative to the widest in comparable coordinates."""

FARTHEST = 10.0 ** np.arange(-6, 4)
"""Distances [m, rad, m/s, rad/s] at which a policy is asked for gains before anything is proved of it."""


@dataclass(frozen=True, eq=False)
class PolicyScan:
    """What samples of the region, and of the rollout, show without integrating anything."""

    values: dict[str, Any]
    warning: str

    @classmethod
    def of(
        cls, loop: PolicyLoop, box: Array, visited: Array | None, generator: np.random.Generator
    ) -> PolicyScan:
        """Ask the policy for samples of a box ± `box` about zero, and along the states that it visited."""
        d = loop.size
        states = box * generator.uniform(-1.0, 1.0, (SAMPLES, 2 * d))
        states[: SAMPLES // 4, d:] = 0.0
        if visited is not None:
            states = np.concatenate([states, visited])
        found = policy_jacobian(loop, states, scale=box)
        bad = ~loop(states).admissible
        held = largest_force(loop, reach=box[:d])
        turn = loop_energy(loop, np.zeros(d), radius=0.5 * box[:d])
        values: dict[str, Any] = {
            "effective_stiffness": float(found.softest.min()),
            "effective_damping": float(found.least_damping.min()),
            "curl": float(found.curl.max()),
            "largest_force": one_or_many(held.force),
            "largest_force_error": one_or_many(held.error),
            "largest_force_at_edge": bool(held.at_edge[0]) if d == 1 else held.at_edge,
            "loop_energy": turn.energy,
            "loop_plane": np.array(turn.plane),
            "inadmissible_share": float(bad.mean()),
        }
        if visited is not None:
            e = visited[:, :d]
            power = 0.5 * np.einsum("ni,nij,nj->n", e, found.stiffness_rate[-len(visited) :], e)
            values["rollout_stiffness_power"] = float(power.max())
        warning = ""
        if bad.any():
            where = np.array2string(states[int(bad.argmax())], precision=4)
            warning = f"The policy's gains are negative at {bad.mean():.1%} of the samples, e.g. at [e, ė] = {where}."
        return cls(values, warning)


def refused_gains(loop: PolicyLoop) -> str:
    """Where, near or far, the policy answers with gains that no impedance law takes; empty if nowhere."""
    directions = np.random.default_rng(0).uniform(-1.0, 1.0, (32, 2 * loop.size))
    states = (FARTHEST[:, None, None] * directions).reshape(-1, 2 * loop.size)
    remedy = "Bound its output, or give the region in which it works."
    try:
        good = loop(states).admissible
    except InputError as error:
        return f"{error} {remedy}"
    if good.all():
        return ""
    where = np.array2string(states[int((~good).argmax())], precision=4)
    return f"the policy's gains are negative at [e, ė] = {where}. {remedy}"


def visited_states(rollout: ArrayLike | None, loop: PolicyLoop) -> Array | None:
    """The newest [e, ė] of each observation (n, 2 d), checked."""
    if rollout is None:
        return None
    width = 2 * loop.size
    found = finite_array("rollout", rollout, shape=(None, width * loop.history))
    if not len(found):
        raise InputError("rollout is empty; pass at least one observation.")
    return found[:, -width:]


def region_box(region: ArrayLike | None, visited: Array | None, loop: PolicyLoop) -> Array | None:
    """Half widths (2 d,) of the region: as given, or those of a rollout; None without either."""
    if region is not None:
        return positive_array("region", region, shape=(2 * loop.size,))
    if visited is None:
        return None
    extent = np.abs(visited).max(axis=0)
    # an axis that did not move still needs some width: as much as the others, in comparable coordinates
    weight = np.sqrt(np.tile(np.diagonal(loop.mass), 2))
    for half in (slice(0, loop.size), slice(loop.size, None)):
        largest = (weight[half] * extent[half]).max()
        if largest == 0:
            raise InputError("the rollout does not move (all errors, or all rates, are zero); pass a region.")
        extent[half] = np.maximum(extent[half], NARROWEST * largest / weight[half])
    return extent


def region_starts(box: Array, count: int, visited: Array | None, generator: np.random.Generator) -> Array:
    """Corners and inside of the box, one half at rest, and states of the rollout."""
    starts = box * generator.uniform(-1.0, 1.0, (count, len(box)))
    starts[: count // 4] = box * np.sign(starts[: count // 4])
    starts[count // 4 : count // 2, len(box) // 2 :] = 0.0
    if visited is None:
        return starts
    chosen = np.linspace(0, len(visited) - 1, min(len(visited), FOLLOWED)).astype(int)
    return np.concatenate([starts, visited[chosen]])
