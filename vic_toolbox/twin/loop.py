"""The twin in closed loop: what the encoders say, what the controller makes of it, what the arm then does.

Many copies of one robot run side by side, a millisecond at a time:

1. the encoders read angles and speeds, with noise and in steps, and the controller gets them a delay later;
2. the controller evaluates the impedance law with the *nominal* model at that old state;
3. the motors' torque and the hand's wrench, both held for the millisecond, move the perturbed arm.

The law is the compiled one of :mod:`vic_toolbox.tasks`: a batch of the nominal scene is set to the measured state
and evaluated, never stepped.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.control.compiled import LAW_FIELDS
from vic_toolbox.errors import Array
from vic_toolbox.tasks import cup_scene
from vic_toolbox.tasks.scene import TIMESTEP
from vic_toolbox.tasks.simulation import ArmSimulation
from vic_toolbox.twin.parameters import Imperfections, Specimen
from vic_toolbox.twin.plant import HAND, nominal_model, plant_model, sensor_columns

PERIOD = TIMESTEP
"""Of measurement, law and physics [s]."""


class Loop:
    """Copies of one robot under its controller.

    Parameters
    ----------
    imperfections : Imperfections
        Delay and noise.
    specimen : Specimen
        The robot.
    count : int
        Copies.
    rng : numpy.random.Generator
        Noise of the encoders.
    threads : int
        Threads of the physics; the numbers do not depend on it.

    Attributes
    ----------
    law : ArmSimulation
        The controller. Its ``stiffness``, ``damping`` and ``wrench`` are what a policy sets, its state is what
        the encoders said.
    arm : ArmSimulation
        The robot itself.
    time : float
        Since the reset [s].
    """

    def __init__(
        self,
        imperfections: Imperfections,
        specimen: Specimen,
        count: int,
        *,
        rng: np.random.Generator,
        threads: int = 1,
    ) -> None:
        self._imperfections, self._rng = imperfections, rng
        self.law = ArmSimulation(nominal_model(), count, threads=threads, push_body=cup_scene.CUP)
        self.arm = ArmSimulation(plant_model(specimen), count, threads=threads, push_body=HAND)
        self._torque = self.law.batch.bind("ctrl")
        self._motors = self.arm.batch.bind("ctrl")
        self._hand = self.arm.batch.bind("xfrc_applied")[:, self.arm.model.body(HAND).id]
        self._readings = self.arm.batch.bind("sensordata")
        self._columns = sensor_columns(self.arm.model)
        self._pipeline: deque[tuple[Array, Array]] = deque()
        self.time = 0.0

    def reset(self, qpos: ArrayLike) -> None:
        """Put every copy at rest in its posture (count, nv) or (nv,), all gains at zero, x_d at the goal."""
        self.law.reset(qpos, position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
        self.begin()

    def begin(self) -> None:
        """Put the arm at rest where the law, reset by a task with its gains and reference, believes it to be."""
        self.arm.reset(self.law.qpos, position=cup_scene.GOAL, quat_wxyz=cup_scene.TOOL_DOWN_QUAT_WXYZ)
        # the robot's motors follow the controller, not a law that knows the robot's true state
        self.arm.batch.bind("userdata")[:, LAW_FIELDS["magic"]] = 0.0
        self._pipeline.clear()
        for _ in range(self._imperfections.delay_steps):
            self._pipeline.append(self._read())
        self.time = 0.0
        self.measure()

    def measure(self) -> None:
        """Read the encoders; the controller then holds what they said a delay ago."""
        self._pipeline.append(self._read())
        self.law.qpos[:], self.law.qvel[:] = self._pipeline.popleft()

    def step(self, hand: ArrayLike = 0.0) -> None:
        """Advance by one period.

        Parameters
        ----------
        hand : array_like, shape (count, 6)
            Wrench of the operator on the end-effector, about its origin, world axes [N, Nm].
        """
        self.law.batch.forward()
        self._motors[:] = self._torque
        self._hand[:] = hand
        self.arm.step(1)
        self.time += PERIOD
        self.measure()

    @property
    def transmitted(self) -> Array:
        """Wrench (count, 6) of the tool on the sensor at the beginning of the last step, its axes, no noise.

        It is what the outside does to gripper and cup, and their weight and inertia.
        """
        return -self._readings[:, self._columns]

    def _read(self) -> tuple[Array, Array]:
        """Angles and speeds as the encoders see them now."""
        flaws, qpos, qvel = self._imperfections, self.arm.qpos.copy(), self.arm.qvel.copy()
        if flaws.angle_noise:
            qpos += flaws.angle_noise * self._rng.standard_normal(qpos.shape)
        if flaws.speed_noise:
            qvel += flaws.speed_noise * self._rng.standard_normal(qvel.shape)
        return in_steps(qpos, flaws.angle_resolution), qvel


def in_steps(value: Array, step: float | Array) -> Array:
    """Values rounded to multiples of a step; a step of zero does not round."""
    size = np.asarray(step)
    return np.where(size > 0, np.round(value / np.where(size > 0, size, 1.0)) * size, value)
