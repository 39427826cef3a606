"""The smallest damping with which a method proves stability, by bisection on a factor."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vic_toolbox.errors import InputError, Number, positive
from vic_toolbox.stability.verdict import Verdict

DOUBLINGS = 40
"""How often the factor is doubled or halved before the search is given up."""


def smallest_damping(
    method: Callable[..., Verdict],
    mass: Any,
    stiffness: Any,
    damping: Any = 1.0,
    *,
    tolerance: Number = 1e-6,
    **options: Any,
) -> float:
    """Smallest factor of the damping with which ``method(mass, stiffness, factor · damping, …)`` is proved.

    More damping is assumed never to lose a proof, which holds for the methods on time-varying gains.

    Parameters
    ----------
    method : callable
        ``kronander_billard``, ``alpha_schedule``, ``floquet`` or another one that takes mass, stiffness, damping.
    mass, stiffness, damping : number, array_like or callable
        As the method takes them. With a damping of one, the factor is the damping [Ns/m].
    tolerance : number, optional
        Relative, of the factor.
    **options
        The method's own: ``time`` or ``period``.

    Returns
    -------
    float
        The smallest factor found to be proved; zero if even no damping is.

    Raises
    ------
    InputError
        No factor up to 2⁴⁰ is proved, or the method refuses its arguments.
    """
    share = positive("tolerance", tolerance)

    def proved(factor: float) -> bool:
        if callable(damping):
            scaled: Any = lambda t: factor * np.asarray(damping(t), dtype=np.float64)  # noqa: E731
        else:
            scaled = factor * np.asarray(damping, dtype=np.float64)
        return method(mass, stiffness, scaled, **options).status == "proved"

    high = 1.0
    for _ in range(DOUBLINGS):
        if proved(high):
            break
        high *= 2
    else:
        raise InputError(
            f"not proved with {high:.3g} times the damping either; a damping that is zero on some axis stays so."
        )
    if high == 1.0:
        while high > 0.5**DOUBLINGS and proved(high / 2):
            high /= 2
        if high <= 0.5**DOUBLINGS:
            return 0.0
    low = high / 2
    while high - low > share * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if proved(middle) else (middle, high)
    return high
