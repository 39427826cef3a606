"""``vic stability``: fits, tables and runs; the report, the JSON, and one clear line for what can go wrong."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from tests.experiment_runs import copy, figures, finished, folder, tiny
from tests.test_fit_cli import WITHOUT_LEARNING
from vic_toolbox.cli import main
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments import stability_report
from vic_toolbox.experiments.fitting import EXAMPLE, digest
from vic_toolbox.experiments.gain_table import GainTable
from vic_toolbox.experiments.stability_report import FILES
from vic_toolbox.experiments.stability_settings import StabilitySettings
from vic_toolbox.experiments.stability_study import study
from vic_toolbox.experiments.stability_table import read_gains
from vic_toolbox.experiments.training import train
from vic_toolbox.recordings import Layout

ROOT = Path(__file__).parents[1]
SIX = ["--mass", "3", "3", "3", ".05", ".05", ".05"]


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without figures, which are most of the time."""
    monkeypatch.setattr(stability_report, "_drawings", lambda _: iter(()))


@pytest.fixture
def fit(tmp_path: Path) -> Path:
    """The folder of a fit of the example's log, with gains that are not those of the log: quick to make."""
    path = tmp_path / "fit"
    path.mkdir()
    t = np.linspace(0.0, 2.5, 60)
    k = np.array([150.0, 120, 80, 4, 4, 3]) * (1 + 0.3 * np.sin(2 * t[:, None]))
    b = 9 * np.sqrt(k)
    k[:, 5] = np.nan
    seen = np.isfinite(k)
    stiffness, damping = (x[:, :, None] * np.eye(6) for x in (k, b))
    for matrix in (stiffness, damping):
        matrix[:, ~np.eye(6, dtype=bool)] = 0.0
    ones, sd = np.ones((60, 6)), 0.1 * damping
    estimate = GainEstimate(
        t, stiffness, damping, sd, sd, seen, seen, ones, np.zeros((60, 6)), ones[0], ones[0], "made"
    )
    estimate.save(path / "estimate.npz")
    GainTable.of(estimate).write(path / "gains.csv")
    log = EXAMPLE / "guided.npz"
    layout = asdict(Layout.of(EXAMPLE / "guided.toml"))
    inputs = [{"file": str(log), "sha256": digest(log)}]
    (path / "fit.json").write_text(json.dumps({"inputs": inputs, "layout": layout}))
    return path


def table(path: Path, head: str, *rows: str) -> Path:
    path.write_text("\n".join([head, *rows]) + "\n")
    return path


def smooth(path: Path, rows: int = 30) -> Path:
    t = np.linspace(0, 2, rows)
    return table(path, "time,K_x,B_x", *(f"{x},{300 + 50 * np.sin(x)},{40}" for x in t))


def failure(capsys: pytest.CaptureFixture, *line: object) -> str:
    assert main(["stability", *map(str, line)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Traceback" not in err
    last = err.splitlines()[-1]
    assert last.startswith("vic: error: ")
    return last


# --- what it says --------------------------------------------------------------------------------------------


def test_a_fit_is_judged_where_nothing_of_learning_is_installed(fit: Path, tmp_path: Path):
    out = tmp_path / "out"
    line = ["stability", str(fit), *SIX, "--tank", "0.1", "--filter", "3", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_LEARNING, *line], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == FILES.keys()
    told = json.loads((out / "stability.json").read_text())
    analysis = told["analyses"]["gains"]
    assert analysis["axes"] == ["x", "y", "z", "rx", "ry"]
    assert {one["name"]: one["status"] for one in analysis["findings"]}["schedule"] == "proved"
    assert told["replays"].keys() == {"energy tank", "gain filter"}
    assert told["replays"]["energy tank"]["filtered_injected"] <= told["replays"]["energy tank"]["injected"]
    page = (out / "report.html").read_text()
    for text in (
        "Stability of the fit",
        "What the energy tank would have changed",
        "Z-width of",
        "rz left out",
    ):
        assert text in page
    assert "Gains over time, and the α that certifies them" in page
    assert page.count("<svg") == 0  # figures are images, so their ids do not clash
    assert re.search(r"^the gains as they change +proved", done.stdout, re.MULTILINE)
    assert "warning" not in done.stderr


def test_a_schedule_that_pumps_is_disproved_and_the_code_is_zero(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    t = np.linspace(0, 2 * np.pi, 201)
    k = 12 + 10 * np.sin(t)
    k[-1] = 12
    rows = [f"{a},{b},1,{0.1 * np.cos(a)}" for a, b in zip(t, k, strict=True)]
    file = table(tmp_path / "pump.csv", "t,K [N/m],B [Ns/m],e [m]", *rows)
    line = ["stability", str(file), "--mass", "10", "--tank", "0.001", "--out", str(tmp_path / "out")]
    assert main(line) == 0
    out = capsys.readouterr().out
    assert re.search(r"^the gains as they change +disproved", out, re.MULTILINE)
    assert "let the gains rise" in out
    page = (tmp_path / "out" / "report.html").read_text()
    assert "class=alarm" in page
    told = json.loads((tmp_path / "out" / "stability.json").read_text())
    schedule = told["analyses"]["gains"]["findings"][0]
    assert schedule["witness"]["kind"] == "counter-example"
    assert schedule["witness"]["growth"] > 5
    assert told["replays"]["energy tank"]["energy_saved"] > 0


@pytest.mark.usefixtures("quick")
def test_the_same_gains_as_a_fit_and_as_a_table(fit: Path, tmp_path: Path):
    names = ("fit", "csv", "npz")
    files = (fit, fit / "gains.csv", fit / "estimate.npz")
    told = []
    for name, file in zip(names, files, strict=True):
        assert main(["stability", str(file), *SIX, "--out", str(tmp_path / f"out-{name}")]) == 0
        told.append(
            json.loads((tmp_path / f"out-{name}" / "stability.json").read_text())["analyses"]["gains"][
                "findings"
            ]
        )
    for one in told[1:]:
        assert [(f["name"], f["status"]) for f in one] == [(f["name"], f["status"]) for f in told[0]]
        assert [f["margin"] for f in one] == pytest.approx([f["margin"] for f in told[0]])


@pytest.mark.usefixtures("quick")
def test_the_arm_along_the_joints_of_the_log(fit: Path, tmp_path: Path, capsys: pytest.CaptureFixture):
    line = ["stability", str(fit), "--robot", "fanuc_lrmate200id7l", "--tool", "cup_gripper"]
    assert main([*line, "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert "along the joints of the log" in out
    assert "the inertia that moves" in out
    posture = ["--posture", "0", "0.3", "0.5", "0", "0.8", "0"]
    assert main([*line, *posture, "--out", str(tmp_path / "still")]) == 0
    assert "the inertia that moves" not in capsys.readouterr().out


@pytest.mark.parametrize("task", ["cup-on-plate", "peg-in-hole"])
@pytest.mark.usefixtures("quick")
def test_a_run_is_rolled_out_and_judged(task: str, tmp_path: Path):
    known = finished("bc") if task == "cup-on-plate" else finished("bc", task)  # as other tests call it
    run, out = copy(known, tmp_path / "run"), tmp_path / "out"
    starts = 2 if task == "peg-in-hole" else 1
    line = [
        "stability",
        str(run),
        "--tank",
        "0.2",
        "--episodes",
        str(starts),
        "--seed",
        "3",
        "--out",
        str(out),
    ]
    assert main(line) == 0
    told = json.loads((out / "stability.json").read_text())
    assert told["analyses"].keys() == {"rollout", "policy"}
    policy = {one["name"]: one["status"] for one in told["analyses"]["policy"]["findings"]}
    assert policy["switching"] == policy["policy"] == "proved"  # whatever the policy does in the task's range
    rollout = {one["name"]: one["status"] for one in told["analyses"]["rollout"]["findings"]}
    assert rollout["schedule"] == rollout["inertia"] == "proved"
    assert len(told["starts"]) == starts
    assert told["settings"]["period"] == pytest.approx(1e-3)
    assert "The policy, and everything that it may do" in (out / "report.html").read_text()


@pytest.mark.usefixtures("quick")
def test_a_force_policy_has_no_gains_to_filter(tmp_path: Path, capsys: pytest.CaptureFixture):
    run = folder() / "force-bc"
    if not run.exists():
        with figures(drawn=False):
            train(tiny("bc", action="force"), run, threads=1)
    found = study(run, StabilitySettings())
    assert found.analyses.keys() == {"policy"}
    assert "sets forces" in failure(capsys, run, "--tank", "1", "--out", tmp_path / "out")
    assert "leave --mass" in failure(capsys, run, "--mass", "1", "--out", tmp_path / "out")


@pytest.mark.usefixtures("quick")
def test_the_folder_is_kept_or_replaced(tmp_path: Path, capsys: pytest.CaptureFixture):
    file, out = smooth(tmp_path / "gains.csv"), tmp_path / "out"
    line = ["stability", str(file), "--mass", "2", "--out", str(out)]
    assert main(line) == 0
    first = (out / "stability.json").read_bytes()
    capsys.readouterr()
    assert "--overwrite" in failure(capsys, *line[1:])
    assert main([*line, "--overwrite"]) == 0
    assert (out / "stability.json").read_bytes() == first  # the same numbers
    (out / "stability.json").unlink()
    capsys.readouterr()
    assert "holds no stability analysis" in failure(capsys, *line[1:], "--overwrite")


# --- tables --------------------------------------------------------------------------------------------------


def test_columns_by_any_of_their_names(tmp_path: Path):
    rows = ["0,1,2,9", "0.1,,3,9"]
    for head in ("time [s],K_x [N/m],B_x [Ns/m],other", "t,Kx,Bx,x", "Time,stiffness_x,damping_x,sd K_x"):
        found = read_gains(table(tmp_path / "t.csv", head, *rows))
        assert found.stiffness.shape == (2, 6, 6)
        assert found.damping[1, 0, 0] == 3
        assert np.isnan(found.stiffness[1, 0, 0])
        assert np.isnan(found.stiffness[0, 1, 1])
    full = read_gains(table(tmp_path / "t.csv", "t,Kx,Krx,K_x_rx,Bx,Brx", "0,5,6,1,1,1", "1,5,6,2,1,1"))
    assert full.stiffness[1, 0, 3] == full.stiffness[1, 3, 0] == 2
    single = read_gains(table(tmp_path / "t.csv", "t,K,B,e,de", "0,5,6,1,0", "1,5,6,2,0"))
    assert single.stiffness.shape == (2, 1, 1)
    assert single.error is not None
    assert single.error[1, 0] == 2


@pytest.mark.parametrize(
    ("head", "rows", "said"),
    [
        ("time,K_x", ["0,1", "1,1"], r"one K and one B.*its columns are time, K_x"),
        ("K_x,B_x", ["0,1", "1,1"], r"column time \[s\]"),
        ("time,K_x,B_y", ["0,1,1", "1,1,1"], "one K and one B"),
        ("time,K_x,B_x", ["0,1,1", "2,1,1", "1,1,1"], r"row 4: time 1 s does not follow 2 s"),
        ("time,K_x,B_x", ["0,1,1", "0,1,1"], "does not follow"),
        ("time,K_x,B_x", ["0,1,1", "1,soft,1"], r"row 3, column K_x: 'soft' is no number"),
        ("time,K_x,B_x", ["0,1,1", "1,1"], "row 3, has 2 cells"),
        ("time,K_x,B_x", ["0,1,1", ",1,1"], "row 3 has no time"),
        ("time,K_x,B_x", ["0,inf,1", "1,1,1"], "infinite"),
        ("time,K_x,K_x,B_x", ["0,1,1,1"], "twice"),
        ("time,K_x,B_x", [], "no rows"),
        ("time [ms],K_x,B_x", ["0,1,1", "1,1,1"], "is in ms; write it in s"),
        ("time,K_x [N/mm],B_x", ["0,1,1", "1,1,1"], "is in N/mm"),
        ("time,K_x,B_x", [f"{i},{-1 if i == 3 else 1},1" for i in range(9)], r"K_x is -1 at 3 s \(negative in 1 of 9"),
        ("time,K_x,B_x", [f"{i},,1" for i in range(9)], "nowhere determined"),
        ("time,K_x,B_x", ["0,1,1"], "two|constant|samples"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("quick")
def test_a_table_with_a_mistake(
    head: str, rows: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    file, out = table(tmp_path / "gains.csv", head, *rows), tmp_path / "out"
    if len(rows) == 1 and "twice" not in said:  # one row is one pair of constant gains
        assert main(["stability", str(file), "--mass", "1", "--out", str(out)]) == 0
        return
    assert re.search(said, failure(capsys, file, "--mass", "1", "--out", out))
    assert not out.exists()


def test_rows_that_are_not_determined_are_left_out(tmp_path: Path):
    t = np.linspace(0, 2, 40)
    rows = [f"{x},{'' if i < 5 or i == 39 else 300 + 50 * np.sin(x)},40" for i, x in enumerate(t)]
    found = study(table(tmp_path / "gains.csv", "time,K_x,B_x", *rows), StabilitySettings(mass=(2.0,)))
    analysis = found.analyses["gains"]
    assert analysis.time is not None
    assert len(analysis.time) == 34
    assert any("longest stretch" in text for text in analysis.assumptions)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--mass", "1", "2"], "one for x, y, z, or six"),
        (["--mass", "-1"], "positive"),
        (["--period", "0"], "period"),
        (["--hold", "100"], "shorter hold"),
        (["--axes", "w"], "axis"),
        (["--mass", "1", "--robot", "ur5"], "one of them"),
        (["--tool", "cup_gripper"], "--robot"),
        (["--tank", "1"], "replay a motion"),
        (["--delay-steps", "-1"], "delay_steps"),
        (["--episodes", "3"], "no run"),
        (["--robot", "nobody"], "nobody"),
        (["--robot", "ur5", "--posture", "1", "2"], "2 angles"),
    ],
)
def test_options_that_make_no_sense(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture
):
    options = (
        options
        if "--mass" in options or "--robot" in options or said == "--robot"
        else ["--mass", "1", *options]
    )
    assert said in failure(capsys, smooth(tmp_path / "gains.csv"), *options, "--out", tmp_path / "out")


def test_what_is_no_subject(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert "does not exist" in failure(capsys, tmp_path / "none")
    assert "holds neither" in failure(capsys, tmp_path)
    (tmp_path / "a.npz").write_bytes(b"no")
    assert "cannot be read" in failure(capsys, tmp_path / "a.npz")
    (tmp_path / "a.txt").write_bytes(b"\xff\xfe")
    assert "cannot be read" in failure(capsys, tmp_path / "a.txt")
    (tmp_path / "a.pdf").write_bytes(b"no")
    assert "pass one of them" in failure(capsys, tmp_path / "a.pdf")


@pytest.mark.usefixtures("quick")
def test_a_log_that_changed_since_the_fit_is_not_used(
    fit: Path, tmp_path: Path, capsys: pytest.CaptureFixture
):
    told = json.loads((fit / "fit.json").read_text())
    told["inputs"][0]["sha256"] = "other"
    (fit / "fit.json").write_text(json.dumps(told))
    assert main(["stability", str(fit), *SIX, "--out", str(tmp_path / "out")]) == 0
    assert "is not the file that was fitted" in capsys.readouterr().out
    assert "replay a motion" in failure(capsys, fit, *SIX, "--tank", "1", "--out", tmp_path / "other")
