"""The learner's benchmark: it measures what it says it measures, and refuses to measure nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")

from benchmarks import learner, reference_environment
from benchmarks.reference_environment import BenchmarkError, reference_python
from vic_toolbox.learning import (
    Airl,
    AirlConfiguration,
    DiscriminatorConfiguration,
    PolicySearchConfiguration,
)


@pytest.fixture
def small() -> AirlConfiguration:
    return AirlConfiguration(
        search=PolicySearchConfiguration(environments=2),
        discriminator=DiscriminatorConfiguration(steps=2, batch=8),
    )


def test_the_reference_copies_our_configuration(small):
    workload = learner.workload_of(replace(small, divergence=0.5))
    assert (workload.environments, workload.discriminator_steps, workload.discriminator_batch) == (2, 2, 8)
    assert workload.divergence == 0.5


def test_the_parts_add_up_to_the_learners_time(small):
    workload = replace(learner.workload_of(small), horizon=10)
    untouched = Airl._train_reward
    with learner.watch_learner() as watch:
        seconds = learner.our_iteration(small, workload, watch)()
    parts = ("discriminator", "relabel", "trpo", "critic", "other")
    assert all(np.all(seconds[part] > 0.0) for part in (*parts, "not_counted"))
    np.testing.assert_allclose(seconds["total"], sum(seconds[part] for part in parts))
    assert Airl._train_reward is untouched


def test_learners_take_turns():
    calls: list[str] = []

    def iteration(name: str):
        def iterate() -> dict[str, np.ndarray]:
            calls.append(name)
            return {"total": np.array([1.0, 2.0]) * len(calls)}

        return iterate

    rounds = learner.take_turns({name: iteration(name) for name in "ab"}, warm_up=1, repeats=3)
    assert "".join(calls) == "abababab"
    assert learner.medians(rounds["a"]) == {"total": 5.0, "wall": 10.0}


def test_a_folder_of_other_content_is_not_cleared(tmp_path: Path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(BenchmarkError, match="neither a Python environment nor an empty folder"):
        reference_python(tmp_path)
    assert (tmp_path / "thesis.tex").exists()


def test_a_reference_that_does_not_start_is_an_error(tmp_path: Path):
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.write_text("#!/bin/sh\necho no module named imitation >&2\nexit 1\n")
    python.chmod(0o755)
    with pytest.raises(BenchmarkError, match=r"no module named imitation[\s\S]*Nothing was measured"):
        learner.ReferenceLearner(python, learner.workload_of(AirlConfiguration()))


@pytest.mark.slow
def test_without_an_index_nothing_is_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    requirements = tmp_path / "requirements.txt"
    requirements.write_text("a-package-that-no-folder-has==1.0\n")
    monkeypatch.setattr(reference_environment, "REQUIREMENTS", requirements)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    for _ in range(2):  # a failed installation is not taken for a finished one
        with pytest.raises(BenchmarkError, match="Nothing was measured"):
            reference_python(tmp_path / "environment")
