r"""Contacts between a round peg and a round hole with a chamfered mouth, in closed form up to a line search.

The hole is a body of revolution: the block is what lies below the plane :math:`z = 0` and outside the *profile* in
the half-plane :math:`(\rho, z)`,

.. math::
    \rho = R \;(z \le -c), \qquad \rho = R + c + z \;(-c \le z \le 0), \qquad z = 0 \;(\rho \ge R + c),

with radius :math:`R`, a 45° chamfer of width :math:`c`, and either a flat bottom or an open lower edge at
:math:`z = -D`. Two convex bodies would touch at one place; a peg in a bore touches at several. All of them lie on
circles:

- the peg's two **rims** against profile and bottom: :math:`\min_\varphi d(\rho(\varphi), z(\varphi))`, with the
  signed distance :math:`d` of the profile;
- the hole's **edges** (mouth, bore, lower) against the peg's side: :math:`\min_\psi` of their distance to the peg's
  axis, less the peg's radius.

The peg's end faces and the hole's cone and cylinder need no search of their own: their nearest points lie on these
circles. The derivation is in docs/contact.md. No simulator is known here.

Frames: *hole* (axis z, mouth at z = 0), and *aligned*, which is the hole's frame turned about z until the peg's axis
is :math:`(s, 0, k)` with :math:`s, k \ge 0`. In the aligned frame a pose is five numbers, and no result depends on
how the peg is turned about its own axis. Lengths in any one unit; every tolerance is relative.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

MAX_CONTACTS = 50
"""Rows that :func:`contacts` may need room for; a pose that can occur needs about eight."""

_SAMPLES = 24
_SPACING = 2.0 * math.pi / _SAMPLES
_COS, _SIN = np.cos(_SPACING * np.arange(_SAMPLES)), np.sin(_SPACING * np.arange(_SAMPLES))
_TAN = math.tan(_SPACING)
_MINIMA = 8  # local minima that one circle may have
_SUPPORTS = 4  # contacts that hold a circle which touches all around
_APART = math.cos(math.radians(59.0))  # contacts on a circle that touches all around are farther apart than this
_FLAT = 1e-9  # slope / radius below which a circle does not come closer
_NARROW = 1e-9  # bracket [rad] that has closed on a kink
_NEAR = 1e-6  # |difference of two face distances| / radius at a point on the edge between the faces
_SLACK = 5e-3  # [rad] by which a normal may leave an edge's cone: a line contact keeps both of its ends
_HALF = math.sqrt(0.5)
_MOUTH, _BORE, _LOWER, _RIM = range(4)  # the circles: three edges of the hole, and a rim of the peg

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract", "nsz"}}


@njit(**_OPTIONS)
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
    cone = _HALF * (low + bore)
    if bore <= 0.0 and cone <= 0.0 and z <= 0.0:  # inside
        if bore >= cone and bore >= z:
            return bore, -1.0, 0.0
        if cone >= z:
            return cone, -_HALF, _HALF
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
    return cone, -_HALF, _HALF


@njit(**_OPTIONS)
def _rim_point(co, si, rim):
    """Point of a rim in the direction (co, si) from its lowest point, and the rim's tangent, in (x, y, z, ρ)."""
    _, center, r, (sine, cosine), _ = rim
    x, y, z = center[0] + r * cosine * co, center[1] + r * si, center[2] - r * sine * co
    dx, dy, dz = -r * cosine * si, r * co, r * sine * si
    rho = math.sqrt(x * x + y * y)
    return x, y, z, rho, (x * dx + y * dy) / rho, dz


@njit(**_OPTIONS)
def _edge_place(which, hole):
    """Radius and height of an edge of the hole."""
    if which == _MOUTH:
        return hole[0] + hole[1], 0.0
    return hole[0], -hole[1] if which == _BORE else -hole[2]


@njit(**_OPTIONS)
def _gap(co, si, circle):
    """Distance between the bodies along a circle, in the direction (co, si) from its centre, and its derivative.

    A circle is a tuple: which one, centre, the peg's radius, tilt (s, k), hole. A rim's distance is the profile's.
    An edge is looked at along the peg's axis: the peg is a disc at ``centre``, the edge an ellipse about the origin
    with half-axes k R and R.
    """
    which, center, r, tilt, hole = circle
    if which == _RIM:
        _, _, z, rho, d_rho, d_z = _rim_point(co, si, circle)
        distance, normal_rho, normal_z = profile_distance(rho, z, hole[0], hole[1])
        return distance, normal_rho * d_rho + normal_z * d_z
    major = _edge_place(which, hole)[0]
    minor = tilt[1] * major
    x, y = minor * co - center[0], major * si - center[1]
    distance = math.sqrt(x * x + y * y)
    return distance - r, (y * major * co - x * minor * si) / distance


@njit(**_OPTIONS)
def _refine(circle, k, fa, sa, fb, sb, flat):
    """Smallest value between sample k and the next, where the slope changes sign; with its direction.

    The bracket is cut in turns by the secant of the slopes, which finds a smooth minimum, where the two tangents
    meet, which finds a kink, and in the middle, lest either of them creep along from one side.
    """
    co, si = _COS[k], _SIN[k]
    after = k + 1 if k + 1 < _SAMPLES else 0
    if abs(sb) <= flat:
        return fb, _COS[after], _SIN[after]
    a, b = 0.0, _TAN  # places on the tangent at sample k
    sb /= 1.0 + _TAN * _TAN
    for turn in range(40):
        width = b - a
        x = a + 0.5 * width
        if turn % 3 == 0:
            cut = a - sa * width / (sb - sa)
        elif turn % 3 == 1:
            cut = a + (fb - fa - sb * width) / (sa - sb)
            if abs(cut - a) < _NARROW or abs(b - cut) < _NARROW:
                break
        else:
            cut = x
        if a < cut < b:
            x = cut
        scale = 1.0 / math.sqrt(1.0 + x * x)
        f, slope = _gap((co - x * si) * scale, (si + x * co) * scale, circle)
        if abs(slope) <= flat:
            a = b = x
            fa = fb = f
            break
        slope *= scale * scale
        if slope < 0.0:
            a, fa, sa = x, f, slope
        else:
            b, fb, sb = x, f, slope
    x = a if fa < fb else b
    scale = 1.0 / math.sqrt(1.0 + x * x)
    return min(fa, fb), (co - x * si) * scale, (si + x * co) * scale


@njit(**_OPTIONS)
def _circle_minima(circle, length, margin, rows, first):
    """Directions on a circle where it comes closest, written to columns 7 and 8 of the rows from ``first`` on.

    A minimum lies between samples whose slopes go from falling to rising. ``length`` is the circle's radius: it
    bounds the slope, hence how low the curve can come between two samples.

    Returns
    -------
    int
        Row after the last.
    """
    end, below, best, lowest = first, 0, 0, math.inf
    flat, reach = _FLAT * length, _SPACING * length
    fa, sa = _gap(_COS[_SAMPLES - 1], _SIN[_SAMPLES - 1], circle)
    for k in range(_SAMPLES):
        fb, sb = _gap(_COS[k], _SIN[k], circle)
        if fb < margin:
            below += 1
        if fb < lowest:
            lowest, best = fb, k
        if sa < -flat and sb >= -flat and fa + fb - reach < 2.0 * margin and end < first + _MINIMA:
            f, co, si = _refine(circle, k - 1 if k > 0 else _SAMPLES - 1, fa, sa, fb, sb, flat)
            if f < margin:
                rows[end, 7], rows[end, 8] = co, si
                end += 1
        fa, sa = fb, sb
    if below > 0 and end == first:  # level all around
        rows[end, 7], rows[end, 8] = _COS[best], _SIN[best]
        end += 1
    if circle[0] == _RIM and below * _SPACING > 1.0:
        end = _spread(circle, margin, rows, first, end)
    return end


@njit(**_OPTIONS)
def _spread(circle, margin, rows, first, end):
    """Add directions where a wide arc of a rim touches: always the one farthest from those chosen, if 60° away.

    A peg that stands flat needs them: one minimum would not hold it.
    """
    while end < first + _SUPPORTS:
        farthest, place = 1.0, -1
        for k in range(_SAMPLES):
            nearest = -1.0
            for i in range(first, end):
                nearest = max(nearest, rows[i, 7] * _COS[k] + rows[i, 8] * _SIN[k])
            if nearest < _APART and nearest < farthest - 1e-12 and _gap(_COS[k], _SIN[k], circle)[0] < margin:
                farthest, place = nearest, k
        if place < 0:
            break
        rows[end, 7], rows[end, 8] = _COS[place], _SIN[place]
        end += 1
    return end


@njit(**_OPTIONS)
def _write(rows, n, distance, point, normal, share):
    """Fill row n: a point on one body, from which the contact point is ``share`` of the distance along the normal."""
    rows[n, 0] = distance
    for i in range(3):
        rows[n, 1 + i] = point[i] + share * distance * normal[i]
        rows[n, 4 + i] = normal[i]
    return n + 1


@njit(**_OPTIONS)
def _crossed_edge(rho, z, d_rho, d_z, rim):
    """Edge of the hole that the rim crosses at a point inside the block, or ``_RIM`` if it crosses none there.

    There the point is equally deep below two faces, one of which it leaves while it dives under the other.
    """
    _, _, r, _, hole = rim
    bore, cone = hole[0] - rho, _HALF * (z + hole[1] + hole[0] - rho)
    d_cone = _HALF * (d_z - d_rho)
    if abs(z - cone) < _NEAR * r and bore < z and d_z * d_cone < 0.0:
        return _MOUTH
    if abs(bore - cone) < _NEAR * r and z < bore and d_rho * d_cone > 0.0:
        return _BORE
    return _RIM


@njit(**_OPTIONS)
def _edge_against_rim(which, co, si, rim):
    """Depth and normal where a rim has crossed an edge, at the rim's point nearest to the edge.

    Two edges meet in a point; what can part them is perpendicular to both tangents. The edge's own is the
    circumference, so the normal lies in the half-plane, perpendicular to the rim's tangent there.

    Returns
    -------
    distance, normal_rho, normal_z, co, si : float
    """
    edge_rho, edge_z = _edge_place(which, rim[4])
    _, _, z, rho, d_rho, d_z = _rim_point(co, si, rim)
    for _ in range(4):  # Gauss-Newton
        step = -((rho - edge_rho) * d_rho + (z - edge_z) * d_z) / (d_rho * d_rho + d_z * d_z)
        step = min(max(step, -_SPACING), _SPACING)
        scale = 1.0 / math.sqrt(1.0 + step * step)
        co, si = (co - step * si) * scale, (si + step * co) * scale
        _, _, z, rho, d_rho, d_z = _rim_point(co, si, rim)
    scale = math.copysign(1.0 / math.sqrt(d_rho * d_rho + d_z * d_z), d_rho + d_z)  # out of the block
    normal_rho, normal_z = -d_z * scale, d_rho * scale
    return (rho - edge_rho) * normal_rho + (z - edge_z) * normal_z, normal_rho, normal_z, co, si


@njit(**_OPTIONS)
def _rim_contacts(rim, margin, rows, n):
    """Contacts of one rim with the block (bottom apart)."""
    _, center, r, tilt, hole = rim
    outer = math.sqrt(center[0] * center[0] + center[1] * center[1]) + r
    if not profile_distance(outer, center[2] - r * tilt[0], hole[0], hole[1])[0] < margin:
        return n  # the profile's distance falls with ρ and grows with z: nowhere closer than this
    for i in range(n, _circle_minima(rim, r, margin, rows, n)):
        co, si = rows[i, 7], rows[i, 8]
        x, y, z, rho, d_rho, d_z = _rim_point(co, si, rim)
        if z < -hole[2] and hole[3] == 0.0:
            continue  # below the open end
        distance, normal_rho, normal_z = profile_distance(rho, z, hole[0], hole[1])
        which = _crossed_edge(rho, z, d_rho, d_z, rim) if distance < 0.0 else _RIM
        if which != _RIM:
            depth, across_rho, across_z, new_co, new_si = _edge_against_rim(which, co, si, rim)
            if _within_cone(which, across_rho, across_z):  # else the rim only grazes the edge
                distance, normal_rho, normal_z = depth, across_rho, across_z
                x, y, z, rho, _, _ = _rim_point(new_co, new_si, rim)
        normal = (normal_rho * x / rho, normal_rho * y / rho, normal_z)
        if distance < margin:
            n = _write(rows, n, distance, (x, y, z), normal, -0.5)
    return n


@njit(**_OPTIONS)
def _bottom_contacts(rim, margin, rows, n):
    """Contacts of one rim with the bottom of a blind hole: its lowest point and the other three quarters."""
    _, center, r, tilt, hole = rim
    if hole[3] != 0.0 and center[2] - r * tilt[0] + hole[2] < margin:
        for k in range(0, _SAMPLES, _SAMPLES // 4):
            x, y, z, _, _, _ = _rim_point(_COS[k], _SIN[k], rim)
            if z + hole[2] < margin:
                n = _write(rows, n, z + hole[2], (x, y, z), (0.0, 0.0, 1.0), -0.5)
    return n


@njit(**_OPTIONS)
def _within_cone(which, normal_rho, normal_z):
    """Whether the block at edge ``which`` (0 mouth, 1 bore, 2 lower) has a normal in this direction."""
    if which == _MOUTH:
        return normal_z > -normal_rho - _SLACK and normal_rho < _SLACK
    if which == _BORE:
        return normal_z > -_SLACK and normal_z < -normal_rho + _SLACK
    return normal_z < _SLACK and normal_rho < _SLACK


@njit(**_OPTIONS)
def _edge_contacts(which, position, tilt, peg, hole, margin, rows, n):
    """Contacts of the peg's side with one edge of the hole."""
    sine, cosine = tilt
    r, half = peg
    edge_rho, edge_z = _edge_place(which, hole)
    if abs(edge_z - position[2]) > half * cosine + r * sine:
        return n
    center = (cosine * position[0] + sine * (edge_z - position[2]), position[1], 0.0)
    inner = cosine * edge_rho - math.sqrt(center[0] * center[0] + center[1] * center[1]) - r
    if inner >= margin:
        return n  # the circle inscribed in the ellipse is nowhere closer than this
    edge = (which, center, r, tilt, hole)
    for i in range(n, _circle_minima(edge, edge_rho, margin, rows, n)):
        co, si = rows[i, 7], rows[i, 8]
        x, y, z = edge_rho * co - position[0], edge_rho * si - position[1], edge_z - position[2]
        along = sine * x + cosine * z
        x, z = x - sine * along, z - cosine * along
        length = math.sqrt(x * x + y * y + z * z)
        distance = length - r
        if abs(along) > half + min(distance, 0.0):
            continue  # beyond the peg's end, or deep in the peg but nearer its end than its side: the rim's
        normal = (-x / length, -y / length, -z / length)
        if distance < margin and _within_cone(which, normal[0] * co + normal[1] * si, normal[2]):
            n = _write(rows, n, distance, (edge_rho * co, edge_rho * si, edge_z), normal, 0.5)
    return n


def _contacts(rows, position, axis, peg, hole, margin):
    """Find the contacts in the aligned frame and turn them back; see :func:`contacts`."""
    total = position[0] + position[1] + position[2] + axis[0] + axis[1] + axis[2]
    if not math.isfinite(total):
        return 0
    flip = -1.0 if axis[2] < 0.0 else 1.0  # a cylinder has no head
    sine, cosine = math.sqrt(axis[0] * axis[0] + axis[1] * axis[1]), flip * axis[2]
    r, half = peg
    if position[2] - half * cosine - r * sine >= margin:
        return 0
    ex, ey = (flip * axis[0] / sine, flip * axis[1] / sine) if sine > 0.0 else (1.0, 0.0)
    center = (ex * position[0] + ey * position[1], ex * position[1] - ey * position[0], position[2])
    tilt = (sine, cosine)
    n = 0
    for end in (-half, half):
        rim = (_RIM, (center[0] + end * sine, center[1], center[2] + end * cosine), r, tilt, hole)
        n = _rim_contacts(rim, margin, rows, n)
        n = _bottom_contacts(rim, margin, rows, n)
    # An upright side has no normal within the cone of the mouth's edge, and a blind hole no lower edge.
    for which in range(_MOUTH if sine > _HALF - _SLACK else _BORE, _RIM if hole[3] == 0.0 else _LOWER):
        n = _edge_contacts(which, center, tilt, peg, hole, margin, rows, n)
    for i in range(n):
        for c in (1, 4):
            x, y = rows[i, c], rows[i, c + 1]
            rows[i, c], rows[i, c + 1] = ex * x - ey * y, ey * x + ex * y
    return n


def _compile(function: Any) -> Any:
    """Compile at the first call and keep the result on disk, where numba finds a folder that it may write to."""
    try:
        return njit(cache=True, **_OPTIONS)(function)
    except RuntimeError:
        return njit(**_OPTIONS)(function)


contacts: Any = _compile(_contacts)
"""Compiled ``contacts(rows, position, axis, peg, hole, margin) -> count``."""
