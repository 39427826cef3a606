"""The figures of a fit: gains with their bands, what the fit leaves, what can be known, and the checks."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vic_toolbox.errors import Array
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.fit_advice import tells
from vic_toolbox.experiments.fit_summary import SELDOM
from vic_toolbox.experiments.fitting import Fit
from vic_toolbox.experiments.gain_table import KINDS, gain_name, gain_unit
from vic_toolbox.recordings import FrameCheck, Latency

COLOURS = {"K": "#0072b2", "B": "#d55e00"}
XYZ = ("#d55e00", "#009e73", "#0072b2")
CONSTANT, MEASURED = "#44546a", "#b8bec8"
BAND = 1.96
MOST_POINTS, MOST_INSTANTS = 1500, 4000
GAP = 8.0
"""A step this many times the mean one is a gap in a line."""
LATEST = 1e5
"""Clocks that begin later than this [s] are drawn from zero."""
PRECISE = (0.05, 0.2, 1.0)
"""Relative deviations between which the map of what is known changes its colour."""


def gains_over_time(fit: Fit) -> Figure:
    """K(t) and B(t) of each axis with their 95 % bands; rows in which nothing is determined are left out."""
    estimate, rows = fit.estimate, _rows(fit)
    time, label = _clock(fit, estimate.time)
    with style.figure(9.0, 0.5 + 2.0 * len(rows)) as drawing:
        grid = drawing.subplots(len(rows), 3, sharex=True, squeeze=False)
        for (kind, name, axes), panels in zip(rows, grid, strict=True):
            for i, panel in zip(axes, panels, strict=True):
                panel.set_title(f"{gain_name(kind, i, i)}  [{gain_unit(kind, i, i)}]")
                values = getattr(estimate, name)[:, i, i]
                sd = getattr(estimate, f"{name}_sd")[:, i, i]
                if np.isfinite(values).any():
                    at, (line, deviation) = _stretched(fit, time, values, sd)
                    _gain(panel, at, line, deviation, COLOURS[kind])
                    if kind == "K":
                        _constant(panel, fit, i)
                else:
                    _absent(panel)
        for panel in grid[-1]:
            panel.set_xlabel(label)
            panel.margins(x=0)
    return drawing


def _rows(fit: Fit) -> list[tuple[str, str, range]]:
    """Letter, name and axes of the rows in which something is determined, more than hardly ever where possible."""
    shares = {
        (kind, name, axes): getattr(fit.estimate, f"{name}_observable")[:, list(axes)].mean(axis=0).max()
        for kind, (name, _) in KINDS.items()
        for axes in (range(3), range(3, 6))
    }
    return [row for row, share in shares.items() if share >= SELDOM] or [
        row for row, share in shares.items() if share
    ]


def _gain(panel: Axes, time: Array, values: Array, sd: Array, colour: str) -> None:
    """A line with its band, gaps where nothing is known, single instants as dots."""
    every = -(-len(time) // MOST_INSTANTS)  # more than the eye can tell apart only make the file large
    time, values, sd = time[::every], values[::every], sd[::every]
    panel.fill_between(time, values - BAND * sd, values + BAND * sd, color=colour, alpha=0.2, lw=0)
    panel.plot(time, values, color=colour, lw=1.3)
    known = np.isfinite(values)
    alone = known & ~np.roll(known, 1) & ~np.roll(known, -1)
    panel.plot(time[alone], values[alone], ls="", marker="o", ms=2.0, color=colour)
    # a band that opens at the edge of what is known must not hide the curve
    (low, high), edge = np.nanpercentile(values, [1, 99]), BAND * np.nanmedian(sd)
    top, bottom = high + edge, min(low - edge * (low < 0), 0.0)
    panel.set_ylim(bottom - 0.04 * (top - bottom) * (bottom < 0), top + 0.08 * (top - bottom))


def _constant(panel: Axes, fit: Fit, axis: int) -> None:
    if fit.overall is not None and len(fit.estimate.time) > 1:
        panel.axhline(fit.overall.stiffness[0, axis, axis], color=CONSTANT, lw=1.0, ls=(0, (4, 2)))


def _absent(panel: Axes) -> None:
    panel.set_facecolor("#f5f7fa")
    panel.set_yticks([])
    panel.grid(visible=False)
    panel.text(
        0.5, 0.5, "not determined", transform=panel.transAxes, ha="center", va="center", color=style.QUIET
    )


def _stretched(fit: Fit, time: Array, *columns: Array) -> tuple[Array, list[Array]]:
    """Constant gains as a line over the whole log instead of a point in its middle."""
    if len(time) > 1:
        return time, list(columns)
    ends = _clock(fit, fit.recordings[0].time)[0][[0, -1]]
    return ends, [np.repeat(column, 2) for column in columns]


def wrench_explained(fit: Fit) -> Figure:
    """The wrench as it was measured, and as the gains explain it, over the first log."""
    log = fit.recordings[0]
    fitted = log.wrench - fit.estimate.residuals[: len(log)]
    time, label = _clock(fit, log.time)
    with style.figure(9.0, 4.0) as drawing:
        grid = drawing.subplots(2, 3, sharex=True)
        for i, panel in enumerate(grid.flat):
            for column, colour, name, width in (
                (log.wrench[:, i], MEASURED, "measured", 1.6),
                (fitted[:, i], COLOURS["K"], "K e + B ė and what else was fitted", 0.8),
            ):
                panel.plot(*_thinned(time, column), color=colour, lw=width, label=name)
            panel.set_title(
                f"{'force along' if i < 3 else 'moment about'} {'xyz'[i % 3]}  [{'N' if i < 3 else 'Nm'}]"
            )
            panel.margins(x=0)
        for panel in grid[-1]:
            panel.set_xlabel(label)
        style.shared_legend(drawing, grid[0, 0])
    return drawing


def residuals(fit: Fit) -> Figure:
    """What the fit leaves: over time, its distribution, its correlation in time; forces above, moments below."""
    log, left = fit.recordings[0], fit.estimate.residuals
    first = left[: len(log)]
    time, label = _clock(fit, log.time)
    with style.figure(9.0, 4.2) as drawing:
        grid = drawing.subplots(2, 3, width_ratios=(2, 1, 1))
        for (over_time, spread, memory), part, unit in zip(
            grid, (range(3), range(3, 6)), ("N", "Nm"), strict=True
        ):
            for i in part:
                colour = XYZ[i % 3]
                over_time.plot(*_thinned(time, first[:, i]), color=colour, lw=0.6, label="xyz"[i % 3])
                _distribution(spread, left[:, i], colour)
                memory.plot(*_autocorrelation(first[:, i], log.rate), color=colour, lw=1.2)
            over_time.set_title(f"residual  [{unit}]")
            spread.set_title("distribution")
            memory.set_title("autocorrelation")
            memory.axhline(0.0, color=style.QUIET, lw=0.8)
            over_time.margins(x=0)
            spread.set_yticks([])
        grid[1, 0].set_xlabel(label)
        grid[1, 1].set_xlabel("residual / its deviation")
        grid[1, 2].set_xlabel("lag  [s]")
        style.shared_legend(drawing, grid[0, 0])
    return drawing


def _distribution(panel: Axes, left: Array, colour: str) -> None:
    left = left[np.isfinite(left)]
    size = left.std() if left.size else 0.0
    if size > 0:
        panel.hist(
            (left - left.mean()) / size,
            bins=40,
            range=(-4, 4),
            density=True,
            histtype="step",
            color=colour,
        )
    x = np.linspace(-4, 4, 81)
    panel.plot(x, np.exp(-(x**2) / 2) / np.sqrt(2 * np.pi), color=style.QUIET, lw=0.9, ls=":")


def _autocorrelation(left: Array, rate: float, longest: float = 0.5) -> tuple[Array, Array]:
    r = np.nan_to_num(left - np.nanmean(left))
    lags = int(np.clip(round(longest * rate), 2, len(r) - 1))
    size = 1 << int(np.ceil(np.log2(len(r) + lags)))
    power = np.fft.irfft(np.abs(np.fft.rfft(r, size)) ** 2, size)[:lags]
    return np.arange(lags) / rate, power / (power[0] or 1.0)


def observability(fit: Fit) -> Figure:
    """For each gain and instant: how well it is known, or that it is not."""
    estimate = fit.estimate
    time, label = _clock(fit, estimate.time)
    names, rows = [], []
    for kind, (name, _) in KINDS.items():
        for i in range(6):
            value, sd = getattr(estimate, name)[:, i, i], getattr(estimate, f"{name}_sd")[:, i, i]
            seen = getattr(estimate, f"{name}_observable")[:, i]
            typical = np.median(np.abs(value[seen])) if seen.any() else 1.0
            level = len(PRECISE) - np.digitize(sd / max(typical, 1e-12), PRECISE) + 1.0
            rows.append(np.where(seen, level, 0.0))
            names.append(gain_name(kind, i, i))
    time, rows = _stretched(fit, time, *rows)
    colours = ["#eceff3", "#deebf7", "#9ecae1", "#4292c6", "#08519c"]
    words = ["not determined", "worse", "± 100 % or better", "± 20 % or better", "± 5 % or better"]
    with style.figure(9.0, 3.6) as drawing:
        panel = drawing.subplots()
        picked = _columns(len(time))
        mesh = panel.pcolormesh(
            time[picked],
            np.arange(12),
            np.array(rows)[:, picked],
            cmap=ListedColormap(colours),
            norm=BoundaryNorm(np.arange(6) - 0.5, 5),
            shading="nearest",
            rasterized=True,
        )
        panel.set_yticks(range(12), names)
        panel.axhline(5.5, color="white", lw=3)
        panel.invert_yaxis()
        panel.grid(visible=False)
        panel.set_xlabel(label)
        bar = drawing.colorbar(mesh, ax=panel, ticks=range(5), aspect=14, pad=0.01)
        bar.ax.set_yticklabels(words)
        bar.ax.tick_params(length=0)
        bar.outline.set_visible(False)
    return drawing


def _columns(count: int) -> NDArray[np.intp]:
    return np.unique(np.linspace(0, count - 1, min(count, MOST_POINTS)).astype(int))


def checks(frame: FrameCheck | None, latency: Latency | None) -> Figure:
    """How much of the force other ways to mount the sensor would explain, and what other delays would leave."""
    with style.figure(9.0, 2.5) as drawing:
        left, right = drawing.subplots(1, 2, width_ratios=(3, 2))
        _frame_bars(left, frame)
        _delays(right, latency)
    return drawing


def _frame_bars(panel: Axes, frame: FrameCheck | None) -> None:
    panel.set_title("force explained by a constant spring and damper  [%]")
    if frame is None or not frame.judged:
        _absent(panel)
        panel.set_xticks([])
        return
    bars = {
        "as stated": frame.explained_before,
        "best of 24 mountings": frame.explained,
        "best rotation near it": frame.explained_refined,
        "second of the 24": frame.runner_up,
    }
    shares = [100 * max(share, 0.0) for share in bars.values()]
    colours = ["#d55e00" if frame.suspicious else COLOURS["K"], COLOURS["K"], "#7fb6d9", MEASURED]
    panel.barh(range(4), shares, color=colours, height=0.62)
    for i, share in enumerate(shares):
        panel.text(share + 1, i, f"{share:.0f}", va="center", fontsize=8.5)
    panel.set_yticks(range(4), list(bars))
    panel.invert_yaxis()
    panel.set_xlim(0, 108)
    panel.grid(visible=False, axis="y")


def _delays(panel: Axes, latency: Latency | None) -> None:
    panel.set_title("residual, relative to the wrench")
    panel.set_xlabel("wrench late by  [ms]")
    if latency is None:
        _absent(panel)
        return
    panel.plot(1e3 * latency.lags, latency.residual, color=COLOURS["K"], lw=1.4)
    if tells(latency):
        panel.axvline(1e3 * latency.seconds, color="#d55e00", lw=1.2)
        panel.text(1e3 * latency.seconds, 0.96, f"  {1e3 * latency.seconds:.1f} ms", color="#d55e00", va="top",
                   transform=panel.get_xaxis_transform())  # fmt: skip
    panel.margins(x=0)


def _clock(fit: Fit, time: Array) -> tuple[Array, str]:
    """Times to draw, and what they are called."""
    first, *others = fit.recordings
    if others:
        return time - time[0], "time since the start of each log  [s]"
    start = first.time[0]
    return (time - start, "time since the start  [s]") if abs(start) > LATEST else (time, "time  [s]")


def _thinned(time: Array, column: Array) -> tuple[Array, Array]:
    """Extremes of equal pieces, gaps left open: a long log looks the same and the drawing stays small."""
    if len(time) > MOST_POINTS:
        piece = -(-len(time) // (MOST_POINTS // 2))
        count = len(time) // piece
        table = np.nan_to_num(column[: count * piece]).reshape(count, piece)
        picked = np.sort(np.column_stack([table.argmin(axis=1), table.argmax(axis=1)]), axis=1)
        index = (picked + piece * np.arange(count)[:, None]).ravel()
        time, column = time[index], column[index]
    step = np.diff(time)
    gaps = np.flatnonzero(step > GAP * np.mean(step)) + 1
    return np.insert(time, gaps, np.nan), np.insert(column, gaps, np.nan)
