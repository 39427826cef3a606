"""What one should know about a log before anything is fitted to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import InputError
from vic_toolbox.recordings.frame import FrameCheck, check_frame
from vic_toolbox.recordings.latency import Latency, find_latency
from vic_toolbox.recordings.recording import OPTIONAL, Recording
from vic_toolbox.recordings.validation import AXES, Finding

WORTH_TELLING = 1e-3
"""Latencies below this [s] bias B by less than K · 1 ms."""
UNITS = ("mm", "mm", "mm", "°", "°", "°")
SCALE = np.array([1e3] * 3 + [180 / np.pi] * 3)


@dataclass(frozen=True)
class Inspection:
    """A log in words: see :func:`inspect`."""

    summary: str
    """Samples, duration, rate, what it holds."""
    notes: tuple[str, ...]
    """What was guessed, resampled or repaired."""
    rows: tuple[tuple[str, str, str, str, str], ...]
    """For each axis: name, scatter of error, of its rate, of the wrench, and largest wrench."""
    findings: tuple[Finding, ...]
    """What is wrong, or looks so; the frame and the latency among it."""
    frame: FrameCheck | None
    """None where the recording has errors."""
    latency: Latency | None
    """None where nothing can be said."""


HEAD = ("axis", "error", "rate", "wrench", "largest wrench")


def inspect(recording: Recording) -> Inspection:
    """Summarise a recording, and look for what validation alone does not see: a wrong frame, a late wrench.

    Parameters
    ----------
    recording : Recording

    Returns
    -------
    Inspection
    """
    has = [name for name in OPTIONAL if name != "given_error" and getattr(recording, name) is not None]
    summary = f"{recording.source or 'recording'}: {len(recording)} samples, {recording.duration:.4g} s"
    summary += f", {recording.rate:.4g} Hz" if len(recording) > 1 else ""
    summary += f"; wrench in {recording.wrench_axes} axes" + (f"; {', '.join(has)}" if has else "")
    try:
        recording.check()
    except InputError:
        return Inspection(summary, recording.notes, (), recording.findings, None, None)
    found = list(recording.findings)
    frame = check_frame(recording)
    if frame.suspicious:
        remedy = "Read it with the sensor's frame stated, then look again"
        found.append(Finding("frame", "warning", 0, len(recording), frame.message, remedy))
    latency = _latency(recording) if not frame.suspicious else None
    if latency is not None and latency.certain and abs(latency.seconds) > WORTH_TELLING:
        what = f"the wrench seems {'late' if latency.seconds > 0 else 'early'} by {1e3 * abs(latency.seconds):.1f} ms"
        remedy = "It biases the damping by the stiffness times that; shift_wrench takes it out"
        found.append(Finding("latency", "warning", 0, len(recording), what, remedy))
    return Inspection(summary, recording.notes, _rows(recording), tuple(found), frame, latency)


def _latency(recording: Recording) -> Latency | None:
    try:
        return find_latency(recording)
    except InputError:
        return None


def _rows(recording: Recording) -> tuple[tuple[str, str, str, str, str], ...]:
    error = recording.error * SCALE
    try:
        rate = recording.error_rate * SCALE
    except InputError:
        rate = np.full_like(error, np.nan)
    rows = []
    for i, name in enumerate(AXES):
        unit = "N" if i < 3 else "Nm"
        rows.append((
            f"{name[1]} {'translation' if i < 3 else 'rotation'}",
            f"{error[:, i].std():.3g} {UNITS[i]}",
            f"{rate[:, i].std():.3g} {UNITS[i]}/s",
            f"{recording.wrench[:, i].std():.3g} {unit}",
            f"{np.abs(recording.wrench[:, i]).max():.3g} {unit}",
        ))  # fmt: skip
    return tuple(rows)
