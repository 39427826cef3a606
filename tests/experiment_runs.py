"""Tiny runs that the tests of experiments and of the command line share."""

from __future__ import annotations

import atexit
import contextlib
import functools
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest import mock

from vic_toolbox.experiments import run_report
from vic_toolbox.experiments.configuration import (
    DemonstrationConfiguration,
    RunConfiguration,
    default_configuration,
)
from vic_toolbox.experiments.training import train
from vic_toolbox.experiments.transfer import transfer


def tiny(
    method: str = "airl", *, task: str = "cup-on-plate", iterations: int = 2, **options: Any
) -> RunConfiguration:
    """A run of seconds: two simulations, a few iterations, four demonstrations."""
    run = default_configuration(
        task,
        method,
        episodes=2,
        demonstrations=DemonstrationConfiguration.for_task(task, count=3, held_out=1),
        **options,
    )
    airl, carried = run.recipe.airl, run.recipe.transfer
    return replace(
        run,
        recipe=replace(
            run.recipe,
            airl=replace(
                airl,
                iterations=iterations,
                search=replace(airl.search, environments=2),
                discriminator=replace(airl.discriminator, steps=2, batch=64),
            ),
            transfer=replace(carried, iterations=2, search=replace(carried.search, environments=2)),
            cloning=replace(run.recipe.cloning, steps=20, check_every=10),
        ),
    )


@functools.cache
def folder() -> Path:
    """Where the shared runs live until the tests end."""
    path = Path(tempfile.mkdtemp(prefix="vic-runs-"))
    atexit.register(shutil.rmtree, path, ignore_errors=True)
    return path


_draw = run_report._figures


@contextlib.contextmanager
def figures(*, drawn: bool) -> Iterator[None]:
    """Reports with or without their figures, which take most of a tiny run's time."""
    with mock.patch.object(run_report, "_figures", _draw if drawn else lambda *_: []):
        yield


@functools.cache
def finished(method: str, task: str = "cup-on-plate") -> Path:
    """A finished run, AIRL's with figures; read it, do not change it (see :func:`copy`)."""
    path = folder() / task / method
    with figures(drawn=method == "airl"):
        train(tiny(method, task=task), path, threads=1)
    return path


@functools.cache
def transferred() -> Path:
    """A finished transfer of the AIRL run to T1."""
    path = folder() / "airl-T1"
    with figures(drawn=True):
        transfer(finished("airl"), "T1", path, episodes=2, threads=1)
    return path


def copy(run: Path, to: Path) -> Path:
    """A copy of a run that a test may damage."""
    return Path(shutil.copytree(run, to))
