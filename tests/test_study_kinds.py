"""What cells of each kind do, and the commands that run and show a study."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests import test_study_execution as execution
from tests.experiment_runs import tiny as tiny_run
from tests.study_files import write
from vic_toolbox import tasks
from vic_toolbox.cli import main
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.configuration import to_json
from vic_toolbox.experiments.difficulty import sweep_difficulty
from vic_toolbox.experiments.evaluation import Policy, baselines, evaluate
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.experiments.study import judging, kinds, sweeping, training, transferring
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.kinds import KINDS, kind_of
from vic_toolbox.experiments.study.presence import FILE
from vic_toolbox.experiments.training import train

toy = execution.toy
TRAINED = "peg-in-hole/train/gain-airl-seed0"


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one training cell that is done."""
    path = tmp_path_factory.mktemp("study")
    run = tiny_run(task="peg-in-hole")
    folder = path / "cells" / TRAINED
    values = training.run(Cell("train", TRAINED, to_json(run)), folder, path)
    (folder / "values.json").write_text(json.dumps(values))
    return path


def judge(study: Path, policy: dict[str, Any], **changes: Any) -> dict[str, Any]:
    settings = {
        "policy": policy,
        "task": "peg-in-hole",
        "action": "gain",
        "history": 1,
        "scenario": "tilt=0",
        "episodes": 3,
        "time_step": 1.0,
    }
    return judging.run(Cell("judge", "j", settings | changes), study, study)


def test_every_kind_has_a_module_with_what_is_asked_of_it():
    for kind in KINDS:
        module = kind_of(Cell(kind, "x", {}))
        assert callable(module.run)
        assert callable(module.effort)
    with pytest.raises(InputError, match="kind of the cell x is 'tarin'; choose one of: train"):
        kind_of(Cell("tarin", "x", {}))


def test_a_cell_that_trains_ends_with_its_evaluation_and_draws_nothing(study: Path):
    folder = study / "cells" / TRAINED
    values = json.loads((folder / "values.json").read_text())
    assert json.loads((folder / "run" / "evaluation.json").read_text()) == values
    assert (values["method"], values["scenario"], values["episodes"]) == ("airl", "train", 2)
    assert not (folder / "run" / "report.html").exists()
    assert not (folder / "run" / "figures").exists()


def test_a_run_without_report_is_finished_again_alike_and_may_get_one(study: Path, tmp_path: Path):
    run, folder = tiny_run("constant", task="peg-in-hole"), tmp_path / "run"
    first = train(run, folder, threads=1, report=False)
    assert train(run, folder, threads=1, report=False, resume=True) == first
    assert not (folder / "report.html").exists()
    assert train(run, folder, threads=1, resume=True) == first
    assert (folder / "report.html").exists()
    assert train(run, folder, threads=1, report=False, resume=True) == first


def test_a_transfer_cell_takes_the_policy_of_the_cell_that_it_needs(study: Path, tmp_path: Path):
    carried = replace(tiny_run(task="peg-in-hole").recipe.transfer, fresh=True)
    settings = {
        "scenario": "tilt=0",
        "reward": "random",
        "fresh": True,
        "seed": 3,
        "episodes": 2,
        "transfer": asdict(carried),
    }
    values = transferring.run(Cell("transfer", "t", settings, (TRAINED,)), tmp_path, study)
    assert values["transfer"] == "random reward, from random weights"
    assert (values["scenario"], values["seed"], values["episodes"]) == ("tilt=0", 3, 2)
    assert not (tmp_path / "run" / "report.html").exists()


def test_judging_is_the_evaluation_of_that_policy(study: Path):
    task = tasks.make("peg-in-hole", scenario="tilt=0")
    for which, policy in baselines(task).items():
        assert judge(study, {"baseline": which}) == evaluate(task, policy, episodes=3, threads=1).to_json()
    expert = judge(study, {"baseline": "expert"})
    assert (expert["method"], expert["relative_difference"]) == ("expert", 0.0)
    own = load_skill(study / "cells" / TRAINED / "run").judged
    assert judge(study, {"cell": TRAINED}) == evaluate(task, own, episodes=3, threads=1).to_json()
    with pytest.raises(InputError, match="policy is of the kind 'guess'"):
        judge(study, {"guess": 1})


def test_an_untrained_policy_acts_with_noise_drawn_by_its_seed(study: Path):
    first, second = judge(study, {"untrained": 1}), judge(study, {"untrained": 2})
    assert first == judge(study, {"untrained": 1})
    assert first["score_mean"] != second["score_mean"]
    assert (first["method"], first["seed"]) == ("untrained", 1)
    middle = Policy(lambda observations: np.zeros((len(observations), 6)), "middle")
    still = evaluate(tasks.make("peg-in-hole", scenario="tilt=0"), middle, episodes=3, threads=1)
    assert abs(first["score_mean"] - still.score_mean) > 1e-3  # the noise moves something


@pytest.mark.parametrize("name", ["peg-in-hole", "cup-on-plate"])
def test_half_the_time_step_is_the_same_task_with_smaller_steps(name: str, study: Path):
    usual = tasks.make(name)
    finer = tasks.make(name, substeps=2 * usual.substeps)
    step, half = (task.simulation(1).model.opt.timestep for task in (usual, finer))
    assert step == 1e-3
    assert half == step / 2
    assert finer.with_action("force").substeps == finer.substeps
    assert type(usual).substeps == usual.substeps
    with pytest.raises(InputError, match="substeps is 0"):
        tasks.make(name, substeps=0)
    whole = judge(study, {"baseline": "expert"}, task=name, scenario="train")
    fine = judge(study, {"baseline": "expert"}, task=name, scenario="train", time_step=0.5)
    assert fine["score_mean"] != whole["score_mean"]
    assert fine["score_mean"] == pytest.approx(whole["score_mean"], rel=0.02)


@pytest.mark.parametrize("with_policy", [True, False])
def test_a_sweep_has_the_policies_or_what_they_are_compared_with(
    study: Path, tmp_path: Path, with_policy: bool, monkeypatch: pytest.MonkeyPatch
):
    axis = replace(tasks.make("peg-in-hole").sweeps["tilt"], values=(0.0, 2.0))
    monkeypatch.setattr("vic_toolbox.tasks.peg_in_hole.PegInHole.sweeps", {"tilt": axis})
    settings = {"task": "peg-in-hole", "action": "gain", "history": 1, "quantity": "tilt", "episodes": 2}
    settings["policies"] = {"airl": TRAINED} if with_policy else {}
    values = sweeping.run(Cell("sweep", "s", settings), tmp_path, study)
    task, own = tasks.make("peg-in-hole"), load_skill(study / "cells" / TRAINED / "run").judged
    whole = sweep_difficulty(task, {"airl": own}, "tilt", episodes=2, threads=1).summary()
    names = {"airl"} if with_policy else {"expert", "constant", "middle", "matched"}
    assert set(values["methods"]) == names
    assert values["methods"] == {name: whole["methods"][name] for name in names}
    assert (tmp_path / "sweep.csv").exists()


# commands --------------------------------------------------------------------------------------------


@pytest.fixture
def commands(toy: execution.Toy, monkeypatch: pytest.MonkeyPatch) -> execution.Toy:
    """The commands with toy cells in this process and without a report."""
    monkeypatch.setattr("vic_toolbox.experiments.study.engines.JoblibEngine", lambda _: execution.Serial())
    monkeypatch.setattr("vic_toolbox.experiments.study.report.report", lambda folder, out: None)
    return toy


def test_a_study_from_the_command_line(
    commands: execution.Toy, tmp_path: Path, capsys: pytest.CaptureFixture
):
    file, out = write(tmp_path), tmp_path / "out"
    assert main(["study", "run", str(file), "--out", str(out)]) == 0
    said = capsys.readouterr()
    assert said.out == f"5 cells done.\n{out / 'report.html'}\n"
    assert "study tiny: 5/5 cells" in said.err
    assert main(["study", "run", str(file), "--out", str(out), "--resume"]) == 0
    assert "0 cells done, 5 were done before." in capsys.readouterr().out
    assert main(["study", "status", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "A study of seconds" in shown
    assert "It is complete." in shown
    assert main(["study", "run", str(file), "--out", str(out)]) == 2
    assert "--resume" in capsys.readouterr().err


def test_a_failed_cell_ends_with_code_1_and_says_why(
    commands: execution.Toy, tmp_path: Path, capsys: pytest.CaptureFixture
):
    commands.fails = {"b": 9}
    file, out = write(tmp_path), tmp_path / "out"
    assert main(["study", "run", str(file), "--out", str(out)]) == 1
    said = capsys.readouterr()
    assert "failed: b: RuntimeError: b does not want to" in said.err
    assert "not run, because b failed: 1 cells (d)" in said.err
    assert "tried again with --resume" in said.err
    assert str(out / "report.html") in said.out  # of what there is
    assert main(["study", "status", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "failed: b: RuntimeError: b does not want to" in shown
    assert "go on with: vic study run" in shown


def test_status_names_what_runs_and_for_how_long(
    commands: execution.Toy, tmp_path: Path, capsys: pytest.CaptureFixture
):
    file, out = write(tmp_path), tmp_path / "out"
    main(["study", "run", str(file), "--out", str(out)])
    (out / "cells" / "d" / "result.json").unlink()
    capsys.readouterr()
    with kinds_present(out):
        assert main(["study", "status", str(out)]) == 0
    shown = capsys.readouterr().out
    assert "running 0 s: d" in shown
    assert "about 1 s left with 1 at once" in shown or "about 0 s left with 1 at once" in shown
    assert not (out / FILE).exists()


def kinds_present(out: Path):  # type: ignore[no-untyped-def]
    from vic_toolbox.experiments.study.presence import present

    return present(out / "cells" / "d")


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["run", "nothing.toml"], "cannot be read"),
        (["run", "FILE", "--jobs", "-1"], "jobs is -1"),
        (["run", "FILE", "--seeds", "3", "3"], "seeds has 3 twice"),
        (["status", "nowhere"], "holds no study"),
        (["report", "nowhere"], "holds no study"),
    ],
)
def test_bad_options(line: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture):
    file = str(write(tmp_path))
    words = [file if word == "FILE" else word for word in line]
    if words[0] == "run":
        words += ["--out", str(tmp_path / "out")]
    assert main(["study", *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out" / "study.json").exists()


def test_the_effort_of_a_cell_grows_with_its_work():
    cells = {cell.name: cell for cell in execution.DIAMOND}
    assert cells  # toys have their own; the real ones:
    run = to_json(tiny_run(task="peg-in-hole", iterations=2))
    longer = to_json(tiny_run(task="peg-in-hole", iterations=20))
    assert kinds.effort(Cell("train", "a", run)) < kinds.effort(Cell("train", "b", longer))
