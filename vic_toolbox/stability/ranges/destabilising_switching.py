"""A switching sequence between linear systems whose motion grows: searched greedily, then made periodic."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from vic_toolbox.stability.environments.linear_loop import EDGE, GROWTH

STEPS, STARTS = 1500, 8
"""Of a greedy motion, and how many motions."""
TURN = 0.06
"""Angle that the fastest mode turns in one step [rad]."""
PAIRS, LONGEST = 60, 600
"""Candidate periods tried for each motion, and their longest length."""
SURE = 1e-6
"""By how much a period must grow."""


class Word(NamedTuple):
    """Which system acts in each step of one period, the step (its time), the start and its growth over the period."""

    sequence: np.ndarray
    step: float
    start: np.ndarray
    growth: float


def destabilising_word(systems: np.ndarray, matrix: np.ndarray) -> Word | None:
    """A periodic sequence of the systems (n, N, N), O(1), with a growing motion; None if none is found.

    At each step the system is taken that raises ``xᵀ P x`` most, P the least bad Lyapunov matrix; where the motion
    comes back to its direction larger than it was, the sequence between is a period, and the spectral radius of its
    product decides.
    """
    eigenvalues = np.linalg.eigvals(systems)
    step = TURN / max(np.abs(eigenvalues).max(), 1e-12)
    unstable = int(np.argmax(eigenvalues.real.max(axis=-1)))
    maps = expm(systems * step)
    if eigenvalues[unstable].real.max() > EDGE:
        return _word(np.array([unstable]), maps, step)
    states, choices = _greedy(maps, matrix)
    best: Word | None = None
    for start, end in _returns(states):
        for motion in range(STARTS):
            word = _word(choices[start[motion] : end[motion], motion], maps, step)
            if word is not None and (
                best is None
                or math.log(word.growth) / len(word.sequence) > math.log(best.growth) / len(best.sequence)
            ):
                best = word
    return best


def _greedy(maps: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States (steps + 1, starts, N), each of norm one, with the log of their norm behind; choices (steps, starts)."""
    size = maps.shape[-1]
    state = np.random.default_rng(0).normal(size=(STARTS, size))
    states = np.empty((STEPS + 1, STARTS, size + 1))
    choices = np.empty((STEPS, STARTS), dtype=np.int64)
    logarithm = np.zeros(STARTS)
    for i in range(STEPS + 1):
        norm = np.linalg.norm(state, axis=1)
        state, logarithm = state / norm[:, None], logarithm + np.log(norm)
        states[i, :, :size], states[i, :, size] = state, logarithm
        if i < STEPS:
            ahead = np.einsum("nij,rj->rni", maps, state)
            choices[i] = np.einsum("rni,ij,rnj->rn", ahead, matrix, ahead).argmax(axis=1)
            state = ahead[np.arange(STARTS), choices[i]]
    return states, choices


def _returns(states: np.ndarray):
    """Pairs (start, end) of steps, one for each motion, between which it comes back to its direction."""
    directions = states[:, :, :-1]
    ends = np.linspace(STEPS // 2, STEPS, PAIRS).astype(int)
    for end in ends:
        first = max(0, end - LONGEST)
        alike = np.abs(np.einsum("tri,ri->tr", directions[first : end - 2], directions[end]))
        # the latest of the good returns: short periods
        good = alike >= np.maximum(0.9999 * alike.max(axis=0), alike.max(axis=0) - 1e-4)
        last = good.shape[0] - 1 - np.argmax(good[::-1], axis=0)
        yield first + last, np.full(STARTS, end)


def _word(sequence: np.ndarray, maps: np.ndarray, step: float) -> Word | None:
    if not len(sequence):
        return None
    product = np.eye(maps.shape[-1])
    for which in sequence:
        product = maps[which] @ product
    values, vectors = np.linalg.eig(product)
    index = int(np.argmax(np.abs(values)))
    growth = float(np.abs(values[index]))
    if not np.isfinite(growth) or growth <= 1 + SURE:
        return None
    vector = vectors[:, index]
    vector = vector / vector[np.argmax(np.abs(vector))]
    return Word(sequence, step, vector.real / np.linalg.norm(vector.real), growth)


def repeated(word: Word, most: int = 20_000) -> np.ndarray:
    """The sequence again and again, until the motion has grown by 100 (or `most` steps are reached)."""
    periods = math.ceil(math.log(GROWTH) / math.log(word.growth)) + 1
    return np.tile(word.sequence, max(1, min(periods, most // len(word.sequence))))


def carried(maps: np.ndarray, sequence: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States (steps + 1, N) under the maps that the sequence names."""
    states = np.empty((len(sequence) + 1, len(start)))
    states[0] = start
    for i, which in enumerate(sequence):
        states[i + 1] = maps[which] @ states[i]
    return states
