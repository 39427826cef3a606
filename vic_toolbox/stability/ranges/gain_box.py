"""The corners of a box of diagonal gains, as the vertices that a certificate over a range needs."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array

MOST = 4096
"""Corners: more make the certificate too slow."""


def gain_box(*ranges: tuple[ArrayLike, ArrayLike]) -> Array | tuple[Array, ...]:
    """All corners of a box: each diagonal entry at its lowest or its highest, paired over the gains.

    Parameters
    ----------
    *ranges : tuple of array_like
        (lowest, highest) of each gain: numbers, or diagonals (d,) [N/m, Nm/rad or Ns/m, Nms/rad]. An entry whose ends
        are equal does not vary.

    Returns
    -------
    ndarray (n, d, d), or tuple of them
        One for each range, n = 2 to the number of entries that vary. So
        ``common_lyapunov(mass, *gain_box((k_low, k_high), (b_low, b_high)))`` covers every K and B within.

    Raises
    ------
    InputError
        Ends of different length, a low end above its high end, or more than 4096 corners.
    """
    ends = []
    for index, (low, high) in enumerate(ranges):
        first, last = (np.atleast_1d(finite_array(f"range {index}", end)) for end in (low, high))
        if first.ndim != 1 or first.shape != last.shape or (first > last).any():
            raise InputError(
                f"range {index} goes from {low} to {high}; pass (lowest, highest) numbers or diagonals (d,), "
                "of one length, the lowest not above the highest."
            )
        ends.append(np.stack([first, last]))
    if not ends or len({end.shape for end in ends}) > 1:
        raise InputError(
            f"got {len(ends)} ranges of {[e.shape[1] for e in ends]} entries; pass one or more, alike."
        )
    flat = np.concatenate(ends, axis=1)
    varying = np.flatnonzero(flat[0] < flat[1])
    if len(varying) > math.log2(MOST):
        raise InputError(
            f"{len(varying)} entries vary: 2^{len(varying)} corners; let at most {int(math.log2(MOST))} vary, or "
            "certify groups of axes that do not act on each other one by one."
        )
    corners = np.tile(flat[0], (2 ** len(varying), 1))
    bits = np.arange(len(corners))[:, None] >> np.arange(len(varying)) & 1
    corners[:, varying] = np.where(bits, flat[1, varying], flat[0, varying])
    d = ends[0].shape[1]
    boxes = tuple(corners[:, i * d : (i + 1) * d, None] * np.eye(d) for i in range(len(ends)))
    return boxes[0] if len(boxes) == 1 else boxes
