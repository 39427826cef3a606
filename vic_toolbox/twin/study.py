"""What a push buys, and where the errors come from: sessions that differ in one thing, fitted alike.

A human who guides a free arm hardly pulls: the motion is so damped that ``K e`` and ``B ė`` nearly cancel, and any
common factor of both explains the small difference. What else moves the arm, the human's own unrest, then decides,
and it pulls the factor towards zero (identification in closed loop). A push that the human did not make is the cure.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation import fit_smooth
from vic_toolbox.recordings import inertia_share
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.twin.comparison import KNOTS, STOP, Comparison, compare
from vic_toolbox.twin.deployment import Policy, run
from vic_toolbox.twin.excitation import Excitation
from vic_toolbox.twin.guiding import guide
from vic_toolbox.twin.operator import CALM, Operator
from vic_toolbox.twin.parameters import Imperfections
from vic_toolbox.twin.robot import Twin
from vic_toolbox.twin.session import load_session, save_session

STUDY_HEAD = (
    "[%]", "K error", "K_rot error", "K bias", "K_rot bias", "B error", "B_rot error", "observable", "bands hold",
    "M a explains",
)  # fmt: skip
REPLAY_HEAD = ("deviation from the nominal arm, mean / end [mm]", *cup_scene.SCENARIOS)
ROBOTS = 3
"""Twins that each replay is tried on."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """One session of the study."""

    push: float = Excitation().force
    """Root mean square of the controller's push along x [N]."""
    operator: Operator = field(default_factory=Operator)
    imperfections: Imperfections = field(default_factory=Imperfections)
    count: int = 30
    """Demonstrations."""
    pooled: bool = True
    """One fit of all demonstrations, or one of each, whose errors are then taken together."""
    knots: float = KNOTS
    """Distance of the fit's knots [s]."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Of the smooth fit."""


CASES = {
    "push 0 N (paper)": Case(push=0.0),
    "push 1 N": Case(push=1.0),
    "push 2.5 N": Case(push=2.5),
    "push 5 N (default)": Case(),
    "push 10 N": Case(push=10.0),
    "5 N, 10 demonstrations": Case(count=10),
    "5 N, one at a time": Case(count=10, pooled=False),
    "5 N, one at a time, knots 0.3 s": Case(count=10, pooled=False, knots=0.3),
    "5 N, one at a time, knots 0.1 s": Case(count=10, pooled=False, knots=0.1),
    "5 N, one at a time, B = d √K, 0.3 s": Case(
        count=10, pooled=False, knots=0.3, options={"structure": "damping_factor"}
    ),
    "5 N, latency fitted": Case(options={"latency": True}),
    "10 N, latency fitted": Case(push=10.0, options={"latency": True}),
    "5 N, bias fitted": Case(options={"bias": True}),
    "5 N, B = d √K fitted": Case(options={"structure": "damping_factor"}),
    "5 N, no sway": Case(operator=Operator(sway=(0.0, 0.0))),
    "5 N, no tremor": Case(operator=Operator(tremor=(0.0, 0.0))),
    "5 N, calm human": Case(operator=CALM),
    "5 N, calm human, perfect robot": Case(operator=CALM, imperfections=Imperfections.none()),
    "0 N, calm human": Case(push=0.0, operator=CALM),
    "0 N, calm human, perfect robot": Case(push=0.0, operator=CALM, imperfections=Imperfections.none()),
}
"""The sessions, by name."""


class Measured(NamedTuple):
    """What came out of a session."""

    gains: Comparison
    """The smooth fit against the truth."""
    inertia: Array
    """What :func:`~vic_toolbox.recordings.inertia_share` says, (6,)."""


def measure(case: Case, *, seed: int = 0, threads: int = 1) -> Measured:
    """Record a session, fit it smoothly as anybody would, compare with the truth."""
    twin = Twin(case.imperfections, seed=seed)
    session = guide(
        twin,
        case.operator,
        count=case.count,
        seed=seed,
        excitation=Excitation(force=case.push),
        duration=STOP + 0.4,
        threads=threads,
    )
    with tempfile.TemporaryDirectory() as folder:
        save_session(session, twin, folder)
        logs = load_session(folder, stop=STOP)
    together = [logs] if case.pooled else [[log] for log in logs]
    fits = [fit_smooth(part, case.knots, **case.options) for part in together]
    return Measured(compare(fits, session.truth), inertia_share(logs))


def study(
    *, seed: int = 0, threads: int = 1, progress: Callable[[int, int], None] | None = None
) -> list[tuple[str, ...]]:
    """Measure every case: rows of text under :data:`STUDY_HEAD`, in per cent, medians of three axes (means: bands)."""
    rows = []
    for i, (name, case) in enumerate(CASES.items()):
        if progress is not None:
            progress(i, len(CASES))
        rows.append((name, *_cells(measure(case, seed=seed, threads=threads))))
    return rows


def replay(*, seed: int = 0, threads: int = 1) -> list[tuple[str, ...]]:
    """Carry the expert over to other robots, the paper's sim-to-real figure: rows of text under :data:`REPLAY_HEAD`.

    The expert's gains in closed loop, the same gains replayed over time, and the same wrench replayed; means over
    :data:`ROBOTS` twins, from every start.
    """
    task, starts = CupOnPlate(), list(cup_scene.SCENARIOS)
    force = task.with_action("force")
    nominal = run(
        Twin(Imperfections.none()), task.expert_action, task=task, scenarios=starts, threads=threads
    )
    wrenches = force.expert_action(nominal.observations[:, :-1])
    ways: dict[str, tuple[CupOnPlate, Callable[[], Policy]]] = {
        "expert": (task, lambda: task.expert_action),
        "its gains, replayed": (task, lambda: _player(nominal.actions)),
        "its wrench, replayed": (force, lambda: _player(wrenches)),
    }
    rows = []
    for name, (space, policy) in ways.items():
        found = np.mean(
            [
                run(
                    Twin(seed=seed + i), policy(), task=space, scenarios=starts, seed=seed, threads=threads
                ).deviation(nominal)
                for i in range(ROBOTS)
            ],
            axis=0,
        )
        rows.append((name, *(f"{1e3 * mean:.1f} / {1e3 * end:.1f}" for mean, end in found.T)))
    return rows


def _player(actions: Array) -> Policy:
    """A policy that plays actions (n, T, action_size) whatever it sees."""
    steps = iter(actions.swapaxes(0, 1))
    return lambda observations: next(steps)


def _cells(found: Measured) -> list[str]:
    k, b = found.gains.stiffness, found.gains.damping
    cells = [_halves(x) for x in (k.error, k.bias, b.error)]
    both = [
        np.mean([k.observable, b.observable]),
        np.nanmean([k.coverage, b.coverage]),
        np.median(found.inertia[:3]),
    ]
    return [f"{100 * x:.1f}" for x in (*np.ravel(cells).tolist(), *both)]


def _halves(six: Array) -> Array:
    """Median over the axes of translation, and of rotation."""
    return np.nanmedian(six.reshape(2, 3), axis=1)
