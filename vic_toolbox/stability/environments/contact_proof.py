"""What proves that a contact is stable, or the motion that disproves it."""

from __future__ import annotations

import math

import numpy as np

from vic_toolbox.stability.environments.contact_edges import held_step, is_stable
from vic_toolbox.stability.environments.contact_loop import ContactLoop, quasipolynomial
from vic_toolbox.stability.environments.contact_motion import growing_contact
from vic_toolbox.stability.environments.delay_loop import rightmost_root, unstable_roots
from vic_toolbox.stability.environments.linear_loop import EDGE, continuous_lyapunov, discrete_lyapunov
from vic_toolbox.stability.verdict import Certificate, CounterExample

JUST_ABOVE = 1.1
"""Factor on the largest environment stiffness at which a motion grows, for the witness."""
EVERYWHERE = np.geomspace(1e-4, 1e6, 60)
"""Environment stiffnesses, without units, at which a contact that has no edge is checked again."""

NOT_SHOWN = (
    "a root is on the right, but no growing motion was integrated to show it "
    "(growth far slower, or a mode far faster, than the rest of the loop)."
)


def decay_rate(loop: ContactLoop, environment: float) -> float:
    """Decay of the slowest mode of a loop without units; NaN where its root is not found."""
    plant = loop.plant(environment)
    if loop.period > 0:
        largest = np.abs(np.linalg.eigvals(held_step(plant, loop))).max()
        return -math.log(max(largest, 1e-300)) / loop.period
    late = -np.outer(plant.push, plant.law)
    root = rightmost_root(quasipolynomial(plant, loop.delay), plant.dynamics, late)
    return -root.real if root is not None else math.nan


def _certificate(loop: ContactLoop, environment: float) -> Certificate | str:
    """Checked by a second route; or why not."""
    plant = loop.plant(environment)
    if loop.period > 0:
        step = held_step(plant, loop)
        found = discrete_lyapunov(step, held_step(plant, loop, integrate=True))
        statement = "Φᵀ P Φ − P ≺ 0, P ≻ 0, on the integrated map (states without units)"
        return (
            Certificate(statement, {"P": found.matrix}, found.rate) if found else "no Lyapunov matrix holds."
        )
    if loop.delay > 0:
        characteristic = quasipolynomial(plant, loop.delay)
        decay, count = decay_rate(loop, environment), unstable_roots(characteristic)
        if count == 0 and decay > 0:
            return Certificate(
                "no root of P(s) + e^{−sτ} Q(s) on the right, by the argument principle; slack: decay of the rightmost "
                "root, by collocation and Newton",
                {"own": characteristic.own, "late": characteristic.late, "delay": loop.delay},
                decay,
            )
        return "the argument principle and the rightmost root do not agree."
    found = continuous_lyapunov(plant.closed)
    statement = "Aᵀ P + P A ≺ 0, P ≻ 0, by the eigenvalues of the pencil (states without units)"
    return Certificate(statement, {"P": found.matrix}, found.rate) if found else "no Lyapunov matrix holds."


def one_environment(
    loop: ContactLoop, scaled: ContactLoop, environment: float
) -> tuple[Certificate | CounterExample | None, str]:
    """Certificate or counter-example for one environment stiffness, or None and why."""
    decay = decay_rate(scaled, environment)
    if math.isnan(decay):
        return None, "the rightmost root was not found."
    if abs(decay) <= EDGE:
        return None, "a root is on the axis: on the edge of stability."
    if is_stable(scaled, environment):
        found = _certificate(scaled, environment)
        return (found, "") if isinstance(found, Certificate) else (None, found)
    example = growing_contact(loop, environment)
    return example, "" if example else NOT_SHOWN


def any_environment(
    loop: ContactLoop, scaled: ContactLoop, ranges: list[tuple[float, float]]
) -> tuple[Certificate | CounterExample | None, str]:
    """Certificate for all environment stiffnesses, or a counter-example just beyond the stable ones."""
    if ranges and ranges[0] == (0.0, math.inf):
        if loop.delay > 0 or loop.period > 0:
            return None, "no edge was found, but stiffnesses and frequencies are searched up to a limit only."
        found = [_certificate(scaled, k) for k in EVERYWHERE]
        if all(isinstance(one, Certificate) for one in found):
            slack = min(one.slack for one in found if isinstance(one, Certificate))
            return Certificate(
                "f₀(jω) + K_e f₁(jω) ≠ 0 for all K_e > 0 and ω, and Lyapunov matrices on 60 environments",
                {"stiffness": EVERYWHERE * loop.unit},
                slack,
            ), ""
        return None, "no edge was found, but some Lyapunov matrix does not hold."
    if ranges and ranges[0][0] == 0:
        beyond = ranges[0][1] * JUST_ABOVE
        if len(ranges) > 1:
            beyond = min(beyond, math.sqrt(ranges[0][1] * ranges[1][0]))
    else:
        beyond = 0.5 * ranges[0][0] if ranges else 1.0
    if abs(decay_rate(scaled, beyond)) <= EDGE:
        return None, "roots stay on the axis: nothing decays and nothing grows."
    example = growing_contact(loop, beyond)
    return example, "" if example else NOT_SHOWN
