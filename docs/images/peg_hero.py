"""Draws the picture of Peg-in-Hole, expert and constant gain from 6° of tilt: python docs/images/peg_hero.py"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.experiments.evaluation import Policy
from vic_toolbox.experiments.figures import insertion, style
from vic_toolbox.experiments.trace import Trace, record_trace
from vic_toolbox.tasks.peg_in_hole import PegInHole
from vic_toolbox.tasks.rendering import DETAIL, Renderer, add_camera

SIZE = 400  # of a close-up [pixels]
MOUTH = "mouth"
SHOWN = ((3, MOUTH), (13, MOUTH), (15, DETAIL), (199, MOUTH))
"""Policy steps, and the camera for each."""
TITLES = {
    "expert": (
        "0.06 s: hardly moves its tip",
        "0.26 s: meets the chamfer",
        "right edge at 0.30 s",
        "at the end: inserted",
    ),
    "constant": (
        "0.06 s: swings its tip out",
        "0.26 s: lands beside it",
        "right edge at 0.30 s",
        "at the end: stuck",
    ),
}


def pictures(task: PegInHole, traces: dict[str, Trace]) -> dict[str, list[np.ndarray]]:
    """Close-ups, by look."""
    spec = task.picture_spec()
    add_camera(spec, MOUTH, eye=(0.05, -0.5, 0.10), target=(0.0, 0.0, 1e-3), fovy=3.9)
    spec.visual.quality.shadowsize = 8192  # for sharp shadows from close by
    with Renderer(spec, width=2 * SIZE, height=2 * SIZE) as renderer:
        return {
            name: [_halved(renderer.picture(trace.joints[step], camera=camera)) for step, camera in SHOWN]
            for name, trace in traces.items()
        }


def _halved(picture: np.ndarray) -> np.ndarray:
    """The picture at half its size, without jagged edges."""
    return picture.reshape(SIZE, 2, SIZE, 2, 3).mean(axis=(1, 3)).astype(np.uint8)


def hero(task: PegInHole, traces: dict[str, Trace]) -> Figure:
    """Close-ups on the left, a row for each policy; on the right the tip's path, dots where they are; the way to go."""
    with style.figure(11.0, 4.3) as drawing:
        left, right = drawing.subfigures(1, 2, squeeze=False, width_ratios=(2.75, 1.0))[0]
        grid = left.subplots(2, len(SHOWN))
        for row, (name, shown) in zip(grid, pictures(task, traces).items(), strict=True):
            colour = style.QUIET if name == "expert" else style.look(name).colour
            row[0].set_ylabel(style.look(name).label, color=colour, size=10.5, weight="bold")
            for axes, picture, title in zip(row, shown, TITLES[name], strict=True):
                axes.imshow(picture)
                axes.set(xticks=[], yticks=[])
                axes.spines[:].set_visible(False)
                axes.set_title(title, size=8.5)
        path, way = right.subplots(2, 1, height_ratios=(1.7, 1.0))
        steps = [step for step, camera in SHOWN if camera == MOUTH]
        for name, trace in traces.items():
            x, _, z = 1e3 * task.tip_position(trace.observations).T
            style.line(path, x, z, name)
            path.plot(x[steps], z[steps], "o", ms=4.0, color=style.INK, zorder=6)
            style.line(way, trace.time, 1e3 * trace.distance, name)
        insertion.draw_profile(path, task.scenario)
        path.set(title="path of the tip  [mm]", xlim=(-1.6, 5.2), ylim=(-2.2, 3.7), aspect="equal")
        path.annotate("chamfer", (0.22, -0.2), (1.2, -1.3), color=style.QUIET, fontsize=8,
                      arrowprops={"arrowstyle": "-", "color": style.QUIET, "lw": 0.8})  # fmt: skip
        way.legend(loc="center right")
        way.set(title="way to go  [mm]", xlabel="time  [s]")
        way.set_ylim(bottom=0.0)
        way.margins(x=0)
    return drawing


def main() -> None:
    """Draw the picture."""
    task = PegInHole(scenario="tilt=-6")
    acts = {"expert": task.expert_action, "constant": Policy.constant(task).act}
    traces = {name: record_trace(task, act) for name, act in acts.items()}
    style.save(hero(task, traces), Path(__file__).with_name("peg_hero.png"))


if __name__ == "__main__":
    main()
