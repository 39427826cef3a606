"""Gains in a sliding window: the paper's estimator, its constrained forms, and what each window can know."""

from __future__ import annotations

from typing import NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, integer, one_of
from vic_toolbox.estimation import observability
from vic_toolbox.estimation.cones import clarabel_installed, solve_cones
from vic_toolbox.estimation.estimate import GainEstimate, gated
from vic_toolbox.estimation.samples import Motion, Samples, given_noise, samples, weights
from vic_toolbox.estimation.windows_diagonal import diagonal_windows, window_count
from vic_toolbox.estimation.windows_factor import factor_windows, window_sums
from vic_toolbox.estimation.windows_full import (
    FullUnits,
    FullWindows,
    full_windows,
    matrices,
    symmetric_index,
)

STRUCTURES = ("diagonal", "full", "damping_factor")
CONSTRAINTS = ("none", "positive", "spd")
SOLVERS = ("auto", "closed_form", "casadi", "clarabel")


class _Windows(NamedTuple):
    """What each structure finds: gains, their variances (noise included), rank by floating point, noise."""

    stiffness: Array  # (m, 6, 6), or (m, 6) where the structure is diagonal
    damping: Array
    stiffness_variance: Array
    damping_variance: Array
    condition: Array
    noise: Array


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def fit_windows(
    recording: Motion,
    window: SupportsIndex = 10,
    *,
    structure: str = "diagonal",
    constraint: str = "none",
    solver: str = "auto",
    step: SupportsIndex = 1,
    noise: ArrayLike | None = None,
) -> GainEstimate:
    """Fit ``wrench = K e + B ė`` in every window of consecutive samples, gains constant within it.

    Ten samples are what the paper takes. They are few: at 1 kHz, 0.2 N of noise and rich motion the bound of
    Cramér and Rao for K is about 100 %, whatever the estimator; see :func:`fit_smooth` for pooling.

    Parameters
    ----------
    recording : Recording
        Wrench, error and its rate in world axes.
    window : int, optional
        Samples in a window, at least three.
    structure : {'diagonal', 'full', 'damping_factor'}, optional
        Axes on their own; full symmetric matrices; or diagonal with ``B = d √K``, one d for translation and one
        for rotation (always positive).
    constraint : {'none', 'positive', 'spd'}, optional
        Non-negative gains or positive semidefinite matrices. For diagonal matrices they are the same thing, for
        full ones `positive` does not exist.
    solver : {'auto', 'closed_form', 'casadi', 'clarabel'}, optional
        ``auto`` takes the closed form where there is one; for full matrices with ``spd`` Clarabel where it is
        installed, else CasADi. Windows whose unconstrained fit is feasible, or which determine nothing, need
        no solver.
    step : int, optional
        Samples from one window to the next.
    noise : array_like, shape (6,), optional
        Standard deviation of the wrench's noise [N, Nm]; estimated from the residuals by default. Samples are
        taken to be independent within a window.

    Returns
    -------
    GainEstimate
        One instant for each window, its centre.

    Raises
    ------
    InputError
        Fewer samples than a window, an unknown name, or names that do not go together.
    FitError
        A solver gave up.

    References
    ----------
    X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
    Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021.
    """
    data = samples(recording)
    width, stride = integer("window", window, low=3), integer("step", step, low=1)
    if len(data) < width:
        raise InputError(f"the recording has {len(data)} samples and a window {width}; shorten the window.")
    given = given_noise(noise)
    solver = chosen_solver(structure, constraint, solver)
    constants = observability.constant_gains([data], coupled=structure == "full")

    if structure == "diagonal":
        found = _diagonal(data, width, stride, positive=constraint != "none", solver=solver, given=given)
    elif structure == "damping_factor":
        found = _tied(data, width, stride, solver=solver, given=given, start=constants[:2])
    else:
        found = _full(data, width, stride, spd=constraint == "spd", solver=solver, given=given)
    return _estimate(data, width, stride, found, constants, f"{structure}, {constraint}, {solver}")


def chosen_solver(structure: str, constraint: str, solver: str) -> str:
    """Resolve ``auto`` and refuse what does not go together."""
    one_of("structure", structure, STRUCTURES)
    one_of("constraint", constraint, CONSTRAINTS)
    one_of("solver", solver, SOLVERS)
    if structure == "full" and constraint == "positive":
        raise InputError("constraint 'positive' is for diagonal gains; choose 'none' or 'spd' for full ones.")
    cone = structure == "full" and constraint == "spd"
    if solver == "auto":
        return "closed_form" if not cone else "clarabel" if clarabel_installed() else "casadi"
    if cone and solver == "closed_form":
        raise InputError("there is no closed form for the nearest SPD fit; choose 'clarabel' or 'casadi'.")
    if solver == "clarabel" and not cone:
        raise InputError(
            "Clarabel solves full matrices with constraint 'spd'; choose 'closed_form' or 'casadi'."
        )
    if solver == "casadi" and structure == "full" and not cone:
        raise InputError("full matrices without constraint have a closed form; choose 'closed_form'.")
    return solver


def _diagonal(
    data: Samples, window: int, step: int, *, positive: bool, solver: str, given: Array | None
) -> _Windows:
    fit = diagonal_windows(data, window, step=step, positive=positive)
    noise = np.sqrt(fit.squares.mean(axis=0) / (window - 2)) if given is None else given
    stiffness, damping = fit.stiffness, fit.damping
    if solver == "casadi":
        from vic_toolbox.estimation.programs import diagonal_programs

        k, b = diagonal_programs(data, window, step=step, positive=positive)
        stiffness = np.where(np.isfinite(stiffness), k, np.nan)
        damping = np.where(np.isfinite(damping), b, np.nan)
    with np.errstate(invalid="ignore"):
        return _Windows(
            stiffness,
            damping,
            fit.stiffness_variance * noise**2,
            fit.damping_variance * noise**2,
            fit.condition,
            noise,
        )


def _tied(
    data: Samples, window: int, step: int, *, solver: str, given: Array | None, start: tuple[Array, Array]
) -> _Windows:
    free = diagonal_windows(data, window, step=step)
    noise = np.sqrt(free.squares.mean(axis=0) / (window - 2)) if given is None else given
    sums = window_sums(data, window, step)
    weight = weights([data], noise)
    fit = factor_windows(sums, weight, start=start)
    root, factor = fit.root, np.repeat(fit.factor, 3, axis=1)
    stiffness, damping = root**2, factor * root
    if solver == "casadi":
        from vic_toolbox.estimation.programs import factor_programs

        stiffness, damping = factor_programs(data, window, weight, step=step, start=(root, fit.factor))
    # k = s², b = d s: variances to first order
    scale = (noise / weight) ** 2
    roots = np.diagonal(fit.covariance[..., :3, :3], axis1=-2, axis2=-1).reshape(-1, 6)
    factors = np.repeat(fit.covariance[..., 3, 3], 3, axis=1)
    both = fit.covariance[..., :3, 3].reshape(-1, 6)
    with np.errstate(invalid="ignore"):
        k_variance = np.where(np.isfinite(roots), 4 * root**2 * roots * scale, np.inf)
        b_variance = (factor**2 * roots + 2 * factor * root * both + root**2 * factors) * scale
    b_variance = np.where(np.isfinite(b_variance), b_variance, np.inf)
    condition = np.repeat(fit.condition, 3, axis=1)
    return _Windows(stiffness, damping, k_variance, b_variance, condition, noise)


def _full(data: Samples, window: int, step: int, *, spd: bool, solver: str, given: Array | None) -> _Windows:
    units = FullUnits.of([data])
    noise, fit = full_noise(data, window, step, units) if given is None else (given, None)
    weight = weights([data], noise)
    if fit is None or not np.array_equal(weight, noise):
        fit = full_windows(data, window, step=step, noise=weight, units=units)
    theta = fit.solution
    if spd:
        known = np.isfinite(fit.variance).any(axis=1)
        smallest = np.min([np.linalg.eigvalsh(m)[:, 0] for m in matrices(theta)], axis=0)
        theta = theta.copy()
        for m in np.flatnonzero(known & (smallest < 0)):
            theta[m] = solve_cones(fit.information[m], fit.right[m], solver=solver)
            for part in (slice(0, 21), slice(21, 42)):
                theta[m, part] = _inside(theta[m, part])
    stiffness, damping = matrices(theta * units.entries)
    with np.errstate(invalid="ignore"):
        k_variance, b_variance = matrices(fit.variance * units.entries**2)
    condition = np.repeat(fit.condition[:, None], 6, axis=1)
    return _Windows(stiffness, damping, k_variance, b_variance, condition, noise)


def full_noise(data: Samples, window: int, step: int, units: FullUnits) -> tuple[Array, FullWindows]:
    """Noise of each wrench axis from the residuals of full fits, weighed once with a first guess of it."""
    weight, fit = weights([data], np.full(6, np.inf)), None
    for _ in range(2):
        fit = full_windows(data, window, step=step, noise=weight, units=units)
        stiffness, damping = matrices(fit.solution * units.entries)
        squares = np.zeros(6)
        starts = step * np.arange(len(stiffness))
        for k in range(window):
            rows = starts + k
            motion = data.error[rows][..., None], data.rate[rows][..., None]
            squares += np.sum(
                (data.wrench[rows] - (stiffness @ motion[0] + damping @ motion[1])[..., 0]) ** 2, 0
            )
        freedom = max(float(np.sum(window - fit.rank / 6)), 1.0)
        noise = np.sqrt(squares / freedom)
        weight = weights([data], noise)
    assert fit is not None
    return noise, full_windows(data, window, step=step, noise=weight, units=units)


def _inside(block: Array) -> Array:
    """The block with the solver's rounding below zero removed from its eigenvalues."""
    values, vectors = np.linalg.eigh(matrices(np.tile(block, 2))[0])
    return block if values[0] >= 0 else ((vectors * np.maximum(values, 0)) @ vectors.T)[symmetric_index()]


def _estimate(
    data: Samples,
    window: int,
    step: int,
    found: _Windows,
    constants: observability.Constants,
    names: str,
) -> GainEstimate:
    count = window_count(len(data), window, step)
    middle = 0.5 * (window - 1) + step * np.arange(count)
    time = np.interp(middle, np.arange(len(data)), data.time)
    scales = observability.gain_scales(
        [data],
        observability.typical(_diagonals(found.stiffness), np.sqrt(_diagonals(found.stiffness_variance))),
        observability.typical(_diagonals(found.damping), np.sqrt(_diagonals(found.damping_variance))),
    )
    deviations = np.sqrt(found.stiffness_variance), np.sqrt(found.damping_variance)
    seen = tuple(
        observability.determined(sd, scale) & constants.evident
        for sd, scale in zip(deviations, scales, strict=True)
    )
    nearest = np.clip(np.rint((np.arange(len(data)) - 0.5 * (window - 1)) / step).astype(int), 0, count - 1)
    residuals = data.wrench - sum(
        _times(gain[nearest], motion)
        for gain, motion in ((found.stiffness, data.error), (found.damping, data.rate))
    )
    return gated(
        time,
        found.stiffness,
        found.damping,
        deviations=deviations,
        seen=(seen[0], seen[1]),
        condition=found.condition,
        residuals=residuals,
        noise=found.noise,
        explained=observability.explained([data], residuals),
        method=f"windows of {window} samples: {names}",
        warnings=observability.remedies(seen[0], seen[1], constants.evident),
    )


def _diagonals(x: Array) -> Array:
    return x if x.ndim == 2 else np.diagonal(x, axis1=1, axis2=2)


def _times(gain: Array, motion: Array) -> Array:
    product = gain * motion if gain.ndim == 2 else (gain @ motion[..., None])[..., 0]
    # a gain that multiplies no motion need not be known
    return np.where(np.isnan(product) & (motion == 0), 0.0, product)
