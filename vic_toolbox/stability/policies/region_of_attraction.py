r"""Region of attraction about an equilibrium, by a quadratic Lyapunov candidate and samples: an estimate, no proof.

With A the closed loop linearised at the equilibrium and P from :math:`A^T P + P A = -Q` (Q: the identity in the
coordinates of :meth:`PolicyLoop.normal`), the ellipsoid :math:`\delta x^T P\,\delta x \le c` is a region of
attraction if :math:`\dot V = 2\,\delta x^T P f(x) < 0` in all of it. Here this is looked at in many directions and
levels, most closely where it is worst. Between the samples it may fail.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from vic_toolbox.errors import Array
from vic_toolbox.stability.policies.policy_loop import PolicyLoop

LEVELS = 24
REFINEMENTS = 2
BEST = 16


@dataclass(frozen=True, eq=False)
class AttractionRegion:
    """The ellipsoid ``δxᵀ P δx ≤ level`` about ``[equilibrium, 0]`` in which no sample speaks against decay.

    Parameters
    ----------
    lyapunov : ndarray, shape (2 d, 2 d)
        P.
    level : float
        c [J/rad², scaled with P]; zero if there is none.
    semi_axes : ndarray, shape (2 d,)
        How far the ellipsoid reaches along e and ė.
    share : float
        Its size over that of the largest such ellipsoid within the box: 1 if no sample speaks against it there.
    samples : int
        Number of states looked at.
    """

    lyapunov: Array
    level: float
    semi_axes: Array
    share: float
    samples: int


def lyapunov_matrix(system: Array, *, normal: Array) -> Array:
    """P ≻ 0 (2 d, 2 d) of ``AᵀP + PA = −TᵀT`` for a stable system A and the map T to comparable coordinates."""
    back = np.linalg.inv(normal)
    scaled = normal @ system @ back
    found = solve_continuous_lyapunov(scaled.T, -np.eye(len(system)))
    return normal.T @ (0.5 * (found + found.T)) @ normal


def region_of_attraction(
    loop: PolicyLoop,
    equilibrium: Array,
    lyapunov: Array,
    *,
    region: Array,
    directions: int = 256,
    generator: np.random.Generator,
) -> AttractionRegion:
    """Largest level of a Lyapunov candidate whose samples all decay, inside a box ± region about zero.

    Parameters
    ----------
    loop : PolicyLoop
        Policy, mass and load.
    equilibrium : ndarray, shape (d,)
        Error at rest.
    lyapunov : ndarray, shape (2 d, 2 d)
        P, see :func:`lyapunov_matrix`.
    region : ndarray, shape (2 d,)
        Half widths of the box.
    directions : int
        Number of random directions.
    generator : Generator
        Of the directions.
    """
    size = len(lyapunov)
    centre = np.concatenate([equilibrium, np.zeros_like(equilibrium)])
    widths = np.sqrt(np.diagonal(np.linalg.inv(lyapunov)))  # of the ellipsoid of level 1
    radius = float(((region - np.abs(centre)) / widths).min())
    if radius <= 0:
        return AttractionRegion(lyapunov, 0.0, np.zeros(size), 0.0, 0)
    shares = np.arange(1, LEVELS + 1) / LEVELS
    to_state = np.linalg.inv(np.linalg.cholesky(lyapunov)).T * radius

    def decays_to(units: Array) -> Array:
        """Number of levels, from the innermost, at which V decays in each direction."""
        offsets = shares[:, None, None] * (units @ to_state.T)
        states = (centre + offsets).reshape(-1, size)
        answer = loop(states)
        pull = loop.load - answer.pull(states)
        rate = np.concatenate([states[:, loop.size :], np.linalg.solve(loop.mass, pull.T).T], axis=1).reshape(
            offsets.shape
        )
        good = (np.einsum("kni,ij,knj->kn", offsets, lyapunov, rate) < 0) & answer.admissible.reshape(
            LEVELS, -1
        )
        return np.where(good.all(axis=0), LEVELS, (~good).argmax(axis=0))

    units = _unit(generator.standard_normal((directions, size)))
    reached = decays_to(units)
    count = units.shape[0]
    for spread in 0.3 / 3.0 ** np.arange(REFINEMENTS):
        worst = units[np.argsort(reached)[:BEST]].repeat(BEST, axis=0)
        more = _unit(worst + spread * generator.standard_normal(worst.shape))
        units, reached = np.concatenate([units, more]), np.concatenate([reached, decays_to(more)])
        count += len(more)
    share = float(reached.min()) / LEVELS
    return AttractionRegion(
        lyapunov, (share * radius) ** 2, share * radius * widths, share, int(count * LEVELS)
    )


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
