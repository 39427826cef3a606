"""Where along a circle a peg and a bore come closest.

Samples show between which of them the distance has a minimum; a bracketed search finds it. Directions are unit
vectors, so no angle is computed, and they are written into the rows of the contacts, so nothing is allocated.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from vic_toolbox.tasks.bore import HALF, MOUTH, OPTIONS, RIM, edge_place, gap, rim_point

_SAMPLES = 24
_SPACING = 2.0 * math.pi / _SAMPLES
_COS, _SIN = np.cos(_SPACING * np.arange(_SAMPLES)), np.sin(_SPACING * np.arange(_SAMPLES))
_TAN = math.tan(_SPACING)
_MINIMA = 8  # local minima that one circle may have
_SUPPORTS = 4  # contacts that hold a rim which touches along a wide arc
_APART = math.cos(math.radians(59.0))  # how far apart these are
_BESIDE = math.cos(math.radians(30.0))  # how far the companions of a minimum are from other contacts
_FLAT = 1e-9  # |slope| / radius at a minimum
_NARROW = 1e-9  # width [rad] of a bracket that has closed on a kink


@njit(**OPTIONS)
def closest_directions(circle, length, margin, rows, first):
    """Directions on a circle where it comes closer than ``margin``, written to columns 7 and 8 of ``rows``.

    They are the minima of the distance, and more where it is small along a wide arc. ``length`` is the circle's
    radius: it bounds the slope, hence how low the distance can be between two samples.

    Returns
    -------
    int
        Row after the last; the first is row ``first``.
    """
    end, below, best, lowest = first, 0, 0, math.inf
    flat, reach = _FLAT * length, _SPACING * length
    fa, sa = gap(_COS[_SAMPLES - 1], _SIN[_SAMPLES - 1], circle)
    for k in range(_SAMPLES):
        fb, sb = gap(_COS[k], _SIN[k], circle)
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
    if below < _SAMPLES // 8:  # an arc of less than 45°
        return end
    if circle[0] == RIM:
        supported = _spread(circle, margin, rows, first, end)
        if supported > end:
            return supported
    return _companions(circle, margin, rows, first, end)


@njit(**OPTIONS)
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
        f, slope = gap((co - x * si) * scale, (si + x * co) * scale, circle)
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


@njit(**OPTIONS)
def _companions(circle, margin, rows, first, end):
    """Add the directions 45° to either side of each minimum where the circle touches there too.

    Where a circle overlaps along a wide arc, its deepest point turns around the bore faster than one contact could
    hold it.
    """
    for i in range(first, end):
        for side in (-HALF, HALF):
            co = HALF * rows[i, 7] - side * rows[i, 8]
            si = HALF * rows[i, 8] + side * rows[i, 7]
            nearest = -1.0
            for j in range(first, end):
                nearest = max(nearest, rows[j, 7] * co + rows[j, 8] * si)
            if nearest < _BESIDE and end < first + _MINIMA and gap(co, si, circle)[0] < margin:
                rows[end, 7], rows[end, 8] = co, si
                end += 1
    return end


@njit(**OPTIONS)
def _spread(rim, margin, rows, first, end):
    """Add directions where a wide arc of a rim lies on the top plane: the farthest from those chosen, if 60° away.

    A peg that stands flat needs them: one minimum would not hold it.
    """
    mouth, _ = edge_place(MOUTH, rim[4])
    while end < first + _SUPPORTS:
        farthest, place = _APART, -1
        for k in range(_SAMPLES):
            nearest = -1.0
            for i in range(first, end):
                nearest = max(nearest, rows[i, 7] * _COS[k] + rows[i, 8] * _SIN[k])
            if nearest < farthest - 1e-12:
                _, _, z, rho, _, _ = rim_point(_COS[k], _SIN[k], rim)
                if z < margin and rho > mouth:
                    farthest, place = nearest, k
        if place < 0:
            break
        rows[end, 7], rows[end, 8] = _COS[place], _SIN[place]
        end += 1
    return end
