"""What `benchmarks.transfer` runs on each task: scenarios, seeds, budgets, and the paper's numbers beside ours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType


@dataclass(frozen=True)
class Transferred:
    """A kind of transfer: its row in the table, the reward it is optimised under, and where it starts."""

    row: str
    reward: str = "learned"
    fresh: bool = False


@dataclass(frozen=True)
class Study:
    """Every method on every scenario of one task.

    Attributes
    ----------
    task : str
    metric : {"difference", "success"}
        What a cell shows: ``|S − S_e|/|S_e|``, or the share of successes.
    scenarios : tuple of str
        The training scenario first.
    first_seed : int
        Smaller seeds were used while the recipes were made; nothing that is reported comes from them.
    episodes : int
        Episodes of a cell.
    fresh_iterations, fresh_divergence : int, float
        Iterations and first trust region of a transfer that begins with random weights, which has farther to go; one
        that continues takes the recipe's.
    histories : tuple of int
        Numbers of observations that policies see.
    paper : dict
        What the paper reports (best three of five seeds), by row and scenario.
    sweeps : tuple of str
        Sweeps of the policies that are not transferred.
    """

    task: str
    metric: str
    scenarios: tuple[str, ...]
    first_seed: int
    episodes: int
    fresh_iterations: int
    fresh_divergence: float
    histories: tuple[int, ...]
    paper: Mapping[str, Mapping[str, float]]
    sweeps: tuple[str, ...]

    @property
    def unseen(self) -> tuple[str, ...]:
        """Scenarios that no demonstration showed."""
        return self.scenarios[1:]

    @property
    def file(self) -> str:
        """Name of the files with the results."""
        return self.task.replace("-", "_")


def _cells(scenarios: tuple[str, ...], rows: Mapping[str, tuple[float, ...]]) -> dict[str, dict[str, float]]:
    return {row: dict(zip(scenarios, values, strict=True)) for row, values in rows.items()}


_STARTS = ("train", "T1", "T2", "T3", "T4")

_CUP_ON_PLATE = Study(
    task="cup-on-plate",
    metric="difference",
    scenarios=_STARTS,
    first_seed=30,
    episodes=20,
    fresh_iterations=120,
    fresh_divergence=0.03,
    histories=(1,),
    paper=_cells(
        _STARTS,
        {
            "Gain-AIRL": (0.01, 0.09, 0.01, 0.19, 0.24),
            "Gain-BC": (0.02, 0.17, 0.10, 0.25, 0.36),
            "Force-AIRL": (0.10, 0.55, 0.58, 0.32, 0.26),
            "Force-BC": (0.05, 0.40, 0.20, 0.42, 0.58),
            "Constant gain": (0.14, 0.18, 0.18, 0.17, 0.39),
        },
    ),
    sweeps=("start",),
)

_VARIANTS = (
    "train", "tilt=-6", "tilt=-4", "tilt=0", "tilt=2", "scale=0.3", "scale=0.5", "scale=0.7", "scale=0.9",
)  # fmt: skip

_PEG_IN_HOLE = Study(
    task="peg-in-hole",
    metric="success",
    scenarios=_VARIANTS,
    first_seed=30,
    episodes=100,
    fresh_iterations=60,
    fresh_divergence=0.03,
    histories=(1, 5),
    paper=_cells(
        _VARIANTS,
        {
            "Gain-AIRL": (0.983, 0.917, 1.0, 1.0, 1.0, 0.917, 0.90, 0.95, 1.0),
            "Gain-BC": (0.967, 0.56, 1.0, 1.0, 0.467, 0.70, 0.80, 0.933, 0.917),
            "Force-AIRL": (1.0, 0.533, 0.717, 0.567, 0.0, 0.0, 0.0, 0.0, 0.916),
            "Force-BC": (0.933, 0.80, 0.95, 1.0, 0.75, 0.167, 0.40, 0.75, 0.90),
            "Constant gain": (0.367, 0.067, 0.10, 1.0, 0.317, 0.283, 0.433, 0.117, 0.233),
            "Gain-AIRL, history 5": (1.0, 1.0, 0.917, 1.0, 0.933, 0.867, 0.90, 0.917, 1.0),
            "Gain-BC, history 5": (0.90, 0.633, 0.867, 1.0, 0.55, 0.333, 0.667, 0.833, 0.833),
            "Force-AIRL, history 5": (0.75, 0.20, 0.0, 0.216, 0.316, 0.0, 0.217, 0.0, 0.267),
            "Force-BC, history 5": (0.933, 0.867, 0.867, 0.833, 0.833, 0.067, 0.50, 0.633, 0.767),
        },
    ),
    sweeps=("tilt", "scale", "offset", "friction", "clearance"),
)

STUDIES: Mapping[str, Study] = MappingProxyType({
    study.task: study for study in (_CUP_ON_PLATE, _PEG_IN_HOLE)
})  # fmt: skip
"""The study of each task."""

TRANSFERS: Mapping[tuple[str, int], tuple[Transferred, ...]] = MappingProxyType({
    ("gain", 1): (
        Transferred("Gain-AIRL"),
        Transferred("Gain-AIRL, fresh policy", fresh=True),
        Transferred("Gain, random reward", reward="random"),
        Transferred("Gain, random reward, fresh policy", reward="random", fresh=True),
    ),
    ("force", 1): (Transferred("Force-AIRL"), Transferred("Force, random reward", reward="random")),
    ("gain", 5): (Transferred("Gain-AIRL, history 5"),),
    ("force", 5): (Transferred("Force-AIRL, history 5"),),
})  # fmt: skip
"""How the AIRL policies of an action space and history are transferred."""
