"""How fast a study runs: two workers against one, and the hours of the whole paper: ``python -m benchmarks.study``.

The ratio is of whole runs, start of the workers included, over the same cells: AIRL on Peg-in-Hole, alike but for the
seed. The hours come from one cell of every sort in ``studies/paper.toml``: one seed, one unseen scenario, with a few
iterations of each learner; the time of an iteration is multiplied by the iterations that the study asks for, and
that of a sweep by its episodes. Restarts of AIRL, which the study allows, are not in it. The last line is one JSON
object.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.definition import Budget, Study, load
from vic_toolbox.experiments.study.engines import JoblibEngine
from vic_toolbox.experiments.study.execution import execute
from vic_toolbox.experiments.study.folder import Result, StudyFolder
from vic_toolbox.experiments.study.plan import Plan, make_plan
from vic_toolbox.experiments.study.timing import duration

CORES = 4
"""For how many the hours are told."""
SHORT = {"iterations": 12, "transfer_iterations": 6, "fresh_iterations": 6, "sweep_episodes": 4}
"""Budget of the sample."""


def equal_cells(count: int, iterations: int) -> Study:
    """A study of so many trainings that take alike."""
    paper = load("paper")
    table = replace(
        paper.table[0],
        scenarios=("train",),
        methods=("airl",),
        actions=("gain",),
        histories=(1,),
        controls=(),
        halved_step=(),
        sweeps=(),
        paper={},
    )
    budget = Budget(episodes=2, iterations=iterations, demonstrations=10, held_out=2)
    return replace(paper, seeds=tuple(range(count)), table=(table,), budget={table.task: budget})


def wall_time(study: Study, folder: Path, workers: int) -> float:
    """Time that so many workers need for a study [s]."""
    began = time.perf_counter()
    with StudyFolder.create(folder, study) as there:
        summary = execute(there, JoblibEngine(workers))
    if not summary.complete:
        raise SystemExit(f"a cell failed: {summary.failures[0].tracebacks[-1]}")
    return time.perf_counter() - began


def sample_of(study: Study) -> Study:
    """One cell of every sort, with a short budget."""
    tables = []
    for table in study.table:
        unseen = next(scenario for scenario in table.scenarios if scenario != "train")
        halved = (unseen,) if table.halved_step else ()
        tables.append(replace(table, scenarios=("train", unseen), halved_step=halved, paper={}))
    budgets = {table.task: replace(study.budget_of(table.task), **SHORT) for table in study.table}
    return replace(study, seeds=study.seeds[:1], table=tuple(tables), budget=budgets)


def sort_of(cell: Cell, study: Study) -> str:
    """The name of a cell without its seed and its scenario: cells of a sort take alike."""
    name = re.sub(r"-?seed\d+", "", cell.name)
    scenarios = {scenario for table in study.table for scenario in table.scenarios}
    for scenario in sorted(scenarios, key=len, reverse=True):
        name = name.replace(f"/{scenario}", "/*")
    return name


def whole_time(cell: Cell, sample: Result, folder: Path, plans: tuple[Plan, Plan]) -> float:
    """Time of a cell with its whole budget, from that of a short one [s]."""
    if cell.kind == "sweep":
        whole, short = plans
        return sample.seconds * whole.effort[cell.name] / short.effort[sample.cell.name]
    iterations = _iterations(cell)
    if not iterations:
        return sample.seconds
    last = RunFolder.open(folder / "run").metrics()[-1]
    return sample.seconds + (iterations - last["iteration"]) * last["seconds"] / last["iteration"]


def _iterations(cell: Cell) -> int:
    """Iterations of a learner; 0 where there is none."""
    if cell.kind == "transfer":
        return cell.settings["transfer"]["iterations"]
    if cell.kind == "train" and cell.settings["method"] == "airl":
        return cell.settings["recipe"]["airl"]["iterations"]
    return 0


def extrapolate(study: Study, folder: StudyFolder) -> dict[str, list[float]]:
    """Times of all cells of a study by kind [s], from its sample."""
    plan, samples = make_plan(study), {}
    for result in folder.results().values():
        samples[sort_of(result.cell, study)] = result
    times: dict[str, list[float]] = {}
    for cell in plan.cells:
        sample = samples[sort_of(cell, study)]
        path = folder.cell_path(sample.cell.name)
        times.setdefault(cell.kind, []).append(whole_time(cell, sample, path, (plan, folder.plan)))
    return times


def per_hour(times: Iterable[float]) -> float:
    """Cells that one core does in an hour."""
    times = list(times)
    return 3600.0 * len(times) / sum(times)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cells", type=int, default=8, help="cells of the ratio; an even number")
    parser.add_argument("--iterations", type=int, default=30, help="iterations of each of them")
    parser.add_argument("--study", default="paper", help="the study whose hours are told: a file or a name")
    parser.add_argument(
        "--jobs", type=int, default=0, help="workers for the sample; 0: one for each processor"
    )
    chosen = parser.parse_args()
    result: dict[str, object] = {}
    with tempfile.TemporaryDirectory(prefix="vic-benchmark-") as temporary:
        equal = equal_cells(chosen.cells, chosen.iterations)
        seconds = {count: wall_time(equal, Path(temporary) / str(count), count) for count in (1, 2)}
        result["two_over_one"] = round(seconds[1] / seconds[2], 3)
        print(f"{chosen.cells} cells: one worker {seconds[1]:.1f} s, two {seconds[2]:.1f} s", flush=True)
        study = load(chosen.study)
        with StudyFolder.create(Path(temporary) / "sample", sample_of(study)) as folder:
            print(f"a sample of {len(folder.cells)} cells ...", flush=True)
            summary = execute(folder, JoblibEngine(chosen.jobs))
            if not summary.complete:
                raise SystemExit(f"a cell failed: {summary.failures[0].tracebacks[-1]}")
            times = extrapolate(study, folder)
    total = sum(map(sum, times.values()))
    for kind, each in times.items():
        print(
            f"{kind}: {len(each)} cells, {per_hour(each):.0f} an hour and core, {duration(sum(each))} in all"
        )
    result["cells_per_core_hour"] = {kind: round(per_hour(each), 1) for kind, each in times.items()}
    result["cells"] = sum(map(len, times.values()))
    result["core_hours"] = round(total / 3600.0, 2)
    result[f"hours_on_{CORES}_cores"] = round(total / 3600.0 / CORES, 2)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
