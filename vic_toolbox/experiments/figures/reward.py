"""What the learned reward values: a slice of r(o, a) along the expert's path."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from vic_toolbox.experiments.figures import style

_PALE_IS_BEST = LinearSegmentedColormap.from_list(
    "reward", ["#5a3a1e", "#a8672a", "#e3ae62", "#f7e3b5", "#fffdf4"]
)


@dataclass(frozen=True)
class RewardSlice:
    """The reward along a line of actions, at the states of the expert's path.

    Attributes
    ----------
    name : str
        What changes along the line, with its unit.
    value : ndarray, shape (m,)
        Places along it.
    distance : ndarray, shape (n,)
        Distance to the goal at each state [m].
    reward : ndarray, shape (n, m)
        Reward of each value at each state.
    chosen : dict of ndarray, shape (n,)
        The place that is nearest to what each policy chose, by look.
    """

    name: str
    value: np.ndarray
    distance: np.ndarray
    reward: np.ndarray
    chosen: Mapping[str, np.ndarray]


def reward_landscape(slices: list[RewardSlice]) -> Figure:
    """Maps of the reward below its best at each state; what the expert and the policy chose is drawn on top.

    Pale is what the reward prefers. Where the pale ridge follows the expert's line, it has learned his skill.
    """
    with style.figure(9.0, 3.1) as drawing:
        grid = np.atleast_1d(drawing.subplots(1, len(slices)))
        for axes, part in zip(grid, slices, strict=True):
            factor, unit = style.length_unit(float(part.distance.max()))
            distance = factor * part.distance
            below = part.reward - part.reward.max(axis=1, keepdims=True)
            depth = max(float(np.quantile(-below, 0.9)), 1e-6)
            image = axes.pcolormesh(
                distance,
                part.value,
                below.T,
                cmap=_PALE_IS_BEST,
                vmin=-depth,
                vmax=0.0,
                shading="gouraud",
                rasterized=True,
            )
            for name, chosen in part.chosen.items():
                over = (
                    {"color": style.INK, "lw": 1.6, "dashes": (3, 2), "zorder": 6} if name == "expert" else {}
                )
                style.line(axes, distance, chosen, name, **over)
            axes.set(title=part.name, xlabel=f"distance to the goal  [{unit}]")
            margin = 0.02 * (part.value[-1] - part.value[0])
            axes.set_ylim(part.value[0] - margin, part.value[-1] + margin)
            axes.set_xlim(distance.max(), distance.min())
            axes.grid(visible=False)
            drawing.colorbar(image, ax=axes, label="reward below the best", pad=0.02).outline.set_visible(
                False
            )
        style.shared_legend(drawing, grid[0])
    return drawing
