"""The picture of Peg-in-Hole: the block cut open along the plane y = 0, and the peg in a compliant hand.

The hole of the physics is a formula that nothing can draw; what is seen are surfaces of revolution of its measures.
They go with the scale of the part, and so do cameras and lights: only the ruler tells a small part from a large one.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array
from vic_toolbox.tasks import rendering
from vic_toolbox.tasks.peg_scene import (
    BLOCK,
    BORE_DEPTH,
    CHAMFER,
    GOAL_DEPTH,
    HOLE_RADIUS,
    TIP_DISTANCE,
    PegScenario,
    build_spec,
)
from vic_toolbox.tasks.scene import HIDDEN_GROUP

SEGMENTS = 256
"""Corners of a full circle; its chords are within 1 µm of the bore, much less than the clearance."""

Surface = dict[str, np.ndarray]

_BEVEL = 0.8e-3  # of the block's outer edge [m]

_COLLAR = 1e-3 * np.array([(12.6, 16.0), (16.0, 16.0), (17.0, 17.0), (17.0, 29.0), (12.6, 29.0)])
_FLANGE = 1e-3 * np.array([(12.6, 29.0), (21.0, 29.0), (22.0, 30.0), (22.0, 70.0), (0.0, 70.0)])
"""Profiles (radius, height above the centre of mass) of the two parts of the hand [m]."""

_BLUE = (0.0, 0.45, 0.70)
_MATERIALS: dict[str, dict[str, Any]] = {
    "block": {"rgba": [0.36, 0.42, 0.50, 1.0], "specular": 0.35, "shininess": 0.5},
    "section": {"rgba": [0.80, 0.84, 0.89, 1.0], "specular": 0.05, "shininess": 0.1},
    "collar": {"rgba": [0.16, 0.17, 0.19, 1.0], "specular": 0.4, "shininess": 0.5},
    "flange": {"rgba": [0.93, 0.72, 0.05, 1.0], "specular": 0.3, "shininess": 0.5},
    "mark": {"rgba": [0.16, 0.17, 0.19, 1.0]},
    "goal": {"rgba": [*_BLUE, 1.0]},
    "table": {"rgba": rendering.WOOD, "specular": 0.2, "shininess": 0.3},
}


def picture_spec(scenario: PegScenario) -> mujoco.MjSpec:
    """The scene of a scenario for the eye alone: joint and sizes of the physics, and nothing that touches.

    Parameters
    ----------
    scenario : PegScenario

    Returns
    -------
    mujoco.MjSpec
        For :class:`vic_toolbox.tasks.rendering.Renderer`. Its camera :data:`~vic_toolbox.tasks.rendering.DETAIL`
        looks at the edge of the hole towards which a constant stiffness swings the tip.
    """
    spec, scale = build_spec(scenario), scenario.scale
    for geom in spec.geoms:
        geom.group = HIDDEN_GROUP
    rendering.studio(spec, size=0.12 * scale)
    spec.visual.map.znear = 0.1  # tells surfaces apart that are closer than the clearance
    for name, look in _MATERIALS.items():
        spec.add_material(name=name, **look)
    side = math.copysign(1.0, scenario.offset if scenario.tilt == 0.0 else -scenario.tilt)
    _add_block(spec, scale)
    _add_ruler(spec, scale, side)
    _add_peg(spec, scale)
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    middle, edge = np.array([6e-3, 0.0, 31e-3]), np.array([side * HOLE_RADIUS, 0.0, 0.0])
    _add_camera(spec, rendering.CAMERA, scale * middle, azimuth=8.0, elevation=15.0, height=128e-3 * scale)
    _add_camera(spec, rendering.DETAIL, scale * edge, azimuth=4.0 * side, elevation=7.0, height=6e-3 * scale)
    return spec


def revolve(profile: ArrayLike, angles: ArrayLike) -> Surface:
    """Surface that a profile sweeps about the z axis; its own edges stay sharp, around the axis it is smooth.

    Parameters
    ----------
    profile : array_like, shape (n, 2)
        Points (ρ, z), along which what is solid lies on the left.
    angles : array_like, shape (m,)
        Angles about z [rad].

    Returns
    -------
    dict
        What MuJoCo's meshes call ``uservert`` (v, 3), ``usernormal`` (v, 3), ``usertexcoord`` (v, 2), the angle as a
        share of the circle and the height as a share of the profile's, and ``userface`` (f, 3).
    """
    points, around = np.asarray(profile, dtype=np.float64), np.asarray(angles, dtype=np.float64)
    ends = np.stack([points[:-1], points[1:]], axis=1)  # (segment, end, (ρ, z))
    along = ends[:, 1] - ends[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    outward = np.repeat(np.stack([along[:, 1], -along[:, 0]], axis=-1)[:, None], 2, axis=1)
    low, high = points[:, 1].min(), points[:, 1].max()
    share = np.broadcast_to((ends[..., 1] - low) / (high - low), (around.size, *ends.shape[:2]))
    turn = np.broadcast_to(around[:, None, None] / (2.0 * math.pi), share.shape)
    i, j = (index.ravel() for index in np.indices((around.size - 1, len(ends))))
    a = 2 * (len(ends) * i + j)
    b, c, d = a + 1, a + 2 * len(ends), a + 2 * len(ends) + 1  # next along the profile, next around, both
    return {
        "uservert": _turned(ends, around).reshape(-1, 3),
        "usernormal": _turned(outward, around).reshape(-1, 3),
        "usertexcoord": np.stack([turn, share], axis=-1).reshape(-1, 2),
        "userface": np.concatenate([np.stack([a, c, b], axis=-1), np.stack([b, c, d], axis=-1)]),
    }


def _turned(half_plane: Array, angles: Array) -> Array:
    """(ρ, z) of (..., 2) turned about z by each of the angles (m,), as (m, ..., 3)."""
    angle = angles.reshape(-1, *[1] * (half_plane.ndim - 1))
    rho, z = half_plane[..., 0], half_plane[..., 1]
    return np.stack(np.broadcast_arrays(rho * np.cos(angle), rho * np.sin(angle), z), axis=-1)


def _section(profile: Array) -> Surface:
    """The two flat faces, seen from −y, where the plane y = 0 cuts a body of revolution with a convex profile."""
    right = np.insert(profile, 1, 0.0, axis=1)
    vertices = np.concatenate([right, right * [-1.0, 1.0, 1.0]])
    fan = np.array([(0, k, k + 1) for k in range(1, len(right) - 1)])
    return {
        "uservert": vertices,
        "usernormal": np.broadcast_to([0.0, -1.0, 0.0], vertices.shape),
        "userface": np.concatenate([fan, len(right) + fan[:, ::-1]]),
    }


def _add_surface(
    spec: mujoco.MjSpec, body: Any, name: str, surface: Surface, *, scale: float, material: str
) -> None:
    """Add a surface, in metres at scale 1, to a body."""
    numbers = {key: values.ravel() for key, values in surface.items()}
    shell = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # it bounds no volume
    spec.add_mesh(name=name, scale=[scale] * 3, inertia=shell, **numbers)
    body.add_geom(name=name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, material=material)


def _add_block(spec: mujoco.MjSpec, scale: float) -> None:
    """Half of a round block with the hole in it, on a table."""
    profile = np.array([
        (BLOCK, -BORE_DEPTH), (BLOCK, -_BEVEL), (BLOCK - _BEVEL, 0.0),
        (HOLE_RADIUS + CHAMFER, 0.0), (HOLE_RADIUS, -CHAMFER), (HOLE_RADIUS, -BORE_DEPTH),
    ])  # fmt: skip
    world, half_turn = spec.worldbody, np.linspace(0.0, math.pi, SEGMENTS // 2 + 1)
    _add_surface(spec, world, "hole", revolve(profile, half_turn), scale=scale, material="block")
    _add_surface(spec, world, "section", _section(profile), scale=scale, material="section")
    size = scale * np.array([0.4, 0.08, 0.01])
    below = [0.0, 0.0, -scale * BORE_DEPTH - size[2]]
    world.add_geom(name="table", type=mujoco.mjtGeom.mjGEOM_BOX, material="table", size=size, pos=below)


def _add_ruler(spec: mujoco.MjSpec, scale: float, side: float) -> None:
    """Marks of the depth on the cut face beside the bore, at every true millimetre."""
    for depth in range(1, math.ceil(1e3 * scale * BORE_DEPTH)):  # [mm]
        at_goal = abs(1e-3 * depth - scale * GOAL_DEPTH) < 1e-6
        length, thickness = scale * (0.5e-3 if depth % 5 else 1.2e-3), min(scale * 0.035e-3, 0.1e-3)
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, material="goal" if at_goal else "mark",
            size=[length, scale * 0.02e-3, thickness],
            pos=[side * (scale * HOLE_RADIUS + length), 0.0, -1e-3 * depth],
        )  # fmt: skip


def _add_peg(spec: mujoco.MjSpec, scale: float) -> None:
    """The peg and the hand that holds it."""
    body, radius = spec.body("peg"), spec.geom("peg").size[0] / scale
    circle = np.linspace(0.0, 2.0 * math.pi, SEGMENTS + 1)
    shaft = [(0.0, -TIP_DISTANCE), (radius, -TIP_DISTANCE), (radius, TIP_DISTANCE), (0.0, TIP_DISTANCE)]
    for name, profile in {"shaft": shaft, "collar": _COLLAR, "flange": _FLANGE}.items():
        _add_surface(spec, body, name, revolve(profile, circle), scale=scale, material=name)
    pixels = _brushed_steel()
    height, width, channels = pixels.shape
    flat = mujoco.mjtTexture.mjTEXTURE_2D
    texture = spec.add_texture(name="shaft", type=flat, width=width, height=height, nchannel=channels)
    texture.data = pixels.tobytes()
    steel = spec.add_material(name="shaft", specular=0.3, shininess=0.6)
    steel.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture.name


def _brushed_steel(height: int = 2048, width: int = 256) -> np.ndarray:
    """Texture (height, width, 3) of the peg: brushed around, bright where windows would be mirrored.

    A blue ring marks the centre of mass, and a thin one what is level with the mouth at the goal.
    """
    rng = np.random.default_rng(0)
    brushed = 0.05 * rng.standard_normal((height, 1)) + 0.01 * rng.standard_normal((height, width))
    turn = 2.0 * math.pi * np.arange(width) / width
    mirrored = 0.12 * np.cos(2.0 * turn + 0.6) + 0.08 * np.cos(5.0 * turn)
    pixels = (0.80 + brushed + mirrored)[..., None] * [0.98, 1.0, 1.03]
    above_tip = (np.arange(height) + 0.5) / height * 2.0 * TIP_DISTANCE
    for level, half, colour in ((TIP_DISTANCE, 0.5e-3, _BLUE), (GOAL_DEPTH, 0.12e-3, (0.25, 0.27, 0.30))):
        ring = np.abs(above_tip - level) < half
        pixels[ring] = 0.25 * pixels[ring] + 0.75 * np.array(colour)
    return (255.0 * np.clip(pixels, 0.0, 1.0)).astype(np.uint8)


def _add_camera(
    spec: mujoco.MjSpec, name: str, target: Array, *, azimuth: float, elevation: float, height: float
) -> None:
    """A camera before the cut face [deg], far away, with a field of this height [m] in view."""
    a, e = math.radians(azimuth), math.radians(elevation)
    towards = np.array([math.sin(a) * math.cos(e), -math.cos(a) * math.cos(e), math.sin(e)])
    distance = 4.0 * spec.stat.extent
    fovy = math.degrees(2.0 * math.atan(height / (2.0 * distance)))
    rendering.add_camera(spec, name, eye=target + distance * towards, target=target, fovy=fovy)
