"""The figures of the tables on the digital twin."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from vic_toolbox.experiments.deployed import TRACES, Traces
from vic_toolbox.experiments.figures.sim_to_real import velocity_responses
from vic_toolbox.experiments.study.folder import Result, StudyFolder
from vic_toolbox.experiments.study.learners import CARRIED
from vic_toolbox.experiments.study.table import ResultTable
from vic_toolbox.experiments.task_views import Drawing


def velocity_drawings(
    folder: StudyFolder, table: ResultTable, results: Mapping[str, Result]
) -> Iterator[Drawing]:
    """Velocity responses of every learned policy of a table of deviations, one drawing for each start.

    Of each row the first seed that is done. Drawn once, for the table of mean deviations: the motions are those of the
    table of final deviations too.
    """
    if table.definition.metric != "deviation":
        return
    for start in table.scenarios:
        traces = _traces(folder, table, results, start)
        if traces:
            yield Drawing(
                f"sim-to-real-{start}",
                f"From simulation to the digital twin: {'the training start' if start == 'train' else start}",
                "The human that the policies learned from, on the twin (pale), each policy on the twin (blue), and the "
                "same policy in the nominal simulation (dashed), all from the same posture; AIRL at a new start after "
                "its transfer. Where blue and dashed "
                "agree, the policy does not mind that the robot is another one. First seed.",
                velocity_responses(traces),
            )


def _traces(
    folder: StudyFolder, table: ResultTable, results: Mapping[str, Result], start: str
) -> dict[str, Traces]:
    """By row; methods and the fits beside them, without what is not learned."""
    found: dict[str, Traces] = {}
    endings = tuple(f", {words}" for words, *_ in CARRIED.values())
    for entry in folder.plan.entries:
        mine = entry.table == table.name and entry.scenario == start and entry.method in ("airl", "bc")
        mine = mine and not entry.row.endswith(endings)  # one row for each way of learning is enough
        file = folder.cell_path(entry.cell) / TRACES
        if mine and entry.row not in found and entry.cell in results and file.is_file():
            found[entry.row] = Traces.load(file)
    return found
