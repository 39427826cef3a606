"""The error family, and the checks that turn user input into clean numbers or into a clear message."""

from __future__ import annotations

import copy
import pickle
import sys
from typing import Any

import numpy as np
import pytest

from vic_toolbox import errors
from vic_toolbox.errors import (
    DependencyError,
    FileError,
    InputError,
    ModelError,
    ReachError,
    SimulationError,
    VicError,
    array_within,
    common_batch,
    finite_array,
    finite_number,
    integer,
    one_of,
    positive,
    positive_array,
    require,
)


@pytest.mark.parametrize(
    ("error", "standard"),
    [
        (InputError, ValueError),
        (ReachError, ValueError),
        (ModelError, VicError),
        (FileError, OSError),
        (SimulationError, RuntimeError),
        (DependencyError, ImportError),
    ],
)
def test_every_error_is_a_vic_error_and_its_python_kind(
    error: type[VicError], standard: type[Exception]
) -> None:
    assert issubclass(error, VicError)
    assert issubclass(error, standard)
    assert str(error("what, expected, do")) == "what, expected, do"


def test_the_family_is_complete() -> None:
    family = {x for x in vars(errors).values() if isinstance(x, type) and issubclass(x, Exception)}
    assert all(issubclass(error, VicError) for error in family)


@pytest.mark.parametrize("clone", [copy.copy, lambda error: pickle.loads(pickle.dumps(error))])
def test_reach_error_carries_its_residual_across_processes(clone: Any) -> None:
    error = clone(ReachError("too far", residual=0.25))
    assert (str(error), error.residual) == ("too far", 0.25)
    assert ReachError("too far").residual is None


def test_missing_packages_are_named_with_the_command_that_adds_them(monkeypatch: pytest.MonkeyPatch) -> None:
    require("learn", "numpy", "scipy")
    monkeypatch.setitem(sys.modules, "scipy", None)
    with pytest.raises(
        DependencyError, match=r"^scipy is not installed.*: pip install 'vic-toolbox\[learn\]'"
    ):
        require("learn", "numpy", "scipy")
    with pytest.raises(DependencyError, match="scipy, no_such_package are not installed"):
        require("learn", "scipy", "no_such_package")


@pytest.mark.parametrize("value", [[1, 2, 3], (1.0, 2, 3), np.arange(3, dtype=np.float32), np.arange(3)])
def test_finite_array_returns_float64(value: Any) -> None:
    array = finite_array("value", value, shape=(3,))
    assert array.dtype == np.float64
    assert array.shape == (3,)


def test_finite_array_does_not_copy_what_is_clean() -> None:
    clean = np.ones(6)
    assert finite_array("value", clean) is clean


@pytest.mark.parametrize(
    ("shape", "pattern", "fits"),
    [
        ((6,), (..., 6), True),
        ((5, 6), (..., 6), True),
        ((2, 5, 6), (..., 6), True),
        ((0, 6), (..., 6), True),
        ((5, 6), (6,), False),
        ((5, 6), (None, 6), True),
        ((5, 6), (-1, 6), True),
        ((6,), (None, 6), False),
        ((5,), (..., 6), False),
        ((), (..., 6), False),
        ((), (), True),
        ((), (...,), True),
        ((3, 4), (...,), True),
        ((6,), (..., 6, 6), False),
        ((6, 6), (..., 6, 6), True),
        ((1,), (), False),
    ],
)
def test_shape_patterns(shape: tuple[int, ...], pattern: errors.Shape, fits: bool) -> None:
    if fits:
        assert finite_array("value", np.ones(shape), shape=pattern).shape == shape
    else:
        with pytest.raises(InputError, match="value has shape"):
            finite_array("value", np.ones(shape), shape=pattern)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ([1.0, np.nan], r"load\[1\] is nan; every entry must be finite"),
        ([[1.0, 2.0], [-np.inf, 0.0]], r"load\[1, 0\] is -inf"),
        (np.nan, "load is nan"),
        ("heavy", "not real numbers"),
        (["1", "2"], "not real numbers"),
        (None, "not real numbers"),
        ([True, False], "not real numbers"),
        ([1.0 + 1.0j], "not real numbers"),
        ([[1.0], [1.0, 2.0]], "not an array of numbers"),
        ({"a": 1}, "not real numbers"),
    ],
)
def test_finite_array_refuses(value: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        finite_array("load", value)


def test_the_message_says_received_expected_and_is_short() -> None:
    with pytest.raises(InputError) as caught:
        finite_array("wrench", np.ones((2, 5)), shape=(..., 6))
    assert str(caught.value) == "wrench has shape (2, 5); pass real numbers of shape (..., 6)."
    with pytest.raises(InputError) as caught:
        finite_array("wrench", "x" * 10_000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("value", [[1.0, 0.0], [1.0, -2.0]])
def test_positive_array_refuses_zero_and_negative(value: list[float]) -> None:
    with pytest.raises(InputError, match=r"mass\[1\] is -?[02]; every entry must be greater than zero"):
        positive_array("mass", value)


def test_array_within_names_entry_and_bounds() -> None:
    inside = array_within("q", [0.0, 2.0], low=[-1, -1], high=2, shape=(2,))
    np.testing.assert_array_equal(inside, [0.0, 2.0])
    with pytest.raises(InputError, match=r"q\[1, 1\] is 3; it must lie in \[-1, 2\]"):
        array_within("q", [[0.0, 0.0], [0.0, 3.0]], low=[-5, -1], high=[5, 2])
    with pytest.raises(InputError, match=r"q is 3; it must lie in \[0, 1\]"):
        array_within("q", 3.0, low=0, high=1)


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, "1", None, [1.0], True])
def test_positive_refuses(value: Any) -> None:
    with pytest.raises(InputError, match="mass"):
        positive("mass", value)


def test_numbers_come_back_as_python_numbers() -> None:
    assert type(positive("mass", np.float32(2))) is float
    assert type(finite_number("angle", np.int64(-2), low=-2)) is float
    assert type(integer("steps", np.int32(3))) is int


def test_finite_number_refuses_out_of_range() -> None:
    with pytest.raises(InputError, match=r"angle is 4; it must lie in \[-3.14, 3.14\]"):
        finite_number("angle", 4, low=-3.14, high=3.14)


@pytest.mark.parametrize("value", [2.0, "2", None, True, np.True_, [2]])
def test_integer_refuses_what_is_not_an_integer(value: Any) -> None:
    with pytest.raises(InputError, match="pass an integer"):
        integer("steps", value)


def test_integer_refuses_out_of_range() -> None:
    with pytest.raises(InputError, match="steps is 0; it must be at least 1 and at most 9"):
        integer("steps", 0, low=1, high=9)
    with pytest.raises(InputError, match="steps is 0; it must be at least 1\\."):
        integer("steps", 0, low=1)


def test_common_batch() -> None:
    assert common_batch(pose=(4,), reference=()) == (4,)
    with pytest.raises(InputError, match=r"pose \(4,\), reference \(3,\)"):
        common_batch(pose=(4,), reference=(3,))


def test_one_of_lists_the_valid_names() -> None:
    assert one_of("action", "gain", ["gain", "force"]) == "gain"
    with pytest.raises(InputError, match="action is 'torque'; choose one of: gain, force"):
        one_of("action", "torque", ["gain", "force"])
