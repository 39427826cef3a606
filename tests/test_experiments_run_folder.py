"""The run folder: it refuses what is not its own, and survives whatever stops a process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from vic_toolbox.errors import FileError
from vic_toolbox.experiments.run_folder import FORMAT, RunFolder

SETTINGS = {"seed": 1, "recipe": {"iterations": 20, "bounds": (1.0, 2.0)}}


def make(path: Path, settings: dict | None = None, *, resume: bool = False) -> RunFolder:
    return RunFolder.create(path, "training", settings or SETTINGS, resume=resume)


def test_a_new_run_describes_itself(tmp_path: Path):
    with make(tmp_path / "a" / "run") as folder:
        pass
    again = RunFolder.open(tmp_path / "a" / "run")
    assert again.kind == "training"
    assert again.configuration == {"seed": 1, "recipe": {"iterations": 20, "bounds": [1.0, 2.0]}}
    assert folder.configuration == again.configuration
    assert not again.complete


def test_a_foreign_folder_is_refused_and_left_alone(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(FileError, match=r"not empty \(thesis.tex\)"):
        make(tmp_path)
    assert {entry.name for entry in tmp_path.iterdir()} == {"thesis.tex"}


def test_an_existing_run_is_refused_without_resume_and_taken_up_with_it(tmp_path: Path):
    make(tmp_path).close()
    with pytest.raises(FileError, match="--resume"):
        make(tmp_path)
    make(tmp_path, resume=True).close()


def test_resume_in_a_new_folder_begins_a_run(tmp_path: Path):
    make(tmp_path / "new", resume=True).close()
    assert (tmp_path / "new" / "config.json").exists()


def test_another_configuration_is_refused_with_the_differing_field(tmp_path: Path):
    make(tmp_path).close()
    with pytest.raises(FileError, match=r"configuration.recipe.iterations \(20 there, 30 now\)"):
        make(tmp_path, {"seed": 1, "recipe": {"iterations": 30, "bounds": (1.0, 2.0)}}, resume=True)


def test_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    make(tmp_path).close()
    monkeypatch.setattr("vic_toolbox.__version__", "99.0")
    with pytest.raises(FileError, match=r"version \('.*' there, '99.0' now\)"):
        make(tmp_path, resume=True)


def test_two_processes_cannot_share_a_folder(tmp_path: Path):
    code = (
        "import sys; from vic_toolbox.experiments.run_folder import FORMAT, RunFolder\n"
        f"RunFolder.create({str(tmp_path)!r}, 'training', {SETTINGS!r})\n"
        "print('ready', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(FileError, match="in use by another process"):
            make(tmp_path, resume=True)
        other.kill()
    make(tmp_path, resume=True).close()


def test_metrics_are_cut_to_the_checkpoint(tmp_path: Path):
    with make(tmp_path) as folder:
        for iteration in range(1, 8):
            folder.append_metrics({"iteration": iteration, "score": -1.5 * iteration})
            if iteration == 5:
                folder.save_checkpoint({"weights": torch.arange(3.0)}, iteration)
        with (tmp_path / "metrics.jsonl").open("a") as file:
            file.write('{"iteration": 8, "sco')  # the process was killed here
        assert [row["iteration"] for row in folder.metrics()] == [1, 2, 3, 4, 5, 6, 7]
        state = folder.load_checkpoint()
        assert state is not None
        assert torch.equal(state["weights"], torch.arange(3.0))
        assert [row["iteration"] for row in folder.metrics()] == [1, 2, 3, 4, 5]


def test_without_a_checkpoint_the_run_begins_anew(tmp_path: Path):
    with make(tmp_path) as folder:
        folder.append_metrics({"iteration": 1})
        assert folder.load_checkpoint() is None
        assert folder.metrics() == []


def test_a_damaged_line_of_the_metrics_is_named(tmp_path: Path):
    with make(tmp_path) as folder:
        (tmp_path / "metrics.jsonl").write_text('{"iteration": 1}\n{"iter\n{"iteration": 3}\n')
        with pytest.raises(FileError, match=r"metrics.jsonl, line 2"):
            folder.metrics()


@pytest.mark.parametrize("size", [0, 7, 60])
def test_a_truncated_checkpoint_is_refused(tmp_path: Path, size: int):
    with make(tmp_path) as folder:
        folder.save_checkpoint({"weights": torch.ones(100)}, 1)
        os.truncate(tmp_path / "checkpoint.safetensors", size)
        with pytest.raises(FileError, match=r"checkpoint.safetensors"):
            folder.load_checkpoint()


def test_a_killed_writer_leaves_no_litter_behind(tmp_path: Path):
    make(tmp_path).close()
    litter = tmp_path / ".checkpoint.k3x9.safetensors"
    litter.write_bytes(b"half")
    make(tmp_path, resume=True).close()
    assert not litter.exists()


def test_a_full_disk_is_reported_and_the_old_file_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with make(tmp_path) as folder:
        folder.save_checkpoint({"weights": torch.ones(2)}, 1)

        def full(*_: object) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(FileError, match="No space left"):
            folder.save_checkpoint({"weights": torch.zeros(2)}, 2)
        monkeypatch.undo()
        state = folder.load_checkpoint()
        assert state is not None
        assert torch.equal(state["weights"], torch.ones(2))
        assert not list(tmp_path.glob(".*.*.*"))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "cannot be read as JSON"),
        ('{"format": "vic-run/2", "conf', "cannot be read as JSON"),
        ("[1, 2]", "does not describe a run"),
        (json.dumps({"format": "vic-run/1"}), "does not describe a run of this version.*train it anew"),
        (json.dumps({"format": FORMAT, "kind": 3}), "lacks the kind"),
    ],
)
def test_a_damaged_description_is_refused(tmp_path: Path, content: str, message: str):
    make(tmp_path).close()
    (tmp_path / "config.json").write_text(content)
    with pytest.raises(FileError, match=message):
        RunFolder.open(tmp_path)
    with pytest.raises(FileError):
        make(tmp_path, resume=True)


@pytest.mark.parametrize("name", ["nothing", "file"])
def test_what_is_no_run_cannot_be_opened(tmp_path: Path, name: str):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="not a folder"):
        RunFolder.open(tmp_path / name)
    with pytest.raises(FileError, match="holds no run"):
        RunFolder.open(tmp_path)


def test_a_folder_below_a_file_cannot_be_made(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="cannot be made"):
        make(tmp_path / "file" / "run")
