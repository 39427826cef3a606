"""The demonstration: a skill learned from an expert and carried to an unseen start, in a few minutes."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from vic_toolbox.experiments.configuration import RunConfiguration, default_configuration
from vic_toolbox.experiments.demo_report import write_demo_report
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.skill import Skill, load_skill
from vic_toolbox.experiments.training import train
from vic_toolbox.experiments.transfer import transfer

TASK, UNSEEN = "cup-on-plate", "T1"


@dataclass(frozen=True)
class DemoConfiguration:
    """What the demonstration does."""

    seed: int = 0
    """Of everything."""
    quick: bool = False
    """A tenth of the learning: shows how it works, not how well."""
    minutes: float = 5.0
    """Time that the demonstration should not exceed [min]; learning stops early where the machine is slow."""


@dataclass(frozen=True)
class Demo:
    """A finished demonstration: its report, and what to type next."""

    report: Path
    next_steps: list[tuple[str, str]]


def run_demo(
    configuration: DemoConfiguration,
    out: str | os.PathLike[str],
    *,
    threads: int = 0,
    progress: Progress | None = None,
) -> Demo:
    """Demonstrations, cloning, imitation, transfer, report; goes on where an earlier attempt stopped.

    Raises
    ------
    FileError
        `out` holds something else, or a demonstration with another configuration.
    KeyboardInterrupt
        Ctrl-C; the same call goes on from there.
    """
    progress = progress or Progress()
    with RunFolder.create(out, "demo", asdict(configuration), resume=True) as folder:
        steps = _next_steps(folder.path)
        if folder.complete:
            progress.say(f"{folder.path} is complete already.")
            return Demo(folder.path / "report.html", steps)
        seconds = 60.0 * configuration.minutes
        shared = {"threads": threads, "progress": progress, "resume": True}
        for method in ("bc", "constant"):
            train(_configuration(configuration, method), folder.path / method, **shared)
        train(_configuration(configuration, "airl"), folder.path / "airl", seconds=0.55 * seconds, **shared)
        transfer(
            folder.path / "airl",
            UNSEEN,
            folder.path / f"airl-{UNSEEN}",
            seed=configuration.seed,
            seconds=0.15 * seconds,
            **shared,
        )
        progress.stage("film and report")
        folders = {"airl": "airl", "bc": "bc", "constant": "constant", "transfer": f"airl-{UNSEEN}"}
        skills = {look: load_skill(folder.path / name) for look, name in folders.items()}
        write_demo_report(
            folder.path / "report.html",
            skills,
            unseen=UNSEEN,
            notes=_notes(skills["airl"], configuration),
            next_steps=steps,
            threads=threads,
        )
    return Demo(folder.path / "report.html", steps)


def _configuration(demo: DemoConfiguration, method: str) -> RunConfiguration:
    run = default_configuration(TASK, method, seed=demo.seed)
    if not demo.quick:
        return run
    recipe = run.recipe
    return replace(
        run,
        recipe=replace(
            recipe,
            airl=replace(recipe.airl, iterations=max(recipe.airl.iterations // 10, 1)),
            transfer=replace(recipe.transfer, iterations=max(recipe.transfer.iterations // 10, 1)),
            cloning=replace(recipe.cloning, steps=max(recipe.cloning.steps // 10, 1)),
        ),
    )


def _notes(airl: Skill, demo: DemoConfiguration) -> list[str]:
    """What the reader must know about a demonstration that learned less than it could."""
    if demo.quick:
        return ["This was a quick run with a tenth of the learning: it shows how it works, not how well."]
    done, wanted = airl.folder.metrics()[-1]["iteration"], airl.run.recipe.airl.iterations
    if done >= wanted:
        return []
    return [
        f"Learning stopped after {done} of {wanted} iterations, its share of the demonstration's {demo.minutes:g} "
        "minutes; vic train has no such limit."
    ]


def _next_steps(out: Path) -> list[tuple[str, str]]:
    return [
        (
            f"vic transfer {out}/airl --scenario T3 --out {out}/airl-T3",
            "Carry the skill to another unseen start.",
        ),
        (
            f"vic evaluate {out}/airl --sweep start --against {out}/bc",
            "Judge it and the cloned policy from starts all around the arm.",
        ),
        (
            f"vic train {TASK} --method airl --action force --out runs/force",
            "Learn the same task with a policy that sets forces instead of gains.",
        ),
    ]
