"""Kinds of options that several commands have, with what the help calls their values."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, Suppress, arg

TaskName = Positional[Annotated[str, arg(metavar="TASK")]]
Run = Positional[Annotated[Path, arg(metavar="RUN")]]
NewFolder = Annotated[Path | None, arg(metavar="DIR")]
Count = Annotated[int | None, arg(metavar="N")]
Number = Annotated[float | None, arg(metavar="X")]
Name = Annotated[str | None, arg(metavar="NAME")]
Scenario = Annotated[str, arg(metavar="NAME|TEXT")]
MaybeScenario = Annotated[str | None, arg(metavar="NAME|TEXT")]
MaybeFile = Annotated[Path | None, arg(metavar="FILE")]
Folders = Annotated[tuple[Path, ...], arg(metavar="RUN ...")]
Numbers = Annotated[tuple[float, ...], arg(metavar="X ...")]
HyperParameters = Suppress[tuple[str, ...]]
