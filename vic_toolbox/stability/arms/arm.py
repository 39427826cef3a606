r"""Passivity of the impedance law on a moving arm: the inertia changes on the way, and not every law pays for it.

The paper's law cancels all of :math:`C(x,\dot x)\,\dot x`, so that the closed loop is
:math:`M(x)\ddot e + B\dot e + K e = -F_{ext}` with a mass that moves. Its energy
:math:`V = \tfrac12\dot e^T M\dot e + \tfrac12 e^T K e` then changes by

.. math:: \dot V = -\dot e^T\bigl(B - \tfrac12\dot M(x)\bigr)\dot e - \dot e^T F_{ext},

so positive K and B prove nothing: it takes :math:`B \succeq \tfrac12\dot M` along the motion. A law that feeds
:math:`C\,\dot x_d` forward keeps :math:`C\,\dot e` in the loop, and because :math:`\dot M - 2C` is skew-symmetric
every B ⪰ 0 is enough.

References
----------
C. Ott, "Cartesian Impedance Control of Redundant and Flexible-Joint Robots", Springer, 2008, chapter 3.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicHermiteSpline, CubicSpline

from vic_toolbox.errors import finite_array, one_of
from vic_toolbox.stability.arguments import sample_times
from vic_toolbox.stability.arms.inertia_passivity import (
    MovingMass,
    constant_gains,
    driving_share,
    interpolated,
    passivity_verdict,
    symmetric_part,
)
from vic_toolbox.stability.arms.path_inertia import path_inertia
from vic_toolbox.stability.verdict import Verdict

if TYPE_CHECKING:
    from vic_toolbox.models import RobotModel

DIFFERENCE = 1e-6
"""Time step of the finite differences that check the exact rate of the mass [s]."""


def arm_passivity(
    model: RobotModel,
    stiffness: ArrayLike,
    damping: ArrayLike,
    *,
    time: ArrayLike,
    q: ArrayLike,
    v: ArrayLike | None = None,
    coriolis: Literal["exact", "reference"] = "exact",
    frame: str | None = None,
) -> Verdict:
    """Does the impedance law lose energy at every instant of a motion of the arm, whatever the error?

    Parameters
    ----------
    model : RobotModel
        The arm.
    stiffness : array_like, shape (6, 6)
        Constant K, world axes; changing ones are the business of ``kronander_billard``.
    damping : array_like, shape (6, 6) or (n, 6, 6)
        B, world axes.
    time : array_like, shape (n,)
        Instants [s].
    q, v : array_like, shape (n, nv)
        Joint angles [rad] and speeds [rad/s]; without the speeds, those of a spline through the angles.
    coriolis : {'exact', 'reference'}
        What the law feeds forward: ``C ẋ``, or ``C ẋ_d``.
    frame : str, optional
        The end-effector by default.

    Returns
    -------
    Verdict
        As :func:`~vic_toolbox.stability.arms.inertia_passivity.inertia_passivity`, and in `values` ``without_coriolis``
        and ``without_jacobian_rate``: largest force [N] that a law without these terms leaves on the motion (see
        :class:`~vic_toolbox.stability.arms.path_inertia.PathInertia`).

    Raises
    ------
    InputError
        Wrong shapes, values that are not finite, or gains that are not symmetric positive definite.
    ModelError
        Unknown frame.
    """
    instants = sample_times(time)
    n = len(instants)
    angles = finite_array("q", q, shape=(n, model.nv))
    speeds = (
        CubicSpline(instants, angles)(instants, 1) if v is None else finite_array("v", v, shape=(n, model.nv))
    )
    one_of("coriolis", coriolis, ("exact", "reference"))
    here = path_inertia(model, angles, speeds, frame=frame)
    forces = {
        "without_coriolis": float(np.linalg.norm(here.without_coriolis[:, :3], axis=1).max()),
        "without_jacobian_rate": float(np.linalg.norm(here.without_jacobian_rate[:, :3], axis=1).max()),
    }
    kept = here.coriolis if coriolis == "reference" else None
    k, b = constant_gains(stiffness, damping, n, 6)
    # checked again with differences of M(x), also between the samples
    course = CubicHermiteSpline(instants, angles, speeds)
    between = np.sort(np.concatenate([instants, 0.5 * (instants[1:] + instants[:-1])]))
    finer_q, finer_v = course(between), course(between, 1)
    finer = path_inertia(model, finer_q, finer_v, frame=frame)
    ahead, behind = (
        path_inertia(model, finer_q + sign * DIFFERENCE * finer_v, finer_v, frame=frame).mass
        for sign in (1.0, -1.0)
    )
    driving = (ahead - behind) / (4 * DIFFERENCE)
    if kept is not None:
        driving = driving - symmetric_part(finer.coriolis)
    checked = driving_share(driving, interpolated(instants, b, between))
    return passivity_verdict(
        instants,
        MovingMass(instants, here.mass, here.mass_rate, k, b, kept),
        checked=float(checked.max()),
        name=f"M(x) of {model.name}",
        values=forces,
        singular=bool(here.damped.any() or finer.damped.any()),
    )
