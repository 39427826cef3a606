"""The demonstration: a skill learned from an expert and carried to an unseen start, in a few minutes."""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from vic_toolbox.experiments import report
from vic_toolbox.experiments.configuration import RunConfiguration, default_configuration, flatten
from vic_toolbox.experiments.evaluation import Evaluation, Policy, judge
from vic_toolbox.experiments.figures import learning, style
from vic_toolbox.experiments.figures.reward import reward_landscape
from vic_toolbox.experiments.film import film
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.report_parts import draw, motion_figures, results_table, short, table_caption
from vic_toolbox.experiments.reward_slices import reward_slices
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.skill import Skill, load_skill
from vic_toolbox.experiments.trace import Trace, record_trace
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
    FileError : `out` holds something else, or a demonstration with another configuration.
    KeyboardInterrupt : Ctrl-C; the same call goes on from there.
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
        _report(folder, configuration, threads)
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


@dataclass(frozen=True)
class _Scene:
    """All policies on one start: their evaluations and one episode of each."""

    rows: dict[str, Evaluation]
    traces: dict[str, Trace]


def _scene(skills: dict[str, Skill], scenario: str, threads: int) -> _Scene:
    task = next(iter(skills.values())).task(scenario)
    policies = {"expert": Policy.expert(task)} | {name: skill.judged for name, skill in skills.items()}
    rows = judge(task, policies, threads=threads)
    return _Scene(rows, {name: record_trace(task, policy.act) for name, policy in policies.items()})


def _report(folder: RunFolder, configuration: DemoConfiguration, threads: int) -> None:
    airl, bc, constant, carried = (
        load_skill(folder.path / name) for name in ("airl", "bc", "constant", f"airl-{UNSEEN}")
    )
    seen = _scene({"airl": airl, "bc": bc, "constant": constant}, "train", threads)
    unseen = _scene({"before": airl, "transfer": carried, "bc": bc, "constant": constant}, UNSEEN, threads)
    figures = folder.path / "figures"
    caption = film(
        folder.path / "film.mp4",
        {name: unseen.traces[name] for name in ("expert", "transfer")},
        airl.task(UNSEEN),
    )
    curves = learning.learning_curves(
        airl.folder.metrics(), expert_score=seen.rows["airl"].expert_score, name="airl"
    )
    moved = learning.learning_curves(
        carried.folder.metrics(), expert_score=unseen.rows["transfer"].expert_score, name="transfer"
    )
    assert airl.reward is not None
    slices = reward_slices(airl.task("train"), airl.reward, airl.policy, seen.traces["expert"], name="airl")
    parts: list[report.Part] = [
        report.Film(folder.path / "film.mp4", f"From the unseen start {UNSEEN}", caption),
        _table(seen, "On the training start", "airl"),
        _table(unseen, f"On the unseen start {UNSEEN}", "transfer"),
    ]
    if curves is not None:
        parts.append(draw(curves, figures / "learning.svg", "Learning from the demonstrations", "Learning"))
    if moved is not None:
        parts.append(draw(moved, figures / "transfer.svg", f"Carrying the skill to {UNSEEN}", "Transfer"))
    parts += motion_figures({short("train"): seen.traces, short(UNSEEN): unseen.traces}, figures)
    parts.append(draw(reward_landscape(slices), figures / "reward.svg", "What the reward values", "reward"))
    parts.append(report.Commands("Where to go from here", _next_steps(folder.path)))
    parts.append(report.Settings("Every setting of the AIRL run", flatten(airl.folder.configuration)))
    parts[1:1] = [report.Note(text) for text in _notes(airl, configuration)]
    own = unseen.rows["transfer"]
    report.write_report(
        folder.path / "report.html",
        title="A variable impedance skill, learned and carried over",
        subtitle=f"Cup-on-Plate on the FANUC LR Mate 200iD/7L, gain actions, seed {configuration.seed}",
        summary=_summary(seen.rows["airl"], unseen.rows["before"], own),
        tiles=[
            (f"{seen.rows['airl'].relative_difference:.3f}", "relative difference in training"),
            (f"{unseen.rows['before'].relative_difference:.3f}", f"on {UNSEEN} before transfer"),
            (f"{own.relative_difference:.3f}", f"on {UNSEEN} after transfer"),
            (f"{100 * own.success_rate:.0f} %", f"success on {UNSEEN}"),
        ],
        parts=parts,
    )


def _table(scene: _Scene, title: str, marked: str) -> report.Table:
    rows = [(style.look(name).label, row) for name, row in scene.rows.items()]
    episodes = next(iter(scene.rows.values())).episodes
    return results_table(
        title,
        rows,
        marked=style.look(marked).label,
        caption=table_caption(episodes),
    )


def _summary(seen: Evaluation, before: Evaluation, after: Evaluation) -> str:
    return (
        "An expert put a cup on a plate 50 times, pushed a little while he did it. From that alone AIRL "
        "learned when to be stiff and when to be soft: from the training start it scores "
        f"{_in_percent(seen)} the expert. The reward that it learned was then frozen, and the policy "
        f"optimised under it from the start {UNSEEN}, which no demonstration showed: {_in_percent(before)} "
        f"the expert before, {_in_percent(after)} him after."
    )


def _in_percent(row: Evaluation) -> str:
    return f"{100 * row.relative_difference:.1f} % {'below' if row.signed_difference > 0 else 'above'}"


def _notes(airl: Skill, configuration: DemoConfiguration) -> list[str]:
    notes = []
    metrics = airl.folder.metrics()
    if configuration.quick:
        notes.append(
            "This was a quick run with a tenth of the learning: it shows how it works, not how well."
        )
    elif metrics and metrics[-1]["iteration"] < airl.run.recipe.airl.iterations:
        notes.append(
            f"Learning stopped after {metrics[-1]['iteration']} of {airl.run.recipe.airl.iterations} "
            f"iterations, its share of the demonstration's {configuration.minutes:g} minutes; vic train has "
            "no such limit."
        )
    return notes


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
