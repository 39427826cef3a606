r"""Varying gains with an α that varies as well: less damping is needed than with a constant one.

    V = ½ (ė + α e)ᵀ M (ė + α e) + ½ eᵀ (K + α D − α̇ M − α² M) e

never grows along ``M ë + D(t) ė + K(t) e = 0`` if α(t) exists with, at all times,

    α M ⪯ D,    K̇ + d(α D)/dt − 2 α K − α̈ M ⪯ 0,    K + α D − α̇ M − α² M ≻ 0 .

The first two are linear in α, the last holds if a number ``q ≥ α²`` can stand for α²: a cone program in the
coefficients of a periodic cubic spline α(t), solved for the largest common slack. α returns to its start at the end,
because without that the end of a schedule would cost nothing. What the solver returns is checked at other instants by
eigenvalues.

References
----------
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE T-RO 32, 2016 (α constant);
with α(t) the same derivation leaves the terms in α̇ and α̈.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import InputError, integer, require
from vic_toolbox.stability.arguments import Source
from vic_toolbox.stability.schedules.alpha_interval import SMOOTH, Problem
from vic_toolbox.stability.schedules.alpha_program import AlphaProgram
from vic_toolbox.stability.schedules.kronander_billard import judged
from vic_toolbox.stability.schedules.repetition import closed, growth
from vic_toolbox.stability.verdict import Certificate, Verdict

METHOD = "Kronander and Billard's storage function with α(t), a spline found by a cone program"
STATEMENT = (
    "α M ⪯ D, K̇ + d(α D)/dt ⪯ 2 α K + α̈ M and K + α D − α̇ M − α² M ≻ 0 with α(t) a periodic cubic spline"
)
INTERVALS = {True: 1600, False: 200}
"""Most intervals of the spline by default: axes on their own (or one), or matrices."""


@threadpool_limits.wrap(limits=1, user_api="blas")
def alpha_schedule(
    mass: Source,
    stiffness: Source,
    damping: Source,
    *,
    time: ArrayLike,
    intervals: int | None = None,
) -> Verdict:
    """Is a gain schedule stable, by a storage function with α(t).

    Parameters
    ----------
    mass : number or array_like (d, d)
        M ≻ 0, constant.
    stiffness, damping : number, array_like (n,), (d, d) or (n, d, d), or callable
        K ⪰ 0 and D ⪰ 0 at the instants of `time`, or functions of the time [s] that are sampled there; what does not
        change may be given once.
    time : array_like, shape (n,)
        Increasing [s].
    intervals : int, optional
        Of the spline; by default two for each sample, at most 1600 (200 for matrices that are not diagonal).

    Returns
    -------
    Verdict
        `values`: ``alpha``, α at the instants of `time` (n,) [1/s], and ``slack``, the largest common slack of the
        three inequalities relative to their size (negative: none), which is the margin; ``profile_time``,
        ``profile_alpha`` and ``profile_allowed`` for the picture.

        *Proved* only if the inequalities hold when they are checked at many more instants; where they do not, as
        :func:`~vic_toolbox.stability.kronander_billard`. Everything that a constant α proves is proved.

    Raises
    ------
    InputError
        Gains that are not symmetric, not positive, not finite, or not as many as the instants; a mass that changes.
    DependencyError
        Clarabel is not installed.
    """
    require("lmi", "clarabel")
    problem = Problem.of(mass, stiffness, damping, time=time)
    if problem is None:
        raise InputError("the mass changes; pass a constant one, or use moving_mass.")
    constant = judged(problem, search=False)
    if constant.status == "inconclusive" and "jumps" in constant.values:
        return constant
    parts = closed(problem.parts)
    n = len(problem.time)
    most = INTERVALS[problem.diagonal]
    count = min(max(2 * n, 16), most) if intervals is None else integer("intervals", intervals, low=4)
    program = AlphaProgram.of(problem.of_parts(parts or problem.parts), count)
    coefficients, slack, trouble = program.solved()
    question = "M ë + D(t) ė + K(t) e = 0 is stable: a storage function with α(t) never grows"
    notes = (SMOOTH, "the mass is constant", "α(t) ends as it begins, so that rounds may follow each other")
    unit = "of relative slack of the worst inequality"
    shown = {name: constant.values[name] for name in ("profile_time", "profile_allowed")}
    values: dict[str, Any] = {"slack": slack} | shown
    if coefficients is not None:
        alpha = program.spline(problem.time)[0] @ coefficients * program.frequency
        over_time = program.spline(shown["profile_time"])[0] @ coefficients * program.frequency
        values = {"alpha": alpha, "slack": slack, "profile_alpha": over_time} | shown
        held = program.checked(coefficients) if slack > 0 else -np.inf
        if held >= 0:
            found = {
                "alpha": alpha,
                "coefficients": coefficients * program.frequency,
                "spacing": program.spacing,
            }
            witness = Certificate(STATEMENT, found, held)
            return Verdict("proved", question, METHOD, slack, unit, values, witness, notes)
        trouble = "no α(t) was found" if slack <= 0 else "the solver's α(t) does not hold when it is checked"
    if constant.status == "proved" and isinstance(constant.witness, Certificate):
        alpha = np.full(n, constant.witness.values["alpha"])
        values = {"alpha": alpha, "slack": constant.witness.slack, "profile_chosen": alpha[0]} | shown
        margin, reason = constant.witness.slack, "a constant α serves"
        return Verdict("proved", question, METHOD, margin, unit, values, constant.witness, notes, reason)
    found = growth(problem.parts, lambda x: problem.of_parts(x).at)
    reason = f"{trouble}; this alone proves nothing"
    return found.verdict(question, METHOD, margin=slack, unit=unit, values=values, notes=notes, reason=reason)
