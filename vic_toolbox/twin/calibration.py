"""The F/T sensor's calibration log: the untouched tool, held still in poses that differ in tilt.

The arm moves from pose to pose under its own stiff position control, whose errors do not matter here, so the motion
is prescribed and the sensor follows from inverse dynamics: weight, and inertia on the way.
"""

from __future__ import annotations

import mujoco
import numpy as np

from vic_toolbox.errors import Array, integer
from vic_toolbox.spatial import pose_from, rotation_exp
from vic_toolbox.tasks import cup_scene
from vic_toolbox.twin.logs import Log, sensed
from vic_toolbox.twin.loop import in_steps
from vic_toolbox.twin.plant import plant_model, sensor_columns
from vic_toolbox.twin.robot import Twin
from vic_toolbox.twin.signals import smoothstep

PLACE = (0.45, 0.0, 0.40)
"""Where the cup's bottom stays, more or less [m]."""
TILTS = (0.0, 0.35, 0.7)
"""Tilts of the tool [rad]; three poses of each tilted kind would do, twelve average the noise."""
REST, TRAVEL = 0.8, 0.8
"""Time in a pose, and from one to the next [s]."""
RATE = 100.0
"""Of the log [Hz]."""


def calibrate(twin: Twin, *, poses: int = 12, seed: int = 0) -> Log:
    """Log of the untouched tool at rest in `poses` poses, for :func:`vic_toolbox.recordings.identify_payload`.

    Parameters
    ----------
    twin : Twin
    poses : int
        At least three.
    seed : int
        Of the noise.
    """
    stations = calibration_postures(integer("poses", poses, low=3))
    rng = np.random.default_rng([integer("seed", seed, low=0), 0xCA1])
    time = np.arange(round(RATE * (len(stations) * (REST + TRAVEL) - TRAVEL)), dtype=np.float64) / RATE
    angles, speeds, accelerations = _motion(stations, time)
    model = plant_model(twin.specimen)
    data, columns = mujoco.MjData(model), sensor_columns(model)
    transmitted = np.empty((len(time), 6))
    for i in range(len(time)):
        data.qpos[:], data.qvel[:], data.qacc[:] = angles[i], speeds[i], accelerations[i]
        mujoco.mj_inverse(model, data)
        transmitted[i] = -data.sensordata[columns]
    flaws = twin.imperfections
    noisy = angles + flaws.angle_noise * rng.standard_normal(angles.shape)
    return Log(
        time, in_steps(noisy, flaws.angle_resolution), sensed(transmitted, twin.specimen.bias, flaws, rng)
    )


def calibration_postures(poses: int) -> Array:
    """Joint angles (poses, 6) [rad]: the tool tilted by 0, 20 and 40 degrees, all round."""
    arm = cup_scene.robot()
    posture, found = np.array(cup_scene.start_angles(cup_scene.SCENARIOS["train"].start)), []
    for i in range(poses):
        azimuth = 2.4 * i  # the golden angle spreads them evenly, however many there are
        tilt = TILTS[i % len(TILTS)] * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        pose = pose_from(PLACE, rotation_exp(tilt) @ cup_scene.TOOL_DOWN)
        posture = arm.inverse_kinematics(pose, start=posture)
        found.append(posture)
    return np.array(found)


def _motion(stations: Array, time: Array) -> tuple[Array, Array, Array]:
    """Angles, speeds and accelerations (n, 6): rests, and minimum-jerk travel between them."""
    phase, leg = np.modf(time / (REST + TRAVEL))
    share = np.clip((phase * (REST + TRAVEL) - REST) / TRAVEL, 0.0, 1.0)[:, None]
    here = leg.astype(int)
    there = np.minimum(here + 1, len(stations) - 1)
    way = stations[there] - stations[here]
    speed = 30.0 * share**2 * (1.0 - share) ** 2 / TRAVEL
    acceleration = 60.0 * share * (1.0 - share) * (1.0 - 2.0 * share) / TRAVEL**2
    return stations[here] + smoothstep(share) * way, speed * way, acceleration * way
