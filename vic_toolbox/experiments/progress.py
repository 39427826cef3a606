"""What a long computation tells its user while it runs."""

from __future__ import annotations

import time
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars

from vic_toolbox.experiments.wording import short_score_text


class Progress:
    """Says nothing; the base of the kinds that do."""

    def stage(self, title: str, total: int | None = None, *, expert_score: float | None = None) -> None:
        """Begin a stage of `total` steps; it ends the one before."""

    def update(self, done: int, *, total: int | None = None, score: float | None = None) -> None:
        """Report the stage's steps done so far, and the latest score."""

    def say(self, text: str) -> None:
        """Tell something that stays on the screen."""

    def close(self, *, finished: bool = True) -> None:
        """End the last stage, which may have broken off."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.close(finished=kind is None)


class ConsoleProgress(Progress):
    """A bar for each stage with score, the expert's score and time left; without a terminal a line every few
    seconds.

    Parameters
    ----------
    console : Console
        Where to write.
    interval : float
        Time between two lines without a terminal [s].
    """

    def __init__(self, console: Console, *, interval: float = 5.0):
        self.console = console
        self._bars = _bars(console) if console.is_terminal else None
        if self._bars:
            self._bars.start()
        self._bar = None
        self._interval = interval
        self._title, self._total, self._expert = "", 0, ""
        self._done = 0
        self._began = self._spoke = 0.0
        self._done_at_first: int | None = None

    def stage(self, title: str, total: int | None = None, *, expert_score: float | None = None) -> None:
        """Begin a stage; show its bar or its line."""
        self._finish()
        self._title, self._total, self._done, self._done_at_first = title, total or 0, 0, None
        self._expert = "" if expert_score is None else f"expert {short_score_text(expert_score)}"
        self._began = self._spoke = time.monotonic()
        if self._bars:
            self._bar = self._bars.add_task(title, total=total, score=self._expert)
        else:
            self.console.print(f"{title} ...", markup=False, highlight=False)

    def update(self, done: int, *, total: int | None = None, score: float | None = None) -> None:
        """Move the bar, or print a line once in a while."""
        self._done, self._total = done, total or self._total
        if self._done_at_first is None:
            self._done_at_first = done
        told = " / ".join(
            ([] if score is None else [f"score {short_score_text(score)}"])
            + ([self._expert] if self._expert else [])
        )
        if self._bars and self._bar is not None:
            self._bars.update(self._bar, completed=done, total=self._total or None, score=told)
        elif time.monotonic() - self._spoke >= self._interval:
            self._spoke = time.monotonic()
            parts = [f"  {done}/{self._total}", told, self._time_left()]
            self.console.print(", ".join(part for part in parts if part), markup=False, highlight=False)

    def say(self, text: str) -> None:
        """Print above the bars."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def close(self, *, finished: bool = True) -> None:
        """End the last stage, unless it broke off, and the bars."""
        if finished:
            self._finish()
        if self._bars:
            self._bars.stop()

    def _finish(self) -> None:
        if self._bars and self._bar is not None:
            task = self._bars.tasks[self._bar]
            self._bars.update(self._bar, total=task.completed or 1, completed=task.completed or 1)
            self._bars.stop_task(self._bar)
            self._bar = None
        elif self._title and not self._bars:
            self.console.print(
                f"  done in {time.monotonic() - self._began:.0f} s", markup=False, highlight=False
            )
        self._title = ""

    def _time_left(self) -> str:
        fresh = self._done - (self._done_at_first or 0)
        if fresh <= 0:
            return ""
        left = (self._total - self._done) * (time.monotonic() - self._began) / fresh
        return f"about {left:.0f} s left"


def _bars(console: Console) -> Bars:
    return Bars(
        SpinnerColumn(finished_text="[green]✓"),
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TextColumn("[cyan]{task.fields[score]}"),
        TimeElapsedColumn(),
        TextColumn("[dim]left"),
        TimeRemainingColumn(),
        console=console,
        expand=False,
    )
