"""The tables of a study as a Markdown page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from vic_toolbox.experiments import report
from vic_toolbox.experiments.study.comparison import standing
from vic_toolbox.experiments.study.findings import Finding, headline, of_table
from vic_toolbox.experiments.study.provenance import Provenance
from vic_toolbox.experiments.study.sweeps import StartSweep
from vic_toolbox.experiments.study.table import ResultTable, TableCell, TableRow
from vic_toolbox.experiments.study.wording import asides, called, missing_text, reading


def page(
    title: str,
    tables: Sequence[ResultTable],
    provenance: Provenance,
    *,
    sweeps: Mapping[str, Sequence[StartSweep]],
    figures: Mapping[str, Sequence[report.Figure]],
    folder: Path,
) -> str:
    """The page.

    Parameters
    ----------
    title : str
        Of the study.
    tables : sequence of ResultTable
        With their results.
    provenance : Provenance
        What made them.
    sweeps : mapping
        Sweeps over starts by the name of their table.
    figures : mapping
        Figures by the name of their table; those of no table under "".
    folder : Path
        Where the page will lie.
    """
    lines = [
        f"# {title}",
        "",
        f"Made by `{provenance.command}` ({provenance.text}).",
        "",
        headline(tables),
        "",
        reading(tables),
        "",
    ]
    for table in tables:
        lines += [f"## Table {table.name}. {table.definition.title}", "", *_methods(table), ""]
        lines += _findings(list(of_table(table)))
        lines += _controls(table)
        for swept in sweeps.get(table.name, ()):
            lines += _starts(swept)
        lines += _images(figures.get(table.name, ()), folder)
    if general := figures.get(""):
        lines += ["## How the policies learn, and what they do", "", *_images(general, folder)]
    return "\n".join(lines).rstrip() + "\n"


def _methods(table: ResultTable) -> Iterator[str]:
    yield f"{table.metric.label[0].upper()}{table.metric.label[1:]}."
    yield ""
    yield from _grid(table, table.of_role("method"))


def _controls(table: ResultTable) -> Iterator[str]:
    for title, role in (("Controls", "control"), ("With half the physics time step", "check")):
        if rows := table.of_role(role):
            yield from (f"### {title}", "", *_grid(table, rows), "")


def _grid(table: ResultTable, rows: Iterable[TableRow]) -> Iterator[str]:
    columns = [where for where in table.scenarios if any(where in row.cells for row in rows)]
    yield "| | " + " | ".join(map(called, columns)) + " |"
    yield "|---" * (len(columns) + 1) + "|"
    for row in rows:
        cells = (_text(table, row.cells[where]) if where in row.cells else "" for where in columns)
        yield f"| {row.name} | " + " | ".join(cells) + " |"


def _text(table: ResultTable, cell: TableCell) -> str:
    """A cell; its second line is what stands beside the mean."""
    found = cell.estimate
    if found is None:
        return f"– ({missing_text(cell)})"
    mean = table.metric.text(found.mean)
    lines = [f"**{mean}**" if standing(table, cell) == "reached" else mean]
    if found.low is not None and found.high is not None:
        lines.append(table.metric.interval_text(found.low, found.high))
    return "<br>".join([*lines, *asides(table, cell)]).replace(" ", "\N{NO-BREAK SPACE}")


def _findings(found: Sequence[Finding]) -> Iterator[str]:
    for title, kinds in (("What falls short", ("alarm", "warning")), ("What holds", ("note",))):
        chosen = [finding for finding in found if finding.kind in kinds]
        if chosen:
            yield from (f"**{title}**", "")
            yield from (f"- {finding.text} {finding.more}".rstrip() for finding in chosen)
            yield ""


def _starts(swept: StartSweep) -> Iterator[str]:
    yield from (f"### {swept.title}", "", swept.caption, "")
    yield "| " + " | ".join(swept.head) + " |"
    yield "|---" * len(swept.head) + "|"
    yield from ("| " + " | ".join(row) + " |" for row in swept.rows)
    yield ""


def _images(figures: Sequence[report.Figure], folder: Path) -> Iterator[str]:
    for figure in figures:
        yield from (f"![{figure.title}]({figure.path.relative_to(folder).as_posix()})", "")
        yield from (f"*{figure.title}.* {figure.caption}", "")
