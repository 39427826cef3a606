"""Training and transfer: the same numbers whatever interrupts them, and a folder that holds it all."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.torch import load_file

from tests.experiment_runs import copy, figures, finished, tiny, transferred
from vic_toolbox import tasks
from vic_toolbox.errors import FileError, InputError, ReachError
from vic_toolbox.experiments.configuration import (
    DemonstrationConfiguration,
    RunConfiguration,
    default_configuration,
    from_json,
    to_json,
)
from vic_toolbox.experiments.loop import DivergenceError, deferred_interrupt, run_to_end
from vic_toolbox.experiments.progress import Progress
from vic_toolbox.experiments.run_folder import RunFolder
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.training import train
from vic_toolbox.experiments.transfer import transfer


@pytest.fixture(autouse=True)
def _without_figures():  # type: ignore[no-untyped-def]
    """Reports in a tenth of the time; the shared runs have their figures."""
    with figures(drawn=False):
        yield


WEIGHTS = ("policy.safetensors", "reward.safetensors", "checkpoint.safetensors")


def content(run: Path, *names: str) -> dict[str, Any]:
    """Bytes of the files; of weights the bytes of the tensors, whose header has no fixed order."""
    return {name: _tensors(run / name) if name in WEIGHTS else (run / name).read_bytes() for name in names}


def _tensors(path: Path) -> dict[str, bytes]:
    return {name: tensor.numpy().tobytes() for name, tensor in load_file(path).items()}


def metrics(run: Path) -> list[dict]:
    rows = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return [{name: value for name, value in row.items() if name != "seconds"} for row in rows]


# --- what a run leaves ---------------------------------------------------------------------------------------


def test_a_run_holds_everything_it_should():
    run = finished("airl")
    names = {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()}
    assert names >= {
        "config.json", "metrics.jsonl", "policy.safetensors", "reward.safetensors", "demonstrations.npz",
        "evaluation.json", "evaluations/train/evaluation.json", "report.html", "figures/learning.svg",
        "figures/gains.svg", "figures/paths.svg", "figures/forces.svg", "figures/reward.svg",
    }  # fmt: skip
    row = json.loads((run / "evaluation.json").read_text())
    assert row.keys() >= {
        "task", "scenario", "method", "action", "history", "seed", "episodes", "success_rate", "score_mean",
        "score_std", "expert_score", "relative_difference",
    }  # fmt: skip
    assert (row["task"], row["scenario"], row["method"]) == ("cup-on-plate", "train", "airl")
    difference = abs(row["score_mean"] - row["expert_score"]) / abs(row["expert_score"])
    assert row["relative_difference"] == pytest.approx(difference)


def test_a_run_of_another_task_holds_the_same_and_its_own_figures():
    run = finished("airl", "peg-in-hole")
    names = {path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file()}
    assert names >= {
        "policy.safetensors", "reward.safetensors", "demonstrations.npz", "evaluations/train/evaluation.json",
        "figures/learning.svg", "figures/gains.svg", "figures/insertion.svg", "figures/reward.svg",
    }  # fmt: skip
    assert "figures/paths.svg" not in names
    page = (run / "report.html").read_text()
    for wanted in ("AIRL on Peg-in-Hole", "the peg is in at the end of", "constant, mid-range", "constant, matched",
                   "--sweep tilt", "--scenario tilt=", "mirror image"):  # fmt: skip
        assert wanted in page
    assert "cup" not in page
    assert tasks.Demonstrations.load(run / "demonstrations.npz").push == tasks.PegInHole.push


def test_the_configuration_is_complete_and_comes_back():
    stored = RunFolder.open(finished("airl")).configuration
    assert from_json(RunConfiguration, stored, where="here") == tiny()


def test_a_report_needs_no_other_file():
    page = (finished("airl") / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 5
    assert "http" not in page.replace("http-equiv", "")
    for wanted in (
        "Gains over time",
        "expert",
        "Where to go from here",
        "vic transfer",
        "recipe.airl.slope_bound",
    ):
        assert wanted in page


def test_a_constant_gain_run_acts_with_the_middle_of_the_range():
    skill = load_skill(finished("constant"))
    observations = np.random.default_rng(0).normal(size=(5, 12))
    assert np.abs(skill.judged.act(observations)).max() == 0.0
    assert skill.reward is None


def test_a_cloned_policy_records_its_error():
    rows = metrics(finished("bc"))
    assert [row["iteration"] for row in rows] == [10, 20]
    assert all(0.0 < row["action_error"] < 2.0 for row in rows)


# --- the same numbers ----------------------------------------------------------------------------------------


def test_the_same_seed_gives_the_same_numbers_on_any_number_of_threads(tmp_path: Path):
    train(tiny(), tmp_path / "again", threads=3)
    assert content(tmp_path / "again", *WEIGHTS) == content(finished("airl"), *WEIGHTS)
    assert metrics(tmp_path / "again") == metrics(finished("airl"))


def test_another_seed_gives_other_numbers(tmp_path: Path):
    train(tiny("bc", seed=1), tmp_path / "other", threads=1)
    assert content(tmp_path / "other", WEIGHTS[0]) != content(finished("bc"), WEIGHTS[0])


def test_cloning_does_not_depend_on_an_earlier_attempt(tmp_path: Path):
    run = copy(finished("bc"), tmp_path / "bc")
    (run / "report.html").unlink()  # as if the process had been killed before the end
    train(tiny("bc"), run, resume=True, threads=1)
    assert content(run, "policy.safetensors", "evaluation.json") == content(
        finished("bc"), "policy.safetensors", "evaluation.json"
    )
    assert metrics(run) == metrics(finished("bc"))


def test_a_complete_run_is_not_touched_again(tmp_path: Path):
    run = copy(finished("airl"), tmp_path / "run")
    before = {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.name != ".lock"}
    evaluation = train(tiny(), run, resume=True)
    assert {path: path.stat().st_mtime_ns for path in run.rglob("*") if path.name != ".lock"} == before
    assert evaluation.to_json() == json.loads((run / "evaluation.json").read_text())


KILLED = """
import sys
from tests.experiment_runs import tiny
from vic_toolbox.experiments.training import train
train(tiny(iterations=14), sys.argv[1], resume=True, threads=1)
"""


@pytest.mark.slow
def test_killed_at_random_moments_it_ends_with_the_same_weights(tmp_path: Path):
    """kill -9 at any moment, then resume: the bytes of an unbroken run."""

    def begin(run: Path) -> subprocess.Popen:
        return subprocess.Popen([sys.executable, "-c", KILLED, str(run)], cwd=Path(__file__).parents[1])

    began = time.monotonic()
    assert begin(tmp_path / "whole").wait() == 0
    whole = time.monotonic() - began
    rng = np.random.default_rng(0)
    for _ in range(6):
        process = begin(tmp_path / "broken")
        try:
            process.wait(rng.uniform(0.1, 0.9) * whole)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
    assert begin(tmp_path / "broken").wait() == 0
    names = (*WEIGHTS, "evaluation.json", "figures/gains.svg", "figures/reward.svg")
    assert content(tmp_path / "broken", *names) == content(tmp_path / "whole", *names)
    assert metrics(tmp_path / "broken") == metrics(tmp_path / "whole")


class Stopping(Progress):
    """Sends this process a signal after some updates, as a terminal would."""

    def __init__(self, after: int):
        self.left = after

    def update(self, done: int, **_: object) -> None:
        self.left -= 1
        if self.left == 0:
            os.kill(os.getpid(), signal.SIGINT)


def test_after_ctrl_c_a_run_goes_on_to_the_same_weights(tmp_path: Path):
    run = tiny(iterations=4)
    with pytest.raises(KeyboardInterrupt):
        train(run, tmp_path / "broken", threads=1, progress=Stopping(2))
    assert (tmp_path / "broken" / "checkpoint.safetensors").exists()
    assert not (tmp_path / "broken" / "policy.safetensors").exists()
    assert metrics(tmp_path / "broken")[-1]["iteration"] == 2  # the iteration under way was completed
    train(run, tmp_path / "broken", resume=True, threads=1)
    train(run, tmp_path / "whole", threads=1)
    assert content(tmp_path / "broken", *WEIGHTS) == content(tmp_path / "whole", *WEIGHTS)


def test_a_transfer_goes_on_to_the_same_weights(tmp_path: Path):
    with pytest.raises(KeyboardInterrupt):
        transfer(finished("airl"), "T1", tmp_path / "T1", episodes=2, threads=1, progress=Stopping(1))
    transfer(finished("airl"), "T1", tmp_path / "T1", episodes=2, threads=1, resume=True)
    assert content(tmp_path / "T1", *WEIGHTS) == content(transferred(), *WEIGHTS)


def test_the_second_signal_acts_at_once():
    with deferred_interrupt() as came:
        assert not came()
        os.kill(os.getpid(), signal.SIGINT)
        assert came()
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_time_limit_stops_early_and_still_ends_whole(tmp_path: Path):
    train(tiny(iterations=50), tmp_path / "run", threads=1, seconds=1e-3)
    assert len(metrics(tmp_path / "run")) == 1
    assert (tmp_path / "run" / "report.html").exists()


# --- transfer ------------------------------------------------------------------------------------------------


def test_transfer_keeps_the_reward_and_moves_the_policy():
    before, after = load_skill(finished("airl")), load_skill(transferred())
    assert before.reward is not None
    assert after.reward is not None
    assert (before.reward.theta == after.reward.theta).all()
    assert (before.policy.theta != after.policy.theta).any()
    assert after.origin == "learned reward, continued"
    assert after.task().scenario.name == "T1"
    assert "before transfer" in (transferred() / "report.html").read_text()


def test_a_transfer_to_a_scenario_of_ones_own_is_called_by_its_text(tmp_path: Path):
    source = finished("airl", "peg-in-hole")
    transfer(source, " scale=0.50,tilt=-4", tmp_path / "x", episodes=1, threads=1)
    row = json.loads((tmp_path / "x" / "evaluation.json").read_text())
    assert row["scenario"] == "tilt=-4,scale=0.5"
    assert (tmp_path / "x" / "evaluations" / "tilt=-4,scale=0.5" / "evaluation.json").exists()
    skill = load_skill(tmp_path / "x")
    assert skill.task().scenario == tasks.PegScenario(tilt=-4.0, scale=0.5)


def test_a_random_reward_is_another_network(tmp_path: Path):
    transfer(
        finished("bc"), "0.5,-0.1,0.3", tmp_path / "x", reward="random", fresh=True, episodes=1, threads=1
    )
    row = json.loads((tmp_path / "x" / "evaluation.json").read_text())
    assert (row["scenario"], row["transfer"]) == ("0.5,-0.1,0.3", "random reward, from random weights")
    assert "before transfer" not in (tmp_path / "x" / "report.html").read_text()


def test_a_run_without_reward_cannot_be_transferred(tmp_path: Path):
    with pytest.raises(InputError, match="has learned no reward"):
        transfer(finished("bc"), "T1", tmp_path / "x")
    assert not (tmp_path / "x").exists()


def test_a_changed_source_is_noticed(tmp_path: Path):
    source, out = copy(finished("airl"), tmp_path / "airl"), tmp_path / "T1"
    with pytest.raises(KeyboardInterrupt):
        transfer(source, "T1", out, threads=1, progress=Stopping(1))
    (source / "policy.safetensors").write_bytes((finished("constant") / "policy.safetensors").read_bytes())
    with pytest.raises(FileError, match="source_weights"):
        transfer(source, "T1", out, resume=True)


@pytest.mark.parametrize(
    ("scenario", "error"),
    [
        ("T9", InputError),
        ("1,2", InputError),
        ("a,b,c", InputError),
        ("3,0,1", ReachError),
        ("nan,0,1", InputError),
    ],
)
def test_a_bad_scenario_is_refused_before_anything_is_written(tmp_path: Path, scenario: str, error: type):
    with pytest.raises(error):
        transfer(finished("airl"), scenario, tmp_path / "x")
    assert not (tmp_path / "x").exists()


# --- bad input -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["policy.safetensors", "reward.safetensors", "config.json"])
@pytest.mark.parametrize("share", [0.0, 0.5, 0.99])
def test_a_truncated_file_is_named(tmp_path: Path, name: str, share: float):
    run = copy(finished("airl"), tmp_path / "run")
    os.truncate(run / name, int(share * (run / name).stat().st_size))
    with pytest.raises(FileError, match=name):
        load_skill(run)


def test_truncated_demonstrations_are_named(tmp_path: Path):
    run = copy(finished("bc"), tmp_path / "run")
    (run / "report.html").unlink()
    os.truncate(run / "demonstrations.npz", 1000)
    with pytest.raises(FileError, match=r"demonstrations.npz"):
        train(tiny("bc"), run, resume=True)


def test_weights_of_another_run_do_not_fit(tmp_path: Path):
    run = copy(finished("airl"), tmp_path / "run")
    configuration = json.loads((run / "config.json").read_text())
    configuration["configuration"]["action"] = "force"
    (run / "config.json").write_text(json.dumps(configuration))
    with pytest.raises(FileError, match="12 observations to 7 actions"):
        load_skill(run)


def test_an_unfinished_run_has_no_skill_yet(tmp_path: Path):
    run = copy(finished("airl"), tmp_path / "run")
    (run / "policy.safetensors").unlink()
    with pytest.raises(FileError, match="finish the run with --resume"):
        load_skill(run)


def test_a_checkpoint_of_another_kind_of_run_is_refused(tmp_path: Path):
    run = copy(finished("airl"), tmp_path / "run")
    (run / "report.html").unlink()
    (run / "checkpoint.safetensors").write_bytes((transferred() / "checkpoint.safetensors").read_bytes())
    with pytest.raises(FileError, match="does not fit this run"):
        train(tiny(), run, resume=True)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"seed": -1}, "seed"),
        ({"seed": 1.5}, "seed"),
        ({"episodes": 0}, "episodes"),
        ({"history": 0}, "history"),
        ({"method": "sac"}, "method is 'sac'; choose one of: airl, bc, constant"),
        ({"method": "constant", "action": "force"}, "make no sense"),
        ({"task": "juggling"}, "no recipe for task 'juggling'"),
        ({"action": "position"}, "action is 'position'"),
    ],
)
def test_a_bad_configuration_is_refused(options: dict, message: str):
    options = {"task": "cup-on-plate", "method": "airl", **options}
    with pytest.raises(InputError, match=message):
        default_configuration(options.pop("task"), options.pop("method"), **options)


def test_bad_numbers_are_named_by_their_path():
    run = tiny()
    for field, value in (("slope_bound", float("nan")), ("divergence", -0.1), ("iterations", 0)):
        airl = replace(run.recipe.airl, **{field: value})
        with pytest.raises(InputError, match=rf"recipe\.airl\.{field}"):
            replace(run, recipe=replace(run.recipe, airl=airl))
    wrong: list[dict[str, Any]] = [
        {"push": -1.0}, {"start_noise": float("inf")}, {"start_noise": 11.0}, {"count": 0}, {"held_out": 0},
    ]  # fmt: skip
    for options in wrong:
        with pytest.raises(InputError):
            DemonstrationConfiguration(**{"push": 5.0, **options})


@pytest.mark.parametrize("name", tasks.names())
def test_pushes_are_the_tasks_own_unless_they_are_given(name: str):
    own = tasks.make(name).push
    assert DemonstrationConfiguration.for_task(name).push == own
    assert DemonstrationConfiguration.for_task(name, push=2.0 * own).push == 2.0 * own


def test_a_configuration_with_a_wrong_field_is_refused():
    good = to_json(tiny())
    assert from_json(RunConfiguration, json.loads(json.dumps(good)), where="f") == tiny()
    for path, value in (("seed", "one"), ("demonstrations", 3), ("method", None), ("episodes", True)):
        with pytest.raises(FileError, match=rf"f\.{path}"):
            from_json(RunConfiguration, good | {path: value}, where="f")
    with pytest.raises(FileError, match="unknown"):
        from_json(RunConfiguration, good | {"colour": "red"}, where="f")
    with pytest.raises(FileError, match="seed is -3"):
        from_json(RunConfiguration, good | {"seed": -3}, where="f")


def test_divergence_is_an_error_and_the_checkpoint_stays(tmp_path: Path):
    class Diverging:
        """Learns nothing, and breaks in its third iteration."""

        def __init__(self) -> None:
            import torch

            self.iteration = torch.zeros((), dtype=torch.int64)
            self.configuration = tiny(iterations=9).recipe.airl

        finished = False

        def iterate(self) -> dict[str, float]:
            self.iteration.add_(1)
            count = int(self.iteration)
            return {"iteration": count, "score": float("nan") if count == 3 else -1.0}

        def state(self) -> dict:
            return {"iteration": self.iteration}

        def load_state(self, state: dict) -> None:
            self.iteration.copy_(state["iteration"])

    with RunFolder.create(tmp_path, "training", {}) as folder:
        with pytest.raises(DivergenceError, match="score is nan in iteration 3"):
            run_to_end(Diverging(), folder, progress=Progress(), mean_score=lambda: 0.0, every=2)
        state = folder.load_checkpoint()
        assert state is not None
        assert int(state["iteration"]) == 2
