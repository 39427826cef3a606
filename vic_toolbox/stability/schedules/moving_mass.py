r"""Varying gains with a mass matrix that moves: the certificates with Ṁ, or with C.

An arm has M(x(t)). Its law either cancels all of C ẋ (the paper's), or keeps C ė; with
``V = ½ (ė + α e)ᵀ M (ė + α e) + ½ eᵀ (K + α D − α² M) e``, along the motion and for [ė; e],

    M ë + D ė + K e = 0         ⟸  [[D − ½ Ṁ − α M, −½ α Ṁ], [·, ½ (2 α K − K̇ − α Ḋ)]] ⪰ 0
    M ë + (C + D) ė + K e = 0   ⟸  [[D − α M, −½ α C], [·, ½ (2 α K − K̇ − α Ḋ)]] ⪰ 0     (Ṁ = C + Cᵀ)

and V ≻ 0, ``[[M, α M], [α M, K + α D]] ≻ 0``. All are linear in α. With α = 0 and a stiffness that does not rise the
first says ``D ⪰ ½ Ṁ``: positive gains alone prove nothing for the law that cancels C.

References
----------
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE T-RO 32, 2016 (M constant);
the forms with Ṁ and with C follow by differentiating V.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.stability.arguments import Source, impedance, sample_times, sampled
from vic_toolbox.stability.schedules.between_samples import Coefficient, Pieces, failing
from vic_toolbox.stability.schedules.definite import least_ratio, pack, relative_slack, size, unpack
from vic_toolbox.stability.schedules.free_motion import Matrices
from vic_toolbox.stability.schedules.moving_rows import Rows
from vic_toolbox.stability.schedules.pencil import SAMPLE, Edge, Pick, Samples, largest, least
from vic_toolbox.stability.schedules.repetition import growth
from vic_toolbox.stability.schedules.schedule import Cubics, Index, Schedule, Share
from vic_toolbox.stability.verdict import Certificate, Verdict

SMOOTH = "between the samples M, K and D are the cubics through them: they do not jump"
FITS = 1e-2
"""Largest ``Ṁ − C − Cᵀ``, relative to Ṁ and C, of a C that belongs to the mass."""
PROFILE = 301
"""Instants of the picture."""
ATTEMPTS = 4
"""How often α is moved because of what lies between samples."""


@threadpool_limits.wrap(limits=1, user_api="blas")
def moving_mass(
    mass: Source,
    stiffness: Source,
    damping: Source,
    *,
    time: ArrayLike,
    coriolis: ArrayLike | None = None,
) -> Verdict:
    """Is a gain schedule stable along a motion on which the mass matrix changes.

    Parameters
    ----------
    mass, stiffness, damping : number, array_like (n,), (d, d) or (n, d, d), or callable
        M ≻ 0, K ⪰ 0 and D ⪰ 0 at the instants of `time`, or functions of the time [s] that are sampled there; what
        does not change may be given once.
    time : array_like, shape (n,)
        Increasing [s].
    coriolis : array_like, shape (n,), (d, d) or (n, d, d), optional
        C with ``Ṁ = C + Cᵀ``, if the law keeps C ė; without it, the law cancels C ẋ.

    Returns
    -------
    Verdict
        `values`: ``alpha`` and ``alpha_max`` [1/s], between which every α serves (inf and NaN if none does);
        ``damping_margin`` [1/s], the least eigenvalue of M⁻¹(D − ½ Ṁ), or of M⁻¹ D with `coriolis`, with
        ``worst_time`` [s] and ``worst_direction`` where it is least. The margin is ``alpha_max − alpha``, or
        ``damping_margin`` where that is negative.

    Raises
    ------
    InputError
        Gains that are not symmetric, not positive, not finite, not as many as the instants, or a `coriolis` that
        does not belong to the mass.
    """
    instants = sample_times(time)
    given = impedance(*(sampled(x, instants) for x in (mass, stiffness, damping)))
    if coriolis is None and (given.mass.ndim == 2 or (given.mass == given.mass[0]).all()):
        from vic_toolbox.stability.schedules.kronander_billard import kronander_billard

        return kronander_billard(given.mass, given.stiffness, given.damping, time=time)
    lengths = [len(x) for x in given if x.ndim == 3]
    sample_times(instants, count=lengths[0] if lengths else None)
    parts = [Schedule.of(instants, pack(x)) for x in given]
    c = None if coriolis is None else _coriolis(coriolis, parts[0])
    return _judged(_Problem(parts[0], parts[1], parts[2], c))


@dataclass(frozen=True, eq=False)
class _Problem:
    mass: Schedule
    stiffness: Schedule
    damping: Schedule
    coriolis: Schedule | None

    @property
    def parts(self) -> list[Schedule]:
        return [self.mass, self.stiffness, self.damping] + ([self.coriolis] if self.coriolis else [])

    def of_parts(self, parts: Sequence[Schedule]) -> _Problem:
        mass, stiffness, damping, *coriolis = parts
        return _Problem(mass, stiffness, damping, coriolis[0] if coriolis else None)

    @property
    def time(self) -> Array:
        return self.mass.time

    @property
    def samples(self) -> int:
        return 1 if all(x.constant for x in self.parts) else len(self.time)

    def sampled(self, samples: Samples | slice) -> Rows:
        def rows(x: Schedule, y: Array) -> Array:
            return y if x.constant else y[:, samples]

        return Rows([rows(x, x.values) for x in self.parts], [rows(x, x.slopes) for x in self.parts])

    def on(self, t: Array) -> Rows:
        found = [x.at(t) for x in self.parts]
        return Rows([x[0] for x in found], [x[1] for x in found])

    def at(self, t: Array) -> Matrices:
        """M, K and the matrix before ė at instants (m,)."""
        rows = self.on(t)
        d = unpack(rows.d)
        if rows.c is not None:
            d = d + rows.c.T.reshape(d.shape)
        return unpack(rows.m), unpack(rows.k), d

    def pieces(self, alpha: float) -> Pieces:
        def coefficients(index: Index, low: Share, high: Share) -> Iterator[Coefficient]:
            cubics: list[Cubics] = [x.cubics(index, low, high) for x in self.parts]
            for i in range(3 if isinstance(index, slice) else 4):
                rows = Rows([x.values[i] for x in cubics], [x.slopes[i] for x in cubics])
                a, b = rows.falling()
                yield Coefficient((a, alpha * b))
                a, b = rows.storage()
                yield Coefficient((a, alpha * b), strict=True)

        return coefficients


def _judged(given: _Problem) -> Verdict:
    kept = given.coriolis is not None
    equation = "M(t) ë + (C(t) + D(t)) ė + K(t) e = 0" if kept else "M(t) ë + D(t) ė + K(t) e = 0"
    question = f"{equation} is stable: a storage function never grows"
    method = f"storage function with one α and {'C' if kept else 'Ṁ'} (Kronander and Billard's, with a moving mass)"
    jumps = np.unique(
        np.concatenate([x.jumps for x in given.parts if not x.constant] or [np.zeros(0, np.intp)])
    )
    if len(jumps):
        return Verdict(
            "inconclusive",
            question,
            method,
            values={"jumps": jumps},
            reason=f"M, K or D jumps ({len(jumps)} found), first after {given.time[jumps[0]]:.6g} s: no slope",
        )
    damped = _largest(given, lambda rows: rows.damped(), _ceiling(given))
    margin = float(damped.value)
    values: dict[str, Any] = {"alpha": np.inf, "alpha_max": np.nan, "damping_margin": margin}
    values |= {"worst_time": float(given.time[max(damped.index, 0)]), "worst_direction": damped.direction}
    t = np.linspace(given.time[0], given.time[-1], PROFILE)
    a, b = (unpack(x) for x in given.on(t).damped())
    values |= {"profile_time": t, "profile_allowed": least_ratio(a, -b)}
    certificate, reason = None, f"D − {'α M' if kept else '½ Ṁ'} is indefinite"
    unit = "1/s: least eigenvalue of " + ("M⁻¹ D" if kept else "M⁻¹ (D − ½ Ṁ)")
    if margin >= 0:
        low = least(lambda s: given.sampled(s).falling(), given.samples)
        alpha, top = low.value, np.nan
        if np.isfinite(alpha):
            top = _largest(given, lambda rows: rows.falling(), margin).value
            top = _largest(given, lambda rows: rows.storage(), top).value
        values |= {"alpha": alpha, "alpha_max": top}
        margin, unit, reason = np.nan, "", "no constant α serves at all times"
        if alpha <= top:
            margin, unit = top - alpha, "1/s: width of the range of α that serve"
            certificate, reason = _certified(given, alpha, top)
    notes = (SMOOTH, "the law keeps C ė" if kept else "the law cancels all of C ẋ")
    if certificate is not None:
        values["profile_chosen"] = certificate.values["alpha"]
        return Verdict("proved", question, method, margin, unit, values, certificate, notes)
    found = growth(given.parts, lambda parts: given.of_parts(parts).at)
    reason = f"{reason}; this alone proves nothing"
    return found.verdict(
        question, method, margin=margin, unit=unit, values=values, notes=notes, reason=reason
    )


def _largest(given: _Problem, form: Any, start: float) -> Edge:
    return largest(lambda s: form(given.sampled(s)), given.samples, start=start)


def _ceiling(given: _Problem) -> float:
    """More than the largest α that D − ½ Ṁ − α M ⪰ 0 can allow."""
    rows = given.sampled(slice(None))
    a, b = rows.damped()
    diagonal = np.cumsum(np.arange(1, size(a) + 1)) - 1
    bound = float((a[diagonal] / -b[diagonal]).min())
    return bound + 1e-9 * abs(bound)


def _certified(given: _Problem, alpha: float, top: float) -> tuple[Certificate | None, str]:
    intervals = 1 if given.samples == 1 else len(given.time) - 1
    statement = (
        "[[D − α M, −½ α C], [·, ½ (2 α K − K̇ − α Ḋ)]] ⪰ 0"
        if given.coriolis
        else "[[D − ½ Ṁ − α M, −½ α Ṁ], [·, ½ (2 α K − K̇ − α Ḋ)]] ⪰ 0"
    )
    for _ in range(ATTEMPTS):
        if alpha > top:
            break
        middle = 0.5 * (alpha + top)
        left = failing(given.pieces(middle), intervals)
        if not len(left.index):
            slack = _slack(given, middle)
            if slack < 0:
                return None, f"its eigenvalues, taken one by one, are negative by {-slack:.2g}"
            return Certificate(f"{statement} and V ≻ 0 at every instant", {"alpha": middle}, slack), ""
        rows = given.on(left.instants(given.time))
        before = (alpha, top)
        alpha = least(*_pick(rows.falling()), start=alpha).value
        if not np.isfinite(alpha):
            break
        for form in (rows.falling(), rows.storage()):
            top = largest(*_pick(form), start=top).value
        if (alpha, top) == before:
            break
    return None, "the inequalities could not be shown between the samples; sample more finely"


def _slack(given: _Problem, alpha: float) -> float:
    time = given.time
    rows = given.on(np.linspace(time[0], time[-1], min(4 * SAMPLE, 2 * len(time))))
    a, b = (unpack(x) for x in rows.falling())
    return relative_slack(a, alpha * b)


def _coriolis(value: ArrayLike, mass: Schedule) -> Schedule:
    """C as rows of all its entries, checked against Ṁ."""
    array = finite_array("coriolis", value)
    order, n = size(mass.values), len(mass.time)
    if array.ndim < 2:
        array = array[..., None, None]
    if array.shape not in ((order, order), (n, order, order)):
        raise InputError(
            f"coriolis has shape {np.shape(value)}; pass ({order}, {order}) or ({n}, {order}, {order}) as the mass has."
        )
    rows = array.reshape(-1, order * order).T
    found = Schedule.of(mass.time, np.ascontiguousarray(rows), diagonal=True)
    symmetric = pack(np.reshape(found.values.T, (-1, order, order)))
    both = symmetric + pack(np.swapaxes(found.values.T.reshape(-1, order, order), 1, 2))
    wrong = np.abs(mass.slopes - both).max(axis=1)
    scale = np.maximum(np.abs(mass.slopes).max(axis=1), np.abs(both).max(axis=1))
    if (wrong > FITS * max(float(scale.max()), np.finfo(float).tiny)).any():
        raise InputError(
            f"coriolis + its transpose differ from Ṁ by up to {wrong.max():.3g} (Ṁ is up to "
            f"{np.abs(mass.slopes).max():.3g}); pass the C of this mass and motion, finely sampled."
        )
    return found


def _pick(pencil: tuple[Array, Array]) -> tuple[Pick, int]:
    a, b = pencil
    return (lambda samples: (a[:, samples], b[:, samples])), a.shape[1]
