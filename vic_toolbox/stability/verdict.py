"""The answer of every method: proved, disproved or inconclusive, how far from the edge, and what shows it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vic_toolbox.errors import Array, InputError, one_of
from vic_toolbox.files import write_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Status = Literal["proved", "disproved", "inconclusive"]
STATUSES = ("proved", "disproved", "inconclusive")


@dataclass(frozen=True, eq=False)
class Certificate:
    """What proves a verdict: numbers that anybody can check again.

    Parameters
    ----------
    statement : str
        The inequality that holds, in symbols, e.g. ``αM − D ⪯ 0 and K̇ + αḊ − 2αK ⪯ 0``.
    values : mapping of str to number or ndarray
        What it holds with: ``P``, ``alpha``, …
    slack : float
        By how much it holds when it is checked by another route, in the units of the worst inequality; negative
        if it does not.
    """

    statement: str
    values: Mapping[str, Any]
    slack: float


@dataclass(frozen=True, eq=False)
class CounterExample:
    """What disproves: a motion from a small start that grows, and all that is needed to see it again.

    Parameters
    ----------
    description : str
        What happens, in one sentence.
    time : ndarray, shape (n,)
        Instants [s].
    state : ndarray, shape (n, 2 d)
        ``[e; ė]`` (and states of filters or the environment behind them) at these instants.
    energy : ndarray, shape (n,)
        The energy that grows [J], or the growing quantity that `description` names.
    gains : mapping of str to ndarray
        The gain sequence at these instants: ``stiffness``, ``damping`` (n, d, d), where it is part of the example.
    environment : mapping of str to number or ndarray
        What the arm touches: ``stiffness`` [N/m], …; empty for free motion.
    again : callable, optional
        Integrates the motion from a given initial state by another route and returns (time, state).
    """

    description: str
    time: Array
    state: Array
    energy: Array
    gains: Mapping[str, Array] = field(default_factory=dict)
    environment: Mapping[str, Any] = field(default_factory=dict)
    again: Callable[[Array], tuple[Array, Array]] | None = field(default=None, repr=False)

    @property
    def initial_state(self) -> Array:
        """The state that it starts from."""
        return self.state[0]

    @property
    def energy_gained(self) -> float:
        """From the first instant to the last [J]."""
        return float(self.energy[-1] - self.energy[0])

    @property
    def growth(self) -> float:
        """Norm of the last state over that of the first."""
        return float(np.linalg.norm(self.state[-1]) / np.linalg.norm(self.state[0]))

    def replay(self, initial_state: Any = None) -> tuple[Array, Array]:
        """Integrate the motion again, from its own start or another one; returns time (n,) and state (n, ·).

        Raises
        ------
        InputError
            The example cannot be integrated again, e.g. because it was recorded.
        """
        if self.again is None:
            raise InputError("this counter-example is a recording; read its time and state.")
        start = self.initial_state if initial_state is None else np.asarray(initial_state, dtype=np.float64)
        return self.again(start)


@dataclass(frozen=True, eq=False)
class Verdict:
    """Is it stable (or passive), how far from the edge, and what shows it.

    Parameters
    ----------
    status : {'proved', 'disproved', 'inconclusive'}
        *Proved* is given only after the certificate was checked by another route, *disproved* only with a
        counter-example; a certificate that does not exist proves nothing.
    question : str
        What was asked, in one sentence with its equation.
    method : str
        How it was answered, with its source.
    margin : float
        Distance from the edge in `margin_unit`, positive on the good side; NaN where there is none.
    margin_unit : str
        Unit and meaning of the margin, e.g. ``"Ns/m of damping"``.
    values : mapping of str to number or ndarray
        The method's named numbers.
    witness : Certificate or CounterExample, optional
        What shows it.
    assumptions : tuple of str
        Under which the verdict holds.
    reason : str
        Why it is inconclusive, or what limits the margin.
    """

    status: Status
    question: str
    method: str
    margin: float = float("nan")
    margin_unit: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)
    witness: Certificate | CounterExample | None = None
    assumptions: tuple[str, ...] = ()
    reason: str = ""

    def __post_init__(self) -> None:
        one_of("status", self.status, STATUSES)
        if self.status == "proved" and not (
            isinstance(self.witness, Certificate) and self.witness.slack >= 0
        ):
            raise InputError(
                'a verdict is "proved" only with a certificate that holds when it is checked again.'
            )
        if self.status == "disproved" and not isinstance(self.witness, CounterExample):
            raise InputError('a verdict is "disproved" only with a counter-example.')

    def summary(self) -> str:
        """Everything in a few lines of text."""
        lines = [f"{self.status.upper()}: {self.question}", f"  method: {self.method}"]
        if np.isfinite(self.margin):
            lines.append(f"  margin: {self.margin:.6g} {self.margin_unit}")
        lines += [f"  {name}: {_short(value)}" for name, value in self.values.items()]
        if isinstance(self.witness, Certificate):
            lines.append(f"  certificate: {self.witness.statement} (slack {self.witness.slack:.3g})")
        elif self.witness is not None:
            lines.append(f"  counter-example: {self.witness.description}")
        if self.reason:
            lines.append(f"  reason: {self.reason}")
        lines += [f"  assuming {text}" for text in self.assumptions]
        return "\n".join(lines)

    def __str__(self) -> str:
        return self.summary()

    def plot(self) -> Figure:
        """Draw what shows it: a growing motion with its energy, or the certificate's numbers."""
        from vic_toolbox.stability.picture import draw

        return draw(self)

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, texts and lists, for JSON; what is not finite becomes None."""
        names = ("status", "question", "method", "margin", "margin_unit", "values", "assumptions", "reason")
        found = {name: _plain(getattr(self, name)) for name in names}
        return found | {"witness": _witness(self.witness)}

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write :meth:`to_dict` as JSON, as a whole or not at all.

        Raises
        ------
        FileError
            The file cannot be written.
        """
        write_json(path, self.to_dict())


def status_of(witness: Certificate | CounterExample | None) -> Status:
    """What a witness that was checked shows: a certificate proves, a counter-example disproves."""
    if witness is None:
        return "inconclusive"
    return "proved" if isinstance(witness, Certificate) else "disproved"


def _witness(witness: Certificate | CounterExample | None) -> dict[str, Any] | None:
    if witness is None:
        return None
    if isinstance(witness, Certificate):
        return {
            "kind": "certificate",
            **{n: _plain(getattr(witness, n)) for n in ("statement", "values", "slack")},
        }
    names = ("description", "time", "state", "energy", "gains", "environment", "energy_gained", "growth")
    return {"kind": "counter-example", **{n: _plain(getattr(witness, n)) for n in names}}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(name): _plain(entry) for name, entry in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    if isinstance(value, complex):
        return [_plain(value.real), _plain(value.imag)]
    if isinstance(value, (int, float, np.number)):
        number = value.item() if isinstance(value, np.number) else value
        return number if np.isfinite(number) else None
    return value if value is None else str(value)


def _short(value: Any) -> str:
    array = np.asarray(value)
    if array.ndim == 0:
        return f"{value:.6g}" if array.dtype.kind in "fi" else str(value)
    return f"array of shape {array.shape}" if array.size > 6 else np.array2string(array, precision=4)
