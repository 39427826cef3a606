"""Raw logs with known gains, as a sensor between flange and tool would have written them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.recorded import recording_of_a_spring
from vic_toolbox.errors import Array
from vic_toolbox.recordings import Layout, Payload, Recording, compensate_payload, quaternions

MOUNTING = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
TOOL = Payload(0.85, (0.01, -0.02, 0.06), (3.0, -2.0, 4.0, 0.1, 0.2, -0.1))
LAYOUT = Layout(wrench_axes="tool", sensor_rotation=tuple(map(tuple, MOUNTING.tolist())))
KUKA = next(
    (
        place
        for folder in Path(__file__).parents
        if (place := folder / "shared" / "recordings" / "kuka_iiwa").is_dir()
    ),
    Path("shared/recordings/kuka_iiwa"),
)


def loaded(recording: Recording) -> Recording:
    """What the sensor feels besides: the tool's weight and inertia, and its own bias."""
    away = Payload(-TOOL.mass, TOOL.centre, tuple(-x for x in TOOL.bias))
    return compensate_payload(recording, away)


def raw(recording: Recording, path: Path, *, mounting: Array = MOUNTING, turned: bool = False) -> Path:
    """Write a log with the wrench in the sensor's axes, or `turned` into world axes without knowing the mounting."""
    back = quaternions.conjugate(recording.quat_wxyz)
    wrench = quaternions.rotate_halves(back, recording.wrench)
    wrench = np.hstack([wrench[:, :3] @ mounting, wrench[:, 3:] @ mounting])
    if turned:
        wrench = quaternions.rotate_halves(recording.quat_wxyz, wrench)
    np.savez(
        path,
        time=recording.time,
        wrench=wrench,
        position=recording.position,
        quat_wxyz=recording.quat_wxyz,
        reference_position=recording.reference_position,
        reference_quat_wxyz=recording.reference_quat_wxyz,
    )
    return path


def guided(path: Path, *, seconds: float = 4.0, noise: float = 0.2, seed: int = 0) -> Path:
    """A raw log of a spring and damper (:data:`tests.recorded.STIFFNESS`), tool and bias in it."""
    return raw(loaded(recording_of_a_spring(seconds=seconds, noise=noise, seed=seed)), path)


def at_rest(path: Path, *, poses: int = 6) -> Path:
    """The same sensor, untouched, half a second in each of some tilted poses."""
    rng = np.random.default_rng(5)
    count = 60
    turns = np.repeat(quaternions.exp(rng.uniform(-0.9, 0.9, (poses, 3))), count, axis=0)
    places = np.repeat(rng.uniform(-0.2, 0.2, (poses, 3)), count, axis=0)
    still = Recording(
        time=np.arange(poses * count) / 100,
        position=places,
        quat_wxyz=turns,
        reference_position=places,
        reference_quat_wxyz=turns,
        wrench=np.zeros((poses * count, 6)),
        twist=np.zeros((poses * count, 6)),
    )
    away = Payload(-TOOL.mass, TOOL.centre, tuple(-x for x in TOOL.bias))
    return raw(compensate_payload(still, away, inertia=False), path)
