"""Joint postures that put a frame of a serial arm at a pose: damped least squares from many starts."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin

from vic_toolbox.errors import Array, ReachError

DAMPING = 1e-10
"""Least damping of the normal equations; the rest of it vanishes with the squared error (Sugihara)."""

LARGEST_STEP = 0.5
"""Longest change of a joint in one iteration [rad, m]."""

SEARCH_RANGE = np.pi
"""Random starts of a joint without limits lie within ± this [rad]."""

UNIT_MISTAKE = 3.0
"""Multiple of the arm's reach beyond which a target was hardly meant in metres."""


def solve(
    model: pin.Model, frame: int, target: Array, *, starts: Iterable[Array], tolerance: float, iterations: int
) -> Array:
    r"""Return the posture that the first successful start leads to.

    From each start, Levenberg-Marquardt steps
    :math:`\Delta q = -(J^T J + (\tfrac12 e^T e + \delta) I)^{-1} J^T e` on the pose error
    :math:`e = [p - p_d;\ \log(R R_d^T)]`, clipped to the joint limits; joints that a step would push beyond
    their limit are left out of that step, so the others make up for them.

    Parameters
    ----------
    model : pinocchio.Model
    frame : int
        Index of the frame.
    target : ndarray, shape (4, 4)
    starts : iterable of ndarray, shape (nq,)
        Tried in turn, each brought within the limits first.
    tolerance : float
        Largest norm of e that counts as there [m, rad].
    iterations : int
        Steps from each start.

    Returns
    -------
    ndarray, shape (nq,)

    Raises
    ------
    ReachError
        No start gets there; it carries the smallest residual.

    References
    ----------
    T. Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE
    Transactions on Robotics 27(5), 2011.
    """
    data = model.createData()
    errors = []
    for start in starts:
        q = np.clip(start, model.lowerPositionLimit, model.upperPositionLimit)
        for _ in range(iterations):
            error = _error(model, data, frame, target, q)
            if error @ error <= tolerance**2:
                return q
            q = q + _step(model, data, frame, q, error)
        errors.append(error)
    nearest = min(errors, key=np.linalg.norm)
    raise ReachError(
        _explain(model, frame, target, nearest, len(errors)), residual=float(np.linalg.norm(nearest))
    )


def random_postures(model: pin.Model, generator: np.random.Generator, count: int) -> Array:
    """Uniform postures (count, nq) within the limits; joints without limits within ± :data:`SEARCH_RANGE`."""
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    low = np.where(np.isfinite(low), low, -SEARCH_RANGE)
    high = np.where(np.isfinite(high), high, SEARCH_RANGE)
    return generator.uniform(low, high, size=(count, model.nq))


def reach_bound(model: pin.Model, frame: int) -> tuple[Array, float]:
    """Centre and radius [m] of a ball that holds every position of the frame: all links in one line."""
    chain = list(model.supports[model.frames[frame].parentJoint])[1:]
    offsets = [model.jointPlacements[joint].translation for joint in chain[1:]]
    offsets.append(model.frames[frame].placement.translation)
    radius = sum(np.linalg.norm(offset) for offset in offsets)
    for joint in chain:
        if model.joints[joint].shortname().startswith("JointModelP"):  # PX, PY, PZ or PrismaticUnaligned
            index = model.joints[joint].idx_q
            radius += max(abs(model.lowerPositionLimit[index]), abs(model.upperPositionLimit[index]))
    return model.jointPlacements[chain[0]].translation, float(radius)


def refuse_other_units(model: pin.Model, frame: int, position: Array) -> None:
    """Refuse a position (3,) [m] that is farther away than :data:`UNIT_MISTAKE` times the reach.

    Raises
    ------
    ReachError
        The message names the unit that the position looks like.
    """
    centre, radius = reach_bound(model, frame)
    distance = float(np.linalg.norm(position - centre))
    if distance <= UNIT_MISTAKE * radius:
        return
    # An arm works between a tenth of its reach and all of it.
    unit, factor = ("centimetres", 100) if distance <= 100 * radius else ("millimetres", 1000)
    raise ReachError(
        f"the position ({', '.join(f'{x:g}' for x in position)}) lies {distance:.3g} m from the first joint, "
        f"and {model.frames[frame].name} reaches at most {radius:.3g} m. Positions are in metres; if this one "
        f"is in {unit}, divide it by {factor}."
    )


def _step(model: pin.Model, data: pin.Data, frame: int, q: Array, error: Array) -> Array:
    """Change of the posture that lessens the error within the limits."""
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    jacobian = pin.computeFrameJacobian(model, data, q, frame, pin.LOCAL_WORLD_ALIGNED)
    damping = (0.5 * error @ error + DAMPING) * np.eye(model.nv)
    while True:
        step = -np.linalg.solve(jacobian.T @ jacobian + damping, jacobian.T @ error)
        blocked = ((q <= low) & (step < 0)) | ((q >= high) & (step > 0))
        if not blocked.any():
            break
        jacobian[:, blocked] = 0.0  # their step is zero from here on
    step *= LARGEST_STEP / max(np.abs(step).max(), LARGEST_STEP)
    return np.clip(q + step, low, high) - q


def _error(model: pin.Model, data: pin.Data, frame: int, target: Array, q: Array) -> Array:
    """``vic_toolbox.spatial.pose_error`` without its checks: this is the innermost loop."""
    pin.forwardKinematics(model, data, q)
    pose = pin.updateFramePlacement(model, data, frame)
    return np.concatenate([pose.translation - target[:3, 3], pin.log3(pose.rotation @ target[:3, :3].T)])


def _explain(model: pin.Model, frame: int, target: Array, nearest: Array, count: int) -> str:
    centre, radius = reach_bound(model, frame)
    distance = float(np.linalg.norm(target[:3, 3] - centre))
    name = model.frames[frame].name
    if distance > radius:
        remedy = f"bring the target at least {distance - radius:.3g} m closer"
    elif model.nv < 6:
        remedy = f"with {model.nv} joints most orientations are out of reach: change the orientation"
    else:
        remedy = "change the orientation or the position, or pass a start near the wanted posture"
    position = np.array2string(target[:3, 3], precision=4, separator=", ", suppress_small=True)
    translation, rotation = np.linalg.norm(nearest[:3]), np.linalg.norm(nearest[3:])
    return (
        f"no posture within the limits puts {name} at {position} m with the wanted orientation: the nearest "
        f"of {count} attempts is off by {translation:.3g} m and {rotation:.3g} rad. The target lies "
        f"{distance:.3g} m from the first joint, and the arm reaches at most {radius:.3g} m; {remedy}."
    )
