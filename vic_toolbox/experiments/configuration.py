"""The complete description of a run: what is written to ``config.json`` and read back from it."""

from __future__ import annotations

import math
import os
import types
import typing
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, Self, TypeVar

from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError, finite_number, integer, one_of
from vic_toolbox.files import file_digest
from vic_toolbox.learning import Recipe, TransferConfiguration, recipe
from vic_toolbox.tasks.vector_environment import MOST_NOISE

METHODS = ("airl", "bc", "constant")
ACTIONS = ("gain", "force")
REWARDS = ("learned", "random")

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class DemonstrationConfiguration:
    """How the expert is recorded; alike for every method of the same seed."""

    push: float
    """Size of the random pushes on the expert [N], so that its data cover more than one path."""
    count: int = 50
    """Trajectories to learn from."""
    held_out: int = 10
    """Further trajectories that only judge the learning."""
    start_noise: float = 1.0
    """Variation of the starts, in units of the task's usual one."""

    def __post_init__(self) -> None:
        integer("demonstrations", self.count, low=1)
        integer("held-out demonstrations", self.held_out, low=1)
        finite_number("push", self.push, low=0.0)
        finite_number("start noise", self.start_noise, low=0.0, high=MOST_NOISE)

    @classmethod
    def for_task(cls, task: str, *, push: float | None = None, **options: Any) -> Self:
        """With the task's own pushes, unless they are given.

        Raises
        ------
        InputError
            Unknown task, or a number out of range.
        """
        return cls(push=tasks.make(task).push if push is None else push, **options)


@dataclass(frozen=True, kw_only=True)
class RecordedDemonstrations:
    """Demonstrations from a file, a human's for example, instead of the task's own expert."""

    file: str
    """Name of the file, without its folder."""
    sha256: str
    """Digest of its content: a run is only taken up again with the same demonstrations."""
    held_out: int
    """Trajectories that only judge the learning: the last ones."""

    def __post_init__(self) -> None:
        integer("held-out demonstrations", self.held_out, low=1)

    @classmethod
    def of(cls, path: str | os.PathLike[str], *, held_out: int | None = None) -> Self:
        """Of a file as it is now; by default every sixth trajectory is held out.

        Raises
        ------
        FileError
            The file is missing, or holds no demonstrations.
        InputError
            No trajectory would be left to learn from.
        """
        count = len(tasks.Demonstrations.load(path))
        if count < 2:
            raise InputError(f"{path} holds one trajectory; pass two or more, one of them only judges.")
        kept = (
            max(1, count // 6) if held_out is None else integer("held-out", held_out, low=1, high=count - 1)
        )
        return cls(file=Path(path).name, sha256=file_digest(path), held_out=kept)


@dataclass(frozen=True)
class RunConfiguration:
    """A training run."""

    task: str
    """Name of the task."""
    method: Literal["airl", "bc", "constant"]
    """AIRL, behaviour cloning, or gains that never change."""
    recipe: Recipe
    """Every hyper-parameter of learning."""
    demonstrations: DemonstrationConfiguration | RecordedDemonstrations
    """How the expert is recorded, or the file that holds what he did."""
    action: Literal["gain", "force"] = "gain"
    """What the policy sets: gains, or the feedback wrench itself."""
    history: int = 1
    """Last observations that the policy sees."""
    seed: int = 0
    """Of demonstrations, weights, exploration and minibatches."""
    episodes: int = 20
    """Episodes of the evaluation."""

    def __post_init__(self) -> None:
        one_of("method", self.method, METHODS)
        one_of("action", self.action, ACTIONS)
        integer("history", self.history, low=1)
        integer("seed", self.seed, low=0, high=2**31 - 1)
        integer("episodes", self.episodes, low=1)
        check_numbers(self.recipe, "recipe")
        if self.method == "constant" and (self.action, self.history) != ("gain", 1):
            raise InputError(
                f"constant gains with action {self.action!r} and history {self.history} make no sense; "
                "use action 'gain' and history 1."
            )
        if self.method == "constant" and isinstance(self.demonstrations, RecordedDemonstrations):
            raise InputError("constant gains learn nothing from demonstrations; leave the file out.")


@dataclass(frozen=True)
class TransferRunConfiguration:
    """A transfer run: a policy optimised under a frozen reward on another scenario."""

    source: RunConfiguration
    """The training run that the reward and the policy come from."""
    source_weights: str
    """Fingerprint of that run's weights."""
    scenario: str
    """Name of the scenario."""
    transfer: TransferConfiguration
    """Every hyper-parameter of the transfer."""
    reward: Literal["learned", "random"] = "learned"
    """The learned reward, or an untrained network as the control."""
    seed: int = 0
    """Of fresh weights, exploration and minibatches."""
    episodes: int = 20
    """Episodes of the evaluation."""

    def __post_init__(self) -> None:
        one_of("reward", self.reward, REWARDS)
        integer("seed", self.seed, low=0, high=2**31 - 1)
        integer("episodes", self.episodes, low=1)
        check_numbers(self.transfer, "transfer")


def default_configuration(
    task: str, method: str, *, action: str = "gain", history: int = 1, **rest: Any
) -> RunConfiguration:
    """A :class:`RunConfiguration` with the task's own recipe and demonstrations.

    Raises
    ------
    InputError
        No recipe for the task, or a value that the configuration refuses.
    """
    one_of("action", action, ACTIONS)
    if "recipe" not in rest:
        rest["recipe"] = recipe(task, action=action, history=history)
    if "demonstrations" not in rest:
        rest["demonstrations"] = DemonstrationConfiguration.for_task(task)
    return RunConfiguration(task=task, method=method, action=action, history=history, **rest)  # type: ignore[arg-type]


def check_numbers(configuration: Any, name: str) -> None:
    """Refuse hyper-parameters that are not finite, or negative where only a logarithm may be.

    Raises
    ------
    InputError
        The field is named by its path, e.g. ``recipe.airl.search.discount``.
    """
    for path, value in flatten(asdict(configuration), name).items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            continue
        if not math.isfinite(value) or (value < 0 and not path.endswith("log_std")):
            raise InputError(f"{path} is {value}; it must be finite and not negative.")
        if value == 0 and path.endswith((".iterations", ".environments", ".batch", ".hidden", ".steps")):
            raise InputError(f"{path} is 0; it must be at least 1.")


def to_json(configuration: RunConfiguration | TransferRunConfiguration) -> dict[str, Any]:
    """The configuration as nested JSON values."""
    return asdict(configuration)


def from_json(cls: type[T], value: Any, *, where: str) -> T:
    """Rebuild a configuration from :func:`to_json`.

    Raises
    ------
    FileError
        A field is missing, unknown or of another type; `where` (the file) and the field are named.
    """
    if not isinstance(value, Mapping):
        raise FileError(f"{where} should be a table; it is {value!r:.60}")
    hints = typing.get_type_hints(cls)
    names = {entry.name for entry in fields(typing.cast(Any, cls))}
    if names != value.keys():
        missing, unknown = sorted(names - value.keys()), sorted(value.keys() - names)
        raise FileError(
            f"{where} lacks {missing or 'nothing'} and has the unknown {unknown or 'nothing'}; "
            "it is of another version of the toolbox: run it anew."
        )
    try:
        return cls(**{name: _read(hints[name], value[name], f"{where}.{name}") for name in names})
    except InputError as error:
        raise FileError(f"{where}: {error}") from error


def _read(hint: Any, value: Any, where: str) -> Any:
    if is_dataclass(hint):
        return from_json(typing.cast(type, hint), value, where=where)
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        tables = [kind for kind in typing.get_args(hint) if is_dataclass(kind)]
        if not tables:
            return value
        keys = set(value) if isinstance(value, Mapping) else set()
        alike = [len(keys & {entry.name for entry in fields(kind)}) for kind in tables]
        return from_json(typing.cast(type, tables[alike.index(max(alike))]), value, where=where)
    wanted = (int, float) if hint is float else hint if isinstance(hint, type) else str
    if not isinstance(value, wanted) or (isinstance(value, bool) and hint is not bool):
        raise FileError(f"{where} is {value!r:.60}; expected {getattr(hint, '__name__', hint)}")
    return value


def flatten(tree: Mapping[str, Any], name: str = "") -> dict[str, Any]:
    """Nested tables as one table with dotted names."""
    flat: dict[str, Any] = {}
    for key, value in tree.items():
        path = f"{name}.{key}" if name else key
        flat |= flatten(value, path) if isinstance(value, Mapping) else {path: value}
    return flat
