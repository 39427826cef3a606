"""A sign of a closed loop: how much of the hand's wrench is just what moved the arm.

Where nothing but the human moves a free arm, ``F_hand = M(x) ẍ`` and little else: the wrench follows from the motion by
the arm's inertia, whatever the hand's gains are, and a regression on (e, ė) can only find that out. Where somebody else
pushes as well, the wrench is more than inertia. A spring that is moved at a single frequency looks like a mass, too
(``K e = −(K/ω²) ë``): there as well the remedy is to move in more than one way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vic_toolbox.errors import Array, InputError
from vic_toolbox.recordings.filtering import acceleration, differentiate
from vic_toolbox.recordings.recording import Recording

SMOOTHING = 0.08
"""Window over the wrench [s]."""
WINDOW = 0.16
"""Window of the acceleration [s]."""


def inertia_share(logs: Sequence[Recording]) -> Array:
    """Share of each axis' wrench that one constant inertia matrix times the acceleration explains, (6,).

    The least squares fit ``F ≈ M [p̈; ω̇]`` has 36 free entries for each recording; shares are averaged over them.

    Parameters
    ----------
    logs : sequence of Recording
        Compensated, in world axes.

    Raises
    ------
    InputError
        There is none, or one is too short.
    """
    if not logs:
        raise InputError("no recording was given; pass at least one.")
    return np.mean([_share(log) for log in logs], axis=0)


def _share(log: Recording) -> Array:
    edge = round(WINDOW / 2 * log.rate)
    if len(log) < 2 * edge + 100:
        raise InputError(f"{log.source} has {len(log)} samples; pass {2 * edge + 100} or more.")
    moving = acceleration(log, window=WINDOW)[edge:-edge]
    wrench = differentiate(log, window=SMOOTHING).wrench[edge:-edge]
    inertia, *_ = np.linalg.lstsq(moving, wrench, rcond=None)
    left = np.sum((wrench - moving @ inertia) ** 2, axis=0)
    return 1.0 - left / np.sum(wrench**2, axis=0)
