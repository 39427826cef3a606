"""Even weight for every part of the way.

An arm that hurries to its goal and settles there spends one step in twenty far away. Drawn evenly over time, rows say
next to nothing about the first phase, neither to the reward nor to the policy; drawn evenly over the task's strata
they say as much about each.
"""

from __future__ import annotations

import numpy as np
import torch


def stratified_rows(strata: np.ndarray, shape: tuple[int, ...], rng: np.random.Generator) -> torch.Tensor:
    """Row numbers drawn with replacement so that each stratum that occurs has the same chance.

    `strata` (n,) holds non-negative integers.
    """
    order = np.argsort(strata.astype(np.int16), kind="stable")  # 16 bits: a radix sort
    counts = np.bincount(strata)
    counts = counts[counts > 0]
    first = np.cumsum(counts) - counts
    drawn = rng.integers(len(counts), size=shape)
    within = (rng.random(shape) * counts[drawn]).astype(np.int64)
    return torch.from_numpy(order[first[drawn] + within])
