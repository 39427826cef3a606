"""A fit as demonstrations of a task: the recorded motions, labelled with the gains that were found."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from vic_toolbox import tasks
from vic_toolbox.experiments.conditioning import conditioned
from vic_toolbox.experiments.fitting import Fit
from vic_toolbox.recordings import Recording
from vic_toolbox.tasks.recorded import Labelled, clipping, label

FILE = "demonstrations.npz"
"""In the folder of a fit."""


def fit_demonstrations(fit: Fit, task: tasks.Task) -> tuple[tasks.Demonstrations, list[str]]:
    """Demonstrations of a task from all of the motion that a fit saw, and what to know about them.

    Where only a part of each log was fitted (``between``), its last gains are held to the log's end. An axis that the
    data do not determine at some time takes its gain from the nearest time before at which they do.

    Parameters
    ----------
    fit : Fit
    task : Task
        With gain actions; a training run with force actions converts them.

    Returns
    -------
    Demonstrations, list of str
        The second: what was clipped, held or is missing, with what follows from it.

    Raises
    ------
    InputError
        An axis is never determined, or the motions are shorter than a step or of another kind than the task's.
    """
    motions = [_whole(fit, log) for log in fit.logs]
    found = label(motions, fit.estimate, task=task, fallback="others", hold=True)
    return tasks.Demonstrations.of(found, task), _remarks(found, task)


def next_step(task: str, folder: Path, remarks: Sequence[str]) -> tuple[str, str]:
    """What to type next: (command, what it does)."""
    method = " --method bc" if any("--method bc" in remark for remark in remarks) else ""
    file = shlex.quote(str(folder / FILE))
    return f"vic train {task}{method} --demonstrations {file}", "A skill learned from these demonstrations."


def _whole(fit: Fit, log: Recording) -> Recording:
    """A log as it was fitted, to its end; the clock of a pooled estimate starts where the fitted part does."""
    between = fit.settings.between
    settings = fit.settings if between is None else replace(fit.settings, between=(between[0], log.duration))
    return conditioned(log, settings, layout=fit.layout, payload=fit.payload)


def _remarks(found: Labelled, task: tasks.Task) -> list[str]:
    count, steps = found.actions.shape[:2]
    remarks = [told] if (told := clipping(found, task)) else []
    if found.borrowed.any():
        share = f"{100 * found.borrowed.mean():.0f} %"
        remarks.append(
            f"{share} of the gains are not determined where they are needed, or lie outside what was fitted: there the "
            "gains of the nearest time before stand in."
        )
    if count == 1:
        remarks.append("One trajectory is too few to learn from; pass several logs: one or more only judge.")
    if steps < task.horizon:
        remarks.append(
            f"The trajectories have {steps} steps and an episode of {task.name} has {task.horizon}: AIRL compares "
            "whole episodes; clone them (--method bc), or record for longer."
        )
    return remarks
