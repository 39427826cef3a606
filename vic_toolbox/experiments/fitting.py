"""From raw logs to gains: read and check, take bias, weight and inertia out, fit, and say what to know about it."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from vic_toolbox import estimation, recordings
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.estimation import FitError, GainEstimate
from vic_toolbox.experiments.conditioning import aligned, conditioned, in_contact, weighed
from vic_toolbox.experiments.fit_advice import Advice, advice, refuse_wrong_clock
from vic_toolbox.experiments.fit_settings import FitSettings
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.recordings import Inspection, Layout, Payload, Recording
from vic_toolbox.recordings.frame import FORCE

EXAMPLE = Path(recordings.__file__).parent / "example"
"""A demonstration that comes along: a human guides the digital twin, see the README there."""
EXAMPLE_SETTINGS = FitSettings(structure="damping_factor", knots=0.3, between=(0.0, 2.7))
"""A human's hand ties damping to stiffness closely enough; after 2.7 s nothing excites the motion any more."""
LEAST_CONTACT = 200
"""Samples in contact that the constant gains for comparison are fitted to; with fewer, all samples are used."""
SHARED = (
    "Logs that are fitted together have the same columns and the same sensor; fit others apart, or bring "
    "them to one form with: vic recording inspect FILE --layout LAYOUT --save FILE.npz"
)


@dataclass(frozen=True)
class Input:
    """A log that went into a fit."""

    file: str
    sha256: str


@dataclass(frozen=True, eq=False)
class Fit:
    """Gains fitted to logs, with everything that a reader needs to judge them."""

    settings: FitSettings
    layout: Layout
    """How the logs were read."""
    logs: tuple[Recording, ...]
    """As they were read."""
    recordings: tuple[Recording, ...]
    """As they were fitted: bias, weight and inertia taken out."""
    estimate: GainEstimate
    """The gains."""
    overall: GainEstimate | None
    """Constant gains and a constant bias over all samples in contact, for comparison; None without enough data."""
    payload: Payload | None
    """What hung on the sensor, from the calibration."""
    inspections: tuple[Inspection, ...]
    """Of `recordings`: frame and latency checked."""
    advice: tuple[Advice, ...]
    """What to know, the gravest first, each with its remedy."""
    inputs: tuple[Input, ...] = ()

    @property
    def determined(self) -> bool:
        """Whether the data determine any gain at all."""
        return bool(self.estimate.stiffness_observable.any() or self.estimate.damping_observable.any())


def fit_logs(
    files: Sequence[str | os.PathLike[str]],
    settings: FitSettings | None = None,
    *,
    layout: Layout | None = None,
    stamps: str = "header",
    repair: bool = False,
    calibration: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Read logs and fit gains to all of them together.

    Parameters
    ----------
    files : sequence of path-like
        Logs of the same sensor, one K(t), B(t) for all: with several their clocks start together at zero.
    settings : FitSettings, optional
    layout : Layout, optional
        Where the logs keep what, and how the sensor is mounted.
    stamps : {"header", "arrival"}
        Which times of a bag's messages to use.
    repair : bool
        Mend the logs first, see :func:`vic_toolbox.recordings.repair`.
    calibration : path-like, optional
        Log of the same sensor at rest in three or more tilted poses, untouched: bias and weight of the tool are
        identified from it and taken out. It needs no reference.
    progress : Progress, optional
        Told how it goes.

    Raises
    ------
    FileError
        A file is missing or damaged.
    InputError
        A log cannot be used, or logs do not go together.
    FitError
        A solver gave up.
    """
    settings, layout, progress = settings or FitSettings(), layout or Layout(), progress or Progress()
    settings.check()
    paths = [Path(file) for file in files]
    if not paths:
        raise InputError("no log was given; pass a file, or --example for the one that comes along.")
    logs = []
    for path in paths:
        progress.stage(f"reading {path.name}")
        try:
            logs.append(recordings.read(path, layout, stamps=stamps, repair=repair))
        except InputError as error:
            raise InputError(f"{error} {SHARED}" if logs else str(error)) from error
    inputs = tuple(Input(str(path), digest(path)) for path in paths)
    _refuse_twice(inputs)
    payload = None
    if calibration is not None:
        progress.stage(f"weighing the tool with {Path(calibration).name}")
        payload = weighed(calibration, layout, stamps=stamps, repair=repair)
    return replace(
        fit_recordings(logs, settings, layout=layout, payload=payload, progress=progress), inputs=inputs
    )


def fit_recordings(
    logs: Sequence[Recording],
    settings: FitSettings | None = None,
    *,
    layout: Layout | None = None,
    payload: Payload | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Fit gains to recordings that are at hand; see :func:`fit_logs`.

    Parameters
    ----------
    logs : sequence of Recording
    settings : FitSettings, optional
    layout : Layout, optional
        How they were read: with it a wrong frame is told with the options that mend it.
    payload : Payload, optional
        To take out of the wrench.
    progress : Progress, optional
    """
    settings, layout, progress = settings or FitSettings(), layout or Layout(), progress or Progress()
    settings.check()
    _refuse_mixed(logs, settings)
    for log in logs:
        refuse_wrong_clock(log)
        _check(log)
    progress.stage("conditioning and checking")
    used = tuple(conditioned(log, settings, layout=layout, payload=payload) for log in logs)
    inspections = tuple(recordings.inspect(log) for log in used)
    used = tuple(aligned(log, seen.latency, settings) for log, seen in zip(used, inspections, strict=True))
    kept = tuple(in_contact(log, settings.contact) for log in used)
    progress.stage("fitting")
    estimate = _estimate(kept, settings)
    overall = constant_gains(used)
    return Fit(
        settings=settings,
        layout=layout,
        logs=tuple(logs),
        recordings=kept,
        estimate=estimate,
        overall=overall,
        payload=payload,
        inspections=inspections,
        advice=advice(
            logs, used, inspections, estimate, overall, settings=settings, layout=layout, payload=payload
        ),
    )


def constant_gains(used: Sequence[Recording]) -> GainEstimate | None:
    """Constant diagonal gains and biases over all samples in contact: what one number for each axis would be."""
    forces = [np.linalg.norm(recording.wrench[:, :3], axis=1) >= FORCE for recording in used]
    if sum(int(force.sum()) for force in forces) >= LEAST_CONTACT:
        used = [in_contact(r, FORCE) for r, force in zip(used, forces, strict=True) if force.sum() >= 3]
    try:
        return estimation.fit_smooth(used, None, bias=True)
    except (InputError, FitError):
        return None


def digest(path: Path) -> str:
    """SHA-256 of a file, or of all files of a bag's folder in the order of their names.

    Raises
    ------
    FileError
        It cannot be read.
    """
    total = hashlib.sha256()
    try:
        files = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
        for name in files:
            with name.open("rb") as file:
                while block := file.read(1 << 20):
                    total.update(block)
    except (OSError, ValueError) as error:
        raise FileError(f"{path} cannot be opened ({error}); pass the path of a log.") from error
    return total.hexdigest()


def _estimate(used: Sequence[Recording], settings: FitSettings) -> GainEstimate:
    if settings.method == "windows":
        return estimation.fit_windows(
            used[0],
            settings.window,
            structure=settings.structure,
            constraint=settings.chosen_constraint,
            solver=settings.solver,
            step=settings.step,
        )
    knots = "auto" if settings.knots is None else settings.knots
    return estimation.fit_smooth(
        used,
        None if settings.constant else knots,
        structure=settings.structure,
        constraint=settings.chosen_constraint,
        solver=settings.solver,
        robust=settings.robust,
        bias=settings.bias,
        latency=settings.latency,
        attractor=settings.attractor,
    )


def _check(log: Recording) -> None:
    try:
        log.check()
    except InputError as error:
        raise InputError(f"{error} On the command line: --repair.") from error


def _refuse_twice(inputs: Sequence[Input]) -> None:
    seen: dict[str, str] = {}
    for log in inputs:
        if log.sha256 in seen:
            raise InputError(
                f"{log.file} holds the same bytes as {seen[log.sha256]}; twice the same data is not twice the "
                "evidence: leave one out."
            )
        seen[log.sha256] = log.file


def _refuse_mixed(logs: Sequence[Recording], settings: FitSettings) -> None:
    """Logs that are pooled have to hold the same quantities."""
    if not logs:
        raise InputError("no recording was given; pass at least one.")
    if settings.method == "windows" and len(logs) > 1:
        raise InputError(
            f"windows are fitted to one log and {len(logs)} were given; fit them apart, or pool them with "
            "method 'smooth'."
        )
    first = logs[0]
    for log in logs[1:]:
        ours, theirs = _missing(first), _missing(log)
        if ours != theirs:
            raise InputError(
                f"{log.source}: {_listed(theirs)}, and {first.source}: {_listed(ours)}. {SHARED}"
            )


def _missing(log: Recording) -> frozenset[str]:
    """What a log does not have, by its notes."""
    return frozenset(
        note.split(":")[0].split(" in the log")[0] for note in log.notes if note.startswith("no ")
    )


def _listed(missing: frozenset[str]) -> str:
    return ", ".join(sorted(missing)) or "everything is there"
