"""The ``vic`` command: from a line of text to one of the commands, and from an error to one clear line."""

from __future__ import annotations

import inspect
import shlex
import sys
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import tyro
from tyro.conf import FlagCreatePairsOff

import vic_toolbox
from vic_toolbox.cli.commands import COMMANDS, Command
from vic_toolbox.cli.console import complain, say
from vic_toolbox.cli.learning import Train, Transfer
from vic_toolbox.errors import InputError, VicError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command line; returns the exit code: 0, 2 for bad input, 130 after Ctrl-C."""
    line = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in line
    line = [word for word in line if word != "--debug"]
    warnings.showwarning = _show_warning
    try:
        return _dispatch(line)
    except VicError as error:
        if debug:
            raise
        complain(f"vic: error: {error}")
    except ModuleNotFoundError as error:
        if debug or (error.name or "").startswith("vic_toolbox"):
            raise
        complain(f"vic: error: {error}; install it with: pip install 'vic-toolbox[learn]'")
    except KeyboardInterrupt:
        complain(f"\nvic: stopped.{_how_to_go_on(line)}")
        return 130
    return 2


def _dispatch(line: list[str]) -> int:
    if not line or line[0] in ("-h", "--help"):
        _print_help()
        return 0
    if line[0] == "--version":
        say(f"vic_toolbox {vic_toolbox.__version__}")
        return 0
    if line[0] not in COMMANDS:
        raise InputError(f"{line[0]!r} is no command; choose one of: {', '.join(COMMANDS)}. See vic --help.")
    try:
        _parse(line[0], line[1:]).run()
    except SystemExit as end:  # tyro has printed its help, or what is wrong with the options
        return int(end.code or 0)
    return 0


def _parse(name: str, words: list[str]) -> Command:
    options: dict[str, Any] = {"args": words, "prog": f"vic {name}", "config": (FlagCreatePairsOff,)}
    kind = COMMANDS[name]
    if parts := getattr(kind, "parts", None):
        return tyro.extras.subcommand_cli_from_dict(parts, description=inspect.getdoc(kind), **options)
    if kind not in (Train, Transfer):
        return tyro.cli(kind, **options)
    if words == ["--help-all"]:
        raise InputError(f"--help-all lists the settings of one task; name it: {_LISTS_ALL[kind]}")
    command, rest = tyro.cli(kind, **options, return_unknown_args=True)
    if any(word.startswith("-") and "." not in word and word != "--help-all" for word in rest):
        return tyro.cli(kind, **options)  # ends with what is wrong
    return replace(command, hyper_parameters=tuple(rest))


_LISTS_ALL = {
    Train: "vic train cup-on-plate --help-all",
    Transfer: "vic transfer RUN --scenario NAME --help-all",
}


def _print_help() -> None:
    say("usage: vic COMMAND [options]\n")
    say("Variable impedance control: learn it from demonstrations, carry it over.\n")
    for name, command in COMMANDS.items():
        say(f"  {name:<10} {(command.__doc__ or '').splitlines()[0]}")
    say(
        "\n  vic COMMAND --help   options of a command, with an example"
        "\n  vic --version        the version"
        "\n  --debug              with any command: show the traceback of an error"
        "\n\nBegin with: vic demo"
    )


def _how_to_go_on(line: list[str]) -> str:
    if line and (line[0] in ("train", "transfer") or line[:2] == ["study", "run"]):
        line = line if "--resume" in line else [*line, "--resume"]
    elif not line or line[0] != "demo":
        return ""
    return f" Go on with: vic {shlex.join(line)}"


def _show_warning(message: Warning | str, *_: Any, **__: Any) -> None:
    complain(f"vic: warning: {message}")
