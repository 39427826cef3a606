"""The ``vic`` command: help, results, and one clear line for everything that can go wrong."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest

from tests.experiment_runs import copy, figures, finished, transferred
from vic_toolbox import __version__
from vic_toolbox.cli import main
from vic_toolbox.cli.commands import COMMANDS
from vic_toolbox.experiments.demo import _next_steps
from vic_toolbox.tasks import rendering
from vic_toolbox.tasks.peg_in_hole import PegInHole


@pytest.fixture(autouse=True)
def _without_figures():  # type: ignore[no-untyped-def]
    """Reports in a tenth of the time; the shared runs have their figures."""
    with figures(drawn=False):
        yield


VIC = [sys.executable, "-m", "vic_toolbox"]
ROOT = Path(__file__).parents[1]


def failure(capsys: pytest.CaptureFixture, *line: str) -> str:
    """The one line that a failing command prints."""
    assert main([str(word) for word in line]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1, err
    assert "Traceback" not in err
    assert err.startswith("vic: error: ")
    return err


# --- help ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("line", [[], ["--help"], ["-h"]])
def test_the_help_names_every_command(capsys: pytest.CaptureFixture, line: list[str]):
    assert main(line) == 0
    text = capsys.readouterr().out
    assert all(re.search(rf"^  {name} ", text, re.MULTILINE) for name in COMMANDS)
    assert "vic demo" in text


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_explains_itself_with_an_example_and_a_seed(capsys: pytest.CaptureFixture, name: str):
    assert main([name, "--help"]) == 0
    text = capsys.readouterr().out
    assert f"Example: vic {name}" in text
    assert name in ("tasks", "recording", "fit", "study") or "--seed" in text
    assert "STR" not in text.replace("{", "")


def test_examples_of_the_help_are_accepted(capsys: pytest.CaptureFixture):
    """Each example parses: what fails afterwards is only that the folder is not there."""
    for name, command in COMMANDS.items():
        example = re.search(r"Example: vic (.*)", command.__doc__ or "")
        assert example, name
        words = example.group(1).split()
        if name in ("transfer", "evaluate", "play"):
            assert "is not a folder" in failure(capsys, *words)


def test_help_is_quick_and_loads_nothing_heavy():
    code = (
        "import sys; from vic_toolbox.cli import main; main(['--help']); main(['train', '--help'])\n"
        "assert not {'torch', 'mujoco', 'pinocchio', 'matplotlib'} & sys.modules.keys()"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, cwd=ROOT)


def test_every_hyper_parameter_has_its_help(capsys: pytest.CaptureFixture):
    assert main(["train", "cup-on-plate", "--help-all"]) == 0
    text = capsys.readouterr().out
    for option in (
        "--airl.slope-bound",
        "--airl.search.trpo.fisher-damping",
        "--cloning.steps",
        "--transfer.fresh",
    ):
        assert option in text


def test_the_version(capsys: pytest.CaptureFixture):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"vic_toolbox {__version__}\n"


# --- results -------------------------------------------------------------------------------------------------


def test_train_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture):
    line = ["train", "cup-on-plate", "--method", "bc", "--iterations", "20", "--demonstrations", "3", "--held-out",
            "1", "--episodes", "2", "--cloning.check-every", "10", "--out", str(tmp_path / "run")]  # fmt: skip
    assert main(line) == 0
    out = capsys.readouterr().out
    assert re.match(r"train: score -\d+\.\d ± \d+\.\d, expert -34\d\.\d, relative difference 0\.\d+", out)
    assert str(tmp_path / "run" / "report.html") in out
    configuration = json.loads((tmp_path / "run" / "config.json").read_text())["configuration"]
    assert (
        configuration["recipe"]["cloning"] | {"steps": 20, "check_every": 10}
        == configuration["recipe"]["cloning"]
    )
    assert "--resume" in failure(capsys, *line)
    assert main([*line, "--resume"]) == 0
    assert "is complete already" in capsys.readouterr().err
    assert "recipe.cloning.steps (20 there, 30 now)" in failure(
        capsys, *line, "--resume", "--iterations", "30"
    )


def test_transfer_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "T2"
    line = ["transfer", str(finished("airl")), "--scenario", "T2", "--iterations", "1", "--fresh", "--episodes", "1",
            "--transfer.divergence", "0.02", "--out", str(out)]  # fmt: skip
    assert main(line) == 0
    assert capsys.readouterr().out.startswith("T2: score ")
    settings = json.loads((out / "config.json").read_text())["configuration"]["transfer"]
    assert (settings["iterations"], settings["divergence"], settings["fresh"]) == (1, 0.02, True)


def test_evaluate_writes_its_row(tmp_path: Path, capsys: pytest.CaptureFixture):
    run = copy(transferred(), tmp_path / "run")
    assert main(["evaluate", str(run), "--scenario", "T3", "--episodes", "2", "--seed", "7"]) == 0
    assert capsys.readouterr().out.startswith("T3: score ")
    row = json.loads((run / "evaluation.json").read_text())
    assert row == json.loads((run / "evaluations" / "T3" / "evaluation.json").read_text())
    assert (row["scenario"], row["episodes"], row["start_seed"], row["method"]) == ("T3", 2, 7, "airl")
    assert (run / "evaluations" / "T1" / "evaluation.json").exists()  # the earlier one stays
    first = (run / "evaluation.json").read_bytes()
    assert main(["evaluate", str(run), "--scenario", "T3", "--episodes", "2", "--seed", "7"]) == 0
    assert (run / "evaluation.json").read_bytes() == first


@pytest.mark.slow
def test_a_sweep_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture):
    run = copy(finished("airl"), tmp_path / "run")
    assert main(["evaluate", str(run), "--sweep", "start", "--against", str(finished("bc"))]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^airl +0\.\d+ +0\.\d+ +\d+ %", out, re.MULTILINE)
    assert re.search(r"^bc ", out, re.MULTILINE)
    assert {path.name for path in (run / "evaluations" / "sweep-start").iterdir()} == {
        "sweep.csv", "sweep.json", "sweep.svg",
    }  # fmt: skip


def test_a_difficulty_sweep_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    axis = replace(PegInHole().sweeps["tilt"], values=(-6.0, 2.0))
    monkeypatch.setattr(PegInHole, "sweeps", MappingProxyType({"tilt": axis}))
    run = copy(finished("bc", "peg-in-hole"), tmp_path / "run")
    other = finished("constant", "peg-in-hole")
    line = ["evaluate", str(run), "--sweep", "tilt", "--episodes", "2", "--against", str(other)]
    assert main(line) == 0
    out = capsys.readouterr().out
    assert re.search(r"^success \[%\] +area +-6 +2", out, re.MULTILINE)
    assert re.search(r"^expert +1\.00 +100 +100", out, re.MULTILINE)
    assert re.search(r"^matched ", out, re.MULTILINE)
    assert "tilt  [deg], 2 episodes at each value" in out
    folder = run / "evaluations" / "sweep-tilt"
    assert {path.name for path in folder.iterdir()} == {"sweep.csv", "sweep.json", "sweep.svg"}
    assert set(json.loads((folder / "sweep.json").read_text())["methods"]) >= {"bc", "constant"}


def test_the_folder_of_a_transfer_is_called_by_its_scenario(tmp_path: Path, capsys: pytest.CaptureFixture):
    run = copy(finished("airl", "peg-in-hole"), tmp_path / "run")
    line = ["transfer", str(run), "--scenario", "scale=.50,tilt=-4", "--iterations", "1", "--episodes", "1"]
    assert main(line) == 0
    assert capsys.readouterr().out.startswith("tilt=-4,scale=0.5: score ")
    assert (tmp_path / "run-tilt=-4,scale=0.5" / "report.html").exists()


def test_robots_are_listed(capsys: pytest.CaptureFixture):
    assert main(["robots"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^fanuc_lrmate200id7l +6 +0\.9\d +tool0 +FANUC LR Mate 200iD/7L", out, re.MULTILINE)
    assert re.search(r"^panda +7 ", out, re.MULTILINE)


WITHOUT_LEARNING = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"torch", "mujoco", "gymnasium", "safetensors", "threadpoolctl"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from vic_toolbox.cli import main
sys.exit(main(sys.argv[1:]))
"""


def without_learning(*line: str) -> subprocess.CompletedProcess:
    """The command where only the base package is installed."""
    return subprocess.run(
        [sys.executable, "-c", WITHOUT_LEARNING, *line], capture_output=True, text=True, cwd=ROOT
    )


def test_robots_are_listed_without_the_learning_packages():
    done = without_learning("robots")
    assert done.returncode == 0, done.stderr
    assert "fanuc_lrmate200id7l" in done.stdout


@pytest.mark.parametrize("line", [["demo"], ["train", "cup-on-plate"], ["evaluate", "run"], ["tasks"]])
def test_a_missing_package_is_named_with_its_remedy(line: list[str]):
    done = without_learning(*line)
    assert done.returncode == 2
    assert done.stdout == ""
    assert re.fullmatch(
        r"vic: error: No module named '\w+'; install it with: pip install 'vic-toolbox\[learn\]'\n",
        done.stderr,
    )


def test_tasks_are_listed(capsys: pytest.CaptureFixture):
    assert main(["tasks"]) == 0
    out = capsys.readouterr().out
    assert re.search(
        r"^cup-on-plate +vic/CupOnPlate-v0 +gain \(7\), force \(6\) +500 steps, 5 s", out, re.MULTILINE
    )
    assert re.search(r"^cup-on-plate +T1 +0\.35, −0\.35, 0\.45 m", out, re.MULTILINE)
    assert re.search(r'^cup-on-plate +your own +a start "x,y,z" \[m\]', out, re.MULTILINE)
    assert re.search(
        r"^peg-in-hole +vic/PegInHole-v0 +gain \(6\), force \(6\) +200 steps, 4 s", out, re.MULTILINE
    )
    assert re.search(r"^peg-in-hole +tilt=-6 +tilt [-−]6", out, re.MULTILINE)


# --- what can go wrong ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["transfer", "evaluate", "play"])
def test_a_missing_run(capsys: pytest.CaptureFixture, name: str, tmp_path: Path):
    more = ["--scenario", "T1"] if name == "transfer" else []
    assert "is not a folder" in failure(capsys, name, str(tmp_path / "nothing"), *more)
    assert "holds no run" in failure(capsys, name, str(tmp_path), *more)


@pytest.mark.parametrize("name", ["transfer", "evaluate", "play"])
@pytest.mark.parametrize("file", ["config.json", "policy.safetensors", "reward.safetensors"])
def test_a_broken_run(capsys: pytest.CaptureFixture, name: str, file: str, tmp_path: Path):
    run = copy(finished("airl"), tmp_path / "run")
    os.truncate(run / file, 100)
    more = ["--scenario", "T1"] if name == "transfer" else []
    assert file in failure(capsys, name, str(run), *more)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (["juggle"], "no command; choose one of: demo, train"),
        (["train", "juggling"], "task is 'juggling'; choose one of: cup-on-plate, peg-in-hole"),
        (["train", "--help-all"], "name it: vic train cup-on-plate --help-all"),
        (["train", "cup-on-plate", "--seed", "-1"], "seed is -1"),
        (["train", "cup-on-plate", "--history", "0"], "history is 0"),
        (["train", "cup-on-plate", "--airl.slope-bound", "nan"], "recipe.airl.slope_bound is nan"),
        (["train", "cup-on-plate", "--iterations", "0"], "iterations is 0"),
        (["train", "cup-on-plate", "--demonstrations", "0"], "demonstrations is 0"),
        (["train", "cup-on-plate", "--push", "nan"], "push"),
        (["train", "cup-on-plate", "--method", "constant", "--action", "force"], "make no sense"),
        (["train", "cup-on-plate", "--threads", "-2"], "threads"),
    ],
)
def test_bad_options_of_train(capsys: pytest.CaptureFixture, line: list[str], message: str, tmp_path: Path):
    more = ["--out", str(tmp_path / "run")] if line[0] == "train" and line[1] != "--help-all" else []
    assert message in failure(capsys, *line, *more)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--scenario", "T9"], "choose one of: train, T1, T2, T3, T4, or pass a start"),
        (["--scenario", "3,0,1"], "out of reach"),
        (["--scenario", "0.4,0.4,0.0"], "height"),
        (["--scenario", "1,2"], "x,y,z"),
        (["--episodes", "0"], "episodes is 0"),
        (["--seed", "-4"], "seed is -4"),
        (["--sweep", "start", "--scenario", "T1"], "leave --scenario out"),
        (["--sweep", "tilt"], "Cup-on-Plate has no sweep 'tilt'; choose one of: start."),
        (["--against", "runs/other"], "--against belongs to a sweep"),
    ],
)
def test_bad_options_of_evaluate(capsys: pytest.CaptureFixture, more: list[str], message: str):
    assert message in failure(capsys, "evaluate", str(finished("airl")), *more)


def test_a_method_without_reward_cannot_be_transferred(capsys: pytest.CaptureFixture, tmp_path: Path):
    message = failure(
        capsys, "transfer", str(finished("bc")), "--scenario", "T1", "--out", str(tmp_path / "x")
    )
    assert "has learned no reward" in message


@pytest.mark.parametrize("word", ["--methd", "--airl.slope-bnd", "extra"])
def test_an_unknown_option_ends_with_a_hint(capsys: pytest.CaptureFixture, word: str):
    assert main(["train", "cup-on-plate", word, "3"]) == 2
    out, err = capsys.readouterr()
    assert word in out + err
    assert "Traceback" not in out + err


def test_a_foreign_folder(capsys: pytest.CaptureFixture, tmp_path: Path):
    (tmp_path / "mine.txt").write_text("")
    for line in (["demo"], ["train", "cup-on-plate"]):
        assert "is not empty (mine.txt)" in failure(capsys, *line, "--out", str(tmp_path))


def test_a_full_disk(capsys: pytest.CaptureFixture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    message = failure(capsys, "train", "cup-on-plate", "--out", str(tmp_path / "run"))
    assert "No space left on device" in message
    assert {entry.name for entry in (tmp_path / "run").iterdir()} == {".lock"}


def test_play_without_a_display(capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr(rendering.sys, "platform", "linux")
    assert "--video" in failure(capsys, "play", str(finished("airl")))


def test_play_films_only_mp4(capsys: pytest.CaptureFixture, tmp_path: Path):
    message = failure(capsys, "play", str(finished("airl")), "--video", str(tmp_path / "film.gif"))
    assert "must end in .mp4" in message


def test_debug_shows_where_it_failed(tmp_path: Path):
    from vic_toolbox.errors import FileError

    with pytest.raises(FileError):
        main(["evaluate", str(tmp_path), "--debug"])


def test_ctrl_c_ends_with_how_to_go_on(tmp_path: Path):
    out = tmp_path / "my run"
    line = ["train", "cup-on-plate", "--iterations", "500", "--demonstrations", "2", "--held-out", "1",
            "--airl.search.environments", "2", "--threads", "1", "--out", str(out)]  # fmt: skip
    process = subprocess.Popen([*VIC, *line], stderr=subprocess.PIPE, text=True, cwd=ROOT)
    deadline = time.monotonic() + 60.0
    while not (out / "metrics.jsonl").exists() or not (out / "metrics.jsonl").read_text().count("\n"):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 130
    last = err.strip().splitlines()[-1]
    assert last.startswith("vic: stopped. Go on with: vic train cup-on-plate")
    assert last.endswith(f"--out '{out}' --resume")
    assert "Traceback" not in err
    assert (out / "checkpoint.safetensors").exists()


def test_the_next_steps_of_the_demonstration_are_real_commands(capsys: pytest.CaptureFixture, tmp_path: Path):
    for command, _ in _next_steps(tmp_path):
        _, name, *words = command.split()
        assert main([name, *words, "--nonsense"]) == 2
        out, err = capsys.readouterr()
        assert "Unrecognized options: --nonsense" in re.sub(r"[│╭╮╰╯─\s]+", " ", out + err)
