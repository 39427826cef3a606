"""Tables on the digital twin: sessions, policies back on the robot, and how a study file describes them."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.experiment_runs import finished
from tests.test_fit_demonstrations import DAMPING, STIFFNESS, constant, log
from vic_toolbox import tasks, twin
from vic_toolbox.errors import FileError, InputError
from vic_toolbox.estimation import fit_windows
from vic_toolbox.experiments.deployed import BESIDE, TRACES, Traces, baseline, deploy
from vic_toolbox.experiments.figures.sim_to_real import velocity_responses
from vic_toolbox.experiments.guided import record_session
from vic_toolbox.experiments.session_settings import SessionSettings
from vic_toolbox.experiments.study import deploy as deploy_kind
from vic_toolbox.experiments.study.cell import Cell
from vic_toolbox.experiments.study.definition import parse
from vic_toolbox.experiments.study.kinds import kind_of
from vic_toolbox.experiments.study.plan import make_plan
from vic_toolbox.experiments.study.twin_pictures import velocity_drawings
from vic_toolbox.files import write_arrays
from vic_toolbox.tasks import CupOnPlate, cup_scene
from vic_toolbox.tasks.cup_on_plate import ROTATIONAL_DAMPING
from vic_toolbox.tasks.recorded import label

CUP = CupOnPlate()
HELD = 4
"""Episodes of a deployment."""


# --- labels ----------------------------------------------------------------------------------------------------------


def test_the_measured_wrench_is_the_force_action_of_exact_gains():
    force, logs = CUP.with_action("force"), [log(seed) for seed in range(2)]
    measured = tasks.Demonstrations.from_recordings(logs, None, task=force)
    by_law = tasks.Demonstrations.from_recordings(logs, constant(*logs), task=force, hold=True)
    assert measured.actions.shape == by_law.actions.shape
    np.testing.assert_allclose(measured.actions, by_law.actions, atol=1e-2)
    with pytest.raises(InputError, match="pass a task with action 'force'"):
        tasks.Demonstrations.from_recordings(logs, None, task=CUP)


def test_gaps_take_the_median_of_the_others_and_then_of_the_time_before():
    logs = [log(seed) for seed in range(3)]
    fits = [fit_windows(one, 10, structure="damping_factor") for one in logs]
    wanted = label(logs, fits, task=CUP, fallback="others", hold=True)
    t = fits[0].time
    blind = copy.deepcopy(fits)
    for index, fit in enumerate(blind):  # the first sees no k_x after 1 s, nobody after 1.5 s
        lost = (t > 1.0) & ((index == 0) | (t > 1.5))
        fit.stiffness[lost, 0, 0] = np.nan
        fit.stiffness_observable[lost, 0] = False
    found = label(logs, blind, task=CUP, fallback="others", hold=True)
    others = np.median(wanted.parameters[1:, :, 0], axis=0)
    np.testing.assert_allclose(found.parameters[0, 110:140, 0], others[110:140], rtol=1e-6)
    assert len(np.unique(found.parameters[:, 155:, 0])) == 1
    np.testing.assert_allclose(found.parameters[:, 5:95], wanted.parameters[:, 5:95], rtol=1e-6)
    assert 0.3 < found.borrowed[0] < 0.5
    assert found.observations.shape[1] == 201  # the recording's 2 s, though the last window ends before


def test_an_axis_that_nobody_knows_is_refused_by_name():
    source = log()
    fit = fit_windows(source, 10)
    fit.stiffness[:, 5, 5] = np.nan
    with pytest.raises(InputError, match="stiffness along rz at any time"):
        label(source, fit, task=CUP, fallback="others")
    with pytest.raises(InputError, match="fallback is 'other'"):
        label(source, fit, task=CUP, fallback="other")  # type: ignore[arg-type]


def test_negative_gains_of_a_free_fit_are_clipped_and_counted():
    source = log(stiffness=STIFFNESS * [-0.1, 1, 1, 1, 1, 1])
    found = label(source, constant_free(source), task=CUP, fallback="others")
    assert found.parameters[..., 0].max() < 0
    assert found.actions[..., 0].max() == -1.0
    np.testing.assert_allclose(found.outside(CUP)[:6], [1, 0, 0, 0, 0, 0])


def constant_free(source: Any) -> Any:
    return fit_windows(source, len(source))


# --- the session -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("session")
    return folder, record_session(SessionSettings(count=4), folder, seed=1)


def test_a_session_leaves_demonstrations_of_the_same_motions(session: tuple[Path, dict[str, Any]]):
    folder, values = session
    found = {
        name: tasks.Demonstrations.load(folder / f"{name}.npz") for name in ("windows", "smooth", "wrench")
    }
    assert {name: one.actions.shape for name, one in found.items()} == {
        "windows": (4, 500, 7), "smooth": (4, 500, 7), "wrench": (4, 500, 6)
    }  # fmt: skip
    assert (found["smooth"].observations == found["wrench"].observations).all()
    smooth, windows = (values[name]["stiffness"]["error"] for name in ("smooth", "windows"))
    assert max(smooth[:3]) < 0.1 < min(windows[:3])
    assert (
        values["windows"]["borrowed"][0] > values["smooth"]["borrowed"][0]
    )  # the latter: beyond the fit alone
    assert list(values["windows"]["outside"]) == list(CUP.gains.names)
    json.dumps(values, allow_nan=False)


def test_a_session_is_repeated_byte_by_byte(session: tuple[Path, dict[str, Any]], tmp_path: Path):
    folder, values = session
    for _ in range(2):  # the second time over the leftovers of the first
        again = record_session(SessionSettings(count=4), tmp_path, seed=1)
    assert again == values
    for name in ("windows.npz", "smooth.npz", "wrench.npz"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize(
    ("wrong", "text"),
    [({"count": 1}, "count"), ({"push": -1.0}, "push"), ({"window": 2}, "window"), ({"rate": 0.0}, "rate"),
     ({"fits": ()}, "at least one"), ({"fits": ("smooth", "smooth")}, "none twice"), ({"fits": ("mean",)}, "fits")],
)  # fmt: skip
def test_bad_sessions_are_refused(wrong: dict[str, Any], text: str):
    with pytest.raises(InputError, match=text):
        SessionSettings(**wrong)


# --- back on the robot -----------------------------------------------------------------------------------------------


def test_a_human_is_led_from_the_same_postures_as_a_policy():
    robot = twin.Twin(seed=2)
    options: dict[str, Any] = {"scenarios": ["train", "T2"], "start_noise": 1.0, "seed": 5}
    human = twin.lead(robot, twin.CALM, **options)
    policy = twin.run(robot, CUP.expert_action, **options)
    np.testing.assert_allclose(human.joint_position[:, 0], policy.joint_position[:, 0], atol=1e-12)
    assert np.linalg.norm(human.error[:, -1, :3], axis=-1).max() < 0.02
    # with no noise and no delay the hand's wrench is the law at the true motion
    calm = twin.lead(twin.Twin(twin.Imperfections.none()), twin.CALM)
    stiffness, damping = twin.Operator().schedule.gains(calm.time[:-1])
    wanted = -stiffness * calm.error[0, :-1, :6] - damping * calm.error[0, :-1, 6:]
    np.testing.assert_allclose(calm.actions[0], wanted, atol=1e-9)


def test_his_own_gains_follow_the_human_and_others_do_not():
    place: dict[str, Any] = {"robot": 1, "start": "T2", "episodes": HELD, "seed": 0}
    true, human, middle = (
        baseline(name, CUP, **place).values() for name in ("true-gains", "human", "constant")
    )
    assert max(true["mean_deviation"], human["mean_deviation"]) < 5.0 < middle["mean_deviation"]
    assert all(values["success_rate"] == 1.0 for values in (true, human, middle))
    assert true["mean_deviation"] == pytest.approx(np.mean(true["mean_deviation_each"]))
    with pytest.raises(InputError, match="baseline is 'expert'"):
        baseline("expert", CUP, **place)
    with pytest.raises(InputError, match="pass a task with action 'gain'"):
        baseline("constant", CUP.with_action("force"), **place)


def test_an_arm_that_runs_away_or_stays_behind_has_failed():
    force, wrench = CUP.with_action("force"), np.zeros(6)
    place: dict[str, Any] = {"robot": 1, "start": "train", "episodes": 2}
    found = deploy(lambda: lambda o: np.tile(wrench, (len(o), 1)), force, **place)
    stays = found.values()
    assert (stays["success_rate"], stays["stopped_rate"]) == (0.0, 0.0)
    assert stays["final_deviation"] > 1e3 * BESIDE
    arrived = replace(found.human, stopped=np.array([True, False]))  # one of two is halted next to the goal
    halted = replace(found, on_twin=arrived).values()
    assert (halted["success_rate"], halted["stopped_rate"], halted["final_deviation"]) == (0.5, 0.5, 0.0)


def test_a_deploy_cell_keeps_traces_for_the_figure(tmp_path: Path):
    study = tmp_path / "study"
    run = study / "cells" / "trained" / "run"
    run.parent.mkdir(parents=True)
    run.symlink_to(finished("bc"), target_is_directory=True)
    settings = {"action": "gain", "history": 1, "robot": 3, "start": "T2", "episodes": 2, "seed": 3}
    cell = Cell("deploy", "d", settings | {"policy": {"cell": "trained"}}, ("trained",))
    folder = tmp_path / "cell"
    values = kind_of(cell).run(cell, folder, study)
    assert values == deploy_kind.run(cell, folder, study)
    traces = Traces.load(folder / TRACES)
    off = np.linalg.norm(traces.on_twin[..., :3] - traces.human[..., :3], axis=-1)
    np.testing.assert_allclose(1e3 * off.mean(axis=1), values["mean_deviation_each"], atol=1e-3)
    drawing = velocity_responses({"Gain-BC": traces, "again": traces}, episode=1)
    assert len(drawing.axes) == 8
    write_arrays(folder / TRACES, {"format": "vic-deployment/1", **vars(traces), "human": np.zeros(3)})
    with pytest.raises(FileError, match="damaged traces"):
        Traces.load(folder / TRACES)
    (folder / TRACES).write_bytes(b"PK")
    with pytest.raises(FileError, match="run it again"):
        Traces.load(folder / TRACES)


def test_velocity_responses_are_drawn_once_for_each_start(tmp_path: Path):
    plan = make_plan(study(TABLE, TABLE | {"name": "V", "metric": "final deviation"}))
    still = np.ones((1, 3, 12))
    traces, results = Traces(np.arange(3.0), still, still, still), {}
    for entry in plan.entries:
        if entry.method == "bc":
            (tmp_path / entry.cell).mkdir(parents=True, exist_ok=True)
            traces.save(tmp_path / entry.cell / TRACES)
            results[entry.cell] = None
    folder = SimpleNamespace(plan=plan, cell_path=lambda name: tmp_path / name)
    drawn = {}
    for metric in ("deviation", "final deviation"):
        table = SimpleNamespace(
            name="IV", scenarios=("train", "T2"), definition=SimpleNamespace(metric=metric)
        )
        drawn[metric] = [*velocity_drawings(folder, table, results)]  # type: ignore[arg-type]
    assert [one.file for one in drawn["deviation"]] == ["sim-to-real-train", "sim-to-real-T2"]
    assert len(drawn["deviation"][0].figure.axes) == 4 * 3  # Gain-BC of two fits, Force-BC
    assert drawn["final deviation"] == []


# --- the study file --------------------------------------------------------------------------------------------------

TABLE: dict[str, Any] = {
    "name": "IV",
    "title": "Deviations",
    "task": "cup-on-plate",
    "metric": "deviation",
    "scenarios": ["train", "T2"],
    "controls": ["no-transfer", "random", "untrained", "human", "true-gains"],
    "session": {"count": 4, "fits": ["windows", "smooth"]},
    "paper": {"Gain-AIRL": [12.6, 13.4], "Force-BC": [35.2]},
}


def study(*tables: dict[str, Any], seeds: tuple[int, ...] = (1,)) -> Any:
    return parse({"name": "x", "title": "X", "seeds": list(seeds), "table": list(tables)}, where="x")


def test_the_plan_goes_from_the_session_over_the_simulation_back_to_the_twin():
    plan = make_plan(study(TABLE, TABLE | {"name": "V", "metric": "final deviation"}, seeds=(1, 2)))
    kinds = [cell.kind for cell in plan.cells]
    assert (kinds.count("session"), kinds.count("train"), kinds.count("transfer")) == (2, 12, 12)
    by_row = {(e.table, e.row, e.scenario, e.seed): plan.by_name[e.cell] for e in plan.entries}
    moved = by_row["IV", "Gain-AIRL", "T2", 1]
    chain = [moved]
    while chain[-1].needs:
        chain.append(plan.by_name[chain[-1].needs[0]])
    assert [cell.kind for cell in chain] == ["deploy", "transfer", "train", "session"]
    assert by_row["V", "Gain-AIRL", "T2", 1] == moved
    stayed = by_row["IV", "Gain-AIRL, no transfer", "T2", 1]
    assert [plan.by_name[name].kind for name in stayed.needs] == ["train"]
    (aimless,) = by_row["IV", "Gain-AIRL, smooth fit, random reward", "T2", 2].needs
    assert (plan.by_name[aimless].kind, plan.by_name[aimless].settings["reward"]) == ("transfer", "random")
    assert by_row["V", "Force, untrained with noise", "train", 2].settings["policy"] == {"untrained": 2}
    assert by_row["IV", "Gain-BC, smooth fit", "T2", 2].settings["robot"] == 2
    labels = {cell.settings["demonstrations"]["file"] for cell in plan.cells if cell.kind == "train"}
    assert labels == {"windows.npz", "smooth.npz", "wrench.npz"}
    roles = {entry.row: entry.role for entry in plan.entries}
    assert {row for row, role in roles.items() if role == "method"} == {
        "Gain-AIRL", "Gain-BC", "Force-AIRL", "Force-BC", "Constant gain"
    }  # fmt: skip
    assert min(plan.effort.values()) > 0


@pytest.mark.parametrize(
    ("change", "text"),
    [({"session": None}, "session is missing"), ({"sweeps": ["start"]}, "sweeps is not made on the digital twin"),
     ({"halved_step": ["T2"]}, "halved_step is not made"), ({"controls": ["fresh"]}, "controls has 'fresh'"),
     ({"task": "peg-in-hole", "scenarios": ["train"], "paper": {}}, "twin does Cup-on-Plate"),
     ({"metric": "difference", "controls": [], "paper": {}}, "session is of tables of deviations"),
     ({"paper": {"Gain-BC": [1.0, 2.0, 3.0]}}, "3 numbers"), ({"session": {"cuont": 3}}, "did you mean 'count'")],
)  # fmt: skip
def test_what_a_table_of_deviations_cannot_have_is_named(change: dict[str, Any], text: str):
    with pytest.raises(InputError, match=text):
        study({key: value for key, value in (TABLE | change).items() if value is not None})


def test_a_definition_is_read_back_from_its_json():
    found = study(TABLE)
    assert parse(json.loads(json.dumps(found.to_json())), where="x") == found


@pytest.mark.slow
def test_a_small_study_of_the_twin_from_the_session_to_the_deviation(tmp_path: Path):
    budget = {
        "environments": 2,
        "iterations": 2,
        "transfer_iterations": 1,
        "cloning_steps": 50,
        "episodes": 2,
    }
    tree = {"name": "x", "title": "X", "seeds": [1], "table": [TABLE], "budget": {"cup-on-plate": budget}}
    plan = make_plan(parse(tree, where="x"))
    values = {}
    for cell in plan.cells:
        folder = tmp_path / "cells" / cell.name
        folder.mkdir(parents=True)
        values[cell.name] = kind_of(cell).run(cell, folder, tmp_path)
    for entry in plan.entries:
        assert np.isfinite(values[entry.cell]["mean_deviation"])
        assert entry.scenario in cup_scene.SCENARIOS


def test_the_constants_that_the_labels_rest_on():
    assert DAMPING[3] == pytest.approx(ROTATIONAL_DAMPING)
