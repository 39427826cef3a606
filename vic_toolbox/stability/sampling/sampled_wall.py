"""The energy of a sampled, held and late virtual wall, as a quadratic form at each frequency."""

from __future__ import annotations

import math

import numpy as np

WHOLE = 1e-9
"""Distance from whole periods, in periods, at which a delay counts as whole."""


def split(lateness: float) -> tuple[int, float]:
    """Whole periods and the rest δ in [0, 1) of a delay in periods."""
    whole = math.floor(lateness + WHOLE)
    rest = lateness - whole
    return whole, rest if rest > WHOLE else 0.0


def wall(stiffness: np.ndarray, damping: np.ndarray, whole: int, z: np.ndarray) -> np.ndarray:
    """``T H(z)`` of the wall, the rest of its delay left out; its stiffness is K T [Ns/m], as in all of this module."""
    return (stiffness + damping * (1 - 1 / z)) * z**-whole


def required_damping(stiffness: float, damping: float, lateness: float, angles: np.ndarray) -> np.ndarray:
    """Damping that a 1-DOF wall needs at angles θ = ωT in (0, π], with a delay in periods.

    The hand is at p when the computer samples, and at q when the force changes, δ later. In each period the wall
    gives the hand ``−Re{h̄ p̄ (z − 1) q}`` and a damper takes at least ``D (|q − p|²/δ + |z p − q|²/(1 − δ))``: D is
    the larger eigenvalue of the two forms. With δ = 0, q = p, it is Colgate and Schenkel's eq. (18).
    """
    whole, rest = split(lateness)
    z = np.exp(1j * angles)
    force = wall(np.asarray(stiffness), np.asarray(damping), whole, z)
    if not rest:
        return np.real((1 - 1 / z) * force) / (2 * (1 - np.cos(angles)))
    given, taken = mixed_terms(force, rest, z)
    determinant = 2 * (1 - np.cos(angles)) / (rest * (1 - rest))
    half = np.real(given * np.conj(taken))
    return (np.sqrt(half**2 + determinant * np.abs(given) ** 2) - half) / determinant


def mixed_terms(force: np.ndarray, rest: float, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of ``p̄ q`` in what the wall gives and in what a unit damper takes."""
    return -0.5 * np.conj(force) * (z - 1), -1 / rest - np.conj(z) / (1 - rest)


def energy_form(
    stiffness: np.ndarray, damping: np.ndarray, friction: np.ndarray, lateness: float, angles: np.ndarray
) -> np.ndarray:
    """Smallest eigenvalue at each θ of what the damper takes less what the wall gives, in the moves of the hand.

    Matrices (d, d). The coordinates are the moves ``a = q − p`` and ``b = z p − q`` (or ``z p − p`` without a rest),
    so that ``(z − 1) p = a + b`` and ``(z − 1) q = z a + b``.
    """
    d = len(stiffness)
    whole, rest = split(lateness)
    z = np.exp(1j * angles)[:, None, None]
    force = np.conj(np.swapaxes(wall(stiffness, damping, whole, z), 1, 2)) / np.conj(z - 1)
    if rest:
        given = np.concatenate([np.concatenate([-force * z, -force], axis=2)] * 2, axis=1)
        taken = np.zeros((2 * d, 2 * d))
        taken[:d, :d], taken[d:, d:] = friction / rest, friction / (1 - rest)
    else:
        given, taken = -force, friction
    return np.linalg.eigvalsh(taken - 0.5 * (given + np.conj(np.swapaxes(given, 1, 2))))[:, 0]


def passive_damping(
    stiffness: np.ndarray, damping: np.ndarray, period: float, delay_steps: int
) -> np.ndarray:
    """Damping [Ns/m] that 1-DOF walls of K [N/m] and B of any common shape need, whole periods late."""
    if delay_steps == 0:
        return 0.5 * stiffness * period + np.abs(damping)
    angles = np.linspace(0.0, math.pi, 400 * (1 + delay_steps))[1:]
    springs = required_damping(period, 0.0, delay_steps, angles)
    dampers = required_damping(0.0, 1.0, delay_steps, angles)
    largest = stiffness * period * (0.5 + delay_steps) - damping  # θ → 0
    for spring, damper in zip(springs, dampers, strict=True):
        np.maximum(largest, spring * stiffness + damper * damping, out=largest)
    return largest
