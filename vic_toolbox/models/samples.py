"""One sample or a batch: Pinocchio computes one state at a time, the toolbox any number."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, common_batch, finite_array


def same_batch(states: Mapping[str, ArrayLike], *, size: int) -> list[Array]:
    """Return the named states, checked, with one batch shape: (..., size) each.

    Raises
    ------
    InputError
        Wrong shape, not finite, or batches that do not fit each other.
    """
    arrays = {name: finite_array(name, value, shape=(..., size)) for name, value in states.items()}
    shapes = {name: array.shape[:-1] for name, array in arrays.items()}
    if len(set(shapes.values())) == 1:
        return list(arrays.values())
    batch = common_batch(**shapes)
    return [np.broadcast_to(array, (*batch, size)) for array in arrays.values()]


def map_samples(kernel: Callable[..., Array], *states: Array) -> Array:
    """Apply a kernel of single samples (size,) to every sample of equal batches (..., size)."""
    first = states[0]
    if first.ndim == 1:
        return kernel(*states)
    batch = first.shape[:-1]
    rows = zip(*(state.reshape(-1, first.shape[-1]) for state in states), strict=True)
    results = [kernel(*row) for row in rows] or [kernel(*(np.zeros(first.shape[-1]) for _ in states))]
    stacked = np.stack(results)[: int(np.prod(batch))]
    return stacked.reshape(*batch, *stacked.shape[1:])
