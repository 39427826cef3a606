"""``vic fit``: the example, the table, the files, and one clear line for everything that can go wrong."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.fit_data import LAYOUT, at_rest, guided, raw
from tests.recorded import STIFFNESS, recording_of_a_spring
from vic_toolbox.cli import main
from vic_toolbox.estimation import GainEstimate
from vic_toolbox.experiments import fit_report
from vic_toolbox.experiments.fit_report import FILES

ROOT = Path(__file__).parents[1]
MOUNTED = [
    "--wrench-axes",
    "tool",
    "--sensor-rotation",
    *(str(x) for row in LAYOUT.sensor_rotation for x in row),
]

WITHOUT_LEARNING = """
import sys
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {"torch", "mujoco", "gymnasium", "safetensors", "sklearn", "imageio"}:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Absent())
from vic_toolbox.cli import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without figures, which are most of the time."""
    monkeypatch.setattr(fit_report, "_figures", lambda *_: [])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return guided(tmp_path / "log.npz", seconds=2.0)


def failure(capsys: pytest.CaptureFixture, *line: object) -> str:
    assert main(["fit", *map(str, line)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    last = err.splitlines()[-1]
    assert last.startswith("vic: error: ")
    assert "Traceback" not in err
    return last


def test_the_example_runs_where_nothing_of_learning_is_installed(tmp_path: Path):
    out = tmp_path / "fit"
    line = ["fit", "--example", "--out", str(out)]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_LEARNING, *line], capture_output=True, text=True, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr
    assert {path.name for path in out.iterdir()} == FILES.keys()
    told = json.loads((out / "fit.json").read_text())
    assert told["payload"]["poses"] >= 3
    assert all(told["axes"][axis]["stiffness"]["observable"] > 0.5 for axis in "xyz")
    assert re.search(r"^The stiffness over time .* K_x \d+ to \d+", done.stdout, re.MULTILINE)
    assert re.search(r"^x \[N/m, Ns/m\] +\d+", done.stdout, re.MULTILINE)
    assert all(str(out / file) in done.stdout for file in FILES)
    assert "GainEstimate.load" in done.stdout
    assert "fitting" in done.stderr  # progress


@pytest.mark.usefixtures("quick")
def test_a_log_with_its_calibration(
    log: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(log.parent)
    rest = at_rest(log.with_name("rest.npz"))
    assert main(["fit", "log.npz", "--calibration", str(rest), *MOUNTED, "--constant"]) == 0
    text = capsys.readouterr().out
    assert "not determined" not in text
    assert "--overwrite" in failure(capsys, "log.npz", *MOUNTED)
    assert main(["fit", "log.npz", "--calibration", "rest.npz", *MOUNTED, "--constant", "--overwrite"]) == 0
    estimate = GainEstimate.load("runs/fit-log/estimate.npz")
    np.testing.assert_allclose(np.diagonal(estimate.stiffness[0]), STIFFNESS, rtol=0.05)


@pytest.mark.usefixtures("quick")
def test_a_wrong_frame_comes_first_and_is_mended_by_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    raw(recording_of_a_spring(seconds=2.0, noise=0.2), Path("log.npz"), turned=True)
    assert main(["fit", "log.npz", "--constant", "--out", "fit"]) == 0
    text = capsys.readouterr().out
    assert "alarm: the wrench seems to be in other axes" in text
    assert "Do not use these gains yet" in text
    (line,) = re.findall(r"^  vic (fit .*)$", text, re.MULTILINE)
    assert main([*line.split(), "--constant"]) == 0
    assert "alarm" not in capsys.readouterr().out
    assert "Do not use" in json.loads(Path("fit/fit.json").read_text())["verdict"]


@pytest.mark.usefixtures("quick")
def test_without_any_gain_the_report_is_written_and_the_command_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture
):
    still = recording_of_a_spring(seconds=2.0)
    rng = np.random.default_rng(0)
    path = raw(still.noted(wrench=0.1 * rng.normal(size=still.wrench.shape)), tmp_path / "log.npz")
    out = tmp_path / "fit"
    message = failure(capsys, path, *MOUNTED, "--out", out)
    assert "No gain is determined" in message
    assert str(out / "report.html") in message
    assert {path.name for path in out.iterdir()} == FILES.keys() - {"figures"}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ([], "no log was given; pass a file, or --example"),
        (["none.csv"], "none.csv cannot be opened"),
        (["log.npz", "--example"], "--example brings its own log"),
        (["--example", "--wrench-sign", "1"], "--example brings its own log"),
        (["log.npz", "--knots", "0"], "knots is 0"),
        (["log.npz", "--method", "windows", "--bias"], "windows know no bias"),
        (["log.npz", "--units", "ms"], "write the quantity and its unit"),
        (["log.npz", "--units", "time=h"], "unit of time is 'h'; choose one of: s, ms"),
        (["log.npz", "--sensor-rotation", *"100020001"], "sensor_rotation"),
        (
            ["log.npz", "--calibration", "log.npz", *MOUNTED],
            "log.npz: the end-effector stands still in 0 places",
        ),
        (["log.npz", "--knots", "5", *MOUNTED], "knots are 5 s apart and the recording lasts 1.999 s"),
        (["log.npz", "--between", "9", "12", *MOUNTED], "no sample lies between"),
        (["log.npz", "--out", "log.npz"], "is a file"),
    ],
)
def test_what_can_go_wrong(
    log: Path, line: list[str], message: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(log.parent)
    assert message in failure(capsys, *line)
    assert [path.name for path in log.parent.iterdir()] == ["log.npz"]


def test_a_foreign_folder_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture, log: Path
):
    assert "is not empty (log.npz) and holds no fit" in failure(capsys, "none.csv", "--out", tmp_path)


def test_ctrl_c_leaves_nothing_behind(
    log: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(fit_report, "_write_page", interrupted)
    assert main(["fit", str(log), *MOUNTED, "--out", str(log.parent / "fit")]) == 130
    assert capsys.readouterr().err.splitlines()[-1] == "vic: stopped."
    assert [path.name for path in log.parent.iterdir()] == ["log.npz"]


def test_units_are_options_of_every_reader(log: Path, capsys: pytest.CaptureFixture):
    columns = dict(np.load(log))
    columns["time"] = 1e3 * columns["time"]
    np.savez(log, **columns)
    assert "--units time=ms" in failure(capsys, log, *MOUNTED, "--out", log.parent / "fit")
    picture = ["--out", str(log.with_name("log.svg"))]
    assert main(["recording", "inspect", str(log), *MOUNTED, "--units", "time=ms", *picture]) == 0
    assert "2000 samples, 1.999 s, 1000 Hz" in capsys.readouterr().out
