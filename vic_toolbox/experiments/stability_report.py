"""A study of stability on disk: one page that answers and shows, and everything as JSON."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import vic_toolbox
from vic_toolbox.experiments import report
from vic_toolbox.experiments.figures import stability as pictures
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.result_folder import new_folder, refuse_foreign
from vic_toolbox.experiments.stability_study import Study
from vic_toolbox.files import write_json
from vic_toolbox.gains import AXES
from vic_toolbox.stability import Analysis, Finding

MARKER, WHAT, FORMAT = "stability.json", "stability analysis", "vic-stability/1"
FILES = {
    "report.html": "answers, margins, what to do, and what shows it, on one page",
    "stability.json": "every verdict with its numbers and its witness, the settings",
    "figures": "the figures of the report",
}
HEAD = ("question", "answer", "margin", "what to do")
ALPHAS = "Where the needed α stays below the allowed one, a storage function with an α between never grows."
PLAIN = {"proved": "yes", "inconclusive": "open", "disproved": "no"}
KIND = {"proved": "note", "inconclusive": "warning", "disproved": "alarm"}
SHORT = {
    "schedule": "the gains as they change",
    "held": "gains that are held and jump",
    "inertia": "the inertia that moves",
    "switching": "any change among these gains",
    "worst switching": "the worst change of each axis",
    "safe range": "how far the stiffness may go",
    "policy": "motions under the policy",
    "sampled": "the force held by the computer",
    "passivity": "passive with every hand",
    "contact": "contact with something stiff",
}
SAID = {
    "schedule": "stable as the gains change",
    "held": "stable with gains that are held and jump",
    "inertia": "the damping pays for the inertia that moves",
    "switching": "stable under any change among these gains",
    "worst switching": "stable under the worst change of each axis",
    "safe range": "a range in which the stiffness may change anyhow",
    "policy": "motions under the policy come to rest",
    "sampled": "stable with a force that is held over the control period",
    "passivity": "passive with every hand",
    "contact": "stable in contact with something stiff",
}
ABOUT = {
    "gains": "The gains over time",
    "rollout": "The rollout: the gains that the policy chose",
    "policy": "The policy, and everything that it may do",
}


def refuse_folder(path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Refuse, before any work, a folder that an analysis must not be written to.

    Raises
    ------
    FileError
        It holds something else, or an analysis (without `overwrite`).
    """
    refuse_foreign(Path(path), marker=MARKER, what=WHAT, overwrite=overwrite)


def write_study(study: Study, out: str | os.PathLike[str], *, overwrite: bool = False) -> None:
    """Write the folder, as a whole or not at all.

    Raises
    ------
    FileError
        The folder holds something else, or cannot be written.
    """
    with new_folder(out, marker=MARKER, what=WHAT, overwrite=overwrite) as folder:
        _write_page(study, folder)
        write_json(folder / MARKER, to_json(study))


def to_json(study: Study) -> dict[str, Any]:
    """Everything that was found; what is not finite is null."""
    return {
        "format": FORMAT,
        "version": vic_toolbox.__version__,
        "title": study.title,
        "described": study.described,
        "settings": asdict(study.settings) | {"period": study.period},
        "notes": list(study.notes),
        "analyses": {name: analysis.to_dict() for name, analysis in study.analyses.items()},
        "starts": list(study.starts),
        "replays": {
            name: {
                "share_changed": replay.share_changed,
                "injected": float(replay.injected[-1]),
                "filtered_injected": float(replay.filtered_injected[-1]),
                "energy_saved": replay.energy_saved,
                "lowest_tank": None if replay.tank is None else float(replay.tank.min()),
            }
            for name, replay in study.replays.items()
        },
    }


def rows(analysis: Analysis) -> list[tuple[str, str, str, str]]:
    """The table of an analysis, see :data:`HEAD`."""
    return [(SHORT[f.name], f.status, f.margin, f.remedy or "–") for f in analysis]


def summary(study: Study) -> str:
    """The result in one or two sentences."""
    every = [f for analysis in study.analyses.values() for f in analysis]
    if not every:
        return "No question applies to these gains."
    said = []
    for status, text in (("disproved", "Disproved"), ("inconclusive", "Not decided"), ("proved", "Proved")):
        found = dict.fromkeys(SAID[f.name] for f in every if f.status == status)
        if found:
            said.append(f"{text}: {', '.join(found)}.")
    several = ""
    if len(study.starts) > 1:
        good = sum(status == "proved" for status in study.starts)
        several = f" From {good} of {len(study.starts)} starts the gains are proved stable as they change."
    return " ".join(said) + several


# --- the page ------------------------------------------------------------------------------------------------


def _write_page(study: Study, folder: Path) -> None:
    report.write_report(
        folder / "report.html",
        title=study.title,
        subtitle=study.described,
        summary=summary(study),
        tiles=_tiles(study),
        parts=[
            *_parts(study, folder / "figures"),
            *map(report.Note, study.notes),
            report.Settings(
                "Every setting of this analysis", asdict(study.settings) | {"period": study.period}
            ),
        ],
        footer=(
            "Proved: with a certificate that was checked by another route. Disproved: with a motion that can be "
            "replayed. Inconclusive proves nothing."
        ),
    )


def _tiles(study: Study) -> list[tuple[str, str]]:
    """Every answer, the gravest first in each analysis; of a name that comes twice the first."""
    seen: dict[str, Finding] = {}
    for analysis in study.analyses.values():
        for finding in analysis:
            seen.setdefault(finding.name, finding)
    return [(PLAIN[f.status], f"{SAID[f.name]}: {f.status}") for f in seen.values()]


def _parts(study: Study, folder: Path) -> Iterator[report.Part]:
    for name, analysis in study.analyses.items():
        if not len(analysis):
            continue
        about = ABOUT[name]
        items = [(KIND[f.status], f"{f.question} {f.status.capitalize()}.", _told(f)) for f in analysis]
        yield report.Remedies(about, items)
        yield report.Table(
            f"{about}: in numbers",
            ("question", "answer", "margin"),
            [(SHORT[f.name], f.status, f.margin) for f in analysis],
            caption="Assuming: " + "; ".join(dict.fromkeys(analysis.assumptions)) + "."
            if analysis.assumptions
            else "",
        )
    if len(study.starts) > 1:
        table = [(str(i), "exact" if i == 0 else "varied", status) for i, status in enumerate(study.starts)]
        yield report.Table(
            "Stable as the gains change, from every start", ("episode", "start", "answer"), table
        )
    for drawing in _drawings(study):
        path = style.save(drawing[1], folder / f"{drawing[0]}.svg")
        yield report.Figure(path, drawing[2], drawing[3])


def _told(finding: Finding) -> str:
    margin = "" if finding.margin == "–" else f"Margin: {finding.margin}. "
    return f"{margin}What to do: {finding.remedy}." if finding.remedy else margin


def _drawings(study: Study) -> Iterator[tuple[str, Figure, str, str]]:
    """(file, figure, title, caption) of everything that can be drawn."""
    settings = study.settings
    for name, analysis in study.analyses.items():
        if analysis.time is not None:
            yield (
                f"{name}-gains",
                pictures.gains_over_time(analysis),
                "Gains over time" + (", and the α that certifies them" if pictures.alphas(analysis) else ""),
                ALPHAS if pictures.alphas(analysis) else "The gains that were judged.",
            )
        friction = np.broadcast_to(
            np.asarray(settings.friction, dtype=float), 6 if np.ndim(settings.friction) else 1
        )
        each = [
            float(friction[AXES.index(axis)] if len(friction) == 6 else friction[0] * (axis not in AXES[3:]))
            for axis in analysis.axes
        ] if set(analysis.axes) <= set(AXES) else [float(friction[0])] * len(analysis.axes)  # fmt: skip
        mapped = pictures.in_the_z_width(
            analysis,
            period=study.period,
            friction=np.array(each),
            velocity=settings.velocity,
            delay_steps=settings.delay_steps,
        )
        if mapped is not None:
            yield (
                f"{name}-z-width",
                mapped[0],
                "Z-width" if mapped[1] == "axis" else f"Z-width of {mapped[1]}",
                "What this mass can render at this period; dots are the gains. It is the axis that comes closest to "
                "its edge.",
            )
        for finding in analysis:
            yield (
                f"{name}-{finding.name.replace(' ', '-')}",
                finding.plot(),
                f"{SHORT[finding.name].capitalize()}: {finding.status}",
                _caption(finding),
            )
    for name, replay in study.replays.items():
        yield (
            f"replay-{name.replace(' ', '-')}",
            replay.plot(),
            f"What the {name} would have changed",
            replay.summary().replace("\n", "; ") + ".",
        )


def _caption(finding: Finding) -> str:
    verdict = finding.verdict
    assumed = "; ".join(verdict.assumptions)
    return (
        f"{finding.question} {verdict.method}."
        + (f" Assuming: {assumed}." if assumed else "")
        + (f" {verdict.reason[0].upper()}{verdict.reason[1:]}." if verdict.reason else "")
    )
