"""Verdicts together: one for each question, with what to do about it, and the worst of them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vic_toolbox.errors import Array, one_of
from vic_toolbox.files import write_json
from vic_toolbox.stability.verdict import Certificate, CounterExample, Status, Verdict

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEVERITY = ("disproved", "inconclusive", "proved")
"""The gravest first."""


@dataclass(frozen=True, eq=False)
class Finding:
    """The answer to one question.

    Parameters
    ----------
    name : str
        Short and unique, e.g. ``schedule``.
    question : str
        In plain words.
    verdict : Verdict
        The decisive one.
    remedy : str
        What to do, in one line.
    tried : tuple of Verdict
        Methods that were tried before and did not decide.
    shown : Verdict, optional
        What :meth:`plot` draws instead, of a verdict on several axes: that on the worst.
    """

    name: str
    question: str
    verdict: Verdict
    remedy: str = ""
    tried: tuple[Verdict, ...] = ()
    shown: Verdict | None = field(default=None, repr=False)

    def plot(self) -> Figure:
        """Draw what shows it; of several axes, the worst."""
        return (self.shown or self.verdict).plot()

    @property
    def status(self) -> Status:
        """Of the verdict."""
        return self.verdict.status

    @property
    def margin(self) -> str:
        """Margin and its unit in short; a dash where there is none."""
        value, unit = self.verdict.margin, self.verdict.margin_unit
        if not np.isfinite(value):
            return "–"
        short = re.split(r"[:,]| \(", unit.removeprefix("("))[0].removesuffix(")")
        return f"{value:.3g} {f'({short})' if unit.startswith('(') else short}".replace("-", "−", 1).strip()

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "plain_question": self.question,
            "remedy": self.remedy,
            **self.verdict.to_dict(),
            "tried": [verdict.to_dict() for verdict in self.tried],
        }


@dataclass(frozen=True, eq=False)
class Analysis:
    """All verdicts on one subject, in the order of the questions; iterating gives the findings.

    Parameters
    ----------
    subject : str
        What was analysed.
    findings : tuple of Finding
        One for each question that applies.
    assumptions : tuple of str
        What all of them take for granted, and what was left out and why.
    axes : tuple of str
        Axes that were judged.
    time : ndarray, shape (n,), optional
        Instants of a schedule [s].
    stiffness, damping : ndarray, shape (n, d, d), optional
        Gains that were judged: a schedule's, the corners of a range, or one pair.
    mass : ndarray, shape (d, d) or (n, d, d), optional
        M that was used.
    error : ndarray, shape (n, d), optional
        e of the motion that a schedule came with.
    """

    subject: str
    findings: tuple[Finding, ...]
    assumptions: tuple[str, ...] = ()
    axes: tuple[str, ...] = ()
    time: Array | None = None
    stiffness: Array | None = None
    damping: Array | None = None
    mass: Array | None = field(default=None, repr=False)
    error: Array | None = field(default=None, repr=False)

    def __iter__(self) -> Iterator[Finding]:
        return iter(self.findings)

    def __len__(self) -> int:
        return len(self.findings)

    def __getitem__(self, name: str) -> Verdict:
        """The verdict on a question.

        Raises
        ------
        InputError
            No such question was asked of this subject.
        """
        names = {finding.name: finding.verdict for finding in self.findings}
        return names[one_of("question", name, names)]

    def __contains__(self, name: object) -> bool:
        return any(finding.name == name for finding in self.findings)

    @property
    def verdicts(self) -> dict[str, Verdict]:
        """By the names of their questions."""
        return {finding.name: finding.verdict for finding in self.findings}

    @property
    def worst(self) -> Finding | None:
        """The gravest finding: disproved before inconclusive before proved, the first of those; None without any."""
        return min(self.findings, key=lambda finding: SEVERITY.index(finding.status), default=None)

    def count(self, status: str) -> int:
        """How many questions have this answer."""
        return sum(finding.status == one_of("status", status, SEVERITY) for finding in self.findings)

    def summary(self) -> str:
        """A table in plain words: question, status, margin, and what to do."""
        if not self.findings:
            return "\n".join([f"{self.subject}: no question applies.", *_listed(self.assumptions)])
        head = ("question", "answer", "margin", "what to do")
        rows = [(f.question, f.status, f.margin, f.remedy or "–") for f in self.findings]
        widths = [max(len(row[i]) for row in [head, *rows]) for i in range(3)]
        lines = [self.subject]
        for row in [head, *rows]:
            cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
            lines.append("  ".join([*cells, row[3]]))
        return "\n".join([*lines, *_listed(self.assumptions)])

    def __str__(self) -> str:
        return self.summary()

    def to_dict(self) -> dict[str, Any]:
        """Everything but the gains as plain numbers, texts and lists, for JSON."""
        worst = self.worst
        return {
            "subject": self.subject,
            "worst": None if worst is None else {"name": worst.name, "status": worst.status},
            "axes": list(self.axes),
            "assumptions": list(self.assumptions),
            "findings": [finding.to_dict() for finding in self.findings],
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write :meth:`to_dict` as JSON, as a whole or not at all.

        Raises
        ------
        FileError
            The file cannot be written.
        """
        write_json(path, self.to_dict())


def worst_axis(verdicts: Mapping[str, Verdict]) -> str:
    """The axis with the gravest status, and of those with the smallest margin."""
    order = {
        name: (SEVERITY.index(v.status), np.nan_to_num(v.margin, nan=-np.inf)) for name, v in verdicts.items()
    }
    return min(order, key=lambda one: order[one])


def together(verdicts: Mapping[str, Verdict], *, question: str) -> Verdict:
    """One verdict on several axes: stable if all are, not if one is not. It takes its margin from the worst.

    Parameters
    ----------
    verdicts : mapping of str to Verdict
        By axis.
    question : str
        Asked of all.
    """
    name = worst_axis(verdicts)
    worst = verdicts[name]
    witness: Certificate | CounterExample | None = worst.witness
    if isinstance(witness, Certificate):
        proofs = {axis: v.witness for axis, v in verdicts.items() if isinstance(v.witness, Certificate)}
        slack = min(proof.slack for proof in proofs.values())
        values = {**witness.values, "axes": {axis: proof.values for axis, proof in proofs.items()}}
        witness = replace(witness, values=values, slack=slack)
    every = {
        f"{key}_by_axis": np.array([verdict.values[key] for verdict in verdicts.values()], dtype=np.float64)
        for key, value in worst.values.items()
        if isinstance(value, float) and all(isinstance(v.values.get(key), float) for v in verdicts.values())
    }
    reason = f"{name}: {worst.reason}" if worst.reason else ""
    return Verdict(
        worst.status,
        question,
        worst.method,
        worst.margin,
        worst.margin_unit,
        {"worst_axis": name, **worst.values, **every},
        witness,
        worst.assumptions,
        reason,
    )


def _listed(assumptions: Sequence[str]) -> list[str]:
    return [f"assuming: {text}" for text in assumptions]
