"""One call for everything: what applies to a subject is asked, and the verdicts come back together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, finite_number, integer, one_of, positive
from vic_toolbox.gains import Parametrisation
from vic_toolbox.stability.analysis import computer, courses, sets
from vic_toolbox.stability.analysis.findings import Analysis, Finding
from vic_toolbox.stability.analysis.inertia import read_inertia
from vic_toolbox.stability.analysis.kept import gains_that_occur, kept
from vic_toolbox.stability.analysis.setting import Setting, uncoupled
from vic_toolbox.stability.analysis.subject import (
    Constant,
    Course,
    GainRange,
    Policy,
    axis_names,
    of_parametrisation,
    read_subject,
)
from vic_toolbox.stability.arguments import positive_matrices
from vic_toolbox.stability.policies.policy import policy_stability
from vic_toolbox.stability.sampling.sampled import VELOCITIES
from vic_toolbox.stability.verdict import Certificate

BETWEEN = "between the samples, mass and gains stay in the hull of those at the samples"
CLIPPED = (
    "nothing but the policy's gains acts, its actions are clipped to their range, and the mass stays as it is"
)


def analyse(
    subject: Any,
    model: Any = None,
    *,
    time: ArrayLike | None = None,
    q: ArrayLike | None = None,
    v: ArrayLike | None = None,
    axes: Sequence[str] | None = None,
    period: float | None = None,
    hold: float | None = None,
    physical_damping: ArrayLike = 0.0,
    velocity: Literal["exact", "backward"] = "exact",
    delay_steps: int = 0,
    environment_stiffness: float = 1e5,
    parametrisation: Parametrisation | None = None,
    **policy: Any,
) -> Analysis:
    """Ask of gains whatever can be asked: are they stable, are they passive, how far from the edge, what to do.

    Parameters
    ----------
    subject : object
        One of

        - gains over time: anything with ``time``, ``stiffness`` and ``damping`` ((n,), (n, d) or (n, d, d); NaN where
          they are not determined), e.g. a :class:`~vic_toolbox.estimation.GainEstimate`, a recorded episode; with
          ``error`` and ``error_rate`` (or ``rate``), the motion; or a pair (K, B) with `time`;
        - a range: a :class:`~vic_toolbox.gains.Parametrisation`, or a tuple of tuples
          ``((k_low, k_high), (b_low, b_high))`` of numbers or diagonals;
        - constant gains: :class:`~vic_toolbox.gains.ImpedanceGains`, or a pair (K, B) of numbers, diagonals or
          matrices; a batch of gains without `time` is a set of which any may follow any;
        - a policy K(e, ė), B(e, ė): see :func:`~vic_toolbox.stability.policy_stability`.
    model : number, array_like (d,), (d, d) or (n, d, d), or RobotModel, optional
        The mass that they move [kg, kg m²], constant or along `time`, or the arm, with `q`. One number for six axes is
        that of the translations, and the rotations are left out. Without it only what needs no mass is asked.
    time : array_like, shape (n,), optional
        Instants of gains that do not bring their own [s].
    q, v : array_like, shape (nv,) or (n, nv), optional
        Posture of the arm, or its way [rad, rad/s].
    axes : sequence of str, optional
        Names of the axes to judge (x, y, z, rx, ry, rz); by default all that are determined. The others are taken to
        stand still.
    period : float, optional
        Control period [s]; without it nothing is asked about the computer.
    hold : float, optional
        How long gains are held before they jump to the next [s].
    physical_damping : number, array_like (d,) or (d, d), optional
        Friction of the mechanism; one number for six axes is that of the translations [Ns/m].
    velocity : {'exact', 'backward'}, optional
        See :func:`~vic_toolbox.stability.sampled_stability`.
    delay_steps : int, optional
        Periods from the measurement to the force.
    environment_stiffness : float, optional
        Of what is touched [N/m].
    parametrisation : Parametrisation, optional
        What a policy's actions mean; its range is judged too.
    **policy
        Further arguments of :func:`~vic_toolbox.stability.policy_stability`.

    Returns
    -------
    Analysis
        A finding for each question that applies: ``schedule``, ``held``, ``inertia``, ``switching``,
        ``worst switching``, ``safe range``, ``policy``, ``sampled``, ``passivity``, ``contact``.

    Raises
    ------
    InputError
        A subject or a mass that is none of these, or gains that are not symmetric, not positive or nowhere determined.
    DependencyError
        A package of the group ``lmi`` is missing.

    Examples
    --------
    >>> from vic_toolbox import stability
    >>> found = stability.analyse((1000.0, 30.0), 2.0, period=1e-3)
    >>> found["sampled"].status
    'proved'
    """
    read = read_subject(subject, time)
    one_of("velocity", velocity, VELOCITIES)
    if policy and not isinstance(read, Policy):
        raise InputError(
            f"{', '.join(policy)}: only a policy takes these; a {type(subject).__name__} was passed."
        )
    size = _size(read, model)
    samples = len(read.time) if isinstance(read, Course) else None
    inertia = read_inertia(model, size, samples, q, v)
    setting = Setting(
        names=axis_names(size),
        inertia=inertia,
        period=None if period is None else positive("period", period),
        hold=None if hold is None else positive("hold", hold),
        physical_damping=_friction(physical_damping, size),
        velocity=velocity,
        delay_steps=integer("delay_steps", delay_steps, low=0, high=100),
        environment_stiffness=finite_number("environment_stiffness", environment_stiffness, low=0.0),
    )
    notes = [inertia.note] if inertia.note else []
    if isinstance(read, Policy):
        return _of_policy(read, setting, notes, parametrisation, policy)
    read, setting, left_out = kept(read, setting, axes)
    notes += left_out
    findings = _findings(read, setting, notes)
    course = read if isinstance(read, Course) else None
    stiffness, damping = gains_that_occur(read)
    return Analysis(
        subject=_named(read),
        findings=tuple(findings),
        assumptions=tuple(notes),
        axes=setting.names,
        time=None if course is None else course.time,
        stiffness=stiffness,
        damping=damping,
        mass=setting.inertia.mass,
        error=None if course is None else course.error,
    )


def _findings(read: Course | GainRange | Constant, setting: Setting, notes: list[str]) -> list[Finding]:
    found: list[Finding | None] = []
    if isinstance(read, GainRange):
        if setting.inertia.mass is not None and not uncoupled(setting.mass):
            read = read.spread()
        notes.append(
            f"what is said about the computer and about contact holds at {len(read.members[0])} corners"
        )
    gains = gains_that_occur(read)
    if setting.inertia.mass is not None:
        if isinstance(read, Course):
            found += _over_time(read, setting)
        if isinstance(read, GainRange):
            found += _of_a_set(read, setting)
            found.append(sets.how_far(gains, setting) if _exact(gains, setting) else None)
    else:
        positive_matrices("stiffness", gains[0], definite=False)
        positive_matrices("damping", gains[1], definite=False)
    if setting.period is None:
        notes.append("the force follows at once; pass the control period to ask about the computer")
    elif setting.inertia.mass is not None:
        found.append(computer.held_force(gains, setting, setting.period))
    if setting.period is not None:
        found.append(computer.with_any_hand(gains, setting, setting.period))
    if setting.inertia.mass is not None:
        found.append(computer.touching(gains, setting))
    return [finding for finding in found if finding is not None]


def _over_time(course: Course, setting: Setting) -> list[Finding | None]:
    gains = course.stiffness, course.damping
    schedule = courses.as_they_changed(course, setting)
    constant = all((gain == gain[0]).all() for gain in gains) and not setting.inertia.moving
    among: list[Finding] = []
    if not constant:
        among = _of_a_set(GainRange(gains, gains, "the gains that occur"), setting)
        schedule = courses.or_by_switching(schedule, among[0], note=BETWEEN)
    found: list[Finding | None] = [schedule]
    if setting.inertia.moving:
        found.append(courses.on_a_moving_inertia(course, setting))
    elif setting.hold is not None:
        found.append(courses.held(course, setting))
    return [*found, *among]


def _of_a_set(gains: GainRange, setting: Setting) -> list[Finding]:
    """Any switching; and the worst one, exactly, where axes do not act on each other."""
    switching = sets.any_switching(gains.members, setting, cover=gains.cover, named=gains.named)
    worst = sets.worst_switching(gains.members, setting) if _exact(gains.members, setting) else None
    if worst is None:
        return [switching]
    return [sets.decided_exactly(switching, worst, gains.members, setting), worst]


def _exact(gains: tuple[Array, Array], setting: Setting) -> bool:
    return not setting.inertia.moving and uncoupled(setting.mass, *gains)


def _of_policy(
    read: Policy,
    setting: Setting,
    notes: list[str],
    parametrisation: Parametrisation | None,
    options: dict[str, Any],
) -> Analysis:
    mass = setting.inertia.mass
    if mass is None:
        raise InputError("a policy needs the mass that it moves; pass it as the second argument.")
    if setting.inertia.dropped:
        raise InputError(
            "a policy of six axes needs six masses (three in kg, three in kg m²), or a (6, 6) matrix."
        )
    if setting.inertia.moving:
        raise InputError("a policy is judged about one posture; pass one mass, not one for each instant.")
    verdict = policy_stability(read.call, mass, parametrisation=parametrisation, **options)
    finding = Finding(
        "policy", "Do motions under this policy come to rest?", verdict, _policy_remedy(verdict)
    )
    found: list[Finding] = [finding]
    range_ = None if parametrisation is None else of_parametrisation(parametrisation)
    if range_ is not None:
        found += _findings(range_, setting, notes)
        switching = next(one for one in found if one.name == "switching")
        if options.get("load") is None:
            found[0] = courses.or_by_switching(finding, switching, note=CLIPPED)
    return Analysis(
        "a policy" if range_ is None else f"a policy, and {range_.named}",
        tuple(found),
        tuple(notes),
        setting.names,
        stiffness=None if range_ is None else range_.members[0],
        damping=None if range_ is None else range_.members[1],
        mass=mass,
    )


def _policy_remedy(verdict: Any) -> str:
    if verdict.status == "proved":
        return "nothing" if "range" in verdict.question else "local only: pass the region in which it works"
    if verdict.status == "disproved":
        return "smaller gain gradients (a smoother policy), more damping, or a filter of its gains"
    if isinstance(verdict.witness, Certificate):
        return "nothing was seen to grow: more samples, or a range of gains that is safe whatever the policy does"
    return "look at its equilibrium: more damping, or a smoother policy there"


def _size(read: Course | GainRange | Constant | Policy, model: Any) -> int:
    if not isinstance(read, Policy):
        return gains_that_occur(read)[0].shape[-1]
    if model is None:
        raise InputError("a policy needs the mass that it moves; pass it as the second argument.")
    return 6 if hasattr(model, "operational_space") else max(1, np.atleast_1d(model).shape[-1])


def _friction(value: ArrayLike, size: int) -> Array:
    array = finite_array("physical_damping", value)
    if array.ndim == 0:
        array = np.full(size, float(array))
        array[3:] *= size != 6
    if array.shape == (size,):
        array = np.diag(array)
    if array.shape != (size, size):
        raise InputError(
            f"physical_damping has shape {np.shape(value)}; pass a number, {size} numbers or a ({size}, {size}) matrix."
        )
    return positive_matrices("physical_damping", array, definite=False)


def _named(read: Course | GainRange | Constant) -> str:
    if isinstance(read, GainRange):
        return read.named
    return "gains over time" if isinstance(read, Course) else "constant gains"
