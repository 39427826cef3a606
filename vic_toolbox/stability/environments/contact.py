"""An arm on an environment: the stiffest one that it can touch without starting to bounce."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import Array, InputError, Number, finite_number, one_of, positive
from vic_toolbox.stability.environments.axis_crossings import Edge
from vic_toolbox.stability.environments.contact_edges import is_stable, stable_ranges
from vic_toolbox.stability.environments.contact_loop import ContactLoop
from vic_toolbox.stability.environments.contact_proof import any_environment, decay_rate, one_environment
from vic_toolbox.stability.verdict import Verdict, status_of

if TYPE_CHECKING:
    import control
    from matplotlib.figure import Figure

KINDS = ("impedance", "admittance")
SEARCHED, DECADES = 60, 3
"""Dampings at which the least one is looked for, over so many decades to each side."""


@dataclass(frozen=True, eq=False)
class Contact(Verdict):
    """The verdict on a contact, with its loop as python-control systems to go on with.

    Parameters
    ----------
    loop : ContactLoop
        The numbers it is for, in SI units.
    environment : float
        Environment stiffness at which the systems below are taken [N/m]: the given one; else half of the largest, or,
        where there is none, the stiffness that the loop's own rate and mass make.
    """

    loop: ContactLoop | None = None
    environment: float = float("nan")

    def open_loop(self, *, pade: int = 6) -> control.StateSpace:
        """``L(s)``, the loop cut at the controller's force: stable where 1 + L has no root on the right.

        A delay is a Padé approximation of that order; a held loop is discrete and exact.
        """
        from vic_toolbox.stability.environments.contact_systems import open_loop

        return open_loop(self._numbers, self.environment, pade)

    def closed_loop(self, *, pade: int = 6) -> control.StateSpace:
        """From a force command [N], added to the controller's force, to the contact force [N]."""
        from vic_toolbox.stability.environments.contact_systems import closed_loop

        return closed_loop(self._numbers, self.environment, pade)

    def root_locus_system(self, *, pade: int = 6) -> control.TransferFunction:
        """``W(s)`` with ``1 + K_e W(s) = 0`` at the poles: ``control.root_locus`` of it moves K_e.

        Raises
        ------
        InputError
            The loop is held: the poles of a held loop are not those of a constant times a system.
        """
        from vic_toolbox.stability.environments.contact_systems import root_locus_system

        return root_locus_system(self._numbers, pade)

    def frequency_response(self, frequency: Array) -> Array:
        """L at ω [rad/s], exact with its delay: what a Nyquist plot shows."""
        from vic_toolbox.stability.environments.contact_systems import frequency_response

        return frequency_response(self._numbers, self.environment, frequency)

    def plot(self) -> Figure:
        """Nyquist curve, root locus over the environment stiffness, step response and decay rate."""
        from vic_toolbox.stability.environments.contact_picture import draw

        return draw(self)

    @property
    def _numbers(self) -> ContactLoop:
        assert self.loop is not None
        return self.loop


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def contact(
    mass: Number = 0.0,
    stiffness: Number = 0.0,
    damping: Number = 0.0,
    *,
    kind: str = "admittance",
    environment_stiffness: Number | None = None,
    environment_damping: Number = 0.0,
    filter_time: Number = 0.0,
    delay: Number = 0.0,
    joint_stiffness: Number | None = None,
    joint_inertia: Number | None = None,
    joint_damping: Number = 0.0,
    period: Number | None = None,
) -> Contact:
    """Is a 1-DOF arm in contact stable, and how stiff may the environment ``F = K_e x + B_e ẋ`` be?

    *Admittance*: the arm is a position source that follows ``M ẍ_c + B ẋ_c + K x_c = −F``, F measured. With a joint it
    follows through it: ``J ẍ = K_j (x_c − x) + D_j (ẋ_c − ẋ) − F``, J the inertia behind the joint. *Impedance*: the
    arm of mass M is driven by ``u = −K q − B q̇``, ``M ẍ = u − F``. With a joint q is the position of a motor of
    inertia J: ``J q̈ = u − K_j (q − x) − D_j (q̇ − ẋ)``. The measured force, or the law, passes ``1/(t_f s + 1)`` and
    comes `delay` late; with a `period` it is sampled and held.

    The largest K_e is exact: where a root crosses the axis, ``K_e = −f₀(jω)/f₁(jω)`` is real, as the characteristic
    function is ``f₀ + K_e f₁``. Without delay ω is the root of a polynomial (for admittance with K = 0 it gives
    ``K_e = B (M + B t_f)/(M t_f)``); with it a sign change on a fine grid, refined (``M = 0``: ``K_e = π B/(2 τ)``).

    Parameters
    ----------
    mass : float, optional
        M [kg]: virtual, ≥ 0, for admittance (0: damping control); the arm's, > 0, for impedance.
    stiffness, damping : float, optional
        K [N/m] and B [Ns/m] of the controller, ≥ 0.
    kind : {'admittance', 'impedance'}, optional
        Which controller.
    environment_stiffness : float, optional
        K_e [N/m] that is asked about; without it: all of them.
    environment_damping : float, optional
        B_e [Ns/m].
    filter_time : float, optional
        t_f [s].
    delay : float, optional
        τ [s].
    joint_stiffness, joint_inertia, joint_damping : float, optional
        K_j [N/m], J [kg] and D_j [Ns/m] of a flexible joint, seen at the contact; the first two together.
    period : float, optional
        T [s] of the controller.

    Returns
    -------
    Contact
        A verdict with the loop's python-control systems. Margin: distance of K_e from the edge of stability [N/m].
        Values: ``max_environment_stiffness`` [N/m]: every softer one is stable; 0 if soft ones are not, inf if all are.
        ``stable_ranges`` (n, 2) [N/m], all that were found; ``edge_frequency`` [rad/s] of the
        bounce at the largest. With a given K_e: ``minimum_damping`` [Ns/m], the least B from which on this environment
        is stable (NaN if there is none); ``decay_rate`` [1/s] of the slowest mode.

    Raises
    ------
    InputError
        Numbers that are negative or not finite, half a joint, no mass where one is needed, a loop without dynamics.

    References
    ----------
    N. Hogan, S. P. Buerger, Impedance and interaction control, in Robotics and Automation Handbook, 2005; D. Whitney,
    Force feedback control of manipulator fine motions, J. Dyn. Syst. Meas. Control 99 (1977).
    """
    loop = _checked(
        ContactLoop(
            one_of("kind", kind, KINDS),
            _given("mass", mass),
            _given("stiffness", stiffness),
            _given("damping", damping),
            _given("environment_damping", environment_damping),
            _given("filter_time", filter_time),
            _given("delay", delay),
            None if joint_stiffness is None else positive("joint_stiffness", joint_stiffness),
            0.0 if joint_inertia is None else positive("joint_inertia", joint_inertia),
            _given("joint_damping", joint_damping),
            0.0 if period is None else positive("period", period),
        )
    )
    asked = None if environment_stiffness is None else _given("environment_stiffness", environment_stiffness)
    scaled, unit, rate = loop.dimensionless(), loop.unit, loop.rate
    ranges, edges = stable_ranges(scaled)
    largest = ranges[0][1] if ranges and ranges[0][0] == 0 else 0.0
    values: dict[str, Any] = {
        "max_environment_stiffness": largest * unit,
        "stable_ranges": np.array(ranges).reshape(-1, 2) * unit,
        "edge_frequency": _frequency(edges, largest) * rate,
    }
    margin = math.nan
    if asked is None:
        witness, reason = any_environment(loop, scaled, ranges)
        shown = 0.5 * largest * unit if 0 < largest < math.inf else unit
    else:
        witness, reason = one_environment(loop, scaled, asked / unit)
        margin, shown = _margin(asked / unit, ranges) * unit, asked
        values["minimum_damping"] = minimum_damping(loop, asked)
        values["decay_rate"] = decay_rate(scaled, asked / unit) * rate
    text = "every environment stiffness" if asked is None else f"K_e = {asked:g} N/m"
    return Contact(
        status_of(witness),
        f"{kind} control in contact with {text}: stable?",
        "roots on the axis, exact in the environment stiffness; argument principle with a delay, zero-order-hold "
        "map with a period",
        margin=margin,
        margin_unit="N/m of environment stiffness",
        values=values,
        witness=witness,
        assumptions=_assumptions(loop),
        reason=reason,
        loop=loop,
        environment=shown,
    )


def minimum_damping(loop: ContactLoop, environment: float) -> float:
    """Least B [Ns/m] from which on the contact with K_e is stable, up to the loop's own B or the next; or NaN."""

    def stable(damping: float) -> bool:
        changed = replace(loop, damping=damping)
        return is_stable(changed.dimensionless(), environment / changed.unit)

    centre = loop.damping or math.sqrt(max(loop.mass * (environment + loop.stiffness), 1e-300)) or 1.0
    grid = centre * np.geomspace(10.0**-DECADES, 10.0**DECADES, 2 * SEARCHED + 1)
    found = np.array([stable(b) for b in grid])
    first = SEARCHED
    if not found[first]:
        above = np.flatnonzero(found[first:])
        if not len(above):
            return math.nan
        first += int(above[0])
    while first > 0 and found[first - 1]:
        first -= 1
    if first == 0:
        return 0.0 if loop.mass > 0 and stable(0.0) else float(grid[0])
    low, high = grid[first - 1], grid[first]
    while high - low > 1e-12 * high:
        middle = math.sqrt(low * high)
        if middle in (low, high):
            break
        low, high = (low, middle) if stable(middle) else (middle, high)
    return float(high)


def _given(name: str, value: Number) -> float:
    return finite_number(name, value, low=0.0)


def _checked(loop: ContactLoop) -> ContactLoop:
    if (loop.joint_stiffness is None) != (loop.joint_inertia == 0):
        raise InputError("a flexible joint needs joint_stiffness and joint_inertia; pass both or none.")
    if loop.joint_stiffness is None and loop.joint_damping > 0:
        raise InputError(
            "joint_damping belongs to a flexible joint; pass joint_stiffness and joint_inertia too."
        )
    if loop.kind == "impedance" and loop.mass == 0:
        raise InputError("impedance control drives a mass; pass the arm's mass > 0 (or kind='admittance').")
    if loop.mass == 0 and loop.damping == 0:
        raise InputError("neither mass nor damping: the arm would move infinitely fast; pass one of them.")
    direct = loop.filter_time == 0 and loop.joint_stiffness is None
    if loop.mass == 0 and loop.environment_damping > 0 and direct:
        raise InputError(
            "mass 0 on an environment with damping is a loop without dynamics; pass a filter_time or a mass."
        )
    return loop


def _assumptions(loop: ContactLoop) -> tuple[str, ...]:
    found = ["one degree of freedom, linear, the contact never opens"]
    if loop.period > 0:
        found.append("edges looked for at 600 stiffnesses over twelve decades: a narrower gap is not seen")
    elif loop.delay > 0:
        found.append("edges looked for up to 60/delay [rad/s]")
    return tuple(found)


def _frequency(edges: list[Edge], largest: float) -> float:
    return next((e.frequency for e in edges if abs(e.gain - largest) <= 1e-9 * largest), math.nan)


def _margin(asked: float, ranges: list[tuple[float, float]]) -> float:
    """To the nearest edge: positive inside a stable range, negative outside."""
    for low, high in ranges:
        if low <= asked <= high:
            return min(high - asked, asked - low) if low > 0 else high - asked
    distances = [abs(asked - edge) for pair in ranges for edge in pair if math.isfinite(edge)]
    return -min(distances) if distances else math.nan
