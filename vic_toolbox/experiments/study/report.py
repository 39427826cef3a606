"""Everything that a reader gets of a study: the tables as HTML, Markdown and JSON, with their figures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.report import Figure
from vic_toolbox.experiments.study import markdown, page, results_json
from vic_toolbox.experiments.study.folder import Result, StudyFolder
from vic_toolbox.experiments.study.pictures import draw
from vic_toolbox.experiments.study.provenance import Provenance
from vic_toolbox.experiments.study.sweeps import StartSweep, start_sweep
from vic_toolbox.experiments.study.table import ResultTable, make_tables
from vic_toolbox.experiments.task_views import Drawing
from vic_toolbox.files import write_atomically, write_json


def report(folder: StudyFolder, out: str | os.PathLike[str]) -> tuple[ResultTable, ...]:
    """Write the report of a study, finished or not.

    ==================  =================================================================
    ``report.html``     tables, findings and figures on one page that needs no other file
    ``NAME.md``         the tables and findings; its figures are in ``NAME_figures/``
    ``NAME.json``       the tables as a list of cells, for programs
    ==================  =================================================================

    NAME is that of the study. Every file is replaced as a whole; other files in `out` stay as they are.

    Parameters
    ----------
    folder : StudyFolder
        The study.
    out : path-like
        Folder to write to.

    Returns
    -------
    tuple of ResultTable
        The tables.

    Raises
    ------
    FileError
        A result or a run is damaged, or a file cannot be written.
    """
    out, study, results = Path(out), folder.definition, folder.results()
    failed = {cell.name for cell in folder.cells if cell.name not in results and folder.failure(cell.name)}
    tables = make_tables(study, folder.plan, results, failed=failed)
    provenance = Provenance.of(study, results)
    pictures = draw(folder, tables, results)
    figures = _save({**pictures.by_table, "": pictures.general}, out / f"{study.name}_figures")
    sweeps = {table.name: _sweeps(folder, results, table) for table in tables}
    write_json(out / f"{study.name}.json", results_json.cells(tables))
    text = markdown.page(study.title, tables, provenance, sweeps=sweeps, figures=figures, folder=out)
    write_atomically(out / f"{study.name}.md", text)
    page.write_page(
        out / "report.html",
        study,
        tables,
        provenance,
        sweeps=sweeps,
        figures=figures,
        notes=pictures.left_out,
    )
    return tables


def _sweeps(folder: StudyFolder, results: Mapping[str, Result], table: ResultTable) -> Sequence[StartSweep]:
    found = start_sweep(folder.plan, results, table.name)
    return [] if found is None else [found]


def _save(drawings: Mapping[str, Sequence[Drawing]], folder: Path) -> dict[str, list[Figure]]:
    """Save every drawing; figures of an earlier report that are not among them go."""
    figures = {
        table: [
            Figure(style.save(drawing.figure, folder / f"{drawing.file}.svg"), drawing.title, drawing.caption)
            for drawing in drawn
        ]
        for table, drawn in drawings.items()
    }
    kept = {figure.path for drawn in figures.values() for figure in drawn}
    for path in folder.glob("*.svg"):
        if path not in kept:
            path.unlink()
    return figures
