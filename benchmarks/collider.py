"""How exact the round hole's collider is: ``python -m benchmarks.collider``.

Random poses of the task's peg at its hole: at the mouth, half in, and deep. Where peg and hole do not overlap, the
smallest distance that the collider reports is compared with brute force (:mod:`benchmarks.brute_force`). Where they
do, every contact is: the peg is moved along the contact's normal until that contact should be :data:`LIFT` away, and
its neighbourhood, a quarter of a millimetre, is measured again. For comparison, the same distances are taken from
holes of convex wedges.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import mujoco
import numpy as np

from benchmarks import brute_force
from vic_toolbox.tasks import bore_contacts, wedges

PEG, HOLE = (12.685e-3, 60e-3), (12.70e-3, 0.4e-3, 25e-3, 0.0)
"""Radius and half length of the peg; radius, chamfer, depth and openness of the hole [m]."""
PLACES = ("at the mouth", "half in", "deep")
SEPARATED, PENETRATING = 600, 420
"""Poses in all, and contacts come with the second."""
LIFT = 20e-6
MARGIN = 1e-3
"""Up to which distance contacts are looked for [m]."""
WEDGES = (16, 64)
DEEPEST = 15e-6
"""Overlap that a pose may have [m]; in the closed loop it is below 10 µm."""


def main() -> None:
    """Measure and print the result."""
    rng = np.random.default_rng(0)
    separated, penetrating = [], []
    polygons = {count: (wedge_model(count), []) for count in WEDGES}
    for place in PLACES:
        poses = list(separated_poses(rng, place, SEPARATED // 3))
        true = np.array([brute_force.peg_distance(*pose, peg=PEG, hole=HOLE) for pose in poses])
        separated.append(1e6 * (np.array([reported_distance(*pose) for pose in poses]) - true))
        report(f"separated, {place}", separated[-1])
        for count, (model, errors) in polygons.items():
            errors.append(1e6 * (np.array([wedge_distance(model, *pose) for pose in poses]) - true))
            report(f"{count} wedges, {place}", errors[-1])
    for place in PLACES:
        poses = list(overlapping_poses(rng, place, PENETRATING // 3))
        errors = 1e6 * np.concatenate([contact_errors(*pose) for pose in poses])
        report(f"penetrating, {place}", errors)
        penetrating.append(errors)
    result: dict[str, float | int] = {}
    polygonal = {f"{count}_wedges": errors for count, (_, errors) in polygons.items()}
    for name, parts in {"separated": separated, "penetrating": penetrating, **polygonal}.items():
        errors = np.abs(np.concatenate(parts))
        result |= {
            f"worst_{name}_um": round(errors.max(), 4),
            f"median_{name}_um": round(float(np.median(errors)), 6),
        }
    counts = {"separated_poses": sum(map(len, separated)), "penetrating_contacts": sum(map(len, penetrating))}
    print(json.dumps(result | counts | {"penetrating_poses": PENETRATING}))


def report(name: str, errors: np.ndarray) -> None:
    size = np.abs(errors)
    print(
        f"{name:26s} {len(errors):4d}: error median {np.median(size):.5f}, worst {size.max():.4f} µm",
        flush=True,
    )


def separated_poses(
    rng: np.random.Generator, place: str, count: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Poses whose distance is between zero and a third of a millimetre."""
    while count:
        position, axis = random_pose(rng, place)
        for _ in range(30):
            rows = contacts(position, axis, margin=MARGIN)
            if len(rows) == 0 or rows[:, 0].min() >= 1e-6:
                break
            deepest = rows[rows[:, 0].argmin()]
            position = position + (rng.uniform(1e-6, 8e-6) - deepest[0]) * deepest[4:7]
        if len(rows) and 0.0 < rows[:, 0].min() < 3e-4:
            count -= 1
            yield position, axis


def overlapping_poses(
    rng: np.random.Generator, place: str, count: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Poses that overlap by no more than :data:`DEEPEST`."""
    while count:
        position, axis = random_pose(rng, place)
        for _ in range(40):
            rows = contacts(position, axis)
            if len(rows) == 0 or rows[:, 0].min() > -8e-6:
                break
            deepest = rows[rows[:, 0].argmin()]
            position = position - 0.97 * deepest[0] * deepest[4:7]
        if len(rows) and rows[:, 0].min() > -DEEPEST:
            count -= 1
            yield position, axis


def random_pose(rng: np.random.Generator, place: str) -> tuple[np.ndarray, np.ndarray]:
    """Centre [m] and axis of the peg; tilted by what there is room for."""
    tilt = np.radians(rng.uniform(0.0, 0.12 if place == "deep" else 6.0))
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    axis = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    if place == "at the mouth":
        tip = [*rng.uniform(-0.8e-3, 0.8e-3, 2), PEG[0] * np.sin(tilt) - rng.uniform(0.0, 1.2e-3)]
    elif place == "half in":
        tip = [*rng.uniform(-0.3e-3, 0.3e-3, 2), rng.uniform(-3e-3, 1e-3)]
    else:
        tip = [*rng.uniform(-10e-6, 10e-6, 2), -rng.uniform(2e-3, 19e-3)]
    return np.array(tip) + PEG[1] * axis, axis


def contacts(position: np.ndarray, axis: np.ndarray, *, margin: float = 0.0) -> np.ndarray:
    """Contacts that the collider finds: rows of distance, position, normal."""
    rows = np.zeros((bore_contacts.MAX_CONTACTS, 10))
    count = bore_contacts.contacts(rows, tuple(position), tuple(axis), PEG, HOLE, margin)
    return rows[:count, :7]


def reported_distance(position: np.ndarray, axis: np.ndarray) -> float:
    """Smallest distance that the collider reports [m]."""
    return contacts(position, axis, margin=MARGIN)[:, 0].min()


def wedge_model(count: int) -> mujoco.MjModel:
    """The same peg at the same hole, of so many convex wedges."""
    spec = mujoco.MjSpec()
    spec.option.ccd_tolerance = 1e-9
    radius, chamfer, depth, _ = HOLE
    measures = {"radius": radius, "chamfer": chamfer, "depth": depth, "half_width": 30e-3}
    wedges.add_hole(spec, "hole", count=count, margin=MARGIN, **measures)
    body = spec.worldbody.add_body(name="peg")
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[*PEG, 0.0])
    return spec.compile()


def wedge_distance(model: mujoco.MjModel, position: np.ndarray, axis: np.ndarray) -> float:
    """Smallest distance that MuJoCo reports there, or the margin [m]."""
    data = mujoco.MjData(model)
    data.qpos[:3] = position
    mujoco.mju_quatZ2Vec(data.qpos[3:], axis)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    return data.contact.dist.min(initial=MARGIN)


def contact_errors(position: np.ndarray, axis: np.ndarray) -> list[float]:
    """Error of each contact's depth along its own normal [m]."""
    errors = []
    for row in contacts(position, axis):
        distance, point, normal = row[0], row[1:4], row[4:7]
        lift = (LIFT - distance) * normal
        gap = brute_force.gap_near(point + lift, position + lift, axis, peg=PEG, hole=HOLE)
        errors.append(LIFT - gap)
    return errors


if __name__ == "__main__":
    main()
