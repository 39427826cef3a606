"""Gains as smooth functions of time: penalised B-splines, smoothness by REML, every sample used."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, finite_array, one_of, positive
from vic_toolbox.estimation import huber, observability
from vic_toolbox.estimation.estimate import GainEstimate, gated
from vic_toolbox.estimation.local_gains import local_full_gains, local_gains
from vic_toolbox.estimation.samples import LATENCY, Motion, Samples, given_noise, pooled
from vic_toolbox.estimation.smooth_fit import SmoothFit, SmoothModel
from vic_toolbox.estimation.smooth_full import FullModel
from vic_toolbox.estimation.splines import Basis
from vic_toolbox.estimation.windows import CONSTRAINTS, STRUCTURES, chosen_solver

KNOTS = {"diagonal": 0.1, "damping_factor": 0.1, "full": 0.5}
"""Distance of the knots that is taken by default [s]."""
GRID = 5
"""Instants of the result for each knot interval."""
LATENCY_SCAN = 21
ROBUST_ROUNDS = 12


@threadpool_limits.wrap(limits=1, user_api="blas")  # banded factorisations: threads would only wait
def fit_smooth(
    recordings: Motion | Iterable[Motion],
    knots: float | str | None = "auto",
    *,
    structure: str = "diagonal",
    constraint: str = "spd",
    solver: str = "auto",
    robust: bool = False,
    bias: bool = False,
    latency: bool = False,
    attractor: bool = False,
    noise: ArrayLike | None = None,
    at: ArrayLike | None = None,
) -> GainEstimate:
    """Fit ``wrench = K(t) e + B(t) ė`` with K(t), B(t) penalised cubic B-splines.

    How smooth they are is decided by restricted maximum likelihood, one penalty for stiffness and one for
    damping (of each axis, where axes are on their own). Standard deviations are those of the posterior, widened
    where residuals are correlated in time. What is observable is decided without the penalty.

    Parameters
    ----------
    recordings : Recording, or iterable of them
        Several are pooled: one K(t), B(t) for all, their clocks starting together at zero.
    knots : float, 'auto' or None, optional
        Distance of the knots [s]: the finest change that can be seen. 0.1 s by default, half a second for full
        matrices, whose 42 entries need about that much rich motion. None: constant gains.
    structure : {'diagonal', 'full', 'damping_factor'}, optional
        Axes on their own; full symmetric matrices; or diagonal with ``B = d √K``, one constant d for translation
        and one for rotation.
    constraint : {'none', 'positive', 'spd'}, optional
        ``spd`` keeps K(t) and B(t) positive definite at every instant (every control point is), ``none`` does not.
        For diagonal gains ``positive`` means the same as ``spd``.
    solver : {'auto', 'closed_form', 'casadi', 'clarabel'}, optional
        Only asked where the unconstrained fit is not feasible. Diagonal: projected Newton steps, or CasADi's QP. Full:
        Clarabel, or CasADi's Cholesky program. ``damping_factor`` and `attractor` are CasADi's in any case.
    robust : bool, optional
        Huber's weights instead of squares: outliers count linearly.
    bias : bool, optional
        Estimate a constant wrench for each recording besides (a sensor whose zero is off).
    latency : bool, optional
        Estimate by how much the wrench is late behind the motion, up to 50 ms.
    attractor : bool, optional
        Estimate where the spring is at rest, relative to the reference: ``wrench = K (e − a) + B ė``. Needs a
        stiffness that changes; with a constant one it is the same as a bias. Diagonal gains only.
    noise : array_like, shape (6,), optional
        Standard deviation of the wrench's noise [N, Nm]; estimated by default.
    at : array_like, shape (m,), optional
        Instants of the result [s]; by default five in each knot interval.

    Returns
    -------
    GainEstimate
        `parameters` holds ``bias`` (recordings, 6), ``latency`` [s], ``attractor`` (6,), ``damping_factor`` (2,),
        those that were asked for, each with its ``_sd``.

    Raises
    ------
    InputError
        Bad input, or options that do not go together.
    FitError
        A solver gave up.

    References
    ----------
    P. Eilers, B. Marx, "Flexible smoothing with B-splines and penalties", Statistical Science 11, 1996.
    S. Wood, "Fast stable restricted maximum likelihood and marginal likelihood estimation of semiparametric
    generalized linear models", J. R. Statist. Soc. B 73, 2011.
    """
    parts = pooled(recordings)
    one_of("structure", structure, STRUCTURES)
    one_of("constraint", constraint, CONSTRAINTS)
    joint = structure == "damping_factor" or attractor
    basis = _basis(parts, knots, structure)
    times = _instants(basis, at)
    given = given_noise(noise)
    if joint:
        from vic_toolbox.estimation.joint import fit_joint

        if structure == "full":
            raise InputError("an unknown attractor goes with diagonal gains; choose structure 'diagonal'.")
        if solver not in ("auto", "casadi"):
            raise InputError("tied damping and an unknown attractor are solved by CasADi; choose 'auto'.")
        return fit_joint(
            parts,
            basis,
            times,
            tied=structure == "damping_factor",
            attractor=attractor,
            bias=bias,
            latency=latency,
            robust=robust,
            noise=given,
        )
    kind = "diagonal" if constraint == "positive" and structure == "diagonal" else structure
    solver = chosen_solver(kind, constraint, solver)

    model = (FullModel if structure == "full" else SmoothModel)(basis, parts, bias=bias)
    fit = model.fit(noise=given)
    delay = None
    if latency:
        delay = find_latency(model, fit)
        model = model.of([p.delayed(delay[0]) for p in parts])
        fit = model.fit(noise=given, start=fit)
    if robust:
        for _ in range(ROBUST_ROUNDS):
            previous = fit.noise
            fit = model.fit(noise=given, start=fit, weight=huber.weights(model.residuals(fit)))
            if np.allclose(previous, fit.noise, rtol=1e-3):
                break
    if constraint != "none":
        fit = model.constrained(fit, solver=solver)
    words = [structure, constraint, solver] + ["robust"] * robust + ["bias"] * bias + ["latency"] * latency
    extra = {}
    if bias:
        extra = {"bias": fit.bias, "bias_sd": fit.bias_sd}
    if delay is not None:
        extra |= {"latency": np.array(delay[0]), "latency_sd": np.array(delay[1])}
    return estimate(model, fit, times, extra=extra, words=words)


def estimate(
    model: SmoothModel, fit: SmoothFit, times: Array, *, extra: dict[str, Array], words: list[str]
) -> GainEstimate:
    """Gains, deviations and flags at the instants `times`."""
    parts, basis = model.parts, model.basis
    full = isinstance(model, FullModel)
    residuals = model.residuals(fit)
    steps = np.median(np.concatenate([np.diff(p.time) for p in parts]))
    spacing = (basis.stop - basis.start) / basis.intervals if basis.intervals else len(parts[0]) * steps / 20
    inflation = observability.correlation_inflation(residuals, round(spacing / steps))
    constants = observability.constant_gains(parts, bias=model.bias, coupled=full)
    stiffness, damping = model.gains(fit, times)
    deviations = model.deviations(fit, times, np.sqrt(inflation))
    local = (local_full_gains if full else local_gains)(
        model.unbiased(fit),
        times,
        spacing if basis.intervals else None,
        fit.noise * fit.widening * np.sqrt(inflation),
    )
    raw, scales = (local.stiffness_sd, local.damping_sd), local.scales(parts)
    seen = tuple(
        observability.determined(alone, scale) & observability.determined(sd, scale) & constants.evident
        for alone, sd, scale in zip(raw, deviations, scales, strict=True)
    )
    notes = list(observability.remedies(seen[0], seen[1], constants.evident))
    if full and basis.intervals and spacing < KNOTS["full"] and not (seen[0] & seen[1]).any():
        notes.append(
            f"full matrices have 42 entries, which cannot be told apart within {spacing:.2g} s; "
            f"ask for knots of {KNOTS['full']:g} s or more."
        )
    if inflation.max() > 3:
        notes.append(
            "residuals are correlated in time, not white noise, so bands are up to "
            f"{math.sqrt(inflation.max()):.1f} times as wide. Is inertia, friction or a bias left in the wrench?"
        )
    return gated(
        times,
        stiffness,
        damping,
        deviations=deviations,
        seen=(seen[0], seen[1]),
        condition=local.condition,
        residuals=residuals,
        noise=fit.noise,
        explained=observability.explained(parts, residuals),
        method=f"penalised B-splines, {basis.intervals} intervals: {', '.join(words)}",
        parameters=extra,
        warnings=tuple(notes),
    )


def find_latency(model: SmoothModel, fit: SmoothFit) -> tuple[float, float]:
    """Delay of the wrench behind the motion [s] at which the penalised fit is best, and its standard deviation.

    The gains are fitted anew at every delay tried (with the smoothness found without delay), so this is the
    joint optimum, found along its profile; the deviation comes from the profile's curvature.
    """

    def misfit(delay: float) -> float:
        return model.of([p.delayed(delay) for p in model.parts]).misfit(fit)

    scan = np.linspace(-LATENCY, LATENCY, LATENCY_SCAN)
    best = int(np.argmin([misfit(x) for x in scan]))
    low, high = scan[max(best - 1, 0)], scan[min(best + 1, LATENCY_SCAN - 1)]
    found: Any = minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-6})
    delay = float(found.x)
    h = 1e-3
    curvature = (misfit(delay + h) - 2 * misfit(delay) + misfit(delay - h)) / h**2
    return delay, math.sqrt(2 / curvature) if curvature > 0 else math.inf


def _basis(parts: list[Samples], knots: float | str | None, structure: str) -> Basis:
    start, stop = min(p.time[0] for p in parts), max(p.time[-1] for p in parts)
    if knots is None:
        return Basis(start, stop, 0)
    if isinstance(knots, str):
        one_of("knots", knots, ("auto",))
        knots = min(KNOTS[structure], float(stop - start))
    spacing = positive("knots", knots)
    if spacing > stop - start:
        raise InputError(
            f"knots are {spacing:g} s apart and the recording lasts {stop - start:g} s; pass smaller ones, or None "
            "for constant gains."
        )
    basis = Basis.spaced(start, stop, spacing)
    samples = sum(len(p) for p in parts)
    if basis.intervals > samples:
        raise InputError(f"{basis.intervals} knot intervals for {samples} samples; pass a larger `knots`.")
    return basis


def _instants(basis: Basis, at: ArrayLike | None) -> Array:
    if at is not None:
        times = np.atleast_1d(finite_array("at", at))
        if times.ndim != 1 or (np.diff(times) <= 0).any():
            raise InputError("at holds instants that do not increase; sort them.")
        if times[0] < basis.start or times[-1] > basis.stop:
            raise InputError(
                f"at reaches from {times[0]:g} to {times[-1]:g} s; the recording covers {basis.start:g} to "
                f"{basis.stop:g} s."
            )
        return times
    if not basis.intervals:
        return np.array([0.5 * (basis.start + basis.stop)])
    return np.linspace(basis.start, basis.stop, GRID * basis.intervals + 1)
