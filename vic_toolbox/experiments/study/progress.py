"""What a running study tells its user."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)

from vic_toolbox.experiments.study.timing import duration


@dataclass(frozen=True)
class State:
    """How far a study is: numbers of cells, and the time left [s]."""

    total: int
    done: int
    running: int
    failed: int
    blocked: int
    left: float

    @property
    def text(self) -> str:
        """In words."""
        parts = [f"{self.running} running"]
        parts += [f"{self.failed} failed"] if self.failed else []
        parts += [f"{self.blocked} not run"] if self.blocked else []
        parts += [f"about {duration(self.left)} left"] if self.left else []
        return ", ".join(parts)


class StudyProgress:
    """Says nothing; the base of the kind that does."""

    def update(self, state: State) -> None:
        """Report how far the study is."""

    def say(self, text: str) -> None:
        """Tell something that stays on the screen."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass


class ConsoleStudyProgress(StudyProgress):
    """A bar over all cells; without a terminal a line once in a while.

    Parameters
    ----------
    console : Console
        Where to write.
    title : str
        What the bar is called.
    interval : float
        Time between two lines without a terminal [s].
    """

    def __init__(self, console: Console, title: str, *, interval: float = 30.0) -> None:
        self.console = console
        self._title = title
        self._interval = interval
        self._spoke = -interval
        self._bar: Progress | None = None
        if console.is_terminal:
            self._bar = Progress(
                SpinnerColumn(finished_text="[green]✓"),
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=24),
                MofNCompleteColumn(),
                TimeElapsedColumn(),
                TextColumn("[cyan]{task.fields[state]}"),
                console=console,
            )
            self._task = self._bar.add_task(title, total=None, state="")

    def __enter__(self) -> Self:
        if self._bar:
            self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar:
            self._bar.stop()

    def update(self, state: State) -> None:
        """Move the bar, or print a line once in a while and at the end."""
        if self._bar:
            self._bar.update(self._task, completed=state.done, total=state.total, state=state.text)
        elif time.monotonic() - self._spoke >= self._interval or state.done == state.total:
            self._spoke = time.monotonic()
            self.say(f"{self._title}: {state.done}/{state.total} cells, {state.text}")

    def say(self, text: str) -> None:
        """Print above the bar."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)
