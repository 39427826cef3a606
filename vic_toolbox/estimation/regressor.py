"""The estimators behind the interface of scikit-learn, which is not needed for it."""

from __future__ import annotations

import inspect
import sys
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from vic_toolbox.errors import Array, InputError, VicError, finite_array
from vic_toolbox.estimation.smooth import fit_smooth


class NotFittedError(VicError, ValueError, AttributeError):
    """`predict` was called before `fit`."""


@dataclass(frozen=True, eq=False)
class _Columns:
    """A recording made of the columns of X and y."""

    time: Array
    error: Array
    error_rate: Array
    wrench: Array


class ImpedanceRegressor:
    """Predict a wrench from motion by ``wrench = K e + B ė``, with the `fit` and `predict` of scikit-learn.

    X has the twelve columns (e, ė) for constant gains, `knots` None, or thirteen with time first for gains that
    change with it. y has the six columns of the wrench. Rows need not be in order of time. It works in pipelines,
    searches and cross-validation; scikit-learn itself is not imported.

    Parameters
    ----------
    knots : float or None, optional
        Distance of the knots [s], or None for constant gains.
    structure, constraint, robust, bias
        As of :func:`~vic_toolbox.estimation.fit_smooth`.

    Attributes
    ----------
    estimate_ : GainEstimate
        The fit, with deviations and flags.
    n_features_in_ : int
        Columns of X.

    Notes
    -----
    An axis that the data do not determine predicts a wrench of zero (its bias, with `bias`), not NaN, so that a
    score stays a number; look at ``estimate_.observable``.
    """

    def __init__(
        self,
        *,
        knots: float | None = None,
        structure: str = "diagonal",
        constraint: str = "spd",
        robust: bool = False,
        bias: bool = False,
    ) -> None:
        self.knots = knots
        self.structure = structure
        self.constraint = constraint
        self.robust = robust
        self.bias = bias

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fit the gains.

        Parameters
        ----------
        X : array_like, shape (n, 12) or (n, 13)
        y : array_like, shape (n, 6)

        Raises
        ------
        InputError
            Wrong shapes, NaN, or times that repeat.
        """
        wrench = _numbers("y", y)
        columns = self._checked(X)
        if len(columns) < 2:
            raise InputError(f"X has n_samples = {len(columns)}; a fit needs at least two.")
        wrench = finite_array("y", wrench, shape=(len(columns), 6))
        time = np.arange(len(columns), dtype=float)
        if self.knots is not None:
            order = np.argsort(columns[:, 0], kind="stable")
            columns, wrench = columns[order], wrench[order]
            time, columns = columns[:, 0], columns[:, 1:]
        self.estimate_ = fit_smooth(
            _Columns(time, columns[:, :6], columns[:, 6:], wrench),
            self.knots,
            structure=self.structure,
            constraint=self.constraint,
            robust=self.robust,
            bias=self.bias,
        )
        self.n_features_in_ = 12 if self.knots is None else 13
        return self

    def predict(self, X: ArrayLike) -> Array:
        """The wrench that belongs to the motion, (n, 6).

        Raises
        ------
        NotFittedError
            Before :meth:`fit`.
        InputError
            Wrong shape or NaN.
        """
        if not hasattr(self, "estimate_"):
            raise _not_fitted()
        columns = self._checked(X)
        found = self.estimate_
        time = np.full(len(columns), found.time[0])
        if self.knots is not None:
            time, columns = columns[:, 0], columns[:, 1:]
        stiffness, damping = (
            _interpolated(found.time, gain, time) for gain in (found.stiffness, found.damping)
        )
        wrench = (stiffness @ columns[:, :6, None] + damping @ columns[:, 6:, None])[..., 0]
        return wrench + found.parameters["bias"][0] if self.bias else wrench

    def score(self, X: ArrayLike, y: ArrayLike) -> float:
        """Coefficient of determination r², averaged over the wrench's axes that vary."""
        predicted = self.predict(X)
        wrench = finite_array("y", y, shape=(len(predicted), 6))
        spread = np.sum((wrench - wrench.mean(axis=0)) ** 2, axis=0)
        left = np.sum((wrench - predicted) ** 2, axis=0)
        varies = spread > 0
        return float(np.mean(1 - left[varies] / spread[varies])) if varies.any() else 0.0

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """Constructor arguments by name."""
        del deep
        return {name: getattr(self, name) for name in inspect.signature(type(self)).parameters}

    def set_params(self, **parameters: Any) -> Self:
        """Change constructor arguments.

        Raises
        ------
        InputError
            Unknown name.
        """
        valid = self.get_params()
        for name, value in parameters.items():
            if name not in valid:
                raise InputError(
                    f"{name!r} is no parameter of ImpedanceRegressor; it has {', '.join(valid)}."
                )
            setattr(self, name, value)
        return self

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self)).parameters
        changed = {k: v for k, v in self.get_params().items() if v != defaults[k].default}
        return f"ImpedanceRegressor({', '.join(f'{k}={v!r}' for k, v in changed.items())})"

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "estimate_")

    def __sklearn_tags__(self) -> Any:
        """What scikit-learn asks an estimator about itself; only scikit-learn calls this."""
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags  # pyright: ignore[reportMissingImports]

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True, multi_output=True, single_output=False),
            regressor_tags=RegressorTags(),
            input_tags=InputTags(),
        )

    def _checked(self, columns: ArrayLike) -> Array:
        """X as numbers with its columns; the words are those that scikit-learn's own checks look for."""
        wanted = 12 if self.knots is None else 13
        x = _numbers("X", columns)
        if x.ndim == 2 and x.shape[1] != wanted:
            what = f"a minimum of {wanted} is required" if x.shape[1] < wanted else f"{wanted} are expected"
            raise InputError(
                f"X has {x.shape[1]} feature(s) (shape={x.shape}) while {what}: "
                f"{'' if self.knots is None else 'time, '}six errors and their six rates."
            )
        return finite_array("X", x, shape=(None, wanted))


def _numbers(name: str, value: ArrayLike | None) -> np.ndarray:
    """An array; one of Python objects that are numbers (from a table of mixed types) becomes one of numbers."""
    if value is None:
        raise InputError(
            f"ImpedanceRegressor requires {name} to be passed, but the target {name} is None; pass numbers."
        )
    if sparse.issparse(value):
        raise InputError(f"sparse input is not supported; pass {name} as a dense array.")
    array = np.asarray(value)
    if np.iscomplexobj(array):
        raise InputError(f"Complex data not supported: {name} has complex entries; pass real numbers.")
    if array.dtype.kind == "O":
        try:
            array = array.astype(float)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name} is not an array of numbers ({error}).") from error
    return array


def _not_fitted() -> NotFittedError:
    """The error, which is scikit-learn's own as well where that is loaded."""
    text = "this ImpedanceRegressor is not fitted yet; call fit(X, y) first."
    library = sys.modules.get("sklearn.exceptions")
    if library is None:
        return NotFittedError(text)
    return type("NotFittedError", (NotFittedError, library.NotFittedError), {})(text)


def _interpolated(time: Array, gain: Array, at: Array) -> Array:
    """Gains (n, 6, 6) at any times, linear between instants; zero where nothing is known."""
    known = np.nan_to_num(gain)
    left = np.clip(np.searchsorted(time, at, side="right") - 1, 0, max(len(time) - 2, 0))
    right = np.minimum(left + 1, len(time) - 1)
    span = np.where(right > left, time[right] - time[left], 1.0)
    share = np.clip((at - time[left]) / span, 0.0, 1.0)[:, None, None]
    return known[left] + share * (known[right] - known[left])
