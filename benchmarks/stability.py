"""How fast stability is judged: ``python -m benchmarks.stability``; the last line is one JSON object.

On one thread, each ratio from one run: the certificate of Kronander and Billard over 10⁵ samples of full 6×6 gains
against a Python loop that takes the eigenvalues of its two inequalities with SciPy (and against one call for each
sample); diagonal gains, 10⁶ samples, against the same number of full ones; a Z-width map of 200×200 against a loop over
its points; a policy with a network on a rollout of 200 steps.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg
from threadpoolctl import threadpool_limits

from vic_toolbox.stability.sampling.sampled import sampled_stability
from vic_toolbox.stability.sampling.z_width import z_width
from vic_toolbox.stability.schedules.kronander_billard import kronander_billard

FULL, DIAGONAL = 100_000, 1_000_000
LOOP = 10_000
"""Samples that the Python loop takes; its time is in proportion."""
MAP, MAP_LOOP = 200, 400
"""Points on a side of the map, and points that the loop takes."""


def main() -> None:
    """Measure and print the result."""
    result: dict[str, Any] = {}
    with threadpool_limits(1):
        for measure in (full_gains, diagonal_gains, z_width_map, learned_policy):
            found = measure()
            print(f"{measure.__name__:16s} {found}", flush=True)
            result |= found
    print(json.dumps(result))


def seconds(work: Callable[[], Any], *, repeats: int = 3) -> float:
    """Least processor time of a few runs [s]."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def schedule(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Smooth full gains of six axes that turn, 1 kHz: time, M, K and D."""
    rng = np.random.default_rng(0)
    t = np.arange(n) / 1000
    basis = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    size = 500 + 200 * np.sin(np.outer(t, rng.uniform(0.3, 1, 6)))
    c, s = np.cos(0.3 * np.sin(t)), np.sin(0.3 * np.sin(t))
    turn = np.zeros((n, 6, 6))
    turn[:, range(6), range(6)] = 1
    turn[:, 0, 0], turn[:, 1, 1], turn[:, 0, 1], turn[:, 1, 0] = c, c, -s, s
    turn = turn @ basis
    k = (turn * size[:, None, :]) @ np.swapaxes(turn, 1, 2)
    d = 70 * (1 + 0.1 * np.sin(t))[:, None, None] * np.eye(6)
    return t, 5 * np.eye(6) + 0.5, 0.5 * (k + np.swapaxes(k, 1, 2)), d


def full_gains() -> dict[str, float]:
    t, m, k, d = schedule(FULL)
    kronander_billard(m, k[:500], d[:500], time=t[:500])
    verdict = kronander_billard(m, k, d, time=t)
    alpha = 0.5 * (verdict.values["alpha"] + verdict.values["alpha_max"])
    rates, d_rates = np.gradient(k[:LOOP], t[:LOOP], axis=0), np.gradient(d[:LOOP], t[:LOOP], axis=0)

    def two_inequalities() -> None:
        for i in range(LOOP):
            scipy.linalg.eigvalsh(alpha * m - d[i])
            scipy.linalg.eigvalsh(rates[i] + alpha * d_rates[i] - 2 * alpha * k[i])

    def one_call() -> None:
        for x in k[:LOOP]:
            scipy.linalg.eigvalsh(x)

    own = seconds(lambda: kronander_billard(m, k, d, time=t))
    refused = seconds(lambda: kronander_billard(m, k, d / 100, time=t), repeats=2)
    return {
        "full_100000_seconds": round(own, 3),
        "full_100000_not_certified_seconds": round(refused, 3),
        "loop_over_full": round(seconds(two_inequalities) * FULL / LOOP / own, 2),
        "one_call_loop_over_full": round(seconds(one_call) * FULL / LOOP / own, 2),
        "proved": float(verdict.status == "proved"),
    }


def diagonal_gains() -> dict[str, float]:
    t, m, k, d = schedule(DIAGONAL)
    own = seconds(lambda: kronander_billard(m, k, d, time=t), repeats=2)
    for x in (k, d):
        diagonal = np.diagonal(x, axis1=1, axis2=2).copy()
        x[:] = 0
        x[:, range(6), range(6)] = diagonal
    mass = np.diag(np.diagonal(m))
    diagonal = seconds(lambda: kronander_billard(mass, k, d, time=t))
    return {
        "full_1000000_seconds": round(own, 3),
        "diagonal_1000000_seconds": round(diagonal, 3),
        "diagonal_over_full": round(diagonal / own, 3),
    }


def z_width_map() -> dict[str, float]:
    grid: dict[str, Any] = {"stiffness": np.linspace(1, 5000, MAP), "damping": np.linspace(0, 50, MAP)}
    rng = np.random.default_rng(0)
    points = np.stack(
        [rng.choice(grid["stiffness"], MAP_LOOP), rng.choice(grid["damping"], MAP_LOOP)], axis=1
    )

    def loop() -> None:
        for k, b in points:
            sampled_stability(1.0, k, b, period=1e-3, physical_damping=0.5, velocity="backward")

    def radii() -> None:
        for k, b in points:
            bare_radius(float(k), float(b))

    def mapped() -> None:
        found = z_width(1.0, period=1e-3, physical_damping=0.5, **grid)
        assert found.stable.size == found.spectral_radius.size == MAP**2

    found = z_width(1.0, period=1e-3, physical_damping=0.5, **grid)
    for k, b in points[:10]:  # both find the same
        own = found.spectral_radius[found.damping == b, found.stiffness == k]
        assert abs(own[0] - bare_radius(float(k), float(b))) < 1e-6

    own = seconds(mapped)
    share = MAP**2 / MAP_LOOP / own
    return {
        "z_width_40000_seconds": round(own, 3),
        "loop_of_verdicts_over_map": round(seconds(loop, repeats=1) * share, 1),
        "loop_of_eigenvalues_over_map": round(seconds(radii) * share, 1),
    }


def bare_radius(k: float, b: float, mass: float = 1.0, friction: float = 0.5, period: float = 1e-3) -> float:
    """Spectral radius of one wall, as anybody would write it: an exponential and its eigenvalues."""
    motion = np.zeros((3, 3))
    motion[0, 1], motion[1, 1], motion[1, 2] = 1, -friction / mass, 1 / mass
    exact = scipy.linalg.expm(motion * period)
    loop = np.zeros((3, 3))
    loop[:2, :2] = exact[:2, :2]
    loop[:2, 0] -= exact[:2, 2] * (k + b / period)
    loop[:2, 2] += exact[:2, 2] * b / period
    loop[2, 0] = 1
    return float(np.abs(np.linalg.eigvals(loop)).max())


def learned_policy() -> dict[str, float]:
    """A small network K(e, ė), B(e, ė) of six axes, on a rollout of 200 steps."""
    from vic_toolbox.stability.policies.policy import policy_stability

    rng = np.random.default_rng(0)
    first, second = rng.normal(size=(12, 64)) / 4, rng.normal(size=(64, 12)) / 8

    def policy(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        size = np.exp(0.3 * np.tanh(np.tanh(np.asarray(state) @ first) @ second))
        return 500 * size[:, :6], 60 * size[:, 6:]

    t = np.linspace(0, 2, 200)[:, None]
    decay = np.exp(-2 * t)
    start = rng.uniform(-0.03, 0.03, 6)
    rollout = np.concatenate([start * decay, -2 * start * decay], axis=1)
    began = time.perf_counter()
    verdict = policy_stability(policy, 5 * np.eye(6), rollout=rollout)
    took = time.perf_counter() - began
    return {"policy_rollout_200_seconds": round(took, 3), "policy_proved": float(verdict.status == "proved")}


if __name__ == "__main__":
    main()
