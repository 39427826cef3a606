"""Contacts of a peg with a chamfered bore: where the distance between the two is smallest along each circle.

Two convex bodies touch at one place; a peg in a bore touches at several, all of them on circles
(:mod:`vic_toolbox.tasks.bore`):

- the peg's two **rims** against the profile of the hole, and against the bottom of a blind one;
- the hole's **edges** against the peg's side.

The end faces of the peg and the hole's cone and cylinder need no search of their own: their nearest points lie on
these circles.
"""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from typing import Any

from numba import njit

from vic_toolbox.tasks import bore, bore_search
from vic_toolbox.tasks.bore import (
    BORE,
    HALF,
    LOWER,
    MOUTH,
    OPTIONS,
    RIM,
    SLACK,
    crossed_edge,
    edge_against_rim,
    edge_place,
    profile_distance,
    rim_point,
    within_cone,
)
from vic_toolbox.tasks.bore_search import closest_directions

MAX_CONTACTS = 50
"""Rows that :func:`contacts` needs room for. About eight are the most that occur."""


@njit(**OPTIONS)
def _write(rows, n, distance, point, normal, share):
    """Fill row n: a point on one body, from which the contact point is ``share`` of the distance along the normal."""
    rows[n, 0] = distance
    for i in range(3):
        rows[n, 1 + i] = point[i] + share * distance * normal[i]
        rows[n, 4 + i] = normal[i]
    return n + 1


@njit(**OPTIONS)
def _rim_contacts(rim, margin, rows, n):
    """Contacts of one rim with the block (bottom apart)."""
    _, center, r, tilt, hole = rim
    outer = math.sqrt(center[0] * center[0] + center[1] * center[1]) + r
    if not profile_distance(outer, center[2] - r * tilt[0], hole[0], hole[1])[0] < margin:
        return n  # the profile's distance falls with ρ and grows with z: nowhere closer than this
    for i in range(n, closest_directions(rim, r, margin, rows, n)):
        co, si = rows[i, 7], rows[i, 8]
        x, y, z, rho, d_rho, d_z = rim_point(co, si, rim)
        if z < -hole[2] and hole[3] == 0.0:
            continue  # below the open end
        distance, normal_rho, normal_z = profile_distance(rho, z, hole[0], hole[1])
        which = crossed_edge(rho, z, d_rho, d_z, rim) if distance < 0.0 else RIM
        if which != RIM:
            depth, across_rho, across_z, new_co, new_si = edge_against_rim(which, co, si, rim)
            if within_cone(which, across_rho, across_z):  # else the rim only grazes the edge
                distance, normal_rho, normal_z = depth, across_rho, across_z
                x, y, z, rho, _, _ = rim_point(new_co, new_si, rim)
        normal = (normal_rho * x / rho, normal_rho * y / rho, normal_z)
        if distance < margin:
            n = _write(rows, n, distance, (x, y, z), normal, -0.5)
    return n


@njit(**OPTIONS)
def _bottom_contacts(rim, margin, rows, n):
    """Contacts of one rim with the bottom of a blind hole: its lowest point and the other three quarters."""
    _, center, r, tilt, hole = rim
    if hole[3] != 0.0 and center[2] - r * tilt[0] + hole[2] < margin:
        for co, si in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
            x, y, z, _, _, _ = rim_point(co, si, rim)
            if z + hole[2] < margin:
                n = _write(rows, n, z + hole[2], (x, y, z), (0.0, 0.0, 1.0), -0.5)
    return n


@njit(**OPTIONS)
def _edge_contacts(which, position, tilt, peg, hole, margin, rows, n):
    """Contacts of the peg's side with one edge of the hole."""
    sine, cosine = tilt
    r, half = peg
    edge_rho, edge_z = edge_place(which, hole)
    if abs(edge_z - position[2]) > half * cosine + r * sine:
        return n
    center = (cosine * position[0] + sine * (edge_z - position[2]), position[1], 0.0)
    inner = cosine * edge_rho - math.sqrt(center[0] * center[0] + center[1] * center[1]) - r
    if inner >= margin:
        return n  # the circle inscribed in the ellipse is nowhere closer than this
    edge = (which, center, r, tilt, hole)
    for i in range(n, closest_directions(edge, edge_rho, margin, rows, n)):
        co, si = rows[i, 7], rows[i, 8]
        x, y, z = edge_rho * co - position[0], edge_rho * si - position[1], edge_z - position[2]
        along = sine * x + cosine * z
        x, z = x - sine * along, z - cosine * along
        length = math.sqrt(x * x + y * y + z * z)
        distance = length - r
        if abs(along) > half + min(distance, 0.0):
            continue  # beyond the peg's end, or deep in the peg but nearer its end than its side: the rim's
        normal = (-x / length, -y / length, -z / length)
        if distance < margin and within_cone(which, normal[0] * co + normal[1] * si, normal[2]):
            n = _write(rows, n, distance, (edge_rho * co, edge_rho * si, edge_z), normal, 0.5)
    return n


@njit(**OPTIONS)
def _aligned_contacts(rows, center, tilt, peg, hole, margin):
    """Contacts in the aligned frame."""
    (r, half), (sine, cosine) = peg, tilt
    n = 0
    for end in (-half, half):
        rim = (RIM, (center[0] + end * sine, center[1], center[2] + end * cosine), r, tilt, hole)
        n = _rim_contacts(rim, margin, rows, n)
        n = _bottom_contacts(rim, margin, rows, n)
    # An upright side has no normal within the cone of the mouth's edge, and a blind hole no lower edge.
    for which in range(MOUTH if sine > HALF - SLACK else BORE, RIM if hole[3] == 0.0 else LOWER):
        n = _edge_contacts(which, center, tilt, peg, hole, margin, rows, n)
    return n


def _compile() -> Any:
    """Compile :func:`contacts` at its first call, and keep the result on disk where numba may write.

    What is on disk belongs to this file and to the values that the function closes over; the text of the other files
    that the function is made of must therefore be one of them.
    """
    others = zlib.crc32(b"".join(Path(str(module.__file__)).read_bytes() for module in (bore, bore_search)))

    def contacts(rows, position, axis, peg, hole, margin):
        _ = others
        if not math.isfinite(position[0] + position[1] + position[2] + axis[0] + axis[1] + axis[2]):
            return 0
        sine, flip = math.sqrt(axis[0] * axis[0] + axis[1] * axis[1]), math.copysign(1.0, axis[2])
        if position[2] - peg[1] * abs(axis[2]) - peg[0] * sine >= margin:
            return 0
        # The aligned frame's x; a cylinder has no head, so the axis may be turned over.
        tilted = sine > 1e-150  # below, squares underflow and the direction has no unit length
        ex, ey = (flip * axis[0] / sine, flip * axis[1] / sine) if tilted else (1.0, 0.0)
        center = (ex * position[0] + ey * position[1], ex * position[1] - ey * position[0], position[2])
        count = _aligned_contacts(rows, center, (sine, flip * axis[2]), peg, hole, margin)
        for i in range(count):
            for k in (1, 4):
                x, y = rows[i, k], rows[i, k + 1]
                rows[i, k], rows[i, k + 1] = ex * x - ey * y, ey * x + ex * y
        return count

    try:
        return njit(cache=True, **OPTIONS)(contacts)
    except RuntimeError:  # no folder that numba may write its cache to
        return njit(**OPTIONS)(contacts)


contacts: Any = _compile()
"""``contacts(rows, position, axis, peg, hole, margin) -> count``, compiled: all contacts nearer than ``margin``.

=============  ==================  ====================================================================================
argument       shape               meaning
=============  ==================  ====================================================================================
``rows``       (≥ 50, ≥ 9) array   written: distance (negative where the bodies overlap), contact point halfway between
                                   them (3), unit normal from block to peg (3), scratch (2)
``position``   tuple of 3          centre of the peg in the hole's frame (axis z, mouth at z = 0)
``axis``       tuple of 3          its unit axis, of either sign
``peg``        tuple of 2          radius and half length
``hole``       tuple of 4          radius, chamfer, depth, and 1.0 for a blind hole or 0.0 for an open one
``margin``     float               largest distance
=============  ==================  ====================================================================================

Any one unit of length; floats everywhere. The smallest distance is exact where the bodies do not overlap. A pose that
is not finite has no contacts. The block is as wide as can be, and nothing touches it from below.
"""
