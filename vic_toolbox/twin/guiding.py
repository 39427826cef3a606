"""Guided demonstrations: a human leads the arm to the plate, and the controller logs what it sees.

The controller only compensates: with all gains zero the law asks for ``τ = Jᵀ F_ff`` (gravity, Coriolis), so the arm
moves as ``M(x) ẍ = F_hand + F_excitation`` as far as the nominal model is right. What the F/T sensor measures between
wrist and gripper is the hand's wrench, and weight and inertia of what hangs on it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import InputError, SimulationError, finite_number, integer, positive
from vic_toolbox.tasks import cup_scene
from vic_toolbox.tasks.cup_on_plate import START_NOISE
from vic_toolbox.twin.excitation import Excitation
from vic_toolbox.twin.logs import Log, sensed
from vic_toolbox.twin.loop import PERIOD
from vic_toolbox.twin.operator import Operator
from vic_toolbox.twin.plant import links
from vic_toolbox.twin.robot import Twin
from vic_toolbox.twin.truth import Truth

Progress = Callable[[int, int], None]
"""Called with the steps done and their number."""
REPORT_EVERY = 100
DURATION = 5.0
"""Of a demonstration [s]."""
RATE = 500.0
"""Of the logs [Hz]."""


@dataclass(frozen=True, eq=False)
class Session:
    """Demonstrations by one operator on one robot."""

    logs: tuple[Log, ...]
    truth: Truth


def guide(
    twin: Twin,
    operator: Operator | None = None,
    *,
    count: int = 30,
    seed: int = 0,
    excitation: Excitation | None = None,
    scenario: object = "train",
    start_noise: float = 1.0,
    duration: float = DURATION,
    rate: float = RATE,
    threads: int = 1,
    progress: Progress | None = None,
) -> Session:
    """Let an operator guide the arm to the plate `count` times, side by side.

    Parameters
    ----------
    twin : Twin
    operator : Operator, optional
        The default human.
    count : int
        Demonstrations.
    seed : int
        Of starts, sway, tremor, excitation and noise.
    excitation : Excitation, optional
        What the controller adds; by default 5 N. ``Excitation(force=0)`` leaves the operator alone, as in the
        paper.
    scenario : str, Scenario or (x, y, z)
        Where demonstrations start.
    start_noise : float
        Variation of the starts, in units of the task's (0.02 rad in every joint).
    duration : float
        [s]
    rate : float
        Of the logs [Hz]; a whole fraction of 1 kHz.
    threads : int
        Threads of the physics; the numbers do not depend on it.
    progress : callable, optional
        Told how far it is.

    Raises
    ------
    InputError
        A number out of range.
    SimulationError
        An arm ran away.
    """
    count = integer("count", count, low=1)
    steps = round(positive("duration", duration) / PERIOD)
    every = _every(rate)
    spread = START_NOISE * finite_number("start_noise", start_noise, low=0.0)
    rngs = [np.random.default_rng([integer("seed", seed, low=0), part]) for part in range(5)]
    time = PERIOD * np.arange(steps, dtype=np.float64)
    start = cup_scene.start_angles(cup_scene.as_scenario(scenario).start)
    hands = (operator or Operator()).take(time, count=count, rng=rngs[0])
    push = (excitation or Excitation()).wrench(time, count=count, rng=rngs[1])
    loop = twin.loop(count, rng=rngs[2], threads=threads)
    loop.reset(start + spread * rngs[3].standard_normal((count, len(start))))

    kept = range(0, steps, every)
    angles = np.empty((count, len(kept), len(start)))
    hand, transmitted = np.empty((2, count, len(kept), 6))
    contact = np.empty((count, len(kept)))
    for i in range(steps):
        wrench = hands.wrench(i, loop.arm.observe())
        loop.law.wrench[:] = push[i]
        measured = loop.law.qpos.copy() if i % every == 0 else None
        loop.step(wrench)
        if measured is not None:
            row = i // every
            angles[:, row], hand[:, row] = measured, wrench
            transmitted[:, row], contact[:, row] = loop.transmitted, loop.arm.contact_force
        if progress is not None and i % REPORT_EVERY == 0:
            progress(i, steps)
    if loop.arm.stopped.any():
        raise SimulationError(
            f"the arm ran away in demonstrations {np.flatnonzero(loop.arm.stopped).tolist()}; "
            "soften the operator or the excitation."
        )
    read = sensed(transmitted, twin.specimen.bias, twin.imperfections, rngs[4])
    times = time[::every]
    truth = Truth(
        time=times,
        stiffness=hands.stiffness[::every],
        damping=hands.damping[::every],
        hand=hand,
        contact=contact,
        bias=twin.specimen.bias,
        mass=np.array(hanging_mass(twin)),
    )
    return Session(tuple(Log(times, a, w) for a, w in zip(angles, read, strict=True)), truth)


def hanging_mass(twin: Twin) -> float:
    """Mass of gripper and cup of this robot [kg]."""
    spec = cup_scene.build_spec()
    return sum(spec.body(name).mass * twin.specimen.mass[name] for name in links()[-2:])


def _every(rate: float) -> int:
    """Steps from one row of a log to the next."""
    every = round(1.0 / (PERIOD * positive("rate", rate)))
    if every < 1 or abs(every * PERIOD * rate - 1.0) > 1e-9:
        raise InputError(f"rate is {rate:g} Hz; pass 1000 Hz divided by a whole number.")
    return every
