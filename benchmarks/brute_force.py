"""Distance of a cylinder to a block with a round hole by brute force, as a judge of the analytic collider.

It shares neither code nor idea with :mod:`vic_toolbox.tasks.bore`: points all over the peg's surface, finer and finer
around the best, and their distance to the block's outline as a polygon in the half-plane (ρ, z).
"""

from __future__ import annotations

import itertools

import numpy as np
from scipy import optimize

Array = np.ndarray
FAR = 1.0
"""Where the outline's horizontal lines end [m]."""

NEAR = 0.02
"""Size of a point's neighbourhood, as a share of the peg's radius."""

POINTS = 41
"""Points of a grid along each coordinate."""

SIDE, LOWER_FACE, UPPER_FACE = range(3)


def block_distance(points: Array, hole: tuple[float, float, float, float]) -> Array:
    """Signed distance [m] of points (..., 3) to the block around a hole (radius, chamfer, depth, closed)."""
    radius, chamfer, depth, closed = hole
    rho, z = np.hypot(points[..., 0], points[..., 1]), points[..., 2]
    mouth = [(FAR, 0.0), (radius + chamfer, 0.0), (radius, -chamfer), (radius, -depth)]
    outline = np.array([*mouth, (0.0 if closed else FAR, -depth)])
    distance = np.full(rho.shape, np.inf)
    for start, stop in itertools.pairwise(outline):
        along = stop - start
        place = ((rho - start[0]) * along[0] + (z - start[1]) * along[1]) / (along @ along)
        place = np.clip(place, 0.0, 1.0)
        distance = np.minimum(
            distance, np.hypot(rho - start[0] - place * along[0], z - start[1] - place * along[1])
        )
    wall = (rho > radius) & (rho - radius > z + chamfer)
    inside = (z < 0.0) & ((wall | (z < -depth)) if closed else (wall & (z > -depth)))
    return np.where(inside, -distance, distance)


Peg = tuple[float, float]
"""Radius and half length [m]."""
Hole = tuple[float, float, float, float]
"""Radius, chamfer, depth [m], and 1 if it is closed."""


def closest(
    windows: Array, surface: Array, position: Array, axis: Array, *, peg: Peg, hole: Hole, levels: int
) -> tuple[Array, Array]:
    """Smallest signed distance to the block over windows on the peg's surface, by grids around the best point.

    Parameters
    ----------
    windows : ndarray, shape (n, 2, 2)
        From and to of two coordinates: the angle [rad], and the height along the axis (side) or the distance from
        the axis (faces) [m].
    surface : ndarray of int, shape (n,)
        ``SIDE``, ``LOWER_FACE`` or ``UPPER_FACE``.
    position, axis : ndarray, shape (3,)
        Centre and axis of the peg in the hole's frame.
    levels : int
        How often a grid is laid; each has two fifths of the width of the last.

    Returns
    -------
    distance : ndarray, shape (n,)
        One for each window [m].
    place : ndarray, shape (n, 2)
        Where, in the window's coordinates.
    """
    limits = np.where(surface[:, None] == SIDE, [-peg[1], peg[1]], [0.0, peg[0]])
    span = np.linspace(0.0, 1.0, POINTS)
    windows, every = np.array(windows, dtype=float), np.arange(len(windows))
    kind = surface[:, None, None]
    for _ in range(levels):
        low, size = windows[:, :, 0], windows[:, :, 1] - windows[:, :, 0]
        grid = low[:, :, None] + size[:, :, None] * span
        angle, other = grid[:, 0, :, None], grid[:, 1, None, :]
        points = surface_points(angle, other, kind, axis, peg) + position
        distance = block_distance(points, hole).reshape(len(windows), -1)
        best = distance.argmin(axis=1)
        place = np.stack([grid[every, 0, best // POINTS], grid[every, 1, best % POINTS]], axis=1)
        step = 0.2 * size
        windows = np.stack([place - step, place + step], axis=2)
        windows[:, 1] = np.clip(windows[:, 1], limits[:, :1], limits[:, 1:])
    return distance[every, best], place


def surface_points(angle: Array, other: Array, kind: Array, axis: Array, peg: Peg) -> Array:
    """Points (..., 3) of the peg's surface about its centre, from the coordinates of :func:`closest`."""
    radius, half = peg
    third, first, second = frame(axis)
    out = np.where(kind == SIDE, radius, other) + 0.0 * angle
    height = np.where(kind == SIDE, other, np.where(kind == LOWER_FACE, -half, half)) + 0.0 * angle
    across = (out * np.cos(angle))[..., None] * first + (out * np.sin(angle))[..., None] * second
    return across + height[..., None] * third


def frame(axis: Array) -> Array:
    """An orthonormal frame (3, 3) whose first row is the axis."""
    third = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    first = np.cross(third, np.eye(3)[np.abs(third).argmin()])
    first /= np.linalg.norm(first)
    return np.stack([third, first, np.cross(third, first)])


def peg_distance(position: Array, axis: Array, *, peg: Peg, hole: Hole) -> float:
    """Distance of the whole peg to the block [m]; exact where the two do not overlap.

    Along the hole's edges the distance has narrow curved valleys, in which grids lose their way: from the best few
    windows a simplex walks on.
    """
    radius, half = peg
    rim = 0.15 * radius
    heights = [(-half, -half + rim), (-half + rim, -half + 0.4 * radius), (-half + 0.4 * radius, half)]
    faces = [(radius - rim, radius), (0.0, radius - rim)]
    parts = (
        [(SIDE, part) for part in heights] + [(LOWER_FACE, part) for part in faces] + [(UPPER_FACE, faces[0])]
    )
    angles = np.arange(12) * np.pi / 6.0
    windows = np.array([[(angle - 0.3, angle + 0.3), part] for angle in angles for _, part in parts])
    surface = np.array([kind for _ in angles for kind, _ in parts])
    found, places = closest(windows, surface, position, axis, peg=peg, hole=hole, levels=7)
    best = float(found.min())
    for window in found.argsort()[:4]:
        best = min(best, _walk(places[window], int(surface[window]), position, axis, peg, hole))
    return best


def _walk(start: Array, kind: int, position: Array, axis: Array, peg: Peg, hole: Hole) -> float:
    """Smallest distance that a simplex finds from a place on the peg's surface."""
    low, high = (-peg[1], peg[1]) if kind == SIDE else (0.0, peg[0])

    def distance(place: Array) -> float:
        angle, other = place[0] / peg[0], np.clip(place[1], low, high)
        return float(block_distance(surface_points(angle, other, np.array(kind), axis, peg) + position, hole))

    origin = np.array([start[0] * peg[0], start[1]])
    for size in (3e-4, 3e-5):
        simplex = origin + size * np.array([[0.0, 0.0], [1.0, 0.3], [-0.3, 1.0]])
        options = {"initial_simplex": simplex, "xatol": 1e-9, "fatol": 1e-12, "maxiter": 300}
        origin = optimize.minimize(distance, origin, method="Nelder-Mead", options=options).x
    return distance(origin)


def gap_near(point: Array, position: Array, axis: Array, *, peg: Peg, hole: Hole) -> float:
    """Distance of the part of the peg's surface around a point (in the hole's frame) to the block [m]."""
    radius, half = peg
    height, x, y = frame(axis) @ (np.asarray(point) - position)
    angle, out, reach = np.arctan2(y, x), np.hypot(x, y), NEAR * radius
    sector = (angle - NEAR, angle + NEAR)
    windows = [[sector, np.clip([height - reach, height + reach], -half, half)]]
    surface = [SIDE]
    if abs(height) > half - 2.0 * reach:
        windows.append([sector, np.clip([out - reach, out + reach], 0.0, radius)])
        surface.append(LOWER_FACE if height < 0 else UPPER_FACE)
    found, _ = closest(np.array(windows), np.array(surface), position, axis, peg=peg, hole=hole, levels=13)
    return float(found.min())
