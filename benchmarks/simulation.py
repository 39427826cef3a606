"""How much of the bare physics speed the closed loop keeps: ``python -m benchmarks.simulation cup-on-plate``.

*Closed loop* is a whole ``VectorEnvironment.step``: actions in, law at every physics step, observation,
reward and checks out. *Bare* is ``Batch.step`` of the same batch from the same states, with zero torque and
no callback. Both advance one policy step. They take turns on every state of a set sampled along expert
episodes, so that whatever else the machine does meets both alike; the figure is the median of the ratios.
(Two batches would not do: the idle threads of one slow the other down.)
"""

from __future__ import annotations

import argparse
import functools
import json
import os
import statistics
import time
from collections.abc import Callable

from vic_toolbox import tasks
from vic_toolbox.tasks import callback

STATES = 24
"""States along the episodes."""
TURNS = 15
"""Turns of each side on every state."""
EVERY = 20
"""Policy steps between two states."""


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
    print(json.dumps(result))


def measure(name: str, *, count: int, threads: int) -> dict[str, float]:
    """Median speeds [policy steps/s, all simulations together] and their ratio, for one number of threads."""
    print(f"{name}: {count} simulations on {threads} thread{'s' * (threads > 1)}", flush=True)
    task = tasks.make(name)
    task.horizon = STATES * (EVERY + TURNS) + 1  # no reset while it measures
    environment = tasks.VectorEnvironment(task, count, threads=threads)
    batch, joints = environment.simulation.batch, environment.simulation.nv
    starts = list(task.scenarios.values())
    scenarios = [starts[i % len(starts)] for i in range(count)]
    observation, _ = environment.reset(seed=0, options={"start_noise": 0.02, "scenarios": scenarios})
    closed, bare = [], []
    for state in range(1, STATES + 1):
        for _ in range(EVERY):
            observation, *_ = environment.step(task.expert_action(observation))
        action, snapshot = task.expert_action(observation), batch.state.copy()
        for _ in range(TURNS):
            batch.state[:] = snapshot
            closed.append(_seconds(functools.partial(environment.step, action)))
            callback.uninstall()
            batch.state[:] = snapshot
            batch.bind("ctrl")[:] = 0.0
            bare.append(_seconds(functools.partial(batch.step, nstep=task.substeps)))
            callback.install(joints)
        batch.state[:] = snapshot
        if state % 8 == 0:
            print(
                f"  {state:2d} of {STATES} states: {_share(closed, bare):.3f} of the bare speed", flush=True
            )
    return {
        "closed_loop_over_bare": round(_share(closed, bare), 4),
        "closed_loop_steps_per_s": round(count / statistics.median(closed)),
        "bare_steps_per_s": round(count / statistics.median(bare)),
        "threads": threads,
        "simulations": count,
    }


def _share(closed: list[float], bare: list[float]) -> float:
    return statistics.median(b / c for b, c in zip(bare, closed, strict=True))


def _seconds(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
