r"""Gains that are held and jump, as a controller at a fixed rate sets them: no derivative, but an account of energy.

A jump of the stiffness by ΔK at the error e puts ``½ eᵀ ΔK e`` into the spring at once, while the state does not move.
Between jumps the damping takes ``∫ ėᵀ D ė dt``. With ``V = ½ (ė + α e)ᵀ M (ė + α e) + ½ eᵀ (K + α D − α² M) e``, which
falls between jumps if ``α M ⪯ D``, gains that are held are stable if a constant α ≥ 0 also has, at every jump,

    ΔK + α ΔD ⪯ 0 .

A sequence that ends with the gains it begins with is repeated, and its multipliers decide exactly.

References
----------
K. Kronander, A. Billard, IEEE T-RO 32, 2016, for V; F. Ferraguti, C. Secchi, C. Fantuzzi, "A tank-based approach to
impedance control with variable stiffness", ICRA 2013, for ``½ eᵀ ΔK e``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.stability.arguments import impedance, sample_times
from vic_toolbox.stability.schedules.definite import ROUNDING, pack, relative_slack
from vic_toolbox.stability.schedules.free_motion import IntegrationError, product
from vic_toolbox.stability.schedules.held_sequence import HeldSequence, decaying, form, gaining, growing
from vic_toolbox.stability.schedules.pencil import largest, least
from vic_toolbox.stability.verdict import Certificate, Verdict

METHOD = (
    "gains held between jumps: storage function with one α, multipliers where they repeat, account of energy"
)
STATEMENT = "α M ⪯ D and K + α D − α² M ≻ 0 always, ΔK + α ΔD ⪯ 0 at every jump"
MARGINAL = 1e-9
"""Distance of the spectral radius from one that is never told from it."""


@threadpool_limits.wrap(limits=1, user_api="blas")
def held_gains(
    mass: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    time: ArrayLike,
    error: ArrayLike | None = None,
    error_rate: ArrayLike | None = None,
) -> Verdict:
    """Is an impedance stable whose gains are held and jump, and what energy do the jumps put in.

    Parameters
    ----------
    mass : number or array_like (d, d)
        M ≻ 0, constant.
    stiffness, damping : number, array_like (n,), (d, d) or (n, d, d)
        K ⪰ 0 and D ⪰ 0; those of sample i hold from time[i] until time[i + 1], the last ones from then on.
    time : array_like, shape (n,)
        Increasing [s].
    error, error_rate : array_like, shape (n,) or (n, d), optional
        e and ė of a recorded motion at these instants; its energy is accounted for. Without it, that of the motion
        along which the energy grows most.

    Returns
    -------
    Verdict
        `values`: ``injected`` (n,), ½ eᵀ ΔK e of the jump at each instant [J]; ``injected_energy``, their sum;
        ``largest_injection`` and ``largest_injection_time``; ``dissipated_energy`` [J] (NaN without `error_rate`);
        ``lowest_balance``, the least that dissipated less injected energy comes to on the way [J]: below zero, that
        much had to be in a tank (NaN like the former). ``alpha`` and ``alpha_max`` [1/s], between which every α serves
        (inf and NaN: none);
        ``spectral_radius`` of a sequence that ends with the gains it begins with, ``energy_gain`` of another one.

        *Proved* by an α, or by P with ``Φᵀ P Φ ≺ P`` over a round; *disproved* by the motion that grows from round to
        round, replayed by another integrator; else *inconclusive*.

    Raises
    ------
    InputError
        Gains that are not symmetric, not positive, not finite, or not as many as the instants; a mass that changes.
    """
    given = impedance(mass, stiffness, damping)
    if given.mass.ndim == 3 and (given.mass != given.mass[0]).any():
        raise InputError("the mass changes; held_gains is for jumping gains and a constant mass.")
    lengths = [len(x) for x in given if x.ndim == 3]
    instants = sample_times(time, count=lengths[0] if lengths else None)
    n, d = len(instants), given.mass.shape[-1]
    k, b = (np.broadcast_to(x, (n, d, d)) for x in given[1:])
    held = HeldSequence(given.mass if given.mass.ndim == 2 else given.mass[0], k, b, instants)
    recorded = None
    if error is not None:
        e = _motion("error", error, n, d)
        recorded = e, None if error_rate is None else _motion("error_rate", error_rate, n, d)
    elif error_rate is not None:
        raise InputError("error_rate was given without error; pass both.")
    return _judged(held, recorded)


def _judged(held: HeldSequence, recorded: tuple[Array, Array | None] | None) -> Verdict:
    question = "M ë + D ė + K e = 0 is stable with gains that are held and jump"
    certificate, values = _stored(held)
    alpha, top = values["alpha"], values["alpha_max"]
    margin, unit = (top - alpha, "1/s: width of the range of α that serve") if certificate else (np.nan, "")
    notes = ("the gains of a sample hold until the next one", "the mass is constant")
    example, reason = None, ""
    phi = product(held.steps)
    if not np.isfinite(phi).all():
        return Verdict("inconclusive", question, METHOD, values=values, reason="the motion overflows")
    if held.closed:
        multipliers, vectors = np.linalg.eig(phi)
        radius = float(np.abs(multipliers).max())
        values["spectral_radius"] = radius
        try:
            error = float(np.abs(phi - product(held.collocated)).max())
        except IntegrationError as trouble:
            return Verdict(
                "inconclusive", question, METHOD, values=values, assumptions=notes, reason=str(trouble)
            )
        edge = max(MARGINAL, 10 * error)
        notes = (*notes, "the sequence, which ends with the gains that it begins with, is repeated for ever")
        if certificate is None:
            margin, unit = 1 - radius, "below a spectral radius of one"
            if radius < 1 - edge:
                certificate = decaying(held, phi)
            elif radius > 1 + edge:
                worst = int(np.argmax(np.abs(multipliers)))
                example = growing(held, multipliers[worst], vectors[:, worst])
            reason = f"marginal: the spectral radius is {radius:.9g}"
        start = example.initial_state if example else np.real(vectors[:, int(np.argmax(np.abs(multipliers)))])
    else:
        gain, start = gaining(held, phi)
        values["energy_gain"] = gain
        reason = (
            "no α serves, and the sequence does not repeat; the energy of a motion is multiplied by "
            f"{gain:.4g} at most"
        )
    if recorded is None:
        scaled = start if example else start / np.linalg.norm(start)
        _, path = held.path(scaled, 1, held.steps)
        values |= _account(
            held, path[:: held.parts, : len(held.mass)], energy=held.energy(path)[:: held.parts]
        )
        notes = (*notes, "energies are those of the motion that gains most, from a state of norm one")
    else:
        values |= _account(held, *recorded)
        notes = (*notes, "energies are those of the recorded motion, and only as its samples show it")
    if certificate is not None and certificate.slack >= 0:
        return Verdict("proved", question, METHOD, margin, unit, values, certificate, notes)
    if example is not None:
        return Verdict("disproved", question, METHOD, margin, unit, values, example, notes)
    return Verdict("inconclusive", question, METHOD, margin, unit, values, None, notes, reason)


def _stored(held: HeldSequence) -> tuple[Certificate | None, dict[str, Any]]:
    """The α that serve, and the certificate with the middle one."""
    k, d, m = pack(held.stiffness), pack(held.damping), pack(held.mass)
    k_jump, d_jump = np.diff(k, axis=1), np.diff(d, axis=1)
    mass = np.broadcast_to(m, d.shape)
    diagonal = np.cumsum(np.arange(1, len(held.mass) + 1)) - 1
    ceiling = float((d[diagonal] / m[diagonal]).min()) * (1 + 1e-9)
    allowed = largest(lambda s: (d[:, s], -mass[:, s]), d.shape[1], start=ceiling).value
    allowed = max(allowed, 0.0)
    needed = least(lambda s: (-k_jump[:, s], -d_jump[:, s]), k_jump.shape[1]).value
    values: dict[str, Any] = {"alpha": needed, "alpha_max": np.nan}
    if not np.isfinite(needed) or needed > allowed:
        return None, values
    top = largest(lambda s: (-k_jump[:, s], -d_jump[:, s]), k_jump.shape[1], start=allowed).value
    if top < needed:
        return None, values
    alpha = 0.5 * (needed + top)
    masses = np.broadcast_to(held.mass, held.damping.shape)
    checks = [
        relative_slack(held.damping, -alpha * masses),
        relative_slack(-np.diff(held.stiffness, axis=0), -alpha * np.diff(held.damping, axis=0)),
    ]
    storage = relative_slack(held.stiffness, alpha * held.damping, -(alpha**2) * masses)
    if storage <= ROUNDING or min(checks) < 0:
        return None, values
    values["alpha_max"] = top
    return Certificate(STATEMENT, {"alpha": alpha}, min(checks)), values


def _account(
    held: HeldSequence, error: Array, rate: Array | None = None, *, energy: Array | None = None
) -> dict[str, Any]:
    """Where energy comes from and goes to, along a motion at the samples."""
    injected = np.zeros(len(error))
    injected[1:] = 0.5 * form(error[1:], np.diff(held.stiffness, axis=0))
    put_in = np.cumsum(injected)
    taken = np.full(len(error), np.nan)
    if energy is not None:
        taken = energy[0] + put_in - energy
    elif rate is not None:
        power = form(rate, held.damping)
        ends = form(rate[1:], held.damping[:-1])  # a hold ends with the gains it began with
        taken = np.append(0.0, np.cumsum(0.5 * (power[:-1] + ends) * np.diff(held.time)))
    worst = int(np.argmax(injected))
    return {
        "injected": injected,
        "injected_energy": float(put_in[-1]),
        "largest_injection": float(injected[worst]),
        "largest_injection_time": float(held.time[worst]),
        "dissipated_energy": float(taken[-1]),
        "lowest_balance": float(np.min(taken - put_in)),
    }


def _motion(name: str, value: ArrayLike, n: int, d: int) -> Array:
    array = finite_array(name, value)
    if array.shape == (n,) and d == 1:
        array = array[:, None]
    if array.shape != (n, d):
        raise InputError(
            f"{name} has shape {np.shape(value)}; pass ({n}, {d}), as many samples and axes as the gains."
        )
    return array
