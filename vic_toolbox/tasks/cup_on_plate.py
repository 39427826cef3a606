r"""Cup-on-Plate: an arm puts a cup down on a plate, fast and softly.

The policy runs at 100 Hz for 5 s, law and physics at 1 kHz. The observation is :math:`(e, \dot e)`, 12
numbers, or the last few of them. There are two action spaces, both normalised:

- ``gain`` (7), in [-1, 1]: three stiffnesses of 60-200 N/m, three of 1-6 Nm/rad, and the damping factor d of
  9-12,
  :math:`B = d\sqrt{K}` along the axes;
- ``force`` (6), in [-40, 40]: the feedback wrench itself, in units of 5 N and 0.1 Nm.

In both the law adds the same rotational damping of :math:`12\sqrt3` Nms/rad at its own rate. A wrench that is
held for 10 ms cannot damp the small inertia of the tool (0.05-0.10 kg m²): without this, force policies would
fail for a reason that has nothing to do with learning.

The score penalises, with squared norms, the pose error while the cup is far and its rate while it is near.
(With plain norms the sum of speeds is the length of the path, and nothing is left to gain by being fast.)

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

from vic_toolbox.control.experts import ThreePhaseExpert
from vic_toolbox.errors import Array
from vic_toolbox.gains import DampingFactor, Parametrisation
from vic_toolbox.tasks import rendering
from vic_toolbox.tasks.cup_scene import (
    CUP,
    GOAL,
    PLATE,
    PLATE_RADIUS,
    PLATE_TOP,
    SCENARIO_HELP,
    SCENARIOS,
    TOOL_DOWN,
    TOOL_DOWN_QUAT_WXYZ,
    as_scenario,
    build_spec,
    physics_model,
    robot,
    start_angles,
)
from vic_toolbox.tasks.impedance_task import ImpedanceTask, newest
from vic_toolbox.tasks.simulation import ArmSimulation
from vic_toolbox.tasks.starts import Scenario
from vic_toolbox.tasks.task import SweepAxis

__all__ = [
    "CUP", "GAINS", "GOAL", "PLATE", "PLATE_RADIUS", "PLATE_TOP", "SCENARIOS",
    "TOOL_DOWN", "TOOL_DOWN_QUAT_WXYZ",
    "CupOnPlate",
    "as_scenario", "build_spec", "physics_model", "robot", "start_angles",
]  # fmt: skip

FAR, NEAR = 0.4, 0.2
"""Distances to the goal between which the task turns from accelerating to reaching [m]."""

ROTATIONAL_DAMPING = 12 * math.sqrt(3.0)
"""Damping about every axis, at the law's rate, in both action spaces [Nms/rad]."""

GAINS = DampingFactor(
    stiffness_low=(60.0, 60.0, 60.0, 1.0, 1.0, 1.0),
    stiffness_high=(200.0, 200.0, 200.0, 6.0, 6.0, 6.0),
    factor_low=9.0,
    factor_high=12.0,
    rotational_damping=ROTATIONAL_DAMPING,
)
"""Range of the gain action."""

CONSTANTS: Mapping[str, np.ndarray] = MappingProxyType({"constant": (GAINS.minimum + GAINS.maximum) / 2.0})
"""Constant-gain baseline: the middle of the range."""

START_NOISE = 0.02
"""Usual variation of the start: standard deviation of every joint angle [rad]."""

SKELETON = ("base_link", *(f"link_{i}" for i in range(1, 7)), "gripper", "cup_bottom")
"""Frames between which the arm is drawn as a line."""

WRENCH_UNIT = np.repeat([5.0, 0.1], 3)
"""Wrench that a force action of 1 stands for [N, Nm]."""
LARGEST_FORCE_ACTION = 40.0

OBSERVATION_SCALE = np.repeat([0.2, 0.05, 0.3, 0.3], 3)
"""Typical size of e and ė [m, rad, m/s, rad/s]."""

SCORE_WEIGHT = 15.78
"""Chosen once, so that the expert's scores are near the published ones (training start: −336, there −343)."""

CLOSE, UPRIGHT, RESTING, SOFT = 0.025, math.radians(10.0), 0.02, 25.0
"""Success: distance to the goal [m], tilt [rad], speed of the cup's bottom [m/s], peak contact force [N].

At 25 mm the whole cup stands on the plate with 15 mm to spare; 10° is a quarter of the angle at which it
would tip.
"""


class CupOnPlate(ImpedanceTask):
    """The task: physics, action space, score, success and expert.

    Parameters
    ----------
    action : {"gain", "force"}
        Action space.
    history : int
        Number of last observations that the policy sees, oldest first; the first one fills it at the start.
    scenario : str, Scenario or (x, y, z)
        Where episodes start unless a reset says otherwise: a name, "x,y,z" or a point [m]; see
        :func:`vic_toolbox.tasks.cup_scene.start_angles` for what is checked.
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
        What 1 stands for in an observation [m, rad, m/s, rad/s]: ones.
    observation_scale : ndarray, shape (observation_size,)
    action_low, action_high : ndarray, shape (action_size,)
    expert : ThreePhaseExpert
        Its gains, in SI units.

    Raises
    ------
    InputError
        Unknown action space or scenario, history below 1, or a start inside the furniture.
    ReachError
        The arm cannot start there.
    """

    name = "cup-on-plate"
    title = "Cup-on-Plate"
    horizon: int = 500
    dt: float = 0.01
    substeps: int = 10
    scenarios: Mapping[str, Scenario] = SCENARIOS
    scenario_help = SCENARIO_HELP
    sweeps: Mapping[str, SweepAxis] = MappingProxyType({})
    gains: Parametrisation = GAINS
    constants: Mapping[str, np.ndarray] = CONSTANTS
    law_damping: Array = np.repeat([0.0, ROTATIONAL_DAMPING], 3)
    expert: ThreePhaseExpert
    push: float = 5.0
    outcome_text: tuple[str, str] = ("the cup stands", "the cup does not stand")
    as_scenario = staticmethod(as_scenario)

    def __init__(
        self,
        *,
        action: str = "gain",
        history: int = 1,
        scenario: Any = "train",
        substeps: int | None = None,
    ) -> None:
        super().__init__(
            action=action,
            history=history,
            substeps=substeps,
            observation_scale=OBSERVATION_SCALE,
            observation_unit=np.ones(12),
            wrench_unit=WRENCH_UNIT,
            largest_force_action=LARGEST_FORCE_ACTION,
        )
        self.scenario = as_scenario(scenario)
        self.goal = np.array(GOAL)
        self.expert = ThreePhaseExpert(parametrisation=GAINS, far=FAR, near=NEAR)
        start_angles(self.scenario.start)

    def with_action(self, action: str) -> CupOnPlate:
        """The same task in another action space."""
        return CupOnPlate(action=action, history=self.history, scenario=self.scenario, substeps=self.substeps)

    def simulation(self, count: int, *, threads: int = 1) -> ArmSimulation:
        """A new batch of simulations, for :meth:`start`."""
        model = physics_model(time_step=self.dt / self.substeps)
        return ArmSimulation(model, count, threads=threads, push_body=CUP)

    def start(
        self, simulation: ArmSimulation, scenarios: Sequence[Any], *, noise: float, rng: np.random.Generator
    ) -> None:
        """Put simulation i at rest at ``scenarios[i]``, every joint angle off by N(0, (0.02 rad · noise)²)."""
        starts = [as_scenario(scenario).start for scenario in scenarios]
        qpos = np.array([start_angles(start) for start in starts])
        qpos += START_NOISE * noise * rng.standard_normal(qpos.shape)
        simulation.reset(qpos, position=GOAL, quat_wxyz=TOOL_DOWN_QUAT_WXYZ)
        simulation.damping[:, 3:] = ROTATIONAL_DAMPING

    def act(self, simulation: ArmSimulation, actions: Array) -> None:
        """Hand actions (n, action_size), clipped to their bounds, to the law."""
        if self.action == "gain":
            _set_gains(actions, self._middle, self._half, simulation.stiffness, simulation.damping)
        else:
            np.multiply(
                actions.clip(self.action_low, self.action_high), self.wrench_unit, out=simulation.wrench
            )

    def picture_spec(self) -> mujoco.MjSpec:
        """The scene with everything that the eye wants, for :mod:`vic_toolbox.tasks.rendering`."""
        return rendering.decorate(build_spec(), table="table")

    def skeleton(self, qpos: ArrayLike) -> Array:
        """Joints of the arm from its base to the cup, (..., 9, 3) [m], at joint angles (..., 6) [rad]."""
        arm, angles = robot(), np.asarray(qpos, dtype=np.float64)
        return np.stack([arm.pose(angles, frame=frame)[..., :3, 3] for frame in SKELETON], axis=-2)

    def reward(self, observations: ArrayLike) -> Array:
        r"""Reward of a policy step that begins at the observations (..., 12 h), shape (...).

        .. math::
            r = -15.78\,\left(\lVert e\rVert^2\,[\lVert e_{pos}\rVert > 0.2]
                + \lVert\dot e\rVert^2\,[\lVert e_{pos}\rVert \le 0.4]\right)
        """
        last = newest(observations)
        return _reward(last.reshape(-1, 12)).reshape(last.shape[:-1])

    def success(self, observations: ArrayLike, peak_force: ArrayLike) -> Array:
        """Whether the cup has been delivered: near the goal, upright, at rest, and never pressed hard.

        Parameters
        ----------
        observations : array_like, shape (..., 12 h)
            At the end of the episode.
        peak_force : array_like, shape (...)
            Largest contact force of the episode [N].

        Returns
        -------
        ndarray of bool, shape (...)
            Within 25 mm of the goal, tilted by less than 10°, slower than 20 mm/s, never above 25 N.
        """
        last = newest(observations)
        distance, speed = (np.linalg.norm(last[..., k : k + 3], axis=-1) for k in (0, 6))
        tilt = np.linalg.norm(last[..., 3:5], axis=-1)  # turning about the vertical does not tilt
        return (distance < CLOSE) & (tilt < UPRIGHT) & (speed < RESTING) & (np.asarray(peak_force) < SOFT)

    def outcome(self, simulation: ArmSimulation, observations: Array) -> dict[str, Array]:
        """End of an episode, (n,) each: ``success``, ``stopped``, ``distance`` [m] and ``peak_force`` [N]."""
        peak = simulation.peak_force
        distance = np.linalg.norm(observations[..., -12:-9], axis=-1)
        success = self.success(observations, peak) & ~simulation.stopped
        return {
            "success": success,
            "distance": distance,
            "peak_force": peak,
            "stopped": simulation.stopped.copy(),
        }

    def strata(self, observations: ArrayLike) -> Array:
        """Distance to the goal in steps of 0.1 m, (...) integers from 0 to 8.

        Learning looks at every step of the way alike, however long the arm dwells there.
        """
        distance = np.linalg.norm(newest(observations)[..., :3], axis=-1)
        return np.minimum(10.0 * distance, 8.0).astype(np.int64)

    def _feedback(self, parameters: Array, error: Array) -> Array:
        wrench = -parameters[..., :6] * error[..., :6]
        wrench[..., :3] -= parameters[..., 6:] * np.sqrt(parameters[..., :3]) * error[..., 6:9]
        return wrench


@njit(cache=True)
def _reward(rows):  # type: ignore[no-untyped-def]
    """Rewards (n,) at (e, ė) (n, 12); compiled, because it runs in every policy step."""
    rewards = np.zeros(rows.shape[0])
    for i in range(rows.shape[0]):
        position = rotation = rate = 0.0
        for k in range(3):
            position += rows[i, k] ** 2
            rotation += rows[i, 3 + k] ** 2
            rate += rows[i, 6 + k] ** 2 + rows[i, 9 + k] ** 2
        if position > NEAR**2:
            rewards[i] -= SCORE_WEIGHT * (position + rotation)
        if position <= FAR**2:
            rewards[i] -= SCORE_WEIGHT * rate
    return rewards


@njit(cache=True)
def _set_gains(actions, middle, half, stiffness, damping):  # type: ignore[no-untyped-def]
    """Write k (n, 6) and, along the axes, d √k (n, 3 of 6), of actions (n, 7) clipped to [−1, 1]."""
    for i in range(actions.shape[0]):
        factor = middle[6] + half[6] * min(max(actions[i, 6], -1.0), 1.0)
        for k in range(6):
            stiffness[i, k] = middle[k] + half[k] * min(max(actions[i, k], -1.0), 1.0)
        for k in range(3):
            damping[i, k] = factor * math.sqrt(stiffness[i, k])
