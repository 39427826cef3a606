"""What all questions about one subject share, and how their answers name numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.gains import AXES
from vic_toolbox.stability.analysis.inertia import Inertia


@dataclass(frozen=True, kw_only=True, eq=False)
class Setting:
    """The mass, and the computer that sets the gains.

    Parameters
    ----------
    names : tuple of str
        Axes, in the order of the gains.
    inertia : Inertia
        What they move.
    period : float, optional
        Control period [s].
    hold : float, optional
        How long gains are held [s].
    physical_damping : ndarray, shape (d, d)
        D of the mechanism [Ns/m, Nms/rad].
    velocity : str
        'exact' or 'backward'.
    delay_steps : int
        Periods from the measurement to the force.
    environment_stiffness : float
        Of what is touched [N/m].
    """

    names: tuple[str, ...]
    inertia: Inertia
    period: float | None
    hold: float | None
    physical_damping: Array
    velocity: str
    delay_steps: int
    environment_stiffness: float

    @property
    def mass(self) -> Array:
        """M (d, d) or (n, d, d), where it is known."""
        assert self.inertia.mass is not None
        return self.inertia.mass

    def unit(self, axis: int, kind: str) -> str:
        """Unit of a stiffness (K), a mass (M), or else a damping of an axis."""
        turning = self.names[axis] in AXES[3:]
        return {"K": ("N/m", "Nm/rad"), "M": ("kg", "kg m²")}.get(kind, ("Ns/m", "Nms/rad"))[turning]

    def gain(self, kind: str, axis: int, value: float) -> str:
        """``K_x = 120 N/m``."""
        name = self.names[axis]
        label = kind if name == "axis" else f"{kind}_{name.removeprefix('axis ')}"
        return f"{label} = {value:.3g} {self.unit(axis, kind)}"


def stiffness_text(value: float, unit: str = "N/m") -> str:
    """A large stiffness in kN/m or MN/m."""
    for factor, prefix in ((1e6, "M"), (1e3, "k")):
        if value >= 10 * factor:
            return f"{value / factor:.3g} {prefix}{unit}"
    return f"{value:.3g} {unit}"


def uncoupled(*arrays: Array) -> bool:
    """Whether nothing acts from one axis on another."""
    d = arrays[0].shape[-1]
    apart = ~np.eye(d, dtype=bool)
    return not any((np.abs(a[..., apart]) > 0).any() for a in arrays)


def extremes(*stacks: Array, most: int) -> np.ndarray:
    """Indices of samples (n, d, d) at which an axis of one of them is least or greatest, and others, evenly spread."""
    n = len(stacks[0])
    if n <= most:
        return np.arange(n)
    diagonals = np.concatenate([np.diagonal(a, axis1=1, axis2=2) for a in stacks], axis=1)
    ends = np.concatenate([diagonals.argmin(axis=0), diagonals.argmax(axis=0)])
    rest = np.linspace(0, n - 1, max(most - len(np.unique(ends)), 2)).astype(int)
    return np.unique(np.concatenate([ends, rest]))


def listed(names: Sequence[str]) -> str:
    """``x, y and z``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
