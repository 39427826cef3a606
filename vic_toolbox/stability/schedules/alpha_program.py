"""The cone program for α(t): a periodic cubic spline with the largest common slack of the three inequalities.

    α M ⪯ D,    K̇ + d(α D)/dt − 2 α K − α̈ M ⪯ 0,    K + α D − α̇ M − q M ⪰ 0 with q ≥ α² .

They are asked for at the knots, between which α̈ is a straight line, and half-way; in units in which mass, gains and
time are about one, so that the solver's tolerances mean the same whatever the units of the problem.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse

from vic_toolbox.errors import Array, require
from vic_toolbox.stability.schedules.alpha_interval import Problem
from vic_toolbox.stability.schedules.definite import ROUNDING, least_ratio, lower, pack, relative_slack

POINTS = 2
"""Instants for each interval of the spline at which the inequalities are asked for ..."""
CHECKED = 16
"""... and at which they are checked."""


@dataclass(frozen=True, eq=False)
class AlphaProgram:
    """The cone program, in units of a frequency, with a mass of unit diagonal and gains of about one."""

    problem: Problem
    frequency: float
    """ω [1/s]: time is counted in 1/ω, α in ω."""
    scale: Array
    """What divides each axis of ``ω⁻² K`` in units of the mass, (d,)."""
    count: int
    reference: float
    """Typical α, in ω."""

    @classmethod
    def of(cls, problem: Problem, count: int) -> AlphaProgram:
        """With a spline of `count` intervals over the problem's time."""
        inertia = problem.mass[problem.axes, 0]
        k = problem.stiffness.values[problem.axes].max(axis=1) / inertia
        d = problem.damping.values[problem.axes].max(axis=1) / inertia
        squares = k + d**2
        frequency = float(np.sqrt(squares.max())) or 1.0
        scale = np.where(squares > 0, np.sqrt(squares) / frequency, 1.0)
        return cls(problem, frequency, scale * np.sqrt(inertia), count, max(float(d.max()) / frequency, 1e-6))

    @property
    def spacing(self) -> float:
        """Of the knots [s]."""
        return float(self.problem.time[-1] - self.problem.time[0]) / self.count

    def spline(self, t: Array) -> tuple[Any, Any, Any]:
        """Sparse (m, count) matrices that give α, α̇ and α̈ (in ω, ω², ω³) at instants t from the coefficients."""
        place = (t - self.problem.time[0]) / self.spacing
        first = np.clip(np.floor(place).astype(np.intp), 0, self.count - 1)
        u = place - first
        h = self.spacing * self.frequency
        zeroth = np.stack([(1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, 1 + 3 * u + 3 * u**2 - 3 * u**3, u**3]) / 6
        rate = np.stack([-((1 - u) ** 2), 3 * u**2 - 4 * u, 1 + 2 * u - 3 * u**2, u**2]) / (2 * h)
        bend = np.stack([1 - u, 3 * u - 2, 1 - 3 * u, u]) / h**2
        rows = np.tile(np.arange(len(t)), 4)
        columns = (first + np.arange(4)[:, None]).reshape(-1) % self.count
        shape = (len(t), self.count)
        a, b, c = (sparse.csr_matrix((x.reshape(-1), (rows, columns)), shape) for x in (zeroth, rate, bend))
        return a, b, c

    def gains(self, t: Array) -> tuple[Array, ...]:
        """M, K, D, K̇ and Ḋ at instants (m,) in the program's units, (m, d, d)."""
        problem, w = self.problem, self.frequency
        (k, k_slope), (d, d_slope) = problem.stiffness.at(t), problem.damping.at(t)
        mass = np.repeat(problem.mass, len(t), axis=1)
        rows = (mass, k / w**2, d / w, k_slope / w**3, d_slope / w**2)
        size = self.scale[:, None] * self.scale
        return tuple(problem.matrices(x) / size for x in rows)

    def solved(self) -> tuple[Array | None, float, str]:
        """Coefficients of α (in ω), the slack, and what went wrong if there are none."""
        require("lmi", "clarabel")
        import clarabel as library

        clarabel: Any = library
        step = self.spacing / POINTS
        t = self.problem.time[0] + step * np.arange(self.count * POINTS)
        matrix, right, cones = self._cones(t, clarabel)
        size = matrix.shape[1]
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        cost = np.zeros(size)
        cost[-1] = -1.0
        solver = clarabel.DefaultSolver(sparse.csc_matrix((size, size)), cost, matrix, right, cones, settings)
        solution = solver.solve()
        found = np.asarray(solution.x)
        if str(solution.status) not in ("Solved", "AlmostSolved") or not np.isfinite(found).all():
            return None, float("nan"), f"Clarabel stopped with {solution.status}"
        return found[: self.count], float(found[-1]), ""

    def _cones(self, t: Array, clarabel: Any) -> tuple[Any, Array, list[Any]]:
        """``b − A x`` in the cones, with x the coefficients, q at every instant, and the slack."""
        m, k, d, k_slope, d_slope = self.gains(t)
        zeroth, rate, bend = self.spline(t)
        n, unit = len(t), np.broadcast_to(np.eye(m.shape[1]), m.shape)

        def packed(x: Array) -> Array:
            return np.diagonal(x, axis1=1, axis2=2) if self.problem.diagonal else pack(x).T * weights

        rows, columns = lower(m.shape[1])
        weights = np.where(rows == columns, 1.0, np.sqrt(2.0))  # of Clarabel's triangle
        width = m.shape[1] if self.problem.diagonal else len(rows)

        def weighted(basis: Any, by: Array) -> Any:
            return sparse.diags(packed(by).reshape(-1)) @ sparse.kron(basis, np.ones((width, 1)))

        def column(by: Array) -> Any:
            return sparse.csr_matrix(packed(by).reshape(-1, 1))

        eye, empty = sparse.eye(n), None
        allowed = least_ratio(d, m)
        blocks = [
            # a − α ≥ s r
            [-zeroth, empty, sparse.csr_matrix(np.full((n, 1), -self.reference))],
            # q ≥ α² as |(q − 1, 2 α)| ≤ q + 1, and s ≤ 1
            [sparse.kron(zeroth, [[0.0], [0.0], [2.0]]), sparse.kron(eye, [[1.0], [1.0], [0.0]]), empty],
            [empty, empty, sparse.csr_matrix([[-1.0]])],
            # 2 α K + α̈ M − K̇ − α Ḋ − α̇ D ⪰ s r
            [
                weighted(zeroth, 2 * k - d_slope) - weighted(rate, d) + weighted(bend, m),
                empty,
                -self.reference * column(unit),
            ],
            # K + α D − α̇ M − q M ⪰ s
            [weighted(zeroth, d) - weighted(rate, m), -weighted(eye, m), -column(unit)],
        ]  # fmt: skip
        constants = [
            allowed,
            np.tile([1.0, -1.0, 0.0], n),
            np.ones(1),
            -packed(k_slope).reshape(-1),
            packed(k).reshape(-1),
        ]
        cones = [
            clarabel.NonnegativeConeT(n),
            *[clarabel.SecondOrderConeT(3)] * n,
            clarabel.NonnegativeConeT(1),
        ]
        if self.problem.diagonal:
            cones += [clarabel.NonnegativeConeT(2 * n * width)]
        else:
            cones += [clarabel.PSDTriangleConeT(m.shape[1])] * (2 * n)
        shaped = [[self.count, n, 1][i] for i in range(3)]
        filled = [
            [
                part if part is not None else sparse.csr_matrix((len(b), shaped[i]))
                for i, part in enumerate(row)
            ]
            for row, b in zip(blocks, constants, strict=True)
        ]
        return -sparse.csc_matrix(sparse.bmat(filled)), np.concatenate(constants), cones

    def checked(self, coefficients: Array) -> float:
        """Least eigenvalue of the three, relative to their terms, at the samples and many instants between them.

        The storage function must be positive definite: −inf where it is not.
        """
        time = self.problem.time
        t = np.union1d(np.linspace(time[0], time[-1], CHECKED * self.count + 1), time)
        m, k, d, k_slope, d_slope = self.gains(t)
        alpha, rate, bend = ((x @ coefficients)[:, None, None] for x in self.spline(t))
        rising = relative_slack(2 * alpha * k, bend * m, -k_slope, -alpha * d_slope, -rate * d)
        storage = relative_slack(k, alpha * d, -rate * m, -(alpha**2) * m)
        return min(rising, relative_slack(d, -alpha * m), storage if storage > ROUNDING else -np.inf)
