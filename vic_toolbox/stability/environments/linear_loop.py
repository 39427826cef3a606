"""A linear loop that does not change: the Lyapunov function that proves it, the motion that grows in it."""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eigh, solve_continuous_lyapunov, solve_discrete_lyapunov

EDGE = 1e-9
"""Relative distance from the edge of stability that rounding hides: nothing is said within it."""
GROWTH = 100.0
"""By how much the motion of a counter-example grows, at least."""
POINTS = 400
"""Instants at which a growing motion is kept, about."""


class LyapunovMatrix(NamedTuple):
    """P ≻ 0 of ``V = xᵀ P x`` and the rate at which V shrinks: (1 − V⁺/V) a step, or −V̇/V."""

    matrix: np.ndarray
    rate: float


class GrowingMode(NamedTuple):
    """The fastest mode from the phase where it is smallest: ``x(t) = Re(w e^{λt})``, or ``Re(w λᵏ)``."""

    eigenvalue: complex
    start: np.ndarray


def integrated(matrix: np.ndarray, duration: float) -> np.ndarray:
    """``exp(A t)`` by Runge-Kutta (DOP853) and repeated squaring: the second route beside ``expm``."""
    size = len(matrix)
    halvings = max(0, math.ceil(math.log2(max(np.abs(matrix).sum(axis=1).max() * duration, 1e-300))))
    solution = solve_ivp(
        lambda _, x: (matrix @ x.reshape(size, size)).ravel(),
        (0.0, duration / 2**halvings),
        np.eye(size).ravel(),
        method="DOP853",
        rtol=3e-14,
        atol=1e-16,
    )
    return np.linalg.matrix_power(solution.y[:, -1].reshape(size, size), 2**halvings)


def discrete_lyapunov(step: np.ndarray, checked: np.ndarray) -> LyapunovMatrix | None:
    """P with ``Φᵀ P Φ − P ≺ 0``, checked on the map `checked` that another route gave; None if it fails there."""
    try:
        matrix = _symmetric(solve_discrete_lyapunov(step.T, np.eye(len(step))))
        return _shrinking(matrix, 1 - eigh(checked.T @ matrix @ checked, matrix, eigvals_only=True)[-1])
    except (np.linalg.LinAlgError, ValueError):  # singular, not finite, or P not positive definite
        return None


def continuous_lyapunov(matrix: np.ndarray) -> LyapunovMatrix | None:
    """P with ``Aᵀ P + P A ≺ 0``, checked by eigenvalues of the pencil; None if it fails there."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # "nearly singular": P is checked
            found = _symmetric(solve_continuous_lyapunov(matrix.T, -np.eye(len(matrix))))
        power = matrix.T @ found + found @ matrix
        return _shrinking(found, -eigh(_symmetric(power), found, eigvals_only=True)[-1])
    except (np.linalg.LinAlgError, ValueError):
        return None


def growing_mode(matrix: np.ndarray, *, discrete: bool) -> GrowingMode:
    """The fastest growing mode of ``x⁺ = Φ x`` (largest ``|λ|``) or ``ẋ = A x`` (largest ``Re λ``)."""
    eigenvalues, vectors = np.linalg.eig(matrix)
    index = int(np.argmax(np.abs(eigenvalues) if discrete else np.real(eigenvalues)))
    return GrowingMode(complex(eigenvalues[index]), smallest_phase(vectors[:, index]))


def smallest_phase(vector: np.ndarray) -> np.ndarray:
    """``Re(w e^{jφ})`` at the phase φ where its norm is smallest: from there no later one is smaller."""
    if np.abs(np.imag(vector)).max() <= 1e-9 * np.abs(vector).max():
        return np.real(vector) / np.linalg.norm(np.real(vector))
    parts = np.column_stack([np.real(vector), -np.imag(vector)])
    cosine_sine = np.linalg.svd(parts)[2][-1]
    start = parts @ cosine_sine
    if np.linalg.norm(start) <= 1e-9 * np.abs(vector).max():  # a real mode times a phase
        start = parts @ np.linalg.svd(parts)[2][0]
    return start / np.linalg.norm(start)


def stride(steps_to_grow: float) -> tuple[int, int]:
    """How many instants to keep, and every how many steps, when a motion needs that many steps to grow."""
    steps = max(math.ceil(steps_to_grow), 1)
    every = max(1, steps // POINTS)
    return math.ceil(steps / every) + 1, every


def powers(step: np.ndarray, start: np.ndarray, count: int) -> np.ndarray:
    """``[x, Φ x, Φ² x, …]`` as (count, n)."""
    states = np.empty((count, len(start)))
    states[0] = start
    for i in range(1, count):
        states[i] = step @ states[i - 1]
    return states


def until_largest(states: np.ndarray) -> slice:
    """From the start to the instant of the largest norm, so that an oscillation ends at its peak."""
    return slice(0, int(np.argmax(np.linalg.norm(states, axis=1))) + 1)


def _shrinking(matrix: np.ndarray, rate: float) -> LyapunovMatrix | None:
    definite = np.isfinite(rate) and np.linalg.eigvalsh(matrix)[0] > 0
    return LyapunovMatrix(matrix, float(rate)) if definite and rate > 0 else None


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return 0.5 * (matrix + matrix.T)
