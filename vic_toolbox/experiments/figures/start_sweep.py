"""How far the skill carries: score and success over starts all around the arm."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style

WORST = 0.5
"""Relative difference at which the colour scale ends."""


def sweep_maps(
    starts: np.ndarray,
    goal: np.ndarray,
    relative_difference: Mapping[str, np.ndarray],
    success: Mapping[str, np.ndarray],
    *,
    unreachable: np.ndarray,
) -> Figure:
    """Maps of the starts from above, coloured by score, and curves over the start's distance.

    Parameters
    ----------
    starts : ndarray, shape (n, 3)
        Starts that were judged [m].
    goal : ndarray, shape (3,)
        Position of the goal [m].
    relative_difference : dict of ndarray, shape (n,)
        Relative difference to the expert, by look.
    success : dict of ndarray, shape (n,)
        Share of successes, by look; the expert's too.
    unreachable : ndarray, shape (m, 3)
        Starts that the arm cannot take, drawn as dots [m].
    """
    names = list(relative_difference)
    with style.figure(3.0 * max(len(names), 2) + 0.8, 6.2) as drawing:
        grid = drawing.add_gridspec(2, 2 * len(names), height_ratios=(1.4, 1.0))
        maps: list[Axes] = []
        for i, name in enumerate(names):
            axes = drawing.add_subplot(grid[0, 2 * i : 2 * i + 2], sharex=maps[0] if maps else None)
            points = _map(axes, starts, goal, relative_difference[name], success[name])
            axes.scatter(
                *unreachable[:, :2].T, s=5, color="#c3c9d0", lw=0, zorder=2, label="no start possible"
            )
            axes.set_title(style.look(name).label)
            axes.tick_params(labelleft=i == 0)
            maps.append(axes)
        maps[0].set_ylabel("y  [m]")
        drawing.legend(*maps[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
        bar = drawing.colorbar(points, ax=maps, shrink=0.8, pad=0.01, aspect=25, extend="max")
        bar.set_label("relative difference to the expert")
        bar.outline.set_visible(False)
        score = drawing.add_subplot(grid[1, : len(names)])
        share = drawing.add_subplot(grid[1, len(names) :])
        distance = np.linalg.norm(starts - goal, axis=1)
        for name in names:
            _curve(score, distance, relative_difference[name], name)
        for name in success:
            _curve(share, distance, 100.0 * success[name], name)
        score.set(title="relative difference, mean of a ring", xlabel="distance of the start  [m]")
        share.set(title="success  [%]", xlabel="distance of the start  [m]", ylim=(-4, 104))
        score.set_ylim(bottom=0)
        share.legend()
    return drawing


def _map(axes: Axes, starts, goal, difference, success):  # type: ignore[no-untyped-def]
    shown = np.clip(difference, 0.0, WORST)
    points = axes.scatter(
        *starts[:, :2].T, c=shown, cmap="cividis_r", vmin=0.0, vmax=WORST, s=46, lw=0, zorder=3
    )
    failed = success < 0.5
    axes.scatter(*starts[failed, :2].T, label="cup does not stand", **_FAILED)
    axes.scatter(*goal[:2], label="plate", **_PLATE)
    axes.scatter(0.0, 0.0, label="robot", **_ROBOT)
    edge = np.concatenate([starts[:, :2], np.zeros((1, 2))])
    low, high = edge.min(axis=0) - 0.12, edge.max(axis=0) + 0.12
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x  [m]")
    axes.set_aspect("equal", adjustable="box")
    return points


_FAILED = {"marker": "x", "s": 18, "color": "#d55e00", "lw": 1.4, "zorder": 4}
_PLATE = {"marker": "*", "s": 90, "color": style.INK, "lw": 0, "zorder": 5}
_ROBOT = {"marker": "s", "s": 50, "facecolor": "#f5dd90", "edgecolor": style.QUIET, "lw": 0.8, "zorder": 5}


def _curve(axes: Axes, distance: np.ndarray, value: np.ndarray, name: str) -> None:
    rings = np.unique(distance.round(6))
    mean = np.array([value[np.isclose(distance, ring)].mean() for ring in rings])
    style.line(axes, rings, mean, name, marker="o", ms=3.5)
