"""The worst that a stiffness can do by switching: exact for one degree of freedom."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import root_scalar

from vic_toolbox.errors import Array, InputError, Number, finite_array, finite_number, positive
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict, status_of

EDGE = 1e-9
"""Distance of the growth per half turn from one that rounding hides."""
HALF_TURNS, ENOUGH, POINTS = 200, 100.0, 400
"""Of the growing motion: at most, until it grew by this, and instants of all stretches, about."""
START = 1e-2
"""Amplitude of the growing motion [m or rad]."""


class Stretch(NamedTuple):
    """Between an axis of the phase plane and the next: how long [s] and e₁/v₀ [s] or v₁/e₀ [1/s]."""

    duration: float
    ratio: float


def worst_case_switching(mass: Number, stiffness_range: tuple[float, float], damping: Number) -> Verdict:
    """Does ``m ë + b ė + k(t) e = 0`` stay bounded for *every* k(t) in [k_min, k_max], however fast it changes?

    At each state the worst k is the one that turns the motion most outward: with f the field,
    ``f(k₁) × f(k₂) = (k₁ − k₂) e ė/m``, so it is k_min while moving out (e ė > 0) and k_max while moving in. The
    motion so made goes round the phase plane in stretches with closed forms; with σ = b/2m, ωᵢ² = kᵢ/m it grows each
    half turn by

        ``√(k_max/k_min) · exp(−σ (t_out + t_in))``, ``t_out = atan2(ω_d, σ)/ω_d``, ``t_in = (π − atan2(ω_d, σ))/ω_d``

    with ω_d² = ωᵢ² − σ² (hyperbolic where it is negative). If that is below one, every motion dies out; if it is above,
    the bang-bang one grows. If ``b² ≥ 4 m k_max`` no motion can turn, and all die out. No certificate with a quadratic
    V is as wide: it needs ``b > √m (√k_max − √k_min)``.

    Parameters
    ----------
    mass : float
        m [kg, kg m²].
    stiffness_range : tuple of float
        0 ≤ k_min ≤ k_max, k_max > 0 [N/m, Nm/rad].
    damping : float
        b ≥ 0 [Ns/m, Nms/rad].

    Returns
    -------
    Verdict
        Margin: ``b − critical_damping`` [Ns/m]. Values: ``critical_damping`` (stable iff b is above it),
        ``growth_per_half_turn`` (0 if the worst motion does not turn), ``growth_per_cycle`` (its square),
        ``common_quadratic_damping`` (what a common quadratic Lyapunov function would need). The certificate holds the
        closed curve ``orbit`` of the critical damping, a level of a Lyapunov function for every k(t).

    Raises
    ------
    InputError
        A mass that is not positive, negative gains, or a range that is empty.

    References
    ----------
    D. Liberzon, Switching in Systems and Control, 2003, sec. 2.1; U. Boscain, SIAM J. Control Optim. 41 (2002).
    """
    m, b = positive("mass", mass), finite_number("damping", damping, low=0.0)
    low, high = (float(k) for k in finite_array("stiffness_range", stiffness_range, shape=(2,)))
    if not 0 <= low <= high or high <= 0:
        raise InputError(
            f"stiffness_range is ({low:g}, {high:g}); pass (k_min, k_max) with 0 ≤ k_min ≤ k_max and k_max > 0."
        )
    growth, critical = half_turn_growth(m, low, high, b), critical_damping(m, low, high)
    witness, reason = _shown(m, low, high, b, growth, critical)
    return Verdict(
        status_of(witness),
        f"m ë + b ė + k(t) e = 0 with any k(t) in [{low:g}, {high:g}]: bounded?",
        "extremal bang-bang motion in closed form (Liberzon 2003, sec. 2.1; Boscain 2002)",
        margin=b - critical,
        margin_unit="Ns/m of damping (b − critical damping)",
        values={
            "critical_damping": critical,
            "growth_per_half_turn": growth,
            "growth_per_cycle": growth**2,
            "common_quadratic_damping": math.sqrt(m) * (math.sqrt(high) - math.sqrt(low)),
        },
        witness=witness,
        assumptions=(
            "one degree of freedom, constant mass and damping; the stiffness may change arbitrarily fast",
            *(
                ("with k = 0 held a motion comes to rest anywhere: bounded, not drawn back",)
                if low == 0
                else ()
            ),
        ),
        reason=reason,
    )


def half_turn_growth(mass: float, low: float, high: float, damping: float) -> float:
    """``|v|`` at the end of the worst half turn over that at its start; 0 if the motion in never crosses zero."""
    if damping / (2 * mass) >= math.sqrt(high / mass):  # overdamped
        return 0.0
    return _out(mass, low, damping).ratio * _in(mass, high, damping).ratio


def critical_damping(mass: float, low: float, high: float) -> float:
    """Damping at which the worst half turn neither grows nor shrinks [Ns/m]; it grows below, and shrinks above."""
    if low == high:
        return 0.0
    overdamped = 2 * math.sqrt(mass * high)

    def excess(share: float) -> float:
        return half_turn_growth(mass, low, high, share * overdamped) - 1

    return overdamped * root_scalar(excess, bracket=(1e-12, 1.0), xtol=1e-15, rtol=1e-14).root


def _out(mass: float, stiffness: float, damping: float) -> Stretch:
    """From e = 0 to ė = 0 under k_min."""
    decay, natural = damping / (2 * mass), math.sqrt(stiffness / mass)
    if natural == 0:
        return Stretch(math.inf, 1 / (2 * decay) if decay else math.inf)
    duration = _quarter(natural, decay)
    return Stretch(duration, math.exp(-decay * duration) / natural)


def _in(mass: float, stiffness: float, damping: float) -> Stretch:
    """From ė = 0 to e = 0 under k_max, which is not overdamped."""
    decay, natural = damping / (2 * mass), math.sqrt(stiffness / mass)
    oscillation = math.sqrt((natural - decay) * (natural + decay))
    duration = (math.pi - math.atan2(oscillation, decay)) / oscillation
    return Stretch(duration, math.exp(-decay * duration) * natural)


def _quarter(natural: float, decay: float) -> float:
    """Time from e = 0 to ė = 0: ``atan2(ω_d, σ)/ω_d``, or its hyperbolic form."""
    square = (natural - decay) * (natural + decay)
    part = math.sqrt(abs(square))
    if part <= 1e-6 * decay:
        return 1 / decay * (1 - square / (3 * decay**2))  # both forms, near ω_d = 0
    return (math.atan2(part, decay) if square > 0 else math.atanh(part / decay)) / part


def _shown(
    m: float, low: float, high: float, b: float, growth: float, critical: float
) -> tuple[Certificate | CounterExample | None, str]:
    if abs(growth - 1) <= EDGE:
        return None, "the worst motion neither grows nor shrinks: on the edge."
    if growth > 1:
        example = _growing(m, _turning(m, low, high, b), high, b)
        grows = np.linalg.norm(example.replay()[1][-1]) > np.linalg.norm(example.initial_state)
        return (example, "") if grows else (None, "the bang-bang motion does not grow when it is integrated.")
    # in units of the mass and the stiffest spring nothing depends on the units of m, k and b
    ratio, unit = low / high, math.sqrt(m * high)
    turned = _integrated(ratio, b / unit)
    closed = _integrated(ratio, critical / unit)
    agree = abs(np.abs(turned[-1, 1]) - growth) <= 1e-7 and abs(np.abs(closed[-1, 1]) - 1) <= 1e-7
    slack = 1 - abs(float(turned[-1, 1]))
    if not agree or slack <= 0:
        return None, "the integrated half turn does not agree with the closed form."
    return Certificate(
        "V = gauge of the critical orbit falls along every k(t), as f_c × f = −[(k − k_c) e ė + (b − b_c) ė²]/m ≤ 0; "
        "slack: what the worst half turn loses, integrated",
        {
            "orbit": np.concatenate([closed, -closed]) * [math.sqrt(m / high), 1.0],
            "critical_damping": critical,
        },
        slack,
    ), ""


def _integrated(ratio: float, damping: float) -> Array:
    """The worst half turn from (0, 1) for m = k_max = 1, k_min = ratio, by LSODA: (n, 2); the last is (0, v)."""

    def stretch(stiffness: float, start: Array, zero: int, duration: float) -> Array:
        def event(_: float, x: Array) -> float:
            return x[zero]

        event.terminal = True
        event.direction = -1
        solution = solve_ivp(
            lambda _, x: [x[1], -stiffness * x[0] - damping * x[1]],
            (0.0, 1.1 * duration),
            start,
            events=event,
            method="LSODA",
            rtol=1e-11,
            atol=1e-14,
            max_step=duration / 50,
        )
        return solution.y.T

    out = _out(1.0, ratio, damping)
    if ratio > 0:
        away = stretch(ratio, np.array([0.0, 1.0]), 1, out.duration)
        away[-1, 1] = 0.0
    else:  # coasting ends at m v/b after an infinite time, along a straight line
        away = np.linspace([0.0, 1.0], [1 / damping, 0.0], 50)
    if damping < 2:
        back = stretch(1.0, away[-1], 0, _in(1.0, 1.0, damping).duration)
    else:  # it creeps towards the origin and does not cross: 30 time constants show it
        back = stretch(1.0, away[-1], 0, 30 * damping)
        if back[-1, 0] > 0:
            back[-1] = 0.0
    return np.concatenate([away, back[1:]])


def _turning(m: float, low: float, high: float, b: float) -> float:
    """A softest spring under which the motion still turns round and grows: k_min, or a little above zero."""
    if low > 0:
        return low
    return next(k for k in high * 10.0 ** np.arange(-1, -16, -1) if half_turn_growth(m, k, high, b) > 1)


def _growing(m: float, low: float, high: float, b: float) -> CounterExample:
    """Bang-bang motion from e = 0, half turn after half turn, by the exact map of each stretch."""
    growth = half_turn_growth(m, low, high, b)
    half_turns = min(math.ceil(math.log(ENOUGH) / math.log(growth)), HALF_TURNS)
    points = max(8, POINTS // half_turns)
    pieces = []  # of one half turn: relative instants, maps, stiffness
    for stiffness, duration in ((low, _out(m, low, b).duration), (high, _in(m, high, b).duration)):
        matrix = np.array([[0.0, 1.0], [-stiffness / m, -b / m]])
        instants = np.linspace(0.0, duration, points + 1)[1:]
        pieces.append((instants, expm(matrix * instants[:, None, None]), stiffness))
    time, state, gains = [np.zeros(1)], [np.array([[0.0, START * math.sqrt(high / m)]])], [np.array([low])]
    for _ in range(half_turns):
        for instants, maps, stiffness in pieces:
            time.append(time[-1][-1] + instants)
            state.append(maps @ state[-1][-1])
            gains.append(np.full(len(instants), stiffness))
    times, states, stiffness = np.concatenate(time), np.concatenate(state), np.concatenate(gains)

    def again(initial: Array) -> tuple[Array, Array]:
        """Runge-Kutta, the stiffness chosen by the state: k_min where e ė > 0, else k_max."""
        return times, _replayed(m, low, high, b, initial, times)

    return CounterExample(
        f"k = {high:g} while moving in and {low:g} while moving out: ×{growth:.6g} each half turn",
        times,
        states,
        0.5 * m * states[:, 1] ** 2 + 0.5 * low * states[:, 0] ** 2,
        gains={
            "stiffness": stiffness[:, None, None],
            "damping": np.full((len(times), 1, 1), b),
        },
        again=again,
    )


def _replayed(m: float, low: float, high: float, b: float, initial: Array, times: Array) -> Array:
    """State at the instants, integrated by DOP853 from switch to switch: at ė = 0 and e = 0."""
    start, now, found = np.array(initial, dtype=np.float64), float(times[0]), np.empty((0, 2))
    outward = start[0] * start[1] > 0 or start[0] == 0
    while len(found) < len(times):
        k, watched = (low, 1) if outward else (high, 0)

        def field(_: float, x: Array, k: float = k) -> list[float]:
            return [x[1], -(k * x[0] + b * x[1]) / m]

        def switch(
            t: float, x: Array, watched: int = watched, since: float = now, was: Array = start
        ) -> float:
            return x[watched] if t > since else math.copysign(1.0, x[watched] or was[1 - watched])

        switch.terminal = True
        wanted = times[len(found) :]
        solution = solve_ivp(
            field,
            (now, times[-1]),
            start,
            t_eval=wanted,
            events=switch,
            method="DOP853",
            rtol=1e-11,
            atol=1e-11 * np.abs(start).max(),
        )
        found = np.concatenate([found, solution.y.T])
        if solution.status != 1:  # the end of the time
            break
        now, start = float(solution.t_events[0][0]), np.array(solution.y_events[0][0])
        start[watched] = 0.0
        outward = not outward
        # rounding may put an instant of the switch itself on either side
        if len(found) < len(times) and times[len(found)] <= now:
            found = np.concatenate([found, start[None]])
    return found
