"""How good and how fast the estimators are: ``python -m benchmarks.estimation``.

Synthetic recordings with known gains (10 s at 1 kHz, 0.3-3 Hz, about 15 mm rms, 0.2 N and 0.01 Nm of noise): window
least squares against the bound of Cramér and Rao, the smooth fit's error against its own bands, full SPD matrices, a
known answer for every trap, and speed on one thread. Ratios are taken in one run.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from benchmarks.estimation_cases import CASES
from tests import gain_data
from tests.gain_data import NOISE, clock, diagonal, diagonals, recorded, rich_motion
from vic_toolbox import recordings
from vic_toolbox.estimation import GainEstimate, fit_smooth
from vic_toolbox.estimation.cones import clarabel_installed, solve_cones
from vic_toolbox.estimation.programs import diagonal_programs
from vic_toolbox.estimation.samples import samples
from vic_toolbox.estimation.windows_diagonal import diagonal_windows, window_sum
from vic_toolbox.estimation.windows_full import FullUnits, full_windows

SEEDS = 6
TEN_MINUTES = 600.0
LONG = "--long"
"""Argument of the child process that reads and fits ten minutes, so that its memory is its own."""


def main() -> None:
    """Measure and print the result."""
    if LONG in sys.argv:
        print(json.dumps(long_fit(Path(sys.argv[-1]))))
        return
    result: dict[str, Any] = {}
    with threadpool_limits(1):
        for measure in (bound, smooth, full_spd, *CASES, speed):
            found = measure()
            print(f"{measure.__name__:14s} {found}", flush=True)
            result |= found
    found = ten_minutes()
    print(f"{'ten minutes':14s} {found}", flush=True)
    print(json.dumps(result | found))


def bound() -> dict[str, float]:
    """Error of window least squares over the bound, ten samples; and the bound over the gain, at 90 %."""
    t = clock(10.0)
    e, v = rich_motion(t, np.random.default_rng(0))
    k, b = gain_data.STIFFNESS, 1.4 * np.sqrt(gain_data.STIFFNESS * gain_data.MASS)
    errors = []
    rng = np.random.default_rng(1)
    for _ in range(40):
        fit = diagonal_windows(samples(recorded(t, e, v, k * e + b * v, noise=1.0, rng=rng)), 10, step=10)
        errors.append([fit.stiffness - k, fit.damping - b])
    a, s, c = (window_sum(x, 10, 10, 1000) for x in (e * e, e * v, v * v))
    bounds = NOISE * np.sqrt(np.stack([c, a]) / (a * c - s * s))
    ratio = np.sqrt(np.mean(np.square(errors), axis=0)) / bounds
    percent = 100 * bounds / np.stack([k, b])[:, None]
    worst = np.quantile(percent, 0.9, axis=(1, 2))
    return {
        "window_over_bound": round(float(np.sqrt(np.mean(ratio**2))), 3),
        "bound_of_ten_samples_k_percent_p90": round(float(worst[0]), 1),
        "bound_of_ten_samples_b_percent_p90": round(float(worst[1]), 1),
    }


def smooth() -> dict[str, float]:
    """Median relative error, error over posterior deviation, coverage of 95 % bands."""
    result = {}
    for profile, knots in (("smooth", 0.1), ("steps", 0.05)):
        errors, squares, variances, inside = [], [], [], []
        for seed in range(SEEDS):
            data = diagonal(100 + seed, profile=profile)
            wrong, sd, size = compared(fit_smooth(data.recording, knots), data)
            seen = np.isfinite(wrong)
            errors.append(np.sqrt(np.nanmean(wrong**2, axis=1) / np.mean(size**2, axis=1)))
            squares.append(np.nanmean(wrong**2, axis=1) / np.mean(size**2, axis=1))
            variances.append(np.nanmean(sd**2, axis=1) / np.mean(size**2, axis=1))
            inside.append(np.mean(np.abs(wrong[seen]) < 1.96 * sd[seen]))
        result |= {
            f"{profile}_k_percent": round(100 * float(np.median(np.array(errors)[:, 0])), 3),
            f"{profile}_b_percent": round(100 * float(np.median(np.array(errors)[:, 1])), 3),
            f"{profile}_error_over_deviation": round(
                float(np.sqrt(np.mean(squares) / np.mean(variances))), 3
            ),
            f"{profile}_coverage_percent": round(100 * float(np.mean(inside)), 1),
        }
    return result


def compared(found: GainEstimate, data: gain_data.Known) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Error, deviation and truth of the diagonals, each (2, m, 6)."""
    rows = np.clip(np.rint(found.time * 1000).astype(int), 0, len(data.stiffness) - 1)
    true = np.stack([data.stiffness[rows], data.damping[rows]])
    gains = np.stack([diagonals(found.stiffness), diagonals(found.damping)])
    return gains - true, np.stack([diagonals(found.stiffness_sd), diagonals(found.damping_sd)]), true


def full_spd() -> dict[str, float]:
    """Relative error of full K(t) and B(t), and the smallest eigenvalue that any of them has."""
    errors, smallest, seconds = [], [], []
    for seed in range(3):
        data = gain_data.full(seed)
        start = time.perf_counter()
        found = fit_smooth(data.recording, 0.5, structure="full")
        seconds.append(time.perf_counter() - start)
        rows = np.clip(np.rint(found.time * 1000).astype(int), 0, len(data.stiffness) - 1)
        seen = found.observable.all(axis=1)
        for gain, true in ((found.stiffness, data.stiffness), (found.damping, data.damping)):
            errors.append(gain_data.relative_rms(gain[seen], true[rows][seen]))
            smallest.append(np.linalg.eigvalsh(gain[seen]).min())
    return {
        "full_spd_percent_worst": round(100 * max(errors), 2),
        "full_spd_smallest_eigenvalue": round(float(min(smallest)), 4),
        "full_spd_seconds": round(float(np.median(seconds)), 2),
    }


def speed() -> dict[str, float]:
    """Windows and samples a second on one thread, processor time."""
    data = samples(diagonal(0).recording)
    count = len(data) - 9
    closed = count / fastest(lambda: diagonal_windows(data, 10, positive=True))
    program = count / fastest(lambda: diagonal_programs(data, 10, positive=True), repeats=3)
    seconds = fastest(lambda: fit_smooth(diagonal_recording))
    result = {
        "closed_form_windows_per_second": round(closed),
        "casadi_qp_windows_per_second": round(program),
        "closed_form_over_casadi": round(closed / program, 1),
        "smooth_samples_per_second_per_axis": round(6 * len(data) / seconds),
    }
    if clarabel_installed():
        known = samples(gain_data.full(0).recording)
        windows = full_windows(known, 1000, step=200, noise=NOISE, units=FullUnits.of([known]))
        cone = fastest(
            lambda: [
                solve_cones(a, b, solver="clarabel")
                for a, b in zip(windows.information, windows.right, strict=True)
            ],
            repeats=3,
        )
        result["clarabel_windows_per_second"] = round(len(windows.right) / cone)
    return result


diagonal_recording = diagonal(0).recording


def fastest(work: Callable[[], Any], *, repeats: int = 7) -> float:
    """Least processor time of a few runs [s]; the first one, which imports and compiles, is not counted."""
    work()
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return min(times)


def ten_minutes() -> dict[str, float]:
    """Read and fit a 10-minute log at 1 kHz in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.npz"
        diagonal(0, duration=TEN_MINUTES).recording.save(path)
        command = [sys.executable, "-m", "benchmarks.estimation", LONG, str(path)]
        child = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(child.stdout)


def long_fit(path: Path) -> dict[str, float]:
    import resource  # not on Windows, where the rest runs

    with threadpool_limits(1):
        start = time.perf_counter()
        found = fit_smooth(recordings.read(path))
        seconds = time.perf_counter() - start
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e9 if sys.platform == "darwin" else 1e6)
    return {
        "ten_minutes_seconds": round(seconds, 1),
        "ten_minutes_gigabytes": round(memory, 2),
        "ten_minutes_observable_percent": round(100 * float(found.observable.mean()), 1),
    }


if __name__ == "__main__":
    main()
