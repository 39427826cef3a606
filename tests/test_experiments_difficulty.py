"""Difficulty sweeps: every value is an evaluation, and the area is what it says."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.experiment_runs import finished
from vic_toolbox import tasks
from vic_toolbox.errors import InputError
from vic_toolbox.experiments.difficulty import (
    DifficultySweep,
    offered_sweeps,
    sweep_difficulty,
    sweep_runs_difficulty,
)
from vic_toolbox.experiments.evaluation import Policy, baselines, evaluate
from vic_toolbox.experiments.skill import load_skill
from vic_toolbox.tasks.peg_in_hole import PegInHole


def made_up(values: list[float], rates: list[float], *, episodes: int = 10) -> DifficultySweep:
    return DifficultySweep(
        task="peg-in-hole",
        quantity="tilt",
        label="tilt  [deg]",
        values=np.array(values),
        episodes=episodes,
        start_seed=1000,
        success={"expert": np.ones(len(values)), "airl": np.array(rates)},
    )


@given(st.lists(st.tuples(st.floats(0.1, 5.0), st.floats(0, 1)), min_size=1, max_size=8), st.floats(0, 1))
def test_the_area_is_a_mean_success(steps: list[tuple[float, float]], level: float):
    values = np.cumsum([step for step, _ in steps]).tolist()
    rates = [rate for _, rate in steps]
    swept = made_up(values, rates)
    assert swept.area("expert") == pytest.approx(1.0)
    assert min(rates) - 1e-12 <= swept.area("airl") <= max(rates) + 1e-12
    assert made_up(values, [level] * len(values)).area("airl") == pytest.approx(level)
    stretched = made_up([3.0 * value - 7.0 for value in values], rates)
    assert stretched.area("airl") == pytest.approx(swept.area("airl"), abs=1e-9)


def test_a_straight_line_from_all_to_nothing_has_half_the_area():
    assert made_up([-2.0, 0.0, 6.0], [1.0, 0.75, 0.0]).area("airl") == pytest.approx(0.5)


def test_files_hold_every_value(tmp_path: Path):
    swept = made_up([-2.0, 0.0], [0.5, 1.0], episodes=4)
    swept.write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {"sweep.json", "sweep.csv", "sweep.svg"}
    summary = json.loads((tmp_path / "sweep.json").read_text())
    assert summary["values"] == [-2.0, 0.0]
    assert summary["methods"]["airl"]["success"] == [0.5, 1.0]
    assert summary["methods"]["airl"]["area"] == 0.75
    rows = list(csv.DictReader((tmp_path / "sweep.csv").open()))
    assert [float(row["tilt"]) for row in rows] == [-2.0, 0.0]
    low, high = swept.interval("airl")
    assert [float(row["low_airl"]) for row in rows] == pytest.approx(low, rel=1e-5)
    assert [float(row["high_airl"]) for row in rows] == pytest.approx(high, rel=1e-5)
    assert (low <= swept.success["airl"]).all()
    assert (swept.success["airl"] <= high).all()


@pytest.fixture
def two_tilts(monkeypatch: pytest.MonkeyPatch) -> PegInHole:
    """The peg's task with a sweep of two values."""
    axis = replace(PegInHole().sweeps["tilt"], values=(-6.0, 0.0))
    monkeypatch.setattr(PegInHole, "sweeps", MappingProxyType({"tilt": axis}))
    return PegInHole()


def test_each_value_is_an_evaluation_on_its_scenario(two_tilts: PegInHole):
    policies = {"airl": Policy.constant(two_tilts)}
    swept = sweep_difficulty(two_tilts, policies, "tilt", episodes=3, seed=7, threads=1)
    assert list(swept.success) == ["expert", "airl", "constant", "middle", "matched"]
    for i, tilt in enumerate((-6, 0)):
        there = PegInHole(scenario=f"tilt={tilt}")
        for name, policy in ({"expert": Policy.expert(there)} | baselines(there)).items():
            row = evaluate(there, policy, episodes=3, seed=7, threads=1)
            assert swept.success[name][i] == row.success_rate
    assert swept.success["expert"].tolist() == [1.0, 1.0]
    assert swept.success["constant"].tolist() == swept.success["airl"].tolist() == [0.0, 1.0]
    assert swept.area("constant") == 0.5


def test_the_expert_of_a_sweep_knows_the_size_of_the_part(monkeypatch: pytest.MonkeyPatch):
    axis = replace(PegInHole().sweeps["scale"], values=(0.3,))
    monkeypatch.setattr(PegInHole, "sweeps", MappingProxyType({"scale": axis}))
    swept = sweep_difficulty(PegInHole(), {}, "scale", episodes=3, threads=1)
    assert swept.success["expert"].tolist() == [1.0]
    assert swept.area("expert") == 1.0


def test_an_unknown_quantity_is_refused_with_what_there_is():
    peg, cup = PegInHole(), tasks.make("cup-on-plate")
    offered = "tilt, scale, offset, friction, clearance"
    with pytest.raises(InputError, match=f"Peg-in-Hole has no sweep 'start'; choose one of: {offered}."):
        sweep_difficulty(peg, {}, "start")
    with pytest.raises(InputError, match="Cup-on-Plate has no sweep 'tilt'; choose one of: start."):
        sweep_difficulty(cup, {}, "tilt")
    assert offered_sweeps(cup) == ("start",)
    with pytest.raises(InputError, match="episodes is 0"):
        sweep_difficulty(peg, {}, "tilt", episodes=0)


@pytest.mark.usefixtures("two_tilts")
def test_runs_are_swept_side_by_side():
    skills = [load_skill(finished(method, "peg-in-hole")) for method in ("bc", "constant")]
    swept = sweep_runs_difficulty(skills, "tilt", episodes=2, threads=1)
    assert {"expert", "bc", "constant", "middle", "matched"} == swept.success.keys()
    with pytest.raises(InputError, match="Sweep each alone"):
        sweep_runs_difficulty([skills[0], load_skill(finished("bc"))], "tilt")
