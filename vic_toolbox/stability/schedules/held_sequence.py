"""The motion under gains that are held and jump: exact from hold to hold, and by collocation to check it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import eigh, expm, solve_discrete_lyapunov

from vic_toolbox.errors import Array
from vic_toolbox.stability.schedules.definite import ROUNDING
from vic_toolbox.stability.schedules.free_motion import FreeMotion, IntegrationError, product
from vic_toolbox.stability.verdict import Certificate, CounterExample

CLOSED = 1e-9
"""Relative difference between first and last gains that are the same."""
SHOWN = 256
"""Least instants of a round that are shown."""
ROUNDS = 60
"""Most rounds of a counter-example."""
MOST = 400_000
"""Most collocation steps of a round."""
PHASE = 0.2
"""Largest ‖A‖ h of a collocation step: its error is then below 1e-10."""


@dataclass(frozen=True, eq=False)
class HeldSequence:
    """Gains of sample i hold until the next one: M (d, d), K and D (n, d, d), time (n,)."""

    mass: Array
    stiffness: Array
    damping: Array
    time: Array

    @cached_property
    def motion(self) -> FreeMotion:
        """The motion over one round, for its coordinates without units and its collocation."""

        def matrices(t: Array) -> tuple[Array, Array, Array]:
            i = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 2)
            return np.broadcast_to(self.mass, (len(t), *self.mass.shape)), self.stiffness[i], self.damping[i]

        return FreeMotion(matrices, float(self.time[0]), float(self.time[-1]))

    @property
    def closed(self) -> bool:
        """Whether the last gains are the first."""
        for x in (self.stiffness, self.damping):
            size = np.sqrt(np.diagonal(x[0]))
            if (np.abs(x[-1] - x[0]) > CLOSED * np.abs(x[0]) + ROUNDING * np.outer(size, size)).any():
                return False
        return True

    @cached_property
    def parts(self) -> int:
        """Into how many each hold is divided to be shown."""
        return max(1, -(-SHOWN // (len(self.time) - 1)))

    @cached_property
    def instants(self) -> Array:
        """The samples, and what divides the holds."""
        share = np.arange(self.parts) / self.parts
        inner = self.time[:-1, None] + share * np.diff(self.time)[:, None]
        return np.append(inner.reshape(-1), self.time[-1])

    @cached_property
    def steps(self) -> Array:
        """Exact transition matrices between these, without units: one exponential for each hold."""
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        width = np.diff(self.time) / self.parts
        found = np.asarray(expm(self.motion.system(middle) * width[:, None, None]), dtype=np.float64)
        return np.repeat(found, self.parts, axis=0)

    @cached_property
    def collocated(self) -> Array:
        """The same by Gauss collocation."""
        middle = 0.5 * (self.time[1:] + self.time[:-1])
        size = np.linalg.norm(self.motion.system(middle), axis=(1, 2)) * np.diff(self.time) / self.parts
        more = max(1, int(np.ceil(size.max() / PHASE)))
        if more * self.parts * len(size) > MOST:
            raise IntegrationError(
                f"a round of {self.time[-1] - self.time[0]:.6g} s holds too many oscillations to be checked by a "
                "second integrator; pass a shorter sequence."
            )
        share = np.arange(more) / more
        inner = self.instants[:-1, None] + share * np.diff(self.instants)[:, None]
        fine = self.motion.steps(np.append(inner.reshape(-1), self.time[-1]))
        fine = fine.reshape(-1, more, *fine.shape[1:])
        found = fine[:, 0]
        for i in range(1, more):
            found = fine[:, i] @ found
        return found

    def path(self, state: Array, rounds: int, steps: Array) -> tuple[Array, Array]:
        """Instants and states [e; ė] over some rounds."""
        length = self.time[-1] - self.time[0]
        starts = self.time[0] + length * np.arange(rounds)
        t = np.append(
            (starts[:, None] + (self.instants[:-1] - self.time[0])).reshape(-1), starts[-1] + length
        )
        found, now = np.empty((len(t), len(state))), state / self.motion.scale
        found[0] = now
        for k in range(1, len(t)):
            now = steps[(k - 1) % len(steps)] @ now
            found[k] = now
        return t, found * self.motion.scale

    def energy(self, state: Array) -> Array:
        """½ ėᵀ M ė + ½ eᵀ K e [J] along rounds, with the gains that hold from each instant on."""
        k = np.repeat(self.stiffness[:-1], self.parts, axis=0)
        k = np.concatenate([np.tile(k, ((len(state) - 1) // len(k), 1, 1)), self.stiffness[-1:]])
        e, rate = np.split(state, 2, axis=1)
        return 0.5 * (form(rate, self.mass) + form(e, k))


def decaying(held: HeldSequence, phi: Array) -> Certificate:
    """P of one integrator, checked with the other."""
    p = solve_discrete_lyapunov(phi.T, np.eye(len(phi)))
    p, check = 0.5 * (p + p.T), product(held.collocated)
    left = p - check.T @ p @ check
    slack = float(min(np.linalg.eigvalsh(0.5 * (left + left.T))[0], np.linalg.eigvalsh(p)[0]))
    return Certificate(
        "Φᵀ P Φ − P ≺ 0 and P ≻ 0 over one round, in coordinates without units", {"P": p}, slack
    )


def growing(held: HeldSequence, multiplier: complex, vector: Array) -> CounterExample | None:
    """The motion along the worst eigenvector, if another integrator sees it grow as well."""
    radius = abs(multiplier)
    most = int(np.clip(np.ceil(np.log(10.0) / np.log(radius)), 1, ROUNDS))
    phases = np.exp(1j * np.linspace(0, np.pi, 24, endpoint=False)) if multiplier.imag else np.ones(1)
    rounds = np.arange(1, most + 1)
    turned = vector / vector[np.argmax(np.abs(vector))] * phases[:, None]
    ends = np.real(turned[:, None] * multiplier ** rounds[:, None])
    growth = np.linalg.norm(ends, axis=2) / np.linalg.norm(np.real(turned), axis=1)[:, None]
    phase, k = np.unravel_index(int(np.argmax(growth)), growth.shape)
    start = np.real(turned[phase]) * held.motion.scale
    start, count = start / np.linalg.norm(start), int(rounds[k])
    t, state = held.path(start, count, held.steps)
    energy, again = held.energy(state), held.energy(held.path(start, count, held.collocated)[1])
    if energy[-1] <= energy[0] or again[-1] <= again[0]:
        return None
    gains = {
        name: np.concatenate([np.tile(np.repeat(x[:-1], held.parts, axis=0), (count, 1, 1)), x[-1:]])
        for name, x in (("stiffness", held.stiffness), ("damping", held.damping))
    }
    return CounterExample(
        f"this motion grows by {radius:.6g} in every round of {held.time[-1] - held.time[0]:.6g} s: in {count} rounds "
        f"its energy is multiplied by {energy[-1] / energy[0]:.3g}",
        time=t,
        state=state,
        energy=energy,
        gains=gains,
        again=lambda initial: held.path(np.asarray(initial, dtype=np.float64), count, held.collocated),
    )


def gaining(held: HeldSequence, phi: Array) -> tuple[float, Array]:
    """Largest energy at the end over that at the start, and the state [e; ė] that has it."""
    scale, size = held.motion.scale, len(held.mass)
    before, after = np.zeros((2, 2 * size, 2 * size))
    for weight, k in ((before, held.stiffness[0]), (after, held.stiffness[-1])):
        weight[:size, :size], weight[size:, size:] = k, held.mass
        weight *= scale[:, None] * scale
    softest, *_, stiffest = np.linalg.eigvalsh(before)
    if softest <= ROUNDING * stiffest:  # some start has no energy to compare with
        return float("inf"), np.ones(2 * size) * scale
    gains, vectors = eigh(phi.T @ after @ phi, before)
    return float(gains[-1]), vectors[:, -1] * scale


def form(x: Array, matrices: Array) -> Array:
    """``xᵀ A x`` of vectors (n, d) and matrices (d, d) or (n, d, d)."""
    return np.einsum("ni,nij,nj->n", x, np.broadcast_to(matrices, (len(x), *matrices.shape[-2:])), x)
