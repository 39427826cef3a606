"""What a fit must not see: the gains that the hand really had, and what it really did."""

from __future__ import annotations

import os
from dataclasses import dataclass, fields

import numpy as np

from vic_toolbox.errors import Array, FileError, InputError, finite_array
from vic_toolbox.files import read_arrays, write_arrays

_SHAPES = {
    "time": (None,),
    "stiffness": (None, 6),
    "damping": (None, 6),
    "hand": (None, None, 6),
    "contact": (None, None),
    "bias": (6,),
    "mass": (),
}


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a session of `count` demonstrations, at the n times of its logs."""

    time: Array
    """(n,) [s]"""
    stiffness: Array
    """Diagonal of the hand's K(t), (n, 6) [N/m, Nm/rad]."""
    damping: Array
    """Diagonal of its B(t), (n, 6) [Ns/m, Nms/rad]."""
    hand: Array
    """Wrench of the hand on the end-effector, world axes, (count, n, 6) [N, Nm]."""
    contact: Array
    """Force of the furniture on the cup, (count, n) [N]."""
    bias: Array
    """Zero error of the F/T sensor, its axes, (6,) [N, Nm]."""
    mass: Array
    """What hangs on the sensor, () [kg]."""

    def __post_init__(self) -> None:
        for name, shape in _SHAPES.items():
            object.__setattr__(self, name, finite_array(name, getattr(self, name), shape=shape))
        count = len(self.time)
        if {len(self.stiffness), len(self.damping), self.hand.shape[1], self.contact.shape[1]} != {count}:
            raise InputError(f"the truth's arrays do not have {count} samples each, as its time has.")

    @property
    def landing(self) -> Array:
        """When the cup first touches something, (count,) [s]; infinite where it never does."""
        touching = self.contact > 0
        return np.where(touching.any(axis=1), self.time[touching.argmax(axis=1)], np.inf)

    def gains_at(self, time: Array) -> tuple[Array, Array]:
        """Diagonals of K and B at other times (m,), each (m, 6)."""
        columns = [
            np.column_stack([np.interp(time, self.time, column) for column in gain.T])
            for gain in (self.stiffness, self.damping)
        ]
        return columns[0], columns[1]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one ``.npz``, whole or not at all."""
        write_arrays(path, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Truth:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileError
            Missing, damaged, or something else.
        """
        content = read_arrays(path, "the truth of a session", remedy="record again")
        try:
            return cls(**{field.name: content[field.name] for field in fields(cls)})
        except (KeyError, ValueError) as error:
            raise FileError(f"{path} is not the truth of a session ({error}); record again.") from error
