"""On which environment stiffnesses a contact is stable: the edges are roots on the axis, found exactly."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from scipy.linalg import expm
from scipy.optimize import root_scalar

from vic_toolbox.stability.environments.axis_crossings import Edge, axis_crossings
from vic_toolbox.stability.environments.contact_loop import (
    ContactLoop,
    Plant,
    Quasipolynomial,
    quasipolynomial,
)
from vic_toolbox.stability.environments.delay_loop import unstable_roots
from vic_toolbox.stability.environments.linear_loop import integrated
from vic_toolbox.stability.sampling.sampled_wall import split

TURNS = 60.0
"""Highest ω τ at which edges of a late loop are looked for."""
SCAN = 600
"""Environment stiffnesses at which a held loop is tried before its edges are refined."""
DECADES = 6
"""That these reach to each side."""
PATIENCE = 6
"""Unstable intervals in a row after which no further stable one is looked for, behind a first one."""
BEYOND = (2.0, 30.0, 1e3, 1e5)
"""Of the last edge: stiffnesses that must be stable for the last interval to count as unbounded."""
SOFTEST, STIFFEST = 1e-9, 1e9
"""Environment stiffnesses, without units, that count as none and as a wall: edges beyond are rounding."""


def stable_ranges(loop: ContactLoop) -> tuple[list[tuple[float, float]], list[Edge]]:
    """Intervals of K_e > 0 on which the dimensionless loop is stable, and all edges found."""
    edges = _held_edges(loop) if loop.period > 0 else _continuous_edges(loop)
    bounds = [0.0, *(edge.gain for edge in edges), math.inf]
    ranges: list[tuple[float, float]] = []
    waited = 0
    for low, high in pairwise(bounds):
        if ranges and waited >= PATIENCE:
            break
        if high <= low * (1 + 1e-9):
            continue
        tried = [math.sqrt(low * high) if low else min(0.5 * high, 1.0)]
        if high == math.inf:  # edges of late and held loops lie beyond the search too: stiffer ones are tried
            sought = BEYOND if loop.delay > 0 or loop.period > 0 else BEYOND[:1]
            tried = [(low or 1.0) * more for more in sought]
        if not all(is_stable(loop, stiffness) for stiffness in tried):
            waited += 1
        elif ranges and ranges[-1][1] >= low * (1 - 1e-9):
            ranges[-1] = (ranges[-1][0], high)
        else:
            ranges.append((low, high))
            waited = 0
    return ranges, edges


def is_stable(loop: ContactLoop, environment: float) -> bool:
    """Whether all roots decay on that environment."""
    plant = loop.plant(environment)
    if loop.period > 0:
        return bool(np.abs(np.linalg.eigvals(held_step(plant, loop))).max() < 1)
    if loop.delay > 0:
        return unstable_roots(quasipolynomial(plant, loop.delay)) == 0
    return bool(np.linalg.eigvals(plant.closed).real.max() < 0)


def _continuous_edges(loop: ContactLoop) -> list[Edge]:
    """``K_e = −f₀(jω)/f₁(jω)`` where it is real: the characteristic function is f₀ + K_e f₁."""
    soft, hard = (quasipolynomial(loop.plant(k), loop.delay) for k in (0.0, 1.0))
    slope = Quasipolynomial(hard.own - soft.own, hard.late - soft.late, loop.delay)

    if loop.delay == 0:
        found = axis_crossings(soft.own + soft.late, slope.own + slope.late)
    else:
        found = _late_crossings(soft, slope)
    # a mode that nothing damps in free motion is an edge at K_e = 0, up to rounding
    return sorted(edge for edge in found if SOFTEST < edge.gain < STIFFEST)


def _late_crossings(soft: Quasipolynomial, slope: Quasipolynomial) -> list[Edge]:
    """``Im f₀(jω) f₁(−jω) = 0`` with the delay, up to ω τ = 60: sign changes on a fine grid, refined."""
    delay = soft.delay

    def mixed(w: np.ndarray | float) -> np.ndarray:
        s = 1j * np.asarray(w)
        return np.imag(soft(s) * np.conj(slope(s))) / (1 + np.abs(s)) ** (2 * len(soft.own) - 2)

    grid = np.unique(np.concatenate([np.geomspace(1e-5, 1e4, 2000), np.linspace(0, TURNS, 3000)[1:] / delay]))
    grid = grid[grid <= TURNS / delay]
    value = mixed(grid)
    changed = np.flatnonzero(value[1:] * value[:-1] < 0)
    refined = [
        root_scalar(mixed, bracket=(grid[i], grid[i + 1]), xtol=1e-15, rtol=1e-14).root for i in changed
    ]
    edges = []
    for frequency in [0.0, *refined]:
        below = complex(slope(np.array(1j * frequency)))
        if below:
            edges.append(Edge(float((-soft(np.array(1j * frequency)) / below).real), frequency))
    return edges


def _held_edges(loop: ContactLoop) -> list[Edge]:
    """Sign changes of ``ln ρ`` on a grid of K_e, refined."""

    def logarithm(exponent: float) -> float:
        eigenvalues = np.linalg.eigvals(held_step(loop.plant(10.0**exponent), loop))
        return math.log(max(np.abs(eigenvalues).max(), 1e-300))

    grid = np.linspace(-DECADES, DECADES, SCAN)
    value = np.array([logarithm(g) for g in grid])
    edges = []
    for i in np.flatnonzero(value[1:] * value[:-1] < 0):
        exponent = root_scalar(logarithm, bracket=(grid[i], grid[i + 1]), xtol=1e-14, rtol=1e-14).root
        eigenvalues = np.linalg.eigvals(held_step(loop.plant(10.0**exponent), loop))
        largest = eigenvalues[np.argmax(np.abs(eigenvalues))]
        edges.append(Edge(10.0**exponent, abs(float(np.angle(largest))) / loop.period))
    return edges


def held_step(plant: Plant, loop: ContactLoop, *, integrate: bool = False, closed: bool = True) -> np.ndarray:
    """Map of ``[x; forces on their way, oldest first]`` over one period, by ``expm`` or Runge-Kutta.

    The force computed at a sample acts from `delay` later on, so within one period the one before it may act first.
    Not `closed`, its last column is the effect of a force sequence in place of ``−c x``.
    """
    size, period = len(plant.push), loop.period
    whole, rest = split(loop.delay / period)
    augmented = np.zeros((size + 1, size + 1))
    augmented[:size, :size], augmented[:size, size] = plant.dynamics, plant.push

    def over(duration: float) -> np.ndarray:
        return integrated(augmented, duration) if integrate else expm(augmented * duration)

    fresh = over((1 - rest) * period)
    queue = whole + (rest > 0)
    step = np.zeros((size + queue, size + queue + 1))  # the last column: the force computed now
    now = size + queue
    step[:size, :size] = over(period)[:size, :size]
    acting = size + (rest > 0) if queue > (rest > 0) else now
    step[:size, acting] += fresh[:size, size]
    if rest > 0:
        step[:size, size] += fresh[:size, :size] @ over(rest * period)[:size, size]
    for i in range(queue):
        step[size + i, size + i + 1] = 1.0
    return (
        step if not closed else step[:, :now] + np.outer(step[:, now], np.append(-plant.law, np.zeros(queue)))
    )
