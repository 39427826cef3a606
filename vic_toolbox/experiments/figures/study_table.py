"""A table as a picture: a dot with its interval for each method and scenario, the paper's number beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vic_toolbox.experiments.figures import style


@dataclass(frozen=True)
class Dot:
    """One number, as it is shown."""

    mean: float
    low: float | None
    high: float | None
    paper: float | None


@dataclass(frozen=True)
class DotRow:
    """One method: its name, its look, whether it is a control, and its dots by column."""

    name: str
    look: str
    control: bool
    dots: Mapping[str, Dot]


def dots(rows: Sequence[DotRow], columns: Sequence[str], *, label: str, rate: bool) -> Figure:
    """A panel for each column of the table, a line for each row.

    Parameters
    ----------
    rows : sequence of DotRow
        From top to bottom; controls stand apart, in grey.
    columns : sequence of str
        Names of the panels.
    label : str
        The quantity with its unit.
    rate : bool
        A success rate [%] on an even scale; anything else is positive, and on a logarithmic one.
    """
    places = _places(rows)
    with style.figure(9.0, 1.1 + 0.19 * (max(places) + 1)) as drawing:
        panels = drawing.subplots(1, len(columns), sharey=True, sharex=True, squeeze=False)[0]
        floor = 0.0 if rate else _floor(rows)
        for axes, column in zip(panels, columns, strict=True):
            for place, row in zip(places, rows, strict=True):
                if column in row.dots:
                    _draw(axes, row.dots[column], place, _colour(row), floor)
            axes.set_title(column)
            axes.grid(axis="y", visible=False)
            axes.tick_params(axis="y", length=0)
        panels[0].set_yticks(places, [row.name for row in rows])
        panels[0].set_ylim(max(places) + 0.7, -0.7)
        if rate:
            panels[0].set(xlim=(-5, 105), xticks=(0, 50, 100))
        else:
            panels[0].set_xscale("log")
            panels[0].set_xlim(left=floor)
        drawing.supxlabel(label, fontsize=8.5, color=style.INK)
        drawing.legend(handles=_legend(rows), loc="outside upper center", ncols=3)
    return drawing


def _places(rows: Sequence[DotRow]) -> list[float]:
    """Heights, with a gap between methods and controls."""
    return [i + 0.8 * row.control for i, row in enumerate(rows)]


def _floor(rows: Sequence[DotRow]) -> float:
    """Where a logarithmic axis begins: half the smallest dot, but at most a factor of 2000 below the largest."""
    values = [n for row in rows for dot in row.dots.values() for n in (dot.mean, dot.paper) if n]
    return max(0.5 * min(values), 5e-4 * max(values)) if values else 1e-3


def _colour(row: DotRow) -> str:
    return style.QUIET if row.control else style.look(row.look).colour


def _draw(axes: Axes, dot: Dot, place: float, colour: str, floor: float) -> None:
    if dot.low is not None and dot.high is not None:
        axes.plot([max(dot.low, floor), dot.high], [place, place], color=colour, lw=1.3, alpha=0.65, zorder=3)
    if dot.paper is not None:
        axes.plot(max(dot.paper, floor), place, zorder=4, clip_on=False, **_PAPER)
    axes.plot(max(dot.mean, floor), place, "o", ms=4.5, color=colour, zorder=5, clip_on=False)


_PAPER = {"marker": "D", "ms": 6.5, "mfc": "none", "mec": style.INK, "mew": 0.9, "ls": "none"}


def _legend(rows: Sequence[DotRow]) -> list[Line2D]:
    colour = style.look("airl").colour
    handles = [
        Line2D([], [], marker="o", ms=4.5, ls="none", color=colour, label="mean of the seeds"),
        Line2D([], [], color=colour, lw=1.3, alpha=0.65, label="95 % interval"),
    ]
    if any(dot.paper is not None for row in rows for dot in row.dots.values()):
        handles.append(Line2D([], [], label="the paper (best three of five)", **_PAPER))  # type: ignore[arg-type]
    return handles
