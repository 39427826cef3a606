"""What a runtime filter would have changed in a recorded motion: its gains before and after, and the energy saved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.control.energy_tank import EnergyTank
from vic_toolbox.control.gain_arrays import checked_gains, is_diagonal, quadratic
from vic_toolbox.control.gain_filter import GainFilter
from vic_toolbox.errors import Array, InputError, finite_array

if TYPE_CHECKING:
    from matplotlib.figure import Figure

CHANGED = 1e-6
"""Relative change of a sample's gains that counts as one."""


@dataclass(frozen=True, eq=False)
class FilterReplay:
    """A recorded motion with the gains that it had, and those that a filter would have allowed.

    The motion is as recorded: with the other gains the arm would have moved a little differently after the first
    change, so later numbers are an estimate.

    Parameters
    ----------
    time : ndarray, shape (n,)
        Instants [s].
    stiffness, damping : ndarray, shape (n, d) or (n, d, d)
        As recorded.
    filtered_stiffness, filtered_damping : ndarray
        As the filter allows, in the same form.
    share : ndarray, shape (n,)
        Part of the wanted change that was allowed at each step (the least of all axes).
    injected, filtered_injected : ndarray, shape (n,)
        Energy that jumps of the stiffness have put in since the start, ``Σ max(0, ½ eᵀ ΔK e)`` [J].
    tank : ndarray, shape (n,), optional
        Energy in the tank [J].
    """

    time: Array
    stiffness: Array
    damping: Array
    filtered_stiffness: Array
    filtered_damping: Array
    share: Array
    injected: Array
    filtered_injected: Array
    tank: Array | None = None

    @property
    def energy_saved(self) -> float:
        """Energy that the filter would have kept out [J]."""
        return float(self.injected[-1] - self.filtered_injected[-1])

    @property
    def changed(self) -> np.ndarray:
        """Which samples have other gains (n,)."""
        pairs = ((self.stiffness, self.filtered_stiffness), (self.damping, self.filtered_damping))
        axes = tuple(range(1, self.stiffness.ndim))
        return np.any(
            [np.abs(a - b).max(axis=axes) > CHANGED * np.abs(a).max(axis=axes) for a, b in pairs], axis=0
        )

    @property
    def share_changed(self) -> float:
        """Share of the samples that have other gains."""
        return float(self.changed.mean())

    def summary(self) -> str:
        """The numbers in a few lines of text."""
        lines = [
            f"{self.share_changed:.1%} of {len(self.time)} samples changed",
            f"energy put in by the stiffness: {self.injected[-1]:.4g} J recorded, "
            f"{self.filtered_injected[-1]:.4g} J filtered ({self.energy_saved:.4g} J saved)",
        ]
        if self.tank is not None:
            lines.append(f"tank: {self.tank[0]:.4g} J at the start, {self.tank.min():.4g} J at its lowest")
        return "\n".join(lines)

    def plot(self) -> Figure:
        """Draw stiffness and damping before and after, and the energy over time."""
        from vic_toolbox.control.filter_picture import draw

        return draw(self)


def replay_filter(
    law: EnergyTank | GainFilter,
    time: ArrayLike,
    *,
    error: ArrayLike,
    stiffness: ArrayLike,
    damping: ArrayLike,
    error_rate: ArrayLike | None = None,
) -> FilterReplay:
    """Run recorded gains through a filter, along the recorded motion.

    Parameters
    ----------
    law : EnergyTank or GainFilter
        The filter.
    time : array_like, shape (n,)
        Increasing instants of the control steps [s].
    error : array_like, shape (n, d)
        e [m, rad]; (n,) for one axis.
    stiffness, damping : array_like, shape (n, d) or (n, d, d)
        Gains held from each instant to the next; (n,) for one axis.
    error_rate : array_like, shape (n, d), optional
        ė; neither filter needs it, it is only checked.

    Raises
    ------
    InputError
        Lengths or shapes that do not fit, instants that do not increase, or gains that are not positive.
    """
    instants = finite_array("time", time, shape=(None,))
    if len(instants) < 2 or (np.diff(instants) <= 0).any():
        raise InputError("time must hold at least two instants that increase; sort the samples.")
    e, k, b = (
        _column(name, values)
        for name, values in (("error", error), ("stiffness", stiffness), ("damping", damping))
    )
    rate = e if error_rate is None else _column("error_rate", error_rate)
    if e.ndim != 2 or rate.shape != e.shape or any(len(a) != len(instants) for a in (e, k, b)):
        raise InputError(
            f"time has {len(instants)} samples, error has shape {e.shape}, error_rate {rate.shape}, stiffness "
            f"{k.shape} and damping {b.shape}; pass as many of each."
        )
    k = checked_gains("stiffness", k, error=e)
    b = checked_gains("damping", b, error=e, definite=False)
    if k.shape != b.shape:
        raise InputError(f"stiffness has shape {k.shape} and damping {b.shape}; pass both in one form.")
    steps = np.diff(instants)
    stored: Array | None = None
    if isinstance(law, EnergyTank):
        tanks = [law.start(error=e[0], stiffness=k[0], damping=b[0])]
        for i, dt in enumerate(steps, start=1):
            tanks.append(law.step(tanks[-1], error=e[i], stiffness=k[i], damping=b[i], elapsed=dt))
        states, stored = tanks, np.array([state.energy for state in tanks])
    elif isinstance(law, GainFilter):
        if law.matrices == is_diagonal(k, e):
            raise InputError(f"the filter has matrices={law.matrices} and the stiffness has shape {k.shape}.")
        states = [law.start(stiffness=k[0], damping=b[0])]
        for i, dt in enumerate(steps, start=1):
            states.append(law.step(states[-1], stiffness=k[i], damping=b[i], elapsed=dt))
    else:
        raise InputError(f"law is {type(law).__name__}; pass an EnergyTank or a GainFilter.")
    after_k = np.array([state.stiffness for state in states])
    return FilterReplay(
        time=instants,
        stiffness=k,
        damping=b,
        filtered_stiffness=after_k,
        filtered_damping=np.array([state.damping for state in states]),
        share=np.array([np.min(state.share) for state in states]),
        injected=_injected(k, e),
        filtered_injected=_injected(after_k, e),
        tank=stored,
    )


def _column(name: str, values: ArrayLike) -> Array:
    array = finite_array(name, values)
    return array[:, None] if array.ndim == 1 else array


def _injected(stiffness: Array, error: Array) -> Array:
    jumps = 0.5 * quadratic(np.diff(stiffness, axis=0), error[1:])
    return np.concatenate([[0.0], np.cumsum(np.maximum(jumps, 0.0))])
