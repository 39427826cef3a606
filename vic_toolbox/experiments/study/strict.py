"""Nested tables, as TOML and JSON have them, read into dataclasses without forgiving anything."""

from __future__ import annotations

import difflib
import types
import typing
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Literal, TypeVar

from vic_toolbox.errors import InputError

T = TypeVar("T")


def read(kind: Any, value: Any, where: str) -> Any:
    """The value as an object of a kind: a dataclass, a tuple, a mapping, an optional, or a plain type.

    Raises
    ------
    InputError
        An unknown key (the nearest known one is named), a missing one, a value of another type, or one that the
        dataclass refuses; `where` says in errors where the value is.
    """
    if is_dataclass(kind):
        return _read_table(typing.cast(type, kind), value, where)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else read(inner[0], value, where)
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise InputError(f"{where} is {value!r:.60}; expected a list.")
        return tuple(read(inner[0], entry, _item(inner[0], entry, where, i)) for i, entry in enumerate(value))
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise InputError(f"{where} is {value!r:.60}; expected a table.")
        return {key: read(inner[1], entry, f"{where}.{key}") for key, entry in value.items()}
    if origin is Literal:
        kind = str
    wanted = (int, float) if kind is float else kind
    if not isinstance(value, wanted) or isinstance(value, bool):
        words = {str: "a text", int: "an integer", float: "a number"}
        raise InputError(f"{where} is {value!r:.60}; expected {words[kind]}.")
    return float(value) if kind is float else value


def _item(kind: Any, entry: Any, where: str, index: int) -> str:
    """Where an entry of a list is: tables go by their names."""
    named = is_dataclass(kind) and isinstance(entry, Mapping) and isinstance(entry.get("name"), str)
    return f"{where} {entry['name']!r}" if named else f"{where}[{index}]"


def _read_table(cls: type[T], value: Any, where: str) -> T:
    if not isinstance(value, Mapping):
        raise InputError(f"{where} is {value!r:.60}; expected a table.")
    hints = typing.get_type_hints(cls)
    known = {entry.name: entry for entry in fields(typing.cast(Any, cls))}
    for key in value:
        if key not in known:
            _unknown_key(key, known, where)
    missing = [
        name
        for name, entry in known.items()
        if name not in value and entry.default is MISSING and entry.default_factory is MISSING
    ]
    if missing:
        raise InputError(f"{where} lacks {', '.join(missing)}; add {'it' if len(missing) == 1 else 'them'}.")
    arguments = {name: read(hints[name], entry, f"{where}: {name}") for name, entry in value.items()}
    try:
        return cls(**arguments)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _unknown_key(key: str, known: Iterable[str], where: str) -> typing.NoReturn:
    near = difflib.get_close_matches(key, list(known), 1, 0.5)
    hint = f"did you mean {near[0]!r}?" if near else f"it may have: {', '.join(known)}."
    raise InputError(f"{where} has the unknown key {key!r}; {hint}")


def check_known(name: str, value: str, choices: Iterable[str]) -> None:
    """Like :func:`~vic_toolbox.errors.one_of`, and says which one may be meant."""
    choices = list(choices)
    if value not in choices:
        near = difflib.get_close_matches(value, choices, 1, 0.5)
        remedy = f"did you mean {near[0]!r}? Choose from" if near else "choose from"
        raise InputError(f"{name} has {value!r}; {remedy}: {', '.join(choices)}.")


def check_distinct(name: str, values: Iterable[Any], *, empty: bool = False) -> None:
    """Refuse a value that is there twice, and an empty list unless it may be `empty`."""
    values = list(values)
    if not values and not empty:
        raise InputError(f"{name} is empty; give at least one.")
    for i, value in enumerate(values):
        if value in values[:i]:
            raise InputError(f"{name} has {value!r} twice; give it once.")
