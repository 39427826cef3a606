"""A fit in numbers and in words: each axis, what is determined, what is not, how sure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

import vic_toolbox
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments.fitting import Fit
from vic_toolbox.experiments.gain_table import KINDS, gain_name, gain_unit
from vic_toolbox.gains import AXES

FORMAT = "vic-fit/1"
CHANGES = 5.0
"""A gain is called changing where its range (5 to 95 %) is more than so many of its own deviations,"""
SLIGHT = 0.05
"""... and more than this share of it."""
SELDOM = 0.1
"""A gain that is known for less than this share of the time is not worth a number in words."""
MOSTLY = 0.9
"""One that is known for more than this is known, in words."""


@dataclass(frozen=True)
class GainSummary:
    """One gain of one axis over the instants at which it is determined; NaN where there is none."""

    mean: float
    low: float
    high: float
    """5th and 95th percentile over time."""
    sd: float
    """Standard deviation at a typical instant (median)."""
    observable: float
    """Share of the instants at which the data determine it."""


@dataclass(frozen=True)
class AxisSummary:
    """One axis of a fit."""

    axis: str
    stiffness: GainSummary
    damping: GainSummary
    constant: tuple[float, float]
    """Constant stiffness over all samples in contact, with a constant bias, and its standard deviation."""
    explained: float
    """Share of the wrench about its mean that the fit explains."""
    explained_by_constant: float
    """The same for constant gains and bias, in contact."""
    noise: float
    """Standard deviation of the wrench's noise [N, Nm]."""
    residual_rms: float
    """[N, Nm]"""


def axis_summaries(fit: Fit) -> tuple[AxisSummary, ...]:
    """Every axis of a fit."""
    estimate, overall = fit.estimate, fit.overall
    residual = np.sqrt(np.nanmean(np.square(estimate.residuals), axis=0))
    found = []
    for i, axis in enumerate(AXES):
        gains = [_summary(estimate, name, i) for name, _ in KINDS.values()]
        constant = (math.nan, math.nan)
        if overall is not None:
            constant = float(overall.stiffness[0, i, i]), float(overall.stiffness_sd[0, i, i])
        found.append(
            AxisSummary(
                axis,
                *gains,
                constant=constant,
                explained=float(estimate.explained[i]),
                explained_by_constant=math.nan if overall is None else float(overall.explained[i]),
                noise=float(estimate.noise[i]),
                residual_rms=float(residual[i]),
            )
        )
    return tuple(found)


def _summary(estimate: GainEstimate, name: str, axis: int) -> GainSummary:
    values = getattr(estimate, name)[:, axis, axis]
    sd = getattr(estimate, f"{name}_sd")[:, axis, axis]
    seen = getattr(estimate, f"{name}_observable")[:, axis]
    if not seen.any():
        return GainSummary(*[math.nan] * 4, observable=0.0)
    known = values[seen]
    low, high = np.percentile(known, [5, 95])
    return GainSummary(
        float(known.mean()), float(low), float(high), float(np.median(sd[seen])), float(seen.mean())
    )


def verdict(fit: Fit, axes: Sequence[AxisSummary]) -> list[str]:
    """What is determined, what is not, and how sure, in a few sentences."""
    alarms = [a for a in fit.advice if a.severity == "alarm"]
    told = [f"Do not use these gains yet: {alarms[0].text.split(': a diag')[0]}."] if alarms else []
    if not fit.determined:
        return [*told, "No gain is determined by the data: " + _why(fit)]
    over_time = " over time (± at an instant)" if len(fit.estimate.time) > 1 else ""
    for kind, (name, _) in KINDS.items():
        gains = [getattr(a, name) for a in axes]
        lost = [a.axis for a, gain in zip(axes, gains, strict=True) if gain.observable < SELDOM]
        if text := _phrases(kind, gains):
            without = f"; not determined, or hardly ever: {', '.join(lost)}" if lost else ""
            told.append(f"The {name}{over_time} is {text}{without}.")
        else:
            ever = ", or hardly ever" if any(gain.observable for gain in gains) else ""
            told.append(f"The {name} is not determined along any axis{ever}.")
    return told + _how_well(axes)


def in_one_number(fit: Fit, axes: Sequence[AxisSummary]) -> list[str]:
    """What one constant stiffness would be, in a sentence; none where the gains are constant or nothing is known."""
    text = _phrases("K", [_steady(*a.constant) for a in axes])
    if not text or len(fit.estimate.time) == 1:
        return []
    shares = [_percent(a.explained_by_constant) for a in axes if math.isfinite(a.constant[0])]
    return [f"One constant stiffness, over all contact, would be {text} and explain {', '.join(shares)} %."]


def _steady(value: float, sd: float) -> GainSummary:
    return GainSummary(value, value, value, sd, observable=float(math.isfinite(value)))


def _phrases(kind: str, gains: Sequence[GainSummary]) -> str:
    """``K_x 117 ± 3, K_y 52 to 180 (± 9 at an instant) N/m and K_rx ... Nm/rad`` of what is known."""
    groups = []
    for part in (range(3), range(3, 6)):
        words = [_phrase(gain_name(kind, i, i), gains[i]) for i in part if gains[i].observable >= SELDOM]
        if words:
            groups.append(f"{', '.join(words)} {gain_unit(kind, part[0], part[0])}")
    return " and ".join(groups)


def _phrase(name: str, gain: GainSummary) -> str:
    share = [f"{100 * gain.observable:.0f} % of the time"] if gain.observable <= MOSTLY else []
    if gain.high - gain.low > max(CHANGES * gain.sd, SLIGHT * abs(gain.mean)):
        low, high, sd = (rounded(x, gain.sd) for x in (gain.low, gain.high, gain.sd))
        return f"{name} {low} to {high} ({', '.join([f'± {sd}', *share])})".replace("-", "−")
    return f"{name} {plus_minus(gain.mean, gain.sd)}" + (f" ({share[0]})" if share else "")


def _how_well(axes: Sequence[AxisSummary]) -> list[str]:
    known = [a for a in axes if a.stiffness.observable >= SELDOM and math.isfinite(a.explained)]
    names, shares = ", ".join(a.axis for a in known), ", ".join(_percent(a.explained) for a in known)
    return [f"The fit explains {shares} % of the wrench along {names}."] if known else []


def _percent(share: float) -> str:
    return f"{100 * max(share, 0.0):.0f}"


def _why(fit: Fit) -> str:
    forces = np.concatenate([np.linalg.norm(r.wrench[:, :3], axis=1) for r in fit.recordings])
    motion = np.concatenate([r.error[:, :3] for r in fit.recordings])
    spread = float(np.linalg.norm(motion.std(axis=0)))
    return (
        f"the force is {np.sqrt(np.mean(forces**2)):.2g} N rms and the error varies by {1e3 * spread:.2g} mm, and a "
        "constant wrench explains the data as well as a spring does. Record with contact and motion along the axes "
        "that matter."
    )


def parameter_rows(estimate: GainEstimate) -> list[tuple[str, str]]:
    """What else was estimated, each with its standard deviation: (name, value)."""
    rows = []
    for name, value in estimate.parameters.items():
        if name.endswith("_sd"):
            continue
        sd = np.broadcast_to(estimate.parameters.get(f"{name}_sd", np.nan), np.shape(value))
        for index in np.ndindex(np.shape(value)):
            label, factor, unit = _labelled(name, index)
            rows.append(
                (
                    label,
                    f"{plus_minus(factor * float(value[index]), factor * float(sd[index]))} {unit}".strip(),
                )
            )
    return rows


def _labelled(name: str, index: tuple[int, ...]) -> tuple[str, float, str]:
    if name == "bias":
        return f"bias along {AXES[index[1]]}, log {index[0] + 1}", 1.0, "N" if index[1] < 3 else "Nm"
    if name == "latency":
        return "latency of the wrench", 1e3, "ms"
    if name == "attractor":
        return f"rest of the spring, {AXES[index[0]]}", 1e3, "mm" if index[0] < 3 else "mrad"
    if name == "damping_factor":
        return (
            f"damping factor, {('translation', 'rotation')[index[0]]}",
            1.0,
            "√kg" if not index[0] else "√(kg m²)",
        )
    return f"{name} {list(index) or ''}".strip(), 1.0, ""


def to_json(fit: Fit, axes: Sequence[AxisSummary]) -> dict[str, Any]:
    """Everything about a fit but the gains over time; what is not determined is null."""
    estimate = fit.estimate
    content = {
        "format": FORMAT,
        "version": vic_toolbox.__version__,
        "verdict": " ".join(verdict(fit, axes)),
        "determined": fit.determined,
        "method": estimate.method,
        "inputs": [
            {"file": r.source, "sha256": None}
            | named
            | {"samples": len(r), "duration": r.duration, "rate": r.rate}
            for named, r in zip(
                map(asdict, fit.inputs) if fit.inputs else [{}] * len(fit.logs), fit.logs, strict=True
            )
        ],
        "settings": asdict(fit.settings),
        "layout": asdict(fit.layout),
        "payload": None if fit.payload is None else asdict(fit.payload),
        "axes": {a.axis: {k: v for k, v in asdict(a).items() if k != "axis"} for a in axes},
        "parameters": {name: np.asarray(value).tolist() for name, value in estimate.parameters.items()},
        "checks": [_checks(seen.frame, seen.latency) for seen in fit.inspections],
        "warnings": [asdict(a) for a in fit.advice if a.severity != "note"],
        "notes": [a.text for a in fit.advice if a.severity == "note"],
    }
    return _plain(content)


def _checks(frame: Any, latency: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"frame": None, "latency": None}
    if frame is not None:
        names = ("judged", "suspicious", "explained_before", "explained", "sign", "wrench_axes", "message")
        found["frame"] = {name: getattr(frame, name) for name in names} | {
            "rotation": frame.rotation.tolist()
        }
    if latency is not None:
        found["latency"] = {"seconds": latency.seconds, "certain": latency.certain}
    return found


def _plain(value: Any) -> Any:
    """For JSON, which has no word for NaN and infinity."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def rounded(value: float, sd: float) -> str:
    """A number with the digits that its standard deviation leaves."""
    if not (math.isfinite(value) and math.isfinite(sd)) or sd <= 0:
        return f"{value:.3g}"
    # two digits of a deviation that begins with one, else one
    exponent = math.floor(math.log10(sd))
    places = (1 if sd < 2 * 10**exponent else 0) - exponent
    shown = round(value, places) + 0.0
    return f"{shown:.{max(places, 0)}f}"


def plus_minus(value: float, sd: float) -> str:
    """``117 ± 3``, with the digits that the deviation leaves; a dash where the value is not determined."""
    if not math.isfinite(value):
        return "–"
    if not math.isfinite(sd):
        return f"{value:.3g}"
    return f"{rounded(value, sd)} ± {rounded(sd, sd)}".replace("-", "−")
