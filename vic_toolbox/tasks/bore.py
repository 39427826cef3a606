r"""The geometry of a round peg at a round hole with a chamfered mouth: profile, circles, edges that have crossed.

The hole is a body of revolution: the block is what lies below the plane :math:`z = 0` and outside the *profile* in
the half-plane :math:`(\rho, z)`,

.. math::
    \rho = R \;(z \le -c), \qquad \rho = R + c + z \;(-c \le z \le 0), \qquad z = 0 \;(\rho \ge R + c),

with radius :math:`R`, a 45° chamfer of width :math:`c`, and either a flat bottom or an open lower edge at
:math:`z = -D`. Everything that peg and block can touch with lies on circles: the peg's two rims, and the hole's three
edges (mouth, bore, lower). :mod:`vic_toolbox.tasks.bore_contacts` searches them; the derivation is in
docs/contact.md. No simulator is known here.

Arguments that all functions share, in any one unit of length:

- ``hole``: radius R, chamfer c, depth D, and 1 for a blind hole or 0 for an open one;
- ``tilt``: :math:`(s, k)`, sine and cosine of the angle between the two axes, neither negative;
- ``circle`` (a ``rim`` or an edge): which one, its centre, the peg's radius, tilt, hole;
- ``co, si``: a direction on a circle, as cosine and sine of the angle.

Points are in the *aligned* frame: the hole's (axis z, mouth at z = 0), turned about z until the peg's axis is
:math:`(s, 0, k)`. So no result depends on how the peg is turned about its own axis.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit

MOUTH, BORE, LOWER, RIM = range(4)
"""The circles: three edges of the hole, and a rim of the peg."""

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}
"""How the collider is compiled: no exceptions for a division by zero, NaN stays NaN."""

SLACK = 5e-3
"""Angle [rad] by which a normal may leave an edge's cone, so that a line contact keeps both of its ends."""

HALF = math.sqrt(0.5)

_NEAR = 1e-6  # |difference of two face distances| / radius at a point on the edge between the faces
_LONGEST_STEP = 0.25  # [rad] of a Gauss-Newton step


@njit(**OPTIONS)
def profile_distance(rho, z, radius, chamfer):
    """Signed distance of a point of the half-plane to the block without its bottom, and the direction away from it.

    Outside the block it is the Euclidean distance, inside minus the depth below the nearest face. The block's
    half of the plane is convex, so the distance is too; it falls with ρ and grows with z.

    Returns
    -------
    distance, normal_rho, normal_z : float
    """
    bore = radius - rho
    low = z + chamfer
    cone = HALF * (low + bore)
    if bore <= 0.0 and cone <= 0.0 and z <= 0.0:  # inside
        if bore >= cone and bore >= z:
            return bore, -1.0, 0.0
        if cone >= z:
            return cone, -HALF, HALF
        return z, 0.0, 1.0
    if low <= 0.0:
        return bore, -1.0, 0.0
    if bore <= -chamfer:
        return z, 0.0, 1.0
    along = low - bore  # √2 × distance along the cone from the bore's edge
    if along < 0.0:
        distance = math.sqrt(bore * bore + low * low)
        return distance, -bore / distance, low / distance
    if along > 2.0 * chamfer:
        inward = bore + chamfer
        distance = math.sqrt(inward * inward + z * z)
        return distance, -inward / distance, z / distance
    return cone, -HALF, HALF


@njit(**OPTIONS)
def rim_point(co, si, rim):
    """Point of a rim in the direction (co, si) from its lowest point, and the rim's tangent, in (x, y, z, ρ)."""
    _, center, r, (sine, cosine), _ = rim
    x, y, z = center[0] + r * cosine * co, center[1] + r * si, center[2] - r * sine * co
    dx, dy, dz = -r * cosine * si, r * co, r * sine * si
    rho = math.sqrt(x * x + y * y)
    return x, y, z, rho, (x * dx + y * dy) / rho, dz


@njit(**OPTIONS)
def edge_place(which, hole):
    """Radius and height of an edge of the hole."""
    if which == MOUTH:
        return hole[0] + hole[1], 0.0
    return hole[0], -hole[1] if which == BORE else -hole[2]


@njit(**OPTIONS)
def gap(co, si, circle):
    """Distance between the bodies at a place on a circle, and its derivative by the angle.

    A rim's distance is the profile's. An edge is looked at along the peg's axis: there the peg is a disc at the
    circle's ``centre`` and the edge an ellipse about the origin, with half-axes k R and R.
    """
    which, center, r, tilt, hole = circle
    if which == RIM:
        _, _, z, rho, d_rho, d_z = rim_point(co, si, circle)
        distance, normal_rho, normal_z = profile_distance(rho, z, hole[0], hole[1])
        return distance, normal_rho * d_rho + normal_z * d_z
    major = edge_place(which, hole)[0]
    minor = tilt[1] * major
    x, y = minor * co - center[0], major * si - center[1]
    distance = math.sqrt(x * x + y * y)
    return distance - r, (y * major * co - x * minor * si) / distance


@njit(**OPTIONS)
def crossed_edge(rho, z, d_rho, d_z, rim):
    """Edge of the hole that the rim crosses at a point inside the block, or ``RIM`` if it crosses none there.

    There the point is equally deep below two faces, one of which it leaves while it dives under the other.
    """
    _, _, r, _, hole = rim
    bore, cone = hole[0] - rho, HALF * (z + hole[1] + hole[0] - rho)
    d_cone = HALF * (d_z - d_rho)
    if abs(z - cone) < _NEAR * r and bore < z and d_z * d_cone < 0.0:
        return MOUTH
    if abs(bore - cone) < _NEAR * r and z < bore and d_rho * d_cone > 0.0:
        return BORE
    return RIM


@njit(**OPTIONS)
def edge_against_rim(which, co, si, rim):
    """Depth and normal where a rim has crossed an edge, at the rim's point nearest to the edge.

    Two edges meet in a point; what can part them is perpendicular to both tangents. The edge's own is the
    circumference, so the normal lies in the half-plane, perpendicular to the rim's tangent there.

    Returns
    -------
    distance, normal_rho, normal_z, co, si : float
    """
    edge_rho, edge_z = edge_place(which, rim[4])
    _, _, z, rho, d_rho, d_z = rim_point(co, si, rim)
    for _ in range(4):  # Gauss-Newton
        step = -((rho - edge_rho) * d_rho + (z - edge_z) * d_z) / (d_rho * d_rho + d_z * d_z)
        step = min(max(step, -_LONGEST_STEP), _LONGEST_STEP)
        scale = 1.0 / math.sqrt(1.0 + step * step)
        co, si = (co - step * si) * scale, (si + step * co) * scale
        _, _, z, rho, d_rho, d_z = rim_point(co, si, rim)
    scale = math.copysign(1.0 / math.sqrt(d_rho * d_rho + d_z * d_z), d_rho + d_z)  # out of the block
    normal_rho, normal_z = -d_z * scale, d_rho * scale
    return (rho - edge_rho) * normal_rho + (z - edge_z) * normal_z, normal_rho, normal_z, co, si


@njit(**OPTIONS)
def within_cone(which, normal_rho, normal_z):
    """Whether the block has a normal in this direction at edge ``which``."""
    if which == MOUTH:
        return normal_z > -normal_rho - SLACK and normal_rho < SLACK
    if which == BORE:
        return normal_z > -SLACK and normal_z < -normal_rho + SLACK
    return normal_z < SLACK and normal_rho < SLACK
