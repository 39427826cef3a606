"""The commands that learn: ``demo``, ``train``, ``transfer``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeVar

import tyro
from tyro.conf import FlagCreatePairsOff, arg

from vic_toolbox.cli.console import console_progress, print_result, say
from vic_toolbox.cli.options import Count, HyperParameters, NewFolder, Number, Run, Scenario, TaskName
from vic_toolbox.errors import InputError

if TYPE_CHECKING:
    from vic_toolbox.experiments.configuration import DemonstrationConfiguration, RecordedDemonstrations

Demonstrations = Annotated[int | Path, arg(metavar="N|FILE")]
T = TypeVar("T")


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

    Every hyper-parameter is an option too, e.g. --airl.slope-bound 6; list them with vic train TASK --help-all.

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
    demonstrations: Demonstrations = 50
    """Trajectories of the expert to learn from; or a file of recorded ones, see `vic fit --task`."""
    held_out: Count = None
    """Trajectories that only judge the learning: by default 10 further ones, of a file every sixth."""
    push: Number = None
    """Size of the random pushes on the expert [N]; by default the task's own."""
    episodes: int = 20
    """Episodes of the evaluation at the end."""
    threads: int = 0
    """Threads of the simulation, 0 for all processors; the numbers do not depend on it."""
    hyper_parameters: HyperParameters = ()
    """Dotted options, which belong to the recipe."""

    def run(self) -> None:
        """Train."""
        from vic_toolbox.experiments.configuration import default_configuration
        from vic_toolbox.experiments.training import train

        run = default_configuration(
            self.task,
            self.method,
            action=self.action,
            history=self.history,
            seed=self.seed,
            episodes=self.episodes,
            demonstrations=self._demonstrations(),
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
            evaluation = train(
                run,
                out,
                resume=self.resume,
                threads=self.threads,
                progress=progress,
                demonstrations=self.demonstrations if isinstance(self.demonstrations, Path) else None,
            )
        print_result(evaluation, out)

    def _demonstrations(self) -> DemonstrationConfiguration | RecordedDemonstrations:
        from vic_toolbox.experiments.configuration import DemonstrationConfiguration, RecordedDemonstrations

        if isinstance(self.demonstrations, int):
            held_out = 10 if self.held_out is None else self.held_out
            return DemonstrationConfiguration.for_task(
                self.task, count=self.demonstrations, held_out=held_out, push=self.push
            )
        if self.push is not None:
            raise InputError("--push is for an expert that is recorded now; leave it out with a file.")
        return RecordedDemonstrations.of(self.demonstrations, held_out=self.held_out)


@dataclass(frozen=True)
class Transfer:
    """Carry a skill over: optimise a policy on another scenario under the frozen reward of a run.

    Every hyper-parameter is an option too, e.g. --transfer.divergence 0.02; list them with vic transfer RUN --help-all.

    Example: vic transfer runs/airl-1 --scenario T1 --out runs/airl-1-T1
    """

    source: Run
    """Folder of a finished AIRL run."""
    scenario: Scenario
    """Scenario, see `vic tasks`, or one of your own: 0.4,0.1,0.3 or tilt=-4,scale=0.5."""
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

        skill = load_skill(self.source)
        recipe, scenario = skill.run.recipe, skill.task(self.scenario).scenario.name
        if self.iterations is not None:
            recipe = replace(recipe, transfer=replace(recipe.transfer, iterations=self.iterations))
        recipe = _with_options(recipe, self.hyper_parameters, "vic transfer")
        kind = f"{'-fresh' if self.fresh else ''}{'-random' if self.reward == 'random' else ''}"
        out = self.out or self.source.with_name(f"{self.source.name}-{scenario}{kind}")
        with console_progress() as progress:
            evaluation = transfer(
                self.source,
                scenario,
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


def _with_options(recipe: T, words: Sequence[str], program: str) -> T:
    """The recipe with dotted options in it; ``--help-all`` lists them."""
    words = ["--help" if word == "--help-all" else word for word in words]
    return tyro.cli(type(recipe), args=words, default=recipe, prog=program, config=(FlagCreatePairsOff,))
