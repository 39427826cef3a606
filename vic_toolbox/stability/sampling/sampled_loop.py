"""One step of a mass under held gains: the exact zero-order-hold map, dimensionless."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from vic_toolbox.stability.environments.linear_loop import integrated


class SampledLoop(NamedTuple):
    """Masses (n, d, d) under ``u_k = −K x_{k−s} − B v_{k−s}``, held over the period.

    Everything is dimensionless, so units cannot change a verdict: time in periods T, positions ``x' = Lᵀ x`` with
    ``M = L Lᵀ``; then ``K' = T² L⁻¹ K L⁻ᵀ`` and ``B' = T L⁻¹ B L⁻ᵀ``.
    """

    stiffness: np.ndarray
    damping: np.ndarray
    physical_damping: np.ndarray
    backward: bool
    delay_steps: int

    @property
    def degrees(self) -> int:
        """Number d of degrees of freedom."""
        return self.stiffness.shape[-1]

    def step(self, *, integrate: bool = False) -> np.ndarray:
        """Map Φ (n, N, N) of ``[x; T v; (x_{k−1}); u of the last steps, oldest first]`` over one period.

        The plant is ``exp`` of its augmented matrix, or is integrated by Runge-Kutta (the other route).
        """
        d, n = self.degrees, len(self.stiffness)
        plant = np.zeros((n, 3 * d, 3 * d))  # of [x; v; held force]
        plant[:, :d, d : 2 * d] = plant[:, d : 2 * d, 2 * d :] = np.eye(d)
        plant[:, d : 2 * d, d : 2 * d] = -self.physical_damping
        plants, which = np.unique(plant, axis=0, return_inverse=True)  # mostly one for all gains
        held = np.stack([integrated(one, 1.0) for one in plants]) if integrate else expm(plants)
        held = held[which.reshape(n)]

        previous = 2 * d  # where x_{k−1} stands
        queue = previous + d * self.backward  # where the forces on their way stand
        size = queue + d * self.delay_steps
        law = np.zeros((n, d, size))
        law[:, :, :d] = -self.stiffness
        if self.backward:
            law[:, :, :d] -= self.damping
            law[:, :, previous:queue] = self.damping
        else:
            law[:, :, d : 2 * d] = -self.damping

        step = np.zeros((n, size, size))
        step[:, : 2 * d, : 2 * d] = held[:, : 2 * d, : 2 * d]
        if self.backward:
            step[:, previous:queue, :d] = np.eye(d)
        push = held[:, : 2 * d, 2 * d :]
        if self.delay_steps:
            step[:, : 2 * d, queue : queue + d] = push
            step[:, queue : size - d, queue + d :] = np.eye(size - d - queue)
            step[:, size - d :] = law
        else:
            step[:, : 2 * d] += push @ law
        return step


def dimensionless(mass: np.ndarray, *gains: tuple[np.ndarray, float]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Cholesky factor L (n, d, d) of the mass, and ``factor · L⁻¹ G L⁻ᵀ`` of each (gain G, factor)."""
    factor = np.linalg.cholesky(mass)
    scaled = []
    for gain, scale in gains:
        half = np.linalg.solve(factor, gain)
        whole = scale * np.linalg.solve(factor, np.swapaxes(half, -1, -2))
        scaled.append(0.5 * (whole + np.swapaxes(whole, -1, -2)))
    return factor, scaled
