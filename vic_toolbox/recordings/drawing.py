"""A recording at a glance: error, its rate and wrench over time, with the findings where they are."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from vic_toolbox.errors import Array, InputError
from vic_toolbox.recordings.validation import ABSURD

if TYPE_CHECKING:
    from vic_toolbox.recordings.recording import Recording

PANELS = (
    ("error [mm]", "error", slice(0, 3), 1e3),
    ("rotational error [°]", "error", slice(3, 6), 180 / np.pi),
    ("rate [mm/s]", "error_rate", slice(0, 3), 1e3),
    ("rotational rate [°/s]", "error_rate", slice(3, 6), 180 / np.pi),
    ("force [N]", "wrench", slice(0, 3), 1.0),
    ("moment [Nm]", "wrench", slice(3, 6), 1.0),
)
COLOURS = ("#c0392b", "#1e8449", "#2471a3")
MOST_POINTS = 3000


def draw(recording: Recording) -> Any:
    """Draw a recording; one with errors shows its wrench and pose as they are.

    Returns
    -------
    matplotlib.figure.Figure
        Save it with ``savefig``.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 7), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True)
    clock = np.where(np.abs(recording.time) < ABSURD, recording.time, np.nan)
    for axis, (label, name, part, scale) in zip(axes.flat, PANELS, strict=True):
        values = _values(recording, name)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if values is None:
            axis.text(0.5, 0.5, "see the findings", transform=axis.transAxes, ha="center", color="#777777")
            continue
        values = np.where(np.abs(values) < ABSURD, values, np.nan)
        for column, colour, direction in zip(values[:, part].T, COLOURS, "xyz", strict=True):
            times, shown = _thinned(clock, scale * column)
            axis.plot(times, shown, color=colour, linewidth=0.8, label=direction)
    for finding in recording.findings:
        if finding.index < len(recording) and np.isfinite(clock[finding.index]):
            for axis in axes.flat:
                axis.axvline(clock[finding.index], color="#b9770e", linewidth=0.8, linestyle=":")
    axes[2, 0].legend(
        loc="upper right", ncols=3, fontsize="small", frameon=False
    )  # the wrench is always there
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    title = f"{len(recording)} samples, {recording.rate:.4g} Hz"
    if recording.findings:
        title += f"; dotted: where {len(recording.findings)} findings begin"
    figure.suptitle(title, fontsize="medium")
    return figure


def _values(recording: Recording, name: str) -> Array | None:
    try:
        return getattr(recording, name)
    except InputError:  # the recording has errors, or is too short for a rate
        return None


def _thinned(time: Array, column: Array) -> tuple[Array, Array]:
    """Extremes of equal pieces: a long log looks the same and is drawn at once."""
    if len(time) <= MOST_POINTS:
        return time, column
    piece = -(-len(time) // (MOST_POINTS // 2))
    count = len(time) // piece
    table = np.nan_to_num(column[: count * piece]).reshape(count, piece)
    picked = np.sort(np.column_stack([table.argmin(axis=1), table.argmax(axis=1)]), axis=1)
    index = (picked + piece * np.arange(count)[:, None]).ravel()
    return time[index], column[index]
