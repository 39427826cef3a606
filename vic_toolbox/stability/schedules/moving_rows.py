"""The inequalities with a moving mass as matrices of twice the size, ``A + α B ⪰ 0``, packed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.definite import lower, size


class Rows:
    """Values and slopes of M, K, D (and C), at samples, at instants, or as Bernstein coefficients."""

    def __init__(self, values: Sequence[Array], slopes: Sequence[Array]) -> None:
        self.m, self.k, self.d, *rest = values
        self.m_slope, self.k_slope, self.d_slope = slopes[:3]
        self.c = rest[0] if rest else None

    def falling(self) -> tuple[Array, Array]:
        """``−V̇ ⪰ 0`` as A + α B, packed (2 d, 2 d)."""
        order = size(self.m)
        if self.c is None:
            damping, coupling = self.d - 0.5 * self.m_slope, _square(self.m_slope)
        else:
            transposed = np.arange(order * order).reshape(order, order).T.reshape(-1)
            damping, coupling = self.d + 0 * self.m, self.c[transposed]
        zero = np.zeros((order * order, 1))
        a = _blocks(damping, zero, -0.5 * self.k_slope)
        return _same(a, _blocks(-self.m, -0.5 * coupling, self.k - 0.5 * self.d_slope))

    def storage(self) -> tuple[Array, Array]:
        """``V ≻ 0`` as A + α B."""
        zero = np.zeros((size(self.m) ** 2, 1))
        return _same(_blocks(self.m, zero, self.k), _blocks(0 * self.m, _square(self.m), self.d))

    def damped(self) -> tuple[Array, Array]:
        """``D − ½ Ṁ − α M``, or ``D − α M``."""
        return _same(self.d - (0.5 * self.m_slope if self.c is None else 0 * self.m_slope), -self.m)


def _square(packed: Array) -> Array:
    """All d² entries, row by row, of packed symmetric ones."""
    order = size(packed)
    index = np.empty((order, order), np.intp)
    rows, columns = lower(order)
    index[rows, columns] = index[columns, rows] = np.arange(len(packed))
    return packed[index.reshape(-1)]


def _blocks(first: Array, below: Array, second: Array) -> Array:
    """Packed [[first, ·], [below, second]] of packed, all (row by row) and packed entries."""
    order = size(first)
    width = max(first.shape[1], below.shape[1], second.shape[1])
    rows, columns = lower(2 * order)
    packed = np.empty((len(rows), width))
    corner = rows >= order
    packed[~corner] = first
    inner = corner & (columns >= order)
    packed[inner] = second
    edge = corner & (columns < order)
    packed[edge] = below[(rows[edge] - order) * order + columns[edge]]
    return packed


def _same(a: Array, b: Array) -> tuple[Array, Array]:
    width = max(a.shape[1], b.shape[1])
    shape = (len(a), width)
    return np.broadcast_to(a, shape), np.broadcast_to(b, shape)
