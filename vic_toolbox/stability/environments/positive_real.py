"""Positive realness of a rational function: poles, residues on the axis, and the least real part, all exact."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SAME = 1e-8
"""Distance at which a pole meets a zero, or the axis; rates are of order one."""
TWINS = 1e-6
"""Distance at which rounding may have split a repeated pole."""
ZERO = 1e-9
"""Share of the size of a function or a residue that is rounding."""
SWEPT = 4000
"""Frequencies of the second route."""


class Rational(NamedTuple):
    """``n(s)/d(s)``, highest power first, d monic, no common roots."""

    top: np.ndarray
    bottom: np.ndarray

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Its value at s."""
        return np.polyval(self.top, s) / np.polyval(self.bottom, s)


class PositiveReal(NamedTuple):
    """What decides whether a rational function is positive real.

    Parameters
    ----------
    unstable : float
        Largest real part of a pole, if one is on the right; else 0.
    double : float
        Frequency of a repeated pole on the axis; NaN if there is none.
    residue : float
        Least residue at a pole on the axis (infinity is one too, with its slope), over the largest; 0 if it is
        rounding, −inf if one is not real; +inf if there are none.
    least : float
        Infimum of ``Re G(jω)``; −inf without the conditions above.
    frequency : float
        Where it is (inf: at infinity).
    swept : float
        The same by evaluation on a grid: the second route.
    """

    unstable: float
    double: float
    residue: float
    least: float
    frequency: float
    swept: float

    @property
    def passive(self) -> bool:
        """Whether the function is positive real."""
        return self.least >= 0


def rational(top: np.ndarray, bottom: np.ndarray) -> Rational:
    """The fraction without common roots and leading zeros."""
    top, bottom = (np.trim_zeros(np.asarray(p, dtype=np.float64), "f") for p in (top, bottom))
    if not len(top):
        return Rational(np.zeros(1), np.ones(1))
    zeros, poles = list(np.roots(top)), list(np.roots(bottom))
    gain = top[0] / bottom[0]
    kept = []
    for pole in poles:
        near = [abs(pole - zero) for zero in zeros]
        if near and min(near) <= SAME * max(1.0, abs(pole)):
            zeros.pop(int(np.argmin(near)))
        else:
            kept.append(pole)
    if len(kept) == len(poles):  # nothing in common: keep the coefficients as they are
        return Rational(top / bottom[0], bottom / bottom[0])
    return Rational(gain * _polynomial(zeros), _polynomial(kept))


def positive_real(function: Rational) -> PositiveReal:
    """Test a rational function whose rates are of order one.

    G is positive real iff no pole is on the right, poles on the axis (and at infinity) are simple with positive
    residues, and ``Re G(jω) ≥ 0`` elsewhere. The poles on the axis are split off; of the rest
    ``Re G = N(ω²)/|d(jω)|²``, whose stationary points are roots of a polynomial.
    """
    nothing = PositiveReal(0.0, np.nan, np.inf, -np.inf, np.nan, -np.inf)
    poles = np.roots(function.bottom)
    size = np.maximum(1.0, np.abs(poles))
    apart = np.abs(poles[:, None] - poles) + 1e9 * np.eye(len(poles))
    twins = (np.abs(poles.real) <= TWINS * size) & (apart.min(axis=1, initial=1e9) <= TWINS * size)
    if twins.any():
        return nothing._replace(double=abs(float(poles.imag[twins][0])))
    if (poles.real > SAME * size).any():
        return nothing._replace(unstable=float(poles.real.max()))
    on_axis = np.abs(poles.real) <= SAME * size
    frequencies = np.sort(poles.imag[on_axis & (poles.imag >= -SAME)])
    frequencies = np.where(frequencies < SAME, 0.0, frequencies)
    if len(function.top) - len(function.bottom) > 1:
        return nothing._replace(double=np.inf)
    rest, residues = _without_axis(function, frequencies, poles[~on_axis])
    largest = max((abs(r) for r in residues), default=0.0)
    if residues and max(abs(np.imag(r)) for r in residues) > TWINS * largest:
        return nothing._replace(residue=-np.inf)
    least_residue = min((float(np.real(r)) / largest for r in residues), default=np.inf)
    if least_residue < -ZERO:
        return nothing._replace(residue=least_residue)
    least, frequency = _least_real_part(rest)
    grid = np.concatenate([[0.0], np.geomspace(1e-5, 1e5, SWEPT)])
    if np.isfinite(frequency):
        grid = np.append(grid, frequency * (1 + np.linspace(-1e-3, 1e-3, 101)))
    value = rest(1j * grid)
    swept = float(np.where(np.abs(np.real(value)) <= ZERO * np.abs(value), 0.0, np.real(value)).min())
    return PositiveReal(0.0, np.nan, least_residue, least, frequency, swept)


def _without_axis(
    function: Rational, frequencies: np.ndarray, others: np.ndarray
) -> tuple[Rational, list[complex]]:
    """What is left of G without its poles on the axis and at infinity, and their residues."""
    top, bottom = function
    slope = np.polyder(bottom)
    residues, lossless = [], np.ones(1)
    terms = []
    for frequency in frequencies:
        residue = complex(np.polyval(top, 1j * frequency) / np.polyval(slope, 1j * frequency))
        residues.append(residue)
        factor = np.array([1.0, 0.0, frequency**2]) if frequency > 0 else np.array([1.0, 0.0])
        terms.append((residue.real * (np.array([2.0, 0.0]) if frequency > 0 else np.ones(1)), factor))
        lossless = np.polymul(lossless, factor)
    if len(top) > len(bottom):
        residues.append(complex(top[0] / bottom[0]))
        top = np.polysub(top, np.polymul([top[0] / bottom[0], 0.0], bottom))
        top = top[-len(bottom) :]
    stable = _polynomial(others)
    for term, factor in terms:
        share = np.polydiv(lossless, factor)[0]
        top = np.polysub(top, np.polymul(np.polymul(term, share), stable))
    left = np.polydiv(top, lossless)[0] if len(lossless) > 1 else top
    return Rational(np.atleast_1d(left), stable), residues


def _least_real_part(function: Rational) -> tuple[float, float]:
    """Infimum of ``Re n(jω)/d(jω)`` for a stable and proper fraction, and its ω."""
    top, bottom = (_even_odd(p) for p in function)
    # n = a + jω b and d = c + jω e with polynomials of w = ω²: Re n d̄ = a c + w b e
    power = np.polyadd(np.polymul(top[0], bottom[0]), np.polymul([1.0, 0.0], np.polymul(top[1], bottom[1])))
    size = np.polyadd(
        np.polymul(bottom[0], bottom[0]), np.polymul([1.0, 0.0], np.polymul(bottom[1], bottom[1]))
    )
    stationary = np.polysub(np.polymul(np.polyder(power), size), np.polymul(power, np.polyder(size)))
    stationary = np.trim_zeros(
        np.where(np.abs(stationary) > 1e-14 * np.abs(stationary).max(), stationary, 0.0), "f"
    )
    roots = np.roots(stationary) if len(stationary) > 1 else np.zeros(0)
    squares = roots[np.abs(roots.imag) <= 1e-6 * np.maximum(1e-9, np.abs(roots))].real
    squares = np.concatenate([[0.0], squares[squares > 0]])
    values = np.polyval(power, squares)
    values[np.abs(values) <= ZERO * np.polyval(np.abs(power), squares)] = 0.0
    values /= np.polyval(size, squares)
    best = int(np.argmin(values))
    degree = len(function.bottom) - len(function.top)
    at_infinity = function.top[0] / function.bottom[0] if degree == 0 else 0.0
    # at infinity it is a limit; "at infinity" only where no finite frequency is as low
    if at_infinity < values[best] - 1e-15 * abs(values[best]):
        return float(at_infinity), np.inf
    return float(values[best]), float(np.sqrt(squares[best]))


def _polynomial(roots: np.ndarray | list) -> np.ndarray:
    return np.atleast_1d(np.real(np.poly(roots))) if len(roots) else np.ones(1)


def _even_odd(polynomial: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``p(jω) = even(ω²) + jω odd(ω²)``."""
    ascending = polynomial[::-1]
    signs = (-1.0) ** np.arange(len(ascending))
    even, odd = ascending[0::2], ascending[1::2]
    return (
        (even * signs[: len(even)])[::-1],
        (odd * signs[: len(odd)])[::-1] if len(odd) else np.zeros(1),
    )
