"""How much of the bare physics speed the closed loop keeps: ``python -m benchmarks.simulation TASK``.

*Closed loop* is a whole ``VectorEnvironment.step``: actions in, law at every physics step, observation,
reward and checks out. *Bare* is ``Batch.step`` of the same batch from the same states:

- Cup-on-Plate: with zero torque and no callback, because there the law is a callback of ours;
- Peg-in-Hole: with the same gains and the collider, because there law and contacts are part of the model. Without
  them it would be another motion, not the same one at its bare price.

Both advance one policy step. They take turns on every state of a set sampled along expert episodes, so that
whatever else the machine does meets both alike; the figure is the median of the ratios. (Two batches would not
do: the idle threads of one slow the other down.)

For Peg-in-Hole the round hole and the hole of 16 convex wedges also take turns, on one thread, with whole steps of
the environment: ``wedges_over_analytic`` is the ratio of their times.
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from vic_toolbox import tasks
from vic_toolbox.tasks import callback
from vic_toolbox.tasks.simulation import ArmSimulation

STATES = 24
"""States along the episodes."""
TURNS = 15
"""Turns of each side on every state."""
WEDGES = 16
"""Wedges of the usual way to model a hole."""

State = tuple[np.ndarray, np.ndarray]  # of the batch, and the expert's actions there


def main() -> None:
    """Measure on one thread and on all, and print the result."""
    parser = argparse.ArgumentParser(
        description="Share of the bare physics speed that the closed loop keeps."
    )
    parser.add_argument("task", choices=tasks.names())
    parser.add_argument("--per-thread", type=int, default=20, help="simulations for each thread")
    options = parser.parse_args()
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    result: dict[str, object] = {"task": options.task}
    for label, threads in (("1", 1), ("all", processors)):
        figures = measure(options.task, count=options.per_thread * threads, threads=threads)
        result |= {f"{name}_{label}": value for name, value in figures.items()}
    if options.task == "peg-in-hole":
        result |= compare_with_wedges(count=options.per_thread)
    print(json.dumps(result))


def measure(name: str, *, count: int, threads: int) -> dict[str, float]:
    """Median speeds [policy steps/s, all simulations together] and their ratio, for one number of threads."""
    print(f"{name}: {count} simulations on {threads} thread{'s' * (threads > 1)}", flush=True)
    environment = tasks.VectorEnvironment(tasks.make(name), count, threads=threads)
    closed, bare = [], []
    for number, state in enumerate(expert_states(environment), start=1):
        for _ in range(TURNS):
            closed.append(closed_seconds(environment, state))
            bare.append(bare_seconds(environment, state))
        if number % 8 == 0:
            print(
                f"  {number:2d} of {STATES} states: {_ratio(bare, closed):.3f} of the bare speed", flush=True
            )
    return {
        "closed_loop_over_bare": round(_ratio(bare, closed), 4),
        "closed_loop_steps_per_s": round(count / statistics.median(closed)),
        "bare_steps_per_s": round(count / statistics.median(bare)),
        "threads": threads,
        "simulations": count,
    }


def compare_with_wedges(*, count: int) -> dict[str, float]:
    """Median time of a policy step of one simulation [µs] with either hole, and their ratio; one thread."""
    print(f"peg-in-hole: {count} simulations with {WEDGES} wedges and with the round hole", flush=True)
    environment = tasks.VectorEnvironment(tasks.make("peg-in-hole"), count)
    polygon = tasks.VectorEnvironment(tasks.make("peg-in-hole", wedges=WEDGES), count)
    polygon.task.horizon = STATES * TURNS + 1
    polygon.reset(seed=0)
    round_hole, wedges = [], []
    for state in expert_states(environment):
        for _ in range(TURNS):
            round_hole.append(closed_seconds(environment, state))
            wedges.append(closed_seconds(polygon, state))
    return {
        "wedges_over_analytic": round(_ratio(wedges, round_hole), 3),
        "wedges_us": round(1e6 * statistics.median(wedges) / count, 2),
        "analytic_us": round(1e6 * statistics.median(round_hole) / count, 2),
    }


def expert_states(environment: tasks.VectorEnvironment) -> Iterator[State]:
    """States along an expert's episode from all starts; whatever is simulated in between does not change them."""
    task, batch = environment.task, environment.simulation.batch
    every = task.horizon // (STATES + 1)
    task.horizon = STATES * (every + 2 * TURNS) + 1  # no reset while it measures
    starts = [start for start in task.scenarios.values() if _geometry(start) == _geometry(task.scenario)]
    scenarios = [starts[i % len(starts)] for i in range(environment.num_envs)]
    observation, _ = environment.reset(seed=0, options={"scenarios": scenarios})
    for _ in range(STATES):
        for _ in range(every):
            observation, *_ = environment.step(task.expert_action(observation))
        snapshot = batch.state.copy()
        yield snapshot, task.expert_action(observation)
        batch.state[:] = snapshot


def closed_seconds(environment: tasks.VectorEnvironment, state: State) -> float:
    """Time of one whole step of the environment [s]."""
    environment.simulation.batch.state[:], actions = state
    return _seconds(functools.partial(environment.step, actions))


def bare_seconds(environment: tasks.VectorEnvironment, state: State) -> float:
    """Time of the same physics steps alone [s]."""
    simulation, steps = environment.simulation, environment.task.substeps
    simulation.batch.state[:] = state[0]
    if not isinstance(simulation, ArmSimulation):
        return _seconds(functools.partial(simulation.batch.step, nstep=steps))
    simulation.batch.bind("ctrl")[:] = 0.0
    callback.uninstall()
    seconds = _seconds(functools.partial(simulation.batch.step, nstep=steps))
    callback.install(simulation.nv)
    return seconds


def _geometry(scenario: Any) -> Any:
    """What two scenarios must share to be simulated side by side."""
    return getattr(scenario, "geometry", None)


def _ratio(numerators: list[float], denominators: list[float]) -> float:
    return statistics.median(a / b for a, b in zip(numerators, denominators, strict=True))


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
