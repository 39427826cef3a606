"""Gains held by a computer: exact stability at the control period."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, integer, one_of, positive
from vic_toolbox.stability.arguments import impedance, positive_matrices
from vic_toolbox.stability.environments.linear_loop import (
    EDGE,
    GROWTH,
    discrete_lyapunov,
    growing_mode,
    powers,
    stride,
    until_largest,
)
from vic_toolbox.stability.sampling.sampled_characteristic import characteristic, damping_range
from vic_toolbox.stability.sampling.sampled_loop import SampledLoop, dimensionless
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict, status_of

VELOCITIES = ("exact", "backward")
METHOD = (
    "spectral radius of the exact zero-order-hold map; discrete Lyapunov matrix checked on the integrated map "
    "(Åström and Wittenmark, Computer-Controlled Systems, 1997, sec. 3.3)"
)


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def sampled_stability(
    mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    period: float,
    physical_damping: ArrayLike = 0.0,
    velocity: str = "exact",
    delay_steps: int = 0,
) -> Verdict:
    """Is ``M ẍ + D ẋ = u`` stable when a computer holds ``u_k = −K x_{k−s} − B v_{k−s}`` over each period T?

    The map from sample to sample is exact, so the answer is *iff*: the loop is asymptotically stable where its
    spectral radius is below one. A free mass with exact velocity is stable iff ``K T/2 < B < 2 m/T``.

    Parameters
    ----------
    mass : float, (d, d) or (n, d, d)
        M ≻ 0 [kg, kg m²].
    stiffness, damping : float, (n,), (d, d) or (n, d, d)
        Gains K ⪰ 0 [N/m, Nm/rad] and B ⪰ 0 [Ns/m, Nms/rad] of the computer. Several are judged one by one, each
        as if it were held for ever, and the worst decides.
    period : float
        T [s].
    physical_damping : float, (d, d) or (n, d, d), optional
        D ⪰ 0 of the mechanism itself [Ns/m]; a number with matrices of gains stands for ``D · 1``.
    velocity : {'exact', 'backward'}, optional
        What v is: the true velocity at the sample, or ``(x_k − x_{k−1})/T``.
    delay_steps : int, optional
        Whole periods s from the measurement to the force.

    Returns
    -------
    Verdict
        Margin: ``1 − spectral radius``, the share by which the slowest mode shrinks each period. Values:
        ``spectral_radius``, ``eigenvalues`` (of the worst), ``index`` and ``spectral_radii`` where there are several,
        ``damping_range`` for one degree of freedom: the B (low, high) [Ns/m] between which these K, m, D are stable;
        NaN where there is none.

    Raises
    ------
    InputError
        Gains that are asymmetric, indefinite or not finite; sizes that differ; a period that is not positive.
    """
    period = positive("period", period)
    one_of("velocity", velocity, VELOCITIES)
    delay_steps = integer("delay_steps", delay_steps, low=0, high=1000)
    given = impedance(mass, stiffness, damping)
    masses, loop = _loop(given, physical_damping, period, velocity == "backward", delay_steps)
    steps = loop.step()
    radii = np.abs(np.linalg.eigvals(steps)).max(axis=-1)
    worst = int(np.argmax(radii))
    radius, d = float(radii[worst]), loop.degrees
    values = {"spectral_radius": radius, "eigenvalues": np.linalg.eigvals(steps[worst])}
    if len(radii) > 1:
        values |= {"index": worst, "spectral_radii": radii}
    if d == 1:
        family = characteristic(loop.physical_damping[worst, 0, 0], loop.backward, delay_steps)
        low, high = damping_range(family, loop.stiffness[worst, 0, 0], loop.damping[worst, 0, 0])
        values["damping_range"] = np.array([low, high]) * masses[worst, 0, 0] / period
    witness, reason = _shown(loop, steps, radii, masses, period)
    return Verdict(
        status_of(witness),
        f"M ẍ + D ẋ = −K x − B v, held over {period:g} s ({velocity} velocity, {delay_steps} steps late): stable?",
        METHOD,
        margin=1 - radius,
        margin_unit="(1 − spectral radius: shrinks by this share each period)",
        values=values,
        witness=witness,
        assumptions=_assumptions(len(radii)),
        reason=reason,
    )


def _loop(given, physical_damping, period, backward, delay_steps) -> tuple[Array, SampledLoop]:
    d = given.mass.shape[-1]
    friction = positive_matrices("physical_damping", physical_damping, definite=False)
    if friction.ndim == 2 and friction.shape[-1] == 1:
        friction = friction * np.eye(d)
    if friction.shape[-1] != d:
        raise InputError(
            f"physical_damping is {friction.shape[-1]} × {friction.shape[-1]} and the gains are {d} × {d}; "
            "pass matrices of one size, or a number."
        )
    every = [array.reshape(-1, d, d) for array in (*given, friction)]
    count = max(len(array) for array in every)
    if {len(array) for array in every} - {1, count}:
        raise InputError(
            f"physical_damping has {len(every[3])} samples and the gains have {count}; pass as many of each, or one."
        )
    masses, stiffness, damping, friction = (np.broadcast_to(array, (count, d, d)) for array in every)
    _, scaled = dimensionless(masses, (stiffness, period**2), (damping, period), (friction, period))
    return masses, SampledLoop(*scaled, backward=backward, delay_steps=delay_steps)


def _shown(
    loop: SampledLoop, steps: Array, radii: Array, masses: Array, period: float
) -> tuple[Certificate | CounterExample | None, str]:
    worst = int(np.argmax(radii))
    if abs(radii[worst] - 1) <= EDGE:
        return None, f"the spectral radius is one within {EDGE:g}: on the edge."
    other = loop.step(integrate=True)
    if radii[worst] > 1:
        return _growing(loop, steps[worst], other[worst], worst, masses[worst], period)
    found = [discrete_lyapunov(step, check) for step, check in zip(steps, other, strict=True)]
    if any(one is None for one in found):
        index = next(i for i, one in enumerate(found) if one is None)
        return None, f"the Lyapunov matrix of sample {index} does not hold on the integrated map."
    slack = min(one.rate for one in found if one is not None)
    matrices = np.array([one.matrix for one in found if one is not None])
    return Certificate(
        "Φᵀ P Φ − P ≺ 0, P ≻ 0, with [Lᵀx; T Lᵀv; …] as state and M = L Lᵀ",
        {"P": matrices[0] if len(matrices) == 1 else matrices, "step": other[worst]},
        slack,
    ), ""


def _growing(
    loop: SampledLoop, step: Array, other: Array, index: int, mass: Array, period: float
) -> tuple[CounterExample | None, str]:
    """The unstable mode in SI units, and the same start carried on by the integrated map."""
    d, factor = loop.degrees, np.linalg.cholesky(mass)
    to_position = np.linalg.inv(factor.T)
    blocks = [to_position, to_position / period]
    blocks += [to_position] * loop.backward + [factor / period**2] * loop.delay_steps
    units = np.zeros_like(step)
    for i, block in enumerate(blocks):
        units[i * d : (i + 1) * d, i * d : (i + 1) * d] = block
    step, other = (units @ one @ np.linalg.inv(units) for one in (step, other))

    mode = growing_mode(step, discrete=True)
    start = mode.start * 1e-3
    count, every = stride(math.log(GROWTH) / math.log(abs(mode.eigenvalue)))
    ahead, checked = np.linalg.matrix_power(step, every), np.linalg.matrix_power(other, every)
    states = powers(ahead, start, count)
    part = until_largest(states)
    time = np.arange(count, dtype=np.float64)[part] * every * period
    states = states[part]

    def again(initial: Array) -> tuple[Array, Array]:
        return time, powers(checked, initial, len(time))

    stiffness, damping = (
        factor @ (gain[index] / period**power) @ factor.T
        for gain, power in ((loop.stiffness, 2), (loop.damping, 1))
    )
    position, velocity = states[:, :d], states[:, d : 2 * d]
    energy = 0.5 * np.einsum("ni,ij,nj->n", velocity, mass, velocity)
    energy += 0.5 * np.einsum("ni,ij,nj->n", position, stiffness, position)
    example = CounterExample(
        f"a mode of the held loop grows by {abs(mode.eigenvalue):.6g} each period",
        time,
        states,
        energy,
        gains={
            "stiffness": np.tile(stiffness, (len(time), 1, 1)),
            "damping": np.tile(damping, (len(time), 1, 1)),
        },
        again=again,
    )
    _, replayed = again(start)
    if np.linalg.norm(replayed[-1]) <= np.linalg.norm(start):
        return None, "the unstable mode does not grow on the integrated map."
    return example, ""


def _assumptions(count: int) -> tuple[str, ...]:
    found = ("a rigid body, linear gains, a force that is held exactly over the period",)
    if count > 1:
        found += ("each set of gains held for ever: changing from one to another is not covered",)
    return found
