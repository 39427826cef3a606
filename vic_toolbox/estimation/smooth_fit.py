"""The linear smooth model with axes on their own: six problems with two splines each."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.estimation import huber
from vic_toolbox.estimation.nonnegative import nonnegative, nonnegative_casadi
from vic_toolbox.estimation.penalised import Problem, Solution
from vic_toolbox.estimation.samples import Samples, root_mean_square
from vic_toolbox.estimation.selected_inverse import pointwise
from vic_toolbox.estimation.splines import Basis, NormalEquations, normal_equations

FLOOR = 1e-6
"""Smallest eigenvalue of a constrained gain, relative to its scale: positive definite, not only semidefinite."""
NOISELESS = 1e-5
"""Noise relative to the wrench below which rounding matters and the solution is refined on the samples."""
ORDERS = (2, 3)
"""Orders of the differences that may be penalised."""


@dataclass(frozen=True, eq=False)
class SmoothFit:
    """What was fitted: one problem for each axis, or one for all of them.

    Parameters
    ----------
    problems, solutions : list
    logarithms : list of ndarray
        log λ of each problem.
    noise : ndarray, shape (6,)
    weight : ndarray, shape (n, 6) or None
        Of the squared residuals, if robust.
    widening : ndarray, shape (6,)
        By how much deviations grow because of the weights.
    bias, bias_sd : ndarray, shape (recordings, 6)
    """

    problems: list[Problem]
    solutions: list[Solution]
    logarithms: list[Array]
    noise: Array
    weight: Array | None
    widening: Array
    bias: Array
    bias_sd: Array


class SmoothModel:
    """Diagonal K(t) and B(t): six problems with two splines each.

    Parameters
    ----------
    basis : Basis
    parts : list of Samples
    bias : bool
        Whether each recording has an unknown constant wrench.
    """

    groups: NDArray[np.intp] = np.array([0, 1])

    def __init__(self, basis: Basis, parts: list[Samples], *, bias: bool) -> None:
        self.basis, self.parts, self.bias = basis, parts, bias
        e, v, w = (
            root_mean_square(np.concatenate([getattr(p, name) for p in parts]))
            for name in ("error", "rate", "wrench")
        )
        w = np.where(w > 0, w, 1.0)
        self.units = np.stack([w / np.where(e > 0, e, 1.0), w / np.where(v > 0, v, 1.0)], axis=1)  # (6, 2)

    def of(self, parts: list[Samples]) -> SmoothModel:
        """The same model for other samples."""
        return type(self)(self.basis, parts, bias=self.bias)

    # --- fit -------------------------------------------------------------------------------------------------

    def equations(self, weight: Array | None = None, targets: Array | None = None) -> NormalEquations:
        """Normal equations of all axes, (6 problems), of the wrench or of other `targets` (n, 6)."""
        total, start = None, 0
        for index, p in enumerate(self.parts):
            rows = slice(start, start + len(p))
            part = normal_equations(
                self.basis,
                p.time,
                x=self.regressors(p),
                y=p.wrench if targets is None else targets[rows],
                z=self.border(index),
                weight=None if weight is None else weight[rows],
            )
            total = part if total is None else total + part
            start += len(p)
        assert total is not None
        return total

    def regressors(self, p: Samples) -> Array:
        """What the splines multiply, (n, 6, q), in the model's units."""
        return np.stack([p.error, p.rate], axis=2) * self.units

    def border(self, index: int) -> Array | None:
        """What the biases multiply in recording number `index`, (n, 6, r)."""
        if not self.bias:
            return None
        z = np.zeros((len(self.parts[index]), 6, len(self.parts)))
        z[:, :, index] = 1
        return z

    def fit(
        self, *, noise: Array | None, start: SmoothFit | None = None, weight: Array | None = None
    ) -> SmoothFit:
        """Fit without constraint; smoothness is searched from `start` where given."""
        equations = self.equations(weight)
        if start is None:
            likeliest = [self.likeliest(equations, i) for i in range(6)]
        else:
            known = zip(start.problems, start.logarithms, strict=True)
            likeliest = [
                self.smoothed(Problem.of(equations, i, self.groups, order=p.order), log)
                for i, (p, log) in enumerate(known)
            ]
        problems, logs, solutions = (list(part) for part in zip(*likeliest, strict=True))
        found = np.sqrt([p.noise_variance(s) for p, s in zip(problems, solutions, strict=True)])
        exact = found < NOISELESS * root_mean_square(np.concatenate([p.wrench for p in self.parts]))
        fit = self._assembled(problems, solutions, logs, found if noise is None else noise, weight)
        if exact.any():
            fit = self._refined(fit)
        return self._with_noise(fit, given=noise)

    def smoothed(self, problem: Problem, start: Array | None = None) -> tuple[Problem, Array, Solution]:
        """A problem, the smoothness that REML gives it, and its solution."""
        logs = problem.smoothest(start)
        return problem, logs, self.solved(problem, logs)

    def likeliest(self, equations: NormalEquations, index: int) -> tuple[Problem, Array, Solution]:
        """One axis with the order of differences that is the likelier.

        Gains that bend gently are known much better where the third is taken to be small; gains that step are not.
        Without noise there is nothing to choose by.
        """
        fits = [self.smoothed(Problem.of(equations, index, self.groups, order=ORDERS[0]))]
        problem, _, solution = fits[0]
        if problem.noise_variance(solution) > NOISELESS**2 * problem.squares / problem.count:
            fits += [
                self.smoothed(Problem.of(equations, index, self.groups, order=order)) for order in ORDERS[1:]
            ]
        return min(fits, key=lambda fit: fit[0].reml(fit[1]))

    @staticmethod
    def solved(problem: Problem, logarithms: Array) -> Solution:
        """The solution for these log λ, or a little more smoothness where rounding makes the matrix indefinite."""
        solution = problem.solve(logarithms)
        while solution is None:
            logarithms = logarithms + 5.0
            solution = problem.solve(logarithms)
        return solution

    def _assembled(
        self,
        problems: list[Problem],
        solutions: list[Solution],
        logs: list[Array],
        noise: Array,
        weight: Array | None,
    ) -> SmoothFit:
        bias, deviation = self._biases(problems, solutions, noise)
        return SmoothFit(problems, solutions, logs, noise, weight, np.ones(6), bias, deviation)

    def _biases(
        self, problems: list[Problem], solutions: list[Solution], noise: Array
    ) -> tuple[Array, Array]:
        bias = np.stack([s.beta for s in solutions], axis=1)
        sd = np.stack([np.sqrt(np.maximum(np.diagonal(s.inverse), 0)) for s in solutions], axis=1)
        return bias, sd * noise

    def _refined(self, fit: SmoothFit) -> SmoothFit:
        """Residuals taken sample by sample, then the same equations for what is left, with their penalty on that alone.

        Without noise this removes rounding and, where the data are strong, the penalty's bias (iterated Tikhonov
        regularisation); where they say nothing, the gains stay as smooth as they were.
        """
        for _ in range(3):
            again = self.equations(fit.weight, self.residuals(fit))
            problems = [Problem.of(again, i, self.groups, order=p.order) for i, p in enumerate(fit.problems)]
            fit = dataclasses.replace(
                fit,
                solutions=[
                    corrected(*parts) for parts in zip(problems, fit.solutions, fit.logarithms, strict=True)
                ],
            )
        bias, _ = self._biases(fit.problems, fit.solutions, fit.noise)
        return dataclasses.replace(fit, bias=bias)

    def _with_noise(self, fit: SmoothFit, *, given: Array | None) -> SmoothFit:
        """Noise from the residuals themselves: robustly if there are weights, with rounding removed if not."""
        residuals = self.residuals(fit)
        if fit.weight is None:
            if given is not None:
                return fit
            freedom = np.maximum(self._freedom(fit), 1.0)
            noise = np.sqrt(np.sum(residuals**2, axis=0) / freedom)
            return dataclasses.replace(fit, noise=noise, bias_sd=_rescaled(fit.bias_sd, noise, fit.noise))
        noise = huber.scale(residuals) if given is None else given
        widening = huber.widening(residuals, fit.weight, noise)
        bias_sd = _rescaled(fit.bias_sd, noise * widening, fit.noise)
        return dataclasses.replace(fit, noise=noise, widening=widening, bias_sd=bias_sd)

    def _freedom(self, fit: SmoothFit) -> Array:
        """Observations of each axis less what the fit used of them, (6,): the trace of its smoother."""
        pairs = zip(fit.problems, fit.solutions, fit.logarithms, strict=True)
        used = np.array([p.effective(log, solution) for p, solution, log in pairs])
        return sum(len(p) for p in self.parts) - used

    # --- constraint ------------------------------------------------------------------------------------------

    def constrained(self, fit: SmoothFit, *, solver: str) -> SmoothFit:
        """The best fit with every control point at least :data:`FLOOR`; deviations stay those of the free fit."""
        solve = nonnegative_casadi if solver == "casadi" else nonnegative
        solutions = []
        for problem, solution, log in zip(fit.problems, fit.solutions, fit.logarithms, strict=True):
            if solution.coefficients.min() >= FLOOR:
                solutions.append(solution)
                continue
            h, b = problem.matrix(log), problem.target
            m, q = problem.size
            bounded = np.arange(len(b)) < m * q
            x = solve(h, b - h @ np.where(bounded, FLOOR, 0.0), bounded) + np.where(bounded, FLOOR, 0.0)
            solutions.append(
                dataclasses.replace(solution, coefficients=x[: m * q].reshape(m, q), beta=x[m * q :])
            )
        bias, _ = self._biases(fit.problems, solutions, fit.noise)
        return dataclasses.replace(fit, solutions=solutions, bias=bias)

    # --- what the fit says -------------------------------------------------------------------------------------

    def gains(self, fit: SmoothFit, times: Array) -> tuple[Array, Array]:
        """K and B at the instants, (m, 6) each here, (m, 6, 6) for full matrices."""
        c = np.stack([s.coefficients for s in fit.solutions], axis=1) * self.units
        values = self.basis.evaluate(c, times)
        return values[..., 0], values[..., 1]

    def predicted(self, fit: SmoothFit, p: Samples, index: int) -> Array:
        """The wrench that the fit expects in recording number `index`, (n, 6)."""
        stiffness, damping = self.gains(fit, p.time)
        wrench = stiffness * p.error + damping * p.rate
        return wrench + fit.bias[index] if self.bias else wrench

    def unbiased(self, fit: SmoothFit) -> list[Samples]:
        """The samples less the biases found."""
        if not self.bias:
            return self.parts
        return [
            dataclasses.replace(p, wrench=p.wrench - b) for p, b in zip(self.parts, fit.bias, strict=True)
        ]

    def residuals(self, fit: SmoothFit) -> Array:
        """Measured less expected wrench, recordings one after another, (n, 6)."""
        return np.concatenate([p.wrench - self.predicted(fit, p, i) for i, p in enumerate(self.parts)])

    def misfit(self, fit: SmoothFit) -> float:
        """Penalised sum of squares over σ² of these samples, with the smoothness and the noise of `fit`."""
        equations = self.equations(fit.weight)
        total = 0.0
        for i, log in enumerate(fit.logarithms):
            problem = Problem.of(equations, i, self.groups, order=fit.problems[i].order)
            solution = self.solved(problem, log)
            total += solution.least / max(fit.noise[i] ** 2, 1e-12 * float(equations.squares[i]), 1e-300)
        return total

    def deviations(self, fit: SmoothFit, times: Array, factor: Array) -> tuple[Array, Array]:
        """Posterior standard deviations of K and B, shaped like them, times `factor` (6,)."""
        first, values = self.basis(times)
        variances = [
            pointwise(problem.variances(log, solution), first, values)
            for problem, solution, log in zip(fit.problems, fit.solutions, fit.logarithms, strict=True)
        ]
        scale = (fit.noise * fit.widening * factor)[:, None] * self.units
        with np.errstate(invalid="ignore"):  # infinite variance, no noise: not known
            sd = np.sqrt(np.stack(variances, axis=1)) * scale
        return sd[..., 0], sd[..., 1]


def corrected(remainder: Problem, solution: Solution, logarithms: Array) -> Solution:
    """One step of refinement: `remainder` holds the right-hand sides that the residuals make."""
    step = remainder.solve(logarithms)
    if step is None:
        return solution
    return dataclasses.replace(
        solution,
        coefficients=solution.coefficients + step.coefficients,
        beta=solution.beta + step.beta,
    )


def _rescaled(deviation: Array, new: Array, old: Array) -> Array:
    return deviation * np.where(old > 0, new / np.where(old > 0, old, 1.0), 1.0)
