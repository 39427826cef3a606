"""Demonstrations that a run takes from a file: checked before any work starts, as the run's policy would see them."""

from __future__ import annotations

import os
from pathlib import Path

from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.configuration import RecordedDemonstrations, RunConfiguration
from vic_toolbox.files import file_digest

COPY = "demonstrations.npz"
"""What a run learned from, in its folder."""


def given_demonstrations(
    run: RunConfiguration, out: str | os.PathLike[str], file: str | os.PathLike[str] | None
) -> tasks.Demonstrations | None:
    """What a run is to learn from, where it takes it from a file and has no copy of it yet.

    Parameters
    ----------
    run : RunConfiguration
    out : path-like
        The run's folder.
    file : path-like, optional
        The file that the configuration was made of; a run that is taken up again does not need it any more.

    Raises
    ------
    FileError
        The file is missing, damaged, or another one than the configuration says.
    InputError
        It does not suit the task, or is missing where it is needed.
    """
    wanted = run.demonstrations
    if not isinstance(wanted, RecordedDemonstrations):
        if file is not None:
            raise InputError(
                f"{file} was given, and the configuration records the task's own expert; pass "
                "demonstrations=RecordedDemonstrations.of(file) in it."
            )
        return None
    if (Path(out) / COPY).exists():
        return None
    if file is None:
        raise InputError(f"the run learns from {wanted.file}; pass that file.")
    if file_digest(file) != wanted.sha256:
        raise FileError(f"{file} is not the {wanted.file} that this run was configured with; pass that file.")
    return suited(tasks.Demonstrations.load(file), run, where=str(file))


def suited(found: tasks.Demonstrations, run: RunConfiguration, *, where: str) -> tasks.Demonstrations:
    """Demonstrations in the run's action space and history, if the run can learn from them.

    Raises
    ------
    InputError
        Another task, wrenches where gains are wanted, too few trajectories, or, for AIRL, parts of episodes.
    """
    task = tasks.make(run.task, action=run.action, history=run.history)
    if len(found) <= run.demonstrations.held_out:
        raise InputError(
            f"{where} holds {len(found)} trajectories and {run.demonstrations.held_out} are to be held out; "
            "hold out fewer."
        )
    steps = found.actions.shape[1]
    if run.method == "airl" and steps < task.horizon:
        raise InputError(
            f"{where} has trajectories of {steps} steps ({steps * task.dt:g} s) and an episode of {task.name} has "
            f"{task.horizon} ({task.horizon * task.dt:g} s); AIRL compares whole episodes. Record longer ones, or "
            "clone them (method 'bc')."
        )
    try:
        return found.converted(task)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
