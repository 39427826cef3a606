"""Learning curves of a study: all seeds of a method, their mean, and the expert."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vic_toolbox.experiments.figures import style


@dataclass(frozen=True)
class Curves:
    """Scores of the mean action while the seeds of one method learn, and the expert's score.

    Attributes
    ----------
    iterations, scores : sequence of ndarray, shape (n,)
        One of each for every seed.
    expert : float
        The expert's mean score.
    """

    iterations: Sequence[np.ndarray]
    scores: Sequence[np.ndarray]
    expert: float


def learning_of_seeds(methods: Mapping[str, Mapping[str, Curves]], *, looks: Mapping[str, str]) -> Figure:
    """One panel for each method (row) on each task (column): seeds thin, their mean thick, the expert a pale line.

    Parameters
    ----------
    methods : mapping
        Curves by method and by task.
    looks : mapping
        Look of each method, see :func:`style.look`.
    """
    tasks = list(dict.fromkeys(task for curves in methods.values() for task in curves))
    with style.figure(9.0, 1.9 * len(methods) + 0.5) as drawing:
        grid = drawing.subplots(len(methods), len(tasks), squeeze=False)
        for row, (name, by_task) in zip(grid, methods.items(), strict=True):
            for axes, task in zip(row, tasks, strict=True):
                if task not in by_task:
                    axes.set_visible(False)
                    continue
                _panel(axes, by_task[task], style.look(looks[name]).colour)
                axes.set_title(f"{name}, {task}")
            row[0].set_ylabel("score")
        for axes in grid[-1]:
            axes.set_xlabel("iteration")
        style.shared_legend(drawing, next(axes for axes in grid.flat if axes.get_visible()))
    return drawing


def _panel(axes: Axes, curves: Curves, colour: str) -> None:
    axes.axhline(curves.expert, color=style.look("expert").colour, lw=4.0, zorder=1, label="expert")
    for i, (iteration, score) in enumerate(zip(curves.iterations, curves.scores, strict=True)):
        axes.plot(
            iteration, score, color=colour, lw=0.8, alpha=0.45, zorder=3, label="a seed" if i == 0 else ""
        )
    common, mean = mean_curve(curves)
    axes.plot(common, mean, color=colour, lw=2.0, zorder=4, label="mean of the seeds")
    axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.margins(x=0)
    _leave_out_the_fall(axes, curves)


def mean_curve(curves: Curves) -> tuple[np.ndarray, np.ndarray]:
    """Mean over the seeds at the iterations that every seed has reached; (n,) each."""
    end = min(iteration[-1] for iteration in curves.iterations)
    begin = max(iteration[0] for iteration in curves.iterations)
    every = np.unique(np.concatenate(list(curves.iterations)))
    common = every[(every >= begin) & (every <= end)]
    on_grid = [np.interp(common, i, s) for i, s in zip(curves.iterations, curves.scores, strict=True)]
    return common, np.mean(on_grid, axis=0)


def _leave_out_the_fall(axes: Axes, curves: Curves) -> None:
    """The first scores may be a hundred times worse than all others: they would flatten the rest."""
    every = np.concatenate(list(curves.scores))
    floor = min(
        float(np.quantile(every, 0.05)), *(float(score[-1]) for score in curves.scores), curves.expert
    )
    span = max(float(every.max()), curves.expert) - floor
    if floor - 0.15 * span > float(every.min()):
        axes.set_ylim(bottom=floor - 0.15 * span)
