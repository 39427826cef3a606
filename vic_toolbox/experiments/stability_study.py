"""The analyses of one fit, table or run together, and what the runtime filters would have changed."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vic_toolbox import stability
from vic_toolbox.control import EnergyTank, FilterReplay, GainFilter, replay_filter
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.stability_settings import PERIOD, StabilitySettings
from vic_toolbox.experiments.stability_source import Source, is_run, read_source
from vic_toolbox.stability import Analysis


@dataclass(frozen=True, eq=False)
class Study:
    """What was found.

    Parameters
    ----------
    title, described : str
        What was analysed.
    settings : StabilitySettings
        How.
    period : float
        Control period that was used [s].
    analyses : mapping of str to Analysis
        By what they are about, e.g. ``gains``, ``rollout``, ``policy``.
    replays : mapping of str to FilterReplay
        What each runtime filter would have changed.
    starts : tuple of str
        Status of the schedule from each start of a run.
    notes : tuple of str
        What to know about all of it.
    """

    title: str
    described: str
    settings: StabilitySettings
    period: float
    analyses: Mapping[str, Analysis]
    replays: Mapping[str, FilterReplay] = field(default_factory=dict)
    starts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def study(
    path: str | os.PathLike[str],
    settings: StabilitySettings | None = None,
    *,
    progress: Progress | None = None,
) -> Study:
    """Analyse a fit, a table of gains, or a run.

    Raises
    ------
    FileError
        It is not there, or cannot be read.
    InputError
        It is none of these, or the settings do not fit it.
    """
    settings, progress = settings or StabilitySettings(), progress or Progress()
    settings.check()
    with np.errstate(all="ignore"):  # a motion that overflows grows: the verdict says so
        if is_run(path):
            from vic_toolbox.experiments.stability_run import study_run  # torch and mujoco

            return study_run(path, settings, progress=progress)
        return _study_gains(path, settings, progress)


def _study_gains(path: str | os.PathLike[str], settings: StabilitySettings, progress: Progress) -> Study:
    if settings.scenario is not None or settings.episodes > 1:
        raise InputError(f"{path} is no run; --scenario and --episodes are for runs.")
    progress.stage("reading the gains")
    source = read_source(path)
    progress.stage("analysing the gains")
    model, q, notes = _model(settings, source)
    period = settings.period or PERIOD
    analysis = stability.analyse(
        source.gains,
        model,
        q=q,
        axes=settings.axes or None,
        period=period,
        hold=settings.hold,
        physical_damping=_friction(settings, source),
        velocity=settings.velocity,
        delay_steps=settings.delay_steps,
        environment_stiffness=settings.environment,
    )
    return Study(
        source.title,
        source.described,
        settings,
        period,
        {"gains": analysis},
        replays(analysis, settings),
        notes=(*source.notes, *notes, *filter_note(analysis, settings)),
    )


def replays(analysis: Analysis, settings: StabilitySettings) -> dict[str, FilterReplay]:
    """The energy tank and the gain filter along the motion that the gains came with.

    Raises
    ------
    InputError
        There is no motion, no mass, or an α that the damping does not allow.
    """
    if settings.tank is None and settings.filter is None:
        return {}
    if (
        analysis.time is None
        or analysis.error is None
        or analysis.stiffness is None
        or analysis.damping is None
    ):
        raise InputError(
            "--tank and --filter replay a motion, and these gains came without one: pass a run, a fit whose log is "
            "still in its place, or a table with columns e_x, e_y, … [m, rad]."
        )
    apart = ~np.eye(len(analysis.axes), dtype=bool)
    full = bool((analysis.stiffness[:, apart] != 0).any() or (analysis.damping[:, apart] != 0).any())
    laws: dict[str, Any] = {}
    if settings.tank is not None:
        laws["energy tank"] = EnergyTank(energy=settings.tank)
    if settings.filter is not None:
        if analysis.mass is None:
            raise InputError("--filter needs the mass; pass --mass or --robot.")
        mass = analysis.mass if analysis.mass.ndim == 2 else analysis.mass[0]
        coupled = full or bool((mass[apart] != 0).any())
        laws["gain filter"] = GainFilter(mass=mass, alpha=settings.filter, matrices=coupled)
    found = {}
    for name, law in laws.items():
        matrices = law.matrices if isinstance(law, GainFilter) else full
        k, b = (
            a if matrices else np.diagonal(a, axis1=1, axis2=2)
            for a in (analysis.stiffness, analysis.damping)
        )
        found[name] = replay_filter(law, analysis.time, error=analysis.error, stiffness=k, damping=b)
    return found


def filter_note(analysis: Analysis, settings: StabilitySettings) -> tuple[str, ...]:
    """What a filter for a constant mass leaves out where the mass moves."""
    if settings.filter is None or analysis.mass is None or analysis.mass.ndim == 2:
        return ()
    return (
        "the gain filter is for a constant mass: it was given that of the first instant, so its bound leaves out Ṁ",
    )


def _model(settings: StabilitySettings, source: Source) -> tuple[Any, Any, tuple[str, ...]]:
    """The mass as the analysis takes it, the way of the arm, and what to know about it."""
    if settings.robot is None:
        numbers = settings.numbers
        if source.gains.stiffness.shape[-1] == 1 and len(settings.mass) == 6:
            raise InputError(f"{source.path} has one axis without a name; pass one mass.")
        return numbers, None, ()
    from vic_toolbox.models import load_robot

    robot = load_robot(settings.robot, tool=settings.tool)
    if settings.posture:
        if len(settings.posture) != robot.nv:
            raise InputError(
                f"the posture has {len(settings.posture)} angles and {robot.name} {robot.nv} joints."
            )
        return robot, np.array(settings.posture), ()
    if source.joints is not None and source.joints.shape[1] == robot.nv:
        return robot, source.joints, (f"M(x) of {robot.name} along the joints of the log",)
    return (
        robot,
        robot.home,
        (f"M(x) of {robot.name} in its home posture, as no other is known; pass --posture",),
    )


def _friction(settings: StabilitySettings, source: Source) -> Any:
    if source.gains.stiffness.shape[-1] == 1 and np.size(settings.friction) == 6:
        raise InputError(f"{source.path} has one axis without a name; pass one number for the friction.")
    return settings.friction
