"""Figures, films, reports and progress: what a user looks at."""

from __future__ import annotations

import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import matplotlib.pyplot
import numpy as np
import pytest
from matplotlib.figure import Figure
from rich.console import Console

from vic_toolbox.errors import DependencyError, FileError, InputError
from vic_toolbox.experiments import film as film_module
from vic_toolbox.experiments import report, task_views
from vic_toolbox.experiments.evaluation import Policy
from vic_toolbox.experiments.figures import insertion, learning, motion, placing, style
from vic_toolbox.experiments.figures.difficulty import success_curves
from vic_toolbox.experiments.figures.start_sweep import sweep_maps
from vic_toolbox.experiments.film import DRAWN, film
from vic_toolbox.experiments.progress import ConsoleProgress, Progress
from vic_toolbox.experiments.trace import Trace, record_trace
from vic_toolbox.tasks.cup_on_plate import CupOnPlate
from vic_toolbox.tasks.cup_scene import GOAL, start_angles
from vic_toolbox.tasks.peg_in_hole import PegInHole


def made_up(*, stiffness: float = 100.0, steps: int = 60) -> Trace:
    """A trace of something that creeps to the goal."""
    time = 0.01 * np.arange(steps)
    decay = np.exp(-4.0 * time)[:, None]
    error = np.concatenate([decay * [0.2, -0.45, 0.28], 0.0 * decay * [1, 1, 1]], axis=1)
    rate = -4.0 * error
    gains = np.full((steps, 6), stiffness)
    damping = 10.0 * np.sqrt(gains)
    return Trace(
        task=CupOnPlate(),
        time=time,
        error=error,
        rate=rate,
        stiffness=gains,
        damping=damping,
        feedback=-gains * error - damping * rate,
        contact=np.where(time > 0.4, 2.0, 0.0),
        joints=np.tile(start_angles((0.6, -0.05, 0.3)), (steps, 1)),
        observations=np.concatenate([error, rate], axis=1),
        score=-300.0,
    )


@pytest.fixture(scope="module")
def traces() -> dict[str, Trace]:
    return {"expert": made_up(), "airl": made_up(stiffness=120.0), "constant": made_up(stiffness=130.0)}


def texts(path: Path) -> str:
    """Everything that an SVG says about itself."""
    return ET.parse(path).getroot().tag + path.read_text()


_KINDS: dict[str, Callable[[dict], Figure]] = {
    "gains": motion.gains_over_time,
    "forces": placing.forces_over_time,
    "paths": lambda traces: placing.paths({"start": traces}),
}


@pytest.mark.parametrize("kind", _KINDS)
def test_figures_are_the_same_every_time_and_need_no_window(kind: str, traces: dict, tmp_path: Path):
    def draw(path: Path) -> bytes:
        return style.save(_KINDS[kind](traces), path).read_bytes()

    first = draw(tmp_path / "a.svg")
    assert first == draw(tmp_path / "b.svg")
    assert ET.fromstring(first).tag.endswith("svg")
    assert matplotlib.pyplot.get_fignums() == []


def test_gains_are_drawn_with_their_units(traces: dict):
    drawing = motion.gains_over_time(traces)
    titles = [axes.get_title(loc="left") for axes in drawing.axes]
    assert titles[0] == "stiffness along x  [N/m]"
    assert titles[4] == "stiffness about x  [Nm/rad]"
    assert titles[3] == "damping factor d  [√kg]"
    assert titles[7] == "distance to go  [m]"
    values = {line.get_label(): np.asarray(line.get_ydata())[0] for line in drawing.axes[0].get_lines()}
    assert values == {"expert": 100.0, "AIRL": 120.0, "constant gain": 130.0}


def test_force_policies_show_their_wrench_instead():
    force = {"expert": made_up(stiffness=0.0), "airl": made_up(stiffness=0.0)}
    assert not motion.has_gains(force)
    titles = [axes.get_title(loc="left") for axes in motion.wrench_over_time(force).axes]
    assert titles[0] == "force along x  [N]"
    assert titles[4] == "torque about x  [Nm]"


@pytest.fixture(scope="module")
def pegs() -> dict[str, Trace]:
    """The expert, who gets in, and the constant gain, which does not."""
    task = PegInHole(scenario="tilt=-6")
    return {
        "expert": record_trace(task, task.expert_action),
        "constant": record_trace(task, Policy.constant(task).act),
    }


def test_a_fixed_damping_has_no_factor_to_draw(pegs: dict):
    titles = [axes.get_title(loc="left") for axes in motion.gains_over_time(pegs).axes]
    assert titles[3] == "speed  [mm/s]"
    assert titles[7] == "distance to go  [mm]"
    assert not any("damping" in title for title in titles)


def test_the_path_of_the_tip_is_drawn_against_the_hole(pegs: dict):
    task = pegs["expert"].task
    drawing = insertion.insertion(pegs)
    path, offset, tilt, way, _ = drawing.axes
    line, *_ = path.get_lines()
    x, z = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
    tip = 1e3 * task.tip_position(pegs["expert"].observations)
    np.testing.assert_allclose(np.stack([x, z]), tip[:, [0, 2]].T)
    assert z[-1] == pytest.approx(-10.0, abs=1.0)
    inside = z < -0.41  # below the chamfer an upright peg's tip has 15 µm to either side
    assert (np.abs(x[inside]) < 0.1).all()
    wall, other = (np.asarray(patch.get_path().vertices) for patch in path.patches)
    assert np.abs(wall[:, 0]).min() == pytest.approx(0.015)
    assert (wall[:, 0] <= 0.0).all()
    assert (other[:, 0] >= 0.0).all()
    stuck = np.asarray(way.get_lines()[1].get_ydata())
    assert stuck[-1] > 5.0
    assert np.asarray(tilt.get_lines()[0].get_ydata())[0] == pytest.approx(6.0, abs=0.01)
    assert offset.get_title(loc="left") == "tip off the hole's axis  [mm]"


@pytest.mark.parametrize("task", ["cup-on-plate", "peg-in-hole", "juggling"])
def test_every_task_has_a_view_with_figures_of_its_own_or_none(task: str, traces: dict, pegs: dict):
    episodes = pegs if task == "peg-in-hole" else traces
    shown = task_views.VIEWS.get(task, task_views.ANY_TASK)
    drawings = shown.figures({"training": episodes})
    assert [drawing.file for drawing in drawings] == {
        "cup-on-plate": ["paths", "forces"], "peg-in-hole": ["insertion"], "juggling": [],
    }[task]  # fmt: skip
    assert all(drawing.caption.endswith(".") for drawing in drawings)


def test_success_is_drawn_with_its_band_and_its_area():
    values, rate = np.array([-2.0, 0.0, 4.0]), np.array([0.0, 0.5, 1.0])
    band = np.array([[0.0, 0.3, 0.8], [0.2, 0.7, 1.0]])
    drawing = success_curves(
        values, {"airl": rate}, {"airl": band}, areas={"airl": 0.58}, label="tilt  [deg]"
    )
    (axes,) = drawing.axes
    assert axes.get_xlabel() == "tilt  [deg]"
    (line,) = axes.get_lines()
    assert line.get_label() == "AIRL  (0.58)"
    np.testing.assert_allclose(np.asarray(line.get_ydata()), 100.0 * rate)


def rows(count: int, **extra: float) -> list[dict]:
    return [{"iteration": i, "score": -500.0 + i, "log_std": -0.5, **extra} for i in range(1, count + 1)]


def test_learning_curves_show_what_was_recorded():
    metrics = rows(30, action_error=0.4, discriminator_accuracy=0.7, attempt=0)
    for i in (0, 9, 19, 29):
        metrics[i]["mean_score"] = -400.0
    for row in metrics[15:]:
        row["attempt"] = 1
    drawing = learning.learning_curves(metrics, expert_score=-340.0, name="airl")
    assert drawing is not None
    assert len(drawing.axes) == 4
    restart = [line for line in drawing.axes[1].get_lines() if np.ptp(np.asarray(line.get_xdata())) == 0]
    assert [np.asarray(line.get_xdata())[0] for line in restart] == [16]


@pytest.mark.parametrize("metrics", [[], rows(1)])
def test_without_iterations_there_are_no_learning_curves(metrics: list):
    assert learning.learning_curves(metrics, expert_score=-340.0, name="constant") is None


def test_a_method_of_ones_own_gets_a_colour_and_its_name():
    assert style.look("mine").label == "mine"
    assert style.look("mine").colour == style.look("mine").colour


def test_one_policy_alone_can_be_mapped():
    starts = np.array([[0.6, 0.0, 0.3], [0.5, -0.2, 0.3]])
    drawing = sweep_maps(
        starts,
        np.array(GOAL),
        {"airl": np.array([0.1, 0.9])},
        {"airl": np.ones(2)},
        unreachable=np.empty((0, 3)),
    )
    assert len(drawing.axes) == 4


def test_a_figure_that_cannot_be_written_is_reported(traces: dict, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match=r"gains.svg"):
        style.save(placing.forces_over_time(traces), tmp_path / "file" / "gains.svg")


# --- film ----------------------------------------------------------------------------------------------------


def test_without_opengl_the_arm_is_drawn_and_the_caption_says_so(traces, tmp_path, monkeypatch):
    def absent(*_: object, **__: object) -> None:
        raise DependencyError("no OpenGL to draw with. On Linux: apt-get install libegl1.")

    monkeypatch.setattr(film_module, "Renderer", absent)
    two = {name: traces[name] for name in ("expert", "airl")}
    caption = film(tmp_path / "film.mp4", two, CupOnPlate())
    assert caption.startswith("Drawn, not rendered")
    assert "apt-get install libegl1" in caption
    assert DRAWN.split("{")[0] in caption
    content = (tmp_path / "film.mp4").read_bytes()
    assert content[4:8] == b"ftyp"
    assert len(content) > 5_000


def test_without_opengl_the_peg_is_drawn_over_its_hole(pegs, tmp_path, monkeypatch):
    def absent(*_: object, **__: object) -> None:
        raise DependencyError("no OpenGL to draw with.")

    monkeypatch.setattr(film_module, "Renderer", absent)
    monkeypatch.setattr(film_module, "FPS", 4)
    caption = film(tmp_path / "film.mp4", pegs, pegs["expert"].task)
    assert "from 151 to 2900 N/m" in caption
    assert (tmp_path / "film.mp4").stat().st_size > 5_000


def test_a_film_must_be_an_mp4(traces, tmp_path, monkeypatch):
    monkeypatch.setattr(film_module, "Renderer", lambda *_, **__: pytest.fail("must not be needed"))
    with pytest.raises(InputError, match="must end in .mp4"):
        film(tmp_path / "film.gif", traces, CupOnPlate())


# --- report --------------------------------------------------------------------------------------------------


def test_text_in_a_report_cannot_become_markup(tmp_path: Path):
    page = tmp_path / "report.html"
    bad = "<script>alert('x')</script> & \"quotes\" $tiles"
    report.write_report(
        page,
        title=bad,
        subtitle=bad,
        summary=bad,
        tiles=[(bad, bad)],
        parts=[
            report.Table(bad, [bad], [[bad]], caption=bad, marked=frozenset({0})),
            report.Note(bad),
            report.Commands(bad, [(bad, bad)]),
            report.Settings(bad, {bad: bad}),
        ],
    )
    text = page.read_text()
    assert "<script>" not in text
    assert text.count("&lt;script&gt;") == 17
    assert not re.search(r"(?:src|href)=[\"']?(?!data:)", text)


def test_a_missing_figure_leaves_the_old_report(tmp_path: Path):
    page = tmp_path / "report.html"
    page.write_text("old")
    lost = report.Figure(tmp_path / "lost.svg", "title", "caption")
    with pytest.raises(FileError, match=r"lost.svg"):
        report.write_report(page, title="t", subtitle="s", summary="x", parts=[lost])
    assert page.read_text() == "old"


# --- progress ------------------------------------------------------------------------------------------------


def test_without_a_terminal_progress_is_lines():
    text = io.StringIO()
    with ConsoleProgress(Console(file=text, width=200), interval=0.0) as progress:
        progress.stage("imitation", 4, expert_score=-342.4)
        for done in (1, 2, 3):
            progress.update(done, total=4, score=-400.0 + done)
        progress.say("[brackets] stay")
    lines = text.getvalue().splitlines()
    assert lines[0] == "imitation ..."
    assert re.fullmatch(r"  2/4, score -398 / expert -342, about \d+ s left", lines[2])
    assert "[brackets] stay" in lines
    assert re.fullmatch(r"  done in \d+ s", lines[-1])


def test_a_stage_that_breaks_off_is_not_called_done():
    text = io.StringIO()

    def broken_off() -> None:
        with ConsoleProgress(Console(file=text, width=80)) as progress:
            progress.stage("imitation", 4)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert text.getvalue() == "imitation ...\n"


def test_on_a_terminal_progress_is_bars():
    text = io.StringIO()
    with ConsoleProgress(Console(file=text, width=120, force_terminal=True)) as progress:
        progress.stage("imitation", 4, expert_score=-342.4)
        progress.update(2, score=-398.0)
        progress.stage("report")
    assert "score -398 / expert -342" in text.getvalue()


def test_the_silent_progress_says_nothing(capsys: pytest.CaptureFixture):
    with Progress() as progress:
        progress.stage("x", 3, expert_score=-1.0)
        progress.update(1, score=-2.0)
        progress.say("hello")
    assert capsys.readouterr() == ("", "")
