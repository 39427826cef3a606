"""The linear smooth model with full symmetric matrices: one problem with 42 splines, every control point SPD.

A B-spline is a weighted mean of its control points, so K(t) is positive definite at every instant when the control
points are.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.estimation.cones import BLOCK, solve_cones
from vic_toolbox.estimation.penalised import Problem, Solution
from vic_toolbox.estimation.samples import Samples, root_mean_square, weights
from vic_toolbox.estimation.selected_inverse import pointwise
from vic_toolbox.estimation.smooth_fit import FLOOR, NOISELESS, SmoothFit, SmoothModel, corrected
from vic_toolbox.estimation.splines import Basis, NormalEquations
from vic_toolbox.estimation.windows_full import FullUnits, duplication, matrices, symmetric_index

RESOLUTION = 1e-4
"""Residual, relative to the wrench, that a fit of full matrices need not go below: it has directions so weakly
determined that what the spline leaves out would decide them."""


class FullModel(SmoothModel):
    """Symmetric K(t) and B(t): one problem with 42 splines, axes weighed by their noise."""

    groups: NDArray[np.intp] = np.repeat([0, 1], BLOCK)

    def __init__(self, basis: Basis, parts: list[Samples], *, bias: bool) -> None:
        super().__init__(basis, parts, bias=bias)
        self.full_units = FullUnits.of(parts)
        self.units = np.ones((6, 12))
        self.weight = weights(parts, np.full(6, np.inf))

    def regressors(self, p: Samples) -> Array:  # noqa: D102
        x = np.concatenate([p.error, p.rate], axis=1)
        return np.broadcast_to(x[:, None, :], (len(p), 6, 12))

    def border(self, index: int) -> Array | None:  # noqa: D102
        if not self.bias:
            return None
        z = np.zeros((len(self.parts[index]), 6, len(self.parts), 6))
        z[:, np.arange(6), index, np.arange(6)] = 1
        return z.reshape(len(z), 6, -1)

    def problem(self, e: NormalEquations, scale: Array) -> Problem:
        """The six axes' equations, (q = 12), as one in the 42 free entries, axes weighed by 1/scale²."""
        units = np.concatenate(
            [np.outer(u, u) for u in (self.full_units.stiffness, self.full_units.damping)], axis=1
        )
        d = duplication() * units[..., None]
        w = 1 / scale**2
        return Problem(
            np.einsum("p,pik,pdmij,pjl->dmkl", w, d, e.gram, d, optimize=True),
            np.einsum("p,pik,pmi->mk", w, d, e.right, optimize=True),
            float(w @ e.squares),
            np.einsum("p,pik,pmir->mkr", w, d, e.border, optimize=True),
            np.einsum("p,prs->rs", w, e.corner),
            np.einsum("p,pr->r", w, e.border_right),
            float(e.count.sum()),
            self.groups,
            RESOLUTION,
        )

    def fit(  # noqa: D102
        self, *, noise: Array | None, start: SmoothFit | None = None, weight: Array | None = None
    ) -> SmoothFit:
        equations = self.equations(weight)
        scale = weights(
            self.parts, noise if noise is not None else start.noise if start else np.full(6, np.inf)
        )
        logs = start.logarithms[0] if start else None
        fit = None
        for _ in range(1 if noise is not None or start else 2):
            self.weight = scale
            problem = self.problem(equations, scale)
            logs = problem.smoothest(logs)
            solution = self.solved(problem, logs)
            relative = np.sqrt(problem.noise_variance(solution))
            fit = self._assembled([problem], [solution], [logs], scale * relative, weight)
            size = root_mean_square(np.concatenate([p.wrench for p in self.parts]))
            if (relative * scale < NOISELESS * size).any():
                fit = self._refined(fit)
            fit = self._with_noise(fit, given=noise)
            scale = weights(self.parts, fit.noise)
        assert fit is not None
        return fit

    def _refined(self, fit: SmoothFit) -> SmoothFit:
        for _ in range(2):
            again = self.problem(self.equations(fit.weight, self.residuals(fit)), self.weight)
            solution = corrected(again, fit.solutions[0], fit.logarithms[0])
            bias, _ = self._biases(fit.problems, [solution], fit.noise)
            fit = dataclasses.replace(fit, solutions=[solution], bias=bias)
        return fit

    def _biases(
        self, problems: list[Problem], solutions: list[Solution], noise: Array
    ) -> tuple[Array, Array]:
        s = solutions[0]
        if not self.bias:
            return np.zeros((0, 6)), np.zeros((0, 6))
        sd = np.sqrt(np.maximum(np.diagonal(s.inverse), 0)).reshape(-1, 6)
        return s.beta.reshape(-1, 6), sd * noise / self.weight

    def _freedom(self, fit: SmoothFit) -> Array:
        used = fit.problems[0].effective(fit.logarithms[0], fit.solutions[0])
        return np.full(6, sum(len(p) for p in self.parts) - used / 6)

    def constrained(self, fit: SmoothFit, *, solver: str) -> SmoothFit:  # noqa: D102
        problem, solution, log = fit.problems[0], fit.solutions[0], fit.logarithms[0]
        m, q = problem.size
        if _smallest(solution.coefficients) >= FLOOR:
            return fit
        h = problem.matrix(log)[: m * q, : m * q]
        beta, c = solution.beta, solution.coefficients
        for _ in range(5 if self.bias else 1):  # convex in gains and biases: in turns
            right = problem.right.reshape(-1) - problem.border.reshape(m * q, -1) @ beta
            c = solve_cones(h, right, solver=solver, floor=FLOOR, start=c.reshape(-1)).reshape(m, q)
            if self.bias:
                left = problem.border_right - problem.border.reshape(m * q, -1).T @ c.reshape(-1)
                beta = np.linalg.solve(problem.corner, left)
        solutions = [dataclasses.replace(solution, coefficients=_lifted(c), beta=beta)]
        bias, _ = self._biases(fit.problems, solutions, fit.noise)
        return dataclasses.replace(fit, solutions=solutions, bias=bias)

    def gains(self, fit: SmoothFit, times: Array) -> tuple[Array, Array]:  # noqa: D102
        return matrices(self.basis.evaluate(fit.solutions[0].coefficients * self.full_units.entries, times))

    def predicted(self, fit: SmoothFit, p: Samples, index: int) -> Array:  # noqa: D102
        wrench = np.empty_like(p.wrench)
        for start in range(0, len(p), 8192):
            rows = slice(start, start + 8192)
            stiffness, damping = self.gains(fit, p.time[rows])
            wrench[rows] = (stiffness @ p.error[rows, :, None] + damping @ p.rate[rows, :, None])[..., 0]
        return wrench + fit.bias[index] if self.bias else wrench

    def misfit(self, fit: SmoothFit) -> float:  # noqa: D102
        problem = self.problem(self.equations(fit.weight), weights(self.parts, fit.noise))
        return self.solved(problem, fit.logarithms[0]).least

    def deviations(self, fit: SmoothFit, times: Array, factor: Array) -> tuple[Array, Array]:  # noqa: D102
        band = fit.problems[0].variances(fit.logarithms[0], fit.solutions[0])
        scale = float(np.max(factor * fit.widening * fit.noise / self.weight))
        return matrices(np.sqrt(pointwise(band, *self.basis(times))) * scale * self.full_units.entries)


def _smallest(coefficients: Array) -> float:
    return min(float(np.linalg.eigvalsh(m).min()) for m in matrices(coefficients))


def _lifted(coefficients: Array) -> Array:
    """Control points (m, 42) with a solver's rounding below the floor removed from their eigenvalues."""
    blocks = []
    for matrix in matrices(coefficients):
        values, vectors = np.linalg.eigh(matrix)
        lifted = (vectors * np.maximum(values, FLOOR)[:, None, :]) @ np.swapaxes(vectors, 1, 2)
        blocks.append(
            np.where(values[:, :1, None] < FLOOR, lifted, matrix)[(slice(None), *symmetric_index())]
        )
    return np.concatenate(blocks, axis=1)
