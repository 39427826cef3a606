"""Expert demonstrations: recorded with small random pushes, saved and loaded as one file.

An expert without noise visits one thin path, and near its end the wrench is almost zero: nothing tells a
force policy how to come back to it. So somebody pushes a little while the expert works. The motion is
recorded once, with the expert setting gains, and labelled in the action space that is asked for: every method
learns from the same motions.
"""

from __future__ import annotations

import dataclasses
import os
import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vic_toolbox.errors import Array, FileError, InputError, finite_array, finite_number, integer
from vic_toolbox.files import read_arrays, write_arrays
from vic_toolbox.tasks.task import Task
from vic_toolbox.tasks.vector_environment import VectorEnvironment

if TYPE_CHECKING:
    from vic_toolbox.estimation import GainEstimate
    from vic_toolbox.gains import ImpedanceGains
    from vic_toolbox.recordings import Recording
    from vic_toolbox.tasks.recorded import Labelled

PUSH_MEMORY = 0.1
"""Correlation time of the pushes [s]."""

_FORMAT = 2


@dataclass(frozen=True)
class Demonstrations:
    """Trajectories of the expert, all of the same length.

    Attributes
    ----------
    observations : ndarray, shape (n, T + 1, observation_size)
        What a policy would have seen, the last one after the last action.
    actions : ndarray, shape (n, T, action_size)
        The expert's normalised actions at these observations.
    scores : ndarray, shape (n,)
        The task's score of each.
    task, action, scenario : str
        Names of the task, the action space and the scenario.
    history : int
        Observations that one row holds.
    push : float
        Standard deviation of the pushing force along each axis [N].
    start_noise : float
        Variation of the starts, in units of the task's usual one.
    seed : int
    """

    observations: Array
    actions: Array
    scores: Array
    task: str
    action: str
    scenario: str
    history: int
    push: float
    start_noise: float
    seed: int

    def __post_init__(self) -> None:
        observations = finite_array("observations", self.observations, shape=(None, None, None))
        actions = finite_array("actions", self.actions, shape=(None, None, None))
        count, length = actions.shape[:2]
        finite_array("scores", self.scores, shape=(count,))
        if count < 1 or observations.shape[:2] != (count, length + 1):
            raise InputError(
                f"observations {observations.shape} and actions {actions.shape} do not agree; "
                "pass (n, T + 1, ·) and (n, T, ·), n at least 1."
            )

    def __len__(self) -> int:
        return len(self.actions)

    @classmethod
    def from_recordings(
        cls,
        recordings: Recording | Iterable[Recording],
        estimate: GainEstimate | Sequence[GainEstimate] | None,
        *,
        task: Task,
        fallback: ImpedanceGains | Literal["others"] | None = None,
        hold: bool = False,
    ) -> Demonstrations:
        """Demonstrations from recordings of an arm, a human's for example, and the gains that were fitted to them.

        Observations are ``(e, ė)`` of the recordings at the steps of the task, actions what sets K(t), B(t) there.
        Gains that the task's action cannot write are approximated (:meth:`Parametrisation.closest_parameters`), and
        clipped to its range with a warning that says how much. All trajectories are as long as the shortest, at most
        the task's horizon: scores of shorter ones do not compare with those of whole episodes.

        Parameters
        ----------
        recordings : Recording, or iterable of them
            Motions about the task's goal, in world axes: as they were fitted, in the same order. With `hold` they may
            go on for longer than what was fitted.
        estimate : GainEstimate, or one for each recording, or None
            One for several recordings is a pooled one, whose clock starts with each of them. None, for force actions
            only: the action is the measured wrench itself.
        task : Task
            Whose observations, action space and score to use.
        fallback : ImpedanceGains or "others", optional
            For axes and times that the data do not determine: given gains, or, for diagonal estimates, what the
            others have there: the median at the same time, and where none has any, that of the nearest time before.
        hold : bool
            Use the recordings as a whole, with the first and last gains held before and after the estimate's times:
            for motion that goes on when there is nothing to fit any more.

        Raises
        ------
        InputError
            Gains are not determined and there is no fallback, the times do not fit each other, or the task
            observes something else.
        """
        from vic_toolbox.tasks.recorded import clipping, label

        found = label(recordings, estimate, task=task, fallback=fallback, hold=hold)
        if told := clipping(found, task):
            warnings.warn(told, stacklevel=2)
        return cls.of(found, task)

    @classmethod
    def of(cls, found: Labelled, task: Task) -> Demonstrations:
        """Demonstrations of motions that are labelled already, see :func:`vic_toolbox.tasks.recorded.label`."""
        return cls(
            observations=found.observations,
            actions=found.actions,
            scores=found.scores,
            task=task.name,
            action=task.action,
            scenario=task.scenario.name,
            history=task.history,
            push=0.0,
            start_noise=0.0,
            seed=0,
        )

    def converted(self, task: Task) -> Demonstrations:
        """The same motions as policies of this task see and label them: with another history, gains as the wrench.

        Raises
        ------
        InputError
            They are of another task, or hold wrenches where gains are asked for: no wrench tells its gains.
        """
        from vic_toolbox.tasks.recorded import stacked

        if self.task != task.name:
            raise InputError(
                f"the demonstrations are of {self.task}; the task is {task.name}. Record them for it."
            )
        if (self.action, self.history) == (task.action, task.history):
            return self
        if self.action == "force" and task.action == "gain":
            raise InputError(
                "the demonstrations hold wrenches (action 'force') and gains are to be learned; pass demonstrations "
                "with action 'gain'."
            )
        width = task.observation_size // task.history
        observations = stacked(self.observations[..., -width:], task.history)
        actions = self.actions
        if self.action != task.action:
            actions = task.gains_to_action(task.gains.action_to_parameters(actions), observations[:, :-1])
        return dataclasses.replace(
            self, observations=observations, actions=actions, action=task.action, history=task.history
        )

    def split(self, held_out: int) -> tuple[Demonstrations, Demonstrations]:
        """Split off the last ``held_out`` trajectories: (the others, these).

        Raises
        ------
        InputError
            One side would be empty.
        """
        first = len(self) - integer("held_out", held_out, low=1, high=len(self) - 1)
        return self._rows(slice(first)), self._rows(slice(first, None))

    def _rows(self, rows: slice) -> Demonstrations:
        per_trajectory = ("observations", "actions", "scores")
        return dataclasses.replace(self, **{name: getattr(self, name)[rows] for name in per_trajectory})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one compressed ``.npz``; an earlier file stays until this one is whole.

        Raises
        ------
        FileError
            The file cannot be written.
        """
        content: dict[str, Any] = {
            field.name: getattr(self, field.name) for field in dataclasses.fields(self)
        }
        write_arrays(path, {"format": _FORMAT} | content)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Demonstrations:
        """Read what :meth:`save` wrote; nothing in the file is executed.

        Raises
        ------
        FileError
            Missing, damaged, of another format, or its arrays do not fit together.
        """
        wanted = {field.name: field.type for field in dataclasses.fields(cls)}
        content: dict[str, Any] = read_arrays(path, "demonstrations", remedy="record them again")
        if not np.array_equal(content.pop("format", -1), _FORMAT) or content.keys() != wanted.keys():
            raise FileError(f"{path} is not a file of demonstrations of format {_FORMAT}; record them again.")
        scalars: dict[str, Any] = {"str": str, "int": int, "float": float}
        try:
            return cls(**{
                name: scalars[kind](content[name].item()) if kind in scalars else content[name]
                for name, kind in wanted.items()
            })  # fmt: skip
        except ValueError as error:
            raise FileError(f"{path} holds damaged demonstrations ({error}); record them again.") from error


def record(
    task: Task,
    count: int = 50,
    *,
    seed: int = 0,
    push: float | None = None,
    start_noise: float = 1.0,
    threads: int = 1,
) -> Demonstrations:
    """Let the expert do the task ``count`` times from the task's own scenario.

    Parameters
    ----------
    task : Task
        Task and action space; the expert always moves by setting gains, whichever space labels the actions.
    count : int
        Number of trajectories.
    seed : int
        Draws starts and pushes.
    push : float, optional
        Standard deviation of the pushing force along each axis [N], an Ornstein-Uhlenbeck process with a
        memory of 0.1 s; by default the task's own, 0 does not push.
    start_noise : float
        Variation of the starts, in units of the task's usual one.
    threads : int
        Threads of the physics; the numbers do not depend on it.
    """
    count = integer("count", count, low=1)
    push = finite_number("push", task.push if push is None else push, low=0.0)
    seed = integer("seed", seed, low=0)
    guide = task.with_action("gain")
    environment = VectorEnvironment(guide, count, start_noise=start_noise, threads=threads)
    forces = random_push(task.horizon, count, std=push, dt=task.dt, rng=np.random.default_rng([seed, 1]))
    observations = np.empty((task.horizon + 1, count, task.observation_size))
    actions = np.empty((task.horizon, count, task.action_size))
    observations[0], info = environment.reset(seed=seed)
    for t in range(task.horizon):
        environment.set_push(forces[t])
        actions[t] = task.expert_action(observations[t])
        observations[t + 1], _, _, _, info = environment.step(guide.expert_action(observations[t]))
    return Demonstrations(
        observations=np.ascontiguousarray(observations.swapaxes(0, 1)),
        actions=np.ascontiguousarray(actions.swapaxes(0, 1)),
        scores=info["score"],
        task=task.name,
        action=task.action,
        scenario=task.scenario.name,
        history=task.history,
        push=push,
        start_noise=float(start_noise),
        seed=seed,
    )


def random_push(steps: int, count: int, *, std: float, dt: float, rng: np.random.Generator) -> Array:
    """Forces (steps, count, 3) [N] of a stationary Ornstein-Uhlenbeck process, sampled exactly.

    Each axis has standard deviation ``std`` [N] and autocorrelation ``exp(−t/0.1 s)``; ``dt`` [s] is the
    step.
    """
    keep = np.exp(-dt / PUSH_MEMORY)
    forces = std * rng.standard_normal((steps, count, 3))
    for t in range(1, steps):
        forces[t] = keep * forces[t - 1] + np.sqrt(1 - keep**2) * forces[t]
    return forces
