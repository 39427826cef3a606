"""A virtual wall computed at a finite rate: how much real damping makes it passive (Colgate and Schenkel)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_number, positive
from vic_toolbox.stability.arguments import matrices, positive_matrices
from vic_toolbox.stability.sampling.drawing_motion import drawing_motion
from vic_toolbox.stability.sampling.sampled_wall import WHOLE, energy_form, required_damping, split
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict, status_of

EDGE = 1e-9
"""Share of the needed damping within which nothing is said."""
GRID, REFINED = 200, 4
"""Angles per turn of the delay, and how often the grid about the top is made finer: 1e-12 of it, as it is flat."""
SLOW = 1e-2
"""Angle below which a maximum counts as that of θ → 0 [rad]."""
ANGLES = 2000
"""Of the grid on which the energy form is checked again."""


def sampled_passivity(
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    period: float,
    delay: float = 0.0,
    physical_damping: ArrayLike = 0.0,
) -> Verdict:
    """Is the wall ``u_k = −K x_k − B (x_k − x_{k−1})/T``, held over T and `delay` late, passive with the damping D?

    It is iff ``D > K T/2 + |B|`` without delay, and in general iff, for all ω in (0, π/T],

        ``D > T/2 · 1/(1 − cos ωT) · Re{(1 − e^{−jωT}) H(e^{jωT})}``,  ``H(z) = (K + B (1 − z⁻¹)/T) z^{−delay/T}``

    for delays of whole periods. With any other delay the force changes between samples; the condition is then that of
    the energy form of the positions at both instants, exact too: see
    :mod:`~vic_toolbox.stability.sampling.sampled_wall`.

    Parameters
    ----------
    stiffness : float, (n,), (d, d) or (n, d, d)
        K ⪰ 0 of the wall [N/m, Nm/rad].
    damping : float, (n,), (d, d) or (n, d, d)
        B of the wall [Ns/m, Nms/rad], symmetric; it may be negative.
    period : float
        T [s].
    delay : float, optional
        From the sample to the force [s].
    physical_damping : float, (d, d) or (n, d, d), optional
        D of the mechanism [Ns/m]; a number with matrices stands for ``D · 1``.

    Returns
    -------
    Verdict
        Margin: smallest eigenvalue of ``D − required`` [Ns/m]. Values: ``required_damping`` in the shape of the gains;
        ``exact``: whether it is needed too (K and B commute), or only enough, as ``K (T/2 + delay) + |B|``;
        ``worst_frequency`` [rad/s], where it is needed.

    Raises
    ------
    InputError
        Gains that are asymmetric or not finite, an indefinite K or D, sizes that differ, a period not positive.

    References
    ----------
    J. E. Colgate, G. G. Schenkel, Passivity of a class of sampled-data systems: application to haptic interfaces,
    Journal of Robotic Systems 14 (1997), eqs. (18) and (20).
    """
    period = positive("period", period)
    lateness = finite_number("delay", delay, low=0.0, high=1e3 * period) / period
    springs, dampers, friction = _gains(stiffness, damping, physical_damping)
    needed, frequencies, exact = zip(
        *(_required(k * period, b, lateness) for k, b in zip(springs, dampers, strict=True)), strict=True
    )
    short = [float(np.linalg.eigvalsh(d - r)[0]) for d, r in zip(friction, needed, strict=True)]
    worst = int(np.argmin(short))
    required = np.stack(needed)
    if np.ndim(stiffness) < 2 and np.ndim(damping) < 2:
        required = required[:, 0, 0]
    single = max(np.ndim(stiffness), np.ndim(damping)) in (0, 2)
    values = {
        "required_damping": _plain(required[0]) if single else required,
        "exact": all(exact),
        "worst_frequency": frequencies[worst] / period,
    }
    witness, reason = _shown(
        springs[worst] * period,
        dampers[worst],
        friction[worst],
        needed[worst],
        exact[worst],
        lateness,
        period,
    )
    return Verdict(
        status_of(witness),
        f"wall −K x − B Δx/T held over {period:g} s, {lateness * period:g} s late, with damping D: passive?",
        "Colgate and Schenkel (1997), eq. (20); between samples by the energy form of the positions",
        margin=short[worst],
        margin_unit="Ns/m of physical damping (D − required)",
        values=values,
        witness=witness,
        assumptions=(
            "viscous friction in the mechanism and ideal sensors; the wall may pull as well as push",
        ),
        reason=reason,
    )


def _worst(stiffness: float, damping: float, lateness: float) -> tuple[float, float]:
    """Largest required damping over all θ = ωT, and its θ.

    As θ → 0 it is ``(s + √(s² + (K T)² δ (1 − δ)))/2`` with ``s = K (T/2 + delay) − B``; without delay it is monotonic
    in cos θ.
    """
    rest = split(lateness)[1]
    slow = stiffness * (0.5 + lateness) - damping
    slowest = 0.5 * (slow + math.sqrt(slow**2 + stiffness**2 * rest * (1 - rest)))
    if lateness < WHOLE:
        return (0.5 * stiffness + damping, math.pi) if damping > 0 else (slow, 0.0)
    angles = np.linspace(0.0, math.pi, GRID * (2 + math.ceil(lateness)))[1:]
    found = required_damping(stiffness, damping, lateness, angles)
    for _ in range(REFINED):
        top = int(np.argmax(found))
        width = angles[1] - angles[0]
        low, high = max(angles[top] - width, 0.5 * angles[0]), min(angles[top] + width, math.pi)
        angles = np.linspace(low, high, GRID + 1)
        found = required_damping(stiffness, damping, lateness, angles)
    top = int(np.argmax(found))
    # near θ = 0 the formula divides small numbers: the limit is the better value there
    limit = angles[top] < SLOW or found[top] <= slowest
    return (slowest, 0.0) if limit else (float(found[top]), float(angles[top]))


def _required(stiffness: Array, damping: Array, lateness: float) -> tuple[Array, float, bool]:
    """Matrix of the damping needed (K already times T), the worst angle, and whether it is exact."""
    size = np.abs(stiffness).max() * np.abs(damping).max()
    if np.abs(stiffness @ damping - damping @ stiffness).max() <= 1e-12 * size:
        # eigenvectors of a generic sum diagonalise both
        scales = [np.abs(gain).max() or 1.0 for gain in (stiffness, damping)]
        directions = np.linalg.eigh(stiffness / scales[0] + 0.7236067977 * damping / scales[1])[1]
        k, b = (np.einsum("ji,jk,ki->i", directions, gain, directions) for gain in (stiffness, damping))
        found = [_worst(float(one), float(other), lateness) for one, other in zip(k, b, strict=True)]
        amounts = np.array([amount for amount, _ in found])
        return (directions * amounts) @ directions.T, found[int(np.argmax(amounts))][1], True
    values, directions = np.linalg.eigh(damping)
    absolute = (directions * np.abs(values)) @ directions.T
    definite = values[0] >= 0 or values[-1] <= 0
    angle = math.pi if values[-1] > -values[0] else 0.0
    return stiffness * (0.5 + lateness) + absolute, angle, bool(lateness < WHOLE and definite)


def _shown(
    stiffness: Array,
    damping: Array,
    friction: Array,
    needed: Array,
    exact: bool,
    lateness: float,
    period: float,
) -> tuple[Certificate | CounterExample | None, str]:
    slack = np.linalg.eigvalsh(friction - needed)[0]
    edge = EDGE * max(np.abs(needed).max(), np.abs(friction).max())
    if slack > edge:
        checked = energy_form(
            stiffness, damping, friction, lateness, np.linspace(0.0, math.pi, ANGLES + 1)[1:]
        ).min()
        if checked >= 0:
            return Certificate(
                "D − required_damping ≻ 0; the energy form is positive on a grid of frequencies",
                {"required_damping": needed, "physical_damping": friction},
                float(checked),
            ), ""
        return None, "the energy form is negative on the finer grid."
    example = drawing_motion(stiffness, damping, friction, lateness, period)
    if example is not None:
        return example, ""
    if exact or abs(slack) <= edge:
        return None, "D equals the damping that is needed: on the edge."
    return (
        None,
        "K and B do not commute: the damping is less than is enough, and no motion was found that draws energy.",
    )


def _gains(stiffness: ArrayLike, damping: ArrayLike, friction: ArrayLike) -> tuple[Array, Array, Array]:
    found = {
        "stiffness": positive_matrices("stiffness", stiffness, definite=False),
        "damping": matrices("damping", damping),
        "physical_damping": positive_matrices("physical_damping", friction, definite=False),
    }
    d = found["stiffness"].shape[-1]
    if found["physical_damping"].ndim == 2 and found["physical_damping"].shape[-1] == 1:
        found["physical_damping"] = found["physical_damping"] * np.eye(d)
    if any(array.shape[-1] != d for array in found.values()):
        sizes = ", ".join(f"{name} {array.shape[-1]} × {array.shape[-1]}" for name, array in found.items())
        raise InputError(f"the sizes differ: {sizes}; pass matrices of one size.")
    arrays = {name: array.reshape(-1, d, d) for name, array in found.items()}
    count = max(len(array) for array in arrays.values())
    if {len(array) for array in arrays.values()} - {1, count}:
        lengths = ", ".join(f"{name} has {len(array)}" for name, array in arrays.items())
        raise InputError(f"the numbers of samples differ: {lengths}; pass as many of each, or one for all.")
    first, second, third = (np.broadcast_to(array, (count, d, d)) for array in arrays.values())
    return first, second, third


def _plain(value: Array) -> Array | float:
    return float(value) if value.ndim == 0 else value
