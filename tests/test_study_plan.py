"""From a definition to cells: each thing is done once, and everything that it depends on is in it."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import pytest

from tests.study_files import tiny
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.experiments.configuration import RunConfiguration, from_json
from vic_toolbox.experiments.study.cell import Cell, digests
from vic_toolbox.experiments.study.definition import Budget, Study, load
from vic_toolbox.experiments.study.plan import Draft, make_plan
from vic_toolbox.experiments.study.timing import Timing, duration


def two_tables(**changes: object) -> Study:
    study = tiny()
    first = study.table[0]
    second = replace(
        first, name="II", title="Scales", scenarios=("train", "scale=0.5"), halved_step=(), paper={}
    )
    return replace(study, table=(first, replace(second, **changes)))  # type: ignore[arg-type]


def test_tables_share_their_training():
    plan = make_plan(two_tables())
    trained = [entry.cell for entry in plan.entries if entry.row == "Gain-AIRL" and entry.scenario == "train"]
    assert len(trained) == 2
    assert len(set(trained)) == 1
    assert max(Counter(cell.name for cell in plan.cells).values()) == 1


def test_every_entry_has_its_cell_and_every_need_comes_before():
    plan = make_plan(load("paper"))
    before: set[str] = set()
    for cell in plan.cells:
        assert before.issuperset(cell.needs)
        before.add(cell.name)
    assert {entry.cell for entry in plan.entries} <= before
    for name in before:  # no folder inside another one
        assert not any(other.startswith(f"{name}/") for other in before)
    assert len(set(plan.entries)) == len(plan.entries)


def test_every_method_has_a_number_for_every_scenario_and_seed():
    study = load("paper")
    plan = make_plan(study)
    for table in study.table[:3]:
        rows = Counter(
            (entry.row, entry.scenario)
            for entry in plan.entries
            if entry.table == table.name and entry.role == "method"
        )
        assert set(rows) == {(row, scenario) for row in table.paper for scenario in table.scenarios}
        assert {count for (row, _), count in rows.items() if row != "Constant gain"} == {len(study.seeds)}


def test_a_training_cell_is_a_complete_configuration():
    plan = make_plan(tiny())
    cell = plan.by_name["peg-in-hole/train/gain-airl-seed30"]
    run = from_json(RunConfiguration, cell.settings, where="cell")
    assert (run.method, run.action, run.seed, run.episodes) == ("airl", "gain", 30, 2)
    assert run.recipe.airl.iterations == 12
    assert run.recipe.airl.search.environments == run.recipe.transfer.search.environments == 2
    assert run.demonstrations.held_out == 1


def test_a_budget_changes_only_what_it_names():
    study = tiny()
    other = replace(
        study, budget={"peg-in-hole": replace(study.budget["peg-in-hole"], transfer_iterations=5)}
    )
    plan, changed = make_plan(study), make_plan(other)
    before, after = digests(plan.cells), digests(changed.cells)
    name = "peg-in-hole/transfer/gain-airl-seed30/tilt=0/learned"
    assert before[name] != after[name]
    assert before["peg-in-hole/judge/expert/train"] == after["peg-in-hole/judge/expert/train"]


def test_a_fingerprint_follows_what_a_cell_needs():
    first = Cell("train", "a", {"seed": 1})
    judged = Cell("judge", "b", {"of": "a"}, ("a",))
    assert digests([first, judged]) == digests([first, judged])
    assert digests([first, judged])["b"] != digests([Cell("train", "a", {"seed": 2}), judged])["b"]


def test_contradictions_are_refused():
    draft = Draft()
    draft.cell("judge", "a/b", {"x": 1})
    assert draft.cell("judge", "a/b", {"x": 1}) == "a/b"
    with pytest.raises(InputError, match="'a/b' with different settings"):
        draft.cell("judge", "a/b", {"x": 2})
    with pytest.raises(InputError, match="needs c"):
        draft.cell("judge", "a/d", {}, needs=("c",))
    draft.cell("judge", "a", {})
    with pytest.raises(InputError, match="'a/b' would lie inside the cell 'a'"):
        draft.finish()


def test_the_paper_has_numbers_only_for_rows_that_there_are():
    study = tiny()
    table = replace(study.table[0], paper={"Gain-ARIL": (0.5, 0.5)})
    with pytest.raises(InputError, match="row 'Gain-ARIL'.*Gain-AIRL, Gain-BC"):
        make_plan(replace(study, table=(table,)))


@pytest.mark.parametrize("name", ["", "/", "a//b", "../a", "a/.run", "a\\b"])
def test_names_are_folders(name: str):
    with pytest.raises(InputError, match="cannot name a cell"):
        Cell("train", name, {})


@pytest.mark.parametrize(
    "value", [None, [], {"kind": "a"}, {"kind": "a", "name": 3, "settings": {}, "needs": []}]
)
def test_what_is_no_cell_is_refused(value: object):
    with pytest.raises(FileError, match=r"f\.json does not describe a cell"):
        Cell.from_json(value, where="f.json")


def test_controls_of_fresh_policies_are_made_for_gains_and_one_observation():
    plan = make_plan(load("paper"))
    fresh = {cell.name.split("/")[2] for cell in plan.cells if cell.settings.get("fresh")}
    assert {name.rsplit("-", 1)[0] for name in fresh if not name.startswith("twin")} == {"gain-airl"}


def test_time_left_is_the_work_shared_out_or_the_longest_chain():
    plan = make_plan(tiny())
    timing = Timing(plan)
    alone = timing.left(plan.cells, slots=1)
    assert timing.left(plan.cells, slots=2) == pytest.approx(max(alone / 2, max(plan.urgency.values())))
    assert timing.left(plan.cells, slots=1000) == pytest.approx(max(plan.urgency.values()))
    judged = [cell for cell in plan.cells if cell.kind == "judge" and cell.settings["time_step"] == 1.0]
    timing.add(judged[0], 100.0)
    assert timing.expected(judged[1]) == 100.0  # of the same kind, task and effort
    assert timing.left([], slots=3) == 0.0


@pytest.mark.parametrize(("seconds", "text"), [(5, "5 s"), (61, "1 min"), (7800, "2 h 10 min")])
def test_durations_are_readable(seconds: float, text: str):
    assert duration(seconds) == text


def test_defaults_of_a_budget_are_valid():
    assert Budget().episodes == 20
