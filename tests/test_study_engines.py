"""Real processes: whatever is killed, and wherever cells are done, the numbers are the same."""

from __future__ import annotations

import contextlib
import functools
import json
import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from tests.study_files import TINY, tiny, write
from vic_toolbox.errors import DependencyError, InputError
from vic_toolbox.experiments.study.definition import load
from vic_toolbox.experiments.study.engines import JoblibEngine, Lost, RayEngine
from vic_toolbox.experiments.study.execution import Summary, execute
from vic_toolbox.experiments.study.folder import StudyFolder
from vic_toolbox.experiments.study.kinds import KINDS
from vic_toolbox.experiments.study.progress import StudyProgress
from vic_toolbox.experiments.study.report import report
from vic_toolbox.experiments.study.status import read_status

TRAINED = "peg-in-hole/train/gain-airl-seed30"
VIC = [sys.executable, "-m", "vic_toolbox"]


def never() -> bool:
    return False


def twice(number: int) -> int:
    return 2 * number


def suicidal(number: int) -> int:
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def slow(number: int) -> int:
    time.sleep(30.0)
    return number


def environment(_: int) -> dict[str, str | None]:
    return {name: os.environ.get(name) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")}


def exploding(number: int) -> int:
    raise ZeroDivisionError(number)


# joblib ----------------------------------------------------------------------------------------------


def test_processes_yield_every_answer_as_it_comes():
    answers = dict(JoblibEngine(2).map(twice, iter(range(5)), stopped=never))
    assert answers == {number: 2 * number for number in range(5)}
    assert dict(JoblibEngine(1).map(environment, iter([0]), stopped=never))[0] == {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
    }


def test_a_process_that_dies_takes_only_its_own_job_with_it():
    answers = dict(JoblibEngine(2).map(suicidal, iter(range(6)), stopped=never))
    lost = answers.pop(3)
    assert isinstance(lost, Lost)
    assert "SIGKILL" in lost.reason
    assert answers == {number: number for number in (0, 1, 2, 4, 5)}


def test_none_waits_for_what_is_under_way():
    queue: list[int | None] = [1, None, 2]
    answers = dict(JoblibEngine(2).map(twice, iter(queue), stopped=never))
    assert answers == {1: 2, 2: 4}


def test_an_error_of_the_function_is_the_callers():
    with pytest.raises(ZeroDivisionError):
        dict(JoblibEngine(1).map(exploding, iter([1]), stopped=never))


def test_stopping_ends_the_processes_soon():
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        dict(JoblibEngine(1).map(slow, iter([1]), stopped=lambda: time.monotonic() - began > 2.0))
    assert time.monotonic() - began < 20.0


@pytest.mark.parametrize("jobs", [-1, 1.5, True])
def test_a_number_of_processes_is_an_integer(jobs: Any):
    with pytest.raises(InputError, match="jobs"):
        JoblibEngine(jobs)
    assert JoblibEngine(0).slots >= 1


def test_ray_is_asked_for_when_it_is_missing(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(DependencyError, match=r"ray is not installed.*pip install 'vic-toolbox\[cluster\]'"):
        RayEngine()


# whole studies ---------------------------------------------------------------------------------------


@functools.cache
def values(folder: Path) -> str:
    """The values of every result, as text: to be compared to the last digit."""
    results = StudyFolder.open(folder).results()
    return json.dumps({name: result.values for name, result in results.items()}, sort_keys=True)


@pytest.fixture(scope="module")
def unbroken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny study, done without trouble."""
    path = tmp_path_factory.mktemp("studies") / "unbroken"
    with StudyFolder.create(path, tiny()) as folder:
        summary = execute(folder, JoblibEngine(2))
    assert summary.complete
    return path


class Killer(StudyProgress):
    """Kills the process that trains, once, a moment after it began; remembers what was said."""

    def __init__(self, folder: Path) -> None:
        self.said: list[str] = []
        self.killed = 0
        self._file = folder / "cells" / TRAINED / "running.json"
        self._metrics = folder / "cells" / TRAINED / "run" / "metrics.jsonl"
        threading.Thread(target=self._kill, daemon=True).start()

    def say(self, text: str) -> None:
        self.said.append(text)

    def _kill(self) -> None:
        while not (self._metrics.exists() and self._metrics.stat().st_size):
            time.sleep(0.02)
        self.killed = json.loads(self._file.read_text())["pid"]
        os.kill(self.killed, signal.SIGKILL)


def survives(path: Path, engine: Any) -> Summary:
    """Do the tiny study while a worker is killed."""
    killer = Killer(path)
    with StudyFolder.create(path, tiny()) as folder:
        summary = execute(folder, engine, progress=killer)
    assert killer.killed
    assert killer.killed != os.getpid()
    assert len(killer.said) == 1
    assert killer.said[0].startswith(f"{TRAINED} failed and is tried once more")
    return summary


@pytest.mark.slow
def test_a_killed_process_does_not_change_the_study(unbroken: Path, tmp_path: Path):
    assert survives(tmp_path / "study", JoblibEngine(2)).complete
    assert values(tmp_path / "study") == values(unbroken)


@contextlib.contextmanager
def cluster() -> Iterator[None]:
    """A real Ray cluster of two workers."""
    ray = pytest.importorskip("ray", reason="ray is not installed: pip install 'vic-toolbox[cluster]'")
    ray.init(address="local", num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        yield
    finally:
        ray.shutdown()


@pytest.mark.slow
def test_a_cluster_with_a_killed_worker_has_the_same_table(unbroken: Path, tmp_path: Path):
    with cluster():
        engine = RayEngine()
        assert engine.slots == 2
        assert survives(tmp_path / "study", engine).complete
        assert values(tmp_path / "study") == values(unbroken)
        with StudyFolder.create(tmp_path / "away", tiny()) as folder:
            folder.token = "of a place that no worker sees"
            assert execute(folder, engine).complete
        assert values(tmp_path / "away") == values(unbroken)
        with pytest.raises(KeyboardInterrupt):
            dict(engine.map(slow, iter([1]), stopped=lambda: True))


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_an_error():
    pytest.importorskip("ray", reason="ray is not installed: pip install 'vic-toolbox[cluster]'")
    with socket.create_server(("127.0.0.1", 0)) as free:  # closed again, nothing listens there
        address = f"127.0.0.1:{free.getsockname()[1]}"
    with pytest.raises(InputError, match=f"no Ray cluster at '{address}'.*ray start --head"):
        RayEngine(address)
    for wrong in ("here", ":6379", "127.0.0.1:", "127.0.0.1:99999"):
        with pytest.raises(InputError, match="pass auto, or HOST:PORT"):
            RayEngine(wrong)


@pytest.mark.slow
def test_ten_kills_of_the_runner_leave_the_same_numbers(unbroken: Path, tmp_path: Path):
    draw = random.Random(8)
    out, file = tmp_path / "study", write(tmp_path)
    line = [*VIC, "study", "run", str(file), "--out", str(out), "--jobs", "2", "--resume"]
    kills = 0
    while kills < 10:
        with subprocess.Popen(line, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as runner:
            _wait_for_work(out, runner)
            time.sleep(draw.uniform(0.0, 1.5))
            if runner.poll() is None:
                runner.kill()
                kills += 1
                continue
        if runner.returncode == 0:  # it was done before the tenth: take something away again
            _undo(out, draw)
    status = read_status(StudyFolder.open(out))
    assert status.runner is not None
    assert not status.runner.alive
    subprocess.run(line, check=True, capture_output=True, timeout=300)
    assert values(out) == values(unbroken)
    assert read_status(StudyFolder.open(out)).total.done == len(StudyFolder.open(out).cells)


def _wait_for_work(out: Path, runner: subprocess.Popen[bytes]) -> None:
    """Until some cell is under way: a kill while the runner still imports would show nothing."""
    while runner.poll() is None and not list((out / "cells").rglob("running.json")):
        time.sleep(0.02)


def _undo(out: Path, draw: random.Random) -> None:
    results = sorted((out / "cells").rglob("result.json"))
    for path in draw.sample(results, 4):
        path.unlink()


@pytest.mark.slow
def test_the_quick_study_at_its_smallest_ends_with_its_report(tmp_path: Path):
    quick = load("quick")
    little = {
        "episodes": 1,
        "iterations": 1,
        "environments": 2,
        "cloning_steps": 10,
        "transfer_iterations": 1,
        "fresh_iterations": 1,
    }
    study = replace(
        quick,
        seeds=quick.seeds[:1],
        budget={task: replace(budget, **little) for task, budget in quick.budget.items()},
        table=tuple(replace(table, sweeps=()) for table in quick.table),
    )
    with StudyFolder.create(tmp_path, study) as folder:
        summary = execute(folder, JoblibEngine(2))
        assert summary.complete, summary.failures
        assert {cell.kind for cell in folder.cells} == set(KINDS) - {"sweep"}
        report(folder, tmp_path)
    assert (tmp_path / "report.html").stat().st_size > 10_000
    assert json.loads((tmp_path / "quick.json").read_text())


@pytest.mark.slow
def test_ctrl_c_stops_cleanly_and_says_how_to_go_on(tmp_path: Path):
    long = TINY.replace("iterations = 12\ncloning", "iterations = 2000\ncloning")
    out, file = tmp_path / "study", write(tmp_path, long)
    line = [*VIC, "study", "run", str(file), "--out", str(out), "--jobs", "2"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True) as runner:
        while not (out / "cells" / TRAINED / "run" / "metrics.jsonl").exists():
            assert runner.poll() is None
            time.sleep(0.02)
        refused = subprocess.run([*line, "--resume"], capture_output=True, text=True, timeout=120)
        assert refused.returncode == 2
        assert "in use by another process" in refused.stderr
        runner.send_signal(signal.SIGINT)
        _, said = runner.communicate(timeout=60)
    assert runner.returncode == 130
    assert f"Go on with: vic study run {file} --out {out} --jobs 2 --resume" in said
    status = read_status(StudyFolder.open(out))
    assert not status.running
    assert TRAINED in [name for name, _ in status.stale]
    assert (out / "cells" / TRAINED / "run" / "checkpoint.safetensors").exists()
    shown = subprocess.run([*VIC, "study", "status", str(out)], capture_output=True, text=True, timeout=120)
    assert "go on with: vic study run" in shown.stdout
