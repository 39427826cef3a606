"""A policy in closed loop: whatever a callable returns, as gains in ``M ë + B(e,ė) ė + K(e,ė) e = load``."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, integer, one_of
from vic_toolbox.gains import Parametrisation
from vic_toolbox.stability.arguments import ROUNDING, SYMMETRY, positive_matrices
from vic_toolbox.stability.policies.policy_call import policy_call

OUTPUTS = ("gains", "wrench")
DOUBLE, SINGLE = float(np.finfo(np.float64).eps), float(np.finfo(np.float32).eps)


class Answer(NamedTuple):
    """What a policy answers at states (n, 2 d)."""

    stiffness: Array
    """K (n, d, d)."""
    damping: Array
    """B (n, d, d)."""
    force: Array
    """What pulls back beside K and B: minus the wrench of a force policy, zero for gains; (n, d)."""
    admissible: np.ndarray
    """Where K and B are positive semidefinite (n,): no impedance law takes other gains."""
    precision: float
    """Rounding of the policy's arithmetic: of double or of single precision."""

    def pull(self, states: Array) -> Array:
        """``K e + B ė + force`` (n, d), which the arm feels with its sign reversed."""
        e, rate = np.split(states, 2, axis=-1)
        return np.matvec(self.stiffness, e) + np.matvec(self.damping, rate) + self.force


class PolicyLoop:
    """The closed loop of a policy and a mass.

    Parameters
    ----------
    policy : callable or object
        A function of the observations (n, 2 d) = ``[e, ė]``, of the two arrays e and ė, or of a lone argument that
        is called ``e``; or an object with such a method: ``mean`` (a policy of :mod:`vic_toolbox.learning`) or
        ``gains`` (an expert of :mod:`vic_toolbox.control`). Arrays of one axis are (n,). It may be written for one
        state only, see :func:`~vic_toolbox.stability.policies.policy_call.policy_call`. It returns one of

        - a pair (K, B), or :class:`~vic_toolbox.gains.ImpedanceGains`: numbers, (n,), (n, d) diagonals or (n, d, d);
        - K alone, with `damping` given; or (n, 2 d) diagonals of K, then of B;
        - actions of a `parametrisation`, clipped to [−1, 1] as the tasks do;
        - with ``output="wrench"``, the feedback wrench F_fb (n, d).

        Torch tensors are taken as they are.
    mass : array_like
        M: a number, or (d, d).
    damping : array_like, optional
        Fixed B of a policy that sets K or a wrench: a number, or (d, d).
    parametrisation : Parametrisation, optional
        What the policy's actions mean.
    output : {'gains', 'wrench'}
        What the policy returns.
    history : int
        How many observations it wants, newest last. It gets the same one `history` times, which is what it sees
        while the arm moves slowly against its memory.
    load : array_like, optional
        Constant wrench (d,) that pushes on the arm, ``−F_ext``; zero by default.

    Attributes
    ----------
    mass : ndarray, shape (d, d)
    load : ndarray, shape (d,)
    output, history, parametrisation
        As given.

    Raises
    ------
    InputError
        Arguments that do not fit each other.
    """

    def __init__(
        self,
        policy: Any,
        mass: ArrayLike,
        *,
        damping: ArrayLike | None = None,
        parametrisation: Parametrisation | None = None,
        output: Literal["gains", "wrench"] = "gains",
        history: int = 1,
        load: ArrayLike | None = None,
    ) -> None:
        self.mass = positive_matrices("mass", mass)
        if self.mass.ndim != 2:
            raise InputError(f"mass has shape {np.shape(mass)}; pass one number or one (d, d) matrix.")
        d = len(self.mass)
        self.output = one_of("output", output, OUTPUTS)
        self.parametrisation = parametrisation
        if parametrisation is not None and (output == "wrench" or damping is not None):
            raise InputError("a parametrisation sets K and B; leave out damping and output='wrench'.")
        if parametrisation is not None and d != 6:
            raise InputError(f"a parametrisation sets six axes and mass is {d} × {d}; pass a (6, 6) mass.")
        self._damping = None if damping is None else _fixed_damping(damping, d)
        self.load = np.zeros(d) if load is None else np.atleast_1d(finite_array("load", load))
        if self.load.shape != (d,):
            raise InputError(f"load has shape {self.load.shape}; pass {d} numbers.")
        self.history = integer("history", history, low=1)
        self._inverse = np.linalg.inv(self.mass)
        self._ask = policy_call(policy, d, self.history)

    @property
    def size(self) -> int:
        """Number of axes d."""
        return len(self.mass)

    def __call__(self, states: Array) -> Answer:
        """Ask the policy at states (n, 2 d).

        Raises
        ------
        InputError
            It fails, or returns something else than finite gains (a wrench) of the right shape.
        """
        n, d = len(states), self.size
        if n == d > 1:  # (n,) and (d,), or (n, d) and (d, d), could not be told apart
            more = self(np.concatenate([states, states[-1:]]))
            parts = {name: part[:-1] for name, part in more._asdict().items() if name != "precision"}
            return more._replace(**parts)
        try:
            raw = self._ask(np.tile(states, (1, self.history)))
        except InputError:
            raise
        except Exception as error:
            raise InputError(
                f"the policy failed on observations of shape ({n}, {2 * d * self.history}): {error!r}; "
                "it must take [e, ė] in rows, or the arrays e and ė (one with a memory: see history)."
            ) from error
        precision = max(_precision(part) for part in raw)
        if self.output == "wrench":
            wrench = _finite("wrench", raw[0] if len(raw) == 1 else np.array(raw), states).reshape(n, -1)
            if wrench.shape != (n, d):
                raise InputError(f"the policy's wrench has shape {wrench.shape}; it must be ({n}, {d}).")
            damping = np.zeros((d, d)) if self._damping is None else self._damping
            fixed = np.broadcast_to(damping, (n, d, d))
            return Answer(np.zeros((n, d, d)), fixed, -wrench, np.ones(n, bool), precision)
        stiffness, damping = self._gains(raw, states)
        k, soft = _as_matrices("stiffness", stiffness, states)
        b, limp = _as_matrices("damping", damping, states)
        return Answer(k, b, np.zeros((n, d)), (soft >= 0) & (limp >= 0), precision)

    def acceleration(self, states: Array) -> Array:
        """ë (n, d) at states (n, 2 d)."""
        return np.asarray(np.matvec(self._inverse, self.load - self(states).pull(states)), dtype=np.float64)

    def derivative(self, states: Array) -> Array:
        """``d/dt [e, ė]`` (n, 2 d)."""
        return np.concatenate([states[:, self.size :], self.acceleration(states)], axis=-1)

    def normal(self, frequency: float) -> Array:
        """The map (2 d, 2 d) of a state to ``[ω Lᵀ e; Lᵀ ė]`` with M = L Lᵀ, where all entries share one unit [√J].

        In these coordinates metres and radians, and whatever units the user has, compare.
        """
        root = np.linalg.cholesky(self.mass).T
        return np.asarray(np.kron(np.diag([frequency, 1.0]), root), dtype=np.float64)

    def _gains(self, raw: list[Any], states: Array) -> tuple[Array, Array]:
        n, d = len(states), self.size
        if len(raw) == 2:
            if self._damping is not None:
                raise InputError("the policy returns K and B; leave out damping.")
            return _finite("stiffness", raw[0], states), _finite("damping", raw[1], states)
        if len(raw) != 1:
            raise InputError(f"the policy returns {len(raw)} arrays; it must return (K, B), or one array.")
        answer = _finite("answer", raw[0], states)
        if self.parametrisation is not None:
            if answer.shape != (n, self.parametrisation.size):
                raise InputError(
                    f"the policy's actions have shape {answer.shape}; {type(self.parametrisation).__name__} "
                    f"takes ({n}, {self.parametrisation.size})."
                )
            gains = self.parametrisation.to_gains(np.clip(answer, -1.0, 1.0))
            return gains.stiffness, gains.damping
        if self._damping is not None:
            return answer, np.broadcast_to(self._damping, (n, d, d))
        if answer.shape == (n, 2 * d):
            return answer[:, :d], answer[:, d:]
        raise InputError(
            f"the policy returns one array of shape {answer.shape}: stiffness without damping? "
            f"Pass damping=..., a parametrisation, or let it return (K, B) or ({n}, {2 * d}) diagonals."
        )


def _fixed_damping(damping: ArrayLike, d: int) -> Array:
    fixed = positive_matrices("damping", damping, definite=False)
    if fixed.shape not in ((1, 1), (d, d)):
        raise InputError(f"damping has shape {np.shape(damping)}; pass a number or ({d}, {d}).")
    return fixed * np.eye(d) if len(fixed) == 1 else fixed


def _precision(value: ArrayLike) -> float:
    """Whether numbers carry double precision, or were computed in single precision."""
    try:
        array = np.asarray(value)
    except ValueError:  # ragged: said when it is read
        return DOUBLE
    if array.dtype.kind != "f" or array.dtype.itemsize < 8:
        return SINGLE if array.dtype.kind == "f" else DOUBLE
    with np.errstate(over="ignore", invalid="ignore"):
        same = (array.astype(np.float32) == array).all()
    return SINGLE if array.size and same and array.min() < array.max() else DOUBLE


def _finite(name: str, value: ArrayLike, states: Array) -> Array:
    try:
        array = np.asarray(value)
    except ValueError as error:
        raise InputError(f"the policy's {name} is not an array of numbers ({error}).") from error
    if array.dtype.kind not in "fiu":
        raise InputError(f"the policy's {name} holds {array.dtype}, not real numbers.")
    array = array.astype(np.float64, copy=False)
    bad = ~np.isfinite(array)
    if bad.any():
        row = int(np.nonzero(bad)[0][0]) if array.ndim and len(array) == len(states) else 0
        raise InputError(
            f"the policy's {name} is {array[bad].flat[0]} at [e, ė] = {np.array2string(states[row], precision=4)}; "
            "its answers must be finite."
        )
    return array


def _as_matrices(name: str, value: Array, states: Array) -> tuple[Array, Array]:
    """Gains as (n, d, d), with the smallest eigenvalue of each (n,)."""
    n, d = len(states), states.shape[1] // 2
    if value.shape == (n, d, d) and d > 1:
        lopsided = np.abs(value - np.swapaxes(value, 1, 2)).max(axis=(1, 2))
        uneven = lopsided > SYMMETRY * np.abs(value).max(axis=(1, 2))
        if uneven.any():
            where = np.array2string(states[int(np.argmax(uneven))], precision=4)
            raise InputError(
                f"the policy's {name} is not symmetric at [e, ė] = {where} (by {lopsided.max():.3g}); "
                "a skew part is no spring and no damper: return symmetric matrices."
            )
        if not (value * (1 - np.eye(d))).any():
            return value, np.diagonal(value, axis1=1, axis2=2).min(axis=1)
        # a zero eigenvalue may round to a negative one
        return value, np.linalg.eigvalsh(value)[:, 0] + ROUNDING * np.abs(value).max(axis=(1, 2))
    if value.shape == (n, 1, 1) or (value.ndim == 2 and value.shape == (n, d)):
        diagonal = value.reshape(n, d)
    elif value.shape in ((), (n,)) and d == 1:
        diagonal = np.broadcast_to(value, (n,)).reshape(n, 1)
    elif value.shape == (n,) and n != d:
        diagonal = np.repeat(value[:, None], d, axis=1)
    elif value.shape in ((), (d,)):
        diagonal = np.broadcast_to(value, (n, d))
    elif value.shape == (d, d):
        return _as_matrices(name, np.broadcast_to(value, (n, d, d)), states)
    else:
        raise InputError(
            f"the policy's {name} has shape {value.shape}; for {n} observations of {d} axes return ({n},), "
            f"({n}, {d}) diagonals or ({n}, {d}, {d}) matrices."
        )
    return diagonal[:, :, None] * np.eye(d), diagonal.min(axis=1)
