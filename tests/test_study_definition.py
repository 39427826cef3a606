"""A study's file: everything that is wrong with it is said before any work starts."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.study_files import TINY, write
from vic_toolbox.errors import FileError, InputError, VicError
from vic_toolbox.experiments.study.definition import load, parse, shipped

ROOT = Path(__file__).parents[1]


def refused(folder: Path, old: str, new: str, message: str) -> None:
    assert TINY.count(old) == 1
    with pytest.raises(InputError, match=message):
        load(write(folder, TINY.replace(old, new)))


def test_a_file_and_its_json_are_the_same_study(tmp_path: Path):
    study = load(write(tmp_path))
    assert parse(study.to_json(), where="study.json") == study
    assert study.table[0].methods == ("airl", "bc", "constant")  # a default, written out
    assert study.budget_of("peg-in-hole").iterations == 12
    assert study.budget_of("cup-on-plate").iterations is None


@pytest.mark.parametrize("name", ["paper", "quick"])
def test_the_shipped_studies_are_found_by_name_and_by_file(name: str):
    assert name in shipped()
    assert load(name) == load(ROOT / "studies" / f"{name}.toml")
    assert {table.name for table in load(name).table} >= {"I", "II", "III"}


def test_the_paper_study_is_what_was_announced():
    study = load("paper")
    assert len(study.seeds) == 5
    assert min(study.seeds) >= 30  # smaller ones served the recipes
    assert study.budget_of("peg-in-hole").episodes == 100
    for table in study.table[:3]:
        assert table.histories == (1, 5)
        assert set(table.paper) == {
            f"{action}-{method}{past}"
            for action in ("Gain", "Force")
            for method in ("AIRL", "BC")
            for past in ("", "-His")
        } | {"Constant gain"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seeds = [30]", "seed = [30]", "unknown key 'seed'; did you mean 'seeds'"),
        ("held_out = 1", "helt_out = 1", "peg-in-hole.*unknown key 'helt_out'; did you mean 'held_out'"),
        ('metric = "success"', 'metrik = "success"', "table 'I' has the unknown key 'metrik'.*'metric'"),
        ('title = "A study of seconds"', "", "lacks title; add it"),
        ("seeds = [30]", "seeds = []", "seeds is empty"),
        ("seeds = [30]", "seeds = [30, 31, 30]", "seeds has 30 twice"),
        ("seeds = [30]", "seeds = [-1]", "seeds is -1"),
        ("seeds = [30]", "seeds = [1e400]", "expected an integer"),
        ("seeds = [30]", "seeds = 30", "seeds is 30; expected a list"),
        ("seeds = [30]", "seeds = [true]", "expected an integer"),
        ('name = "tiny"', 'name = "../tiny"', "use letters, digits"),
        ('name = "tiny"', "name = 3", "name is 3; expected a text"),
        ('"tilt=0"]\nactions', '"tilt=O"]\nactions', "scenarios: tilt is 'O'"),
        ('"tilt=0"]\nactions', '"tilt=0.0"]\nactions', "write it as 'tilt=0'"),
        ('["train", "tilt=0"]', '["tilt=0"]', 'lacks "train"'),
        ('["train", "tilt=0"]', '["train", "tilt=0", "train"]', "'train' twice"),
        ('task = "peg-in-hole"', 'task = "peg-in-whole"', "choose one of: cup-on-plate, peg-in-hole"),
        ('metric = "success"', 'metric = "fun"', "metric is 'fun'"),
        ('actions = ["gain"]', 'actions = ["gian"]', "'gian'; did you mean 'gain'"),
        ('actions = ["gain"]', 'methods = ["arl"]', "'arl'; did you mean 'airl'"),
        ('actions = ["gain"]', "histories = [0]", "histories is 0"),
        ('"no-transfer", "random"', '"no-transfer", "randon"', "did you mean 'random'"),
        ('halved_step = ["tilt=0"]', 'halved_step = ["tilt=2"]', "halved_step has 'tilt=2'"),
        ('halved_step = ["tilt=0"]', 'sweeps = ["colour"]', "no sweep 'colour'"),
        ("Gain-AIRL = [0.983, 1.0]", "Gain-AIRL = [0.983]", "has 1 numbers"),
        ("Gain-AIRL = [0.983, 1.0]", "Gain-AIRL = [0.983, nan]", "must be finite"),
        ("[budget.peg-in-hole]", "[budget.peg-in-hol]", "did you mean 'peg-in-hole'"),
        ("episodes = 2\nsweep", "episodes = 0\nsweep", "episodes is 0"),
        ("episodes = 2\nsweep", "episodes = 2.5\nsweep", "expected an integer"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, old: str, new: str, message: str):
    refused(tmp_path, old, new, message)


@pytest.mark.parametrize(
    "content", [b"", b"\xff\xfe", b"[[table]", b"a = " + b"[" * 5000, b"name = 'x'\x00", b"a" * 1_000_001]
)
def test_hostile_files_are_refused(tmp_path: Path, content: bytes):
    path = tmp_path / "study.toml"
    path.write_bytes(content)
    with pytest.raises(VicError, match=r"study\.toml"):
        load(path)


def test_a_truncated_file_is_refused_wherever_it_ends(tmp_path: Path):
    whole = load(write(tmp_path))
    for length in range(0, len(TINY), 23):
        try:
            study = load(write(tmp_path, TINY[:length]))
        except VicError:
            continue
        assert study != whole  # what is left is a study of its own


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(st.sampled_from(["name", "seeds", "table", "budget", "x"]), inner, max_size=4)
        ),
        max_leaves=12,
    )
)
def test_whatever_json_holds_is_read_or_refused(tree: object):
    with pytest.raises(InputError):  # none of them is a whole study
        parse(tree, where="study.json")


def test_a_missing_file_names_what_there_is(tmp_path: Path):
    with pytest.raises(FileError, match=r"cannot be read.*paper, quick"):
        load(tmp_path / "nothing.toml")


def test_seeds_of_the_command_line_become_part_of_the_definition(tmp_path: Path):
    study = load(write(tmp_path))
    assert study.with_seeds([1, 2]).to_json()["seeds"] == (1, 2)
    with pytest.raises(InputError, match="twice"):
        study.with_seeds([1, 1])
