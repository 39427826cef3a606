"""Known answers of estimation: one function for each trap, the numbers that come out of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.gain_data import biased, clock, diagonal, diagonals, recorded, rich_motion, struck
from vic_toolbox import recordings
from vic_toolbox.estimation import fit_smooth, fit_windows
from vic_toolbox.estimation.splines import Basis
from vic_toolbox.gains import ImpedanceGains
from vic_toolbox.spatial import rotation_exp

SEED = 0
REAL = Path(__file__).parents[2] / "shared" / "recordings" / "kuka_iiwa"
"""Recordings of a KUKA LBR iiwa, beside the repository where they are."""
MOUNTING = ((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
"""Of its sensor."""


def exact_recovery() -> dict[str, float]:
    """A1, A2: largest relative error without noise, constant gains in windows and splines in their space."""
    t = clock(10.0)
    rng = np.random.default_rng(SEED)
    e, v = rich_motion(t, rng)
    constant = diagonal(profile="constant", noise=0.0)
    windows = fit_windows(constant.recording)
    basis = Basis.spaced(t[0], t[-1], 0.1)
    k = basis.evaluate(600 + 150 * rng.uniform(-1, 1, (basis.size, 6)), t)
    b = basis.evaluate(40 + 10 * rng.uniform(-1, 1, (basis.size, 6)), t)
    spline = fit_smooth(recorded(t, e, v, k * e + b * v), at=t[::50])
    return {
        "a1_relative": float(np.abs(diagonals(windows.stiffness) / constant.stiffness[:9991] - 1).max()),
        "a2_relative": float(np.abs(diagonals(spline.stiffness) / k[::50] - 1).max()),
    }


def constraints() -> dict[str, float]:
    """A3: K of data that imply −200; A3b: residual [N] of the best PSD stiffness, and of a projected one."""
    t = clock(10.0)
    e, v = rich_motion(t, np.random.default_rng(SEED))
    negative = fit_windows(recorded(t, e, v, -200 * e + 30 * v), len(t), constraint="positive")
    true = np.array([[300.0, 400.0], [400.0, 300.0]])
    along = np.zeros((40, 6))
    along[::2, 0], along[1::2, 1] = 0.02, 0.002
    force = np.zeros((40, 6))
    force[:, :2] = along[:, :2] @ true
    data = recorded(clock(0.04), along, np.zeros((40, 6)), force)
    best = fit_windows(data, 40, structure="full", constraint="spd")
    values, vectors = np.linalg.eigh(true)
    projected = (vectors * np.maximum(values, 0)) @ vectors.T
    return {
        "a3_stiffness": float(diagonals(negative.stiffness).max()),
        "a3b_residual": round(float(np.linalg.norm(best.residuals[:2])), 3),
        "a3b_projected": round(float(np.linalg.norm(along[:2, :2] @ (projected - true))), 3),
    }


def amplitudes() -> dict[str, float]:
    """A4: deviation of K [N/m] for 1 s of 1 Hz at 10, 1 and 0.1 mm, and axes observable without motion."""
    t = clock(1.0)
    turn = 2 * np.pi * t[:, None] * np.ones(6)
    noise = 0.2 * np.random.default_rng(1).normal(size=turn.shape)
    found = {}
    for size, name in ((1e-2, "10"), (1e-3, "1"), (1e-4, "0.1")):
        e, v = size * np.sin(turn), size * 2 * np.pi * np.cos(turn)
        # a spring that is stiff enough to be seen at every amplitude
        fit = fit_windows(recorded(t, e, v, 6e3 * e + 30 * v + noise), 1000, noise=np.full(6, 0.2))
        found[f"a4_deviation_{name}_mm"] = round(float(np.nanmedian(diagonals(fit.stiffness_sd))), 2)
    still = fit_smooth(recorded(t, 0 * turn, 0 * turn, noise), None)
    return found | {"a4_observable_at_rest": float(still.observable.sum())}


def bias() -> dict[str, float]:
    """A5: K of 600 N/m under 3 N of bias, without an intercept and with one."""
    data = biased()
    without, with_bias = (diagonals(fit_smooth(data, None, bias=fit).stiffness) for fit in (False, True))
    return {"a5_blind": round(float(without.mean()), 1), "a5_with_bias": round(float(with_bias.mean()), 1)}


def tip_stiffness() -> dict[str, float]:
    """A6: diag(800, 800, 400) at a tip 0.15 m off, fitted at the COM; diag(800, 400) turned by 30°."""
    t = clock(10.0)
    e, v = rich_motion(t, np.random.default_rng(SEED))
    damping = np.diag([60.0, 60, 40, 1, 1, 1])
    hand = ImpedanceGains(np.diag([800.0, 800, 400, 1e-6, 1e-6, 1e-6]), damping).transported((0, 0, 0.15))
    turned = ImpedanceGains.diagonal([800.0, 400, 400, 5, 5, 5], [60.0, 60, 60, 1, 1, 1])
    turned = turned.rotated(rotation_exp([0, 0, np.radians(30)]))
    at_hand, at_yaw = (
        fit_smooth(recorded(t, e, v, e @ g.stiffness + v @ g.damping), None, structure="full").stiffness[0]
        for g in (hand, turned)
    )
    return {
        "a6_rotational": round(float(at_hand[4, 4]), 3),
        "a6_coupling": round(abs(float(at_hand[0, 4])), 2),
        "a6_yaw_x": round(float(at_yaw[0, 0]), 1),
        "a6_yaw_y": round(float(at_yaw[1, 1]), 1),
        "a6_yaw_xy": round(abs(float(at_yaw[0, 1])), 1),
    }


def latency() -> dict[str, float]:
    """A7: B of 59.4 Ns/m under a wrench that is 5 ms late, blind and with the latency found."""
    t = clock(10.0)
    rng = np.random.default_rng(SEED)
    e, v = rich_motion(t, rng)
    late = np.concatenate([np.zeros((5, 6)), (600 * e + 59.4 * v)[:-5]]) + 0.2 * rng.normal(size=e.shape)
    data = recorded(t, e, v, late)
    found = fit_smooth(data, None, latency=True)
    return {
        "a7_damping_blind": round(float(np.mean(diagonals(fit_smooth(data, None).damping))), 2),
        "a7_damping": round(float(np.mean(diagonals(found.damping))), 2),
        "a7_latency_ms": round(1e3 * float(found.parameters["latency"]), 3),
    }


def inertia() -> dict[str, float]:
    """A9: K of 600 N/m with 3 kg left in the wrench, at 0.5, 1 and 2 Hz, and with them taken out at 2 Hz."""
    t = clock(10.0)
    found = {}
    for frequency in (0.5, 1.0, 2.0):
        w = 2 * np.pi * frequency
        e, v = 0.01 * np.sin(w * t)[:, None] * np.ones(6), 0.01 * w * np.cos(w * t)[:, None] * np.ones(6)
        data = recorded(t, e, v, 600 * e + 30 * v - 3 * w**2 * e)
        found[f"a9_at_{frequency:g}_hz"] = round(float(diagonals(fit_smooth(data, None).stiffness).mean()), 1)
        light = recordings.compensate_inertia(data, [3.0] * 6)
        middle = light.between(1.0, 9.0)  # the ends have no acceleration
    found["a9_compensated"] = round(float(diagonals(fit_smooth(middle, None).stiffness).mean()), 1)
    return found


def outliers() -> dict[str, float]:
    """A10: K of 600 N/m with 2 % outliers of 20 ± 30 N, by least squares and by Huber's estimate."""
    data = struck()
    squares, huber = (diagonals(fit_smooth(data, None, robust=robust).stiffness) for robust in (False, True))
    return {"a10_squares": round(float(squares.mean()), 1), "a10_huber": round(float(huber.mean()), 1)}


def real_data() -> dict[str, object]:
    """Constant K [N/m] of the real arm in contact, whether free motion has any, whether the wrong frame is noticed."""
    if not REAL.is_dir():
        return {"real": None}
    found: dict[str, object] = {}
    for name in ("circle", "linear_table"):
        log = recordings.read(REAL / f"{name}.txt", sensor_rotation=MOUNTING)
        touching = log.rows(np.linalg.norm(log.wrench[:, :3], axis=1) > 2)
        fit = fit_smooth(touching, None, bias=True)
        found[f"real_{name}"] = np.round(diagonals(fit.stiffness)[0, :3], 1).tolist()
        found[f"real_{name}_trap_noticed"] = recordings.check_frame(
            recordings.read(REAL / f"{name}.txt")
        ).suspicious
    free = fit_smooth(recordings.read(REAL / "free.txt", sensor_rotation=MOUNTING), None)
    return found | {"real_free_observable_axes": int(free.observable.sum())}


CASES = (
    exact_recovery, constraints, amplitudes, bias, tip_stiffness, latency, inertia, outliers, real_data,
)  # fmt: skip
