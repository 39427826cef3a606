"""What to know about a fit before its numbers are used: each thing with its remedy on the command line."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, TypeGuard

import numpy as np

from vic_toolbox.errors import InputError
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments.fit_settings import FitSettings
from vic_toolbox.gains import AXES
from vic_toolbox.recordings import (
    Finding,
    FrameCheck,
    Inspection,
    Latency,
    Layout,
    Payload,
    Recording,
    inertia_share,
)
from vic_toolbox.recordings.frame import FORCE
from vic_toolbox.recordings.inspection import WORTH_TELLING
from vic_toolbox.recordings.repairs import REPAIRS

EXPLAINS = 0.2
"""Largest residual of constant gains, relative to the wrench, at which a scan of delays means something."""
OUT_OF_CONTACT = 0.3
"""Share of samples out of contact that is worth telling."""
OFTEN = 0.02
"""Negative gains are told where there are more than this share of them."""
LIGHTEST = 0.02
"""Masses within this of zero [kg] may be negative by noise."""
INERTIAL = 0.8
"""Above this share of the force that inertia explains, gains may be those of whatever moved the arm."""
STATIC_RESIDUAL = 0.5
"""A calibration whose poses leave more than this unexplained [N] was touched, or is of another tool."""


@dataclass(frozen=True)
class Advice:
    """One thing to know, and what to do about it."""

    severity: Literal["alarm", "warning", "note"]
    """An alarm says that the gains are probably wrong; a note is no fault."""
    text: str
    """What it is."""
    remedy: str = ""
    """What to do."""

    def __str__(self) -> str:
        return f"{self.text}. {self.remedy}".strip() if self.remedy else self.text


def advice(
    logs: Sequence[Recording],
    used: Sequence[Recording],
    inspections: Sequence[Inspection],
    estimate: GainEstimate,
    overall: GainEstimate | None,
    *,
    settings: FitSettings,
    layout: Layout,
    payload: Payload | None,
) -> tuple[Advice, ...]:
    """Everything to know, the gravest first.

    Parameters
    ----------
    logs : sequence of Recording
        As they were read.
    used : sequence of Recording
        As they were conditioned.
    inspections : sequence of Inspection
        Of these.
    estimate, overall : GainEstimate
        What was fitted, and the constant gains with bias for comparison.
    settings, layout, payload
        How it was fitted, read and compensated.
    """
    found: list[Advice] = []
    for log, part, seen in zip(logs, used, inspections, strict=True):
        where = f"{log.source}: " if len(logs) > 1 else ""
        found += _frame(seen.frame, layout, where)
        found += [
            Advice(
                "note" if finding.kind == "flip" else "warning",
                where + finding.message,
                command_remedy(finding),
            )
            for finding in log.findings
        ]
        found += _contact(part, where, settings)
        if not settings.latency:
            found += _latency(seen, where)
    found += _durations(logs)
    found += _inertial(used)
    found += _calibration(payload, layout)
    found += _bias(overall, settings)
    found += _negative(estimate)
    found += [Advice("warning", text) for text in estimate.warnings]
    found += _notes(logs)
    order = ("alarm", "warning", "note")
    return tuple(sorted(dict.fromkeys(found), key=lambda a: order.index(a.severity)))


def refuse_wrong_clock(log: Recording) -> None:
    """Refuse a log whose time is not in seconds: every rate, and so all damping, would be off by its factor.

    Raises
    ------
    InputError
        The median step looks like milliseconds or less.
    """
    for finding in log.findings:
        if finding.kind == "units" and "time" in finding.message:
            raise InputError(
                f"{log.source or 'the recording'}: {finding.message}. State it: --units time=ms (or us, ns), or "
                "[units] in the layout."
            )


def command_remedy(finding: Finding) -> str:
    """The remedy of a finding with the option that does it, where there is one."""
    if finding.kind in REPAIRS and "repair" in finding.remedy:
        return f"{finding.remedy}. On the command line: --repair"
    if finding.kind == "units":
        return f"{finding.remedy}. On the command line: --units length=mm and the like"
    return finding.remedy


def frame_options(check: FrameCheck, layout: Layout) -> str | None:
    """The options under which the log is read in the frame that the check proposes; None where there are none.

    The check saw the wrench after it was read with `layout`. Its rotation ``Q`` therefore comes on top of the one
    stated, ``Q₀``: ``R Q Q₀``, unless both differ in whether the log had turned the wrench.
    """
    stated, found = np.array(layout.sensor_rotation), check.rotation
    plain = layout.wrench_axes == "world" and np.array_equal(stated, np.eye(3))
    if check.wrench_axes == "tool" and not plain:
        return None
    axes = check.wrench_axes if plain else layout.wrench_axes
    words = [] if axes == layout.wrench_axes else [f"--wrench-axes {axes}"]
    turn = found @ stated
    if not np.allclose(turn, stated):
        words.append("--sensor-rotation " + " ".join(f"{x:.6g}" for x in (turn + 0.0).ravel()))
    sign = check.sign * layout.wrench_sign
    if sign != layout.wrench_sign:
        words.append(f"--wrench-sign {sign}")
    return " ".join(words)


def _frame(check: FrameCheck | None, layout: Layout, where: str) -> Iterator[Advice]:
    if check is None or not check.suspicious:
        return
    before, after = 100 * check.explained_before, 100 * check.explained
    text = (
        f"{where}the wrench seems to be in other axes than stated: a diagonal spring and damper explain "
        f"{before:.0f} % of the force as it is, and {after:.0f} % with the sensor turned"
    )
    options = frame_options(check, layout)
    remedy = (
        f"Fit again with {options}"
        if options
        else "State how the sensor is mounted anew: --wrench-axes and --sensor-rotation do not fit together"
    )
    if check.explained - check.runner_up < 0.05:
        remedy += f"; another rotation explains {100 * check.runner_up:.0f} %, so look at the sensor first"
    yield Advice("alarm", text, remedy)


def _latency(seen: Inspection, where: str) -> Iterator[Advice]:
    late = seen.latency
    if not tells(late) or abs(late.seconds) <= WORTH_TELLING:
        return
    side = "late" if late.seconds > 0 else "early"
    yield Advice(
        "warning",
        f"{where}the wrench seems {side} by {1e3 * abs(late.seconds):.1f} ms, which moves the damping by the "
        "stiffness times that",
        "Add --latency to estimate it with the gains",
    )


def tells(latency: Latency | None) -> TypeGuard[Latency]:
    """Whether a scan of delays says anything: it takes the gains for constant, and has to explain the wrench so."""
    return latency is not None and latency.certain and latency.residual.min() < EXPLAINS


def _durations(logs: Sequence[Recording]) -> Iterator[Advice]:
    durations = [log.duration for log in logs]
    if max(durations) > 1.5 * min(durations):
        yield Advice(
            "warning",
            f"the logs last from {min(durations):.3g} to {max(durations):.3g} s, and K(t), B(t) are one function of "
            "the time since the start of each",
            "Pool only repetitions of the same motion, or take --constant",
        )


def _inertial(used: Sequence[Recording]) -> Iterator[Advice]:
    """A free arm that only a hand moves: its wrench is inertia, whatever the hand's gains are."""
    try:
        share = float(np.mean(inertia_share(used)[:3]))
    except InputError:  # too short to tell
        return
    if share > INERTIAL:
        yield Advice(
            "warning",
            f"a constant mass times the acceleration explains {100 * share:.0f} % of the force, so the gains may "
            "be those of the arm that was moved, whatever their bands say",
            "Did a hand guide a free arm? Let its controller push as well, with several frequencies ('vic twin study' "
            "shows what that buys). Was it a spring? Move it at several frequencies",
        )


def _contact(log: Recording, where: str, settings: FitSettings) -> Iterator[Advice]:
    force = np.linalg.norm(log.wrench[:, :3], axis=1)
    below = float((force < FORCE).mean())
    if 0 < force.max() < FORCE:
        yield Advice(
            "warning",
            f"{where}the force never exceeds {force.max():.2g} N",
            "Was there contact? A free motion says nothing about stiffness",
        )
    elif below > OUT_OF_CONTACT and not settings.contact and settings.method == "smooth":
        yield Advice(
            "warning",
            f"{where}the force is below {FORCE:g} N for {100 * below:.0f} % of the samples, where friction may be "
            "all that the sensor feels",
            f"Compare with --contact {FORCE:g}, which leaves them out",
        )


def _calibration(payload: Payload | None, layout: Layout) -> Iterator[Advice]:
    if payload is None:
        return
    mass = layout.wrench_sign * payload.mass
    if mass < -LIGHTEST or payload.residual[0] > STATIC_RESIDUAL:
        yield Advice(
            "warning",
            f"the calibration gives a tool of {mass:.3g} kg and leaves {payload.residual[0]:.2g} N unexplained in "
            f"{payload.poses} poses",
            "Was the tool touched, or is the sensor's frame or sign another? See --sensor-rotation, --wrench-sign",
        )


def _bias(overall: GainEstimate | None, settings: FitSettings) -> Iterator[Advice]:
    """A sensor whose zero is off, as the constant gains see it, which have a bias of their own."""
    if settings.bias or settings.method == "windows" or overall is None:
        return
    bias, sd = overall.parameters["bias"], overall.parameters["bias_sd"]
    large = np.maximum(3 * overall.noise, np.repeat([0.5, 0.02], 3))
    with np.errstate(invalid="ignore"):
        told_at = np.argwhere((np.abs(bias) > 3 * sd) & (np.abs(bias) > large))
    told = [
        f"{bias[i, j]:.2g} {'N' if j < 3 else 'Nm'} along {AXES[j]}"
        for i, j in told_at
        if np.isfinite(overall.stiffness[0, j, j])
    ]
    if told:
        more = ", ..." if len(told) > 6 else ""
        yield Advice(
            "warning",
            f"the wrench seems to have a bias ({', '.join(told[:6])}{more}), which a fit without one reads as gains",
            "Add --bias, or take it out with --calibration FILE (poses at rest, untouched)",
        )


def _negative(estimate: GainEstimate) -> Iterator[Advice]:
    """Gains that are surely negative: no spring and no damper."""
    told = []
    for letter, name in (("K", "stiffness"), ("B", "damping")):
        for i, axis in enumerate(AXES):
            value, sd = getattr(estimate, name)[:, i, i], getattr(estimate, f"{name}_sd")[:, i, i]
            seen = getattr(estimate, f"{name}_observable")[:, i]
            share = float((value[seen] < -3 * sd[seen]).mean()) if seen.any() else 0.0
            if share > OFTEN:
                told.append(f"{letter}_{axis} ({100 * share:.0f} % of the time)")
    if told:
        yield Advice(
            "warning",
            f"negative beyond three deviations: {', '.join(told)}, which is neither spring nor damper",
            "Is inertia, friction or a bias left in the wrench, or is the frame another? --mass, --bias, "
            "--calibration; --constraint positive forbids it",
        )


def _notes(logs: Sequence[Recording]) -> Iterator[Advice]:
    for note in dict.fromkeys(note for log in logs for note in log.notes):
        yield Advice("note", note)
