"""How reports show each task: its own figures, its captions, and the line along which its reward is cut.

A task without an entry in :data:`VIEWS` gets the figures and words that fit every task.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import insertion, placing, style
from vic_toolbox.experiments.figures.motion import Traces
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.cup_on_plate import FAR, NEAR

Scenes = Mapping[str, Traces]
"""Traces by scenario and look; every scenario has an "expert"."""


@dataclass(frozen=True)
class Drawing:
    """A figure that is not saved yet: name of its file, title, the sentence that says what to see, content."""

    file: str
    title: str
    caption: str
    figure: Figure


def _as_it_is(_: Task, s: np.ndarray) -> np.ndarray:
    return s


@dataclass(frozen=True)
class Knob:
    """A line through the actions that changes all of them together: s · direction, for s from `low` to `high`.

    Without a direction of its own it is the expert's action: s = 1 is what he does, −1 its mirror image about the
    middle of the range.
    """

    title: str
    caption: str
    direction: tuple[float, ...] | None = None
    low: float = -1.0
    high: float = 1.0
    unit: Callable[[Task, np.ndarray], np.ndarray] = _as_it_is
    """What the axis shows at s."""


@dataclass(frozen=True)
class TaskView:
    """What is special about the reports of one task."""

    gains: str
    """Caption of the gains over time."""
    wrench: str
    """Caption of the wrench over time."""
    knob: Knob
    """How the reward of gain actions is cut."""
    figures: Callable[[Scenes], Sequence[Drawing]] = lambda _: ()
    """The task's own figures."""
    scenery: Callable[[Any, str, Trace, np.ndarray], None] | None = None
    """Draws what stands around into 3-D axes, given a look, its trace and the skeleton (T, n, 3)."""
    detail: str = ""
    """What the picture from close by shows, if the task's scene has one."""
    zones: tuple[float, ...] = ()
    """Distances at which the expert changes over [m]."""


def view(task: Task) -> TaskView:
    """The view of a task."""
    return VIEWS.get(task.name, ANY_TASK)


def knob(task: Task) -> Knob:
    """The line along which a reward on this task's actions is cut."""
    return _WRENCH if task.action == "force" else view(task).knob


def plain_scenery(axes: Any, name: str, trace: Trace, skeleton: np.ndarray) -> None:
    """The path and axes to scale around everything that moves."""
    x, y, z = trace.path.T
    style.line(axes, x, y, name, zs=z)
    points = np.concatenate([trace.path, skeleton.reshape(-1, 3)])
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.1 * float((high - low).max())
    axes.set(**{f"{axis}lim": (low[i] - room, high[i] + room) for i, axis in enumerate("xyz")})
    axes.set_box_aspect(high - low + 2.0 * room)


_MIRROR = Knob(
    "from the expert's gains (1) to their mirror image (−1)",
    "The learned reward at states along the expert's path, along a line of actions on which all gains change together: "
    "1 is the expert's action, 0 the middle of every range, −1 the expert's mirror image about it. Pale is what the "
    "reward prefers; where the pale ridge follows the dashed line, it has learned what the expert does.",
)

_WRENCH = Knob(
    "multiple of the expert's wrench",
    "The learned reward at states along the expert's path, for multiples of the expert's whole wrench: 1 is the "
    "expert's own. Pale is what the reward prefers; where the pale ridge follows the dashed line, it has learned what "
    "the expert does.",
    low=0.0,
    high=2.0,
)

ANY_TASK = TaskView(
    gains="Gains over one episode. The broad pale band is the expert.",
    wrench="The wrench that the policy sets, over one episode; the broad pale band is the expert's.",
    knob=_MIRROR,
)
"""For tasks that have no view of their own."""


def _placing(scenes: Scenes) -> list[Drawing]:
    where, traces = list(scenes.items())[-1]
    return [
        Drawing(
            "paths",
            "Paths in space",
            "Left: the path of the cup's bottom from its start to the plate. Right: how far each policy is from "
            "where the expert is at the same moment.",
            placing.paths(scenes),
        ),
        Drawing(
            "forces",
            "Forces" + (f", {where}" if len(scenes) > 1 else ""),
            "Force that drives the arm, speed of the cup, and the force on it when it touches the plate.",
            placing.forces_over_time(traces),
        ),
    ]


def _inserting(scenes: Scenes) -> list[Drawing]:
    return [
        Drawing(
            "insertion" if len(scenes) == 1 else f"insertion-{i + 1}",
            "Insertion" + (f", {where}" if len(scenes) > 1 else ""),
            "Left: the path of the centre of the peg's tip, seen along y. Grey is where an upright peg's tip cannot "
            "be, the hole's profile drawn narrower by the peg's radius. The tip slides in between the 45° chamfers, or "
            "sticks on the surface beside them. Right: its distance from the hole's axis, the peg's tilt, its way to "
            "go, and the force of the block on it, over time.",
            insertion.insertion(traces),
        )
        for i, (where, traces) in enumerate(scenes.items())
    ]


def _mean_stiffness(task: Task, s: np.ndarray) -> np.ndarray:
    """Mean translational stiffness [N/m] of an action s everywhere."""
    low, high = task.gains.minimum[:3].mean(), task.gains.maximum[:3].mean()
    return low + (high - low) * (s + 1.0) / 2.0


VIEWS: Mapping[str, TaskView] = MappingProxyType({
    "cup-on-plate": TaskView(
        gains=(
            "Stiffness and damping over one episode. The broad pale band is the expert: stiff and lightly "
            "damped while far from the goal, soft and well damped near it. Dotted lines mark the distances at "
            "which he changes over."
        ),
        wrench=(
            "The wrench that the policy sets, over one episode; the broad pale band is the expert's. Dotted lines mark "
            "the distances at which he changes over."
        ),
        knob=Knob(
            "all stiffnesses together, against the damping  [N/m]",
            "The learned reward at states along the expert's path, along the line of actions from soft and well damped "
            "(bottom) to stiff and lightly damped (top): all stiffnesses change together, and the damping factor "
            "against them. Pale is what the reward prefers; where the pale ridge follows the dashed line, it has "
            "learned what the expert does.",
            direction=(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0),
            unit=_mean_stiffness,
        ),
        figures=_placing,
        scenery=placing.scenery,
        zones=(NEAR, FAR),
    ),
    "peg-in-hole": TaskView(
        gains=(
            "Stiffness at the peg's centre of mass over one episode; the damping is fixed. The broad pale band is the "
            "expert, whose tip is stiff: as the peg turns upright, its gains along x and y follow the lever to the tip."
        ),
        wrench="The wrench at the peg's centre of mass, over one episode; the broad pale band is the expert's.",
        knob=_MIRROR,
        figures=_inserting,
        scenery=insertion.scenery,
        detail="The small picture is the edge of the hole; its marks are a millimetre apart.",
    ),
})  # fmt: skip
"""By name of the task."""
