"""How much Peg-in-Hole depends on the numbers that were chosen for it: ``python -m benchmarks.peg_sensitivity``.

One number at a time is changed; the expert and the constant gains then do the task from −6° and from −2°, on the
starts of every evaluation. Nothing is learned. The rows are printed as a Markdown table, success in %, and the last
line is one JSON object. About three minutes on one core.

The scene is edited after :func:`~vic_toolbox.tasks.peg_scene.build_spec` made it, so that the task itself needs no
settings that nobody should change.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from vic_toolbox.control.experts import TipStiffnessExpert
from vic_toolbox.experiments.evaluation import Policy, run_episodes
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.tasks import collider
from vic_toolbox.tasks.peg_in_hole import CONSTANTS, GAINS, TIP_STIFFNESS, PegInHole
from vic_toolbox.tasks.peg_scene import (
    BLOCK,
    BORE_DEPTH,
    DAMPING,
    GOAL_DEPTH,
    HOLE_RADIUS,
    SCENARIOS,
    SOLIMP,
    TIMESTEP,
    TIP_DISTANCE,
    PegScenario,
    build_spec,
)
from vic_toolbox.tasks.peg_simulation import PegSimulation

TILTS = (-6.0, -2.0)
"""[deg]"""

Edit = Callable[[mujoco.MjSpec], None]


@dataclass(frozen=True)
class Variant:
    """One changed number of the task.

    Attributes
    ----------
    name : str
        What is changed, with its unit.
    scenario : PegScenario
        Friction and clearance; the tilt is set later.
    edit : callable, optional
        Changes the scene.
    tip_distance : float
        From the centre of mass to the tip [m].
    substeps : int
        Physics steps in a policy step; the time step follows.
    tip_factor : float
        On K_tip but for its z, which only says how long the way down takes; for the expert's and for the constant gain
        of the same numbers.
    damping : ndarray, shape (6,)
        Of the law [Ns/m, Nms/rad].
    """

    name: str
    scenario: PegScenario = SCENARIOS["train"]
    edit: Edit | None = None
    tip_distance: float = TIP_DISTANCE
    substeps: int = PegInHole.substeps
    tip_factor: float = 1.0
    damping: tuple[float, ...] = DAMPING

    @property
    def tip_stiffness(self) -> np.ndarray:
        """K_tip [N/m, Nm/rad]."""
        factor = self.tip_factor
        return np.array([factor, factor, 1.0, factor, factor, factor]) * TIP_STIFFNESS

    @property
    def matched(self) -> np.ndarray:
        """Constant gains with K_x/B_x = K_r/B_r for the damping as it is here [N/m, Nm/rad]."""
        stiffness = CONSTANTS["matched"].copy()
        stiffness[:2] = self.damping[0] * stiffness[4] / self.damping[4]
        return stiffness


class VariedPegInHole(PegInHole):
    """Peg-in-Hole with one number changed."""

    def __init__(self, variant: Variant, *, tilt: float) -> None:
        super().__init__(scenario=replace(variant.scenario, tilt=tilt))
        self.variant = variant
        self.substeps = variant.substeps
        self.tip = (0.0, 0.0, -variant.tip_distance)
        self.goal = np.array([0.0, 0.0, variant.tip_distance - GOAL_DEPTH])
        self.expert = TipStiffnessExpert(
            parametrisation=GAINS, offset=self.tip, tip_stiffness=variant.tip_stiffness
        )

    def simulation(self, count: int, *, threads: int = 1) -> PegSimulation:
        """A new batch of simulations of the changed scene."""
        spec = build_spec(self.scenario)
        spec.option.timestep = TIMESTEP * PegInHole.substeps / self.substeps
        _set_length(spec, self.variant.tip_distance)
        for axis, value in enumerate(self.variant.damping):
            spec.actuator(f"impedance_{axis}").biasprm[2] = -value
        if self.variant.edit is not None:
            self.variant.edit(spec)
        return PegSimulation(spec.compile(), count, threads=threads)

    def policies(self) -> Mapping[str, Policy]:
        """The expert and the constant gains, with K_tip as it is here."""
        constants = {**CONSTANTS, "constant": self.variant.tip_stiffness, "matched": self.variant.matched}
        return {
            "expert": Policy(self.expert.action, "expert"),
            **{name: Policy(_Constant(parameters), name) for name, parameters in constants.items()},
        }


@dataclass(frozen=True)
class _Constant:
    """Always the same gains."""

    parameters: np.ndarray

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        return np.broadcast_to(GAINS.parameters_to_action(self.parameters), (len(observations), 6))


def _set_length(spec: mujoco.MjSpec, tip_distance: float) -> None:
    """Make the peg longer or shorter, its centre of mass in the middle; mass and inertia stay."""
    peg = spec.geom("peg")
    peg.size = [peg.size[0], tip_distance, 0.0]
    spec.body("tip").pos = [0.0, 0.0, -tip_distance]
    spec.site("goal").pos = [0.0, 0.0, tip_distance - GOAL_DEPTH]


def chamfer(width: float) -> Edit:
    """Give the hole a chamfer of this width [m]."""

    def edit(spec: mujoco.MjSpec) -> None:
        old = spec.geom("block")
        keep = ("contype", "conaffinity", "friction", "solref", "solimp", "condim")
        kept = {name: getattr(old, name) for name in keep}
        spec.delete(spec.hfield("block"))
        spec.delete(old)
        collider.add_hole(
            spec,
            "block",
            radius=HOLE_RADIUS,
            chamfer=width,
            depth=BORE_DEPTH,
            half_width=BLOCK,
            **kept,
        )

    return edit


def contacts(solref: tuple[float, ...], solimp: tuple[float, ...]) -> Edit:
    """Give the contacts other parameters."""

    def edit(spec: mujoco.MjSpec) -> None:
        for name in ("peg", "block"):
            spec.geom(name).solref, spec.geom(name).solimp = solref, solimp

    return edit


def _damping(translations: float, rotations: float) -> tuple[float, ...]:
    """The law's damping times two factors."""
    return tuple(np.multiply(DAMPING, np.repeat([translations, rotations], 3)).tolist())


VARIANTS = (
    Variant("as it is"),
    *(Variant(f"friction {mu:g}", PegScenario(friction=mu)) for mu in (0.1, 0.2, 0.3)),
    *(Variant(f"chamfer {1e3 * c:g} mm", edit=chamfer(c)) for c in (0.2e-3, 0.3e-3, 0.6e-3, 1e-3)),
    *(Variant(f"clearance {c:g} µm", PegScenario(clearance=c)) for c in (10.0, 30.0, 60.0)),
    *(Variant(f"tip {1e3 * d:g} mm from the COM", tip_distance=d) for d in (40e-3, 80e-3)),
    *(Variant(f"time step {20 / n:g} ms", substeps=n) for n in (40, 80)),
    Variant("contacts 5 × slower (solref .01)", edit=contacts((0.01, 1.0), SOLIMP)),
    Variant("contacts of MuJoCo's own", edit=contacts((0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0))),
    *(Variant(f"K_tip × {f:g}, but for z", tip_factor=f) for f in (0.5, 0.75)),
    *(Variant(f"B × {f:g}", damping=_damping(f, f)) for f in (0.7, 1.4)),
    *(Variant(f"B of the rotations × {f:g}", damping=_damping(1.0, f)) for f in (0.5, 2.0)),
)


def success(variant: Variant, episodes: int) -> dict[str, list[float]]:
    """Success rate of each policy from each tilt."""
    rates: dict[str, list[float]] = {}
    for tilt in TILTS:
        task = VariedPegInHole(variant, tilt=tilt)
        for name, policy in task.policies().items():
            outcome = run_episodes(task, policy.act, episodes=episodes, threads=1)
            rates.setdefault(name, []).append(float(outcome.success.mean()))
    return rates


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=50, help="of each policy, tilt and variant")
    episodes = parser.parse_args().episodes
    worst = wilson_interval(0.5, episodes)[1] - 0.5
    sure = wilson_interval(1.0, episodes)[0]
    print(
        f"Success in % from −6° / −2°, {episodes} episodes each: 95 % intervals are at most ±{100 * worst:.0f}, "
        f"and 100 stands for at least {100 * sure:.0f}.\n"
    )
    print("| | expert | diag(K_tip) | mid-range | matched |\n|---|---|---|---|---|")
    result = {}
    for variant in VARIANTS:
        result[variant.name] = rates = success(variant, episodes)
        cells = (" / ".join(f"{100 * rate:.0f}" for rate in rates[name]) for name in ("expert", *CONSTANTS))
        print(f"| {variant.name} | " + " | ".join(cells) + " |", flush=True)
    print(json.dumps({"episodes": episodes, "tilts": TILTS, "success": result}))


if __name__ == "__main__":
    main()
