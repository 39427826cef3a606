"""``vic recording inspect``: the summary, the findings, the figure, and one clear line for what cannot be read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.recorded import recording_of_a_spring
from vic_toolbox.cli import main
from vic_toolbox.recordings import read, wrench_to_world

MOUNTING = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    recording_of_a_spring(seconds=3.0, noise=0.3).save(tmp_path / "log.npz")
    return tmp_path / "log.npz"


def test_a_good_log_is_summarised_and_drawn(
    log: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(log.parent)
    assert main(["recording", "inspect", "log.npz"]) == 0
    text = capsys.readouterr().out
    assert "log.npz: 3000 samples, 2.999 s, 1000 Hz; wrench in world axes" in text
    assert "x translation" in text
    assert "nothing was found wrong with it" in text
    assert Path("log.svg").read_text().startswith("<?xml")


def test_a_wrong_frame_is_told_and_mended(log: Path, capsys: pytest.CaptureFixture):
    wrong = log.with_name("wrong.npz")
    columns = wrench_to_world(read(log), rotation=MOUNTING.T)
    np.savez(
        wrong,
        time=columns.time,
        wrench=columns.wrench,
        position=columns.position,
        quat_wxyz=columns.quat_wxyz,
        position_desired=columns.reference_position,
        quat_wxyz_desired=columns.reference_quat_wxyz,
    )
    out = log.with_name("figure.png")
    assert main(["recording", "inspect", str(wrong), "--out", str(out)]) == 0
    text = capsys.readouterr().out
    assert "sensor_rotation=[[0, 1, 0], [-1, 0, 0], [0, 0, 1]]" in text
    assert out.read_bytes().startswith(b"\x89PNG")
    mended = log.with_name("mended.h5")
    turn = ["--sensor-rotation", *["0", "1", "0", "-1", "0", "0", "0", "0", "1"]]
    assert main(["recording", "inspect", str(wrong), *turn, "--save", str(mended), "--out", str(out)]) == 0
    assert "other axes than stated" not in capsys.readouterr().out
    np.testing.assert_allclose(read(mended).wrench, read(log).wrench, atol=1e-12)


def test_a_log_with_errors_is_told_and_drawn(log: Path, capsys: pytest.CaptureFixture):
    good = read(log)
    bad = log.with_name("bad.npz")
    time = good.time.copy()
    time[70] = 0.0
    good.noted(time=time).save(bad)
    out = log.with_name("figure.pdf")
    assert main(["recording", "inspect", str(bad), "--out", str(out)]) == 0
    assert "error: time runs backwards 1 times" in capsys.readouterr().out
    assert out.exists()
    assert main(["recording", "inspect", str(bad), "--out", str(out), "--repair"]) == 0
    assert "dropped 1 samples" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("content", "options", "message"),
    [
        (b"", (), "is empty"),
        (b"\x89HDF\r\n\x1a\nnonsense", (), "cannot be read as HDF5"),
        (b"#ROSBAG V2.0\n", (), "cannot be read as a bag"),
        (b"\x89MCAP0\r\n", (), "cannot be read as a bag"),
        (b"SQLite format 3\0", (), "cannot be read as a bag"),
        (b"PK\x03\x04", (), "cannot be read as npz"),
        (b"a,b\n1,2\n", (), "no column was recognised as wrench"),
        (b"a,b\n1,2\n", ("--out", "figure.jpg"), "is no figure"),
        (b"a,b\n1,2\n", ("--layout", "none.toml"), "cannot be read as TOML"),
    ],
)
def test_what_cannot_be_read_gives_one_line(tmp_path: Path, capsys, monkeypatch, content, options, message):
    monkeypatch.chdir(tmp_path)
    Path("log").write_bytes(content)
    assert main(["recording", "inspect", "log", *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert message in err
    assert err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["log"]
