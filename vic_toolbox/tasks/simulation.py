"""Many copies of one arm in closed loop, stepped together.

Each simulation is one row of a ``mujoco.batch.Batch``. Gains, wrench and reference are live views of the
row's law block: write them, call :meth:`ArmSimulation.step`, read :meth:`ArmSimulation.observe`. Nothing else
crosses from Python to the physics, and nothing at all during the steps.
"""

from __future__ import annotations

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import ArrayLike

from vic_toolbox.control.compiled import LAW_FIELDS, LAW_MAGIC, law_block_size
from vic_toolbox.errors import SimulationError, finite_array, integer
from vic_toolbox.tasks import callback
from vic_toolbox.tasks.kinematics import FASTEST_JOINT, Chain, compile_observation

_NO_STAGE = mujoco.mjtStage.mjSTAGE_NONE.value


class ArmSimulation:
    """Batched closed loop of an arm under the impedance law.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled from a :func:`vic_toolbox.tasks.scene.arm_spec`.
    count : int
        Number of simulations.
    threads : int
        Threads of the batch; 0 takes every processor. The numbers do not depend on it.
    push_body : str
        Body that :meth:`set_push` acts on.

    Attributes
    ----------
    qpos, qvel : ndarray, shape (count, nv)
        Joint angles [rad] and speeds [rad/s]; live.
    stiffness, damping : ndarray, shape (count, 6)
        Diagonals of K and B; live.
    wrench : ndarray, shape (count, 6)
        Wrench added to −K e − B ė; live.
    stopped : ndarray of bool, shape (count,)
        Simulations in protective stop since the last reset: a joint ran away (above 30 rad/s, or not finite),
        so the arm was halted where it last was in order, as a real controller would, and stays there.
    """

    def __init__(self, model: mujoco.MjModel, count: int, *, threads: int = 1, push_body: str) -> None:
        self.count = integer("number of simulations", count, low=1)
        threads = integer("threads", threads, low=0)
        self.nv = model.nu
        self.model = model
        callback.install(self.nv)
        self.batch = batch.Batch(model, self.count, threads)
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self._blocks = self.batch.bind("userdata")
        self.stiffness = self._blocks[:, LAW_FIELDS["stiffness_diagonal"]]
        self.damping = self._blocks[:, LAW_FIELDS["damping_diagonal"]]
        self.wrench = self._blocks[:, LAW_FIELDS["wrench"]]
        extra = law_block_size(self.nv)
        self.stopped = np.zeros(self.count, dtype=bool)
        self._last_qpos = np.empty_like(self.qpos)
        self._ticks = self._blocks[:, extra + callback.EXTRA_FIELDS["ticks"]]
        self._peak = self._blocks[:, extra + callback.EXTRA_FIELDS["peak_force"]]
        self._sensor = self.batch.bind("sensordata")
        self._push = self.batch.bind("xfrc_applied")[:, model.body(push_body).id]
        chain = Chain.from_model(model)
        self._chain = chain.offsets, chain.quats_wxyz, chain.axes
        self._observe = compile_observation()

    def reset(self, qpos: ArrayLike, *, position: ArrayLike, quat_wxyz: ArrayLike) -> None:
        """Put every simulation at rest in its posture ``qpos`` (count, nv) or (nv,), all gains at zero.

        ``position`` (3,) [m] and ``quat_wxyz`` (4,) are the reference pose x_d of the law.
        """
        qpos = finite_array("qpos", qpos, shape=(..., self.nv))
        callback.install(self.nv)
        self.batch.reset(stage=_NO_STAGE)
        self.qpos[:] = qpos
        self.stopped[:] = False
        self._blocks[:] = 0.0
        self._blocks[:, LAW_FIELDS["magic"]] = LAW_MAGIC
        self._blocks[:, LAW_FIELDS["reference_position"]] = position
        self._blocks[:, LAW_FIELDS["reference_quat_wxyz"]] = quat_wxyz

    def set_push(self, force: ArrayLike) -> None:
        """Push with a force (count, 3) or (3,) [N], world axes, until the next call."""
        self._push[:, :3] = finite_array("force", force, shape=(..., 3))

    def step(self, steps: int) -> None:
        """Advance every simulation by ``steps`` physics steps, gains and wrench held.

        Raises
        ------
        SimulationError
            MuJoCo stopped in some simulations; they are named.
        """
        self._ticks[:] = 0.0
        self._last_qpos[:] = self.qpos
        try:
            self.batch.step(nstep=steps)
        except batch.SimulationError as error:
            raise SimulationError(f"{error}. Check masses and gains of these simulations.") from error
        if self.stopped.any():
            self._hold(self.stopped)

    def observe(self) -> np.ndarray:
        """Pose error and its rate, (count, 12), at this very moment (MuJoCo's own fields are one step old).

        A simulation whose joint speed is not finite or above 30 rad/s is put into its protective stop first.
        """
        out = np.empty((self.count, 12))
        if not self._observe(*self._chain, self.qpos, self.qvel, self._blocks, out):
            self.stopped |= ~(np.abs(self.qvel).max(axis=1) <= FASTEST_JOINT)
            self._hold(self.stopped)
            self._observe(*self._chain, self.qpos, self.qvel, self._blocks, out)
        return out

    def _hold(self, rows: np.ndarray) -> None:
        """Undo the last step of these simulations and leave them at rest there."""
        self.qpos[rows] = self._last_qpos[rows]
        self.qvel[rows] = 0.0
        self.batch.bind("qacc_warmstart")[rows] = 0.0

    @property
    def contact_force(self) -> np.ndarray:
        """Force of the furniture on the held object at the last physics step, (count,) [N]."""
        return np.linalg.norm(self._sensor[:, 1:4], axis=1)

    @property
    def peak_force(self) -> np.ndarray:
        """Largest contact force since the reset, (count,) [N]."""
        return np.maximum(self._peak, self.contact_force)

    @property
    def time(self) -> float:
        """Simulated time since the reset [s]."""
        return float(self.batch.bind("time")[0])
