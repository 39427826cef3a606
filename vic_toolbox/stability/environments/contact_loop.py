"""The loop that an arm closes with what it touches: a dimensionless plant, and a force that comes filtered and late."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np


class Plant(NamedTuple):
    """``ẋ = A x + b u``, ``u = −c x`` (late, or held), contact force ``f x + g u``; of one environment."""

    dynamics: np.ndarray
    push: np.ndarray
    law: np.ndarray
    force: np.ndarray
    through: float

    @property
    def closed(self) -> np.ndarray:
        """A − b c: the loop without delay."""
        return self.dynamics - np.outer(self.push, self.law)


@dataclass(frozen=True)
class ContactLoop:
    """Numbers of a 1-DOF contact; SI units, or none.

    What each means is said by :func:`~vic_toolbox.stability.environments.contact.contact`.
    """

    kind: str
    mass: float
    stiffness: float
    damping: float
    environment_damping: float = 0.0
    filter_time: float = 0.0
    delay: float = 0.0
    joint_stiffness: float | None = None
    joint_inertia: float = 0.0
    joint_damping: float = 0.0
    period: float = 0.0

    @property
    def rate(self) -> float:
        """Geometric mean of all its rates [1/s]: what time is measured in."""
        m, k, b = self.mass, self.stiffness, self.damping
        found = [1 / t for t in (self.filter_time, self.delay, self.period) if t > 0]
        if m > 0:
            found += [one for one in (b / m, math.sqrt(k / m)) if one > 0]
        elif k > 0:
            found.append(k / b)
        if self.joint_stiffness is not None:
            found.append(math.sqrt(self.joint_stiffness / self.joint_inertia))
        if not found and self.environment_damping > 0:
            found.append(self.environment_damping / m)
        return math.exp(sum(map(math.log, found)) / len(found)) if found else 1.0

    @property
    def unit(self) -> float:
        """What stiffness is measured in [N/m]: mass or damping at that rate."""
        return self.mass * self.rate**2 if self.mass > 0 else self.damping * self.rate

    def dimensionless(self) -> ContactLoop:
        """The same loop in those units."""
        rate, unit = self.rate, self.unit
        soft, inertial = rate / unit, rate**2 / unit
        return replace(
            self,
            mass=self.mass * inertial,
            stiffness=self.stiffness / unit,
            damping=self.damping * soft,
            environment_damping=self.environment_damping * soft,
            filter_time=self.filter_time * rate,
            delay=self.delay * rate,
            joint_stiffness=None if self.joint_stiffness is None else self.joint_stiffness / unit,
            joint_inertia=self.joint_inertia * inertial,
            joint_damping=self.joint_damping * soft,
            period=self.period * rate,
        )

    @property
    def names(self) -> tuple[str, ...]:
        """What the states are: those of the body that touches the environment first."""
        own = ("position", "velocity")[: 1 + (self.mass > 0)]
        if self.joint_stiffness is not None:
            behind = own if self.kind == "admittance" else ("position", "velocity")
            side = "commanded" if self.kind == "admittance" else "motor"
            own = ("position", "velocity", *(f"{side} {name}" for name in behind))
        return own + ("filtered force",) * (self.filter_time > 0)

    def units(self) -> np.ndarray:
        """SI units of the states, for a loop without units: position m, velocity m/s, force N."""
        return np.array([
            1.0 if name.endswith("position") else self.rate if name.endswith("velocity") else self.unit
            for name in self.names
        ])  # fmt: skip

    def plant(self, environment: float) -> Plant:
        """The plant on an environment of that stiffness."""
        return (self._admittance if self.kind == "admittance" else self._impedance)(environment)

    def _admittance(self, environment: float) -> Plant:
        """``M ẍ_c + B ẋ_c + K x_c = u``; the arm follows x_c, or through its joint; u is minus the force."""
        flexible = self.joint_stiffness is not None
        order = 1 + (self.mass > 0)
        first = 2 * flexible  # of the commanded motion
        size = first + order + (self.filter_time > 0)
        dynamics, push = np.zeros((size, size)), np.zeros(size)
        if self.mass > 0:
            dynamics[first, first + 1] = 1.0
            dynamics[first + 1, first : first + 2] = -self.stiffness / self.mass, -self.damping / self.mass
            push[first + 1] = 1 / self.mass
            speed, jump = np.eye(size)[first + 1], 0.0
        else:
            dynamics[first, first], push[first] = -self.stiffness / self.damping, 1 / self.damping
            speed, jump = dynamics[first].copy(), push[first]
        place = np.eye(size)[first]
        if flexible:
            link, moving = np.eye(size)[0], np.eye(size)[1]
            drawn = self._joint() @ np.stack([place - link, speed - moving])
            held = environment * link + self.environment_damping * moving
            dynamics[0, 1] = 1.0
            dynamics[1] = (drawn - held) / self.joint_inertia
            push[1] = self.joint_damping * jump / self.joint_inertia
            place, speed, jump = link, moving, 0.0
        force = environment * place + self.environment_damping * speed
        return self._filtered(dynamics, push, force, force, self.environment_damping * jump)

    def _impedance(self, environment: float) -> Plant:
        """``m ẍ = u − K_e x − B_e ẋ``, or through a joint from a motor; u = −(K q + B q̇), q where it is driven."""
        flexible = self.joint_stiffness is not None
        size = 2 + 2 * flexible + (self.filter_time > 0)
        dynamics, push = np.zeros((size, size)), np.zeros(size)
        basis = np.eye(size)
        force = environment * basis[0] + self.environment_damping * basis[1]
        dynamics[0, 1] = 1.0
        dynamics[1] = -force / self.mass
        driven = 0
        if flexible:
            driven = 2
            drawn = self._joint() @ (basis[2:4] - basis[:2])
            dynamics[1] += drawn / self.mass
            dynamics[2, 3] = 1.0
            dynamics[3] = -drawn / self.joint_inertia
            push[3] = 1 / self.joint_inertia
        else:
            push[1] = 1 / self.mass
        law = self.stiffness * basis[driven] + self.damping * basis[driven + 1]
        return self._filtered(dynamics, push, law, force, 0.0)

    def _joint(self) -> np.ndarray:
        return np.array([self.joint_stiffness or 0.0, self.joint_damping])

    def _filtered(
        self, dynamics: np.ndarray, push: np.ndarray, signal: np.ndarray, force: np.ndarray, through: float
    ) -> Plant:
        """The signal behind ``1/(t_f s + 1)``, its state last."""
        if self.filter_time == 0:
            return Plant(dynamics, push, signal, force, through)
        last = len(push) - 1
        dynamics[last] = signal / self.filter_time
        dynamics[last, last] -= 1 / self.filter_time
        if self.kind == "admittance":
            push[last] = through / self.filter_time
        return Plant(dynamics, push, np.eye(last + 1)[last], force, through)


class Quasipolynomial(NamedTuple):
    """``P(s) + e^{−sτ} Q(s)`` of one plant, highest power first; P is monic, Q of lower degree."""

    own: np.ndarray
    late: np.ndarray
    delay: float

    def __call__(self, s: np.ndarray) -> np.ndarray:
        """Its value at s, a root where a motion e^{st} closes the loop."""
        return np.polyval(self.own, s) + np.exp(-s * self.delay) * np.polyval(self.late, s)


def quasipolynomial(plant: Plant, delay: float) -> Quasipolynomial:
    """``det(s − A) + e^{−sτ} c adj(s − A) b``, by Faddeev and LeVerrier's recursion: zeros stay exact zeros."""
    size = len(plant.push)
    own, late, adjugate = np.zeros(size + 1), np.zeros(size + 1), np.eye(size)
    own[0] = 1.0
    for k in range(1, size + 1):
        late[k] = plant.law @ adjugate @ plant.push
        moved = plant.dynamics @ adjugate
        own[k] = -np.trace(moved) / k
        adjugate = moved + own[k] * np.eye(size)
    return Quasipolynomial(own, late, delay)
