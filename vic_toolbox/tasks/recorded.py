"""Recordings of a real arm with fitted gains, as demonstrations of a task: what cloning and AIRL learn from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vic_toolbox.errors import Array, InputError, one_of
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.gains import AXES, ImpedanceGains
from vic_toolbox.recordings import Recording
from vic_toolbox.tasks.task import Task

Estimates = GainEstimate | Sequence[GainEstimate]
Fallback = ImpedanceGains | Literal["others"] | None

LEAST_DAMPING = 1e-6
"""What a damping that came out negative counts as before the range of the task is looked at [Ns/m, Nms/rad]."""


@dataclass(frozen=True, eq=False)
class Labelled:
    """Recorded motions, labelled with what a policy should have done."""

    observations: Array
    """(n, T + 1, observation_size)"""
    actions: Array
    """(n, T, action_size)"""
    scores: Array
    """(n,)"""
    parameters: Array
    """Fitted gain parameters [SI] before they were clipped to the task's range, (n, T, size); none: (n, T, 0)."""
    borrowed: Array
    """Share of the steps whose K, then B, of each axis comes from other recordings or other times, (12,)."""

    def outside(self, task: Task) -> Array:
        """Share of the steps at which each parameter lies outside the task's range, (size,)."""
        if not self.parameters.shape[-1]:
            return np.zeros(0)
        beyond = (self.parameters < task.gains.minimum) | (self.parameters > task.gains.maximum)
        return beyond.mean(axis=(0, 1))


def label(
    recordings: Recording | Iterable[Recording],
    estimate: Estimates | None,
    *,
    task: Task,
    fallback: Fallback = None,
    hold: bool = False,
) -> Labelled:
    """Observations, actions and scores of recorded motions; see ``Demonstrations.from_recordings``."""
    logs = [recordings] if isinstance(recordings, Recording) else list(recordings)
    if not logs:
        raise InputError("no recording was given; pass at least one.")
    if estimate is None and task.action != "force":
        raise InputError("without an estimate the wrench is the action; pass a task with action 'force'.")
    estimates = [] if estimate is None else _one_for_each(logs, estimate)
    pooled = isinstance(estimate, GainEstimate) and len(logs) > 1
    clocks = [
        float(log.time[0]) if pooled else 0.0 for log in logs
    ]  # of the estimate, as the estimators have it
    if hold or estimate is None:
        spans = [_whole(log) for log in logs]
    else:
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
    seen /= np.tile(task.observation_unit, task.history)
    scores = task.score(np.ascontiguousarray(seen[:, :-1].swapaxes(0, 1)))
    if estimate is None:
        wrenches = np.stack([-_at(log.wrench, log, t[:-1]) for log, t in zip(logs, times, strict=True)])
        actions = task.wrench_to_action(wrenches, seen[:, :-1])
        return Labelled(seen, actions, scores, np.zeros((*actions.shape[:2], 0)), np.zeros(12))
    fitted = [(found, t[:-1] - clock) for found, t, clock in zip(estimates, times, clocks, strict=True)]
    if isinstance(fallback, str):
        one_of("fallback", fallback, ("others",))
        parameters, borrowed = _from_others(fitted, task)
    else:
        parameters, borrowed = _with_spare(fitted, task, fallback)
    clipped = np.clip(parameters, task.gains.minimum, task.gains.maximum)
    return Labelled(seen, task.gains_to_action(clipped, seen[:, :-1]), scores, parameters, borrowed)


def _with_spare(
    fitted: Sequence[tuple[GainEstimate, Array]], task: Task, spare: ImpedanceGains | None
) -> tuple[Array, Array]:
    """Parameters (n, T, size) of each estimate at its times, and how much of them is spare."""
    parameters = [task.gains.closest_parameters(found.to_gains(t, fallback=spare)) for found, t in fitted]
    known = np.stack([_diagonals(found, t) for found, t in fitted])
    return np.stack(parameters), np.isnan(known).mean(axis=(0, 1))


def _from_others(fitted: Sequence[tuple[GainEstimate, Array]], task: Task) -> tuple[Array, Array]:
    """The same with gaps filled by the median of the others at that time; where none knows, of the time before.

    One demonstration's last gain is not held for long on its own: the median of all is a better guess of what follows.
    """
    gains = np.stack([_diagonals(found, t) for found, t in fitted])  # (n, T, 12), NaN where not determined
    missing = np.isnan(gains)
    known: NDArray[np.bool_] = np.any(~missing, axis=0)
    never: NDArray[np.bool_] = np.all(~known, axis=0)
    if never.any():
        names = [f"{gain} along {axis}" for gain in ("stiffness", "damping") for axis in AXES]
        lost = ", ".join(name for name, lacking in zip(names, never.tolist(), strict=True) if lacking)
        raise InputError(f"no recording determines the {lost} at any time; pass gains as fallback.")
    usual = np.nanmedian(np.where(known, gains, 0.0), axis=0)
    for column in range(12):
        at = np.flatnonzero(known[:, column])
        nearest = at[np.clip(np.searchsorted(at, np.arange(len(known)), side="right") - 1, 0, None)]
        usual[:, column] = usual[nearest, column]
    filled = np.where(missing, usual, gains)
    stiffness, damping = filled[..., :6], filled[..., 6:]
    # a free fit may be negative, and gains may not: the range decides, and what it cost is told from the fit itself
    low, high = np.array(task.gains.stiffness_low), np.array(task.gains.stiffness_high)
    positive = ImpedanceGains.diagonal(np.clip(stiffness, low, high), np.maximum(damping, LEAST_DAMPING))
    parameters = task.gains.closest_parameters(positive)
    parameters[..., :6] = stiffness
    return parameters, missing.mean(axis=(0, 1))


def _diagonals(found: GainEstimate, times: Array) -> Array:
    """K and B of the axes, (T, 12), interpolated; NaN where an instant is not determined, or beyond the estimate."""
    columns = []
    for gain in (found.stiffness, found.damping):
        diagonal = np.diagonal(gain, axis1=1, axis2=2)
        if len(found.time) == 1:
            columns.append(np.repeat(diagonal, len(times), axis=0))
            continue
        left = np.clip(np.searchsorted(found.time, times, side="right") - 1, 0, len(found.time) - 2)
        share = np.clip((times - found.time[left]) / np.diff(found.time)[left], 0.0, 1.0)[:, None]
        ends = diagonal[left], diagonal[left + 1]
        # an end that carries no weight need not be known
        columns.append(
            np.where(share == 0, 0.0, share * ends[1]) + np.where(share == 1, 0.0, (1 - share) * ends[0])
        )
    found_at = np.hstack(columns)
    if len(found.time) > 1:
        found_at[(times < found.time[0] - 1e-9) | (times > found.time[-1] + 1e-9)] = np.nan
    return found_at


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


def _whole(log: Recording) -> tuple[float, float]:
    """Times of a recording; its last sample stands for its interval, so that 500 samples at 100 Hz are 5 s."""
    last = float(log.time[-1] - log.time[-2]) if len(log) > 1 else 0.0
    return float(log.time[0]), float(log.time[-1]) + last


def _observations(log: Recording, times: Array, history: int) -> Array:
    """(e, de/dt) at the times, the last `history` of them in a row, oldest first; the first fills it at the start."""
    return stacked(_at(np.hstack([log.error, log.error_rate]), log, times), history)


def stacked(motion: Array, history: int) -> Array:
    """Rows (..., T, m) as rows of the last `history` of them, oldest first, (..., T, m h)."""
    steps = np.arange(motion.shape[-2])
    past = [motion[..., np.maximum(steps - back, 0), :] for back in range(history - 1, -1, -1)]
    return np.concatenate(past, axis=-1)


def _at(values: Array, log: Recording, times: Array) -> Array:
    """Columns of a recording at other times."""
    return np.column_stack([np.interp(times, log.time, column) for column in values.T])


def clipping(found: Labelled, task: Task) -> str:
    """By how much gains were outside the task's range, in words; empty where none was."""
    each, low, high = found.outside(task), task.gains.minimum, task.gains.maximum
    if not each.any():
        return ""
    flat = found.parameters.reshape(-1, len(low))
    told = [
        f"{name} {flat[:, i].min():.3g} to {flat[:, i].max():.3g} (range {low[i]:g} to {high[i]:g}) in "
        f"{100 * each[i]:.0f} %"
        for i, name in enumerate(task.gains.names)
        if each[i]
    ]
    return (
        f"{100 * each.mean():.0f} % of the fitted gains lie outside the range of {task.name} and were clipped: "
        f"{'; '.join(told)} of the steps."
    )
