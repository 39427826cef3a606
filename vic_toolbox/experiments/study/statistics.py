r"""What a few seeds tell about a method: mean, 95 % interval, and the best three as the paper reports them.

Every seed trains a policy of its own and all of them are judged on the same m starts, so two things are uncertain:
another seed would give another policy, and other starts another rate. For a **mean** of k seeds (relative
differences, deviations) the interval is Student's,

.. math:: \bar x \pm t_{k-1}\, s / \sqrt k ,

cut off where the quantity ends. For a **success rate** it would be ± 0 whenever all seeds agree, most often at
100 %, and would leave [0, 1] when they do not. There it is the set of rates π that the data do not contradict
(Wilson's form),

.. math:: |\bar p - \pi| \le q \sqrt{\pi (1-\pi) / n} ,

the wider one of two: the seeds' spread, :math:`q = t_{k-1}` and the effective number of episodes
:math:`n = \bar p (1-\bar p) / (s^2 / k)`, and the starts, :math:`q = z` and :math:`n = m`, since m starts are m
independent episodes however many seeds are judged on them. Neither pooling all k·m episodes (far too narrow as soon as
one seed of five fails) nor a bootstrap (five values resample to themselves) does that.

Five seeds that agree do not exclude that one in five fails: the chance of not seeing it is a third.

References
----------
E. B. Wilson, "Probable inference, the law of succession, and statistical inference", JASA 22, 1927.

N. Dean, M. Pagano, "Evaluating confidence interval methods for binomial proportions in clustered surveys",
J. Survey Statistics and Methodology 3, 2015: Wilson's interval with the effective number, as here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from vic_toolbox.errors import array_within, finite_array, integer
from vic_toolbox.experiments.intervals import wilson_interval

BEST = 3
"""Seeds that the paper keeps, of its five."""


@dataclass(frozen=True)
class Estimate:
    """A method in one scenario, over its seeds."""

    mean: float
    """Of all seeds."""
    low: float | None
    """Lower end of the 95 % interval; None where a single seed says nothing about it."""
    high: float | None
    """Upper end of the 95 % interval."""
    best3: float | None
    """Mean of the best three seeds; None with fewer than three."""
    seeds: int
    """Number of seeds."""


def mean_estimate(values: Sequence[float], *, lowest: float = -math.inf) -> Estimate:
    """Estimate of a mean over seeds, of which less is better.

    Parameters
    ----------
    values : sequence of float
        One for each seed.
    lowest : float
        Where the quantity ends; the interval is cut off there.

    Raises
    ------
    InputError
        No values, or one that is not finite or below `lowest`.
    """
    x = _seeds(array_within("values of the seeds", values, low=lowest, high=math.inf, shape=(None,)))
    mean = float(x.mean())
    if len(x) == 1:
        return Estimate(mean, None, None, None, 1)
    half = _quantile(len(x)) * float(x.std(ddof=1)) / math.sqrt(len(x))
    return Estimate(mean, max(mean - half, lowest), mean + half, _best(np.sort(x)), len(x))


def rate_estimate(rates: Sequence[float], *, episodes: int) -> Estimate:
    """Estimate of a success rate over seeds.

    Parameters
    ----------
    rates : sequence of float
        Share of successes, in [0, 1], one for each seed.
    episodes : int
        Starts on which every seed was judged.

    Raises
    ------
    InputError
        No rates, one outside [0, 1], or no episodes.
    """
    p = _seeds(array_within("rates of the seeds", rates, low=0.0, high=1.0, shape=(None,)))
    episodes = integer("episodes", episodes, low=1)
    mean = float(p.mean())
    low, high = wilson_interval(mean, episodes)
    if (spread := float(p.var(ddof=1)) if len(p) > 1 else 0.0) > 0.0:
        effective = max(mean * (1.0 - mean) / (spread / len(p)), len(p) - 1.0)  # never less, but for rounding
        by_seeds = wilson_interval(mean, effective, quantile=_quantile(len(p)))
        low, high = min(low, by_seeds[0]), max(high, by_seeds[1])
    return Estimate(mean, low, high, _best(np.sort(p)[::-1]), len(p))


def _seeds(values: np.ndarray) -> np.ndarray:
    integer("number of seeds", len(values), low=1)
    return finite_array("values of the seeds", values)


def _quantile(seeds: int) -> float:
    """Student's, of 97.5 %."""
    return float(stats.t.ppf(0.975, seeds - 1))


def _best(ordered: np.ndarray) -> float | None:
    return float(ordered[:BEST].mean()) if len(ordered) >= BEST else None
