"""Learning curves: is the policy as good as the expert, and does the run look healthy?"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from vic_toolbox.experiments.figures import style

Metrics = Sequence[Mapping[str, Any]]

_PANELS = (
    ("mean_score", "score", "score"),
    ("action_error", "held-out action error", "RMS, normalised action"),
    ("discriminator_accuracy", "discriminator: expert or policy?", "share told right"),
    ("objective", "learned reward, with entropy", "mean per step"),
    ("log_std", "exploration", "policy σ, normalised action"),
)


def learning_curves(metrics: Metrics, *, expert_score: float, name: str) -> Figure | None:
    """Panels of whatever was recorded: score against the expert's, action error, discriminator, exploration.

    Parameters
    ----------
    metrics : sequence of mappings
        Rows of ``metrics.jsonl``.
    expert_score : float
        The expert's mean score, drawn as a line.
    name : str
        Look of the method, see :func:`style.look`.

    Returns
    -------
    Figure or None
        None when there is nothing to draw: a method without iterations.
    """
    panels = [panel for panel in _PANELS if len(_series(metrics, panel[0])[0]) > 1]
    if any(
        key == "action_error" for key, *_ in panels
    ):  # it says better than the reward how the policy improves
        panels = [panel for panel in panels if panel[0] != "objective"]
    if not panels:
        return None
    columns = 2 if len(panels) == 4 else len(panels)
    rows = -(-len(panels) // columns)
    with style.figure(9.0, (2.1 if rows > 1 else 2.4) * rows + 0.3) as drawing:
        grid = np.atleast_1d(drawing.subplots(rows, columns, squeeze=False)).ravel()
        for axes, (key, title, label) in zip(grid, panels, strict=False):
            _panel(axes, metrics, key, name=name)
            axes.set(title=title, ylabel=label, xlabel="iteration")
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
        if panels[0][0] == "mean_score":
            _score_panel(grid[0], metrics, expert_score)
    return drawing


def _panel(axes: Axes, metrics: Metrics, key: str, *, name: str) -> None:
    iteration, value = _series(metrics, key)
    if key == "log_std":
        value = np.exp(value)
    if key == "discriminator_accuracy":
        axes.axhline(0.5, color=style.QUIET, lw=0.9, ls=":")
        axes.set_ylim(0.4, 1.02)
        axes.annotate(
            "by chance",
            (1, 0.5),
            (0, -3),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            va="top",
            ha="right",
            color=style.QUIET,
            fontsize=7.5,
        )
    axes.plot(iteration, value, color=style.look(name).colour, lw=1.4, zorder=4, label=style.look(name).label)
    if key in ("action_error", "log_std"):
        axes.set_ylim(0.0, 1.08 * value.max())
    for restart in _restarts(metrics):
        axes.axvline(restart, color=style.QUIET, lw=0.8, ls="--")


def _score_panel(axes: Axes, metrics: Metrics, expert_score: float) -> None:
    iteration, sampled = _series(metrics, "score")
    axes.plot(iteration, sampled, color=style.QUIET, lw=0.8, alpha=0.8, zorder=2, label="while exploring")
    axes.axhline(expert_score, color=style.look("expert").colour, lw=3.0, zorder=1, label="expert")
    _, mean = _series(metrics, "mean_score")
    low = min(np.quantile(mean, 0.15), mean[-1], expert_score) - 0.35 * abs(expert_score)
    if np.isfinite(low) and low > min(mean.min(), sampled.min()):  # the first scores may be many times worse
        axes.set_ylim(bottom=low)
    low, high = axes.get_ylim()
    axes.set_ylim(bottom=low - 0.45 * (high - low))  # room for the legend
    axes.legend(loc="lower right", fontsize=7.5, labelspacing=0.3, borderaxespad=0.2)


def _series(metrics: Metrics, key: str) -> tuple[np.ndarray, np.ndarray]:
    rows = [(row["iteration"], row[key]) for row in metrics if row.get(key) is not None]
    values = np.array(rows, dtype=float).reshape(-1, 2)
    return values[:, 0], values[:, 1]


def _restarts(metrics: Metrics) -> list[int]:
    """Iterations at which a new attempt began."""
    attempts = [(row["iteration"], row.get("attempt", 0)) for row in metrics]
    return [later for (later, new), (_, old) in zip(attempts[1:], attempts[:-1], strict=True) if new != old]
