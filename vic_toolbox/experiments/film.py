"""A short film of several policies side by side, with the stiffness that each of them has at the moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.patches import Rectangle

from vic_toolbox.errors import DependencyError, InputError
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.task_views import plain_scenery, view
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.rendering import DETAIL, Renderer, write_video

FPS = 25
WIDTH, HEIGHT, STRIP = 480, 420, 64  # of one panel, and of the strip below it [pixels]
_INSET, _FRAME = 168, 2  # side of the picture from close by, and width of the frame around it [pixels]
_DPI = 100
_ARRIVED = 0.035  # distance to the goal that counts as none, as a share of the first
_BAR = 0.76  # length of the stiffness bar, as a share of the width

RENDERED = "The simulation at its real speed."
DRAWN = (
    "Drawn, not rendered: this machine has no OpenGL library ({reason}) The lines stand for what moves, at its real "
    "speed."
)
_BAR_LEGEND = " The bar is the mean translational stiffness, from {:.0f} to {:.0f} N/m."


def film(path: Path, traces: Mapping[str, Trace], task: Task) -> str:
    """Write an ``.mp4`` of the traces side by side.

    Without an OpenGL library the moving parts are drawn as lines instead, and the caption says so.

    Parameters
    ----------
    path : Path
        The ``.mp4`` file to write.
    traces : dict of Trace
        What to show, by look, from left to right.
    task : Task
        Task of the traces.

    Returns
    -------
    str
        Caption for the film.

    Raises
    ------
    InputError
        The name does not end in ``.mp4``.
    FileError
        The file cannot be written.
    """
    if path.suffix != ".mp4":
        raise InputError(f"the film's name is {str(path)!r}; it must end in .mp4.")
    step = round(1.0 / (FPS * task.dt))
    gains = any(trace.stiffness.any() for trace in traces.values())
    legend = _BAR_LEGEND.format(*_stiffness_range(task)) if gains else ""
    try:
        renderer = Renderer(task.picture_spec(), width=WIDTH, height=HEIGHT)
    except DependencyError as error:
        write_video(path, _frames(traces, step, _drawn(traces, task)), fps=FPS)
        return DRAWN.format(reason=error) + legend
    with renderer:
        write_video(path, _frames(traces, step, _rendered(traces, renderer)), fps=FPS)
        closer = renderer.has_detail
    return RENDERED + (f" {view(task).detail}" if closer else "") + legend


def _frames(
    traces: Mapping[str, Trace], step: int, picture: Callable[[str, int], np.ndarray]
) -> Iterator[np.ndarray]:
    strips = {name: _Strip(name, bar=bool(trace.stiffness.any())) for name, trace in traces.items()}
    for t in range(0, _arrival(traces) + 1, step):
        panels = [
            np.concatenate([picture(name, t), strips[name].picture(trace, t)])
            for name, trace in traces.items()
        ]
        yield np.concatenate(panels, axis=1)


def _stiffness_range(task: Task) -> tuple[float, float]:
    """Smallest and largest mean translational stiffness [N/m]."""
    return float(task.gains.minimum[:3].mean()), float(task.gains.maximum[:3].mean())


def _arrival(traces: Mapping[str, Trace]) -> int:
    """Row half a second after the last one has all but covered its way to the goal; then all stand still."""
    length = len(next(iter(traces.values())).time)
    late = [
        np.flatnonzero(trace.distance > _ARRIVED * trace.distance[0]).max(initial=0)
        + round(0.5 / trace.time[1])
        for trace in traces.values()
    ]
    return min(max(late), length - 1)


class _Strip:
    """The line below a panel: name, time, distance to go, and a bar of the stiffness."""

    def __init__(self, name: str, *, bar: bool):
        colour = style.QUIET if name == "expert" else style.look(name).colour
        with style.figure(WIDTH / _DPI, STRIP / _DPI) as drawing:
            drawing.set_dpi(_DPI)
            drawing.text(0.03, 0.86, style.look(name).label, color=colour, size=13, weight="bold", va="top")
            self._told = drawing.text(0.97, 0.82, "", color=style.QUIET, size=10, ha="right", va="top")
            self._stiffness = drawing.text(0.97, 0.26, "", size=11, ha="right", va="center")
            for x, width, shade in ((0.03, _BAR * bar, style.GRID), (0.03, 0.0, colour)):
                self._bar = Rectangle((x, 0.18), width, 0.16, color=shade, transform=drawing.transFigure)
                drawing.add_artist(self._bar)
        self._drawing = drawing

    def picture(self, trace: Trace, t: int) -> np.ndarray:
        """The strip at one moment, (STRIP, WIDTH, 3)."""
        decimals = 0 if trace.distance[0] > 0.1 else 1
        self._told.set_text(f"{trace.time[t]:.2f} s    {1e3 * trace.distance[t]:.{decimals}f} mm to go")
        stiffness = float(trace.stiffness[t, :3].mean())
        if stiffness > 0.0:
            low, high = _stiffness_range(trace.task)
            self._bar.set_width(
                _BAR * (0.05 + 0.95 * float(np.clip((stiffness - low) / (high - low), 0.0, 1.0)))
            )
            self._stiffness.set_text(f"{stiffness:.0f} N/m")
        return style.pixels(self._drawing)


def _rendered(traces: Mapping[str, Trace], renderer: Renderer) -> Callable[[str, int], np.ndarray]:
    """Pictures of the scene, with what matters from close by in the upper right corner if the scene has it."""

    def picture(name: str, t: int) -> np.ndarray:
        joints = traces[name].joints[t]
        overview = renderer.picture(joints)
        if renderer.has_detail:
            corner = overview[10 : 10 + _INSET + 2 * _FRAME, -10 - _INSET - 2 * _FRAME : -10]
            corner[:] = 255
            corner[_FRAME:-_FRAME, _FRAME:-_FRAME] = _middle(renderer.picture(joints, camera=DETAIL))
        return overview

    return picture


def _middle(picture: np.ndarray) -> np.ndarray:
    """The middle of a picture at half its size, (_INSET, _INSET, 3)."""
    top, left = ((length - 2 * _INSET) // 2 for length in picture.shape[:2])
    square = picture[top : top + 2 * _INSET, left : left + 2 * _INSET]
    return square.reshape(_INSET, 2, _INSET, 2, 3).mean(axis=(1, 3)).astype(np.uint8)


def _drawn(traces: Mapping[str, Trace], task: Task) -> Callable[[str, int], np.ndarray]:
    """Pictures of what moves as a line, in front of what the task's view has to show."""
    scenery = view(task).scenery or plain_scenery
    bodies = {name: task.skeleton(trace.joints) for name, trace in traces.items()}
    drawings = {}
    for name, trace in traces.items():
        with style.figure(WIDTH / _DPI, HEIGHT / _DPI) as drawing:
            axes: Any = drawing.add_subplot(projection="3d")
            scenery(axes, name, trace, bodies[name])
            (line,) = axes.plot(
                [], [], [], color="#e0a800", lw=5, marker="o", ms=6, mfc="#7a5c00", mec="none"
            )
            drawings[name] = (drawing, line)

    def picture(name: str, t: int) -> np.ndarray:
        drawing, line = drawings[name]
        line.set_data_3d(*bodies[name][t].T)
        return style.pixels(drawing)

    return picture
