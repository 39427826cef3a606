"""One look for every figure: colours that colour-blind readers can tell apart, quiet axes, units on every
label.

Each method keeps its colour and its name in all figures and tables. The palette is Okabe and Ito's.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.legend import Legend

from vic_toolbox.files import atomic_path

INK, QUIET, GRID = "#1f2933", "#616e7c", "#e4e7eb"


@dataclass(frozen=True)
class Look:
    """How one method is drawn and called."""

    label: str
    colour: str
    dashes: tuple[float, ...] = ()
    width: float = 1.7
    order: float = 3.0


_LOOKS = {  # the expert is a broad pale band: what lies on it agrees with the expert
    "expert": Look("expert", "#c9ced6", width=6.0, order=2),
    "airl": Look("AIRL", "#0072b2", order=4),
    "before": Look("AIRL, before transfer", "#56b4e9", (4, 1.5), order=3.5),
    "transfer": Look("AIRL, after transfer", "#0072b2", order=4),
    "random": Look("random reward", "#cc79a7", (2, 1)),
    "bc": Look("cloning (BC)", "#d55e00", (3, 1), order=5),
    "constant": Look("constant gain", "#009e73", width=1.2),
    "middle": Look("constant, mid-range", "#e69f00", (6, 1.5), width=1.2),
    "matched": Look("constant, matched", "#7b5ea7", (1.5, 1), width=1.4),
}
_SPARE = ("#a05a2c", "#44546a", "#999933", "#882255")


def look(name: str) -> Look:
    """The look of a method; an unknown name is its own label and gets a colour of its own."""
    if name in _LOOKS:
        return _LOOKS[name]
    return Look(name, _SPARE[sum(name.encode()) % len(_SPARE)])


RC: dict[Any, Any] = {
    "font.size": 9.0,
    "font.family": "DejaVu Sans",
    "text.color": INK,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.labelsize": 8.5,
    "axes.titlesize": 9.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 6.0,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": GRID,
    "grid.linewidth": 0.7,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "lines.linewidth": 1.8,
    "svg.hashsalt": "vic_toolbox",
}


@contextlib.contextmanager
def figure(width: float, height: float) -> Iterator[Figure]:
    """A figure of this size [inch] in the house style; it belongs to no window and needs no display."""
    with matplotlib.rc_context(RC):
        drawing = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasAgg(drawing)
        yield drawing


def line(axes: Axes, x, y, name: str, *, zs=None, **extra) -> None:
    """Draw one method's curve in its own look; `zs` in 3-D axes."""
    chosen = look(name)
    drawn_as = {
        "color": chosen.colour,
        "lw": chosen.width,
        "zorder": chosen.order,
        "label": chosen.label,
    } | extra
    if chosen.dashes:
        drawn_as["dashes"] = chosen.dashes
    axes.plot(x, y, *([] if zs is None else [zs]), solid_capstyle="butt", **drawn_as)


def length_unit(largest: float) -> tuple[float, str]:
    """Factor and name of the unit for lengths up to the largest one [m]: metres, or millimetres below 0.1 m."""
    return (1.0, "m") if largest >= 0.1 else (1e3, "mm")


def shared_legend(drawing: Figure, axes: Axes) -> Legend:
    """One legend for all panels, in a row above them; a method drawn twice is named once."""
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    handles, labels = list(named.values()), list(named)
    return drawing.legend(
        handles, labels, loc="outside upper center", ncols=max(len(labels), 1), handlelength=2.6
    )


def save(drawing: Figure, path: Path) -> Path:
    """Write the figure whole or not at all; the suffix chooses the format. The same figure gives the same
    bytes.

    Raises
    ------
    FileError
        The file cannot be written.
    """
    with matplotlib.rc_context(RC), atomic_path(path) as temporary:
        drawing.savefig(temporary, dpi=150, metadata={"Date": None} if path.suffix == ".svg" else None)
    return path


def pixels(drawing: Figure) -> np.ndarray:
    """The figure as an image (height, width, 3) of bytes."""
    canvas = FigureCanvasAgg(drawing)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()
