"""The demonstration: from the expert to a report, and on from wherever it was stopped."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.experiment_runs import figures, tiny
from vic_toolbox.errors import DependencyError, FileError
from vic_toolbox.experiments import demo as demo_module
from vic_toolbox.experiments import film as film_module
from vic_toolbox.experiments.demo import DemoConfiguration, run_demo
from vic_toolbox.experiments.progress import Progress


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch):  # type: ignore[no-untyped-def]
    """Tiny runs whose own reports have no figures, and a film of a few drawn pictures."""

    def absent(*_: object, **__: object) -> None:
        raise DependencyError("no OpenGL to draw with.")

    monkeypatch.setattr(demo_module, "_configuration", lambda demo, method: tiny(method, seed=demo.seed))
    monkeypatch.setattr(film_module, "Renderer", absent)
    monkeypatch.setattr(film_module, "FPS", 4)
    with figures(drawn=False):
        yield


class Breaking(Progress):
    """Breaks off when a stage of that name begins."""

    def __init__(self, at: str):
        self.at = at

    def stage(self, title: str, *_: object, **__: object) -> None:
        if title.startswith(self.at):
            raise KeyboardInterrupt


@pytest.mark.usefixtures("small")
def test_a_stopped_demonstration_goes_on_and_ends_with_its_report(tmp_path: Path):
    configuration, out = DemoConfiguration(seed=2), tmp_path / "demo"
    with pytest.raises(KeyboardInterrupt):
        run_demo(configuration, out, threads=1, progress=Breaking("transfer"))
    assert (out / "airl" / "report.html").exists()
    finished_before = (out / "airl" / "policy.safetensors").stat().st_mtime_ns
    demo = run_demo(configuration, out, threads=1)
    assert (out / "airl" / "policy.safetensors").stat().st_mtime_ns == finished_before
    page = demo.report.read_text()
    assert demo.report == out / "report.html"
    assert "data:video/mp4;base64," in page
    assert "Drawn, not rendered" in page
    wanted = (
        "On the training start",
        "On the unseen start T1",
        "AIRL, after transfer",
        "cloning (BC)",
        "constant gain",
        "Gains over time, T1",
        "Paths in space",
        "Forces",
        "What the reward values",
    )
    for text in wanted:
        assert text in page
    assert len(demo.next_steps) == 3
    assert all(command.startswith("vic ") for command, _ in demo.next_steps)
    assert run_demo(configuration, out) == demo  # complete: nothing is done again
    with pytest.raises(FileError, match=r"configuration.seed \(2 there, 3 now\)"):
        run_demo(DemoConfiguration(seed=3), out)


def test_quick_means_a_tenth():
    whole, quick = (demo_module._configuration(DemoConfiguration(quick=q), "airl") for q in (False, True))
    assert quick.recipe.airl.iterations == whole.recipe.airl.iterations // 10
    assert quick.recipe.transfer.iterations == whole.recipe.transfer.iterations // 10
