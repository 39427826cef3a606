"""The loop of every learner: iterate, write down, checkpoint; survive a kill at any moment and stop cleanly
on Ctrl-C.
"""

from __future__ import annotations

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any, Protocol

import torch
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import FileError, VicError
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.run_folder import RunFolder


class Learner(Protocol):
    """What the loop asks of a learner; `Airl` and `Transfer` offer it."""

    iteration: torch.Tensor
    configuration: Any

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""
        ...

    def iterate(self) -> dict[str, float]:
        """One iteration; returns its metrics."""
        ...

    def state(self) -> dict[str, torch.Tensor]:
        """All that the rest of the run depends on."""
        ...

    def load_state(self, state: dict[str, torch.Tensor]) -> None:
        """Go back to a saved state."""
        ...


class DivergenceError(VicError):
    """Learning produced numbers that are not finite."""


def run_to_end(
    learner: Learner,
    folder: RunFolder,
    *,
    progress: Progress,
    mean_score: Callable[[], float],
    every: int = 10,
    seconds: float = math.inf,
) -> bool:
    """Iterate until the learner has finished; takes up a run that was stopped.

    Parameters
    ----------
    learner : Learner
        What learns; it is changed.
    folder : RunFolder
        Where metrics and checkpoints go.
    mean_score : callable
        Returns the score of the present mean policy; asked for every `every` iterations, only to be shown.
    every : int
        Iterations between two checkpoints.
    seconds : float
        Stop early once the run has used up so much time, all its pieces together [s].
    progress : Progress
        Told the iteration and the score.

    Returns
    -------
    bool
        Whether the learner finished (False: time was up).

    Raises
    ------
    KeyboardInterrupt
        Ctrl-C or SIGTERM; the iteration under way was completed and a checkpoint saved.
    FileError
        The folder's checkpoint does not fit this learner.
    DivergenceError
        A metric is not finite.
    """
    saved = folder.load_checkpoint()
    if saved is not None:
        try:
            learner.load_state(saved)
        except (KeyError, RuntimeError) as error:
            raise FileError(
                f"the checkpoint in {folder.path} does not fit this run ({error}); start it anew"
            ) from error
    rows = folder.metrics()
    used = rows[-1]["seconds"] if rows else 0.0
    done = rows[-1]["iteration"] if rows else 0
    score = next((row["mean_score"] for row in reversed(rows) if "mean_score" in row), None)
    with deferred_interrupt() as interrupted:
        while not learner.finished and used < seconds:
            began = time.perf_counter()
            metrics: dict[str, Any] = learner.iterate()
            _check_finite(metrics)
            done = metrics["iteration"]
            checkpoint = done % every == 0 or learner.finished
            if checkpoint or done == 1:
                score = metrics["mean_score"] = mean_score()
            used += time.perf_counter() - began
            folder.append_metrics(metrics | {"seconds": round(used, 3)})
            if checkpoint or used >= seconds:
                folder.save_checkpoint(learner.state(), done)
            ahead = learner.configuration.iterations - int(learner.iteration)
            progress.update(done, total=done + ahead, score=score)
            if interrupted():
                folder.save_checkpoint(learner.state(), done)
                raise KeyboardInterrupt
    return learner.finished


def _check_finite(metrics: dict[str, Any]) -> None:
    for name, value in metrics.items():
        if not math.isfinite(value):
            raise DivergenceError(
                f"learning diverged: {name} is {value} in iteration {metrics['iteration']}; "
                "the last checkpoint is whole. Try a smaller trust region (divergence) or another seed."
            )


@contextlib.contextmanager
def deferred_interrupt() -> Iterator[Callable[[], bool]]:
    """Hold back Ctrl-C and SIGTERM so that a step is never cut in two; a second one acts at once.

    Yields a function that says whether a signal came. Outside the main thread signals stay as they are.
    """
    came: list[int] = []

    def note(signal_number: int, _: FrameType | None) -> None:
        if came:
            raise KeyboardInterrupt
        came.append(signal_number)

    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    caught = [n for n in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(n) not in (signal.SIG_IGN, None)]
    before = {number: signal.signal(number, note) for number in caught}
    try:
        yield lambda: bool(came)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """One thread for the matrix products of learning: they are too small to share, and waiting costs a
    hundredfold.

    The simulation keeps its own threads.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        torch.set_num_threads(threads)
