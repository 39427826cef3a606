"""Gains at which a root of ``f₀(s) + κ f₁(s)`` reaches the imaginary axis, or roots on it meet: exact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

REAL = 1e-7
"""Imaginary part, relative, at which a root counts as real."""
NOTHING = 1e-13
"""Share of the largest coefficient that is rounding."""
VANISHED = 1e-6
"""Share of the terms of f₁ at which it is zero: there κ is infinite."""


class Edge(NamedTuple):
    """A gain with a root on the axis, and its frequency."""

    gain: float
    frequency: float


def axis_crossings(first: np.ndarray, second: np.ndarray) -> list[Edge]:
    """All edges with κ > 0, in order, of polynomials f₀, f₁ with the highest power first.

    κ = −f₀(jω)/f₁(jω) is real at an edge: ``Im f₀(jω) f₁(−jω) = 0``, a polynomial in ω. Where it is zero throughout
    (nothing dissipates) roots stay on the axis until two of them meet: then ``dκ/dω = 0``.
    """
    size = max(len(first), len(second))
    first, second = (np.concatenate([np.zeros(size - len(p)), p]) for p in (first, second))
    turned = 1j ** np.arange(size - 1, -1, -1)
    on_axis = first * turned, second * turned
    product = np.convolve(on_axis[0], np.conj(on_axis[1]))
    if np.abs(product.imag).max() > NOTHING * np.abs(product).max():
        frequencies = _real_roots(product.imag)
    else:
        # κ(ω) = −P/|f₁|² with the real polynomial P: P′ |f₁|² = P (|f₁|²)′
        size_squared = np.convolve(on_axis[1], np.conj(on_axis[1])).real
        frequencies = _real_roots(
            np.polysub(
                np.polymul(np.polyder(product.real), size_squared),
                np.polymul(product.real, np.polyder(size_squared)),
            )
        )
    edges = []
    for frequency in [0.0, *frequencies]:
        below = np.polyval(second, 1j * frequency)
        if abs(below) > VANISHED * np.polyval(np.abs(second), frequency):
            gain = float((-np.polyval(first, 1j * frequency) / below).real)
            if 0 < gain < np.inf:
                edges.append(Edge(gain, frequency))
    return sorted(edges)


def _real_roots(polynomial: np.ndarray) -> list[float]:
    """Positive real roots, each once."""
    kept = np.flatnonzero(np.abs(polynomial) > NOTHING * np.abs(polynomial).max())
    if not len(kept):
        return []
    roots = np.roots(polynomial[kept[0] :])
    real = roots[np.abs(roots.imag) <= REAL * np.maximum(np.abs(roots), 1e-12)].real
    return [float(w) for w in np.unique(real[real > 1e-9])]
