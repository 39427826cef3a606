"""Is a port passive: stable with every passive environment? If not, the spring that shows it."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
from scipy.linalg import expm
from threadpoolctl import threadpool_limits

from vic_toolbox.errors import InputError, one_of
from vic_toolbox.stability.environments.destabilising_environment import (
    Environment,
    coupled,
    destabilising_environment,
    destabilising_gains,
)
from vic_toolbox.stability.environments.linear_loop import (
    GROWTH,
    growing_mode,
    integrated,
    powers,
    stride,
    until_largest,
)
from vic_toolbox.stability.environments.positive_real import PositiveReal, Rational, positive_real, rational
from vic_toolbox.stability.verdict import Certificate, CounterExample, Verdict, status_of

PORTS = ("admittance", "impedance")
PER_TURN = 40
"""Instants per turn of a growing motion before they are thinned."""
AMPLITUDE = 1e-3


@threadpool_limits.wrap(limits=1, user_api="blas")  # small matrices: threads would only wait for each other
def port_passivity(system: Any, *, port: str = "admittance") -> Verdict:
    """Is a one-axis port passive, so that no passive environment can make it unstable?

    It is iff ``G(s)`` is positive real: no pole on the right, poles on the axis simple with positive residues, and
    ``Re G(jω) ≥ 0``. The poles are looked at first: indices of an unstable port mean nothing. An active port is
    unstable with some passive environment (Colgate and Hogan): a spring or a mass is looked for, then one of them with
    a damper.

    Parameters
    ----------
    system : python-control LTI
        G in continuous time, one input and one output: a transfer function or a state space.
    port : {'admittance', 'impedance'}, optional
        What it maps: force to velocity, or velocity to force. The answer is the same; the names of the environments
        are not.

    Returns
    -------
    Verdict
        Margin: the input passivity index [unit of G]: what can be taken from G before it stops to be passive. Values:
        ``input_passivity_index`` ν = inf Re G(jω), ``output_passivity_index`` ρ = inf Re 1/G(jω) (−inf where the poles,
        or the zeros, already rule it out), ``worst_frequency`` [rad/s], ``least_residue`` (relative; where poles are on
        the axis), ``destabilising_stiffness`` (n, 2) [N/m] and ``destabilising_mass`` (n, 2) [kg]: ranges of springs
        and of masses alone that make it unstable.

    Raises
    ------
    InputError
        Not a python-control system, discrete, or with several inputs or outputs.

    References
    ----------
    J. E. Colgate, N. Hogan, Robust control of dynamically interacting systems, Int. J. Control 48 (1988); C. A. Desoer,
    M. Vidyasagar, Feedback Systems: Input-Output Properties, 1975, for the indices.
    """
    one_of("port", port, PORTS)
    top, bottom = _coefficients(system)
    rate = _rate(top, bottom)
    function = rational(
        top * rate ** np.arange(len(top))[::-1], bottom * rate ** np.arange(len(bottom))[::-1]
    )
    if not np.any(function.top):
        raise InputError("the system is zero: a port that never moves; pass one that answers.")
    found = positive_real(function)
    inverse = positive_real(rational(function.bottom, function.top))
    springs, masses = _ranges(function, port, rate)
    values = {
        "input_passivity_index": found.least,
        "output_passivity_index": inverse.least,
        "worst_frequency": found.frequency * rate,
        "destabilising_stiffness": springs,
        "destabilising_mass": masses,
    }
    if np.isfinite(found.residue):
        values["least_residue"] = found.residue
    witness, reason = _shown(system, function, found, rate, port)
    return Verdict(
        status_of(witness),
        f"{port} port: passive?",
        "positive realness: poles, residues on the axis, stationary points of Re G(jω) (Colgate and Hogan 1988)",
        margin=found.least if np.isfinite(found.least) else math.nan,
        margin_unit="(unit of G) of input passivity index",
        values=values,
        witness=witness,
        assumptions=("linear, one axis; modes that the port does not show are left out",),
        reason=reason,
    )


def _coefficients(system: Any) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(system, control.StateSpace | control.TransferFunction):
        raise InputError(
            f"system is a {type(system).__name__}; pass a python-control transfer function or state space."
        )
    if system.ninputs != 1 or system.noutputs != 1:
        raise InputError(
            f"the system has {system.ninputs} inputs and {system.noutputs} outputs; pass one axis, "
            "e.g. nᵀ G n along a direction n."
        )
    if system.isdtime(strict=True):
        raise InputError(
            "the system is discrete; a sampled wall between a hand and its friction: sampled_passivity."
        )
    transfer = control.ss2tf(system) if isinstance(system, control.StateSpace) else system
    top, bottom = (np.asarray(p[0][0], dtype=np.float64) for p in (transfer.num, transfer.den))
    if not (np.isfinite(top).all() and np.isfinite(bottom).all()):
        raise InputError("the system has coefficients that are not finite.")
    if isinstance(system, control.StateSpace):  # conversion leaves rounding in front
        top = np.where(np.abs(top) > 1e-12 * np.abs(top).max(), top, 0.0)
    return top, bottom


def _rate(top: np.ndarray, bottom: np.ndarray) -> float:
    """Geometric mean of the rates of poles and zeros: what time is measured in."""
    rates = np.abs(np.concatenate([np.roots(np.trim_zeros(p, "f")) for p in (top, bottom) if np.any(p)]))
    rates = rates[rates > 1e-6 * rates.max(initial=0.0)]
    return float(np.exp(np.log(rates).mean())) if len(rates) else 1.0


def _ranges(function: Rational, port: str, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Springs [N/m] and masses [kg] alone that destabilise.

    On an admittance a spring is the integral gain and a mass the derivative one. On an impedance they change places and
    count inversely: there the environment answers a force with a velocity.
    """
    integral = np.array(destabilising_gains(function, derivative=False)).reshape(-1, 2) * rate
    derivative = np.array(destabilising_gains(function, derivative=True)).reshape(-1, 2) / rate
    if port == "admittance":
        return integral, derivative
    with np.errstate(divide="ignore"):
        return (1 / derivative)[:, ::-1][::-1], (1 / integral)[:, ::-1][::-1]


def _shown(
    system: Any, function: Rational, found: PositiveReal, rate: float, port: str
) -> tuple[Certificate | CounterExample | None, str]:
    if found.passive:
        slack = min(found.swept, found.residue if np.isfinite(found.residue) else np.inf)
        if slack >= 0:
            return Certificate(
                "Re G(jω) ≥ 0 (poles on the axis split off, to rounding), checked at 4000 frequencies; residues ≥ 0",
                {"num": function.top, "den": function.bottom, "rate": rate},
                slack,
            ), ""
        return None, "the sweep does not agree with the stationary points."
    why = _why(found, rate)
    if len(function.top) > len(
        function.bottom
    ):  # no state space has it: the same port seen the other way has
        function = rational(function.bottom, function.top)
        system, port = control.tf(function.top, function.bottom), PORTS[port == "admittance"]
    if found.unstable > 0:
        environment = Environment(0.0, 0.0, 0.0)
    else:
        springs, masses = (destabilising_gains(function, derivative=one) for one in (False, True))
        candidate = destabilising_environment(function, springs, masses, found.frequency)
        if candidate is None:
            return None, f"{why}, so it is not passive, but no environment that shows it was found."
        environment = candidate
    example = _motion(system, function, environment, rate, port)
    return example, "" if example else f"{why}, but the motion did not grow when it was integrated again."


def _why(found: PositiveReal, rate: float) -> str:
    if found.unstable > 0:
        return f"a pole is on the right, at {found.unstable * rate:.6g}/s"
    if not np.isnan(found.double):
        return f"a pole on the axis is repeated, at {found.double * rate:.6g} rad/s"
    if found.residue < 0:
        return "a pole on the axis has a residue that is not positive"
    return f"Re G is {found.least:.6g} at {found.frequency * rate:.6g} rad/s"


def _motion(
    system: Any, function: Rational, environment: Environment, rate: float, port: str
) -> CounterExample | None:
    """The growing motion of port and environment, in the port's own states if it was given with some."""
    if isinstance(system, control.StateSpace):
        a, b, c, d = (
            np.asarray(m, dtype=np.float64)
            for m in (np.asarray(system.A) / rate, np.asarray(system.B) / rate, system.C, system.D)
        )
    else:
        realised = control.StateSpace(control.tf2ss(control.tf(function.top, function.bottom)))
        a, b, c, d = (
            np.asarray(m, dtype=np.float64) for m in (realised.A, realised.B, realised.C, realised.D)
        )
    matrix = coupled(a, b[:, 0], c[0], float(d[0, 0]), environment)
    if environment == (0.0, 0.0, 0.0):
        matrix = a
    mode = growing_mode(matrix, discrete=False)
    if mode.eigenvalue.real <= 0:
        return None
    wanted = math.log(GROWTH) / mode.eigenvalue.real
    base = min(wanted, 2 * math.pi / max(abs(mode.eigenvalue.imag), 1e-12)) / PER_TURN
    count, every = stride(wanted / base)
    first, second = (
        np.linalg.matrix_power(one, every) for one in (expm(matrix * base), integrated(matrix, base))
    )
    states = powers(first, AMPLITUDE * mode.start, count)
    part = until_largest(states)
    time, states = np.arange(count, dtype=np.float64)[part] * base * every / rate, states[part]
    stored = 0.5 * np.sum(states**2, axis=1)
    if environment.integral > 0:
        stored = 0.5 * environment.integral * states[:, len(a)] ** 2
    elif environment.derivative > 0 and len(matrix) == len(a) + 1:
        stored = 0.5 * environment.derivative * (states[:, : len(a)] @ c[0]) ** 2
    named = _named(environment, rate, port)
    touching = ", ".join(f"{name} {value:.6g}" for name, value in named.items()) or "nothing"
    example = CounterExample(
        f"coupled to {touching} (SI), a mode grows at {mode.eigenvalue.real * rate:.6g}/s; the states are the port's, "
        "then the environment's",
        time,
        states,
        stored,
        environment=named,
        again=lambda initial: (time, powers(second, np.asarray(initial, dtype=np.float64), len(time))),
    )
    grows = np.linalg.norm(example.replay()[1][-1]) > np.linalg.norm(states[0]) and example.growth > 1
    return example if grows else None


def _named(environment: Environment, rate: float, port: str) -> dict[str, float]:
    integral, proportional, derivative = environment
    integral, derivative = integral * rate, derivative / rate
    if port == "impedance":
        integral, proportional, derivative = (
            1 / g if g else 0.0 for g in (derivative, proportional, integral)
        )
    named = {"stiffness": integral, "damping": proportional, "mass": derivative}
    return {name: float(value) for name, value in named.items() if value > 0}
