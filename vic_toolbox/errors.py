"""One family of errors, and the checks that raise them.

Every error of the toolbox derives from :class:`VicError`. Its message says what was received, what is
expected, and what to do. The checks below turn user input into clean ``float64`` arrays (or numbers), or
raise :class:`InputError` before any work starts.
"""

from __future__ import annotations

import importlib.util
import math
import operator
from collections.abc import Iterable
from types import EllipsisType
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Number = float | np.floating | np.integer
Shape = tuple[int | EllipsisType | None, ...]


class VicError(Exception):
    """Base of every error that the toolbox raises on purpose."""


class InputError(VicError, ValueError):
    """An argument cannot be used: wrong shape, not finite, out of range, unknown name."""


class ReachError(InputError):
    """No joint posture puts the end-effector where it was asked to be.

    Attributes
    ----------
    residual : float or None
        Norm of the pose error that the best attempt left, where it is known.
    """

    def __init__(self, message: str, *, residual: float | None = None) -> None:
        super().__init__(message)
        self.residual = residual


class ModelError(VicError):
    """A robot or scene description cannot be used (missing frame, wrong joint type, not a serial arm)."""


class FileError(VicError, OSError):
    """A file is missing, damaged, of another version, or cannot be written."""


class SimulationError(VicError, RuntimeError):
    """A simulation diverged, or the simulator cannot run what was asked of it."""


class DependencyError(VicError, ImportError):
    """An optional dependency or a system library is missing; the message names the command that adds it."""


def require(group: str, *packages: str) -> None:
    """Check that packages of an optional dependency group are installed, without importing them.

    Raises
    ------
    DependencyError
        Some are not; the message names them and the command that adds the group.
    """
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        raise DependencyError(
            f"{', '.join(missing)} {'is' if len(missing) == 1 else 'are'} not installed, and this part of the "
            f"toolbox needs {'it' if len(missing) == 1 else 'them'}: pip install 'vic-toolbox[{group}]'."
        )


def finite_array(name: str, value: ArrayLike, *, shape: Shape | None = None) -> Array:
    """Return `value` as a ``float64`` array of finite real numbers with the wanted shape.

    Parameters
    ----------
    name : str
        What the value is called in the error message.
    value : array_like
        Real numbers (integers or floats). It is not copied when it is a ``float64`` array already.
    shape : tuple, optional
        Pattern of the shape: ``None`` or ``-1`` stands for any length, a leading ``...`` for any number of
        batch dimensions, e.g. ``(..., 6)`` or ``(None, 6, 6)``. Without it every shape is accepted.

    Raises
    ------
    InputError
        Not an array of real numbers, wrong shape, or a NaN or infinite entry (its index is named).
    """
    try:
        raw = np.asarray(value)
    except (ValueError, TypeError, RuntimeError) as error:
        raise InputError(f"{name} is not an array of numbers ({error}); pass {_expected(shape)}.") from error
    if raw.dtype.kind not in "fiu":
        raise InputError(
            f"{name} holds {raw.dtype} ({_short(value)}), not real numbers; pass {_expected(shape)}."
        )
    array = raw.astype(np.float64, copy=False)
    if shape is not None and not _matches(array.shape, shape):
        raise InputError(f"{name} has shape {array.shape}; pass {_expected(shape)}.")
    if not np.isfinite(array).all():
        index, first = _first(array, ~np.isfinite(array))
        raise InputError(f"{name}{index} is {first}; every entry must be finite.")
    return array


def positive_array(name: str, value: ArrayLike, *, shape: Shape | None = None) -> Array:
    """Return `value` as :func:`finite_array` does, with every entry greater than zero.

    Raises
    ------
    InputError
        As :func:`finite_array`, or an entry is zero or negative.
    """
    array = finite_array(name, value, shape=shape)
    if (array <= 0).any():
        index, first = _first(array, array <= 0)
        raise InputError(f"{name}{index} is {first:g}; every entry must be greater than zero.")
    return array


def array_within(
    name: str, value: ArrayLike, *, low: ArrayLike, high: ArrayLike, shape: Shape | None = None
) -> Array:
    """Return `value` as :func:`finite_array` does, with every entry in the closed range [`low`, `high`].

    Raises
    ------
    InputError
        As :func:`finite_array`, or an entry lies outside the range (entry and range are named).
    """
    array = finite_array(name, value, shape=shape)
    smallest, largest = np.broadcast_to(low, array.shape), np.broadcast_to(high, array.shape)
    outside = (array < smallest) | (array > largest)
    if outside.any():
        index, first = _first(array, outside)
        bounds = f"[{smallest[outside][0]:g}, {largest[outside][0]:g}]"
        raise InputError(f"{name}{index} is {first:g}; it must lie in {bounds}.")
    return array


def finite_number(name: str, value: Number, *, low: float = -math.inf, high: float = math.inf) -> float:
    """Return `value` as a finite ``float`` in the closed range [`low`, `high`].

    Raises
    ------
    InputError
        Not a real number, not finite, or outside the range.
    """
    number = float(finite_array(name, value, shape=()))
    if not low <= number <= high:
        raise InputError(f"{name} is {number:g}; it must lie in [{low:g}, {high:g}].")
    return number


def positive(name: str, value: Number) -> float:
    """Return `value` as a finite ``float`` greater than zero.

    Raises
    ------
    InputError
        Not a real number, not finite, zero or negative.
    """
    return float(positive_array(name, value, shape=()))


def integer(name: str, value: SupportsIndex, *, low: int | None = None, high: int | None = None) -> int:
    """Return `value` as an ``int`` in the closed range [`low`, `high`]; a float or a bool is refused.

    Raises
    ------
    InputError
        Not an integer, or outside the range.
    """
    try:
        if isinstance(value, bool | np.bool_):
            raise TypeError
        number = operator.index(value)
    except TypeError:
        raise InputError(f"{name} is {_short(value)}; pass an integer.") from None
    if (low is not None and number < low) or (high is not None and number > high):
        limits = [f"at least {low}"] * (low is not None) + [f"at most {high}"] * (high is not None)
        raise InputError(f"{name} is {number}; it must be {' and '.join(limits)}.")
    return number


def common_batch(**shapes: tuple[int, ...]) -> tuple[int, ...]:
    """Return the batch shape that several arguments broadcast to, given the batch shape of each by name.

    Raises
    ------
    InputError
        The shapes do not fit each other (all of them are named).
    """
    try:
        return np.broadcast_shapes(*shapes.values())
    except ValueError:
        received = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise InputError(
            f"batch shapes do not fit each other: {received}; "
            "pass equal batches, or one sample where it serves all."
        ) from None


def one_of(name: str, value: str, choices: Iterable[str]) -> str:
    """Return `value` if it is one of `choices`.

    Raises
    ------
    InputError
        Unknown value; the message lists the valid ones.
    """
    valid = list(choices)
    if value not in valid:
        raise InputError(f"{name} is {_short(value)}; choose one of: {', '.join(valid)}.")
    return value


def _matches(actual: tuple[int, ...], pattern: Shape) -> bool:
    if pattern and pattern[0] is Ellipsis:
        pattern = pattern[1:]
        actual = actual[max(len(actual) - len(pattern), 0) :]
    return len(actual) == len(pattern) and all(
        wanted in (None, -1) or got == wanted for got, wanted in zip(actual, pattern, strict=True)
    )


def _expected(shape: Shape | None) -> str:
    if shape is None:
        return "an array of real numbers"
    if shape == ():
        return "one real number"
    lengths = ["..." if n is Ellipsis else "any" if n in (None, -1) else str(n) for n in shape]
    return f"real numbers of shape ({', '.join(lengths)}{',' if len(lengths) == 1 else ''})"


def _first(array: Array, where: NDArray[np.bool_]) -> tuple[str, np.float64]:
    """Index, as text, and value of the first entry that `where` marks."""
    index = tuple(int(axis[0]) for axis in np.nonzero(np.atleast_1d(where)))
    return (str(list(index)) if array.ndim else ""), np.atleast_1d(array)[index]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
