"""A fit on disk: the gains as a table, everything else as JSON, and one page that shows and judges them."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from vic_toolbox.experiments import report
from vic_toolbox.experiments.figures import gain_fit, style
from vic_toolbox.experiments.fit_advice import Advice, frame_options
from vic_toolbox.experiments.fit_summary import (
    SELDOM,
    AxisSummary,
    GainSummary,
    axis_summaries,
    in_one_number,
    parameter_rows,
    plus_minus,
    rounded,
    to_json,
    verdict,
)
from vic_toolbox.experiments.fitting import Fit
from vic_toolbox.experiments.gain_table import KINDS, GainTable, gain_unit
from vic_toolbox.experiments.result_folder import new_folder, refuse_foreign
from vic_toolbox.files import write_json
from vic_toolbox.gains import AXES

MARKER, WHAT = "fit.json", "fit"
FILES = {
    "report.html": "the result on one page",
    "gains.csv": "gains over time, their deviations, what is determined",
    "fit.json": "settings, each axis, warnings, checks, the logs' fingerprints",
    "estimate.npz": "everything for Python",
    "figures": "the figures of the report",
}
HEAD = (
    "axis",
    "K mean",
    "K range",
    "K sd",
    "known",
    "K constant",
    "B mean",
    "B sd",
    "known",
    "explained",
    "residual",
)


def refuse_folder(path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Refuse, before any work, a folder that a fit must not be written to.

    Raises
    ------
    FileError
        It holds something else, or a fit (without `overwrite`).
    """
    refuse_foreign(Path(path), marker=MARKER, what=WHAT, overwrite=overwrite)


def write_fit(fit: Fit, out: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the folder of a fit, as a whole or not at all.

    Parameters
    ----------
    fit : Fit
    out : path-like
        A new or empty folder, or with `overwrite` one that holds a fit.
    overwrite : bool
        Replace the fit that is there.

    Raises
    ------
    FileError
        The folder holds something else, or cannot be written.
    """
    axes = axis_summaries(fit)
    with new_folder(out, marker=MARKER, what=WHAT, overwrite=overwrite) as folder:
        GainTable.of(fit.estimate).write(folder / "gains.csv")
        fit.estimate.save(folder / "estimate.npz")
        _write_page(fit, axes, folder, Path(out))
        write_json(folder / MARKER, to_json(fit, axes))


def result_rows(axes: Sequence[AxisSummary]) -> list[tuple[str, ...]]:
    """The table of a result, one row for each axis; see :data:`HEAD`."""
    rows = []
    for i, a in enumerate(axes):
        k, b = a.stiffness, a.damping
        rows.append((
            f"{a.axis} [{gain_unit('K', i, i)}, {gain_unit('B', i, i)}]",
            _mean(k), _range(k), _sd(k), _share(k.observable), plus_minus(*a.constant),
            _mean(b), _sd(b), _share(b.observable),
            f"{100 * a.explained:.0f} %" if a.explained > 0 else "–",
            f"{a.residual_rms:.2g} {'N' if i < 3 else 'Nm'}",
        ))  # fmt: skip
    return rows


def next_steps(fit: Fit, out: Path) -> list[tuple[str, str]]:
    """What to type next: (command, what it does)."""
    logs = " ".join(shlex.quote(log.file) for log in fit.inputs) or "LOG"
    steps = []
    frame = next((seen.frame for seen in fit.inspections if seen.frame and seen.frame.suspicious), None)
    if frame is not None and (options := frame_options(frame, fit.layout)):
        steps.append((f"vic fit {logs} {options} --out {out}-turned", "The same with the sensor turned."))
    if not fit.determined:
        return [*steps, (f"vic recording inspect {logs.split(' ')[0]}", "What the log holds, with a figure.")]
    return [
        *steps,
        (
            "from vic_toolbox import estimation, gains\n"
            f'fit = estimation.GainEstimate.load("{out}/estimate.npz")\n'
            "spare = gains.ImpedanceGains.diagonal([200.0] * 3 + [10.0] * 3, [40.0] * 3 + [2.0] * 3)\n"
            "schedule = fit.to_gains(fit.time, fallback=spare)",
            "K(t) and B(t) for a simulation or a stability analysis; spare stands in where the data say nothing.",
        ),
        (
            "command = law.impedance(q, v, reference=goal, gains=fit.to_gains(t, fallback=spare))",
            "In a control loop: law is a control.CartesianLaw of your arm, goal a control.Reference.",
        ),
        (
            "demonstrations = tasks.Demonstrations.from_recordings(logs, fit, task=task, fallback=spare)",
            "Motions and gains to learn from (pip install 'vic-toolbox[learn]').",
        ),
    ]


def _mean(gain: GainSummary) -> str:
    return rounded(gain.mean, gain.sd).replace("-", "−") if gain.observable else "–"


def _range(gain: GainSummary) -> str:
    if not gain.observable or gain.low == gain.high:
        return "–"
    return f"{rounded(gain.low, gain.sd)} to {rounded(gain.high, gain.sd)}".replace("-", "−")


def _sd(gain: GainSummary) -> str:
    return rounded(gain.sd, gain.sd) if gain.observable else "–"


def _share(share: float) -> str:
    return f"{100 * share:.0f} %" if share == 0 or share >= 0.01 else "< 1 %"


# --- the page ------------------------------------------------------------------------------------------------


def _write_page(fit: Fit, axes: Sequence[AxisSummary], folder: Path, out: Path) -> None:
    serious = [a for a in fit.advice if a.severity != "note"]
    notes = [a for a in fit.advice if a.severity == "note"]
    logs = ", ".join(Path(log.source).name or "a recording" for log in fit.logs)
    report.write_report(
        folder / "report.html",
        title="Gains from " + (logs if len(logs) < 60 else f"{len(fit.logs)} logs"),
        subtitle=f"{sum(map(len, fit.recordings))} samples; {fit.estimate.method}",
        summary=" ".join(verdict(fit, axes)),
        tiles=_tiles(axes),
        parts=[
            *([_remedies("What to know before using them", serious)] if serious else []),
            _result(axes),
            *map(report.Note, in_one_number(fit, axes)),
            *_matrices(fit),
            *_figures(fit, folder / "figures"),
            *_parameters(fit),
            *([_remedies("How the log was read", notes)] if notes else []),
            report.Commands("Where to go from here", next_steps(fit, out)),
            report.Settings("Every setting of this fit", _settings(fit)),
        ],
        footer="Wrench = K e + B ė; bands are 95 %; what the data do not determine is left out, never guessed.",
    )


def _settings(fit: Fit) -> dict[str, object]:
    return asdict(fit.settings) | {f"layout.{name}": value for name, value in asdict(fit.layout).items()}


def _remedies(title: str, advice: Sequence[Advice]) -> report.Remedies:
    return report.Remedies(title, [(a.severity, a.text, a.remedy) for a in advice])


def _tiles(axes: Sequence[AxisSummary]) -> list[tuple[str, str]]:
    """The stiffnesses that are known."""
    return [
        (
            _range(k).replace(" to ", "–"),
            f"K_{a.axis} [{gain_unit('K', i, i)}] over time, ± {_sd(k)} at an instant",
        )
        if k.high > k.low
        else (plus_minus(k.mean, k.sd), f"K_{a.axis} [{gain_unit('K', i, i)}]")
        for i, a in enumerate(axes)
        if (k := a.stiffness).observable >= SELDOM
    ]


def _result(axes: Sequence[AxisSummary]) -> report.Table:
    return report.Table(
        "Result",
        HEAD,
        result_rows(axes),
        caption=(
            "Mean, range (5 to 95 %) and standard deviation at a typical instant, over the instants at which the data "
            "determine the gain (known: their share). K constant: one stiffness and one bias for all samples in "
            "contact, for comparison. Explained: share of the wrench about its mean."
        ),
    )


def _matrices(fit: Fit) -> Iterator[report.Part]:
    """Mean matrices, where axes are coupled."""
    if not GainTable.of(fit.estimate).full:
        return
    for kind, (name, _) in KINDS.items():
        values = getattr(fit.estimate, name)
        known = np.isfinite(values)
        mean = np.where(
            known.any(axis=0), np.nansum(values, axis=0) / np.maximum(known.sum(axis=0), 1), np.nan
        )
        rows = [
            (AXES[i], *("–" if x != x else f"{x:.3g}".replace("-", "−") for x in row))
            for i, row in enumerate(mean)
        ]
        units = ", ".join(KINDS[kind][1])
        yield report.Table(f"{name.capitalize()}, mean over time", ("", *AXES), rows, caption=f"[{units}]")


def _parameters(fit: Fit) -> Iterator[report.Part]:
    rows = parameter_rows(fit.estimate)
    if fit.payload is not None:
        centre = ", ".join(f"{1e3 * x:.1f}" for x in fit.payload.centre)
        bias = ", ".join(f"{x:.3g}" for x in fit.payload.bias)
        rows += [
            ("mass on the sensor, taken out", f"{fit.layout.wrench_sign * fit.payload.mass:.4g} kg"),
            ("its centre, from the end-effector", f"{centre} mm"),
            ("bias of the sensor, taken out", f"{bias} N, Nm"),
            (
                "left in the poses at rest",
                f"{fit.payload.residual[0]:.2g} N, {fit.payload.residual[1]:.2g} Nm",
            ),
        ]
    if rows:
        yield report.Table("What else was found", ("quantity", "value"), rows)


def _figures(fit: Fit, folder: Path) -> list[report.Part]:
    seen = fit.inspections[0]
    several = " Of the first log." if len(fit.recordings) > 1 else ""
    drawings: list[tuple[str, Figure, str, str]] = []
    if fit.determined:
        drawings.append((
            "gains", gain_fit.gains_over_time(fit), "Gains",
            "Line: the fit; band: 95 %; dashes: one constant stiffness for all samples in contact. Gaps are instants "
            "at which the data do not determine the gain. Rows without any known gain are left out.",
        ))  # fmt: skip
    drawings += [
        ("wrench", gain_fit.wrench_explained(fit), "The wrench, measured and fitted",
         "Where the two part, something else than a spring and a damper acts: friction, inertia, a wrong frame, "
         "or no contact." + several),
        ("residuals", gain_fit.residuals(fit), "What is left",
         "White noise would look like the dotted bell and have no memory. A long memory is a part of the wrench "
         "that the model does not have; the bands are widened by it." + several),
        ("observability", gain_fit.observability(fit), "What can be known",
         "Deviation of each gain relative to its typical size. Grey: the data do not tell it at this resolution, "
         "and no number is given."),
        ("checks", gain_fit.checks(seen.frame, seen.latency), "Frame and latency",
         (seen.frame.message[0].upper() + seen.frame.message[1:] + ". " if seen.frame else "")
         + "A wrench in other axes, or a late one, would be explained better elsewhere." + several),
    ]  # fmt: skip
    return [
        report.Figure(style.save(figure, folder / f"{name}.svg"), title, caption)
        for name, figure, title, caption in drawings
    ]
