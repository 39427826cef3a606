"""A guided session on the digital twin, and how its gains are fitted."""

from __future__ import annotations

from dataclasses import dataclass

from vic_toolbox.errors import InputError, finite_number, integer, one_of, positive

FITS = ("windows", "smooth")
"""How gains may be fitted, see :mod:`vic_toolbox.experiments.guided`."""


@dataclass(frozen=True, kw_only=True)
class SessionSettings:
    """A session on the twin, and how gains are fitted to it."""

    count: int = 30
    """Demonstrations."""
    push: float = 5.0
    """Known push of the controller while the human works, root mean square along x [N]; 0 leaves the human alone."""
    rate: float = 100.0
    """Samples of the log [Hz]; by default one for each step of the policy."""
    window: int = 10
    """Samples in a window."""
    fits: tuple[str, ...] = FITS
    """Of "windows" (the paper's) and "smooth"; the first makes the rows of the methods, others rows beside them."""

    def __post_init__(self) -> None:
        integer("count", self.count, low=2)
        finite_number("push", self.push, low=0.0)
        positive("rate", self.rate)
        integer("window", self.window, low=3)
        if not self.fits or len(set(self.fits)) < len(self.fits):
            raise InputError(f"fits are {self.fits}; give at least one, and none twice.")
        for name in self.fits:
            one_of("fits", name, FITS)
