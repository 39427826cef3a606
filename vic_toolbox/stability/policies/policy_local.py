"""A policy's closed loop linearised at its equilibrium: eigenvalues, a local certificate, a growing mode."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from vic_toolbox.errors import Array, InputError
from vic_toolbox.stability.arguments import ROUNDING
from vic_toolbox.stability.policies.growing_trajectory import fastest, grown_example
from vic_toolbox.stability.policies.policy_jacobian import PolicyJacobian, policy_jacobian
from vic_toolbox.stability.policies.policy_loop import PolicyLoop
from vic_toolbox.stability.policies.region_of_attraction import lyapunov_matrix
from vic_toolbox.stability.verdict import Certificate, CounterExample

NUDGE = 1e-3
"""Start of a growing motion, off its equilibrium and relative to the size of the region (or of the error there)."""
TOUCH = 1e-12
"""Distance from the equilibrium, in any unit and relative to it, at which continuous gains are still the same."""
JUMP = 1e-5
"""Relative difference there that counts as a jump."""
SWELLING = 12.0
"""How long a growing mode is followed at most, in its time constants; a slow one at least a third of that."""


@dataclass(frozen=True, eq=False)
class LocalLoop:
    """The loop linearised at its equilibrium."""

    rest: Array
    jacobian: PolicyJacobian
    system: Array
    eigenvalues: NDArray[np.complex128]
    frequency: float
    spring: Array
    """Positive definite stiffness by which energy about the equilibrium is counted."""
    normal: Array
    continuous: bool

    @classmethod
    def at(cls, loop: PolicyLoop, rest: Array, box: Array | None) -> LocalLoop:
        """Linearise at [rest, 0]; the region, where there is one, sets the steps of the differences.

        Raises
        ------
        InputError
            The gains there are not positive.
        """
        state = np.concatenate([rest, np.zeros_like(rest)])[None]
        answer = loop(state)
        stiffness = np.linalg.eigvalsh(answer.stiffness[0])
        low = stiffness[0], np.linalg.eigvalsh(answer.damping[0])[0]
        if loop.output == "gains" and (not answer.admissible[0] or low[0] <= ROUNDING * abs(stiffness[-1])):
            where = np.array2string(rest, precision=4)
            raise InputError(
                f"the policy's gains are not positive at the equilibrium e = {where}: smallest eigenvalues K "
                f"{low[0]:.6g}, B {low[1]:.6g}. The impedance law refuses them; bound the policy's output, e.g. by a "
                "parametrisation of vic_toolbox.gains."
            )
        frequency = fastest(loop, state)
        scale = box
        if scale is None and (rest.any() or answer.force.any()):
            size = np.abs(rest).max() or float(
                np.abs(answer.force).max() / (frequency**2 * np.abs(loop.mass).max())
            )
            scale = np.concatenate([np.full(loop.size, size), np.full(loop.size, size * frequency)])
        found = policy_jacobian(loop, state, scale=scale)
        system = found.system(loop.mass)
        slope = found.effective_stiffness[0]
        spring = 0.5 * (slope + slope.T)
        if np.linalg.eigvalsh(spring)[0] <= 0:
            spring = found.stiffness[0] if loop.output == "gains" else frequency**2 * loop.mass
        touch = TOUCH * (1 + np.abs(rest).max())
        near = state + touch * np.concatenate([np.eye(2 * loop.size), -np.eye(2 * loop.size)])
        beside = loop(near)
        jumps = [
            np.abs(there - here).max() > JUMP * np.abs(here).max()
            for there, here in ((beside.stiffness, answer.stiffness), (beside.damping, answer.damping))
            if here.any()
        ]
        return cls(
            rest,
            found,
            system,
            np.linalg.eigvals(system).astype(np.complex128),
            frequency,
            spring,
            loop.normal(frequency),
            not any(jumps),
        )

    @property
    def rate(self) -> float:
        """Largest real part of the eigenvalues [1/s]."""
        return float(self.eigenvalues.real.max())

    @property
    def slowest(self) -> float:
        """Longest period of a mode [s], or three times its time constant where it hardly oscillates."""
        re, im = np.abs(self.eigenvalues.real), np.abs(self.eigenvalues.imag)
        tiny = 1e-9 * self.frequency
        return float(
            np.where(im > 0.1 * re, 2 * np.pi / np.maximum(im, tiny), 3 / np.maximum(re, tiny)).max()
        )

    @property
    def values(self) -> dict[str, Any]:
        """The numbers that a verdict names."""
        order = np.argsort(-self.eigenvalues.real)
        return {
            "equilibrium": one_or_many(self.rest),
            "growth_rate": self.rate,
            "eigenvalues": self.eigenvalues[order],
            "effective_stiffness": float(self.jacobian.softest[0]),
            "effective_damping": float(self.jacobian.least_damping[0]),
            "curl": float(self.jacobian.curl[0]),
        }

    def certificate(self, loop: PolicyLoop) -> Certificate | None:
        """P of the linearised loop, checked in discrete time and against the error of the gradients."""
        if self.rate >= -ROUNDING * self.frequency:
            return None
        lyapunov = lyapunov_matrix(self.system, normal=self.normal)
        back = np.linalg.inv(self.normal)
        a, p = self.normal @ self.system @ back, back.T @ lyapunov @ back
        if np.linalg.eigvalsh(p)[0] <= 0:
            return None
        error = np.zeros_like(a)
        error[loop.size :] = np.abs(np.linalg.inv(loop.mass)) @ self.jacobian.uncertainty[0]
        open_ = np.linalg.norm(np.abs(self.normal) @ error @ np.abs(back), 2)
        continuous = -np.linalg.eigvalsh(a.T @ p + p @ a)[-1] - 2 * np.linalg.norm(p, 2) * open_
        step = expm(a / np.linalg.norm(a, 2))
        discrete = np.linalg.eigvalsh(p - step.T @ p @ step)[0]
        return Certificate(
            "P ≻ 0 and AᵀP + PA ≺ 0 for the loop linearised at the equilibrium",
            {"P": lyapunov, "A": self.system},
            slack=float(min(continuous, discrete)),
        )

    def growing(self, loop: PolicyLoop, box: Array | None) -> CounterExample | None:
        """A motion along the fastest growing mode."""
        values, vectors = np.linalg.eig(self.system)
        mode = np.real(vectors[:, np.real(values).argmax()])
        size = box if box is not None else np.tile(np.abs(self.rest).max() or 1.0, 2 * loop.size)
        if box is None:
            size[loop.size :] *= self.frequency
        start = np.concatenate([self.rest, np.zeros(loop.size)])
        nudge = NUDGE * mode / (np.abs(mode) / size).max()
        return grown_example(
            loop,
            start + nudge,
            equilibrium=self.rest,
            stiffness=self.spring,
            duration=min(SWELLING / self.rate, max(SWELLING / 3 / self.rate, 300.0 / self.frequency)),
            description=f"from beside the equilibrium the motion grows at {self.rate:.6g} 1/s",
            anywhere=False,
        )


def one_or_many(values: Array) -> float | Array:
    """A number for one axis, an array for several."""
    return float(values[0]) if len(values) == 1 else values
