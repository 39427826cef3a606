"""What a fit of gains does with a log: method, resolution, and what is taken out of the wrench before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from vic_toolbox.errors import InputError, finite_array, finite_number, integer, one_of, positive

Three = tuple[float, float, float]
Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """How gains are fitted."""

    method: Literal["smooth", "windows"] = "smooth"
    """Splines through every sample, or the paper's sliding window."""
    knots: float | None = None
    """Finest change of the gains that can be seen [s]; by default 0.1, for full matrices 0.5 (smooth)."""
    constant: bool = False
    """Gains that do not change at all (smooth)."""
    window: int = 10
    """Samples in a window (windows)."""
    step: int = 1
    """Samples from one window to the next (windows)."""
    structure: Literal["diagonal", "full", "damping_factor"] = "diagonal"
    """Axes on their own, full symmetric matrices, or damping tied to stiffness by B = d √K."""
    constraint: Literal["auto", "none", "positive", "spd"] = "auto"
    """Positive (definite) gains or free ones; auto: spd for smooth, none for windows, as in the paper."""
    solver: Literal["auto", "closed_form", "casadi", "clarabel"] = "auto"
    """Asked only where the unconstrained fit is not feasible."""
    robust: bool = False
    """Outliers of the wrench count linearly, not squared (smooth)."""
    bias: bool = False
    """Estimate a constant wrench for each log besides: the sensor's zero may be off (smooth)."""
    latency: bool = False
    """Estimate by how much the wrench is late."""
    attractor: bool = False
    """Estimate where the spring rests, relative to the reference (smooth)."""
    between: Span | None = None
    """Fit only this part of each log, from its start [s]."""
    mass: float = 0.0
    """Between hand and spring: its inertia is taken out of the wrench [kg]."""
    inertia: Three = (0.0, 0.0, 0.0)
    """The same for rotation, about x, y and z of the world [kg m²]."""
    smoothing: float = 0.0
    """Filter pose and wrench alike by local cubics over this time [s]; 0 leaves them as they are."""
    contact: float = 0.0
    """Leave out samples with less force than this [N]: without contact, friction is all there is (smooth)."""

    def check(self) -> None:
        """Refuse settings that make no sense, before any work starts.

        Raises
        ------
        InputError
            A number is out of range, or options do not go together.
        """
        one_of("method", self.method, ("smooth", "windows"))
        if self.knots is not None:
            positive("knots", self.knots)
        integer("window", self.window, low=3)
        integer("step", self.step, low=1)
        for name in ("mass", "smoothing", "contact"):
            finite_number(name, getattr(self, name), low=0.0)
        if (finite_array("inertia", self.inertia, shape=(3,)) < 0).any():
            raise InputError(f"inertia is {self.inertia}; no entry may be negative [kg m²].")
        if self.between is not None:
            start, stop = finite_array("between", self.between, shape=(2,)).tolist()
            if not 0 <= start < stop:
                raise InputError(
                    f"between is {start:g} to {stop:g} s; pass two times from the log's start, ascending."
                )
        if self.method == "windows":
            meant = [name for name in _SMOOTH_ONLY if getattr(self, name)]
            if meant:
                raise InputError(
                    f"windows know no {', '.join(meant)}; leave {'it' if len(meant) == 1 else 'them'} out, "
                    "or fit with method 'smooth'."
                )

    @property
    def chosen_constraint(self) -> str:
        """The constraint, ``auto`` resolved."""
        return self.constraint if self.constraint != "auto" else "spd" if self.method == "smooth" else "none"


_SMOOTH_ONLY = ("constant", "robust", "bias", "attractor", "contact")
