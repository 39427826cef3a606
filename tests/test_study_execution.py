"""Doing a study: done cells never again, failures reported while the others go on, nothing ever mixed."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.study_files import tiny
from vic_toolbox.errors import FileError
from vic_toolbox.experiments.study import folder as study_folder
from vic_toolbox.experiments.study import work
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.engines import Lost
from vic_toolbox.experiments.study.execution import Queue, Summary, execute
from vic_toolbox.experiments.study.folder import StudyFolder, read_result
from vic_toolbox.experiments.study.parcels import pack, unpack
from vic_toolbox.experiments.study.plan import Plan
from vic_toolbox.experiments.study.presence import FILE, presence, present
from vic_toolbox.experiments.study.status import read_status
from vic_toolbox.files import read_json, write_json


def cell(name: str, *needs: str, **settings: Any) -> Cell:
    return Cell("toy", name, settings, needs)


class Toy:
    """A kind whose cells add one to what they need; it counts how often each is done, and fails where it is told."""

    def __init__(self) -> None:
        self.done: Counter[str] = Counter()
        self.fails: dict[str, int] = {}

    def run(self, cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
        self.done[cell.name] += 1
        if self.fails.get(cell.name, 0) >= self.done[cell.name]:
            raise RuntimeError(f"{cell.name} does not want to")
        needed = [read_result(study / "cells" / name) for name in cell.needs]
        (folder / "note.txt").write_text(cell.name)
        return {"value": 1 + sum(result.values["value"] for result in needed if result is not None)}

    def effort(self, settings: Mapping[str, Any]) -> float:
        return float(settings.get("effort", 1.0))


class Serial:
    """An engine of one place, in this process."""

    slots = 1
    label = "this process"

    def __init__(self, broken: dict[str, int] | None = None) -> None:
        self.broken = Counter(broken or {})

    def map(
        self, function: Callable[[Any], Any], jobs: Iterator[Any], *, stopped: Callable[[], bool]
    ) -> Generator[tuple[Any, Any]]:
        while (job := next(jobs, None)) is not None:
            if stopped():
                raise KeyboardInterrupt
            self.broken[job.cell.name] -= 1
            lost = self.broken[job.cell.name] >= 0
            yield job, Lost("its process was killed") if lost else function(job)


DIAMOND = (
    cell("a", effort=5.0),
    cell("b", "a"),
    cell("c", "a", effort=3.0),
    cell("d", "b", "c"),
    cell("other/e", effort=2.5),
)


@pytest.fixture
def toy(monkeypatch: pytest.MonkeyPatch) -> Toy:
    kind = Toy()
    monkeypatch.setattr(work, "kind_of", lambda _: kind)
    monkeypatch.setattr("vic_toolbox.experiments.study.kinds.kind_of", lambda _: kind)
    plan_of(monkeypatch, DIAMOND)
    return kind


def plan_of(monkeypatch: pytest.MonkeyPatch, cells: tuple[Cell, ...]) -> None:
    monkeypatch.setattr(study_folder, "make_plan", lambda _: Plan(cells, ()))


def do(path: Path, *, resume: bool = False, engine: Serial | None = None) -> Summary:
    with StudyFolder.create(path, tiny(), resume=resume) as folder:
        return execute(folder, engine or Serial())


def values(path: Path) -> dict[str, Any]:
    return {name: result.values for name, result in StudyFolder.open(path).results().items()}


# order -----------------------------------------------------------------------------------------------


def test_the_longest_chain_goes_first_and_nothing_before_its_needs(toy: Toy, tmp_path: Path):
    queue = Queue(Plan(DIAMOND, ()), set())
    order = []
    while (job := next(queue)) is not None:
        order.append(job.name)
        queue.finish(job.name)
    assert order == ["a", "c", "other/e", "b", "d"]
    assert next(queue) is None


def test_nothing_is_ready_while_its_needs_are_under_way(toy: Toy):
    queue = Queue(Plan(DIAMOND, ()), {"other/e"})
    first = next(queue)
    assert first is not None
    assert first.name == "a"
    assert next(queue) is None
    queue.finish("a")
    assert next(queue) is not None


# results ---------------------------------------------------------------------------------------------


def test_done_cells_are_never_done_again(toy: Toy, tmp_path: Path):
    first = do(tmp_path)
    assert (first.done, first.kept, first.complete) == (5, 0, True)
    assert values(tmp_path)["d"] == {"value": 5}
    again = do(tmp_path, resume=True)
    assert (again.done, again.kept, again.complete) == (0, 5, True)
    assert set(toy.done.values()) == {1}


def test_a_result_says_what_it_is_and_who_made_it(toy: Toy, tmp_path: Path):
    do(tmp_path)
    result = StudyFolder.open(tmp_path).result("d")
    assert result is not None
    assert result.cell == DIAMOND[3]
    assert result.version
    assert "cores" in result.machine
    assert not (tmp_path / "cells" / "d" / FILE).exists()


def test_a_failure_is_tried_once_more(toy: Toy, tmp_path: Path):
    toy.fails = {"b": 1}
    assert do(tmp_path).complete
    assert toy.done["b"] == 2


def test_a_cell_that_fails_twice_is_reported_and_the_others_go_on(toy: Toy, tmp_path: Path):
    toy.fails = {"b": 9}
    summary = do(tmp_path)
    (failure,) = summary.failures
    assert (failure.name, failure.reason) == ("b", "RuntimeError: b does not want to")
    assert [text.count("Traceback") for text in failure.tracebacks] == [1, 1]
    assert summary.blocked == {"d": "b"}
    assert not summary.complete
    assert toy.done == {"a": 1, "b": 2, "c": 1, "other/e": 1}
    status = read_status(StudyFolder.open(tmp_path))
    assert (status.total.done, status.total.failed, status.total.blocked) == (3, 1, 1)
    assert status.failures == summary.failures


def test_a_failed_cell_is_tried_again_when_the_study_is_taken_up(toy: Toy, tmp_path: Path):
    toy.fails = {"b": 2}
    do(tmp_path)
    summary = do(tmp_path, resume=True)
    assert (summary.kept, summary.done, summary.complete) == (3, 2, True)
    assert not (tmp_path / "cells" / "b" / "failure.json").exists()


def test_a_worker_that_dies_costs_its_cell_one_attempt(toy: Toy, tmp_path: Path):
    assert do(tmp_path, engine=Serial({"a": 1})).complete
    summary = do(tmp_path / "other", engine=Serial({"a": 2}))
    assert [failure.reason for failure in summary.failures] == ["its process was killed"]
    assert summary.blocked == {"b": "a", "c": "a", "d": "a"}


def test_a_worker_of_another_version_refuses(toy: Toy, tmp_path: Path):
    outcome = work.perform(make_job(tmp_path, version="0.0"))
    assert outcome.state == "failed"
    assert "install the same version everywhere" in outcome.traceback


def make_job(path: Path, **changes: Any) -> work.Job:
    with StudyFolder.create(path, tiny(), resume=True) as folder:
        job = work.Job(DIAMOND[0], folder.digests["a"], str(path), token=folder.token)
    return replace(job, **changes)


def test_a_worker_elsewhere_asks_for_the_cell_and_sends_it_home(toy: Toy, tmp_path: Path):
    do(tmp_path)
    job = replace(
        make_job(tmp_path, token="of another place"), cell=DIAMOND[3], digest="fresh" + tmp_path.name
    )
    assert work.perform(job).state == "away"
    needed = {name: pack(tmp_path / "cells" / name) for name in ("b", "c")}
    outcome = work.perform(replace(job, parcels=needed))
    assert (outcome.state, outcome.traceback) == ("done", "")
    unpack(outcome.parcel, tmp_path / "home")
    assert read_result(tmp_path / "home") is not None
    assert (tmp_path / "home" / "note.txt").read_text() == "d"


def test_a_study_whose_workers_are_elsewhere_is_the_same(toy: Toy, tmp_path: Path):
    do(tmp_path / "here")
    with StudyFolder.create(tmp_path / "away", tiny()) as folder:
        folder.token = "of another place"
        assert execute(folder, Serial()).complete
    assert values(tmp_path / "away") == values(tmp_path / "here")


def test_a_damaged_parcel_leaves_the_folder_as_it_was(tmp_path: Path):
    (tmp_path / "cell").mkdir()
    (tmp_path / "cell" / "kept.txt").write_text("mine")
    with pytest.raises(FileError, match="cannot be put"):
        unpack(b"PK no archive", tmp_path / "cell")
    assert [entry.name for entry in tmp_path.iterdir()] == ["cell"]
    assert (tmp_path / "cell" / "kept.txt").read_text() == "mine"
    unpack(b"", tmp_path / "cell")
    assert pack(tmp_path / "nothing") == b""


# the folder ------------------------------------------------------------------------------------------


def test_an_existing_study_is_refused_without_resume(toy: Toy, tmp_path: Path):
    do(tmp_path)
    with pytest.raises(FileError, match="holds a study already; take it up with --resume"):
        do(tmp_path)


def test_a_foreign_folder_is_refused_and_left_alone(toy: Toy, tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(FileError, match=r"not empty \(thesis.tex\) and holds no study"):
        do(tmp_path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]
    with pytest.raises(FileError, match="holds no study"):
        StudyFolder.open(tmp_path)


def test_a_changed_cell_is_named_and_nothing_is_mixed(
    toy: Toy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    do(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.json")}
    plan_of(monkeypatch, (*DIAMOND[:1], cell("b", "a", effort=7.0), *DIAMOND[2:]))
    with pytest.raises(
        FileError, match=r"2 of the cells .* b \(effort 'nothing' there, 7.0 now\); d \(a cell that"
    ):
        do(tmp_path, resume=True)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.json")} == before


def test_a_wider_study_keeps_what_is_done(toy: Toy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    do(tmp_path)
    plan_of(monkeypatch, (*DIAMOND, cell("f", "d")))
    summary = do(tmp_path, resume=True)
    assert (summary.kept, summary.done) == (5, 1)
    assert set(toy.done.values()) == {1}


def test_another_version_is_noticed(toy: Toy, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    do(tmp_path)
    monkeypatch.setattr("vic_toolbox.__version__", "99.0")
    with pytest.raises(FileError, match=r"5 of the cells .*version .* there, 99.0 now"):
        do(tmp_path, resume=True)


def test_a_cell_deleted_by_hand_is_done_again(toy: Toy, tmp_path: Path):
    do(tmp_path)
    for path in (tmp_path / "cells" / "b").iterdir():
        path.unlink()
    assert do(tmp_path, resume=True).done == 1
    assert toy.done["b"] == 2


@pytest.mark.parametrize(
    "content", ["", "[]", '{"format": "vic-study/0"}', '{"format": "vic-study/1", "version": 1}']
)
def test_a_damaged_description_is_refused(toy: Toy, tmp_path: Path, content: str):
    do(tmp_path)
    (tmp_path / "study.json").write_text(content)
    with pytest.raises(FileError, match=r"study\.json"):
        StudyFolder.open(tmp_path)
    with pytest.raises(FileError, match=r"study\.json"):
        do(tmp_path, resume=True)


@pytest.mark.parametrize("content", ["{", "3", "{}", '{"format": "vic-cell/1", "cell": {"kind": "a"}}'])
def test_a_damaged_result_is_named(toy: Toy, tmp_path: Path, content: str):
    do(tmp_path)
    (tmp_path / "cells" / "b" / "result.json").write_text(content)
    with pytest.raises(FileError, match=r"cells/b/result\.json"):
        StudyFolder.open(tmp_path).results()


def test_a_second_runner_is_refused(toy: Toy, tmp_path: Path):
    do(tmp_path)
    code = (
        "import fcntl, os, sys\n"
        f"fcntl.flock(os.open({str(tmp_path / '.lock')!r}, os.O_RDWR), fcntl.LOCK_EX)\n"
        "print('ready', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        with pytest.raises(FileError, match="in use by another process"):
            do(tmp_path, resume=True)
        other.kill()
    assert do(tmp_path, resume=True).kept == 5


# status ----------------------------------------------------------------------------------------------


def test_status_tells_running_cells_from_interrupted_ones(toy: Toy, tmp_path: Path):
    do(tmp_path)
    for name in ("b", "d"):
        for path in (tmp_path / "cells" / name).iterdir():
            path.unlink()
    with present(tmp_path / "cells" / "b"):
        status = read_status(StudyFolder.open(tmp_path))
        assert [name for name, _ in status.running] == ["b"]
        assert (status.total.done, status.total.running, status.total.waiting) == (3, 1, 1)
        assert status.left > 0
    nobody = 2**30  # more than any system numbers
    sign = {"pid": nobody, "host": socket.gethostname(), "began": 0.0, "beat": time.time(), "seconds": 7.0}
    write_json(tmp_path / "cells" / "b" / FILE, sign | {"note": "", "cells": [], "over": False})
    status = read_status(StudyFolder.open(tmp_path))
    assert [(name, here.seconds) for name, here in status.stale] == [("b", 7.0)]
    assert status.total.running == 0


def test_a_process_of_another_machine_is_gone_when_it_is_silent(tmp_path: Path):
    sign = {
        "pid": 1,
        "host": "elsewhere",
        "began": 0.0,
        "seconds": 0.0,
        "note": "",
        "cells": [],
        "over": False,
    }
    write_json(tmp_path / FILE, sign | {"beat": time.time()})
    here = presence(tmp_path)
    assert here is not None
    assert here.alive
    write_json(tmp_path / FILE, sign | {"beat": time.time() - 1000.0})
    here = presence(tmp_path)
    assert here is not None
    assert not here.alive


@pytest.mark.parametrize("content", ["", "{}", "[]", '{"pid": '])
def test_a_damaged_sign_of_life_is_none(tmp_path: Path, content: str):
    (tmp_path / FILE).write_text(content)
    assert presence(tmp_path) is None


def test_time_of_interrupted_pieces_is_counted(tmp_path: Path):
    sign = {
        "pid": 1,
        "host": "x",
        "began": 0.0,
        "beat": 0.0,
        "seconds": 100.0,
        "note": "",
        "cells": [],
        "over": False,
    }
    write_json(tmp_path / FILE, sign)
    with present(tmp_path) as table:
        pass
    assert table["seconds"] >= 100.0
    assert not (tmp_path / FILE).exists()
    with pytest.raises(ZeroDivisionError), present(tmp_path):
        raise ZeroDivisionError
    here = presence(tmp_path)
    assert here is not None
    assert here.over
    assert not here.alive
    with present(tmp_path) as table:
        assert table["seconds"] >= here.seconds


def test_an_interrupted_study_says_so_and_goes_on(toy: Toy, tmp_path: Path):
    class Interrupting(Toy):
        def run(self, cell: Cell, folder: Path, study: Path) -> dict[str, Any]:
            if cell.name == "c" and not self.done["c"]:
                os.kill(os.getpid(), signal.SIGINT)
            return super().run(cell, folder, study)

    kind = Interrupting()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work, "kind_of", lambda _: kind)
        with pytest.raises(KeyboardInterrupt):
            do(tmp_path)
    assert set(values(tmp_path)) == {"a", "c"}  # the cell under way was finished
    assert do(tmp_path, resume=True).complete


def test_a_definition_that_cannot_be_planned_makes_no_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def refuse(_: Any) -> Plan:
        raise FileError("no")

    monkeypatch.setattr(study_folder, "make_plan", refuse)
    with pytest.raises(FileError, match="no"):
        StudyFolder.create(tmp_path / "new", tiny())
    assert not (tmp_path / "new").exists()


def test_the_identity_is_complete(toy: Toy, tmp_path: Path):
    do(tmp_path)
    stored = read_json(tmp_path / "study.json")
    assert stored["definition"] == json.loads(json.dumps(tiny().to_json()))
    assert StudyFolder.open(tmp_path).definition == tiny()
    assert SimpleNamespace(**stored).format == "vic-study/1"
