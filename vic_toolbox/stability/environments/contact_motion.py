"""The bounce that grows: a motion in contact that disproves stability."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from vic_toolbox.stability.environments.contact_edges import held_step
from vic_toolbox.stability.environments.contact_loop import ContactLoop, Plant, quasipolynomial
from vic_toolbox.stability.environments.delay_loop import collocated, collocated_step, rightmost_root, stepped
from vic_toolbox.stability.environments.linear_loop import (
    GROWTH,
    growing_mode,
    integrated,
    powers,
    smallest_phase,
    stride,
    until_largest,
)
from vic_toolbox.stability.verdict import CounterExample

AMPLITUDE = 1e-4
"""Norm of the start, in SI units."""
PER_TURN = 40
"""Instants per turn of the growing mode, at least, before they are thinned."""
EXTENSIONS = 8
"""How often a motion from rest is made twice as long until it has grown."""

Motion = Callable[[np.ndarray, int], np.ndarray]
"""From a start in units of the loop and a number of instants, the states (count, n)."""


class _Found(NamedTuple):
    """A start, the time between instants, their number, both routes, and the rate at which the mode grows."""

    start: np.ndarray
    step: float
    count: int
    motion: Motion
    other: Motion
    rate: float


def growing_contact(loop: ContactLoop, environment: float) -> CounterExample | None:
    """A growing motion on K_e (in units of the loop), replayed by another integration; None if that does not grow."""
    scaled = loop.dimensionless()
    plant = scaled.plant(environment)
    found = (_held if scaled.period > 0 else _late if scaled.delay > 0 else _plain)(scaled, plant)
    if found is None:
        return None
    start, step, count, motion, other, rate = found
    units = np.concatenate([loop.units(), np.full(len(start) - len(plant.push), loop.unit)])
    start = start * AMPLITUDE / np.linalg.norm(units * start)
    states = motion(start, count) * units
    for _ in range(EXTENSIONS):
        if np.linalg.norm(states, axis=1).max() >= 10 * np.linalg.norm(states[0]):
            break
        count *= 2
        states = motion(start, count) * units
    part = until_largest(states)
    time, states = np.arange(count, dtype=np.float64)[part] * step / loop.rate, states[part]

    def again(initial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return time, other(np.asarray(initial) / units, len(time)) * units

    stiffness = environment * loop.unit
    speed = states[:, 1] if loop.mass > 0 or loop.joint_stiffness is not None else 0.0
    energy = 0.5 * loop.mass * speed**2 + 0.5 * stiffness * states[:, 0] ** 2
    example = CounterExample(
        f"on K_e = {stiffness:.6g} N/m a mode grows at {rate * loop.rate:.6g}/s; the states are {', '.join(loop.names)}"
        + (", forces on their way" if len(units) > len(plant.push) else ""),
        time,
        states,
        np.broadcast_to(energy, time.shape),
        environment={"stiffness": stiffness, "damping": loop.environment_damping},
        again=again,
    )
    grows = example.growth > 1 and np.linalg.norm(example.replay()[1][-1]) > np.linalg.norm(states[0])
    return example if grows else None


def _plain(loop: ContactLoop, plant: Plant) -> _Found | None:
    mode = growing_mode(plant.closed, discrete=False)
    if mode.eigenvalue.real <= 0:
        return None
    wanted = math.log(GROWTH) / mode.eigenvalue.real
    base = min(wanted, 2 * math.pi / max(abs(mode.eigenvalue.imag), 1e-12)) / PER_TURN
    count, every = stride(wanted / base)
    step = base * every
    first = np.linalg.matrix_power(expm(plant.closed * base), every)
    second = np.linalg.matrix_power(integrated(plant.closed, base), every)
    return _Found(
        mode.start,
        step,
        count,
        lambda start, n: powers(first, start, n),
        lambda start, n: powers(second, start, n),
        mode.eigenvalue.real,
    )


def _held(loop: ContactLoop, plant: Plant) -> _Found | None:
    step = held_step(plant, loop)
    mode = growing_mode(step, discrete=True)
    if abs(mode.eigenvalue) <= 1:
        return None
    rate = math.log(abs(mode.eigenvalue)) / loop.period
    count, every = stride(math.log(GROWTH) / (rate * loop.period))
    first, second = (
        np.linalg.matrix_power(one, every) for one in (step, held_step(plant, loop, integrate=True))
    )
    return _Found(
        mode.start,
        loop.period * every,
        count,
        lambda start, n: powers(first, start, n),
        lambda start, n: powers(second, start, n),
        rate,
    )


def _late(loop: ContactLoop, plant: Plant) -> _Found | None:
    """From a state that rested over the delay."""
    late = -np.outer(plant.push, plant.law)
    root = rightmost_root(quasipolynomial(plant, loop.delay), plant.dynamics, late)
    if root is None or root.real <= 0 or not collocated(plant.dynamics, late, loop.delay, root):
        return None
    closed = root * np.eye(len(late)) - plant.dynamics - np.exp(-root * loop.delay) * late
    start = smallest_phase(np.linalg.svd(closed)[2][-1].conj())
    second, rested, base = stepped(plant.dynamics, late, loop.delay)
    count, every = stride(math.log(GROWTH) / (root.real * base))
    first, resting = collocated_step(plant.dynamics, late, loop.delay, base)
    size = len(late)
    first, second = (np.linalg.matrix_power(one, every) for one in (first, second))
    return _Found(
        start,
        base * every,
        count,
        lambda start, n: powers(first, resting @ start, n)[:, :size],
        lambda start, n: powers(second, rested @ start, n)[:, :size],
        root.real,
    )
