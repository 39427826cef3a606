"""The windows as CasADi programs: what the closed forms are tested against, and a base for other constraints."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from vic_toolbox.errors import Array
from vic_toolbox.estimation.cones import FitError
from vic_toolbox.estimation.samples import Samples
from vic_toolbox.estimation.windows_diagonal import window_count
from vic_toolbox.estimation.windows_factor import window_sums

MAPPED = 6 * 256
"""Problems in one call of the mapped solver."""


def diagonal_programs(
    data: Samples, window: int, *, step: int = 1, positive: bool = True
) -> tuple[Array, Array]:
    """K and B (m, 6) of every window by CasADi's active-set QP solver `qrqp`, mapped over windows and axes.

    The two unknowns are scaled to unit information. `qrqp` is run in one thread: CasADi's thread maps are not
    safe with every solver.
    """
    count = window_count(len(data), window, step)
    a, s, c, p, q, _ = window_sums(data, window, step).reshape(6, -1)
    e_size, v_size = (np.sqrt(np.where(x > 0, x, 1.0)) for x in (a, c))
    h = np.empty((2, 2, len(a)))
    h[0, 0], h[1, 1] = (a > 0).astype(float), (c > 0).astype(float)
    h[0, 1] = h[1, 0] = s / (e_size * v_size)
    g = -np.stack([p / e_size, q / v_size])
    largest = np.abs(g).max(axis=0)
    largest = np.where(largest > 0, largest, 1.0)
    x = np.empty((2, len(a)))
    solve = _mapped_qp(MAPPED)
    for first in range(0, len(a), MAPPED):
        part = np.arange(first, first + MAPPED) % len(a)  # the last call is filled up from the start
        result = solve(
            h=h[:, :, part].transpose(0, 2, 1).reshape(2, -1),
            g=(g / largest)[:, part],
            lbx=0.0 if positive else -np.inf,
            ubx=np.inf,
        )
        size = min(MAPPED, len(a) - first)
        x[:, first : first + size] = np.asarray(result["x"])[:, :size]
    k, b = x * largest / np.stack([e_size, v_size])
    return k.reshape(count, 6), b.reshape(count, 6)


def _mapped_qp(count: int) -> Any:
    options = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
    pattern = {"h": casadi.Sparsity.dense(2, 2), "a": casadi.Sparsity(0, 2)}
    return casadi.conic("window", "qrqp", pattern, options).map(count, "serial")


def factor_programs(
    data: Samples, window: int, noise: Array, *, step: int = 1, start: tuple[Array, Array]
) -> tuple[Array, Array]:
    """K and B (m, 6) of every window with tied damping, by IPOPT from `start` (√k (m, 6), d (m, 2)).

    Raises
    ------
    FitError
        IPOPT gave up on a window.
    """
    sums = window_sums(data, window, step)
    parameter = casadi.SX.sym("sums", 6, 3)
    x = casadi.SX.sym("x", 4)
    s, d = x[:3], x[3]
    k, g = s * s, d * s
    a, b, c, p, q, f = (parameter[row, :].T for row in range(6))
    value = casadi.sum1(f - 2 * k * p - 2 * g * q + k * k * a + 2 * k * g * b + g * g * c)
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-11}
    solver = casadi.nlpsol("factor", "ipopt", {"x": x, "p": parameter, "f": value}, options)
    root, factor = np.empty((sums.shape[1], 6)), np.empty((sums.shape[1], 2))
    for m in range(sums.shape[1]):
        for group, axes in enumerate((slice(0, 3), slice(3, 6))):
            part = sums[:, m, axes] / noise[axes] ** 2
            size = float(part[5].sum()) or 1.0
            result = solver(
                x0=np.r_[np.maximum(start[0][m, axes], 1e-3), max(start[1][m, group], 1e-3)],
                p=part / size,
                lbx=0.0,
            )
            if not solver.stats()["success"]:
                raise FitError(f"IPOPT stopped with {solver.stats()['return_status']} in window {m}.")
            root[m, axes], factor[m, group] = np.asarray(result["x"])[:3, 0], float(result["x"][3])
    return root**2, root * np.repeat(factor, 3, axis=1)
