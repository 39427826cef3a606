"""Questions about gains that change in time: as they did, as they are held, and on an inertia that moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vic_toolbox.errors import Array, DependencyError, InputError
from vic_toolbox.stability.analysis.findings import Finding
from vic_toolbox.stability.analysis.setting import Setting
from vic_toolbox.stability.analysis.subject import Course
from vic_toolbox.stability.arms.arm import arm_passivity
from vic_toolbox.stability.arms.inertia_passivity import inertia_passivity
from vic_toolbox.stability.schedules.alpha_schedule import alpha_schedule
from vic_toolbox.stability.schedules.held_gains import held_gains
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard
from vic_toolbox.stability.verdict import Verdict

MOST_FOR_ALPHA = 2000
"""Samples from which on α(t) is not looked for where the axes are coupled: its cone program would take minutes."""


def as_they_changed(course: Course, setting: Setting) -> Finding:
    """With one α; where that does not decide, with α(t); where the gains jump, held."""
    tried: list[Verdict] = []
    verdict = kronander_billard(setting.mass, course.stiffness, course.damping, time=course.time)
    jumps = "jumps" in verdict.values
    if jumps and not setting.inertia.moving:
        tried, verdict = [verdict], _held(course, setting)
    elif verdict.status == "inconclusive" and not setting.inertia.moving:
        second = _with_alpha_of_time(course, setting)
        if second is not None:
            tried, verdict = ([verdict], second) if second.status != "inconclusive" else ([second], verdict)
    return Finding(
        "schedule",
        "Is it stable while the gains change as they do here?",
        verdict,
        _remedy(verdict, setting),
        tuple(tried),
    )


def or_by_switching(schedule: Finding, switching: Finding, *, note: str) -> Finding:
    """Where a question is undecided and any switching among all gains (and masses) is safe, it is answered too.

    M⁻¹K and M⁻¹D stay in the hull that one Lyapunov function serves, and with it no rate of change matters, nor Ṁ.
    """
    if schedule.status != "inconclusive" or switching.status != "proved":
        return schedule
    verdict = replace(switching.verdict, assumptions=(*switching.verdict.assumptions, note))
    tried = (schedule.verdict, *schedule.tried)
    remedy = "nothing: one Lyapunov function serves all gains that can occur, however they change"
    return replace(schedule, verdict=verdict, remedy=remedy, tried=tried)


def _with_alpha_of_time(course: Course, setting: Setting) -> Verdict | None:
    if len(course.time) > MOST_FOR_ALPHA and course.stiffness.shape[-1] > 1:
        return None
    try:
        return alpha_schedule(setting.mass, course.stiffness, course.damping, time=course.time)
    except DependencyError:  # without a solver for cones the other verdict stands
        return None


def _remedy(verdict: Verdict, setting: Setting) -> str:
    values = verdict.values
    if verdict.status == "proved":
        return "nothing: no motion grows, whatever the error"
    if "largest_injection_time" in values:
        return (
            f"the largest jump puts in {values['largest_injection']:.3g} J at "
            f"{values['largest_injection_time']:.3g} s: ramp the stiffness there, or let an energy tank pay for it"
        )
    if "damping_margin" in values and values["damping_margin"] < 0:
        return (
            f"more damping at {values['worst_time']:.3g} s, where the moving inertia takes it away (B ⪰ ½ Ṁ)"
        )
    needed, allowed = values.get("alpha", np.nan), values.get("alpha_max", np.nan)
    when = values.get("worst_time")
    where = "" if when is None else f" at {float(when):.3g} s"
    needed, allowed = float(np.max(needed)), float(np.max(allowed))
    if np.isfinite(needed) and np.isfinite(allowed) and 0 < allowed < needed and not setting.inertia.moving:
        factor = needed / allowed
        return f"let the gains rise {factor:.2g} × more slowly{where}, or give {factor:.2g} × the damping"
    return (
        f"let the gains rise more slowly{where}, give more damping, or filter them (energy tank, gain filter)"
    )


def held(course: Course, setting: Setting) -> Finding:
    """With gains that a controller sets every `hold` seconds."""
    verdict = _held(course if setting.hold is None else _every(course, setting.hold), setting)
    recorded = course.error is not None
    if verdict.status == "proved":
        remedy = "nothing: no jump can make a motion grow"
    elif recorded and np.isfinite(verdict.values["lowest_balance"]):
        lowest = verdict.values["lowest_balance"]
        remedy = (
            f"on this motion the damper paid for every jump with {lowest:.3g} J to spare; for others see the schedule"
            if lowest >= 0
            else f"on this motion the jumps put in {-lowest:.3g} J more than the damper had taken: a tank must hold it"
        )
    else:
        remedy = _remedy(verdict, setting)
    held_for = "" if setting.hold is None else f" for {1e3 * setting.hold:.4g} ms each"
    return Finding("held", f"Is it stable with gains that are held{held_for} and jump?", verdict, remedy)


def _held(course: Course, setting: Setting) -> Verdict:
    return held_gains(
        setting.mass,
        course.stiffness,
        course.damping,
        time=course.time,
        error=course.error,
        error_rate=course.error_rate,
    )


def _every(course: Course, hold: float) -> Course:
    """The samples that are there at the beginning of each hold."""
    span = course.time[-1] - course.time[0]
    if hold >= span:
        raise InputError(
            f"gains are held for {hold:g} s and the schedule takes {span:.4g} s; pass a shorter hold."
        )
    instants = course.time[0] + hold * np.arange(int(span / hold * (1 + 1e-9)) + 1)
    index = np.searchsorted(course.time, instants * (1 + 1e-12) + 1e-12, side="right") - 1
    index, kept = np.unique(index, return_index=True)

    def chosen(a: Array | None) -> Array | None:
        return None if a is None else a[index]

    return Course(
        instants[kept],
        course.stiffness[index],
        course.damping[index],
        chosen(course.error),
        chosen(course.error_rate),
    )


def on_a_moving_inertia(course: Course, setting: Setting) -> Finding:
    """B ⪰ ½ Ṁ along the way."""
    inertia, mean = setting.inertia, course.stiffness.mean(axis=0)
    six = len(setting.names) == 6
    if inertia.robot is not None and inertia.q is not None and inertia.q.ndim == 2 and six:
        verdict = arm_passivity(
            inertia.robot, mean, course.damping, time=course.time, q=inertia.q, v=inertia.v
        )
    else:
        rate = np.gradient(setting.mass, course.time, axis=0, edge_order=2)
        verdict = inertia_passivity(setting.mass, mean, course.damping, time=course.time, mass_rate=rate)
    factor = float(verdict.values.get("damping_factor", np.nan))
    remedy = (
        "nothing: the damping takes more than the moving inertia gives"
        if verdict.status == "proved"
        else f"multiply the damping by {factor:.3g}, move more slowly, or feed C ẋ_d forward instead of C ẋ"
    )
    return Finding("inertia", "Does the damping pay for the inertia that moves (B ⪰ ½ Ṁ)?", verdict, remedy)
