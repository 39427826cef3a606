"""A short film of several policies side by side, with the stiffness that each of them has at the moment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from vic_toolbox.errors import DependencyError
from vic_toolbox.experiments.figures import motion, style
from vic_toolbox.experiments.trace import Trace
from vic_toolbox.tasks import Task
from vic_toolbox.tasks.cup_on_plate import GAINS
from vic_toolbox.tasks.cup_scene import PLATE_RADIUS, robot
from vic_toolbox.tasks.rendering import Renderer, write_video

FPS = 25
WIDTH, HEIGHT, STRIP = 480, 420, 64  # of one panel, and of the strip below it [pixels]

RENDERED = "Simulated arm at its real speed; the bar is the mean translational stiffness, from 60 to 200 N/m."
DRAWN = (
    "Drawn, not rendered: this machine has no OpenGL library ({reason}) The lines are the simulated arm's "
    "links at their real speed; the bar is the mean translational stiffness, from 60 to 200 N/m."
)


def film(path: Path, traces: Mapping[str, Trace], task: Task) -> str:
    """Write an ``.mp4`` of the traces side by side.

    Without an OpenGL library the arm is drawn as lines instead, and the caption says so.

    Returns
    -------
    str : caption for the film.

    Raises
    ------
    FileError : the file cannot be written.
    """
    step = round(1.0 / (FPS * task.dt))
    try:
        renderer = Renderer(task.picture_spec(), width=WIDTH, height=HEIGHT)
    except DependencyError as error:
        write_video(path, _frames(traces, step, _drawn(traces)), fps=FPS)
        return DRAWN.format(reason=error)
    with renderer:
        write_video(
            path, _frames(traces, step, lambda name, t: renderer.picture(traces[name].joints[t])), fps=FPS
        )
    return RENDERED


def _frames(
    traces: Mapping[str, Trace], step: int, picture: Callable[[str, int], np.ndarray]
) -> Iterator[np.ndarray]:
    for t in range(0, _arrival(traces) + 1, step):
        yield np.concatenate(
            [_panel(picture(name, t), name, trace, t) for name, trace in traces.items()], axis=1
        )


def _arrival(traces: Mapping[str, Trace]) -> int:
    """Row half a second after the last one has come to within 20 mm of the goal; then all stand still."""
    length = len(next(iter(traces.values())).time)
    late = [
        np.flatnonzero(trace.distance > 0.02).max(initial=0) + round(0.5 / trace.time[1])
        for trace in traces.values()
    ]
    return min(max(late), length - 1)


def _panel(picture: np.ndarray, name: str, trace: Trace, t: int) -> np.ndarray:
    """The picture over a strip with name, time, distance and a bar of the stiffness."""
    canvas = Image.new("RGB", (WIDTH, HEIGHT + STRIP), "white")
    canvas.paste(Image.fromarray(picture), (0, 0))
    pen = ImageDraw.Draw(canvas)
    chosen = style.look(name)
    colour = style.QUIET if name == "expert" else chosen.colour
    pen.text((14, HEIGHT + 7), chosen.label, fill=colour, font=_font(18, bold=True))
    told = f"{trace.time[t]:.2f} s    {1e3 * trace.distance[t]:.0f} mm to go"
    pen.text((WIDTH - 14, HEIGHT + 10), told, fill=style.QUIET, font=_font(14), anchor="ra")
    stiffness = float(trace.stiffness[t, :3].mean())
    if stiffness > 0.0:
        low, high = GAINS.minimum[0], GAINS.maximum[0]
        left, right, top = 14, WIDTH - 96, HEIGHT + 40
        end = left + (right - left) * (0.06 + 0.94 * np.clip((stiffness - low) / (high - low), 0.0, 1.0))
        pen.rounded_rectangle((left, top, right, top + 10), 5, fill=style.GRID)
        pen.rounded_rectangle((left, top, end, top + 10), 5, fill=colour)
        pen.text((WIDTH - 14, top - 5), f"{stiffness:.0f} N/m", fill=style.INK, font=_font(15), anchor="ra")
    return np.asarray(canvas)


def _font(size: int, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font of the figures; it ships with Matplotlib."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / name), size)


def _drawn(traces: Mapping[str, Trace]) -> Callable[[str, int], np.ndarray]:
    """Pictures of the arm as lines from joint to joint."""
    arm = robot()
    frames = [
        frame for frame in arm.frame_names if frame.startswith(("base", "link", "flange", "gripper", "cup"))
    ]
    joints = {
        name: np.stack([arm.pose(trace.joints, frame=frame)[:, :3, 3] for frame in frames], axis=1)
        for name, trace in traces.items()
    }
    drawings = {}
    for name, trace in traces.items():
        with style.figure(WIDTH / 100, HEIGHT / 100) as drawing:
            axes: Any = drawing.add_subplot(projection="3d")
            motion.draw_paths(axes, {"start": {name: trace}}, plate_radius=PLATE_RADIUS)
            axes.set_zlim(0.0, 0.9)
            axes.set_box_aspect((0.8, 0.9, 0.9), zoom=1.1)
            (links,) = axes.plot(
                [], [], [], color="#e0a800", lw=5, marker="o", ms=6, mfc="#7a5c00", mec="none"
            )
            drawings[name] = (drawing, links)

    def picture(name: str, t: int) -> np.ndarray:
        drawing, links = drawings[name]
        links.set_data_3d(*joints[name][t].T)
        return style.pixels(drawing)

    return picture
