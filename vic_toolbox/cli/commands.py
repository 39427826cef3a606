"""The commands of ``vic`` as dataclasses: fields are options, docstrings are the help.

Heavy imports happen when a command runs, so that help is quick.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, Protocol, TypeVar

import tyro
from tyro.conf import FlagCreatePairsOff, Positional, Suppress, arg

from vic_toolbox.cli.console import console_progress, print_result, print_sweep, print_table, say
from vic_toolbox.errors import InputError

if TYPE_CHECKING:
    from vic_toolbox.experiments.skill import Skill

T = TypeVar("T")

TaskName = Positional[Annotated[str, arg(metavar="TASK")]]
Run = Positional[Annotated[Path, arg(metavar="RUN")]]
NewFolder = Annotated[Path | None, arg(metavar="DIR")]
Count = Annotated[int | None, arg(metavar="N")]
Start = Annotated[str, arg(metavar="NAME|X,Y,Z")]
MaybeStart = Annotated[str | None, arg(metavar="NAME|X,Y,Z")]
MaybeFile = Annotated[Path | None, arg(metavar="FILE")]
Folders = Annotated[tuple[Path, ...], arg(metavar="RUN ...")]
HyperParameters = Suppress[tuple[str, ...]]


class Command(Protocol):
    """What every command offers."""

    def run(self) -> None:
        """Do it."""
        ...


@dataclass(frozen=True)
class Demo:
    """Learn a skill from demonstrations and carry it to a start that it never saw.

    Takes at most five minutes on four cores. Run it again with the same options to go on where it
    was stopped.

    Example: vic demo --out runs/demo
    """

    out: Path = Path("runs/demo")
    """Folder of the demonstration; its report.html shows the result."""
    seed: int = 0
    """Of demonstrations, weights and exploration; the same seed gives the same numbers."""
    quick: bool = False
    """A tenth of the learning: shows how it works, not how well."""
    minutes: float = 5.0
    """Learning stops early on a machine that would take longer than this [min]."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""

    def run(self) -> None:
        """Run the demonstration."""
        from vic_toolbox.experiments.demo import DemoConfiguration, run_demo

        configuration = DemoConfiguration(seed=self.seed, quick=self.quick, minutes=self.minutes)
        with console_progress() as progress:
            demo = run_demo(configuration, self.out, threads=self.threads, progress=progress)
        say(f"\nThe report: {demo.report}\n\nTry next:")
        for command, what in demo.next_steps:
            say(f"  {command}\n      {what}")


@dataclass(frozen=True)
class Train:
    """Learn a policy from the expert's demonstrations.

    Every hyper-parameter is an option too, e.g. --airl.slope-bound 6; list them with --help-all.

    Example: vic train cup-on-plate --method airl --action gain --seed 1 --out runs/airl-1
    """

    task: TaskName
    """Name of the task, see `vic tasks`."""
    method: Literal["airl", "bc", "constant"] = "airl"
    """AIRL, behaviour cloning, or gains that never change."""
    action: Literal["gain", "force"] = "gain"
    """What the policy sets: impedance gains, or the feedback wrench itself."""
    history: int = 1
    """Last observations that the policy sees; the paper has 1 and 5."""
    seed: int = 0
    """Of demonstrations, weights, exploration and minibatches; the same seed gives the same numbers."""
    out: NewFolder = None
    """Folder of the run; by default runs/TASK-METHOD-ACTION-HISTORY-seedSEED."""
    resume: bool = False
    """Take up the run in that folder where it was stopped, if there is one."""
    iterations: Count = None
    """Iterations of AIRL, or steps of cloning; by default the task's recipe."""
    demonstrations: int = 50
    """Trajectories of the expert to learn from."""
    held_out: int = 10
    """Further trajectories that only judge the learning."""
    push: float = 5.0
    """Size of the random pushes on the expert [N]."""
    episodes: int = 20
    """Episodes of the evaluation at the end."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""
    hyper_parameters: HyperParameters = ()
    """Dotted options, which belong to the recipe."""

    def run(self) -> None:
        """Train."""
        from vic_toolbox.experiments.configuration import DemonstrationConfiguration, default_configuration
        from vic_toolbox.experiments.training import train

        run = default_configuration(
            self.task,
            self.method,
            action=self.action,
            history=self.history,
            seed=self.seed,
            episodes=self.episodes,
            demonstrations=DemonstrationConfiguration(
                count=self.demonstrations, held_out=self.held_out, push=self.push
            ),
        )
        recipe = run.recipe
        if self.iterations is not None:
            recipe = replace(
                recipe,
                airl=replace(recipe.airl, iterations=self.iterations),
                cloning=replace(recipe.cloning, steps=self.iterations),
            )
        run = replace(run, recipe=_with_options(recipe, self.hyper_parameters, "vic train"))
        name = f"{self.task}-{self.method}-{self.action}-{self.history}-seed{self.seed}"
        out = self.out or Path("runs") / name
        with console_progress() as progress:
            evaluation = train(run, out, resume=self.resume, threads=self.threads, progress=progress)
        print_result(evaluation, out)


@dataclass(frozen=True)
class Transfer:
    """Carry a skill over: optimise a policy on another start under the frozen reward of a run.

    Every hyper-parameter is an option too, e.g. --transfer.divergence 0.02; list them with --help-all.

    Example: vic transfer runs/airl-1 --scenario T1 --out runs/airl-1-T1
    """

    source: Run
    """Folder of a finished AIRL run."""
    scenario: Start
    """Scenario, see `vic tasks`, or a start "x,y,z" [m]."""
    out: NewFolder = None
    """Folder of the new run; by default that of the source with the scenario added."""
    fresh: bool = False
    """Begin with random weights instead of the run's policy: the test of the reward itself."""
    reward: Literal["learned", "random"] = "learned"
    """The learned reward, or an untrained network as the control."""
    seed: int = 0
    """Of fresh weights, exploration and minibatches; the same seed gives the same numbers."""
    resume: bool = False
    """Take up the run in that folder where it was stopped, if there is one."""
    iterations: Count = None
    """Iterations; by default the task's recipe."""
    episodes: int = 20
    """Episodes of the evaluation at the end."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""
    hyper_parameters: HyperParameters = ()
    """Dotted options, which belong to the recipe."""

    def run(self) -> None:
        """Transfer."""
        from vic_toolbox.experiments.skill import load_skill
        from vic_toolbox.experiments.transfer import transfer

        recipe = load_skill(self.source).run.recipe
        if self.iterations is not None:
            recipe = replace(recipe, transfer=replace(recipe.transfer, iterations=self.iterations))
        recipe = _with_options(recipe, self.hyper_parameters, "vic transfer")
        kind = f"{'-fresh' if self.fresh else ''}{'-random' if self.reward == 'random' else ''}"
        out = self.out or self.source.with_name(f"{self.source.name}-{self.scenario}{kind}")
        with console_progress() as progress:
            evaluation = transfer(
                self.source,
                self.scenario,
                out,
                fresh=self.fresh,
                reward=self.reward,
                seed=self.seed,
                settings=recipe.transfer,
                episodes=self.episodes,
                resume=self.resume,
                threads=self.threads,
                progress=progress,
            )
        print_result(evaluation, out)


@dataclass(frozen=True)
class Evaluate:
    """Judge a policy beside the expert on the same starts.

    Writes RUN/evaluations/SCENARIO/evaluation.json and RUN/evaluation.json, or the files of a sweep.

    Example: vic evaluate runs/airl-1 --scenario T1 --episodes 50
    """

    source: Run
    """Folder of a finished run."""
    scenario: MaybeStart = None
    """Scenario, see `vic tasks`, or a start "x,y,z" [m]; by default that of the run."""
    episodes: Count = None
    """Episodes, each from another start nearby; by default 20, in a sweep 1 from each exact start."""
    seed: int = 1000
    """Of the starts; the same seed gives the same numbers."""
    sweep: Literal["start"] | None = None
    """Judge from starts at many distances and bearings around the goal instead."""
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
            self._sweep(skill)
            return
        task = skill.task(self.scenario)
        episodes = 20 if self.episodes is None else self.episodes
        evaluation = evaluate(task, skill.judged, episodes=episodes, seed=self.seed, threads=self.threads)
        write_evaluation(skill.folder, evaluation)
        print_result(evaluation, self.source)

    def _sweep(self, skill: Skill) -> None:
        from vic_toolbox.experiments.skill import load_skill
        from vic_toolbox.experiments.sweep import sweep_runs

        if self.scenario is not None:
            raise InputError("a sweep has its own starts; leave --scenario out.")
        episodes = 1 if self.episodes is None else self.episodes
        others = [load_skill(folder) for folder in self.against]
        with console_progress() as progress:
            swept = sweep_runs(
                [skill, *others], episodes=episodes, seed=self.seed, threads=self.threads, progress=progress
            )
        folder = self.source / "evaluations" / "sweep"
        swept.write(folder)
        print_sweep(swept.summary(), folder)


@dataclass(frozen=True)
class Play:
    """Watch a policy, in a window or as a film beside the expert.

    Example: vic play runs/airl-1 --scenario T1 --video t1.mp4
    """

    source: Run
    """Folder of a finished run."""
    scenario: MaybeStart = None
    """Scenario, see `vic tasks`, or a start "x,y,z" [m]; by default that of the run."""
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
        from vic_toolbox.experiments.listing import robot_rows

        print_table(("name", "joints", "reach [m]", "tool frame", "description"), robot_rows(self.seed))


@dataclass(frozen=True)
class Tasks:
    """List the tasks with their scenarios and action spaces.

    Example: vic tasks
    """

    def run(self) -> None:
        """List."""
        from vic_toolbox.experiments.listing import scenario_rows, task_rows

        print_table(("task", "Gymnasium id", "actions", "episode"), task_rows())
        print_table(("task", "scenario", "start x, y, z [m]"), scenario_rows())


COMMANDS: dict[str, type[Command]] = {
    "demo": Demo,
    "train": Train,
    "transfer": Transfer,
    "evaluate": Evaluate,
    "play": Play,
    "robots": Robots,
    "tasks": Tasks,
}


def _with_options(recipe: T, words: Sequence[str], program: str) -> T:
    """The recipe with dotted options in it; ``--help-all`` lists them."""
    words = ["--help" if word == "--help-all" else word for word in words]
    return tyro.cli(type(recipe), args=words, default=recipe, prog=program, config=(FlagCreatePairsOff,))
