"""What is taken out of a log before gains are fitted: bias, weight, inertia, delay, and samples that do not matter."""

from __future__ import annotations

import os
from dataclasses import replace

import numpy as np

from vic_toolbox import recordings
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.fit_settings import FitSettings
from vic_toolbox.recordings import Latency, Layout, Payload, Recording
from vic_toolbox.recordings.differentiation import WINDOW


def conditioned(
    log: Recording, settings: FitSettings, *, layout: Layout, payload: Payload | None = None
) -> Recording:
    """The recording in world axes, without bias, weight and inertia, filtered and cut if that is asked for.

    Parameters
    ----------
    log : Recording
    settings : FitSettings
    layout : Layout
        How the sensor is mounted, for a log that is still in its axes.
    payload : Payload, optional
        Bias and weight to take out.
    """
    used = _in_world(log, layout)
    if payload is not None:
        used = recordings.compensate_payload(used, payload)
    if settings.mass or any(settings.inertia):
        used = recordings.compensate_inertia(used, [settings.mass] * 3 + list(settings.inertia))
    if settings.smoothing:
        used = recordings.differentiate(used, window=settings.smoothing)
    return _part(used, settings)


def weighed(
    calibration: str | os.PathLike[str], layout: Layout, *, stamps: str = "header", repair: bool = False
) -> Payload:
    """Bias of the sensor and weight of the tool from a log of poses at rest; it needs no reference."""
    columns = {k: v for k, v in layout.columns.items() if not k.startswith("reference_")}
    still = replace(layout, reference="start", columns=columns)
    log = recordings.read(calibration, still, stamps=stamps, repair=repair)
    try:
        return recordings.identify_payload(_in_world(log, layout))
    except InputError as error:
        raise InputError(f"{calibration}: {error}") from error


def in_contact(recording: Recording, force: float) -> Recording:
    """The samples with at least this much force [N]; rates are taken before, across the gaps that this leaves.

    Raises
    ------
    InputError
        There are fewer than three.
    """
    if not force:
        return recording
    keep = np.linalg.norm(recording.wrench[:, :3], axis=1) >= force
    if keep.sum() < 3:
        raise InputError(
            f"{recording.source or 'the recording'}: {keep.sum()} of {len(recording)} samples have {force:g} N or "
            "more; lower --contact. Was there any contact?"
        )
    return _with_rates(recording).rows(keep).noted(f"kept {keep.sum()} samples with {force:g} N or more")


def aligned(recording: Recording, latency: Latency | None, settings: FitSettings) -> Recording:
    """Windows have no latency of their own: where it is certain, the recording is shifted by it."""
    if settings.method != "windows" or not settings.latency:
        return recording
    if latency is None or not latency.certain:
        raise InputError(
            "the latency cannot be told from this log (no clear minimum within 50 ms); leave --latency out."
        )
    return recordings.shift_wrench(recording, latency.seconds)


def _in_world(log: Recording, layout: Layout) -> Recording:
    if log.wrench_axes == "world":
        return log
    return recordings.wrench_to_world(log, rotation=layout.sensor_rotation, offset=layout.sensor_offset)


def _part(recording: Recording, settings: FitSettings) -> Recording:
    """The part of a log that is fitted; its rates are taken before, where there is more to take them from."""
    if settings.between is None:
        return recording
    start, stop = (recording.time[0] + t for t in settings.between)
    return _with_rates(recording).between(start, stop)


def _with_rates(recording: Recording) -> Recording:
    if recording.twist is not None:
        return recording
    return recordings.differentiate(recording, window=WINDOW, smooth=False)
