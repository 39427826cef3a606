"""Numbers as reports and the console write them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vic_toolbox.experiments.evaluation import Evaluation


def score_text(score: float) -> str:
    """A score with one decimal, or with three digits where it is small."""
    return f"{score:.1f}" if abs(score) >= 20.0 else f"{score:.3g}"


def short_score_text(score: float) -> str:
    """A score in few digits, for a line that changes."""
    return f"{score:.0f}" if abs(score) >= 100.0 else f"{score:.3g}"


def success_text(row: Evaluation) -> str:
    """The success rate with its 95 % interval."""
    return f"{100 * row.success_rate:.0f} % ({100 * row.success_low:.0f}–{100 * row.success_high:.0f})"
