"""The commands that look: ``evaluate``, ``play``, ``robots``, ``tasks``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vic_toolbox.cli.console import (
    console_progress,
    print_difficulty,
    print_result,
    print_start_sweep,
    print_table,
    say,
)
from vic_toolbox.cli.options import Count, Folders, MaybeFile, MaybeScenario, Name, Run
from vic_toolbox.errors import InputError

if TYPE_CHECKING:
    from vic_toolbox.experiments.skill import Skill


@dataclass(frozen=True)
class Evaluate:
    """Judge a policy beside the expert on the same starts.

    Writes RUN/evaluations/SCENARIO/evaluation.json and RUN/evaluation.json, or the files of a sweep into
    RUN/evaluations/sweep-NAME.

    Example: vic evaluate runs/airl-1 --scenario T1 --episodes 50
    """

    source: Run
    """Folder of a finished run."""
    scenario: MaybeScenario = None
    """Scenario, see `vic tasks`, or one of your own: 0.4,0.1,0.3 or tilt=-4,scale=0.5; by default that of the run."""
    episodes: Count = None
    """Episodes, each from a varied start; by default 20, in a sweep 50 at each value, or 1 from each exact start."""
    seed: int = 1000
    """Of the starts; the same seed gives the same numbers."""
    sweep: Name = None
    """Judge along one quantity: start (Cup-on-Plate); tilt, scale, offset, friction or clearance (Peg-in-Hole)."""
    against: Folders = ()
    """Folders of further runs to draw beside this one in a sweep."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""

    def run(self) -> None:
        """Evaluate."""
        from vic_toolbox.experiments.evaluation import evaluate
        from vic_toolbox.experiments.results import write_evaluation
        from vic_toolbox.experiments.skill import load_skill

        skill = load_skill(self.source)
        if self.sweep is not None:
            self._sweep(skill, self.sweep)
            return
        if self.against:
            raise InputError("--against belongs to a sweep; add --sweep NAME, or evaluate each run alone.")
        task = skill.task(self.scenario)
        episodes = 20 if self.episodes is None else self.episodes
        evaluation = evaluate(task, skill.judged, episodes=episodes, seed=self.seed, threads=self.threads)
        write_evaluation(skill.folder, evaluation)
        print_result(evaluation, self.source)

    def _sweep(self, skill: Skill, name: str) -> None:
        from vic_toolbox.experiments.difficulty import (
            START,
            offered_sweeps,
            sweep_axis,
            sweep_runs_difficulty,
        )
        from vic_toolbox.experiments.skill import load_skill
        from vic_toolbox.experiments.start_sweep import sweep_runs

        task = skill.task()
        if name not in offered_sweeps(task):
            sweep_axis(task, name)  # says what there is
        if self.scenario is not None:
            raise InputError("a sweep has its own scenarios; leave --scenario out.")
        skills = [skill, *(load_skill(folder) for folder in self.against)]
        options: dict[str, Any] = {"seed": self.seed, "threads": self.threads}
        if self.episodes is not None:
            options["episodes"] = self.episodes
        folder = self.source / "evaluations" / f"sweep-{name}"
        with console_progress() as progress:
            if name == START:
                swept = sweep_runs(skills, **options, progress=progress)
            else:
                swept = sweep_runs_difficulty(skills, name, **options, progress=progress)
        swept.write(folder)
        (print_start_sweep if name == START else print_difficulty)(swept.summary(), folder)


@dataclass(frozen=True)
class Play:
    """Watch a policy, in a window or as a film beside the expert.

    Example: vic play runs/airl-1 --scenario T1 --video t1.mp4
    """

    source: Run
    """Folder of a finished run."""
    scenario: MaybeScenario = None
    """Scenario, see `vic tasks`, or one of your own: 0.4,0.1,0.3 or tilt=-4,scale=0.5; by default that of the run."""
    video: MaybeFile = None
    """Write a film (.mp4) of the policy and the expert instead of opening a window."""
    seed: int = 0
    """Of the start in the window; 0 starts exactly at the scenario."""

    def run(self) -> None:
        """Play."""
        from vic_toolbox.experiments.play import film_skill, show_skill
        from vic_toolbox.experiments.skill import load_skill

        skill = load_skill(self.source)
        if self.video is None:
            say(show_skill(skill, self.scenario, seed=self.seed))
        else:
            say(film_skill(skill, self.scenario, self.video))


@dataclass(frozen=True)
class Robots:
    """List the robots that models can load, with joints and reach.

    Example: vic robots
    """

    seed: int = 0
    """Of the random postures that the reach is measured with."""

    def run(self) -> None:
        """List."""
        from vic_toolbox.experiments.robot_listing import robot_rows

        print_table(("name", "joints", "reach [m]", "tool frame", "description"), robot_rows(self.seed))


@dataclass(frozen=True)
class Tasks:
    """List the tasks with their scenarios and action spaces.

    Example: vic tasks
    """

    def run(self) -> None:
        """List."""
        from vic_toolbox.experiments.task_listing import scenario_rows, task_rows

        print_table(("task", "Gymnasium id", "actions", "episode"), task_rows())
        print_table(("task", "scenario", "what it is"), scenario_rows())
