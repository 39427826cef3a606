"""Recordings with known answers, for several test files."""

from __future__ import annotations

import numpy as np

from vic_toolbox.recordings import Recording, quaternions

RATE = 1000
STIFFNESS = np.array([600.0, 500.0, 400.0, 20.0, 15.0, 10.0])
DAMPING = np.array([59.4, 50.0, 40.0, 2.0, 1.5, 1.0])
NOISE = np.array([1.0, 1.0, 1.0, 0.05, 0.05, 0.05])


def rich_motion(
    time: np.ndarray, *, seed: int = 0, rms: float = 0.015
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motion of six axes of 0.3 to 3 Hz, its first and its second derivative (n, 6)."""
    rng = np.random.default_rng(seed)
    omega = 2 * np.pi * rng.uniform(0.3, 3.0, (6, 8))
    phase = rng.uniform(0, 2 * np.pi, (6, 8))
    size = rms * np.sqrt(2 / 8)
    angle = time[:, None, None] * omega + phase
    return (
        size * np.sin(angle).sum(axis=-1),
        size * (omega * np.cos(angle)).sum(axis=-1),
        -size * (omega**2 * np.sin(angle)).sum(axis=-1),
    )


def recording_of_a_spring(
    *, seconds: float = 2.0, noise: float = 0.0, late: float = 0.0, inertia: float = 0.0, seed: int = 0
) -> Recording:
    """A moving end-effector on a spring and damper; the reference moves and turns too.

    Positions are near (0.5, 0, 0.4) m; the tool points down. The wrench is late by `late` [s] and has `noise`
    [N] (a twentieth of it in Nm).
    """
    time = np.arange(round(seconds * RATE)) / RATE
    error, rate, _ = rich_motion(time, seed=seed)
    then, then_rate, then_acceleration = rich_motion(time - late, seed=seed)
    rng = np.random.default_rng(seed + 1)
    wrench = STIFFNESS * then + DAMPING * then_rate + inertia * then_acceleration
    wrench = wrench + noise * NOISE * rng.normal(size=error.shape)
    speed = np.array([0.01, 0.02, 0.0])
    reference = np.array([0.5, 0.0, 0.4]) + time[:, None] * speed
    down = quaternions.exp(np.tile([np.pi - 0.2, 0.1, 0.0], (len(time), 1)))
    return Recording(
        time=time,
        position=reference + error[:, :3],
        quat_wxyz=quaternions.multiply(quaternions.exp(error[:, 3:]), down),
        reference_position=reference,
        reference_quat_wxyz=down,
        wrench=wrench,
        twist=rate + np.concatenate([speed, np.zeros(3)]),
        reference_twist=np.tile(np.concatenate([speed, np.zeros(3)]), (len(time), 1)),
    )


def fitted(recording: Recording, axis: int = 0, *, constant: bool = True) -> np.ndarray:
    """Least-squares (K, B, constant) of one axis."""
    columns = [recording.error[:, axis], recording.error_rate[:, axis]] + [np.ones(len(recording))] * constant
    return np.linalg.lstsq(np.column_stack(columns), recording.wrench[:, axis], rcond=None)[0]
