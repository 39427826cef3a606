"""The report of a study as one HTML page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from vic_toolbox.experiments import report
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.experiments.study.comparison import standing, standings, subjects
from vic_toolbox.experiments.study.definition import Study
from vic_toolbox.experiments.study.findings import headline, of_table
from vic_toolbox.experiments.study.provenance import Provenance
from vic_toolbox.experiments.study.sweeps import StartSweep
from vic_toolbox.experiments.study.table import ResultTable, TableCell, TableRow
from vic_toolbox.experiments.study.wording import asides, called, missing_text, reading

Figures = Mapping[str, Sequence[report.Figure]]
"""By the name of their table; those of no table under ""."""


@dataclass(frozen=True)
class Chapter:
    """A heading above several sections."""

    title: str

    def html(self) -> str:
        """The element."""
        return f"<h2 class=chapter>{escape(self.title)}</h2>"


@dataclass(frozen=True)
class ResultGrid:
    """Rows of a table with intervals, the paper's numbers and what falls short of them."""

    title: str
    table: ResultTable
    rows: Sequence[TableRow]
    caption: str = ""

    def html(self) -> str:
        """The element."""
        columns = [where for where in self.table.scenarios if any(where in row.cells for row in self.rows)]
        head = "".join(f"<th>{escape(text)}</th>" for text in ("", *map(called, columns)))
        body = "".join(
            f"<tr><td>{escape(row.name)}</td>{''.join(self._cell(row.cells.get(where)) for where in columns)}</tr>"
            for row in self.rows
        )
        grid = f"<div class=scroll><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        return report.section(
            self.title, grid + f"<p class=caption>{escape(self.caption)}</p>" * bool(self.caption)
        )

    def _cell(self, cell: TableCell | None) -> str:
        if cell is None:
            return "<td></td>"
        found = cell.estimate
        if found is None:
            return f"<td class=missing>{escape(missing_text(cell))}</td>"
        metric = self.table.metric
        interval = (
            "" if found.low is None or found.high is None else metric.interval_text(found.low, found.high)
        )
        small = "".join(
            f"<small>{escape(text)}</small>" for text in (interval, *asides(self.table, cell)) if text
        )
        kind = standing(self.table, cell)
        return f"<td{f' class={kind}' if kind else ''}><b>{escape(metric.text(found.mean))}</b>{small}</td>"


def write_page(
    path: Path,
    study: Study,
    tables: Sequence[ResultTable],
    provenance: Provenance,
    *,
    sweeps: Mapping[str, Sequence[StartSweep]],
    figures: Figures,
    notes: Sequence[str] = (),
) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
        The HTML file.
    study : Study
        What was done.
    tables : sequence of ResultTable
        With their results.
    provenance : Provenance
        What made them.
    sweeps : mapping
        Sweeps over starts by the name of their table.
    figures : mapping
        Figures by the name of their table; those of no table under "".
    notes : sequence of str
        What else the reader must know.

    Raises
    ------
    FileError
        The page cannot be written.
    """
    parts: list[report.Part] = [report.Note(text) for text in (*notes, reading(tables))]
    for table in tables:
        parts += _table_parts(table, sweeps.get(table.name, ()), figures.get(table.name, ()))
    if figures.get(""):
        parts += [Chapter("How the policies learn, and what they do"), *figures[""]]
    report.write_report(
        path,
        title=study.title,
        subtitle=provenance.text,
        summary=headline(tables),
        tiles=_tiles(study, tables),
        parts=[
            *parts,
            report.Commands("Make it again", _commands(provenance)),
            report.Settings("The definition of the study", flatten(study.to_json())),
        ],
        footer="Scores are of the policies' mean actions; every seed counts.",
    )


def _table_parts(
    table: ResultTable, sweeps: Sequence[StartSweep], figures: Sequence[report.Figure]
) -> Iterator[report.Part]:
    yield Chapter(f"Table {table.name}. {table.definition.title}")
    label = f"{table.metric.label[0].upper()}{table.metric.label[1:]}"
    yield ResultGrid("Methods", table, table.of_role("method"), f"{label}.{_LEGEND * _has_paper(table)}")
    found = list(of_table(table))
    for title, kinds in (("What falls short", ("alarm", "warning")), ("What holds", ("note",))):
        if items := [
            (finding.kind, finding.text, finding.more) for finding in found if finding.kind in kinds
        ]:
            yield report.Remedies(title, items)
    for title, role in (("Controls", "control"), ("With half the physics time step", "check")):
        if rows := table.of_role(role):
            yield ResultGrid(title, table, rows)
    for swept in sweeps:
        yield report.Table(swept.title, swept.head, swept.rows, caption=swept.caption)
    yield from figures


_LEGEND = " Blue: at least the paper's number. Tinted: below it; with a bar, its whole interval is."


def _has_paper(table: ResultTable) -> bool:
    return any(cell.paper is not None for row in table.rows for cell in row.cells.values())


def _tiles(study: Study, tables: Sequence[ResultTable]) -> list[tuple[str, str]]:
    cells = [cell for table in tables for row in table.rows for cell in row.cells.values()]
    tiles = [
        (f"{len(study.seeds)}", "seeds, all of which count"),
        (f"{sum(cell.done for cell in cells)} of {sum(cell.wanted for cell in cells)}", "results are there"),
    ]
    for name in dict.fromkeys(row.name for table in tables for row in subjects(table)):
        said = [
            s
            for table in tables
            for row in subjects(table)
            if row.name == name
            for s in standings(table, row).values()
        ]
        if said:
            tiles.append(
                (f"{said.count('reached')} of {len(said)}", f"cells in which {name} reaches the paper")
            )
    return tiles[:6]


def _commands(provenance: Provenance) -> list[tuple[str, str]]:
    return [
        (
            provenance.command,
            "Everything; the same numbers whatever the number of processes, killed and resumed or not.",
        ),
        ("vic study report DIR --out OUT", "Tables and figures of what is there."),
    ]
