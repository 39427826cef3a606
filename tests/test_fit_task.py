"""``vic fit --task``: from logs of a session to demonstrations that a skill is learned from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from vic_toolbox import tasks, twin
from vic_toolbox.cli import main
from vic_toolbox.experiments import fit_report
from vic_toolbox.experiments.fit_demonstrations import FILE, fit_demonstrations
from vic_toolbox.experiments.fit_settings import FitSettings
from vic_toolbox.experiments.fitting import fit_logs
from vic_toolbox.recordings import Layout, read
from vic_toolbox.twin.logs import CALIBRATION, LAYOUT

CUP = tasks.make("cup-on-plate")


@pytest.fixture(autouse=True)
def _without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fit_report, "_figures", lambda *_: [])


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three demonstrations of a calm human, as ``vic twin record`` leaves them."""
    folder, robot = tmp_path_factory.mktemp("session"), twin.Twin(seed=4)
    twin.save_session(twin.guide(robot, twin.CALM, count=3, seed=4, rate=100.0), robot, folder)
    return folder


def logs(session: Path) -> list[Path]:
    return sorted(session.glob("demonstration_*.npz"))


def line(session: Path, *options: object) -> list[str]:
    files = [*logs(session), "--calibration", session / CALIBRATION, "--layout", session / LAYOUT]
    return ["fit", *map(str, [*files, "--between", 0, 2.6, "--knots", 0.2, *options])]


def test_two_commands_lead_from_recordings_to_a_skill(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "fit"
    assert main(line(session, "--task", "cup-on-plate", "--out", out)) == 0
    told = capsys.readouterr().out
    assert "3 demonstrations of Cup-on-Plate, 500 steps of 0.01 s" in told
    assert "the gains of the nearest time before stand in" in told
    (command,) = [row.split() for row in told.splitlines() if row.strip().startswith("vic train")]
    found = tasks.Demonstrations.load(command[-1])
    k_x = CUP.gains.action_to_parameters(found.actions)[0, [100, 180], 0]
    np.testing.assert_allclose(k_x, twin.Operator().schedule.gains(np.array([1.0, 1.8]))[0][:, 0], rtol=0.1)
    options = ["--method", "bc", "--iterations", "20", "--episodes", "1", "--out", str(tmp_path / "run")]
    assert main([*command[1:], *options]) == 0


def test_a_part_that_begins_later_keeps_its_clock(session: Path):
    """Labels of a pooled fit from 0.5 s on are those of the whole fit from there on."""
    layout = Layout.load(session / LAYOUT)
    found = [
        fit_demonstrations(
            fit_logs(
                logs(session),
                FitSettings(between=(start, 2.6), knots=0.2),
                layout=layout,
                calibration=session / CALIBRATION,
            ),
            CUP,
        )[0]
        for start in (0.0, 0.5)
    ]
    assert [one.actions.shape[1] for one in found] == [500, 450]
    early, late = (CUP.gains.action_to_parameters(one.actions) for one in found)
    np.testing.assert_allclose(late[:, 40:150, :2], early[:, 90:200, :2], rtol=0.12)


def test_what_is_too_little_is_said(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = read(logs(session)[0], Layout.load(session / LAYOUT))
    source.between(0.0, 2.0).save(tmp_path / "short.npz")
    options = ["--calibration", str(session / CALIBRATION), "--layout", str(session / LAYOUT)]
    short = ["fit", str(tmp_path / "short.npz"), *options, "--knots", "0.5", "--task", "cup-on-plate"]
    assert main([*short, "--out", str(tmp_path / "fit")]) == 0
    told = capsys.readouterr().out
    assert "One trajectory is too few" in told
    assert "clone them (--method bc)" in told
    assert f"vic train cup-on-plate --method bc --demonstrations {tmp_path / 'fit' / FILE}" in told


def test_an_unknown_task_is_refused_before_any_work(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert main(line(session, "--task", "cup-on-table", "--out", tmp_path / "fit")) == 2
    assert "cup-on-plate" in capsys.readouterr().err
    assert not (tmp_path / "fit").exists()
