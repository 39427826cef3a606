"""The report of the demonstration: every policy on the training start and on the unseen one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from vic_toolbox.experiments import report
from vic_toolbox.experiments.configuration import flatten
from vic_toolbox.experiments.evaluation import Evaluation, Policy, judge
from vic_toolbox.experiments.figures import style
from vic_toolbox.experiments.film import film
from vic_toolbox.experiments.report_parts import (
    learning_figure,
    motion_figures,
    results_table,
    reward_figure,
    saved,
    short,
    table_caption,
)
from vic_toolbox.experiments.skill import Skill
from vic_toolbox.experiments.trace import Trace, record_trace


@dataclass(frozen=True)
class Scene:
    """All policies on one start: their evaluations, and one episode of each."""

    rows: dict[str, Evaluation]
    traces: dict[str, Trace]

    @classmethod
    def play(cls, skills: Mapping[str, Skill], scenario: str, *, threads: int) -> Scene:
        """Run the skills (by the name of their look) and the expert from a scenario."""
        task = next(iter(skills.values())).task(scenario)
        policies = {"expert": Policy.expert(task)} | {name: skill.judged for name, skill in skills.items()}
        rows = judge(task, policies, threads=threads)
        return cls(rows, {name: record_trace(task, policy.act) for name, policy in policies.items()})


def write_demo_report(
    path: Path,
    skills: Mapping[str, Skill],
    *,
    unseen: str,
    notes: Sequence[str],
    next_steps: Sequence[tuple[str, str]],
    threads: int = 0,
) -> None:
    """Judge, film and draw; write the page, and its figures beside it.

    Parameters
    ----------
    path : Path
        The HTML file to write.
    skills : Mapping[str, Skill]
        The runs "airl", "bc", "constant", and "transfer" for the AIRL policy after transfer.
    unseen : str
        Scenario that the skill was carried to.
    notes : Sequence[str]
        What the reader must know.
    next_steps : Sequence[tuple[str, str]]
        Pairs of a command and what it does.
    threads : int
        Threads of the simulation, 0 for all processors; the numbers do not depend on it.
    """
    airl, carried = skills["airl"], skills["transfer"]
    others = {name: skills[name] for name in ("bc", "constant")}
    trained = Scene.play({"airl": airl} | others, "train", threads=threads)
    new = Scene.play({"before": airl, "transfer": carried} | others, unseen, threads=threads)
    drawings = [
        *learning_figure(
            airl, trained.rows["airl"], file="learning", title="Learning from the demonstrations"
        ),
        *learning_figure(
            carried, new.rows["transfer"], file="transfer", title=f"Carrying the skill to {unseen}"
        ),
        *motion_figures({short("train"): trained.traces, short(unseen): new.traces}),
        *reward_figure(airl, trained.traces["expert"]),
    ]
    report.write_report(
        path,
        title="A variable impedance skill, learned and carried over",
        subtitle=f"Cup-on-Plate on the FANUC LR Mate 200iD/7L, gain actions, seed {airl.seed}",
        summary=_summary(trained.rows["airl"], new.rows["before"], new.rows["transfer"]),
        tiles=_tiles(trained.rows["airl"], new.rows["before"], new.rows["transfer"]),
        parts=[
            _film(path.parent / "film.mp4", new, airl, unseen),
            *(report.Note(text) for text in notes),
            _table(trained, "On the training start", "airl"),
            _table(new, f"On the unseen start {unseen}", "transfer"),
            *(saved(drawing, path.parent / "figures") for drawing in drawings),
            report.Commands("Where to go from here", next_steps),
            report.Settings("Every setting of the AIRL run", flatten(airl.folder.configuration)),
        ],
    )


def _film(path: Path, scene: Scene, skill: Skill, scenario: str) -> report.Film:
    shown = {name: scene.traces[name] for name in ("expert", "transfer")}
    return report.Film(path, f"From the unseen start {scenario}", film(path, shown, skill.task(scenario)))


def _table(scene: Scene, title: str, marked: str) -> report.Table:
    rows = [(style.look(name).label, row) for name, row in scene.rows.items()]
    episodes = scene.rows["expert"].episodes
    return results_table(title, rows, marked=style.look(marked).label, caption=table_caption(episodes))


def _summary(trained: Evaluation, before: Evaluation, after: Evaluation) -> str:
    return (
        "An expert put a cup on a plate 50 times, pushed a little while he did it. From that alone AIRL learned "
        f"when to be stiff and when to be soft: from the training start it scores {_in_percent(trained)} the expert. "
        "The reward that it learned was then frozen, and the policy optimised under it from the start "
        f"{after.scenario}, which no demonstration showed: {_in_percent(before)} the expert before, "
        f"{_in_percent(after)} him after."
    )


def _in_percent(row: Evaluation) -> str:
    return f"{100 * row.relative_difference:.1f} % {'below' if row.signed_difference > 0 else 'above'}"


def _tiles(trained: Evaluation, before: Evaluation, after: Evaluation) -> list[tuple[str, str]]:
    return [
        (f"{trained.relative_difference:.3f}", "relative difference in training"),
        (f"{before.relative_difference:.3f}", f"on {after.scenario} before transfer"),
        (f"{after.relative_difference:.3f}", f"on {after.scenario} after transfer"),
        (f"{100 * after.success_rate:.0f} %", f"success on {after.scenario}"),
    ]
