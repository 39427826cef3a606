"""Files are whole or not there, and whatever a file of arrays holds, it is read or refused with a message."""

from __future__ import annotations

import contextlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from vic_toolbox import files
from vic_toolbox.errors import FileError
from vic_toolbox.files import atomic_path, read_arrays, write_arrays

SAMPLE = {"time": np.linspace(0.0, 1.0, 40), "gains": np.arange(12.0).reshape(3, 4), "text": np.array("müde")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("files") / "sample.npz"
    write_arrays(path, SAMPLE)
    return path


@given(array=hnp.arrays(np.float64, hnp.array_shapes(min_side=0)))
def test_arrays_come_back(array: np.ndarray, tmp_path_factory: pytest.TempPathFactory):
    path = tmp_path_factory.mktemp("arrays") / "a.npz"
    write_arrays(path, {"a": array, "b c": array > 0})
    found = read_arrays(path)
    np.testing.assert_array_equal(found["a"], array)
    assert found["b c"].dtype == bool


@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject, whole: Path):
    content = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    damaged = whole.with_name("damaged.npz")
    damaged.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    with contextlib.suppress(FileError):
        read_arrays(damaged)


def test_objects_are_not_read(tmp_path: Path):
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    with pytest.raises(FileError, match="a.npy holds Python objects, which are not read"):
        read_arrays(tmp_path / "a.npz")


def test_what_is_missing_or_too_much_is_refused(whole: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(FileError, match="cannot be read as traces"):
        read_arrays(whole.with_name("none.npz"), "traces")
    monkeypatch.setattr(files, "LARGEST_BYTES", 100)
    with pytest.raises(FileError, match="too much for one file"):
        read_arrays(whole)


def test_an_interrupted_write_leaves_the_old_file(tmp_path: Path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with contextlib.suppress(KeyboardInterrupt), atomic_path(path) as temporary:
        temporary.write_text("ne")
        raise KeyboardInterrupt
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
