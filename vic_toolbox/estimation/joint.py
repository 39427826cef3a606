"""Smooth gains together with what enters the wrench nonlinearly, as one CasADi program.

    wrench(t) = K(t) (e(t − τ) − a) + B(t) ė(t − τ) + bias + noise

with an unknown attractor a (where the spring rests, relative to the reference), latency τ and bias, and with the
damping on its own or tied, ``B = d √K``. Unknown are the coefficients of the splines and these constants, all at
once; IPOPT minimises the penalised sum of squares. The smoothness follows from REML on the model linearised at the
optimum, and the two alternate until neither changes (penalised quasi-likelihood). The same linearisation gives the
posterior. Tied, the spline is that of √K, which keeps K positive.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation import huber, observability
from vic_toolbox.estimation.estimate import GainEstimate, gated
from vic_toolbox.estimation.joint_model import JointModel, Unknowns
from vic_toolbox.estimation.local_gains import local_gains
from vic_toolbox.estimation.penalised import Problem, Solution
from vic_toolbox.estimation.samples import Samples, weights
from vic_toolbox.estimation.selected_inverse import pointwise
from vic_toolbox.estimation.smooth_fit import SmoothModel
from vic_toolbox.estimation.splines import Basis

ROUNDS = 12
"""Largest number of turns between the program and the smoothness."""
LEAST_NOISE = 1e-3
"""Residual, relative to the wrench, that counts as one at least: IPOPT does not resolve much more below it."""
SETTLED = 0.1
"""Change of log λ below which a turn changes nothing."""


def fit_joint(
    parts: list[Samples],
    basis: Basis,
    times: Array,
    *,
    tied: bool,
    attractor: bool,
    bias: bool,
    latency: bool,
    robust: bool,
    noise: Array | None,
) -> GainEstimate:
    """Fit the joint model; the public door is :func:`vic_toolbox.estimation.fit_smooth`."""
    model = JointModel(parts, basis, tied, attractor, bias, latency)
    x, logs, found, weight = _start(model, noise, robust=robust)
    for _ in range(ROUNDS):
        previous, before = logs, x.delay
        x = model.solve(x, logs, weights(parts, found, least=LEAST_NOISE), weight)
        left = model.residuals(x)
        if robust:
            weight = huber.weights(left)
        single, _ = model.linearised(x, weights(parts, found, least=LEAST_NOISE), weight)
        logs = np.stack([p.smoothest(log) for p, log in zip(single, logs, strict=True)])
        if noise is None:
            found = huber.scale(left) if robust else _noise(single, logs, left)
        if np.abs(logs - previous).max() < SETTLED and abs(x.delay - before) < 1e-6:
            break
    return _estimate(model, x, logs, found, weight, times)


def _noise(single: list[Problem], logs: Array, left: Array) -> Array:
    used = [
        p.effective(log, s) for p, log in zip(single, logs, strict=True) if (s := p.solve(log)) is not None
    ]
    freedom = np.maximum(len(left) - np.array(used if len(used) == 6 else [0.0] * 6), 1.0)
    return np.sqrt(np.sum(left**2, axis=0) / freedom)


def _start(
    model: JointModel, noise: Array | None, *, robust: bool
) -> tuple[Unknowns, Array, Array, Array | None]:
    """Where to begin: the linear fit without latency, its smoothness and noise; a constant wrench for an attractor."""
    linear = SmoothModel(model.basis, model.parts, bias=model.bias or model.attractor)
    fit = linear.constrained(linear.fit(noise=noise), solver="closed_form")
    weight = huber.weights(linear.residuals(fit)) if robust else None
    c = np.stack([s.coefficients for s in fit.solutions], axis=1) * linear.units  # (m, 6, 2)
    logs = np.stack(fit.logarithms) - 2 * np.log(linear.units)  # of coefficients in SI units
    factor = np.ones(2)
    # what each axis has at least: a soft one must not start at the bound
    stiffness = np.maximum(c[..., 0], 1e-2 * np.maximum(c[..., 0].mean(axis=0), 1e-9))
    if model.tied:
        root = np.sqrt(stiffness)
        constant = observability.constant_gains(model.parts, bias=model.bias)
        ratio = np.nan_to_num(constant.damping) / np.sqrt(np.maximum(np.nan_to_num(constant.stiffness), 1e-9))
        middle = np.median(c[..., 1] / root, axis=0)
        usual = np.where(np.isfinite(ratio) & (ratio > 0), ratio, middle)
        factor = np.maximum(np.median(usual.reshape(2, 3), axis=1), 1e-3)
        # λ of √K from that of K: δK = 2 √K δ√K
        logs = logs[:, :1] + np.log(4 * np.maximum(stiffness.mean(axis=0), 1e-9))[:, None]
        c = root[..., None]
    biases, rest = np.zeros((len(model.parts), 6)), np.zeros(6)
    if model.attractor:
        rest = -fit.bias.mean(axis=0) / np.maximum(stiffness.mean(axis=0), 1e-9)
    elif model.bias:
        biases = fit.bias
    return Unknowns(c, factor, rest, biases, 0.0), logs, fit.noise, weight


def _estimate(
    model: JointModel, x: Unknowns, logs: Array, noise: Array, weight: Array | None, times: Array
) -> GainEstimate:
    parts, basis = model.parts, model.basis
    left = model.residuals(x)
    scale = weights(parts, noise, least=LEAST_NOISE)
    _, problem = model.linearised(x, scale, weight)
    # λ of the joint problem counts residuals in units of the noise
    strengths = (logs - 2 * np.log(scale)[:, None]).reshape(-1)
    solution = SmoothModel.solved(problem, strengths)
    spacing = (basis.stop - basis.start) / basis.intervals if basis.intervals else None
    steps = np.median(np.concatenate([np.diff(p.time) for p in parts]))
    inflation = observability.correlation_inflation(
        left, round((spacing or len(parts[0]) * steps / 20) / steps)
    )
    widening = 1.0
    if weight is not None:
        widening = float(huber.widening(left, weight, noise, axis=None))
    factor = np.sqrt(inflation) * noise / scale * widening
    stiffness, damping = model.gains(x, times)
    deviations = _deviations(model, x, problem, solution, strengths, times)
    deviations = deviations[0] * factor, deviations[1] * factor
    moved = [
        dataclasses.replace(p, error=p.error - x.attractor, wrench=p.wrench - b)
        for p, b in zip(model.motion(x), x.bias, strict=True)
    ]
    constants = observability.constant_gains(moved, bias=model.bias)
    local = local_gains(moved, times, spacing, noise * np.sqrt(inflation))
    scales = local.scales(moved)
    share = [
        sd / np.where(scale > 0, scale, 1e-300)
        for sd, scale in zip((local.stiffness_sd, local.damping_sd), scales, strict=True)
    ]
    if model.tied:  # either gain tells the other
        share = [np.minimum(*share)] * 2
    seen = []
    for gain, sd, scale, alone in zip((stiffness, damping), deviations, scales, share, strict=True):
        own = observability.determined(sd, np.maximum(scale, np.abs(gain).mean(axis=0)))
        seen.append(own & (alone < observability.TOLERANCE) & constants.evident)
    if model.tied:
        seen = [seen[0] & seen[1]] * 2
    words = [name for name, _ in model.constants()] + ["robust"] * (weight is not None)
    return gated(
        times,
        stiffness,
        damping,
        deviations=deviations,
        seen=(seen[0], seen[1]),
        condition=local.condition,
        residuals=left,
        noise=noise,
        explained=observability.explained(parts, left),
        method=f"joint program, {basis.intervals} intervals: {', '.join(words)}",
        parameters=_parameters(model, x, solution, float(np.max(factor))),
        warnings=observability.remedies(seen[0], seen[1], constants.evident),
    )


def _deviations(
    model: JointModel, x: Unknowns, problem: Problem, solution: Solution, logs: Array, times: Array
) -> tuple[Array, Array]:
    """Posterior deviations of K and B, (m, 6) each."""
    first, values = model.basis(times)
    variance = pointwise(problem.variances(logs, solution), first, values)
    if not model.tied:
        sd = np.sqrt(variance).reshape(-1, 6, 2)
        return sd[..., 0], sd[..., 1]
    root = model.basis.evaluate(x.coefficients, times)[..., 0]
    d = np.repeat(x.factor, 3)
    group = np.arange(6) // 3
    # covariance of a spline with the constants: −H⁻¹U S⁻¹
    border = (solution.border @ solution.inverse).reshape(model.basis.size, 6, -1)[:, np.arange(6), group]
    both = -sum(values[:, a, None] * border[first + a] for a in range(values.shape[1]))
    factor = np.diagonal(solution.inverse)[group]
    damping = d**2 * variance + 2 * d * root * both + root**2 * factor
    return 2 * root * np.sqrt(variance), np.sqrt(np.maximum(damping, 0))


def _parameters(model: JointModel, x: Unknowns, solution: Solution, factor: float) -> dict[str, Array]:
    found: dict[str, Array] = {}
    start = 0
    sd = factor * np.sqrt(np.maximum(np.diagonal(solution.inverse), 0))
    values = {
        "damping_factor": x.factor,
        "attractor": x.attractor,
        "bias": x.bias,
        "latency": np.array(x.delay),
    }
    for name, size in model.constants():
        found[name] = values[name]
        found[f"{name}_sd"] = sd[start : start + size].reshape(np.shape(values[name]))
        start += size
    return found
