"""Scalars and matrices as every method takes them: one shape, symmetric, positive."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.stability.schedules.definite import CHUNK, diagonals, lower, pack, positive_definite

SYMMETRY = 1e-9
"""Largest asymmetry of a gain matrix, relative to its largest entry."""
ROUNDING = 1e-12
"""Negative eigenvalue of a semidefinite matrix that counts as zero, relative to its largest entry."""


Source = ArrayLike | Callable[[float], ArrayLike]
"""Gains, or a function of the time [s] that returns them."""


class Impedance(NamedTuple):
    """Mass, stiffness and damping with the same d and, where they change, the same n."""

    mass: Array
    stiffness: Array
    damping: Array


def matrices(name: str, value: ArrayLike) -> Array:
    """Gains as matrices: a number becomes (1, 1), (n,) numbers (n, 1, 1); (d, d) and (n, d, d) stay.

    Raises
    ------
    InputError
        Another shape, entries that are not finite, or a matrix that is not symmetric.
    """
    return _checked(name, value)[0]


def _checked(name: str, value: ArrayLike) -> tuple[Array, Array | None]:
    """The matrices, and their diagonals (d, n) if they have nothing else."""
    array = finite_array(name, value)
    if array.ndim < 2:
        array = array[..., None, None]
    if array.ndim > 3 or array.shape[-1] != array.shape[-2] or array.size == 0:
        raise InputError(
            f"{name} has shape {np.shape(value)}; pass a number, (n,) numbers, (d, d) or (n, d, d) matrices."
        )
    alone = diagonals(array)
    if alone is not None:
        return array, alone
    lopsided, size = _asymmetry(array)
    uneven = lopsided > SYMMETRY * size
    if uneven.any():
        index = int(np.argmax(uneven))
        raise InputError(
            f"{name}{f'[{index}]' if array.ndim == 3 else ''} is not symmetric (by {lopsided.reshape(-1)[index]:.3g}); "
            "pass symmetric matrices: a skew part of a stiffness is no spring and makes energy."
        )
    return 0.5 * (array + np.swapaxes(array, -1, -2)) if lopsided.any() else array, None


def _asymmetry(array: Array) -> tuple[Array, Array]:
    """Largest difference across the diagonal, and largest entry, of each matrix."""
    stack = array.reshape(-1, *array.shape[-2:])
    rows, columns = lower(array.shape[-1])
    lopsided, size = np.empty(len(stack)), np.empty(len(stack))
    for start in range(0, len(stack), CHUNK):
        some = slice(start, start + CHUNK)
        below = stack[some, rows, columns]
        lopsided[some] = np.abs(below - stack[some, columns, rows]).max(axis=1)
        size[some] = np.abs(below).max(axis=1)
    return lopsided, size


def positive_matrices(name: str, value: ArrayLike, *, definite: bool = True) -> Array:
    """As :func:`matrices`, and positive definite (or semidefinite).

    Raises
    ------
    InputError
        As there, or an eigenvalue is not positive (negative).
    """
    return _positive(name, value, definite=definite)[0]


def _positive(name: str, value: ArrayLike, *, definite: bool) -> tuple[Array, Array | None]:
    array, alone = _checked(name, value)
    stack = array.reshape(-1, *array.shape[-2:])
    if alone is not None:
        smallest = alone.min(axis=0)
    else:
        smallest = np.full(len(stack), np.inf)
        doubtful = ~positive_definite(pack(stack))
        smallest[doubtful] = np.linalg.eigvalsh(stack[doubtful])[:, 0]
    wrong = np.flatnonzero(smallest <= 0)
    if not definite and len(wrong):
        wrong = wrong[smallest[wrong] < -ROUNDING * np.abs(stack[wrong]).max(axis=(1, 2))]
    if len(wrong):
        index = int(wrong[0])
        where = f"{name}[{index}]" if array.ndim == 3 else name
        kind = "positive definite" if definite else "positive semidefinite"
        raise InputError(f"{where} has the eigenvalue {smallest[index]:.6g}; pass {kind} matrices.")
    return array, alone


def impedance(mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike) -> Impedance:
    """M ≻ 0, K ⪰ 0 and D ⪰ 0 of one size d; each (d, d) or (n, d, d).

    Raises
    ------
    InputError
        As :func:`positive_matrices`, or sizes or lengths that differ.
    """
    return impedance_rows(mass, stiffness, damping)[0]


def impedance_rows(
    mass: ArrayLike, stiffness: ArrayLike, damping: ArrayLike
) -> tuple[Impedance, tuple[Array, Array, Array] | None]:
    """As :func:`impedance`, and the diagonals (d, n) of all three, (d, 1) of constants, if nothing couples the axes."""
    parts = [
        _positive("mass", mass, definite=True),
        _positive("stiffness", stiffness, definite=False),
        _positive("damping", damping, definite=False),
    ]
    found = Impedance(*(part[0] for part in parts))
    sizes = {name: array.shape[-1] for name, array in found._asdict().items()}
    size = max(sizes.values())
    if len(set(sizes.values())) > 1:
        text = ", ".join(f"{name} {d} × {d}" for name, d in sizes.items())
        raise InputError(
            f"the sizes differ: {text}; pass matrices of one size, e.g. number * np.eye({size})."
        )
    lengths = {name: len(array) for name, array in found._asdict().items() if array.ndim == 3}
    if len(set(lengths.values())) > 1:
        text = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise InputError(f"the numbers of samples differ: {text}; pass as many of each, or one for all.")
    (_, m), (_, k), (_, d) = parts
    return found, None if m is None or k is None or d is None else (m, k, d)


def sample_times(time: ArrayLike, *, count: int | None = None) -> Array:
    """Increasing instants (n,) [s], at least two, and as many as the gains.

    Raises
    ------
    InputError
        They do not increase, are not finite, or are not as many.
    """
    instants = finite_array("time", time, shape=(None,))
    if len(instants) < 2:
        raise InputError(f"time has {len(instants)} samples; pass at least two.")
    if (np.diff(instants) <= 0).any():
        index = int(np.argmax(np.diff(instants) <= 0)) + 1
        raise InputError(
            f"time[{index}] is {instants[index]:g}, not after time[{index - 1}]; sort the samples."
        )
    if count is not None and len(instants) != count:
        raise InputError(
            f"time has {len(instants)} samples and the gains have {count}; pass as many of each."
        )
    return instants


def sampled(source: Source, time: Array) -> ArrayLike:
    """Gains at instants (n,), if they are a function of time; others stay as they are."""
    return np.stack([np.asarray(source(float(t))) for t in time]) if callable(source) else source


def at(name: str, source: Source, t: float) -> Array:
    """One matrix (d, d) of a constant, or of a function of time, at the instant t [s].

    Raises
    ------
    InputError
        As :func:`matrices`, or more than one matrix.
    """
    found = matrices(
        f"{name}({t:g})" if callable(source) else name, source(t) if callable(source) else source
    )
    if found.ndim == 3:
        raise InputError(
            f"{name} holds {len(found)} matrices; pass one, or a function of time that returns one."
        )
    return found
