r"""Varying stiffness and damping with a constant mass: the certificate of Kronander and Billard, α found by itself.

    V = ½ (ė + α e)ᵀ M (ė + α e) + ½ eᵀ (K + α D − α² M) e

never grows along ``M ë + D(t) ė + K(t) e = 0`` if a constant α ≥ 0 exists with, at all times,

    α M ⪯ D    and    K̇ + α Ḋ ⪯ 2 α K .

Both are linear in α, so the α that serve are an interval: from the smallest that the changing gains need to the
largest that the damping allows.

References
----------
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE Transactions on Robotics 32,
2016, theorem 1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.stability.arguments import Source
from vic_toolbox.stability.schedules.alpha_interval import (
    SMOOTH,
    Problem,
    allowed,
    certified,
    needed,
    profile,
)
from vic_toolbox.stability.schedules.pencil import largest
from vic_toolbox.stability.schedules.repetition import Growth, growth
from vic_toolbox.stability.verdict import Verdict

METHOD = "Kronander and Billard 2016 with the best constant α"
MARGIN = "1/s: the largest α that the damping allows, less the smallest that the changing gains need"


@threadpool_limits.wrap(limits=1, user_api="blas")
def kronander_billard(mass: Source, stiffness: Source, damping: Source, *, time: ArrayLike) -> Verdict:
    """Is a gain schedule stable, by a storage function with one constant α.

    Parameters
    ----------
    mass, stiffness, damping : number, array_like (n,), (d, d) or (n, d, d), or callable
        M ≻ 0, K ⪰ 0 and D ⪰ 0 at the instants of `time`, or functions of the time [s] that are sampled there; what
        does not change may be given once. A mass that
        changes is judged with its Ṁ, see :func:`~vic_toolbox.stability.schedules.moving_mass.moving_mass`.
    time : array_like, shape (n,)
        Increasing [s], fine enough to see the gains change.

    Returns
    -------
    Verdict
        `values`: ``alpha`` (the smallest α that the changing gains need; inf if none serves) and ``alpha_max`` (the
        largest that the damping allows, min λ_min(M⁻¹ D)) [1/s]; ``required_damping``, α M; ``worst_index``,
        ``worst_time`` [s] and ``worst_direction``, where and along which e the gains rise fastest for their size;
        ``least_damped_time`` and ``least_damped_direction``; ``profile_time``, ``profile_needed`` and
        ``profile_allowed``, the same α instant by instant, for the picture. The margin is ``alpha_max − alpha``.

        *Proved* with an α in the middle of the interval, shown to serve at every instant (samples and cubics
        between them). Where there is none the theorem says nothing. Then a schedule that ends with the gains that
        it begins with is repeated, and *disproved* by a motion that grows from round to round; any other is
        *inconclusive*, with the motion that gains most energy for a witness. So is a schedule with jumps:
        :func:`~vic_toolbox.stability.schedules.held_gains.held_gains` is for that.

    Raises
    ------
    InputError
        Gains that are not symmetric, not positive, not finite, or not as many as the instants.
    """
    given = Problem.of(mass, stiffness, damping, time=time)
    if given is None:
        from vic_toolbox.stability.schedules.moving_mass import moving_mass

        return moving_mass(mass, stiffness, damping, time=time)
    return judged(given)


def judged(given: Problem, *, search: bool = True) -> Verdict:
    """The verdict on a schedule; without `search`, a growing motion is not looked for."""
    question = "M ë + D(t) ė + K(t) e = 0 is stable: a storage function never grows"
    jumps = np.union1d(given.stiffness.jumps, given.damping.jumps)
    if len(jumps):
        first = int(jumps[0])
        return Verdict(
            "inconclusive",
            question,
            METHOD,
            values={"jumps": jumps},
            reason=f"the gains jump ({len(jumps)} found), first between {given.time[first]:.6g} and "
            f"{given.time[first + 1]:.6g} s, and a jump has no slope; use held_gains for gains that are held",
        )
    (low, worst), (high, least_damped) = needed(given), allowed(given)
    alpha, top = low.value, high.value
    required = alpha * given.matrices(given.mass)[0]
    values: dict[str, Any] = {
        "alpha": alpha,
        "alpha_max": top,
        "required_damping": float(required[0, 0]) if required.size == 1 else required,
    }
    if low.index >= 0:
        values |= {"worst_index": low.index, "worst_time": worst, "worst_direction": low.direction}
    values |= {"least_damped_time": least_damped, "least_damped_direction": high.direction}
    values |= profile(given)
    notes = (SMOOTH, "the mass is constant")
    if alpha <= top:
        top = largest(given.rising_at, given.samples, start=top, diagonal=given.diagonal).value
    certificate, reason = certified(given, alpha, top) if alpha <= top else (None, "")
    margin = top - alpha
    if certificate is not None:
        values["profile_chosen"] = certificate.values["alpha"]
        return Verdict("proved", question, METHOD, margin, MARGIN, values, certificate, notes)
    reason = (
        reason or f"needs α = {alpha:.6g}/s, and the damping allows {top:.6g}/s; this alone proves nothing"
    )
    found = growth(given.parts, lambda parts: given.of_parts(parts).at) if search else Growth()
    return found.verdict(
        question, METHOD, margin=margin, unit=MARGIN, values=values, notes=notes, reason=reason
    )
