"""What transfers, and to where: every method on the training start, on T1-T4, and on starts all around the arm.

    python -m benchmarks.transfer --out runs/transfer --seeds 3

trains every method in both action spaces, re-optimises the AIRL policies on T1-T4 under their frozen rewards and,
as the control, under untrained random ones, and judges all of them on the same starts. Each run has its own folder
and is resumed where it was stopped; a finished one is not repeated. The tables are written to `--results`
(JSON, Markdown, the sweep's figure), and the last line printed is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from scipy import stats

from vic_toolbox.experiments.configuration import default_configuration
from vic_toolbox.experiments.evaluation import Evaluation, Policy, evaluate
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.start_sweep import Sweep, sweep_starts
from vic_toolbox.experiments.training import train
from vic_toolbox.experiments.transfer import transfer
from vic_toolbox.files import write_atomically, write_json
from vic_toolbox.learning import recipe
from vic_toolbox.tasks import make

TASK = "cup-on-plate"
SCENARIOS = ("train", "T1", "T2", "T3", "T4")
UNSEEN = SCENARIOS[1:]
PAPER = {
    "Gain-AIRL": (0.01, 0.09, 0.01, 0.19, 0.24),
    "Gain-BC": (0.02, 0.17, 0.10, 0.25, 0.36),
    "Force-AIRL": (0.10, 0.55, 0.58, 0.32, 0.26),
    "Force-BC": (0.05, 0.40, 0.20, 0.42, 0.58),
    "Constant gain": (0.14, 0.18, 0.18, 0.17, 0.39),
}
"""Relative score differences that the paper reports (best three of five seeds)."""

FIRST_SEED = 30
"""Smaller seeds were used while the recipes were made; nothing that is reported comes from them."""

FRESH_ITERATIONS, FRESH_DIVERGENCE = 120, 0.03
"""Iterations and first trust region of a transfer that begins with random weights, which has farther to go; one that
continues takes the recipe's."""


@dataclass(frozen=True)
class Cell:
    """One number of the table: a row, a scenario, a seed, and the signed relative difference to the expert."""

    row: str
    scenario: str
    seed: int
    signed: float
    success: float

    @classmethod
    def of(cls, row: str, seed: int, evaluation: Evaluation) -> Cell:
        """The cell of an evaluation."""
        return cls(row, evaluation.scenario, seed, evaluation.signed_difference, evaluation.success_rate)


@dataclass(frozen=True)
class Transferred:
    """A kind of transfer: its row in the table, the reward it is optimised under, and where it starts."""

    row: str
    reward: str
    fresh: bool


TRANSFERS = {
    "gain": (
        Transferred("Gain-AIRL", "learned", False),
        Transferred("Gain-AIRL, fresh policy", "learned", True),
        Transferred("Gain, random reward", "random", False),
        Transferred("Gain, random reward, fresh policy", "random", True),
    ),
    "force": (
        Transferred("Force-AIRL", "learned", False),
        Transferred("Force, random reward", "random", False),
    ),
}


def airl_cells(out: Path, action: str, seed: int) -> Iterator[Cell]:
    """Train, judge without transfer, transfer in every way, judge again."""
    name = action.capitalize()
    source = out / f"{action}-airl-{seed}"
    own = train(default_configuration(TASK, "airl", action=action, seed=seed), source, resume=True, threads=1)
    yield Cell.of(f"{name}-AIRL", seed, own)
    skill = load_skill(source)
    for scenario in UNSEEN:
        judged = evaluate(skill.task(scenario), skill.judged, threads=1)
        yield Cell.of(f"{name}-AIRL, no transfer", seed, judged)
    settings = recipe(TASK, action=action, history=1).transfer
    for kind in TRANSFERS[action]:
        chosen = settings
        if kind.fresh:
            chosen = replace(settings, iterations=FRESH_ITERATIONS, divergence=FRESH_DIVERGENCE)
        for scenario in UNSEEN:
            start = "fresh" if kind.fresh else "continued"
            moved = transfer(
                source,
                scenario,
                out / f"{action}-airl-{seed}-{scenario}-{kind.reward}-{start}",
                fresh=kind.fresh,
                reward=kind.reward,
                seed=seed,
                settings=chosen,
                resume=True,
                threads=1,
            )
            yield Cell.of(kind.row, seed, moved)


def cloning_cells(out: Path, action: str, seed: int) -> Iterator[Cell]:
    """Train by cloning and judge everywhere."""
    folder = out / f"{action}-bc-{seed}"
    train(default_configuration(TASK, "bc", action=action, seed=seed), folder, resume=True, threads=1)
    skill = load_skill(folder)
    for scenario in SCENARIOS:
        judged = evaluate(skill.task(scenario), skill.judged, threads=1)
        yield Cell.of(f"{action.capitalize()}-BC", seed, judged)


def constant_cells(out: Path, action: str, seed: int) -> Iterator[Cell]:
    """Gains in the middle of their range, which need no training."""
    del out, action
    for scenario in SCENARIOS:
        task = make(TASK, scenario=scenario)
        yield Cell.of("Constant gain", seed, evaluate(task, Policy.constant(task), threads=1))


def listed(job: Callable[..., Iterator[Cell]], *arguments: object) -> list[Cell]:
    """All cells of a job, for a worker process to send back."""
    return list(job(*arguments))


def sweep(out: Path, action: str, seed: int) -> Sweep:
    """Trained policies, not transferred, and the constant gain, from starts all around the arm."""
    task = make(TASK, action=action)
    policies = {method: load_skill(out / f"{action}-{method}-{seed}").judged for method in ("airl", "bc")} | {
        "constant": Policy.constant(task)
    }
    return sweep_starts(task, policies)


def interval(values: np.ndarray) -> float:
    """Half width of the 95 % confidence interval of the mean (Student's t)."""
    if len(values) < 2:
        return float("nan")
    return float(stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values)))


def summarise(cells: list[Cell]) -> list[dict]:
    """Mean over the seeds of |difference|, its interval, the signed mean and the success rate, for each cell."""
    found: dict[tuple[str, str], list[Cell]] = {}
    for cell in cells:
        found.setdefault((cell.row, cell.scenario), []).append(cell)
    table = []
    for (row, scenario), group in found.items():
        signed = np.array([cell.signed for cell in group])
        half = interval(np.abs(signed))
        table.append({
            "row": row,
            "scenario": scenario,
            "seeds": len(group),
            "mean": float(np.abs(signed).mean()),
            "half_interval": half if np.isfinite(half) else None,
            "signed_mean": float(signed.mean()),
            "success": float(np.mean([cell.success for cell in group])),
            "paper": PAPER[row][SCENARIOS.index(scenario)] if row in PAPER else None,
            "values": signed.tolist(),
        })  # fmt: skip
    return table


def markdown(table: list[dict], sweeps: dict[tuple[str, int], Sweep], command: str) -> str:
    """The tables as a page."""
    rows = list(dict.fromkeys(entry["row"] for entry in table))
    by_cell = {(entry["row"], entry["scenario"]): entry for entry in table}
    lines = [
        "# Cup-on-Plate: what transfers",
        "",
        f"Made by `{command}`. |score − expert's score| / |expert's score|, mean over the seeds ± half of the 95 %",
        "interval, 20 episodes a cell; (the paper's number, best three of five seeds). Success is 100 % unless given.",
        "",
        "| | " + " | ".join(SCENARIOS) + " |",
        "|---" * (len(SCENARIOS) + 1) + "|",
    ]
    lines += [
        f"| {row} | " + " | ".join(_cell_text(by_cell.get((row, scenario))) for scenario in SCENARIOS) + " |"
        for row in rows
    ]
    lines += [
        "",
        "*Random reward*: the same optimisation under an untrained reward network, the control.",
        f"*Fresh policy*: from random weights, {FRESH_ITERATIONS} iterations; otherwise the trained policy continues.",
        "",
        "## Starts all around the arm, without transfer",
        "",
        "![Relative difference and success over the starts](starts/sweep.svg)",
        "",
        "The figure shows the gain policies of the first seed.",
        "",
    ]
    lines += ["| action | policy | seed | mean difference | worst | success |", "|---|---|---|---|---|---|"]
    for (action, seed), found in sweeps.items():
        lines += [
            f"| {action} | {name} | {seed} | {entry['relative_difference_mean']:.3f} "
            f"| {entry['relative_difference_worst']:.3f} | {100 * entry['success_rate']:.0f} % |"
            for name, entry in found.summary()["methods"].items()
        ]
    return "\n".join(lines) + "\n"


def _cell_text(entry: dict | None) -> str:
    if entry is None:
        return ""
    half = f" ± {entry['half_interval']:.3f}" if entry["half_interval"] is not None else ""
    paper = f" ({entry['paper']:.2f})" if entry["paper"] is not None else ""
    success = "" if entry["success"] == 1.0 else f", {100 * entry['success']:.0f} %"
    return f"{entry['mean']:.3f}{half}{paper}{success}"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path("runs/transfer"), help="folder of the runs")
    parser.add_argument("--results", type=Path, default=Path("docs/results"), help="folder of the tables")
    parser.add_argument("--seeds", type=int, default=3, help=f"number of seeds, from {FIRST_SEED}")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes, one thread each")
    chosen = parser.parse_args()
    seeds = range(FIRST_SEED, FIRST_SEED + chosen.seeds)
    work = [
        (job, chosen.out, action, seed)
        for seed in seeds
        for job, action in (
            (airl_cells, "gain"),
            (airl_cells, "force"),
            (cloning_cells, "gain"),
            (cloning_cells, "force"),
        )
    ] + [(constant_cells, chosen.out, "gain", FIRST_SEED)]
    done: Any = joblib.Parallel(n_jobs=chosen.jobs, verbose=5)(joblib.delayed(listed)(*job) for job in work)
    table = summarise([cell for cells in done for cell in cells])
    sweeps = {
        (action, seed): sweep(chosen.out, action, seed) for action in ("gain", "force") for seed in seeds
    }
    sweeps["gain", FIRST_SEED].write(chosen.results / "starts")
    command = f"python -m benchmarks.transfer --seeds {chosen.seeds}"
    result = {
        "command": command,
        "table": table,
        "sweep": {f"{action} {seed}": found.summary() for (action, seed), found in sweeps.items()},
    }
    write_json(chosen.results / "cup_on_plate.json", result)
    write_atomically(chosen.results / "cup_on_plate.md", markdown(table, sweeps, command))
    print(json.dumps({f"{entry['row']} {entry['scenario']}": round(entry["mean"], 4) for entry in table}))


if __name__ == "__main__":
    main()
