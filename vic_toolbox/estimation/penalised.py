"""Penalised least squares in banded form: smoothness chosen by REML, uncertainty from the posterior.

The coefficients c of the splines, and constant unknowns β beside them, minimise ::

    ‖y − X c − Z β‖² + Σ_g λ_g Σ_{i in g} ‖Δ^o c_i‖²

where Δ^o takes differences of order o, two or three, along time (Eilers and Marx 1996). Seen as a mixed model,
Δ^o c ~ N(0, σ²/λ), and the restricted likelihood of λ with σ² at its best is, up to a constant, −V/2 with (Wood 2011)

    V(λ, o) = (N − M) log σ̂² + log det H_λ − Σ_g rank_g log λ_g − q log det ΔΔᵀ,

with σ̂² = (least value of the above) / (N − M), M the unpenalised dimensions and q the number of splines. Every
evaluation is one banded Cholesky factorisation. The posterior of c has covariance σ̂² H_λ⁻¹, of which only the band is
needed (:mod:`.selected_inverse`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.optimize import minimize

from vic_toolbox.errors import Array
from vic_toolbox.estimation.differences import ORDER, log_determinant, squared_differences
from vic_toolbox.estimation.selected_inverse import selected_inverse
from vic_toolbox.estimation.splines import NormalEquations

LOG_RANGE = (-46.0, 30.0)
"""Range of log λ relative to the data's information; its lower end stands for no penalty."""
LARGEST_LOG = 300.0
"""Beyond it λ would overflow."""
RIDGE = 1e-13
STIFFEST = 18.0
"""Largest log λ of third differences, relative to the data's information: beyond it rounding hides the data."""


@dataclass(frozen=True, eq=False)
class Problem:
    """One penalised problem.

    Parameters
    ----------
    gram : ndarray, shape (width, m, q, q)
    right : ndarray, shape (m, q)
    squares : float
    border, corner, border_right : ndarray
        As in :class:`NormalEquations`, of one problem.
    count : float
    groups : ndarray of int, shape (q,)
        Which λ belongs to each spline.
    resolution : float, optional
        Residual, relative to the targets, below which smaller is not better.
    order : int, optional
        Of the differences that are penalised.
    """

    gram: Array
    right: Array
    squares: float
    border: Array
    corner: Array
    border_right: Array
    count: float
    groups: NDArray[np.intp]
    resolution: float = 1e-8
    order: int = ORDER

    @classmethod
    def of(
        cls, equations: NormalEquations, index: int, groups: NDArray[np.intp], *, order: int = ORDER
    ) -> Problem:
        """Problem number `index` of several."""
        e = equations
        return cls(
            e.gram[index],
            e.right[index],
            float(e.squares[index]),
            e.border[index],
            e.corner[index],
            e.border_right[index],
            float(e.count[index]),
            groups,
            order=order,
        )

    @property
    def size(self) -> tuple[int, int]:
        """Coefficients of a spline, and splines."""
        return self.right.shape[0], self.right.shape[1]

    def band(self, gram: Array) -> Array:
        """LAPACK's lower band of the matrix with the blocks `gram`, unknowns ordered by knot."""
        m, q = self.size
        width = gram.shape[0]
        band = np.zeros((width * q, m * q))
        for d in range(width):
            for row in range(q):
                for column in range(row + 1 if d == 0 else q):
                    band[d * q + row - column, column : (m - d) * q : q] = gram[d, : m - d, column, row]
        return band

    def penalised(self, logarithms: Array) -> Array:
        """Blocks of H_λ."""
        m, q = self.size
        bands = squared_differences(m, self.order)
        width = max(len(bands), self.gram.shape[0]) if m > self.order else self.gram.shape[0]
        gram = np.zeros((width, m, q, q))
        gram[: self.gram.shape[0]] = self.gram
        index = np.arange(q)
        if m > self.order:
            gram[: len(bands), :, index, index] += (
                bands[:, :, None] * np.exp(np.minimum(logarithms, LARGEST_LOG))[self.groups]
            )
        gram[0, :, index, index] += RIDGE * max(float(np.mean(gram[0, :, index, index])), 1e-300)
        return gram

    def matrix(self, logarithms: Array) -> sparse.csc_matrix:
        """H_λ and its border as one sparse symmetric matrix, the constant unknowns last."""
        m, q = self.size
        band = self.band(self.penalised(logarithms))
        lower = sparse.dia_matrix((band, -np.arange(len(band))), shape=(m * q, m * q)).tocsc()
        h = lower + sparse.tril(lower, -1).T
        if self.corner.size:
            border = self.border.reshape(m * q, -1)
            h = sparse.bmat([[h, border], [border.T, self.corner]])
        matrix = sparse.csc_matrix(h)
        matrix.sort_indices()
        return matrix

    @property
    def target(self) -> Array:
        """Right-hand side that belongs to :meth:`matrix`."""
        return np.concatenate([self.right.reshape(-1), self.border_right])

    def solve(self, logarithms: Array) -> Solution | None:
        """Minimise for given λ; None where H_λ is singular."""
        m, q = self.size
        try:
            factor = cholesky_banded(self.band(self.penalised(logarithms)), lower=True, check_finite=False)
        except np.linalg.LinAlgError:
            return None
        r = self.corner.shape[0]
        columns = np.column_stack([self.right.reshape(-1), self.border.reshape(m * q, r)])
        solved = cho_solve_banded((factor, True), columns, check_finite=False)
        logdet = 2 * float(np.log(factor[0]).sum())
        c, z = solved[:, 0], solved[:, 1:]
        beta = np.zeros(0)
        inverse = np.zeros((r, r))
        if r:
            schur = self.corner - columns[:, 1:].T @ z
            try:
                inverse = np.linalg.inv(schur)
                logdet += float(np.linalg.slogdet(schur)[1])
            except np.linalg.LinAlgError:
                return None
            beta = inverse @ (self.border_right - columns[:, 1:].T @ c)
            c = c - z @ beta
        c = c.reshape(m, q)
        least = max(self.objective(logarithms, c, beta), self.resolution**2 * self.squares)
        return Solution(c, beta, inverse, z, logdet, least)

    def objective(self, logarithms: Array, c: Array, beta: Array) -> float:
        """The penalised sum of squares at coefficients (m, q) and (r,).

        Written out, because rounding in the coefficients then enters squared; ``y² − right · c``, which is the same
        at the minimum, is off by rounding times the penalty.
        """
        m, _ = self.size
        quadratic = float(np.einsum("ja,jab,jb->", c, self.gram[0], c))
        for d in range(1, min(self.gram.shape[0], m)):
            quadratic += 2 * float(np.einsum("ja,jab,jb->", c[: m - d], self.gram[d, : m - d], c[d:]))
        pull = self.border.reshape(c.size, -1).T @ c.reshape(-1)
        fitted = quadratic + float(beta @ (2 * pull + self.corner @ beta))
        bends = (
            np.sum(np.diff(c, self.order, axis=0) ** 2, axis=0) if m > self.order else np.zeros(c.shape[1])
        )
        explained = float(np.sum(self.right * c) + self.border_right @ beta)
        return self.squares - 2 * explained + fitted + float(bends @ np.exp(logarithms)[self.groups])

    def reml(self, logarithms: Array) -> float:
        """V(λ), the smaller the likelier; infinite where it is not defined."""
        inside = np.clip(logarithms, *self.limits)
        solution = self.solve(inside)
        if solution is None:
            return np.inf
        m, q = self.size
        rank = max(m - self.order, 0) * np.bincount(self.groups, minlength=len(logarithms))
        return (
            self.freedom * np.log(max(solution.least, 1e-300) / self.freedom)
            + solution.logdet
            - float(rank @ inside)
            - q * log_determinant(m, self.order)
            + float(np.sum((logarithms - inside) ** 2))
        )

    @property
    def unit(self) -> float:
        """The logarithm of the information that the data hold about one coefficient."""
        return float(np.log(max(float(np.mean(np.einsum("mii->mi", self.gram[0]))), 1e-300)))

    @property
    def limits(self) -> tuple[float, float]:
        """Least and largest log λ."""
        return LOG_RANGE if self.order == ORDER else (LOG_RANGE[0], min(self.unit + STIFFEST, LOG_RANGE[1]))

    @property
    def freedom(self) -> float:
        """Observations less unpenalised dimensions."""
        m, q = self.size
        return max(self.count - q * min(m, self.order) - self.corner.shape[0], 1.0)

    def noise_variance(self, solution: Solution) -> float:
        """The restricted estimate of σ²."""
        return solution.least / self.freedom

    def smoothest(self, start: Array | None = None) -> Array:
        """The log λ that minimise :meth:`reml`: a coarse grid, or `start`, then Nelder and Mead."""
        count = int(self.groups.max()) + 1
        if self.size[0] <= self.order:
            return np.zeros(count)
        if start is None:
            grid = np.stack(np.meshgrid(*[self.unit + np.array([-30.0, -12, -6, -2, 2, 6, 12])] * count), -1)
            points = grid.reshape(-1, count)
            start = points[int(np.argmin([self.reml(point) for point in points]))]
        first = np.asarray(start)
        simplex = np.vstack([first, first + 2.0 * np.eye(count)])
        options = {"xatol": 0.05, "fatol": 0.02, "maxiter": 120, "initial_simplex": simplex}
        return np.clip(minimize(self.reml, first, method="Nelder-Mead", options=options).x, *self.limits)

    def effective(self, logarithms: Array, solution: Solution) -> float:
        """Effective number of parameters: the trace of ``H_λ⁻¹ XᵀX``, constant unknowns included."""
        m, q = self.size
        if m <= self.order:
            return float(m * q + len(solution.beta))
        band, bands = self.variances(logarithms, solution), squared_differences(m, self.order)
        width = min(len(bands), len(band))
        twice = np.where(np.arange(width) > 0, 2.0, 1.0)[:, None, None]
        traces = np.sum(twice * bands[:width, :, None] * band[:width], axis=(0, 1))
        return m * q + len(solution.beta) - float(traces @ np.exp(logarithms)[self.groups])

    def variances(self, logarithms: Array, solution: Solution) -> Array:
        """Band of the diagonal blocks' diagonals of H_λ⁻¹, shape (width, m, q): [d, j, i] couples c_ji and c_(j+d)i."""
        band = selected_inverse(self.penalised(logarithms), self.gram.shape[0])
        m, q = self.size
        if solution.beta.size:
            z = solution.border.reshape(m, q, -1)
            half = z @ solution.inverse
            for d in range(band.shape[0]):
                band[d, : m - d] += np.einsum("jir,jir->ji", half[: m - d], z[d:])
        return band


@dataclass(frozen=True, eq=False)
class Solution:
    """The minimum for given λ.

    Parameters
    ----------
    coefficients : ndarray, shape (m, q)
    beta : ndarray, shape (r,)
    inverse : ndarray, shape (r, r)
        Covariance of β for noise of variance one.
    border : ndarray, shape (m q, r)
        H⁻¹ times the coupling with β.
    logdet : float
    least : float
        The penalised sum of squares.
    """

    coefficients: Array
    beta: Array
    inverse: Array
    border: Array
    logdet: float
    least: float
