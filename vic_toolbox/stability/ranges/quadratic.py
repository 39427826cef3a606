"""The best common quadratic Lyapunov function of several linear systems, by an LMI (cvxpy, Clarabel)."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigh

from vic_toolbox.errors import require

ROUNDS = 60
"""Most bisections of the decay rate."""
DIGITS = 9
"""Decimals of the systems that the solver sees: so it sees the same numbers in whatever units the gains were given."""
PRECISION = 1e-4
"""Of the decay rate, relative to the fastest system; no precision is asked of its sign."""


class CommonQuadratic(NamedTuple):
    """P ≻ 0 with ``Aᵢᵀ P + P Aᵢ ⪯ −2 rate P`` for all i, as its eigenvalues say; negative if V may grow."""

    matrix: np.ndarray
    rate: float


class Trouble(NamedTuple):
    """What the solver did instead of solving."""

    message: str


def best_common_quadratic(systems: np.ndarray, *, sign_only: bool = False) -> CommonQuadratic | Trouble:
    """P with the largest decay rate (a generalised eigenvalue problem, by bisection) for systems (n, N, N), O(1).

    `sign_only` stops as soon as it is known whether the rate is positive. Every P is judged by its own eigenvalues,
    never by the solver's word; the rate that is returned is that of P. Boyd et al., Linear Matrix Inequalities in
    System and Control Theory, 1994, sec. 5.1.

    Raises
    ------
    DependencyError
        cvxpy or Clarabel is missing.
    """
    require("lmi", "cvxpy", "clarabel")
    systems = np.unique(systems, axis=0)
    ceiling = -np.linalg.eigvals(systems).real.max()  # V cannot fall faster than the slowest mode
    floor = -np.linalg.eigvalsh(0.5 * (systems + np.swapaxes(systems, 1, 2))).max()  # that of P = 1
    best = CommonQuadratic(np.eye(systems.shape[-1]), float(floor))
    problem = _Problem(systems)
    trouble: Trouble | None = None
    # at the rate 0 first: its sign is what a verdict needs
    tried = 0.0 if floor < 0 < ceiling else 0.5 * (floor + ceiling)
    for _ in range(ROUNDS):
        found = problem.solve(round(float(tried), DIGITS))
        if isinstance(found, Trouble):
            trouble = trouble or found
        elif found is not None and found.rate > best.rate:
            best = found
        floor = max(best.rate, floor)
        ceiling = ceiling if best.rate >= tried else tried
        known = sign_only and (floor > 0 or ceiling <= 0)
        if known or ceiling - floor <= PRECISION * np.abs(systems).max():
            break
        tried = 0.5 * (floor + ceiling)
    return best if trouble is None or best.rate > 0 else trouble


class _Problem:
    """Maximise the smallest slack of ``−(Aᵢᵀ P + P Aᵢ) − 2 rate P ⪰ s`` and ``P ⪰ s``, trace P = N: always feasible."""

    def __init__(self, systems: np.ndarray) -> None:
        import cvxpy
        from cvxpy.error import SolverError

        size = systems.shape[-1]
        self.systems, self.error = systems, SolverError
        self.matrix = cvxpy.Variable((size, size), symmetric=True)
        self.rate, self.slack = cvxpy.Parameter(), cvxpy.Variable()
        room, moved = self.slack * np.eye(size), self.rate * self.matrix
        constraints = [self.matrix >> room, cvxpy.trace(self.matrix) == size]
        seen = np.unique(np.round(systems, DIGITS), axis=0)
        constraints += [-(a.T @ self.matrix + self.matrix @ a) - 2 * moved >> room for a in seen]
        self.problem = cvxpy.Problem(cvxpy.Maximize(self.slack), constraints)

    def solve(self, rate: float) -> CommonQuadratic | Trouble | None:
        """The P found, with the rate that its eigenvalues give; None where P is no solution."""
        self.rate.value = rate
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # "may be inaccurate": it is checked below
                self.problem.solve(solver="CLARABEL")
        except (self.error, ValueError, ArithmeticError) as error:
            return Trouble(f"the solver failed: {error}")
        if self.matrix.value is None:
            return Trouble(f"the solver gave no matrix (status {self.problem.status}).")
        found = checked(np.asarray(self.matrix.value), self.systems)
        claimed = self.slack.value is not None and float(self.slack.value) > 1e-6
        if claimed and (found is None or found.rate < rate - 1e-6):
            return Trouble(
                f"the solver said {self.problem.status}, but its P does not hold when it is checked."
            )
        return found


def checked(matrix: np.ndarray, systems: np.ndarray) -> CommonQuadratic | None:
    """P with the rate that holds for all systems, from the pencils (AᵢᵀP + P Aᵢ, P); None if P is not ≻ 0."""
    matrix = 0.5 * (matrix + matrix.T)
    if not np.isfinite(matrix).all() or np.linalg.eigvalsh(matrix)[0] <= 1e-12 * np.abs(matrix).max():
        return None
    largest = -np.inf
    for system in systems:
        power = matrix.T @ system
        largest = max(largest, eigh(power + power.T, matrix, eigvals_only=True)[-1])
    return CommonQuadratic(matrix, -0.5 * float(largest))
