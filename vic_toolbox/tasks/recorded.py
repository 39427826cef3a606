"""Recordings of a real arm with fitted gains, as demonstrations of a task: what cloning and AIRL learn from."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from vic_toolbox.errors import Array, InputError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.recordings import Recording
from vic_toolbox.tasks.task import Task

Estimates = GainEstimate | Sequence[GainEstimate]


def trajectories(
    recordings: Recording | Iterable[Recording],
    estimate: Estimates,
    *,
    task: Task,
    fallback: ImpedanceGains | None = None,
) -> dict[str, Any]:
    """Observations, actions and scores of recorded motions; see ``Demonstrations.from_recordings``.

    Returns
    -------
    dict
        ``observations`` (n, T + 1, observation_size), ``actions`` (n, T, action_size), ``scores`` (n,).
    """
    logs = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not logs:
        raise InputError("no recording was given; pass at least one.")
    estimates = _one_for_each(logs, estimate)
    pooled = isinstance(estimate, GainEstimate) and len(logs) > 1
    clocks = [log.time[0] if pooled else 0.0 for log in logs]  # of the estimate, as the estimators have it
    spans = [_span(*each) for each in zip(logs, estimates, clocks, strict=True)]
    steps = min(task.horizon, *(int((stop - start) / task.dt + 1e-9) for start, stop in spans))
    if steps < 1:
        raise InputError(
            f"the recordings and their gains share less than one step of the task ({task.dt:g} s); pass longer ones."
        )
    times = [start + task.dt * np.arange(steps + 1.0) for start, _ in spans]
    seen = np.stack([_observations(log, t, task.history) for log, t in zip(logs, times, strict=True)])
    if seen.shape[-1] != task.observation_size:
        raise InputError(
            f"{task.name} observes {task.observation_size} numbers and a recording gives (e, de/dt) of the last "
            f"{task.history} steps, {seen.shape[-1]}; recordings cannot stand for this task."
        )
    parameters = np.stack([
        task.gains.closest_parameters(found.to_gains(t[:-1] - clock, fallback=fallback))
        for found, t, clock in zip(estimates, times, clocks, strict=True)
    ])  # fmt: skip
    actions = task.gains_to_action(_clipped(parameters, task), seen[:, :-1])
    return {
        "observations": seen,
        "actions": actions,
        "scores": task.score(np.ascontiguousarray(seen[:, :-1].swapaxes(0, 1))),
    }


def _one_for_each(logs: list[Recording], estimate: Estimates) -> list[GainEstimate]:
    if isinstance(estimate, GainEstimate):
        return [estimate] * len(logs)
    if len(estimate) != len(logs):
        raise InputError(
            f"{len(estimate)} estimates for {len(logs)} recordings; pass one for all, or one for each."
        )
    return list(estimate)


def _span(log: Recording, estimate: GainEstimate, clock: float) -> tuple[float, float]:
    """Times of a recording, on its own clock, at which there is an estimate; one of constant gains is for all."""
    start, stop = float(log.time[0]), float(log.time[-1])
    if len(estimate.time) > 1:
        start, stop = max(start, estimate.time[0] + clock), min(stop, estimate.time[-1] + clock)
    if stop <= start:
        raise InputError(
            f"the gains are for {estimate.time[0]:g} to {estimate.time[-1]:g} s and the recording lasts from "
            f"{log.time[0] - clock:g} to {log.time[-1] - clock:g} s; pass the recordings that they were fitted to."
        )
    return start, stop


def _observations(log: Recording, times: Array, history: int) -> Array:
    """(e, de/dt) at the times, the last `history` of them in a row, oldest first; the first fills it at the start."""
    motion = np.hstack([log.error, log.error_rate])
    now = np.column_stack([np.interp(times, log.time, column) for column in motion.T])
    steps = np.arange(len(times))
    return np.hstack([now[np.maximum(steps - back, 0)] for back in range(history - 1, -1, -1)])


def _clipped(parameters: Array, task: Task) -> Array:
    """Parameters within the task's range; by how much they were not is told as a warning."""
    low, high = task.gains.minimum, task.gains.maximum
    outside = (parameters < low) | (parameters > high)
    if outside.any():
        each = outside.reshape(-1, len(low)).mean(axis=0)
        flat = parameters.reshape(-1, len(low))
        told = [
            f"{name} {flat[:, i].min():.3g} to {flat[:, i].max():.3g} (range {low[i]:g} to {high[i]:g}) in "
            f"{100 * each[i]:.0f} %"
            for i, name in enumerate(task.gains.names)
            if each[i]
        ]
        warnings.warn(
            f"{100 * outside.mean():.0f} % of the fitted gains lie outside the range of {task.name} and were clipped: "
            f"{'; '.join(told)} of the steps.",
            stacklevel=4,
        )
    return np.clip(parameters, low, high)
