"""Time of one AIRL iteration without its simulation: ours against the `imitation` library.

    python -m benchmarks.learner

Both sides learn the same synthetic task (`benchmarks.workload`) with the same batch, networks and numbers of
updates, in turns in one run, on one thread each; `imitation` uses sb3-contrib's TRPO. What is counted on
either side is in benchmarks/README.md. The last line printed is one JSON object; `imitation_over_ours` in it
is the ratio of the medians of processor time.
"""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import TracebackType

import numpy as np
import torch
import tyro
from threadpoolctl import threadpool_limits

from benchmarks.reference_environment import BenchmarkError, clean_environment, reference_python
from benchmarks.stopwatch import Stopwatch, now
from benchmarks.workload import LinearSystem, LinearTask, Workload, demonstrations
from vic_toolbox.learning import Airl, AirlConfiguration, ExpertData, GaussianPolicy, policy_search
from vic_toolbox.learning.critic import Critic
from vic_toolbox.learning.reward import RewardNetwork

ROOT = Path(__file__).resolve().parent.parent

Seconds = dict[str, np.ndarray]
"""By part, (2,): processor and wall time [s]."""
Iteration = Callable[[], Seconds]


@dataclass(frozen=True)
class LearnerBenchmark:
    """Settings of the measurement."""

    repeats: int = 20
    """Timed iterations of each learner; the medians are over these."""
    warm_up: int = 2
    """Iterations before them that are not timed."""
    environment: Path = ROOT / "build" / "benchmark-venv"
    """Folder of the reference library's Python environment; made if it is not there."""


def workload_of(configuration: AirlConfiguration) -> Workload:
    """The sizes and numbers of updates of our configuration, for the reference to copy."""
    search, discriminator = configuration.search, configuration.discriminator
    return Workload(
        environments=search.environments,
        hidden=search.hidden,
        log_std=search.log_std,
        discount=search.discount,
        trace=search.trace,
        divergence=configuration.divergence,
        conjugate_gradient_steps=search.trpo.conjugate_gradient_steps,
        fisher_damping=search.trpo.fisher_damping,
        backtracks=search.trpo.backtracks,
        critic_epochs=search.critic.epochs,
        critic_batch=search.critic.batch,
        critic_learning_rate=search.critic.learning_rate,
        discriminator_steps=discriminator.steps,
        discriminator_batch=discriminator.batch,
        discriminator_learning_rate=configuration.learning_rate,
    )


def watch_learner() -> Stopwatch:
    """Time the parts of our learner, of every run in this process."""
    watch = Stopwatch()
    watch.watch(policy_search, "collect", "not_counted")
    watch.watch(Airl, "_train_reward", "discriminator")
    watch.watch(RewardNetwork, "value", "relabel")
    watch.watch(policy_search, "trpo_step", "trpo")
    watch.watch(Critic, "fit", "critic")
    return watch


def our_iteration(configuration: AirlConfiguration, workload: Workload, watch: Stopwatch) -> Iteration:
    """A function that does one `Airl.iterate()` and returns the seconds of each part.

    `total` is everything but the rollout. `other` is what the named parts leave of it: network inputs, log π
    of the samples, the values, the advantages, the average of the weights, the held-out action error.
    """
    task = LinearTask(workload)
    observations, actions = demonstrations(task, workload.expert_trajectories)
    policy = GaussianPolicy(
        task.observation_scale, task.action_size, hidden=workload.hidden, log_std=workload.log_std, seed=0
    )
    bound = np.ones(task.action_size)
    expert = ExpertData.from_trajectories(
        observations, actions, policy=policy, bounds=(-bound, bound), held_out=workload.held_out
    )
    system = LinearSystem(task, workload.environments)
    learner = Airl(system, expert, configuration=replace(configuration, restarts=0), seed=0)

    def iterate() -> Seconds:
        watch.take()
        start = now()
        learner.iterate()
        elapsed = now() - start
        parts = watch.take()
        rollout = parts.pop("not_counted")
        total = elapsed - rollout
        other = total - sum(parts.values(), np.zeros(2))
        return {"total": total, **parts, "other": other, "not_counted": rollout}

    return iterate


class ReferenceLearner:
    """The reference in a process of its own, which sleeps between its iterations."""

    def __init__(self, python: Path, workload: Workload):
        self._folder = python.parent.parent
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        self._process = subprocess.Popen(
            [str(python), "-m", "benchmarks.reference_imitation"],
            cwd=ROOT,
            env=clean_environment() | threads,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        try:
            self.versions: dict[str, str] = self._ask(json.dumps(asdict(workload)))
        except BenchmarkError:
            self.close()
            raise

    def iterate(self) -> Seconds:
        """One AIRL iteration of the library; seconds of each part."""
        return {part: np.array(seconds) for part, seconds in self._ask("iterate").items()}

    def _ask(self, line: str) -> dict:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            print(line, file=self._process.stdin, flush=True)
            return json.loads(self._process.stdout.readline())
        except (OSError, json.JSONDecodeError) as error:
            self._process.kill()
            self._process.wait()
            self._errors.seek(0)
            raise BenchmarkError(
                f"the reference learner stopped:\n{self._errors.read()[-2000:]}\n"
                f"If its environment is damaged, delete {self._folder} and run this again. "
                "Nothing was measured."
            ) from error

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()
        self._errors.close()

    def __enter__(self) -> ReferenceLearner:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()


def take_turns(learners: dict[str, Iteration], *, warm_up: int, repeats: int) -> dict[str, list[Seconds]]:
    """Iterate the learners in turns, so that a change of the machine's load meets all of them alike."""
    rounds: dict[str, list[Seconds]] = {name: [] for name in learners}
    for index in range(-warm_up, repeats):
        taken = {name: iterate() for name, iterate in learners.items()}
        times = "  ".join(f"{name} {1e3 * parts['total'][0]:.0f} ms" for name, parts in taken.items())
        print(f"warm-up: {times}" if index < 0 else f"{index + 1}/{repeats}: {times}", flush=True)
        if index >= 0:
            for name, parts in taken.items():
                rounds[name].append(parts)
    return rounds


def medians(rounds: Sequence[Seconds]) -> dict[str, float]:
    """Median processor time of each part over the rounds, and the median wall time of the whole [s]."""
    seconds = {part: np.median([parts[part] for parts in rounds], axis=0) for part in rounds[0]}
    figures = {part: processor for part, (processor, _) in seconds.items()} | {"wall": seconds["total"][1]}
    return {name: float(f"{value:.4g}") for name, value in figures.items()}


def measure(settings: LearnerBenchmark) -> dict:
    """Run the comparison and return its figures.

    Raises
    ------
    BenchmarkError : the reference cannot be installed or run.
    """
    shipped = AirlConfiguration()
    # The library's Fisher products go over the whole batch, ours by default over a part of it: the comparison
    # makes ours do the library's work, and shows the default beside it.
    trpo = replace(shipped.search.trpo, fisher_stride=1)
    same_work = replace(shipped, search=replace(shipped.search, trpo=trpo))
    workload = workload_of(shipped)
    python = reference_python(settings.environment.resolve())
    torch.set_num_threads(1)
    with threadpool_limits(1), watch_learner() as watch, ReferenceLearner(python, workload) as reference:
        rounds = take_turns(
            {
                "ours": our_iteration(same_work, workload, watch),
                "ours as shipped": our_iteration(shipped, workload, watch),
                "imitation": reference.iterate,
            },
            warm_up=settings.warm_up,
            repeats=settings.repeats,
        )
        versions = {"ours": our_versions(), "imitation": reference.versions}
    ours, as_shipped, imitation = (medians(taken) for taken in rounds.values())
    pairs = zip(rounds["imitation"], rounds["ours"], strict=True)
    ratios = sorted(float(theirs["total"][0] / own["total"][0]) for theirs, own in pairs)
    # What is left of the ratio if imitation drew its expert minibatches and relabelled for nothing.
    floor = (imitation["total"] - imitation["expert_batches"] - imitation["relabel"]) / ours["total"]
    return {
        "benchmark": "learner",
        "imitation_over_ours": round(imitation["total"] / ours["total"], 2),
        "imitation_over_ours_range": [round(ratios[0], 2), round(ratios[-1], 2)],
        "imitation_over_ours_wall": round(imitation["wall"] / ours["wall"], 2),
        "imitation_over_ours_as_shipped": round(imitation["total"] / as_shipped["total"], 2),
        "imitation_over_ours_without_loader_and_relabel": round(floor, 2),
        "ours_s": ours["total"],
        "ours_as_shipped_s": as_shipped["total"],
        "imitation_s": imitation["total"],
        "breakdown": {"ours": ours, "ours_as_shipped": as_shipped, "imitation": imitation},
        "repeats": settings.repeats,
        "threads": 1,
        "batch": workload.environments * workload.horizon,
        "workload": asdict(workload),
        "versions": versions,
    }


def our_versions() -> dict[str, str]:
    """What our side runs on."""
    return {"python": platform.python_version(), "torch": torch.__version__, "numpy": np.__version__}


def main() -> None:
    settings = tyro.cli(LearnerBenchmark, prog="python -m benchmarks.learner", description=__doc__)
    if settings.repeats < 3 or settings.warm_up < 0:
        sys.exit(f"received repeats {settings.repeats}, warm-up {settings.warm_up}; expected >= 3 and >= 0")
    try:
        figures = measure(settings)
    except BenchmarkError as error:
        sys.exit(f"benchmarks.learner: {error}")
    print(json.dumps(figures))


if __name__ == "__main__":
    main()
