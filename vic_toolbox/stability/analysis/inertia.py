"""The mass that gains act on: a number, matrices, or a robot model on the way that it goes."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, finite_array, positive
from vic_toolbox.stability.arguments import positive_matrices

STILL = 1e-6
"""Relative change of a mass that counts as none."""


class Inertia(NamedTuple):
    """M of d axes."""

    mass: Array | None
    """(d, d), or (n, d, d) along time; None if it is not known."""
    robot: Any = None
    """The robot model that it is of, with its way: q (n, nv)."""
    q: Array | None = None
    v: Array | None = None
    dropped: tuple[int, ...] = ()
    """Axes that it says nothing about."""
    note: str = ""

    @property
    def moving(self) -> bool:
        """Whether M changes along time."""
        return self.mass is not None and self.mass.ndim == 3


def read_inertia(
    model: Any, size: int, samples: int | None, q: ArrayLike | None = None, v: ArrayLike | None = None
) -> Inertia:
    """The mass of `size` axes, along `samples` instants if there are any.

    Raises
    ------
    InputError
        A mass of another size or length, not symmetric positive definite, or a robot without its q.
    """
    if model is None:
        return Inertia(None, note="no mass was given: only what needs none was asked; pass the mass too")
    if hasattr(model, "operational_space"):
        return _of_robot(model, size, samples, q, v)
    if q is not None:
        raise InputError("q was given without a robot model; pass model=models.load_robot(...).")
    array = finite_array("mass", model)
    if array.ndim == 0:
        mass = positive("mass", float(array)) * np.eye(size)
        if size == 6:
            note = "rx, ry, rz left out: one number is a mass [kg]; for rotations pass six (three of them in kg m²)"
            return Inertia(mass, dropped=(3, 4, 5), note=note)
        return Inertia(mass)
    if array.shape == (size,):
        return Inertia(positive_matrices("mass", np.diag(array)))
    expected = [(size, size)] + ([(samples, size, size)] if samples else [])
    if array.shape not in expected:
        wanted = " or ".join(map(str, expected))
        raise InputError(
            f"mass has shape {array.shape}; pass a number, {size} numbers, or matrices {wanted}."
        )
    return Inertia(_kept_once(positive_matrices("mass", array)))


def _of_robot(
    robot: Any, size: int, samples: int | None, q: ArrayLike | None, v: ArrayLike | None
) -> Inertia:
    if size != 6:
        raise InputError(f"a robot's mass has six axes and the gains have {size}; pass gains of six axes.")
    if q is None:
        raise InputError(
            f"{robot.name} has another mass in every posture; pass q ({robot.nv} joint angles), or one row for each "
            "instant."
        )
    angles = finite_array("q", q, shape=(..., robot.nv))
    if angles.shape not in ((robot.nv,), (samples, robot.nv)):
        raise InputError(
            f"q has shape {angles.shape}; pass ({robot.nv},)"
            + (f" or ({samples}, {robot.nv})." if samples else ".")
        )
    speeds = None if v is None else finite_array("v", v, shape=angles.shape)
    mass = robot.operational_space(angles, np.zeros_like(angles)).mass
    note = f"M(x) of {robot.name}" + (" in one posture" if angles.ndim == 1 else "")
    return Inertia(_kept_once(0.5 * (mass + np.swapaxes(mass, -1, -2))), robot, angles, speeds, note=note)


def _kept_once(mass: Array) -> Array:
    """A mass along time that never changes as one matrix."""
    if mass.ndim == 3 and np.abs(mass - mass[0]).max() <= STILL * np.abs(mass[0]).max():
        return mass[0]
    return mass
