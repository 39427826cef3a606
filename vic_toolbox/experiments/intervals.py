"""How sure a success rate is that was counted over some episodes."""

from __future__ import annotations

import math

NORMAL_QUANTILE = 1.959963984540054
"""Of 97.5 %: two-sided intervals of 95 %."""


def wilson_interval(
    rate: float, episodes: float, *, quantile: float = NORMAL_QUANTILE
) -> tuple[float, float]:
    r"""The 95 % interval (low, high) of a success probability, from the rate of n independent episodes.

    .. math::
        \frac{p + z^2/2n \pm z\,\sqrt{p(1-p)/n + z^2/4n^2}}{1 + z^2/n}

    It stays within [0, 1] and has a width where every episode ended alike, unlike :math:`p \pm z\sqrt{p(1-p)/n}`.
    Episodes that are not independent count as an effective number n of such, which need not be whole, and `quantile`
    replaces z where n itself is an estimate.

    References
    ----------
    E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927.
    """
    z, n = quantile, episodes
    middle = rate + z**2 / (2 * n)
    half = z * math.sqrt(rate * (1.0 - rate) / n + z**2 / (4 * n**2))
    low, high = ((middle + side * half) / (1.0 + z**2 / n) for side in (-1.0, 1.0))
    return min(max(low, 0.0), rate), max(min(high, 1.0), rate)  # rounding, where the rate is 0 or 1
