r"""Peg-in-Hole: a tilted round peg, held by a compliant hand, has to find its way into a close round hole.

The peg has 25.37 mm, the hole 25.40 mm; the end-effector is the peg's centre of mass, 60 mm above the tip. The
policy runs at 50 Hz for 4 s, law and physics at 1 kHz. The observation is :math:`(e, \dot e)`, 12 numbers, or
the last few of them, with lengths in units of the part's scale: half a millimetre off is to a part of half the size
what a millimetre is to the whole one (docs/reproduction.md). There are two action spaces:

- ``gain`` (6), in [-1, 1]: the six stiffnesses at the centre of mass, between :data:`GAINS`' bounds;
- ``force`` (6), in [-30, 30]: the wrench itself, in units of :data:`WRENCH_UNIT`, its forces times the scale, as
  the forces of a stiffness are.

In both the law adds the same fixed damping at its own rate.

A lateral error settles in :math:`B_x/K_x` = 20 ms, a rotation in :math:`B_r/K_r` = 150 ms. A constant stiffness
therefore swings the tip off the axis while the peg turns upright, by up to 1.4 mm from 2° and 4.3 mm from 6°;
pressed down with 10 N, friction then holds it on the block beside the mouth. What solves the task is a tip that
stays still: a stiff tip, seen from the centre of mass (docs/reproduction.md).

References
----------
X. Zhang, L. Sun, Z. Kuang, M. Tomizuka, "Learning Variable Impedance Control via Inverse Reinforcement
Learning for Force-Related Tasks", IEEE Robotics and Automation Letters, 2021.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import mujoco
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from vic_toolbox.control.experts import TipStiffnessExpert
from vic_toolbox.errors import Array, InputError, finite_array
from vic_toolbox.gains import DiagonalStiffness, Parametrisation
from vic_toolbox.spatial import rotation_exp, rotation_to_quat_wxyz
from vic_toolbox.tasks import peg_picture
from vic_toolbox.tasks.impedance_task import ImpedanceTask, newest
from vic_toolbox.tasks.peg_scene import (
    CHAMFER,
    DAMPING,
    GOAL_DEPTH,
    SCENARIO_HELP,
    SCENARIOS,
    TIP_DISTANCE,
    PegScenario,
    as_scenario,
    physics_model,
)
from vic_toolbox.tasks.peg_simulation import PegSimulation
from vic_toolbox.tasks.task import SweepAxis

__all__ = [
    "CONSTANTS", "GAINS", "SCENARIOS", "TIP_STIFFNESS",
    "PegInHole", "PegScenario",
    "as_scenario", "physics_model",
]  # fmt: skip

TIP_STIFFNESS = (3000.0, 3000.0, 900.0, 12.0, 12.0, 12.0)
"""K_tip of the expert [N/m, Nm/rad]."""

GAINS = DiagonalStiffness(
    stiffness_low=(1.0, 1.0, 450.0, 0.01, 0.01, 0.01),
    stiffness_high=(3000.0, 3000.0, 2700.0, 12.0, 12.0, 12.0),
    damping=DAMPING,
)
"""Range of the gain action."""

CONSTANTS: Mapping[str, Array] = MappingProxyType({
    "constant": np.array(TIP_STIFFNESS),
    "middle": (GAINS.minimum + GAINS.maximum) / 2.0,
    "matched": np.array([*[DAMPING[0] * TIP_STIFFNESS[3] / DAMPING[3]] * 2, *TIP_STIFFNESS[2:]]),
})  # fmt: skip
"""Constant-gain baselines: K_tip at the centre of mass, the middle of the range, and K_tip with the lateral stiffness
(400 N/m) at which the time constants B/K of shift and rotation agree, so that the tip stays still while the peg turns.
"""

WRENCH_UNIT = np.array([0.25, 0.25, 2.5, 0.05, 0.05, 0.05])
"""Wrench that a force action of 1 stands for [N, Nm] at scale 1: about the root mean square of the expert's."""
LARGEST_FORCE_ACTION = 30.0

OBSERVATION_SCALE = np.array([1.5e-3, 1.5e-3, 1e-2, *[0.035] * 3, *[0.01] * 2, 0.015, *[0.1] * 3])
"""Typical size of e and ė [m, rad, m/s, rad/s] at scale 1."""

SUCCESS = 1e-3
"""Distance to the goal depth at the end that counts as inserted [m] at scale 1."""

TILT_NOISE, TIP_NOISE, GAP, GAP_NOISE = math.radians(0.2), 0.3e-3, 2e-3, 1e-3
"""Usual variation of the start: tilt [rad], tip off the axis [m]; mean gap above the mouth [m] and its variation."""

SMALLEST_MISALIGNMENT = 1e-3
"""Tilt [rad] up to twice which everything counts as aligned in :meth:`PegInHole.strata`."""

PENALTY = 0.05
"""Reward of a policy step with the peg not aligned with the hole is minus this [m]: more than any depth to go."""


def _axis(name: str, label: str, values: Sequence[float]) -> SweepAxis:
    return SweepAxis(label, tuple(values), lambda value: PegScenario(**{name: value}))


SWEEPS: Mapping[str, SweepAxis] = MappingProxyType({
    "tilt": _axis("tilt", "tilt  [deg]", (-12, -10, -8, -6, -4, -2, 0, 2, 4, 6, 8, 10, 12)),
    "scale": _axis("scale", "scale", (0.2, 0.3, 0.5, 0.7, 0.9, 1.0, 1.25, 1.5)),
    "offset": _axis("offset", "lateral offset  [mm]", (-2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5, 2.0)),
    "friction": _axis("friction", "friction", (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)),
    "clearance": _axis("clearance", "radial clearance  [µm]", (10, 15, 20, 30, 45, 60)),
})  # fmt: skip
"""Difficulty sweeps."""


class PegInHole(ImpedanceTask):
    """The task: physics, action space, score, success and expert.

    Parameters
    ----------
    action : {"gain", "force"}
        Action space.
    history : int
        Number of last observations that the policy sees, oldest first; the first one fills it at the start.
    scenario : str or PegScenario
        Name, text such as ``"tilt=-4,scale=0.5"``, or a scenario.
    wedges : int, optional
        Build the hole of so many convex wedges instead of the round one, for comparisons.
    substeps : int, optional
        Physics steps in a policy step; more of them are smaller ones, to see what depends on their size.

    Attributes
    ----------
    name, action, history, scenario
        As above.
    horizon, dt, substeps : int, float, int
        Policy steps of an episode, period of the policy [s], physics steps in a policy step.
    observation_size, action_size : int
    observation_unit : ndarray, shape (12,)
        What 1 stands for in an observation [m, rad, m/s, rad/s]: the scale for lengths and speeds, else 1.
    observation_scale : ndarray, shape (observation_size,)
    wrench_unit : ndarray, shape (6,)
        What a force action of 1 stands for [N, Nm].
    action_low, action_high : ndarray, shape (action_size,)
    expert : TipStiffnessExpert
        Its gains, in SI units.

    Raises
    ------
    InputError
        Unknown action space or scenario, history or substeps below 1.
    """

    name = "peg-in-hole"
    title = "Peg-in-Hole"
    horizon: int = 200
    dt: float = 0.02
    substeps: int = 20
    scenarios: Mapping[str, PegScenario] = SCENARIOS
    scenario_help = SCENARIO_HELP
    gains: Parametrisation = GAINS
    constants: Mapping[str, Array] = CONSTANTS
    sweeps: Mapping[str, SweepAxis] = SWEEPS
    law_damping: Array = np.array(DAMPING)
    expert: TipStiffnessExpert
    push: float = 0.4
    outcome_text: tuple[str, str] = ("the peg is in", "the peg is not in")
    as_scenario = staticmethod(as_scenario)

    def __init__(
        self,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        wedges: int | None = None,
        substeps: int | None = None,
    ) -> None:
        self.scenario = as_scenario(scenario)
        scale = self.scenario.scale
        unit = np.repeat([scale, 1.0, scale, 1.0], 3)
        super().__init__(
            action=action,
            history=history,
            substeps=substeps,
            observation_scale=OBSERVATION_SCALE,
            observation_unit=unit,
            wrench_unit=WRENCH_UNIT * unit[:6],
            largest_force_action=LARGEST_FORCE_ACTION,
        )
        self.wedges = wedges
        self.tip = (0.0, 0.0, -scale * TIP_DISTANCE)
        self.goal = np.array([0.0, 0.0, scale * (TIP_DISTANCE - GOAL_DEPTH)])
        self.expert = TipStiffnessExpert(parametrisation=GAINS, offset=self.tip, tip_stiffness=TIP_STIFFNESS)

    def with_action(self, action: str) -> PegInHole:
        """The same task in another action space."""
        return PegInHole(
            action=action,
            history=self.history,
            scenario=self.scenario,
            wedges=self.wedges,
            substeps=self.substeps,
        )

    def simulation(self, count: int, *, threads: int = 1) -> PegSimulation:
        """A new batch of simulations of the scenario's geometry, for :meth:`start`."""
        model = physics_model(self.scenario.geometry, self.wedges, time_step=self.dt / self.substeps)
        return PegSimulation(model, count, threads=threads)

    def start(
        self, simulation: PegSimulation, scenarios: Sequence[Any], *, noise: float, rng: np.random.Generator
    ) -> None:
        """Put peg i at rest above the mouth as ``scenarios[i]`` says.

        With ``noise`` 1 tilts vary by ±0.2° about x and y, the tip by ±0.3 mm along x and y, and the gap between
        the lowest point of the rim and the mouth by ±1 mm about 2 mm (never more), all uniformly.

        Raises
        ------
        InputError
            A scenario has another scale, friction or clearance than this task: those belong to the simulation.
        """
        chosen = [as_scenario(scenario) for scenario in scenarios]
        for scenario in chosen:
            if scenario.geometry != self.scenario.geometry:
                raise InputError(
                    f"scenario {scenario.name!r} has another scale, friction or clearance than this simulation "
                    f"({self.scenario.name!r}); make a task with it."
                )
        scale = self.scenario.scale
        vary = rng.uniform(-1.0, 1.0, (len(chosen), 5))
        rotation = np.zeros((len(chosen), 3))
        rotation[:, :2] = noise * TILT_NOISE * vary[:, :2]
        rotation[:, 1] += np.radians([scenario.tilt for scenario in chosen])
        tip = np.empty((len(chosen), 3))
        tip[:, :2] = noise * TIP_NOISE * vary[:, 2:4]
        tip[:, 0] += 1e-3 * np.array([scenario.offset for scenario in chosen])
        tip[:, 2] = GAP + min(noise, 1.0) * GAP_NOISE * vary[:, 4]
        matrices = rotation_exp(rotation)
        rim = simulation.model.geom("peg").size[0] * np.sqrt(1.0 - matrices[:, 2, 2] ** 2)
        position = scale * tip - matrices @ np.array(self.tip)
        position[:, 2] += rim
        simulation.reset(position, rotation_to_quat_wxyz(matrices))

    def act(self, simulation: PegSimulation, actions: Array) -> None:
        """Hand actions (n, 6), clipped to their bounds, to the law."""
        clipped = np.clip(actions, self.action_low, self.action_high)
        if self.action == "gain":
            simulation.set_stiffness(self._middle + self._half * clipped)
        else:
            np.multiply(clipped, self.wrench_unit, out=simulation.wrench)

    def picture_spec(self) -> mujoco.MjSpec:
        """The scene with everything that the eye wants, for :mod:`vic_toolbox.tasks.rendering`."""
        return peg_picture.picture_spec(self.scenario)

    def skeleton(self, qpos: ArrayLike) -> Array:
        """Top, centre of mass and tip of the peg, (..., 3, 3) [m], at qpos (..., 7)."""
        pose = np.asarray(qpos, dtype=np.float64)
        w, x, y, z = np.moveaxis(pose[..., 3:7], -1, 0)
        axis = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=-1)
        along = self.scenario.scale * TIP_DISTANCE * np.array([1.0, 0.0, -1.0])
        return pose[..., None, :3] + along[:, None] * axis[..., None, :]

    def tip_position(self, observations: ArrayLike) -> Array:
        """Where the tip is, (..., 3) [m], from the observations (..., 12 h)."""
        error = self._error(observations)
        return error[..., :3] + self.goal + rotation_exp(error[..., 3:6]) @ np.array(self.tip)

    def reward(self, observations: ArrayLike) -> Array:
        """Reward of a policy step that begins at the observations (..., 12 h), shape (...).

        Minus the distance of the tip to the goal depth, at scale 1 [m], while the tip is aligned with the hole,
        that is within the chamfer's reach of its axis; −0.05 while it is not.
        """
        last = finite_array("observations", newest(observations), shape=(..., 12))
        return _reward(last.reshape(-1, 12)).reshape(last.shape[:-1])

    def success(self, observations: ArrayLike) -> np.ndarray:
        """Whether the peg is in: its height less than 1 mm (at scale 1) off the goal, shape (...)."""
        return np.abs(newest(observations)[..., 2]) < SUCCESS

    def outcome(self, simulation: PegSimulation, observations: Array) -> dict[str, np.ndarray]:
        """End of an episode, (n,) each: ``success``, ``stopped``, ``distance`` [m] and ``peak_force`` [N]."""
        return {
            "success": self.success(observations) & ~simulation.stopped,
            "distance": np.linalg.norm(self._error(observations)[..., :3], axis=-1),
            "peak_force": simulation.peak_force.copy(),
            "stopped": simulation.stopped.copy(),
        }

    def strata(self, observations: ArrayLike) -> np.ndarray:
        r"""Octave of the misalignment, :math:`\log_2 \max(\lVert\theta_{xy}\rVert, \lVert e_{xy}\rVert/\ell)` above
        2 mrad, (...) integers from 0 to 5.

        Learning looks at each octave alike: half a millimetre off needs its own answer as much as five, and a peg
        that is in, where an episode spends most of its time, is one of six parts of the way.
        """
        last = newest(observations)
        lateral = np.linalg.norm(last[..., :2], axis=-1) / TIP_DISTANCE
        misalignment = np.maximum(np.linalg.norm(last[..., 3:5], axis=-1), lateral)
        octave = np.log2(np.maximum(misalignment / SMALLEST_MISALIGNMENT, 1.0))
        return np.minimum(octave, 5.0).astype(np.int64)

    def _feedback(self, parameters: Array, error: Array) -> Array:
        return -parameters * error[..., :6]


@njit(cache=True, error_model="numpy")
def _reward(rows):  # type: ignore[no-untyped-def]
    """Rewards (n,) at (e, ė) (n, 12) of scale 1; compiled, because it runs in every policy step.

    The tip is at e_pos + goal − ℓ R e_z, and by Rodrigues' formula, with θ = ‖e_rot‖ and (x, y, z) = e_rot,
    R e_z = e_z + sin θ/θ (y, −x, 0) + (1 − cos θ)/θ² (x z, y z, −x² − y²).
    """
    rewards = np.empty(rows.shape[0])
    for i in range(rows.shape[0]):
        x, y, z = rows[i, 3], rows[i, 4], rows[i, 5]
        half = 0.5 * math.sqrt(x * x + y * y + z * z)
        sinc = math.sin(half) / half if half > 0.0 else 1.0
        first, second = sinc * math.cos(half), 0.5 * sinc * sinc
        lateral = math.hypot(
            rows[i, 0] - TIP_DISTANCE * (first * y + second * x * z),
            rows[i, 1] - TIP_DISTANCE * (second * y * z - first * x),
        )
        height = rows[i, 2] + TIP_DISTANCE * second * (x * x + y * y)  # of the tip above the goal depth
        rewards[i] = -abs(height) if lateral <= CHAMFER else -PENALTY
    return rewards
