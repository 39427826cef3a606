"""Search for a motion that grows: many starts at once, then those that grew most, varied; the best one checked twice.

The search steps with the gains held during each step and the implicit midpoint rule, which neither makes nor loses
energy of a spring, one call of the policy a step. What it finds counts only after two other integrators (DOP853, and
LSODA when it is replayed) agree that it grows, over several periods of the slowest mode: a motion that falls into a
stiff spring gains speed, but only once.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.verdict import CounterExample

STEP = 0.15
"""Length of a step, in radians of the fastest spring."""
GROWN = 4.0
"""A motion grows if its energy in the last third is this many times that of the first third, at their largest, and
its kinetic energy is not less there. (An arm that was thrown to where its spring is soft and creeps back has much
energy ``½ δeᵀ K δe`` by the stiffness at the equilibrium, but does not move.)"""
KEPT = 0.98
"""Share of its energy that a motion from anywhere must keep from each of its last three sixths to the next."""
ESCAPED = 1e6
"""It is not followed further when its energy is this many times the one it started with."""
LASTING = 3.0
"""How long a motion must last to count, in periods of the slowest mode (or three of its time constants)."""
APART = 8.0
"""Ratio of fastest and slowest time scale from which the search also looks at the slow one."""
EVALUATIONS = (30_000, 10_000)
"""Calls of the policy for one integration, at most: along a growing mode, and from anywhere."""
TINY = 1e-300
SAMPLES = 601
ROUNDS = 3
BEST = 8


class _TooLong(Exception):
    """An integration takes more evaluations than are worth it."""


class Search(NamedTuple):
    """What a search found.

    The worst motion grew by `growth` (see :data:`GROWN`); `starts` (m, 2 d) are the worst few, in this order. Of the
    first round the share `settled` lost all but a hundredth of its energy, and the share `refused` ran into gains that
    no impedance law takes. `count` motions were followed for at least `duration` [s].
    """

    growth: float
    starts: Array
    settled: float
    refused: float
    count: int
    duration: float


def energy_about(loop: PolicyLoop, equilibrium: Array, stiffness: Array, states: Array) -> Array:
    """``½ ėᵀ M ė + ½ δeᵀ K δe`` about an equilibrium with the stiffness there, (n,) [J]."""
    offset = states[:, : loop.size] - equilibrium
    rate = states[:, loop.size :]
    kinetic = np.einsum("ni,ij,nj->n", rate, loop.mass, rate)
    return 0.5 * (kinetic + np.einsum("ni,ij,nj->n", offset, stiffness, offset))


def search_growth(
    loop: PolicyLoop,
    starts: Array,
    *,
    equilibrium: Array,
    stiffness: Array,
    region: Array,
    slowest: float,
    generator: np.random.Generator,
    steps: int = 400,
) -> Search:
    """Follow motions from starts (n, 2 d) in a region, and look for those that grow most.

    Parameters
    ----------
    loop : PolicyLoop
        Policy, mass and load.
    starts : ndarray, shape (n, 2 d)
        First round; the rounds after it vary the best of them within ± `region`.
    equilibrium : ndarray, shape (d,)
        Error at rest.
    stiffness : ndarray, shape (d, d)
        Positive definite stiffness of the energy.
    region : ndarray, shape (2 d,)
        Half widths of the box of starts about zero.
    slowest : float
        Period of the slowest mode [s].
    generator : Generator
        Of the variations.
    steps : int
        Number of steps.
    """
    step = STEP / fastest(loop, starts)
    course = _Course(loop, equilibrium, stiffness)
    growth, refused = _growth(course, starts, step, steps)
    settled, share = float((growth < 1e-2).mean()), float(refused.mean())
    for level in range(ROUNDS - 1):
        best = np.argsort(growth)[-BEST:]
        spread = region * 0.2 / 4**level
        trial = starts[best].repeat(BEST, axis=0)
        trial = np.clip(trial + spread * generator.standard_normal(trial.shape), -region, region)
        starts, growth = (
            np.concatenate([starts, trial]),
            np.append(growth, _growth(course, trial, step, steps)[0]),
        )
    count = len(starts)
    if LASTING * slowest > APART * step * steps:
        # the fast modes are coarse here, but what grows slowly is seen
        late, _ = _growth(course, starts[: count // 2], LASTING * slowest / steps, steps)
        starts, growth = np.concatenate([starts, starts[: count // 2]]), np.append(growth, late)
    worst = np.argsort(-growth)[:3]
    return Search(float(growth[worst[0]]), starts[worst], settled, share, count, step * steps)


def fastest(loop: PolicyLoop, states: Array) -> float:
    """Largest undamped frequency ``√λmax(M⁻¹K)`` at states [rad/s]; of the damper where there is no spring."""
    answer = loop(states)
    root = np.linalg.inv(np.linalg.cholesky(loop.mass))
    squared = np.linalg.norm(root @ answer.stiffness @ root.T, ord=2, axis=(1, 2)).max()
    rates = np.linalg.norm(root @ answer.damping @ root.T, ord=2, axis=(1, 2)).max()
    force = np.linalg.norm(answer.force, axis=1) / np.linalg.norm(states[:, : loop.size], axis=1).clip(1e-300)
    squared = max(squared, float(force.max()) / np.linalg.eigvalsh(loop.mass)[0])
    return float(np.sqrt(squared)) or float(rates) or 1.0


def grown_example(
    loop: PolicyLoop,
    start: Array,
    *,
    equilibrium: Array,
    stiffness: Array,
    duration: float,
    description: str,
    anywhere: bool = True,
) -> CounterExample | None:
    """The motion from a start as a counter-example, if it grows by two more integrators; else None.

    It ends where the policy's gains are no longer admissible, or where it has escaped. A motion from `anywhere` must
    escape, or last and keep what it gained; one along a mode that grows need only grow until it ends.
    """
    course = _Course(loop, equilibrium, stiffness)
    limit = ESCAPED * course.energy(start[None])[0]

    def over(x: Array) -> bool:
        return bool(course.energy(x[None])[0] > limit)

    calls = EVALUATIONS[anywhere]
    time, state = _followed(loop, start, duration, over, calls)
    if len(time) < 3:
        return None
    escaped = course.energy(state[-1:])[0] > 0.25 * limit
    if anywhere and not escaped and (time[-1] < duration or not course.keeps(state)):
        return None
    # an oscillation is shown up to its last large swing, so that everybody sees it grow
    last = 2 * len(time) // 3
    end = last + int(np.linalg.norm(state[last:], axis=1).argmax()) + 1
    time, state = time[:end], state[:end]
    if course.growth(state) < GROWN:
        return None

    def again(begin: Array) -> tuple[Array, Array]:
        return _again(loop, np.asarray(begin, dtype=np.float64), time, 3 * calls)

    repeated_time, repeated = again(start)
    answer = loop(state)
    if len(repeated_time) < len(time) or course.growth(repeated) < GROWN or not answer.admissible[:-1].all():
        return None
    gains = {} if loop.output == "wrench" else {"stiffness": answer.stiffness, "damping": answer.damping}
    environment = {"load": loop.load} if loop.load.any() else {}
    return CounterExample(description, time, state, course.energy(state), gains, environment, again)


class _Course(NamedTuple):
    """What counts as growth about an equilibrium."""

    loop: PolicyLoop
    equilibrium: Array
    stiffness: Array

    def energy(self, states: Array) -> Array:
        return energy_about(self.loop, self.equilibrium, self.stiffness, states)

    def kinetic(self, states: Array) -> Array:
        rate = states[:, self.loop.size :]
        return 0.5 * np.einsum("ni,ij,nj->n", rate, self.loop.mass, rate)

    def growth(self, states: Array) -> float:
        """By how much a motion grew: see :data:`GROWN`."""
        return grown(self.energy(states), self.kinetic(states))

    def keeps(self, states: Array) -> bool:
        """Whether it does not lose what it gained: see :data:`KEPT`."""
        parts = [part.max() for part in np.array_split(self.energy(states), 6)]
        return all(later >= KEPT * earlier for earlier, later in pairwise(parts[3:]))


def grown(energy: Array, kinetic: Array) -> float:
    """By how much a motion with these energies (n,) grew: see :data:`GROWN`."""
    third = max(len(energy) // 3, 1)
    by_energy = energy[-third:].max() / max(energy[:third].max(), TINY)
    by_speed = kinetic[-third:].max() / max(kinetic[:third].max(), TINY)
    return float(min(by_energy, GROWN * by_speed * (1 + 1e-6)))


def _growth(course: _Course, starts: Array, step: float, steps: int) -> tuple[Array, np.ndarray]:
    """By how much each motion grew (n,), and which were ended by gains that are not admissible (growth 0)."""
    loop, count = course.loop, len(starts)
    d, states, previous = loop.size, starts.copy(), starts
    energy, kinetic = np.empty((steps + 1, count)), np.empty((steps + 1, count))
    lasted = np.full(count, steps)
    alive, refused = np.ones(count, bool), np.zeros(count, bool)
    for k in range(steps + 1):
        e, rate = states[:, :d], states[:, d:]
        energy[k], kinetic[k] = course.energy(states), course.kinetic(states)
        ended = alive & (energy[k] > ESCAPED * np.maximum(energy[0], TINY))
        lasted[ended] = k
        alive &= ~ended
        if k == steps or not alive.any():
            break
        answer = loop(states + 0.5 * (states - previous))
        refused |= alive & ~answer.admissible
        alive &= answer.admissible
        # the average speed v̄ of the step: (M + h/2 B + h²/4 K) v̄ = M ė + h/2 (load − force − K e)
        force = loop.load - answer.force - np.matvec(answer.stiffness, e)
        left = loop.mass + 0.5 * step * answer.damping + 0.25 * step**2 * answer.stiffness
        side = np.matvec(loop.mass, rate) + 0.5 * step * force
        side[~alive], left[~alive] = 0.0, loop.mass  # what has ended stays where it is
        mean = np.linalg.solve(left, side[..., None])[..., 0]
        moved = np.concatenate([e + step * mean, 2 * mean - rate], axis=-1)
        previous, states = states, np.where(alive[:, None], moved, states)
    growth = [grown(energy[: end + 1, i], kinetic[: end + 1, i]) for i, end in enumerate(lasted)]
    return np.where(refused, 0.0, growth), refused


def _followed(
    loop: PolicyLoop, start: Array, duration: float, over: Callable[[Array], bool], calls: int
) -> tuple[Array, Array]:
    """Integrate by DOP853 until the motion is over, or the gains are inadmissible; no samples if it takes too long."""

    def ends(_: float, x: Array) -> float:
        return -1.0 if over(x) or not loop(x[None]).admissible[0] else 1.0

    ends.terminal = True  # type: ignore[attr-defined]
    found = _solve(loop, start, duration, calls, method="DOP853", events=ends, dense_output=True)
    if found is None or found.t[-1] <= 0:
        return np.empty(0), np.empty((0, len(start)))
    time = np.linspace(0.0, found.t[-1], SAMPLES)
    return time, found.sol(time).T


def _again(loop: PolicyLoop, start: Array, time: Array, calls: int) -> tuple[Array, Array]:
    """Integrate by LSODA at given instants; fewer where it fails."""
    found = _solve(loop, start, float(time[-1]), calls, method="LSODA", t_eval=time)
    return (time[:0], np.empty((0, len(start)))) if found is None else (found.t, found.y.T)


def _solve(loop: PolicyLoop, start: Array, duration: float, calls: int, **options: Any) -> Any:
    left = calls

    def field(_: float, x: Array) -> Array:
        nonlocal left
        left -= 1
        if left < 0:
            raise _TooLong
        return loop.derivative(x[None])[0]

    tolerance = 1e-10 * (np.abs(start).max() or 1.0)
    try:
        return solve_ivp(
            field, (0.0, duration), start, rtol=1e-8, atol=tolerance, max_step=duration / 50, **options
        )
    except (InputError, _TooLong):  # it ran to where the policy answers with NaN, or is too stiff
        return None
