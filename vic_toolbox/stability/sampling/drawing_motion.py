"""The hand motion that draws energy from a virtual wall: what shows that it is not passive."""

from __future__ import annotations

import math

import numpy as np

from vic_toolbox.stability.sampling.sampled_wall import mixed_terms, required_damping, split, wall
from vic_toolbox.stability.verdict import CounterExample

SLOWEST = 1e-3
"""Smallest angle of the motion per period [rad]."""
CYCLES = 10
AMPLITUDE = 1e-3
"""Of the motion [m or rad]; the wall is linear."""
PIECES = 20
"""Instants between two corners of the motion at which the replay computes the power."""
NOTHING = 1e-9
"""Share of the damping by which it must fall short."""


def drawing_motion(
    stiffness: np.ndarray, damping: np.ndarray, friction: np.ndarray, lateness: float, period: float
) -> CounterExample | None:
    """A motion along the direction that lacks most damping, for matrices K T, B, D (d, d) [Ns/m]; or None.

    Along a fixed direction n the wall is the 1-DOF one with ``nᵀK n``, ``nᵀB n`` and ``nᵀD n``.
    """
    extreme = [stiffness * (0.5 + lateness) + sign * damping - friction for sign in (1, -1)]
    directions = np.concatenate([np.linalg.eigh(m)[1].T for m in (*extreme, stiffness, damping, friction)])
    angles = np.linspace(SLOWEST, math.pi, 1000 * (1 + math.ceil(lateness)))
    best = (0.0, directions[0], 0.0)
    for direction in directions:
        k, b, d = _along(direction, stiffness, damping, friction)
        lacking = required_damping(k, b, lateness, angles) - d
        top = float(lacking.max())
        if top > max(best[0], NOTHING * (abs(d) + abs(top))):
            # the fastest motion that lacks half as much: short cycles
            best = top, direction, float(angles[np.flatnonzero(lacking >= 0.5 * top)[-1]])
    lack, direction, angle = best
    if lack <= 0:
        return None
    k, b, d = _along(direction, stiffness, damping, friction)
    found = _motion(k, b, d, lateness, angle, direction, period)
    assert found.again is not None
    return found if found.energy[-1] > 0 and found.replay()[1][-1, -1] > 0 else None


def _along(direction: np.ndarray, *gains: np.ndarray) -> list[float]:
    return [float(direction @ gain @ direction) for gain in gains]


def _motion(
    k: float, b: float, d: float, lateness: float, angle: float, direction: np.ndarray, period: float
) -> CounterExample:
    whole, rest = split(lateness)
    z = np.exp(1j * angle)
    force = wall(np.asarray(k), np.asarray(b), whole, z)
    q = complex(1.0)
    if rest:  # the worst q is the eigenvector of the two forms: their first row is zero
        needed = float(required_damping(k, b, lateness, np.array([angle]))[0])
        given, taken = mixed_terms(force, rest, z)
        q = complex(needed * (1 / rest + 1 / (1 - rest)) / (given - needed * taken))
    first = -(whole + 3)  # the computer has seen the motion before time zero
    steps = np.arange(float(first), min(math.ceil(CYCLES * 2 * math.pi / angle), 20_000) + 1)
    corners = [(0.0, 1.0 + 0j)] + [(rest, q)] * bool(rest)
    time = np.stack([steps + shift for shift, _ in corners], axis=1).ravel() * period
    place = np.stack([AMPLITUDE * (phasor * z**steps).real for _, phasor in corners], axis=1).ravel()
    speed = np.diff(place) / np.diff(time)
    # the force phasor from q on; between p and q the one of a period before still acts
    acting = np.stack(
        [-AMPLITUDE / period * (force * z ** (steps - late)).real for late in ([1, 0] if rest else [0])], 1
    )
    power = acting.ravel()[:-1] * speed - d * speed**2
    counted = slice(int(np.searchsorted(time, 0.0)), len(time))
    energy = np.concatenate([[0.0], np.cumsum((power * np.diff(time))[counted.start :])])
    state = _columns(place[counted], np.append(speed, speed[-1])[counted], energy, direction)

    def again(initial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same motion, larger or smaller, against the law as it is written, at small steps of time."""
        scale = float(np.linalg.norm(initial[: len(direction)]) / np.linalg.norm(state[0, : len(direction)]))
        middle = (np.arange(PIECES) + 0.5) / PIECES
        fine = time[:-1, None] + np.diff(time)[:, None] * middle
        sampled = np.floor(fine / period - lateness + 1e-9) * period

        def at(instant: np.ndarray) -> np.ndarray:
            return np.interp(instant, time, place)

        pushed = -k / period * at(sampled) - b * (at(sampled) - at(sampled - period)) / period
        drawn = (pushed * speed[:, None] - d * speed[:, None] ** 2).mean(axis=1) * np.diff(time)
        total = np.concatenate([[0.0], np.cumsum(drawn[counted.start :])])
        moved = scale * state
        moved[:, -1] = scale**2 * total
        return time[counted], moved

    return CounterExample(
        f"a hand that moves {AMPLITUDE * 1e3:g} mm to and fro at {angle / period:.6g} rad/s draws energy "
        "(the state is position, velocity, energy drawn)",
        time[counted],
        state,
        energy,
        gains={"physical_damping": np.full(len(energy), d)},
        environment={"frequency": angle / period, "direction": direction},
        again=again,
    )


def _columns(place: np.ndarray, speed: np.ndarray, energy: np.ndarray, direction: np.ndarray) -> np.ndarray:
    return np.column_stack([np.outer(place, direction), np.outer(speed, direction), energy])
