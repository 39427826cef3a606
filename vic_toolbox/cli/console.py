"""What the commands print: results to standard output, progress to standard error."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from vic_toolbox.experiments.evaluation import Evaluation
    from vic_toolbox.experiments.progress import ConsoleProgress

_WITHOUT_TERMINAL = 200  # columns of a table that goes to a file or a pipe


def console_progress() -> ConsoleProgress:
    """Progress bars on standard error."""
    from vic_toolbox.experiments.progress import ConsoleProgress

    return ConsoleProgress(Console(stderr=True))


def say(text: str) -> None:
    """Print plain text."""
    Console().print(text, markup=False, highlight=False, soft_wrap=True)


def complain(text: str) -> None:
    """Print plain text to standard error."""
    Console(stderr=True).print(text, markup=False, highlight=False, soft_wrap=True)


def print_result(row: Evaluation, folder: Path) -> None:
    """Print an evaluation in a line, and where its report is."""
    from vic_toolbox.experiments.wording import score_text, success_text

    side = "worse" if row.signed_difference > 0 else "better"
    say(
        f"{row.scenario}: score {score_text(row.score_mean)} ± {score_text(row.score_std)}, "
        f"expert {score_text(row.expert_score)}, relative difference {row.relative_difference:.3f} ({side}), "
        f"success {success_text(row)} of {row.episodes}\n{folder / 'report.html'}"
    )


def print_start_sweep(summary: dict[str, Any], folder: Path) -> None:
    """Print the summary of a sweep over starts, and where its files are."""
    rows = []
    for name, method in summary["methods"].items():
        mean, worst = method["relative_difference_mean"], method["relative_difference_worst"]
        rows.append((name, f"{mean:.3f}", f"{worst:.3f}", f"{100 * method['success_rate']:.0f} %"))
    print_table(("policy", "relative difference", "worst", "success"), rows)
    say(f"{summary['starts']} starts; {folder / 'sweep.svg'}, sweep.csv, sweep.json")


def print_difficulty(summary: dict[str, Any], folder: Path) -> None:
    """Print the success of each method at each value of a sweep, and where its files are."""
    rows = [
        (name, f"{method['area']:.2f}", *(f"{100 * rate:.0f}" for rate in method["success"]))
        for name, method in summary["methods"].items()
    ]
    print_table(("success [%]", "area", *(f"{value:g}" for value in summary["values"])), rows)
    say(
        f"{summary['label']}, {summary['episodes']} episodes at each value; "
        f"{folder / 'sweep.svg'}, sweep.csv, sweep.json"
    )


def print_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print aligned columns."""
    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 3, 0, 0))
    for cell in head:
        table.add_column(Text(cell))
    for row in rows:
        table.add_row(*map(Text, row))
    console = Console()
    (console if console.is_terminal else Console(width=_WITHOUT_TERMINAL)).print(table)
    say("")
