"""What a study consists of: read from a TOML file, checked completely before any work starts."""

from __future__ import annotations

import importlib.resources
import os
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Literal

from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError, VicError, finite_number, integer, one_of
from vic_toolbox.experiments.configuration import ACTIONS, METHODS
from vic_toolbox.experiments.difficulty import offered_sweeps, sweep_axis
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.experiments.study.strict import check_distinct, check_known, read

CONTROLS = ("no-transfer", "random", "fresh", "fresh-random", "untrained", "expert", "middle", "matched")
TWIN_CONTROLS = ("no-transfer", "random", "untrained", "human", "true-gains")
METRICS = ("success", "difference", "deviation", "final deviation")
TWIN_METRICS = METRICS[2:]
"""Of policies on the digital twin, see :mod:`~vic_toolbox.experiments.study.twin_table`."""

_LARGEST_FILE = 1_000_000  # bytes


@dataclass(frozen=True, kw_only=True)
class Budget:
    """What every method may spend on a task; an absent number is the recipe's."""

    episodes: int = 20
    """Episodes behind a number, each from a varied start; the same starts for every policy."""
    sweep_episodes: int = 50
    """Episodes at each value of a sweep."""
    demonstrations: int = 50
    """Trajectories of the expert to learn from."""
    held_out: int = 10
    """Further trajectories that only judge the learning."""
    environments: int | None = None
    """Episodes of a batch."""
    iterations: int | None = None
    """Iterations of AIRL, the same in both action spaces."""
    cloning_steps: int | None = None
    """Minibatch steps of cloning."""
    transfer_iterations: int | None = None
    """Iterations of a transfer that continues."""
    fresh_iterations: int | None = None
    """Iterations of a transfer from random weights, which has farther to go."""
    fresh_divergence: float | None = None
    """First trust region of a transfer from random weights [nats]."""

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if value is None:
                continue
            if entry.name == "fresh_divergence":
                finite_number(entry.name, value, low=1e-9, high=10.0)
            else:
                integer(entry.name, value, low=1)


@dataclass(frozen=True, kw_only=True)
class Table:
    """One table: rows are methods and controls, columns are scenarios."""

    name: str
    """Its number, e.g. "I"."""
    title: str
    """What it shows."""
    task: str
    """Name of the task."""
    metric: Literal["success", "difference", "deviation", "final deviation"]
    """Share of successes, relative difference of the score to the expert's, or on the digital twin the deviation from
    the human's path, mean or at the end [mm]."""
    scenarios: tuple[str, ...]
    """Columns in their order; the training scenario, "train", among them."""
    methods: tuple[str, ...] = METHODS
    """Of "airl", "bc", "constant"."""
    actions: tuple[str, ...] = ACTIONS
    """Of "gain", "force"."""
    histories: tuple[int, ...] = (1,)
    """Numbers of observations that policies see; each makes rows of its own."""
    controls: tuple[str, ...] = ()
    """Of :data:`CONTROLS`; those of fresh policies are only made for gains and one observation, they cost most. Of
    :data:`TWIN_CONTROLS` on the digital twin."""
    session: SessionSettings | None = None
    """What is recorded on the digital twin, to learn from; of tables of deviations alone."""
    halved_step: tuple[str, ...] = ()
    """Scenarios on which every method is judged once more with half the physics time step."""
    sweeps: tuple[str, ...] = ()
    """Quantities along which the policies of one observation are judged, not transferred."""
    paper: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    """The published numbers by row, one for each scenario: shares, relative differences or mm. (Of deviations those of
    the last scenarios may be missing: the paper's policy failed there.)"""

    def __post_init__(self) -> None:
        for name in ("name", "title"):
            if not getattr(self, name).strip():
                raise InputError(f"{name} is empty; give the table one.")
        task = tasks.make(one_of("task", self.task, tasks.TASKS))
        one_of("metric", self.metric, METRICS)
        controls = TWIN_CONTROLS if self.on_twin else CONTROLS
        for name, known in (("methods", METHODS), ("actions", ACTIONS), ("controls", controls)):
            for value in getattr(self, name):
                check_known(name, value, known)
        for name in ("methods", "actions", "histories", "scenarios", "controls", "halved_step", "sweeps"):
            check_distinct(name, getattr(self, name), empty=name in ("controls", "halved_step", "sweeps"))
        for history in self.histories:
            integer("histories", history, low=1, high=100)
        self._check_scenarios(task)
        for quantity in self.sweeps:
            if quantity not in offered_sweeps(task):
                sweep_axis(task, quantity)  # says what there is
        for control in self.controls:
            if control in ("middle", "matched") and control not in task.constants:
                raise InputError(f"controls: {task.title} has no constant gain {control!r}; leave it out.")
        for row, numbers in self.paper.items():
            if len(numbers) > len(self.scenarios) or (
                len(numbers) < len(self.scenarios) and not self.on_twin
            ):
                raise InputError(
                    f"paper.{row} has {len(numbers)} numbers; give one for each of the {len(self.scenarios)} "
                    "scenarios."
                )
            for number in numbers:
                finite_number(f"paper.{row}", number, low=0.0)
        if self.on_twin:
            self._check_twin()
        elif self.session is not None:
            raise InputError("session is of tables of deviations on the digital twin; leave it out.")

    @property
    def on_twin(self) -> bool:
        """Whether its policies run on the digital twin."""
        return self.metric in TWIN_METRICS

    def _check_twin(self) -> None:
        if self.task != "cup-on-plate":
            raise InputError(f"the digital twin does Cup-on-Plate; task is {self.task!r}.")
        if self.session is None:
            raise InputError(
                "session is missing; add what is recorded on the twin, e.g. session = {count = 30}."
            )
        for name in ("halved_step", "sweeps"):
            if getattr(self, name):
                raise InputError(f"{name} is not made on the digital twin; leave it out.")

    def _check_scenarios(self, task: tasks.Task) -> None:
        if "train" not in self.scenarios:
            raise InputError('scenarios lacks "train"; the training scenario belongs into every table.')
        for scenario in self.scenarios:
            try:
                name = task.as_scenario(scenario).name
            except VicError as error:
                raise InputError(f"scenarios: {error}") from error
            if name != scenario:
                raise InputError(f"scenarios has {scenario!r}; write it as {name!r}, as tables call it.")
        for scenario in self.halved_step:
            check_known("halved_step", scenario, self.scenarios)


@dataclass(frozen=True, kw_only=True)
class Study:
    """The whole study."""

    name: str
    """One word, which files are called by."""
    title: str
    """What the report is called."""
    seeds: tuple[int, ...]
    """Every learned policy is made once from each."""
    table: tuple[Table, ...]
    """The tables."""
    budget: Mapping[str, Budget] = field(default_factory=dict)
    """By task."""

    def __post_init__(self) -> None:
        if not self.name or not all(char.isalnum() or char in "-_" for char in self.name):
            raise InputError(f"name is {self.name!r}; use letters, digits, '-' and '_'.")
        if not self.title.strip():
            raise InputError("title is empty; give the study one.")
        check_distinct("seeds", self.seeds)
        for seed in self.seeds:
            integer("seeds", seed, low=0, high=2**31 - 1)
        check_distinct("table names", [table.name for table in self.table])
        for task in self.budget:
            check_known("budget", task, tasks.TASKS)

    def budget_of(self, task: str) -> Budget:
        """What every method may spend on a task."""
        return self.budget.get(task, Budget())

    def with_seeds(self, seeds: Iterable[int]) -> Study:
        """The same study over other seeds.

        Raises
        ------
        InputError
            None, the same one twice, or one out of range.
        """
        return replace(self, seeds=tuple(seeds))

    def to_json(self) -> dict[str, Any]:
        """The definition as JSON values, every default written out; :func:`parse` reads it back."""
        return asdict(self)


def load(file: str | os.PathLike[str]) -> Study:
    """Read a study from a TOML file, or one that comes with the package by its name.

    Raises
    ------
    FileError
        The file is missing or is not TOML.
    InputError
        An unknown key (the nearest known one is named), a missing one, or a value that makes no sense.
    """
    path = Path(file)
    if not path.suffix and not path.exists() and str(file) in shipped():
        path = _home() / f"{file}.toml"
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(
            f"{path} cannot be read ({error}); pass a study's TOML file, or one of: {', '.join(shipped())}."
        ) from error
    if len(content) > _LARGEST_FILE:
        raise FileError(f"{path} has {len(content)} bytes; a study's file has at most {_LARGEST_FILE}.")
    try:
        tree = tomllib.loads(content.decode())
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise FileError(
            f"{path} is no TOML file ({error}); see studies/paper.toml for an example."
        ) from error
    return parse(tree, where=str(path))


def shipped() -> tuple[str, ...]:
    """Names of the studies that come with the package."""
    home = _home()
    return tuple(sorted(path.stem for path in home.glob("*.toml"))) if home.is_dir() else ()


def _home() -> Path:
    """Folder of the studies that ship with the package; in a source tree it lies beside it."""
    package = Path(str(importlib.resources.files("vic_toolbox")))
    inside = package / "studies"
    return inside if inside.is_dir() else package.parent / "studies"


def parse(tree: Any, *, where: str) -> Study:
    """The study that nested tables describe; `where` says in errors what they come from.

    Raises
    ------
    InputError
        See :func:`load`.
    """
    return read(Study, tree, where)
