"""What a guided session must be like for policies that are cloned from it to follow the human on the digital twin.

    python -m benchmarks.guided_sessions --seeds 3

records sessions that differ in one thing, clones a policy from each fit (and from the measured wrench), runs it on the
robot of its session from the training start and from T2, and prints the deviations from the human's path in mm, mean
and at the end, over the seeds; the last line is the same as one JSON object. See docs/twin.md.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path

import numpy as np
import torch

from vic_toolbox import tasks
from vic_toolbox.experiments.configuration import RecordedDemonstrations
from vic_toolbox.experiments.deployed import deploy
from vic_toolbox.experiments.guided import WRENCH, record_session
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.learning import ExpertData, GaussianPolicy, clone, recipe

SESSIONS = {
    "default": SessionSettings(),
    "500 Hz": SessionSettings(rate=500.0),
    "window of 30 samples": SessionSettings(window=30, fits=("windows",)),
    "10 demonstrations": SessionSettings(count=10),
    "no push": SessionSettings(push=0.0),
}
STARTS = ("train", "T2")
EPISODES = 10
FIRST_SEED = 30


def deviations(file: Path, *, seed: int) -> list[float]:
    """Mean and final deviation [mm] from each start of a policy that is cloned from a file of demonstrations."""
    found = tasks.Demonstrations.load(file)
    task = tasks.CupOnPlate(action=found.action)
    settings = recipe(task.name, action=found.action, history=1)
    search = settings.airl.search
    policy = GaussianPolicy.for_task(task, hidden=search.hidden, log_std=search.log_std, seed=1)
    held_out = RecordedDemonstrations.of(file).held_out
    expert = ExpertData.from_demonstrations(found, task, policy=policy, held_out=held_out)
    clone(policy, expert, configuration=settings.cloning, rng=np.random.default_rng(0))
    numbers = []
    for start in STARTS:
        values = deploy(
            lambda: policy.mean, task, robot=seed, start=start, episodes=EPISODES, seed=seed
        ).values()
        numbers += [values["mean_deviation"], values["final_deviation"]]
    return numbers


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=3, help="number of robots, each with its session")
    chosen = parser.parse_args()
    torch.set_num_threads(1)
    result: dict[str, list[float]] = {}
    for name, settings in SESSIONS.items():
        rows: dict[str, list[list[float]]] = {}
        for seed in range(FIRST_SEED, FIRST_SEED + chosen.seeds):
            with tempfile.TemporaryDirectory() as folder:
                record_session(settings, Path(folder), seed=seed)
                for fit in (*settings.fits, WRENCH):
                    rows.setdefault(fit, []).append(deviations(Path(folder) / f"{fit}.npz", seed=seed))
        for fit, found in rows.items():
            mean = [round(x, 1) for x in np.mean(found, axis=0).tolist()]
            result[f"{name}, {fit}"] = mean
            print(f"{name:24s} {fit:8s} train {mean[0]} / {mean[1]}  T2 {mean[2]} / {mean[3]}", flush=True)
    print(json.dumps(result))


if __name__ == "__main__":
    main()
