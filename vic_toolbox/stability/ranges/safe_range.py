"""How far a stiffness may vary: the largest range that is still proved, by bisection."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, one_of, positive
from vic_toolbox.stability.arguments import impedance
from vic_toolbox.stability.ranges.common_lyapunov import certified, common_lyapunov
from vic_toolbox.stability.ranges.gain_box import gain_box
from vic_toolbox.stability.ranges.switching import critical_damping, worst_case_switching
from vic_toolbox.stability.verdict import Verdict

WIDEST = 1e9
"""Largest factor that is looked for."""
METHODS, SIDES, TOGETHER = ("switching", "common_lyapunov"), ("up", "around"), ("each", "all")


@threadpool_limits.wrap(limits=1, user_api="blas")
def safe_range(
    mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    side: str = "up",
    vary: str = "each",
    method: str | None = None,
    tolerance: float = 1e-4,
) -> Verdict:
    """Find the largest factor ρ such that the stiffness may change anyhow between K and ρ K, or K/ρ and ρ K.

    Ranges are nested, so what holds for one holds for every smaller one, and bisection finds the edge. It returns the
    verdict on the largest range, which is proved, with the range in its values.

    Parameters
    ----------
    mass, damping : float or (d, d)
        M ≻ 0 and D ⪰ 0, constant [kg, Ns/m].
    stiffness : float or (d, d)
        K ≻ 0 where the range begins [N/m, Nm/rad].
    side : {'up', 'around'}, optional
        From K to ρ K, or from K/ρ to ρ K.
    vary : {'each', 'all'}, optional
        Each diagonal entry on its own (K must be diagonal; 2^d vertices), or the whole matrix with one factor.
    method : {'switching', 'common_lyapunov'}, optional
        *switching* is exact and for one degree of freedom, where it is the default; else a common quadratic Lyapunov
        function, which is enough but not necessary.
    tolerance : float, optional
        Of ρ, relative.

    Returns
    -------
    Verdict
        Values of the method, and ``factor`` ρ, ``stiffness_low``, ``stiffness_high`` [N/m, Nm/rad]. If not even K
        itself is proved, the verdict on K, with ``factor`` NaN.

    Raises
    ------
    InputError
        Matrices that do not fit the question, an unknown option, a tolerance that is not positive.
    """
    one_of("side", side, SIDES)
    one_of("vary", vary, TOGETHER)
    tolerance = positive("tolerance", tolerance)
    given = impedance(mass, stiffness, damping)
    if any(a.ndim == 3 and len(a) > 1 for a in given):
        raise InputError(
            "several samples were passed; pass one mass, stiffness and damping: the range is looked for."
        )
    m, k, b = (a.reshape(a.shape[-2:]) for a in given)
    d = len(k)
    method = one_of("method", method or ("switching" if d == 1 else "common_lyapunov"), METHODS)
    if method == "switching" and d > 1:
        raise InputError(f"switching is for one degree of freedom, not {d}; pass method='common_lyapunov'.")
    if np.linalg.eigvalsh(k)[0] <= 0:
        raise InputError("stiffness must be positive definite: a factor does not widen a zero.")
    if vary == "each" and np.abs(k - np.diag(np.diag(k))).max() > 0:
        raise InputError(
            "stiffness is not diagonal, so its entries cannot vary on their own; pass vary='all'."
        )

    def ends(factor: float) -> tuple[Array, Array]:
        return (k / factor if side == "around" else k), k * factor

    def vertices(factor: float) -> Array:
        low, high = ends(factor)
        if vary == "all":
            return np.stack([low, high])
        box = gain_box((np.diag(low), np.diag(high)))
        assert isinstance(box, np.ndarray)
        return box

    def safe(factor: float) -> bool:
        if method == "switching":
            low, high = (float(end[0, 0]) for end in ends(factor))
            return float(b[0, 0]) > critical_damping(float(m[0, 0]), low, high)
        return certified(m, vertices(factor), b)

    factor = _largest(safe, tolerance)
    if method == "switching":
        low, high = (float(end[0, 0]) for end in ends(factor if factor > 1 else 1.0))
        verdict = worst_case_switching(float(m[0, 0]), (low, high), float(b[0, 0]))
    else:
        verdict = common_lyapunov(m, vertices(max(factor, 1.0)), b)
    low, high = (e if d > 1 else e[0, 0] for e in ends(factor))
    values = {**verdict.values, "factor": factor, "stiffness_low": low, "stiffness_high": high}
    return replace(verdict, values=values)


def _largest(safe, tolerance: float) -> float:
    """Largest factor that is safe, to the tolerance; NaN if not even one is."""
    if not safe(1.0):
        return math.nan
    low, high = 0.0, math.log(2.0)
    while safe(math.exp(high)):
        low, high = high, 2 * high
        if high > math.log(WIDEST):
            return math.exp(low)
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if safe(math.exp(middle)) else (low, middle)
    return math.exp(low)
