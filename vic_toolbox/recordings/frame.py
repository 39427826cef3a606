"""Is the wrench in the axes that it is said to be in? A search over the ways to mount a sensor.

A wrench in the wrong axes is the most common fault of a log, and a fit to it gives numbers: small, often
negative, with a poor fit. Here every way to mount a sensor squarely, the 24 rotations that map axes onto axes,
with both signs, is tried, and the one under which a constant, diagonal, non-negative spring and damper explain
most of the force is compared with the log as it stands.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares

from vic_toolbox.errors import Array, positive
from vic_toolbox.recordings import quaternions
from vic_toolbox.recordings.recording import Recording
from vic_toolbox.recordings.transport import wrench_to_world
from vic_toolbox.spatial import rotation_exp

FORCE = 2.0
"""Forces below this [N] say little about a frame: noise, bias, friction."""
LEAST_SAMPLES = 50
MOST_SAMPLES = 4000
CLEARLY = 0.1
"""A rotation is proposed where it explains this much more of the force's variance than the log as it is."""
ENOUGH = 0.3
"""... and explains this much at all."""


def mountings() -> Array:
    """The 24 rotations (24, 3, 3) that map axes onto axes, the identity first."""
    found = []
    for order, signs in product(permutations(range(3)), product((1.0, -1.0), repeat=3)):
        matrix = np.zeros((3, 3))
        matrix[range(3), order] = signs
        if np.linalg.det(matrix) > 0:
            found.append(matrix)
    return np.array(found)


@dataclass(frozen=True)
class FrameCheck:
    """What the search over the mountings found."""

    suspicious: bool
    """Whether another mounting explains the force much better than the log as it is."""
    judged: bool
    """False where there is too little force or motion to say anything."""
    rotation: Array
    """``Q`` (3, 3), the best of the 24: axes of the sensor, as columns, in those of the end-effector."""
    refined: Array
    """``Q`` (3, 3), the best rotation near it."""
    sign: int
    """-1 where the log has the opposite sign."""
    wrench_axes: str
    """``world`` where the log turned the wrench with the pose; ``tool`` where it did not."""
    explained_before: float
    """Share of the force's variance that a diagonal spring and damper explain in the log as it is; at most 1."""
    explained: float
    """The same after `rotation` and `sign`."""
    explained_refined: float
    """The same after `refined` and `sign`."""
    runner_up: float
    """The same for the second best of the 24."""
    stiffness: tuple[float, float, float]
    """Of that spring, after `rotation` [N/m]."""
    message: str
    """All of it in words, with the remedy."""

    def apply(self, recording: Recording, *, refined: bool = False) -> Recording:
        """The recording with the proposed rotation and sign."""
        turned = recording.noted(wrench=self.sign * recording.wrench, wrench_axes=self.wrench_axes)
        return wrench_to_world(turned, rotation=self.refined if refined else self.rotation)


def check_frame(recording: Recording, *, force: float = FORCE) -> FrameCheck:
    """Look whether the wrench is in the axes that it is said to be in, and propose the rotation that it needs.

    With ``R`` the orientation of the end-effector, a log that turned the wrench into world axes with a wrong
    mounting needs ``f' = R Q Rᵀ f``; one that did not turn it, ``f' = R Q f``. Of each, every ``Q`` of the 24 and
    both signs are tried. Where both do equally well, which happens while the tool hardly turns, the log's own
    statement is kept. `refined` starts from the best and follows the residual down the rotation group.

    Parameters
    ----------
    recording : Recording
    force : float
        Samples with less force than this [N] are left out.

    Raises
    ------
    InputError
        The recording has errors.
    """
    error, wrench = recording.error[:, :3], recording.wrench[:, :3]
    which = np.flatnonzero(np.linalg.norm(wrench, axis=1) > positive("force", force))
    moved = error[which].std(axis=0).max() if len(which) else 0.0
    if len(which) < LEAST_SAMPLES or moved < 1e-6:
        return _undecided(recording, len(which), force)
    which = which[:: -(-len(which) // MOST_SAMPLES)]
    orientation = quaternions.normalised(recording.quat_wxyz[which])
    fit = _Fit(error[which], recording.error_rate[which, :3], orientation)
    candidates = []
    for axes in ("world", "tool"):
        local = wrench[which]
        if axes == "world":
            local = quaternions.rotate(quaternions.conjugate(orientation), local)
        for turn in mountings():
            for sign in (1, -1):
                candidates.append((fit.explained(sign * local, turn)[0], axes, turn, sign))
    stated = [c for c in candidates if c[1] == recording.wrench_axes]
    best_stated, best = max(stated, key=lambda c: c[0]), max(candidates, key=lambda c: c[0])
    if best[0] - best_stated[0] < 0.5 * CLEARLY:
        best = best_stated
    before = stated[0][0]  # the identity with the sign as it is comes first
    explained, axes, turn, sign = best
    rivals = [c[0] for c in candidates if c[1] == axes and not (c[3] == sign and (c[2] == turn).all())]
    local = sign * wrench[which]
    if axes == "world":
        local = quaternions.rotate(quaternions.conjugate(orientation), local)
    refined = fit.refined(local, turn)
    same = sign == 1 and axes == recording.wrench_axes and bool((turn == np.eye(3)).all())
    suspicious = not same and explained > ENOUGH and explained - before > CLEARLY
    check = FrameCheck(
        suspicious=suspicious,
        judged=True,
        rotation=turn,
        refined=refined,
        sign=sign,
        wrench_axes=axes,
        explained_before=before,
        explained=explained,
        explained_refined=fit.explained(local, refined)[0],
        runner_up=max(rivals),
        stiffness=fit.explained(local, turn)[1],
        message="",
    )
    return _worded(check)


class _Fit:
    """How much of a force a constant diagonal spring and damper explain after it was turned."""

    def __init__(self, error: Array, rate: Array, orientation: Array) -> None:
        self.orientation = orientation
        self.error, self.rate = error - error.mean(axis=0), rate - rate.mean(axis=0)
        self.ee, self.vv = (self.error**2).sum(axis=0), (self.rate**2).sum(axis=0)
        self.ev = (self.error * self.rate).sum(axis=0)

    def law(self, local: Array, turn: ArrayLike) -> tuple[Array, Array, Array]:
        """Centred force in world axes, stiffness, and what is left; stiffness and damping are not negative."""
        force = quaternions.rotate(self.orientation, local @ np.asarray(turn).T)
        force = force - force.mean(axis=0)
        ef, vf = (force * self.error).sum(axis=0), (force * self.rate).sum(axis=0)
        determinant = self.ee * self.vv - self.ev**2
        safe = np.where(determinant > 1e-9 * self.ee * self.vv, determinant, np.inf)
        stiffness, damping = (self.vv * ef - self.ev * vf) / safe, (self.ee * vf - self.ev * ef) / safe
        alone = np.maximum(ef / np.where(self.ee > 0, self.ee, np.inf), 0.0)
        damped = np.maximum(vf / np.where(self.vv > 0, self.vv, np.inf), 0.0)
        both = (stiffness > 0) & (damping > 0)
        softer = damped**2 * self.vv > alone**2 * self.ee  # the better of the two with one of them zero
        stiffness = np.where(both, stiffness, np.where(softer, 0.0, alone))
        damping = np.where(both, damping, np.where(softer, damped, 0.0))
        return force, stiffness, force - stiffness * self.error - damping * self.rate

    def explained(self, local: Array, turn: ArrayLike) -> tuple[float, tuple[float, float, float]]:
        force, stiffness, left = self.law(local, turn)
        total = float((force**2).sum())
        share = 1.0 - float((left**2).sum()) / total if total > 0 else 0.0
        return share, (float(stiffness[0]), float(stiffness[1]), float(stiffness[2]))

    def refined(self, local: Array, start: Array) -> Array:
        def left(vector: Array) -> Array:
            return self.law(local, start @ rotation_exp(vector))[2].ravel()

        return start @ rotation_exp(least_squares(left, np.zeros(3), x_scale=0.1, max_nfev=30).x)


def _undecided(recording: Recording, count: int, force: float) -> FrameCheck:
    return FrameCheck(
        suspicious=False,
        judged=False,
        rotation=np.eye(3),
        refined=np.eye(3),
        sign=1,
        wrench_axes=recording.wrench_axes,
        explained_before=0.0,
        explained=0.0,
        explained_refined=0.0,
        runner_up=0.0,
        stiffness=(0.0, 0.0, 0.0),
        message=f"the frame cannot be judged: {count} samples have more than {force:g} N and move",
    )


def _worded(check: FrameCheck) -> FrameCheck:
    before, after = 100 * check.explained_before, 100 * check.explained
    if not check.suspicious:
        text = f"a diagonal spring and damper explain {before:.0f} % of the force in the stated frame"
        if check.explained_before < ENOUGH:
            text += ", and no square mounting of the sensor explains more than it should"
        return replace(check, message=text)
    turn = [[round(x) for x in row] for row in check.rotation.tolist()]
    options = [f"sensor_rotation={turn}", f"wrench_axes='{check.wrench_axes}'"]
    options += ["wrench_sign=-1"] * (check.sign == -1)
    rival = ""
    if check.explained - check.runner_up < 0.05:
        rival = f" Another rotation explains {100 * check.runner_up:.0f} %: know the mounting before you trust this."
    message = (
        f"the wrench seems to be in other axes than stated: a diagonal spring and damper explain {before:.0f} % of "
        f"the force as it is, and {after:.0f} % with {', '.join(options)}; read the log with these.{rival}"
    )
    return replace(check, message=message)
