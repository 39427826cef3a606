"""A hole built of convex wedges, as physics engines usually do it: a polygon, kept as a reference.

Its corners, not the task, decide whether a tilted peg slips in (docs/contact.md); nothing is learned on it.
"""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from vic_toolbox.errors import integer


def add_hole(
    spec: mujoco.MjSpec,
    name: str,
    *,
    count: int,
    radius: float,
    chamfer: float,
    depth: float,
    half_width: float,
    **geom: Any,
) -> None:
    """Add a prismatic hole of `count` wedges around the z axis, its mouth at z = 0.

    Each wedge is the convex hull of the profile (bore, chamfer, top, outside) extruded along the tangent; the
    inscribed circle of the polygon is the round hole.

    Parameters
    ----------
    spec : mujoco.MjSpec
        Scene; it is changed.
    name : str
        Names of the geoms begin with it.
    count : int
        Number of wedges, 3 to 512.
    radius, chamfer, depth, half_width : float
        Of the inscribed bore, its 45° chamfer, and the block around it [m].
    **geom
        Attributes of each geom.
    """
    count = integer("number of wedges", count, low=3, high=512)
    half = (radius + chamfer) * math.tan(math.pi / count) * 1.02  # neighbours overlap a little
    profile = [
        (radius, -chamfer),
        (radius + chamfer, 0.0),
        (half_width, 0.0),
        (half_width, -depth),
        (radius, -depth),
    ]
    vertices = np.array([(x, y, z) for x, z in profile for y in (-half, half)])
    spec.add_mesh(
        name=name, uservert=vertices.ravel().tolist(), inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    )
    for i in range(count):
        angle = 2.0 * math.pi * i / count
        quat = [math.cos(angle / 2), 0.0, 0.0, math.sin(angle / 2)]
        spec.worldbody.add_geom(
            name=f"{name}_{i}", type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, quat=quat, **geom
        )
