"""Demonstrations from a file: the same skill as from the expert himself, and clear words for what does not suit."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file

from tests.experiment_runs import figures, finished, tiny
from vic_toolbox import tasks
from vic_toolbox.cli import main
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.configuration import (
    RecordedDemonstrations,
    RunConfiguration,
    from_json,
    to_json,
)
from vic_toolbox.experiments.training import train


@pytest.fixture(autouse=True)
def _without_figures():  # type: ignore[no-untyped-def]
    with figures(drawn=False):
        yield


@pytest.fixture(scope="module")
def file() -> Path:
    """Four demonstrations of the expert, as a run left them."""
    return finished("bc") / "demonstrations.npz"


def from_file(path: Path, method: str = "bc", **options: object) -> RunConfiguration:
    return replace(tiny(method, **options), demonstrations=RecordedDemonstrations.of(path))  # type: ignore[arg-type]


def recorded(path: Path, count: int = 3, *, steps: int = 500, **options: object) -> Path:
    """A file of few demonstrations."""
    whole = tasks.record(tasks.make("cup-on-plate", **options), count, seed=1)  # type: ignore[arg-type]
    cut = replace(whole, observations=whole.observations[:, : steps + 1], actions=whole.actions[:, :steps])
    cut.save(path)
    return path


# --- converted -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("action", "history"), [("gain", 1), ("gain", 5), ("force", 1), ("force", 3)])
@pytest.mark.parametrize("name", ["cup-on-plate", "peg-in-hole"])
def test_converted_demonstrations_are_those_that_would_have_been_recorded(
    name: str, action: str, history: int
):
    task = tasks.make(name, action=action, history=history)
    for first in (1, 2):
        found = tasks.record(tasks.make(name, history=first), 2, seed=3).converted(task)
        wanted = tasks.record(task, 2, seed=3)
        np.testing.assert_allclose(found.observations, wanted.observations, atol=0)
        np.testing.assert_allclose(found.actions, wanted.actions, atol=1e-9)
        assert (found.action, found.history) == (action, history)


def test_no_wrench_tells_its_gains():
    force = tasks.record(tasks.make("cup-on-plate", action="force"), 1)
    with pytest.raises(InputError, match="hold wrenches"):
        force.converted(tasks.make("cup-on-plate"))
    with pytest.raises(InputError, match="are of cup-on-plate; the task is peg-in-hole"):
        force.converted(tasks.make("peg-in-hole", action="force"))
    assert force.converted(tasks.make("cup-on-plate", action="force")) is force


# --- training ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["bc", "airl"])
def test_a_file_teaches_what_the_expert_himself_teaches(method: str, tmp_path: Path):
    source = finished(method)
    file = source / "demonstrations.npz"
    train(from_file(file, method), tmp_path / "run", threads=1, demonstrations=file)
    ours, theirs = (load_file(run / "policy.safetensors") for run in (tmp_path / "run", source))
    assert all((ours[name] == theirs[name]).all() for name in theirs)


def test_the_folder_keeps_a_copy_so_that_the_file_may_go(file: Path, tmp_path: Path):
    mine = tmp_path / "mine.npz"
    mine.write_bytes(file.read_bytes())
    run, out = from_file(mine), tmp_path / "run"
    train(run, out, threads=1, demonstrations=mine)
    mine.unlink()
    for name in ("report.html", "evaluation.json", "policy.safetensors"):
        (out / name).unlink()
    train(run, out, threads=1, resume=True)
    told = json.loads((out / "config.json").read_text())["configuration"]["demonstrations"]
    assert told == asdict(RecordedDemonstrations.of(out / "demonstrations.npz")) | {"file": "mine.npz"}


def test_force_policies_with_a_history_learn_from_gains(file: Path, tmp_path: Path):
    run = from_file(file, action="force", history=2)
    train(run, tmp_path / "run", threads=1, demonstrations=file)
    kept = tasks.Demonstrations.load(tmp_path / "run" / "demonstrations.npz")
    assert (kept.action, kept.history, len(kept)) == ("force", 2, 4)


def test_what_does_not_suit_is_refused_before_any_work(file: Path, tmp_path: Path):
    out = tmp_path / "run"
    run = from_file(file)
    with pytest.raises(InputError, match=r"learns from demonstrations\.npz; pass that file"):
        train(run, out, threads=1)
    with pytest.raises(FileError, match=r"is not the demonstrations\.npz"):
        train(run, out, threads=1, demonstrations=recorded(tmp_path / "other.npz"))
    with pytest.raises(InputError, match="task is peg-in-hole"):
        train(from_file(file, task="peg-in-hole"), out, threads=1, demonstrations=file)
    with pytest.raises(InputError, match="records the task's own expert"):
        train(tiny("bc"), out, threads=1, demonstrations=file)
    few = replace(run, demonstrations=replace(RecordedDemonstrations.of(file), held_out=4))
    with pytest.raises(InputError, match="hold out fewer"):
        train(few, out, threads=1, demonstrations=file)
    with pytest.raises(InputError, match="constant gains learn nothing"):
        from_file(file, "constant")
    with pytest.raises(InputError, match="holds one trajectory"):
        RecordedDemonstrations.of(recorded(tmp_path / "one.npz", 1))
    assert not out.exists()


def test_airl_wants_whole_episodes_and_cloning_does_not(tmp_path: Path):
    short = recorded(tmp_path / "short.npz", steps=260)
    with pytest.raises(InputError, match=r"260 steps \(2\.6 s\).*has 500 \(5 s\)"):
        train(from_file(short, "airl"), tmp_path / "airl", threads=1, demonstrations=short)
    train(from_file(short), tmp_path / "bc", threads=1, demonstrations=short)


def test_configurations_of_both_kinds_are_read_back(file: Path):
    for run in (tiny("bc"), from_file(file)):
        assert from_json(RunConfiguration, json.loads(json.dumps(to_json(run))), where="x") == run
    broken = to_json(from_file(file)) | {"demonstrations": {"file": "x", "held_out": 1}}
    with pytest.raises(FileError, match=r"lacks \['sha256'\]"):
        from_json(RunConfiguration, broken, where="x")
    with pytest.raises(FileError, match="should be a table"):
        from_json(RunConfiguration, broken | {"demonstrations": 3}, where="x")


def test_every_sixth_is_held_out(tmp_path: Path):
    assert RecordedDemonstrations.of(recorded(tmp_path / "a.npz", 13)).held_out == 2
    assert RecordedDemonstrations.of(recorded(tmp_path / "b.npz", 2)).held_out == 1


def test_the_command_line_takes_a_number_or_a_file(
    file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    line = ["train", "cup-on-plate", "--method", "bc", "--iterations", "20", "--episodes", "2"]
    out = tmp_path / "run"
    assert main([*line, "--demonstrations", str(file), "--held-out", "2", "--out", str(out)]) == 0
    told = json.loads((out / "config.json").read_text())["configuration"]["demonstrations"]
    assert (told["file"], told["held_out"]) == ("demonstrations.npz", 2)
    capsys.readouterr()
    assert main([*line, "--demonstrations", str(file), "--push", "3", "--out", str(tmp_path / "b")]) == 2
    assert "leave it out with a file" in capsys.readouterr().err
    assert main([*line, "--demonstrations", str(tmp_path / "no.npz")]) == 2
    assert "cannot be read as demonstrations" in capsys.readouterr().err
