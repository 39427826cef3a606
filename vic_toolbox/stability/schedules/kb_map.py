r"""What a certificate sees and what it misses, over all sinusoidal stiffness schedules.

    m ë + d ė + k (1 + a sin ωt) e = 0

is stable or not by Floquet; the constant-α certificate of Kronander and Billard proves it where
``ω a / (2 √(1 − a²)) ≤ d / m``; one with α(t) proves more. Over frequency and amplitude the three make a map: one
ladder, each step inside the next.

References
----------
K. Kronander, A. Billard, "Stability considerations for variable impedance control", IEEE T-RO 32, 2016.
S. Blanes et al., "The Magnus expansion and some of its applications", Physics Reports 470, 2009, eq. (253): order four.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from vic_toolbox.errors import Array, InputError, Number, array_within, positive, positive_array
from vic_toolbox.stability.schedules.alpha_interval import Problem
from vic_toolbox.stability.schedules.alpha_program import AlphaProgram
from vic_toolbox.stability.schedules.definite import Mask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

STEPS = 640
"""Of one period; two are taken for each radian of the oscillation at least."""
SAMPLES = 160
"""Of a schedule whose α(t) is looked for."""
COLUMNS = 28
"""Frequencies at which it is."""
HALVINGS = 7
SLOWEST, FASTEST, LARGEST = 0.15, 3.2, 0.97
"""Default range of ω, over √(k/m), and of a."""


@dataclass(frozen=True, eq=False)
class KbMap:
    """What :func:`kb_map` found; `plot` draws it.

    Parameters
    ----------
    mass, stiffness, damping : float
        m, the mean k, and d.
    frequency : ndarray, shape (n,)
        ω of the stiffness [rad/s].
    amplitude : ndarray, shape (p,)
        a, relative.
    spectral_radius : ndarray, shape (p, n)
        Over one period of the stiffness; unstable above one.
    required_damping : ndarray, shape (p, n)
        Damping that the constant-α certificate needs [Ns/m].
    schedule_edge : ndarray, shape (c, 2), or None
        ω and the largest a that α(t) proves.
    """

    mass: float
    stiffness: float
    damping: float
    frequency: Array
    amplitude: Array
    spectral_radius: Array
    required_damping: Array
    schedule_edge: Array | None

    @property
    def certified(self) -> Mask:
        """Where the constant-α certificate exists, (p, n)."""
        return self.required_damping <= self.damping

    @property
    def stable(self) -> Mask:
        """Where the motion decays, (p, n)."""
        return self.spectral_radius < 1

    @property
    def certified_amplitude(self) -> Array:
        """Largest a that the constant-α certificate proves, at each frequency (n,)."""
        ratio = 2 * self.damping / (self.mass * self.frequency)
        return ratio / np.sqrt(1 + ratio**2)

    def plot(self) -> Figure:
        """A figure for a paper."""
        from vic_toolbox.stability.schedules.kb_map_picture import draw

        return draw(self)


def kb_map(
    mass: Number,
    stiffness: Number,
    damping: Number,
    *,
    frequency: ArrayLike | None = None,
    amplitude: ArrayLike | None = None,
    schedule: bool = True,
) -> KbMap:
    """Map stability and certificates of ``m ë + d ė + k (1 + a sin ωt) e = 0`` over ω and a.

    Parameters
    ----------
    mass, stiffness, damping : number
        m, mean k and d.
    frequency : array_like, shape (n,), optional
        Increasing ω [rad/s]; by default from 0.15 to 3.2 times √(k/m).
    amplitude : array_like, shape (p,), optional
        Increasing a in [0, 1); by default up to 0.97.
    schedule : bool, optional
        Also look for the edge of the certificate with α(t): a few seconds, and Clarabel.

    Raises
    ------
    InputError
        Numbers that are not positive, an amplitude out of range, or grids that do not increase.
    """
    m, k, d = (positive(n, x) for n, x in (("mass", mass), ("stiffness", stiffness), ("damping", damping)))
    natural = np.sqrt(k / m)
    default = natural * np.linspace(SLOWEST, FASTEST, 240)
    omega = default if frequency is None else positive_array("frequency", frequency, shape=(None,))
    a = np.linspace(0, LARGEST, 160) if amplitude is None else amplitude
    a = array_within("amplitude", a, low=0.0, high=1 - 1e-9, shape=(None,))
    for name, grid in (("frequency", omega), ("amplitude", a)):
        if len(grid) < 2 or (np.diff(grid) <= 0).any():
            raise InputError(
                f"{name} has {len(grid)} values that do not increase; pass at least two, sorted."
            )
    needed = m * omega * (a / (2 * np.sqrt(1 - a**2)))[:, None]
    edge = _schedule_edge(m, k, d, np.linspace(omega[0], omega[-1], COLUMNS)) if schedule else None
    return KbMap(m, k, d, omega, a, modulated_radius(m, k, d, omega, a), needed, edge)


def modulated_radius(m: float, k: float, d: float, omega: Array, a: Array) -> Array:
    """Spectral radius over one period for every a (p,) and ω (n,), (p, n).

    With ``e = exp(−d t / 2 m) y`` the damping leaves the equation; a step of the Magnus expansion is then
    ``exp [[δ, h], [−h q, −δ]]`` in closed form.
    """
    square = k / m - 0.25 * (d / m) ** 2
    count = max(STEPS, int(np.ceil(4 * np.pi * np.sqrt(2 * k / m) / omega.min())))
    h = 2 * np.pi / omega / count
    phi = np.broadcast_to(np.eye(2)[:, :, None, None], (2, 2, len(a), len(omega))).copy()
    shift = np.sqrt(3) / 6
    for step in range(count):
        q = [square + k / m * a * np.sin(2 * np.pi * (step + 0.5 + s) / count) for s in (-shift, shift)]
        mean, bend = 0.5 * (q[0] + q[1])[:, None], (np.sqrt(3) / 12 * (q[1] - q[0]))[:, None] * h**2
        root = np.sqrt((bend**2 - h**2 * mean).astype(complex))
        safe = np.where(np.abs(root) > 1e-6, root, 1.0)
        even, odd = np.cosh(root).real, np.where(np.abs(root) > 1e-6, (np.sinh(root) / safe).real, 1.0)
        phi = np.stack(
            [
                (even + odd * bend) * phi[0] + odd * h * phi[1],
                -odd * h * mean * phi[0] + (even - odd * bend) * phi[1],
            ]
        )
    half = 0.5 * np.abs(phi[0, 0] + phi[1, 1])
    return (half + np.sqrt(np.maximum(half**2 - 1, 0.0))).clip(1.0) * np.exp(-np.pi * d / (m * omega))


def _schedule_edge(m: float, k: float, d: float, omega: Array) -> Array:
    """Largest a that α(t) proves at each ω, by bisection."""
    found = np.empty((len(omega), 2))
    phase = np.linspace(0, 2 * np.pi, SAMPLES + 1)
    for i, w in enumerate(omega):
        low, high = 0.0, LARGEST
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            problem = Problem.of(m, k * (1 + middle * np.sin(phase)), d, time=phase / w)
            assert problem is not None
            program = AlphaProgram.of(problem, SAMPLES)
            coefficients, slack, _ = program.solved()
            proved = coefficients is not None and slack > 0 and program.checked(coefficients) >= 0
            low, high = (middle, high) if proved else (low, middle)
        found[i] = w, low
    return found
