"""A motion that grows under a schedule, looked for where no certificate was found.

Over a finite time every linear motion is bounded, so samples alone disprove nothing. A schedule that ends with the
gains it begins with can be repeated: then its multipliers decide (:mod:`.floquet`). For any other
one the motion that gains most energy from start to end is worth seeing, and no more than that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import eigh

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.floquet import growing, multipliers
from vic_toolbox.stability.schedules.free_motion import CHECK, FreeMotion, IntegrationError, Matrices
from vic_toolbox.stability.schedules.schedule import Schedule
from vic_toolbox.stability.verdict import CounterExample, Verdict

CLOSED = 1e-3
"""Largest difference of the gains at the end and at the start, relative to their range, of a closed schedule."""
NEXT = 2e-2
"""The same for the sample that would follow, of a schedule whose last sample is left out."""
ROUNDING = 1e-9
"""The same relative to the gains, for entries that hardly change."""
STEPS = 2048
"""Most steps of the integration that looks for growth."""
INSTANTS = 257
"""Of a motion."""


@dataclass(frozen=True, eq=False)
class Growth:
    """What was found.

    Parameters
    ----------
    repeated : bool
        The schedule is closed: the example grows from round to round, and disproves stability.
    example : CounterExample, optional
    values : mapping
        ``spectral_radius`` of a closed schedule, ``energy_gain`` (largest energy at the end over that at the start)
        of another one.
    assumptions : tuple of str
    reason : str
        In words, where it disproves nothing.
    """

    repeated: bool = False
    example: CounterExample | None = None
    values: dict[str, Any] = field(default_factory=dict)
    assumptions: tuple[str, ...] = ()
    reason: str = ""

    def verdict(
        self,
        question: str,
        method: str,
        *,
        margin: float,
        unit: str,
        values: Mapping[str, Any],
        notes: tuple[str, ...],
        reason: str,
    ) -> Verdict:
        """What is left to say where no certificate holds: disproved by the example, or inconclusive for `reason`."""
        disproved = self.repeated and self.example is not None
        return Verdict(
            "disproved" if disproved else "inconclusive",
            question,
            method,
            margin if np.isfinite(margin) else float("nan"),
            unit,
            {**values, **self.values},
            self.example,
            (*notes, *self.assumptions),
            "" if disproved else f"{reason}; {self.reason}",
        )


def growth(
    parts: Sequence[Schedule], at: Callable[[Sequence[Schedule]], Callable[[Array], Matrices]]
) -> Growth:
    """Look for a growing motion.

    Parameters
    ----------
    parts : sequence of Schedule
        What changes.
    at : callable
        Takes such parts and gives a function that returns M, K and D, (m, d, d) each, at instants (m,).
    """
    whole = closed(parts)
    start, stop = (float(t) for t in (whole or parts)[0].time[[0, -1]])
    try:
        return (_once if whole is None else _repeated)(FreeMotion(at(whole or parts), start, stop))
    except IntegrationError as error:
        return Growth(reason=str(error))


def closed(parts: Sequence[Schedule]) -> list[Schedule] | None:
    """The schedules if they end where they begin, with one more sample if they end just before that; else None."""
    time = parts[0].time
    gap = float(np.median(np.diff(time)))
    closes, follows = True, True
    for part in parts:
        extent = np.ptp(part.values, axis=1)  # row by row, so that units do not mix
        first, last = part.values[:, 0], part.values[:, -1]
        closes &= bool((np.abs(last - first) <= CLOSED * extent + ROUNDING * part.scale).all())
        follows &= bool(
            (np.abs(last + gap * part.slopes[:, -1] - first) <= NEXT * extent + ROUNDING * part.scale).all()
        )
    if closes:
        return list(parts)
    if not follows:
        return None
    longer = np.append(time, time[-1] + gap)
    return [
        Schedule(longer, x.values if x.constant else np.append(x.values, x.values[:, :1], axis=1), x.diagonal)
        for x in parts
    ]


def _repeated(motion: FreeMotion) -> Growth:
    length = motion.stop - motion.start
    notes = (
        f"the schedule, which ends with the gains that it begins with, is repeated every {length:.6g} s",
    )
    found = motion.transition(most=STEPS, tolerance=1e-7)
    if found is None:
        return Growth(reason="the motion has too many oscillations to look for growth; use floquet")
    radius = float(np.abs(np.linalg.eigvals(found[0])).max())
    values = {"spectral_radius": radius}
    if radius > 1 + 1e-6:
        exact = multipliers(motion)
        example = growing(motion, exact) if exact.radius > 1 + exact.tolerance else None
        if example is not None:
            return Growth(True, example, {"spectral_radius": exact.radius}, notes)
    kind = "below one: stable" if radius < 1 - 1e-6 else "one to rounding: marginal"
    return Growth(
        values=values,
        reason=f"repeated, the schedule has a spectral radius of {radius:.6g}, {kind} (use floquet)",
    )


def _once(motion: FreeMotion) -> Growth:
    """The motion whose energy grows most from the first instant to the last."""
    found = motion.transition(most=STEPS, tolerance=1e-6)
    if found is None:
        return Growth(reason="the motion has too many oscillations to look for growth")
    m, k, _ = motion.matrices(np.array([motion.start, motion.stop]))
    size = m.shape[-1]
    before, after = np.zeros((2, 2 * size, 2 * size))
    for weight, i in ((before, 0), (after, 1)):
        weight[:size, :size], weight[size:, size:] = k[i], m[i]
        weight *= motion.scale[:, None] * motion.scale
    if np.linalg.eigvalsh(k[0])[0] <= 0:
        return Growth(reason="the stiffness is zero at the start, so that energies cannot be compared")
    gains, vectors = eigh(found[0].T @ after @ found[0], before)
    values = {"energy_gain": float(gains[-1])}
    reason = f"a schedule of finite length; the energy of a motion is multiplied by {gains[-1]:.4g} at most"
    if gains[-1] <= 1:
        return Growth(values=values, reason=reason)
    state = vectors[:, -1] * motion.scale
    t = np.linspace(motion.start, motion.stop, INSTANTS)
    path = motion.motion(state / np.linalg.norm(state), t)
    m, k, d = motion.matrices(t)

    def again(initial: Array) -> tuple[Array, Array]:
        return t, motion.motion(initial, t, method=CHECK)

    example = CounterExample(
        f"over the schedule, passed through once, the energy of this motion is multiplied by {gains[-1]:.4g}",
        time=t,
        state=path,
        energy=motion.energy(t, path),
        gains={"stiffness": k, "damping": d},
        again=again,
    )
    return Growth(example=example, values=values, reason=reason)
