"""What transfers, and to where: every method on the training scenario and on all unseen ones of a task.

    python -m benchmarks.transfer cup-on-plate --out runs/transfer --seeds 3

trains every method in both action spaces, re-optimises the AIRL policies on the unseen scenarios under their frozen
rewards and, as the control, under untrained random ones, and judges all of them on the same starts. Each run has its
own folder and is resumed where it was stopped; a finished one is not repeated. The tables are written to `--results`
(JSON, Markdown, figures of the sweeps), and the last line printed is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from benchmarks.studies import STUDIES, TRANSFERS, Study, Transferred
from benchmarks.transfer_tables import Cell, Swept, markdown, summarise
from vic_toolbox.experiments.configuration import RunConfiguration, default_configuration
from vic_toolbox.experiments.difficulty import sweep_difficulty
from vic_toolbox.experiments.evaluation import Policy, baselines, evaluate, judge
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.skill import Skill, load_skill
from vic_toolbox.experiments.start_sweep import sweep_starts
from vic_toolbox.experiments.training import train
from vic_toolbox.experiments.transfer import transfer
from vic_toolbox.files import write_atomically, write_json
from vic_toolbox.tasks import Task, make

DITHER = 0.3
"""Noise of the dither baseline on every action, of the middle of the range (normalised action)."""


@dataclass(frozen=True)
class Job:
    """One source of cells: a method with its action space, history and seed."""

    study: Study
    out: Path
    method: str
    action: str = "gain"
    history: int = 1
    seed: int = 0

    @property
    def folder(self) -> Path:
        """Folder of its training run."""
        history = "" if self.history == 1 else f"-history{self.history}"
        return self.out / f"{self.action}-{self.method}{history}-{self.seed}"

    @property
    def row(self) -> str:
        """Name of its row."""
        history = "" if self.history == 1 else f", history {self.history}"
        return f"{self.action.capitalize()}-{self.method.upper()}{history}"

    def configuration(self) -> RunConfiguration:
        """Configuration of its training run."""
        return default_configuration(
            self.study.task,
            self.method,
            action=self.action,
            history=self.history,
            seed=self.seed,
            episodes=self.study.episodes,
        )

    def trained(self) -> Skill:
        """The trained policy."""
        train(self.configuration(), self.folder, resume=True, threads=1)
        return load_skill(self.folder)

    def judged(self, skill: Skill, row: str, scenarios: tuple[str, ...]) -> Iterator[Cell]:
        """Cells of a policy that is not transferred."""
        for scenario in scenarios:
            result = evaluate(skill.task(scenario), skill.judged, episodes=self.study.episodes, threads=1)
            yield Cell.of(row, self.seed, result)


def airl_cells(job: Job) -> Iterator[Cell]:
    """Train, judge without transfer, transfer in every way, judge again."""
    skill = job.trained()
    yield from job.judged(skill, job.row, job.study.scenarios[:1])
    yield from job.judged(skill, f"{job.row}, no transfer", job.study.unseen)
    for kind in TRANSFERS[job.action, job.history]:
        for scenario in job.study.unseen:
            yield _transferred(job, skill, kind, scenario)


def _transferred(job: Job, skill: Skill, kind: Transferred, scenario: str) -> Cell:
    settings = skill.run.recipe.transfer
    if kind.fresh:
        study = job.study
        settings = replace(settings, iterations=study.fresh_iterations, divergence=study.fresh_divergence)
    start = "fresh" if kind.fresh else "continued"
    moved = transfer(
        job.folder,
        scenario,
        job.folder.with_name(f"{job.folder.name}-{scenario}-{kind.reward}-{start}"),
        fresh=kind.fresh,
        reward=kind.reward,
        seed=job.seed,
        settings=settings,
        episodes=job.study.episodes,
        resume=True,
        threads=1,
    )
    return Cell.of(kind.row, job.seed, moved)


def cloning_cells(job: Job) -> Iterator[Cell]:
    """Train by cloning and judge everywhere."""
    yield from job.judged(job.trained(), job.row, job.study.scenarios)


def baseline_cells(job: Job) -> Iterator[Cell]:
    """The expert, every constant gain, and dither about the middle of the range: nothing of it is trained."""
    for scenario in job.study.scenarios:
        task = make(job.study.task, scenario=scenario)
        noise = np.random.default_rng(job.seed)
        untrained = {
            "Expert": Policy.expert(task),
            **{_constant_row(name): policy for name, policy in baselines(task).items()},
            "Dither": Policy(partial(_dither, task, noise), "dither"),
        }
        for row, result in judge(task, untrained, episodes=job.study.episodes, threads=1).items():
            yield Cell.of(row, job.seed, result)


def _dither(task: Task, noise: np.random.Generator, observations: np.ndarray) -> np.ndarray:
    return DITHER * noise.standard_normal((len(observations), task.action_size))


def _constant_row(name: str) -> str:
    label = style.look(name).label
    return label[0].upper() + label[1:]  # "Constant gain", as in the paper's table


def listed(cells: Callable[[Job], Iterator[Cell]], job: Job) -> list[Cell]:
    """All cells of a job, for a worker process to send back."""
    return list(cells(job))


def jobs(study: Study, out: Path, seeds: range) -> list[tuple[Callable[[Job], Iterator[Cell]], Job]]:
    """Everything that there is to do, the longest first."""
    work: list[tuple[Callable[[Job], Iterator[Cell]], Job]] = []
    for method, cells in (("airl", airl_cells), ("bc", cloning_cells)):
        for action in ("gain", "force"):
            for history in study.histories:
                work += [(cells, Job(study, out, method, action, history, seed)) for seed in seeds]
    return [*work, (baseline_cells, Job(study, out, "none", seed=seeds[0]))]


def sweep(study: Study, out: Path, quantity: str, action: str, seed: int) -> Swept:
    """Trained policies of one observation, not transferred, beside the baselines over a sweep."""
    task: Task = make(study.task, action=action)
    policies = {
        method: load_skill(Job(study, out, method, action, 1, seed).folder).judged
        for method in ("airl", "bc")
    }
    if quantity == "start":
        return sweep_starts(task, policies | baselines(task))
    return sweep_difficulty(task, policies, quantity, threads=1)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("task", choices=STUDIES)
    parser.add_argument("--out", type=Path, help="folder of the runs; by default runs/transfer-TASK")
    parser.add_argument("--results", type=Path, default=Path("docs/results"), help="folder of the tables")
    parser.add_argument("--seeds", type=int, default=3, help="number of seeds")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes, one thread each")
    chosen = parser.parse_args()
    study = STUDIES[chosen.task]
    out = chosen.out or Path("runs") / f"transfer-{study.task}"
    seeds = range(study.first_seed, study.first_seed + chosen.seeds)
    parallel: Any = joblib.Parallel(n_jobs=chosen.jobs, verbose=5)
    done = parallel(joblib.delayed(listed)(*work) for work in jobs(study, out, seeds))
    table = summarise([cell for cells in done for cell in cells], study)
    which = [
        (quantity, action, seed)
        for quantity in study.sweeps
        for action, some in (("gain", seeds), ("force", seeds[:1]))
        for seed in some
    ]
    found = parallel(joblib.delayed(sweep)(study, out, *key) for key in which)
    sweeps: dict[tuple[str, str, int], Swept] = dict(zip(which, found, strict=True))
    for quantity in study.sweeps:
        sweeps[quantity, "gain", study.first_seed].write(chosen.results / study.file / quantity)
    command = f"python -m benchmarks.transfer {study.task} --seeds {chosen.seeds}"
    result = {
        "command": command,
        "table": table,
        "sweep": {" ".join(map(str, key)): swept.summary() for key, swept in sweeps.items()},
    }
    write_json(chosen.results / f"{study.file}.json", result)
    write_atomically(chosen.results / f"{study.file}.md", markdown(study, table, sweeps, command))
    print(json.dumps({f"{entry['row']} {entry['scenario']}": round(entry["mean"], 4) for entry in table}))


if __name__ == "__main__":
    main()
