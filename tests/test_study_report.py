"""What a reader sees of a study: statistics, tables, findings, and the files of the report."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.study_results import definition, write_study
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.figures.study_learning import Curves, mean_curve
from vic_toolbox.experiments.figures.study_table import Dot, DotRow, dots
from vic_toolbox.experiments.intervals import wilson_interval
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.experiments.study import results_json
from vic_toolbox.experiments.study.comparison import better_rivals, standing
from vic_toolbox.experiments.study.definition import (
    CONTROLS,
    METRICS,
    TWIN_CONTROLS,
    Budget,
    Study,
    Table,
    load,
)
from vic_toolbox.experiments.study.findings import headline, of_table
from vic_toolbox.experiments.study.folder import Result, StudyFolder, write_result
from vic_toolbox.experiments.study.kinds import KINDS, kind_of
from vic_toolbox.experiments.study.metric import metric
from vic_toolbox.experiments.study.plan import Entry
from vic_toolbox.experiments.study.report import report
from vic_toolbox.experiments.study.statistics import mean_estimate, rate_estimate
from vic_toolbox.experiments.study.table import ResultTable, make_tables

RATES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8)
LENGTHS = st.lists(st.floats(0.0, 1e3), min_size=1, max_size=8)


# --- statistics --------------------------------------------------------------------------------------------------


def test_interval_of_a_mean_by_hand():
    found = mean_estimate([1.0, 2.0, 3.0, 4.0, 5.0])
    half = 2.7764451 * math.sqrt(2.5) / math.sqrt(5.0)  # t of 97.5 % with 4 degrees of freedom, from a table
    assert found.mean == 3.0
    assert (found.low, found.high) == pytest.approx((3.0 - half, 3.0 + half), rel=1e-7)
    assert found.best3 == 2.0
    assert found.seeds == 5


def test_interval_of_a_rate_by_hand():
    p, k, t = 0.8, 5, 2.7764451
    found = rate_estimate([1.0, 1.0, 1.0, 1.0, 0.0], episodes=100)
    n = p * (1 - p) / (0.2 / k)  # the variance of the seeds is 0.2
    middle, half = p + t**2 / (2 * n), t * math.sqrt(p * (1 - p) / n + t**2 / (4 * n**2))
    wanted = (middle - half) / (1 + t**2 / n), (middle + half) / (1 + t**2 / n)
    assert (found.low, found.high) == pytest.approx(wanted, rel=1e-6)
    assert found.best3 == 1.0


def test_seeds_that_agree_leave_what_the_starts_leave_open():
    found = rate_estimate([1.0] * 5, episodes=100)
    assert (found.low, found.high) == wilson_interval(1.0, 100)
    assert rate_estimate([0.0] * 5, episodes=20).high == pytest.approx(wilson_interval(0.0, 20)[1])


@given(RATES, st.integers(1, 1000))
def test_interval_of_a_rate_holds_its_mean_and_stays_a_rate(rates: list[float], episodes: int):
    found = rate_estimate(rates, episodes=episodes)
    assert found.low is not None
    assert found.high is not None
    assert 0.0 <= found.low <= found.mean + 1e-12
    assert found.mean - 1e-12 <= found.high <= 1.0
    low, high = wilson_interval(found.mean, episodes)
    assert found.low <= low
    assert found.high >= high


@given(RATES, st.integers(1, 1000))
def test_success_and_failure_are_alike(rates: list[float], episodes: int):
    one = rate_estimate(rates, episodes=episodes)
    other = rate_estimate([1.0 - rate for rate in rates], episodes=episodes)
    assert one.low is not None
    assert other.high is not None
    assert one.low == pytest.approx(1.0 - other.high, abs=1e-6)


@given(LENGTHS, st.randoms(use_true_random=False))
def test_a_mean_does_not_depend_on_the_order_of_the_seeds(values: list[float], random):
    shuffled = random.sample(values, len(values))
    one, other = mean_estimate(values, lowest=0.0), mean_estimate(shuffled, lowest=0.0)
    assert one.mean == pytest.approx(other.mean)
    assert (one.best3 is None) == (len(values) < 3)
    assert one.best3 is None or one.best3 <= one.mean * (1.0 + 1e-12)
    if one.low is not None and one.high is not None:
        assert 0.0 <= one.low <= one.mean * (1.0 + 1e-12)
        assert one.high >= one.mean * (1.0 - 1e-12)


def test_the_interval_of_a_rate_covers_the_truth():
    """95 % of studies of five seeds, whose policies differ, have the true mean inside."""
    rng = np.random.default_rng(0)
    for a, b in ((8.0, 2.0), (3.0, 3.0), (60.0, 3.0)):
        seeds = rng.beta(a, b, size=(400, 5))
        counts = rng.binomial(100, seeds) / 100.0
        found = [rate_estimate(rates.tolist(), episodes=100) for rates in counts]
        inside = np.mean([f.low <= a / (a + b) <= f.high for f in found])  # type: ignore[operator]
        assert inside > 0.92


@pytest.mark.parametrize("bad", [[], [1.5], [-0.1], [float("nan")], ["much"]])
def test_what_is_no_rate_is_refused(bad: list):
    with pytest.raises(InputError):
        rate_estimate(bad, episodes=10)


def test_a_number_is_compared_at_the_decimals_of_the_paper():
    success, difference = metric("success"), metric("difference")
    assert success.reaches(0.98300001, 0.983)
    assert success.reaches(0.9826, 0.983)
    assert not success.reaches(0.982, 0.983)
    assert difference.reaches(0.0149, 0.01)
    assert not difference.reaches(0.0151, 0.01)


# --- tables ------------------------------------------------------------------------------------------------------


def outcome(entry: Entry) -> float:
    """Gain-AIRL is good, cloning middling, and −6° is harder than the paper says; the seeds differ."""
    base = {"airl": 0.94, "bc": 0.8, "constant": 0.3, "untrained": 0.0, "expert": 1.0, "matched": 1.0}
    rate = base.get(entry.method, 0.5)
    if entry.scenario == "tilt=-6":
        rate -= 0.08 * (entry.method == "airl")
    if "random reward" in entry.row:
        rate -= 0.4
    if entry.table == "III":
        rate = 1.0 - rate
    return max(rate + 0.02 * ((entry.seed or 2) - 2), 0.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> StudyFolder:
    return write_study(tmp_path_factory.mktemp("study") / "small", definition(), outcome)


def tables_of(folder: StudyFolder) -> dict[str, ResultTable]:
    made = make_tables(folder.definition, folder.plan, folder.results())
    return {table.name: table for table in made}


def test_rows_are_called_as_in_the_paper(folder: StudyFolder):
    names = [row.name for row in tables_of(folder)["I"].of_role("method")]
    assert names == [
        "Gain-AIRL", "Gain-BC", "Force-AIRL", "Force-BC",
        "Gain-AIRL-His", "Gain-BC-His", "Force-AIRL-His", "Force-BC-His", "Constant gain",
    ]  # fmt: skip


def test_a_cell_is_the_mean_of_its_seeds_beside_the_paper(folder: StudyFolder):
    table = tables_of(folder)["I"]
    row = table.row("Gain-AIRL")
    assert row is not None
    cell = row.cells["tilt=-6"]
    assert cell.values == pytest.approx((0.84, 0.86, 0.88))
    assert cell.estimate == rate_estimate(cell.values, episodes=50)
    assert cell.paper == 0.917
    assert standing(table, cell) == "open"  # 91.7 lies inside its interval
    assert standing(table, row.cells["train"]) == "below"  # 98.3 does not
    moved = folder.plan.by_name["peg-in-hole/transfer/gain-airl-seed1/tilt=-6/learned"]
    assert cell.iterations == moved.settings["transfer"]["iterations"]
    assert row.cells["train"].iterations != cell.iterations


def test_controls_and_checks_stand_apart(folder: StudyFolder):
    table = tables_of(folder)["I"]
    controls = {row.name for row in table.of_role("control")}
    assert {"Gain-AIRL, random reward", "Gain-AIRL, fresh policy, random reward", "Expert"} <= controls
    assert not any(cell.paper is not None for row in table.of_role("control") for cell in row.cells.values())
    checks = table.of_role("check")
    assert all(set(row.cells) == {"tilt=-6"} for row in checks)
    assert "Gain-BC, half the time step" in {row.name for row in checks}


def test_the_best_rival_is_found_whatever_is_better(folder: StudyFolder):
    for table in tables_of(folder).values():  # more is better in one of them, less in the other
        cloned, learned = table.row("Gain-BC"), table.row("Gain-AIRL")
        assert cloned is not None
        assert learned is not None
        assert [row.name for row in better_rivals(table, cloned, "train")] == ["Gain-AIRL", "Force-AIRL"]
        assert better_rivals(table, learned, "train") == []


def test_findings_come_from_the_numbers(folder: StudyFolder):
    tables = tables_of(folder)
    said = {finding.text: finding for finding in of_table(tables["I"])}
    lead = "Gain-AIRL: the paper's number is reached in 0 of 3 scenarios."
    assert said[lead].kind == "warning"
    assert "tilt=-6: 86.0" in said[lead].more
    assert "Gain-AIRL: no other method is better in any scenario." in said
    better = "Gain-AIRL: the learned reward does better than a random one in tilt=-6, tilt=2."
    assert said[better].kind == "note"
    assert "tilt=2: 94.0 against 54.0" in said[better].more
    assert headline(tuple(tables.values())).startswith(
        "Gain-AIRL: reaches the paper's number in 1 of 5 cells"
    )


def test_a_control_that_does_as_well_is_told(tmp_path: Path):
    level = write_study(tmp_path / "level", definition(), lambda entry: 1.0 if entry.table == "I" else 0.0)
    said = {finding.text: finding.kind for finding in of_table(tables_of(level)["I"])}
    assert said["Gain-AIRL: a random reward does as well as the learned one in tilt=-6, tilt=2."] == "warning"
    assert said["Gain-AIRL: the transfer changes nothing in tilt=-6, tilt=2."] == "note"
    assert any("untrained with noise succeeds in tilt=-6 (100 %)" in text for text in said)


# --- an unfinished study -----------------------------------------------------------------------------------------


def half(entry: Entry) -> float | None:
    return None if entry.seed == 3 and entry.method == "airl" else outcome(entry)


def test_what_is_missing_is_never_averaged(tmp_path: Path):
    folder = write_study(tmp_path / "half", definition(), half)
    lost = next(e.cell for e in folder.plan.entries if e.row == "Gain-AIRL" and e.seed == 3)
    folder.write_failure(lost, ["Traceback\nSimulationError: it blew up"])
    table = make_tables(folder.definition, folder.plan, folder.results(), failed={lost})[0]
    row, other = table.row("Gain-AIRL"), table.row("Gain-BC")
    assert row is not None
    assert other is not None
    cell = row.cells["tilt=-6"]
    assert (cell.estimate, cell.done, cell.wanted, cell.failed) == (None, 2, 3, 1)
    assert standing(table, cell) is None
    assert other.cells["tilt=-6"].estimate is not None
    cells = results_json.cells([table])
    own = next(
        c for c in cells if c["method"] == "Gain-AIRL" and c["history"] == 1 and c["scenario"] == "tilt=-6"
    )
    assert own["mean"] is None
    assert own["best3"] is None
    assert own["seeds"] == 2
    report(folder, tmp_path / "out")
    text = (tmp_path / "out" / "small.md").read_text()
    assert "2 of 3 seeds, 1 failed" in text
    assert "The study is not finished" in text
    assert "2 of 3 seeds, 1 failed" in (tmp_path / "out" / "report.html").read_text()


def test_a_study_without_any_result_has_a_report(tmp_path: Path):
    report(write_study(tmp_path / "empty", definition(), lambda _: None), tmp_path / "out")
    assert "0 of 3 seeds" in (tmp_path / "out" / "small.md").read_text()


def test_a_result_without_its_number_is_refused(tmp_path: Path):
    folder = write_study(tmp_path / "bad", definition(), outcome)
    path = folder.cell_path(folder.plan.entries[0].cell) / "result.json"
    value = json.loads(path.read_text())
    del value["values"]["success_rate"]
    path.write_text(json.dumps(value))
    with pytest.raises(FileError, match="success_rate"):
        tables_of(folder)


# --- the files ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def out(folder: StudyFolder, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report")
    report(folder, path)
    return path


def test_the_json_is_a_list_of_cells(folder: StudyFolder, out: Path):
    cells = results_json.read_cells(out / "small.json")
    assert [*cells[0]] == list(results_json.KEYS)
    keys = [(cell["table"], cell["method"], cell["history"], cell["scenario"]) for cell in cells]
    assert len(set(keys)) == len(keys)
    for cell in cells:
        assert cell["metric"] in METRICS
        assert cell["seeds"] in (1, 3)
        if cell["low"] is not None:
            assert cell["low"] <= cell["mean"] <= cell["high"]
    own = next(
        cell
        for cell in cells
        if cell["table"] == "I" and cell["method"] == "Gain-AIRL" and cell["history"] == 5
    )
    assert own["scenario"] == "tilt=-6"
    assert own["paper"] == 1.0
    assert own["mean"] == pytest.approx(0.86)
    assert own["iterations"] > 0
    assert {cell["table"] for cell in cells} == {"I", "III"}


@pytest.mark.parametrize("bad", ['{"a": 1}', '[{"table": "I"}]', "[1]", "no JSON"])
def test_another_json_is_refused(bad: str, tmp_path: Path):
    (tmp_path / "x.json").write_text(bad)
    with pytest.raises(FileError):
        results_json.read_cells(tmp_path / "x.json")


def test_the_markdown_shows_mean_interval_paper_and_best_three(out: Path):
    text = (out / "small.md").read_text()
    row = next(line for line in text.splitlines() if line.startswith("| Gain-AIRL |"))
    found = rate_estimate([0.84, 0.86, 0.88], episodes=50)
    interval = f"[{100 * (found.low or 0):.1f}, {100 * (found.high or 0):.1f}]"
    assert f"86.0<br>{interval}<br>paper 91.7<br>best three 86.0" in row.replace("\N{NO-BREAK SPACE}", " ")
    assert "Made by `vic study run small.toml --out DIR`" in text
    assert "a processor, 4 cores" in text
    for link in re.findall(r"\]\(([^)]+)\)", text):
        assert (out / link).is_file()


class _Reader(HTMLParser):
    """Follows the nesting of elements and collects what a page refers to."""

    VOID = frozenset({"meta", "img", "br", "link", "source"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value or "" for name, value in attrs if name in ("src", "href")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_is_well_formed_and_needs_no_other_file(out: Path):
    page = (out / "report.html").read_text()
    reader = _Reader()
    reader.feed(page)
    assert reader.open == []
    assert reader.references
    assert all(reference.startswith("data:") for reference in reader.references)
    assert "@import" not in page
    assert "<script" not in page


def test_a_new_report_replaces_the_old_one_and_nothing_else(folder: StudyFolder, tmp_path: Path):
    report(folder, tmp_path)
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "small_figures" / "old.svg").write_text("<svg/>")
    before = {path.name: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    report(folder, tmp_path)
    after = {path.name: path.read_bytes() for path in tmp_path.rglob("*.*") if path.is_file()}
    assert before.keys() - after.keys() == {"old.svg"}
    assert all(after[name] == before[name] for name in after)  # the same results give the same bytes


# --- figures -----------------------------------------------------------------------------------------------------


def test_the_mean_curve_ends_where_the_first_seed_does():
    iterations = [np.array([1.0, 10, 20, 30]), np.array([1.0, 10, 20])]
    curves = Curves(iterations, [np.array([0.0, 1, 2, 3]), np.array([2.0, 3, 4])], expert=5.0)
    common, mean = mean_curve(curves)
    assert common.tolist() == [1, 10, 20]
    assert mean.tolist() == [1, 2, 3]


def test_a_picture_of_a_table_has_the_paper_only_where_there_is_one():
    row = DotRow("A", "airl", False, {"x": Dot(50.0, 40.0, 60.0, None)})
    with_paper = DotRow("B", "bc", False, {"x": Dot(50.0, None, None, 70.0)})
    for rows, entries in (([row], 2), ([row, with_paper], 3)):
        drawing = dots(rows, ["x"], label="success [%]", rate=True)
        assert len(drawing.legends[0].get_texts()) == entries
        assert [text.get_text() for text in drawing.axes[0].get_yticklabels()] == [r.name for r in rows]


def test_a_logarithmic_picture_keeps_what_is_zero():
    row = DotRow("A", "airl", False, {"x": Dot(0.0, 0.0, 0.01, 0.1), "y": Dot(0.02, None, None, None)})
    drawing = dots([row], ["x", "y"], label="difference", rate=False)
    low, _ = drawing.axes[0].get_xlim()
    assert low > 0.0
    shown = [line.get_xdata() for line in drawing.axes[0].get_lines()]
    assert all(np.min(np.asarray(x, dtype=float)) >= low for x in shown)


def test_runs_in_the_folder_are_drawn(tmp_path: Path):
    """A study of a few steps: learning curves, gains and what the task has of its own; and a run that is gone."""
    study = definition(
        seeds=[1, 2],
        budget={"peg-in-hole": {"episodes": 1, "demonstrations": 2, "held_out": 1, "environments": 2, "iterations": 2,
                                "cloning_steps": 10}},
        table=[{"name": "I", "title": "t", "task": "peg-in-hole", "metric": "success", "scenarios": ["train"],
                "actions": ["gain"]}],
    )  # fmt: skip
    with StudyFolder.create(tmp_path / "run", study) as folder:
        for cell in folder.cells:
            values = kind_of(cell).run(cell, folder.cell_path(cell.name), folder.path)
            write_result(folder.cell_path(cell.name), Result(cell, values, 1.0, "0", "a processor"))
    report(folder, tmp_path / "out")
    drawn = {path.name for path in (tmp_path / "out" / "small_figures").iterdir()}
    assert {"learning.svg", "peg-in-hole-gain.svg", "peg-in-hole-gain-insertion.svg", "table-I.svg"} <= drawn
    shutil.rmtree(folder.cell_path("peg-in-hole/train/gain-airl-seed1") / "run")
    report(folder, tmp_path / "out")
    assert (
        "Not drawn, since the run is no longer in the folder (1)"
        in (tmp_path / "out" / "report.html").read_text()
    )


# --- documentation -----------------------------------------------------------------------------------------------


def test_the_documentation_has_every_key():
    text = (Path(__file__).parents[1] / "docs" / "studies.md").read_text()
    keys = [
        field.name for kind in (Study, Table, Budget, SessionSettings) for field in dataclasses.fields(kind)
    ]
    words = [*keys, *CONTROLS, *TWIN_CONTROLS, *METRICS, *KINDS]
    assert [word for word in words if not re.search(rf"`[^`\n]*\b{word}\b[^`\n]*`", text)] == []
    assert [key for key in results_json.KEYS if f'"{key}"' not in text] == []


def test_the_committed_results_have_every_cell_of_the_paper_with_all_seeds():
    root = Path(__file__).parents[1]
    study = load(root / "studies" / "paper.toml")
    cells = results_json.read_cells(root / "docs" / "results" / "paper.json")
    found = [cell for cell in cells if cell["paper"] is not None]
    wanted = [(table.name, number) for table in study.table for row in table.paper.values() for number in row]
    assert sorted((cell["table"], cell["paper"]) for cell in found) == sorted(wanted)
    assert all(cell["mean"] is not None for cell in found)
    assert {cell["seeds"] for cell in found if cell["method"] != "Constant gain"} == {len(study.seeds)}
