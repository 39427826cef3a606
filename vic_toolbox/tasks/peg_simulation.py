"""Many copies of the free peg in closed loop, stepped together.

Each simulation is one row of a ``mujoco.batch.Batch``. The impedance law is native to the model, so gains and
wrench are live views of the row's actuators; nothing else crosses from Python to the physics.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from mujoco import batch
from numba import njit
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, SimulationError, finite_array, integer
from vic_toolbox.tasks import collider

FASTEST, FARTHEST, STEEPEST = 2.0, 0.2, 1.0
"""Speed [m/s], distance from the goal [m] and tilt [rad] beyond which a peg is halted; the distance of a scaled-up
part grows with it."""

HAND = 0.2
"""Height above the centre of mass at which the peg is held [m]: pushes act there."""

_NO_STAGE = mujoco.mjtStage.mjSTAGE_NONE.value


class PegSimulation:
    """Batched closed loop of the peg under the impedance law.

    Parameters
    ----------
    model : mujoco.MjModel
        Compiled from :func:`vic_toolbox.tasks.peg_scene.build_spec`.
    count : int
        Number of simulations.
    threads : int
        Threads of the batch; 0 takes every processor. The numbers do not depend on it.

    Attributes
    ----------
    qpos, qvel : ndarray, shapes (count, 7) and (count, 6)
        Position [m] and quaternion wxyz of the centre of mass; velocity [m/s, world] and angular velocity
        [rad/s, body]; live.
    stiffness, damping : ndarray, shape (count, 6)
        Diagonals of K and B, axes of the world; set them with :meth:`set_stiffness`, the damping is fixed.
    wrench : ndarray, shape (count, 6)
        Wrench added to −K e − B ė; live.
    stopped : ndarray of bool, shape (count,)
        Simulations in protective stop since the last reset: the peg ran away, so it was halted where it last
        was in order, and stays there.
    """

    def __init__(self, model: mujoco.MjModel, count: int, *, threads: int = 1) -> None:
        self.count = integer("number of simulations", count, low=1)
        threads = integer("threads", threads, low=0)
        self.model = model
        collider.install()
        self.batch = batch.Batch(model, self.count, threads)
        self.qpos, self.qvel = self.batch.bind("qpos"), self.batch.bind("qvel")
        self.wrench = self.batch.bind("ctrl")
        self._bias = self.batch.expand("actuator_biasprm")
        self._constraint = self.batch.bind("qfrc_constraint")
        self._push = self.batch.bind("xfrc_applied")[:, model.body("peg").id]
        self._goal = model.site("goal").pos.copy()
        self._farthest = max(FARTHEST, 4.0 * self._goal[2])
        self.stopped = np.zeros(self.count, dtype=bool)
        self._peak = np.zeros(self.count)
        self._last_qpos = np.empty_like(self.qpos)

    @property
    def stiffness(self) -> Array:
        """Diagonal of K, (count, 6)."""
        return -self._bias[:, :, 1]

    @property
    def damping(self) -> Array:
        """Diagonal of B, (count, 6)."""
        return -self._bias[:, :, 2]

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the diagonal of K, (count, 6) [N/m, Nm/rad], until the next call."""
        np.negative(stiffness, out=self._bias[:, :, 1])

    def reset(self, position: ArrayLike, quat_wxyz: ArrayLike) -> None:
        """Put every peg at rest with its centre of mass at a pose, (count, 3) [m] and (count, 4); no stiffness."""
        collider.install()
        self.batch.reset(stage=_NO_STAGE)
        self.qpos[:, :3] = finite_array("position", position, shape=(..., 3))
        self.qpos[:, 3:] = finite_array("quat_wxyz", quat_wxyz, shape=(..., 4))
        self._bias[:, :, 1] = 0.0
        self._last_qpos[:] = self.qpos
        self.stopped[:] = False
        self._peak[:] = 0.0

    def set_push(self, force: ArrayLike) -> None:
        """Push the hand with a force (count, 3) or (3,) [N], world axes, until the next call.

        The hand is :data:`HAND` above the centre of mass of an upright peg, so that a push also turns the peg.
        """
        force = finite_array("force", force, shape=(..., 3))
        self._push[:, :3] = force
        self._push[:, 3] = -HAND * force[..., 1]
        self._push[:, 4] = HAND * force[..., 0]

    def step(self, steps: int) -> None:
        """Advance every simulation by ``steps`` physics steps, gains and wrench held.

        Raises
        ------
        SimulationError
            The collider is not installed (the hole would be a flat plate), or MuJoCo stopped in some simulations.
        """
        if not collider.installed():
            raise SimulationError(
                "the collider was uninstalled, and without it the hole is a flat plate; reset the simulation, "
                "which installs it again."
            )
        self._last_qpos[:] = self.qpos
        try:
            self.batch.step(nstep=steps)
        except batch.SimulationError as error:
            raise SimulationError(f"{error}. Check masses and gains of these simulations.") from error
        if self.stopped.any():
            self._hold(self.stopped)
        np.fmax(self._peak, self.contact_force, out=self._peak)  # a force that is not finite is no peak

    def observe(self) -> Array:
        """Pose error and its rate, (count, 12), at this very moment.

        A peg that is too fast, too far or too steep (or not finite) is put into its protective stop first.
        """
        out = np.empty((self.count, 12))
        if not _observe(self.qpos, self.qvel, self._goal, self._farthest, out, self.stopped):
            self._hold(self.stopped)
            _observe(self.qpos, self.qvel, self._goal, self._farthest, out, self.stopped)
        return out

    def _hold(self, rows: np.ndarray) -> None:
        """Undo the last step of these simulations and leave them at rest there."""
        self.qpos[rows] = self._last_qpos[rows]
        self.qvel[rows] = 0.0
        self.batch.bind("qacc_warmstart")[rows] = 0.0

    @property
    def contact_force(self) -> Array:
        """Force of the block on the peg at the last physics step, (count,) [N]."""
        x, y, z = self._constraint[:, :3].T
        return np.sqrt(x * x + y * y + z * z)

    @property
    def peak_force(self) -> Array:
        """Largest contact force at the end of any policy step since the reset, (count,) [N]."""
        return self._peak

    @property
    def time(self) -> float:
        """Simulated time since the reset [s]."""
        return float(self.batch.bind("time")[0])


@njit(cache=True, error_model="numpy")
def _observe(qpos, qvel, goal, farthest, out, stopped):  # type: ignore[no-untyped-def]
    """Write e = [p − p_d; log R] and ė = [v; R ω] of each peg into a row of `out`.

    A peg that is too far, too steep, too fast or not finite is marked in `stopped`, and the answer is False.
    """
    in_order = True
    for s in range(out.shape[0]):
        w, x, y, z = qpos[s, 3], qpos[s, 4], qpos[s, 5], qpos[s, 6]
        sine = math.sqrt(x * x + y * y + z * z)
        # the shorter way round; 2 atan2(s, c)/s tends to 2 at zero
        factor = 2.0 * math.atan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0
        factor = -factor if w < 0.0 else factor
        row, a, b, c = out[s], qvel[s, 3], qvel[s, 4], qvel[s, 5]
        for k in range(3):
            row[k] = qpos[s, k] - goal[k]
            row[6 + k] = qvel[s, k]
        row[3], row[4], row[5] = factor * x, factor * y, factor * z
        tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        row[9] = a + w * tx + y * tz - z * ty
        row[10] = b + w * ty + z * tx - x * tz
        row[11] = c + w * tz + x * ty - y * tx
        far = row[0] * row[0] + row[1] * row[1] + row[2] * row[2]
        steep = row[3] * row[3] + row[4] * row[4] + row[5] * row[5]
        fast = row[6] * row[6] + row[7] * row[7] + row[8] * row[8]
        spin = row[9] + row[10] + row[11]
        if not (far <= farthest**2 and steep <= STEEPEST**2 and fast <= FASTEST**2 and math.isfinite(spin)):
            stopped[s], in_order = True, False
    return in_order
