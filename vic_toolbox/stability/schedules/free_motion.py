r"""The free motion of ``M(t) ë + D(t) ė + K(t) e = 0``, by two routes that share nothing but the equation.

Transition matrices come from three-stage Gauss collocation (order six, A-stable, symplectic where D is zero), all steps
at once; single motions from an adaptive integrator of SciPy. Both work in coordinates that know no units: ``√m_ii e_i``
and the velocities over one frequency of the system, so that a change of units changes neither errors nor verdicts.

References
----------
E. Hairer, C. Lubich, G. Wanner, "Geometric Numerical Integration", Springer, 2006, table II.1.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability.arguments import Source, at
from vic_toolbox.stability.schedules.definite import unpack
from vic_toolbox.stability.schedules.schedule import Schedule

Matrices = tuple[Array, Array, Array]

_ROOT = np.sqrt(15.0)
_NODES = np.array([0.5 - _ROOT / 10, 0.5, 0.5 + _ROOT / 10])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18
_STAGES = np.array(
    [
        [5 / 36, 2 / 9 - _ROOT / 15, 5 / 36 - _ROOT / 30],
        [5 / 36 + _ROOT / 24, 2 / 9, 5 / 36 - _ROOT / 24],
        [5 / 36 + _ROOT / 30, 2 / 9 + _ROOT / 15, 5 / 36],
    ]
)
CHUNK = 1024
"""Steps taken together."""
EVALUATIONS = 500_000
"""Most evaluations of the gains in one integration: about half a minute."""
SAMPLES = 65
"""Instants at which the size of the gains is looked at."""
REFERENCE, CHECK = "DOP853", "LSODA"
"""Integrators of SciPy: an explicit one-step method, and a multi-step method that turns implicit where it must."""


class IntegrationError(InputError):
    """A motion could not be integrated: the gains are not finite, or change too wildly."""


@dataclass(frozen=True, eq=False)
class FreeMotion:
    """An impedance whose mass, stiffness and damping are known at every instant of an interval.

    Parameters
    ----------
    matrices : callable
        Takes instants (m,) and returns M, K and D, (m, d, d) each.
    start, stop : float
        The interval [s].
    """

    matrices: Callable[[Array], Matrices]
    start: float
    stop: float

    @classmethod
    def sampled(cls, mass: Schedule, stiffness: Schedule, damping: Schedule) -> FreeMotion:
        """Between the samples of schedules."""

        def matrices(t: Array) -> Matrices:
            m, k, d = (unpack(s.at(t)[0]) for s in (mass, stiffness, damping))
            return m, k, d

        return cls(matrices, float(mass.time[0]), float(mass.time[-1]))

    @classmethod
    def given(cls, mass: Source, stiffness: Source, damping: Source, *, stop: float) -> FreeMotion:
        """Of constants and functions of time, from zero to `stop`."""

        def over_time(name: str, source: Source) -> Callable[[Array], Array]:
            if callable(source):
                return lambda t: np.stack([at(name, source, float(x)) for x in t])
            constant = at(name, source, 0.0)
            return lambda t: np.broadcast_to(constant, (len(t), *constant.shape))

        parts = [
            over_time(*pair) for pair in (("mass", mass), ("stiffness", stiffness), ("damping", damping))
        ]

        def matrices(t: Array) -> Matrices:
            m, k, d = (part(t) for part in parts)
            return m, k, d

        return cls(matrices, 0.0, stop)

    @cached_property
    def _sizes(self) -> tuple[Array, float]:
        """√m_ii of each axis, and a frequency ω [1/s] of the system."""
        m, k, d = self.matrices(np.linspace(self.start, self.stop, SAMPLES))
        inertia = np.diagonal(m, axis1=1, axis2=2).mean(axis=0)
        squares = np.abs(np.diagonal(k, axis1=1, axis2=2)) / inertia
        rates = np.abs(np.diagonal(d, axis1=1, axis2=2)) / inertia
        turn = 2 * np.pi / (self.stop - self.start)
        return np.sqrt(inertia), float(np.sqrt(squares.max() + turn**2) + rates.max())

    @cached_property
    def scale(self) -> Array:
        """What the coordinates without units are multiplied by to give [e; ė], shape (2 d,)."""
        root, frequency = self._sizes
        return np.concatenate([1 / root, frequency / root])

    def energy(self, t: Array, state: Array) -> Array:
        """½ ėᵀ M ė + ½ eᵀ K e [J] of states (m, 2 d) at instants (m,)."""
        m, k, _ = self.matrices(t)
        e, rate = np.split(state, 2, axis=1)
        return 0.5 * (np.einsum("ni,nij,nj->n", rate, m, rate) + np.einsum("ni,nij,nj->n", e, k, e))

    def size(self, state: Array) -> Array:
        """½ Σ m (ė² + ω² e²) [J] of states (m, 2 d): positive whatever the stiffness is."""
        frequency = self._sizes[1]
        return 0.5 * frequency**2 * np.sum((state / self.scale) ** 2, axis=1)

    def system(self, t: Array) -> Array:
        """A(t) of the first-order form, in the coordinates without units, (m, 2 d, 2 d) [1/s]."""
        m, k, d = self.matrices(t)
        size = m.shape[-1]
        found = np.zeros((len(t), 2 * size, 2 * size))
        found[:, :size, size:] = np.eye(size)
        found[:, size:, :size] = -np.linalg.solve(m, k)
        found[:, size:, size:] = -np.linalg.solve(m, d)
        return found * self.scale / self.scale[:, None]

    def steps(self, edges: Array) -> Array:
        """Transition matrices over each interval of `edges` (m + 1,), (m, 2 d, 2 d), without units."""
        count = len(edges) - 1
        return np.concatenate(
            [self._collocated(edges[k : min(k + CHUNK, count) + 1]) for k in range(0, count, CHUNK)]
        )

    def _collocated(self, edges: Array) -> Array:
        width = np.diff(edges)
        a = [self.system(edges[:-1] + c * width) for c in _NODES]
        size, count = a[0].shape[-1], len(width)
        left = np.empty((count, 3, size, 3, size))
        for i in range(3):
            for j in range(3):
                left[:, i, :, j] = -width[:, None, None] * _STAGES[i, j] * a[j]
            left[:, i, :, i] += np.eye(size)
        right = np.broadcast_to(np.tile(np.eye(size), (3, 1)), (count, 3 * size, size))
        y = np.linalg.solve(left.reshape(count, 3 * size, 3 * size), right).reshape(count, 3, size, size)
        slope = sum(w * (x @ y[:, i]) for i, (w, x) in enumerate(zip(_WEIGHTS, a, strict=True)))
        return np.eye(size) + width[:, None, None] * slope

    def transition(self, *, most: int, tolerance: float) -> tuple[Array, float] | None:
        """Φ over the whole interval (without units) with its error, by doubling the steps up to `most`; or None."""
        count, before = 64, None
        while count <= most:
            found = product(self.steps(np.linspace(self.start, self.stop, count + 1)))
            if not np.isfinite(found).all():
                return None
            if before is not None:
                error = float(np.abs(found - before).max())
                if error <= tolerance * max(1.0, float(np.abs(found).max())):
                    return found, error
            before, count = found, 2 * count
        return None

    def integrated(self, t: Array, *, method: str, rtol: float) -> Array:
        """Φ from the start to the instants t (m,), (m, 2 d, 2 d) without units, by one of SciPy's integrators.

        Raises
        ------
        IntegrationError
            It gave up.
        """
        size = len(self.scale)
        flat = self._solve(np.eye(size).reshape(-1), t, method, rtol)
        return flat.T.reshape(len(t), size, size)

    def motion(
        self, state: Array, t: Array, *, method: str = REFERENCE, rtol: float = 1e-11, rounds: int = 1
    ) -> Array:
        """States [e; ė] (m, 2 d) at instants t within the interval, from `state` at its start.

        Where the interval is a period, `rounds` of them follow each other and t counts on.
        """
        now, length = np.asarray(state, dtype=np.float64) / self.scale, self.stop - self.start
        found = np.empty((len(t), len(now)))
        for k in range(rounds):
            begin, end = self.start + k * length, self.start + (k + 1) * length
            inside = (t >= begin) & ((t < end) | (k == rounds - 1))
            local = np.clip(t[inside] - k * length, self.start, self.stop)
            size = float(np.abs(now).max()) or 1.0
            instants, place = np.unique(np.append(local, self.stop), return_inverse=True)
            path = self._solve(now / size, instants, method, rtol).T * size
            found[inside], now = path[place[:-1]], path[-1]
        return found * self.scale

    def _solve(self, start: Array, t: Array | None, method: str, rtol: float) -> Array:
        size = len(self.scale)

        calls = 0

        def rate(time: float, y: Array) -> Array:
            nonlocal calls
            calls += 1
            if calls > EVALUATIONS:
                raise IntegrationError(
                    f"the motion over {self.stop - self.start:.6g} s was given up after {EVALUATIONS} evaluations of "
                    "the gains: it oscillates too fast, or the gains change too wildly; pass a shorter interval."
                )
            return (self.system(np.array([time]))[0] @ y.reshape(size, -1)).reshape(-1)

        solution: Any = solve_ivp(
            rate,
            (self.start, self.stop),
            start,
            method=method,
            t_eval=t,
            rtol=rtol,
            atol=1e-2 * rtol,
            max_step=(self.stop - self.start) / 64,  # so that no short pulse of a gain is stepped over
        )
        if not solution.success or not np.isfinite(solution.y).all():
            raise IntegrationError(
                f"the motion could not be integrated by {method} ({solution.message}); are the gains finite?"
            )
        return solution.y


def product(steps: Array) -> Array:
    """``Φ_m … Φ_2 Φ_1`` of (m, ·, ·), in pairs."""
    while len(steps) > 1:
        pairs = steps[1::2] @ steps[: len(steps) - len(steps) % 2 : 2]
        steps = np.concatenate([pairs, steps[-1:]]) if len(steps) % 2 else pairs
    return steps[0]
