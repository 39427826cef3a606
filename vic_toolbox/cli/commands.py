"""The commands of ``vic`` by name: dataclasses whose fields are the options and whose docstrings are the help.

Heavy imports happen when a command runs, so that help is quick. A new command is a class with ``run``, and a line here.
"""

from __future__ import annotations

from typing import ClassVar, Protocol

from vic_toolbox.cli.fit import Fit
from vic_toolbox.cli.learning import Demo, Train, Transfer
from vic_toolbox.cli.looking import Evaluate, Play, Robots, Tasks
from vic_toolbox.cli.recording import Recording
from vic_toolbox.cli.stability import Stability
from vic_toolbox.cli.study import Study
from vic_toolbox.cli.twin import Twin


class Command(Protocol):
    """What every command offers."""

    def run(self) -> None:
        """Do it."""
        ...


class Group(Protocol):
    """A command with commands of its own."""

    parts: ClassVar[dict[str, type]]


COMMANDS: dict[str, type[Command] | type[Group]] = {
    "demo": Demo,
    "train": Train,
    "transfer": Transfer,
    "evaluate": Evaluate,
    "play": Play,
    "recording": Recording,
    "fit": Fit,
    "stability": Stability,
    "twin": Twin,
    "study": Study,
    "robots": Robots,
    "tasks": Tasks,
}
