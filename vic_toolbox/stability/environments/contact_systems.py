"""A contact's loop as python-control systems, in SI units: what the user goes on with."""

from __future__ import annotations

import control
import numpy as np

from vic_toolbox.errors import InputError
from vic_toolbox.stability.environments.contact_edges import held_step
from vic_toolbox.stability.environments.contact_loop import ContactLoop, Plant, quasipolynomial


def open_loop(loop: ContactLoop, environment: float, pade: int) -> control.StateSpace:
    """L of one environment [N/m]; a delay as Padé approximation, a held loop discrete."""
    scaled, plant = _scaled(loop, environment)
    if loop.period > 0:
        step = held_step(plant, scaled, closed=False)
        law = np.append(plant.law, np.zeros(len(step) - len(plant.law)))
        return control.StateSpace(step[:, :-1], step[:, -1:], law[None], 0.0, loop.period)
    found = control.StateSpace(plant.dynamics, plant.push[:, None], plant.law[None], 0.0)
    return _seconds(control.StateSpace(control.series(found, _delay(scaled.delay, pade))), loop.rate)


def closed_loop(loop: ContactLoop, environment: float, pade: int) -> control.StateSpace:
    """From a force command to the contact force."""
    scaled, plant = _scaled(loop, environment)
    if loop.period > 0:
        step = held_step(plant, scaled, closed=False)
        law = np.append(plant.law, np.zeros(len(step) - len(plant.law)))
        force = np.append(plant.force, np.zeros(len(step) - len(plant.law)))
        closed = step[:, :-1] - np.outer(step[:, -1], law)
        return control.StateSpace(closed, step[:, -1:], force[None], 0.0, loop.period)
    dynamics, push = plant.dynamics, plant.push
    late = _delay(scaled.delay, pade)
    a, b, c, d = (np.asarray(m) for m in (late.A, late.B, late.C, late.D))
    # u = w − (late law)
    whole = np.block([
        [dynamics - np.outer(push, d @ plant.law[None]), -np.outer(push, c)],
        [b @ plant.law[None], a],
    ])  # fmt: skip
    force = np.append(plant.force - plant.through * (d @ plant.law[None])[0], -plant.through * c)
    whole_push = np.append(push, np.zeros(len(a)))[:, None]
    return _seconds(control.StateSpace(whole, whole_push, force[None], plant.through), loop.rate)


def root_locus_system(loop: ContactLoop, pade: int) -> control.TransferFunction:
    """W(s) with ``1 + K_e W(s) = 0``."""
    if loop.period > 0:
        raise InputError(
            "the poles of a held loop are not those of a constant times a system; see Contact.plot, or poles()."
        )
    scaled = loop.dimensionless()
    soft, hard = (quasipolynomial(scaled.plant(k), 0.0) for k in (0.0, 1.0))
    top, bottom = control.pade(loop.delay * loop.rate, pade) if loop.delay > 0 else ([1.0], [1.0])
    free = np.polyadd(np.polymul(soft.own, bottom), np.polymul(soft.late, top))
    slope = np.polyadd(np.polymul(hard.own - soft.own, bottom), np.polymul(hard.late - soft.late, top))
    slope = np.trim_zeros(slope, "f")
    return control.TransferFunction(_in_seconds(slope, loop.rate) / loop.unit, _in_seconds(free, loop.rate))


def frequency_response(loop: ContactLoop, environment: float, frequency: np.ndarray) -> np.ndarray:
    """L(jω), or L(e^{jωT}), exact."""
    scaled, plant = _scaled(loop, environment)
    if loop.period > 0:
        found = open_loop(loop, environment, 0)
        return np.asarray(found(np.exp(1j * np.asarray(frequency) * loop.period)))
    own, late, delay = quasipolynomial(plant, scaled.delay)
    s = 1j * np.asarray(frequency) / loop.rate
    return np.polyval(late, s) / np.polyval(own, s) * np.exp(-s * delay)


def poles(loop: ContactLoop, environment: float) -> np.ndarray:
    """Poles [1/s] on one environment (of a delay the ones to the right that collocation finds); z of a held loop."""
    from vic_toolbox.stability.environments.delay_loop import generator

    scaled, plant = _scaled(loop, environment)
    if loop.period > 0:
        return np.linalg.eigvals(held_step(plant, scaled))
    if loop.delay > 0:
        whole = generator(plant.dynamics, -np.outer(plant.push, plant.law), scaled.delay)[0]
        found = np.linalg.eigvals(whole)
        return found[np.abs(found) * scaled.delay < 15] * loop.rate
    return np.linalg.eigvals(plant.closed) * loop.rate


def _scaled(loop: ContactLoop, environment: float) -> tuple[ContactLoop, Plant]:
    scaled = loop.dimensionless()
    return scaled, scaled.plant(environment / loop.unit)


def _delay(delay: float, pade: int) -> control.StateSpace:
    if delay == 0:
        return control.StateSpace(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), 1.0)
    return control.StateSpace(control.tf2ss(control.tf(*control.pade(delay, pade))))


def _seconds(system: control.StateSpace, rate: float) -> control.StateSpace:
    """The same system, its time no longer without units (Padé coefficients are too large for expm in seconds)."""
    return control.StateSpace(np.asarray(system.A) * rate, np.asarray(system.B) * rate, system.C, system.D)


def _in_seconds(polynomial: np.ndarray, rate: float) -> np.ndarray:
    """Coefficients of s for those of s/rate."""
    return polynomial / rate ** np.arange(len(polynomial) - 1, -1, -1)
