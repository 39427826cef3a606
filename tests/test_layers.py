"""Imports point downward only, and the light layers stay light.

The layers are those of docs/index.md. A part may import the layers below its own, itself, and the third-party
packages of its row; what a lower row may use, a higher one may too.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

PACKAGE = Path(__file__).parents[1] / "vic_toolbox"


class Row(NamedTuple):
    """A row of the layer table."""

    layer: int
    third_party: frozenset[str]


def row(layer: int, *third_party: str) -> Row:
    return Row(layer, frozenset(third_party))


ROWS = {
    "errors": row(0, "numpy"),
    "files": row(0, "numpy"),
    "spatial": row(0, "numpy", "scipy"),
    "gains": row(0, "numpy", "scipy"),
    "models": row(1, "pinocchio"),
    "recordings": row(1, "rosbags", "mcap", "h5py", "lz4", "zstandard", "matplotlib"),
    "control": row(2, "numba"),
    "estimation": row(2, "casadi", "clarabel", "matplotlib", "sklearn", "threadpoolctl"),
    "stability": row(2, "control", "cvxpy", "clarabel", "threadpoolctl"),
    "tasks": row(3, "mujoco", "gymnasium", "imageio", "imageio_ffmpeg"),
    "learning": row(4, "torch", "safetensors", "threadpoolctl"),
    "twin": row(4),
    "experiments": row(5, "joblib", "matplotlib", "mpl_toolkits", "ray", "rich"),
    "cli": row(6, "tyro"),
    "__main__": row(7),
}
# Siblings on one layer do not import each other, except the modules of layer 0, in this order.
LAYER_0 = ["errors", "files", "spatial", "gains"]
HEAVY = {"torch", "mujoco", "gymnasium"}


def part_of(path: Path) -> str:
    """Name of the top-level part that a source file belongs to; '' for the package's own __init__."""
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return "" if parts == ("__init__",) else parts[0]


def imported(path: Path) -> set[str]:
    """Absolute dotted names of everything that a file imports, wherever in the file it does so.

    `vic_toolbox.tasks` as an attribute counts too, because the package imports its parts on first access.
    """
    package = ["vic_toolbox", *path.relative_to(PACKAGE).parts[:-1]]
    names: set[str] = set()
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level + 1] if node.level else []
            source = ".".join([*start, *([node.module] if node.module else [])])
            # `from vic_toolbox import tasks` names the part in the imported name, not in the source
            root = source == "vic_toolbox"
            names.update(f"{source}.{alias.name}" if root else source for alias in node.names)
        elif isinstance(node, ast.Attribute) and ast.unparse(node.value) in ("vic_toolbox", "vic"):
            names.add(f"vic_toolbox.{node.attr}")
    return names


def complaints(path: Path) -> list[str]:
    """What a file imports and should not."""
    part = part_of(path)
    layer = ROWS[part].layer
    below = [r for r in ROWS.values() if r.layer < layer]
    allowed = frozenset().union(*(r.third_party for r in below), ROWS[part].third_party)
    found = []
    for name in sorted(imported(path)):
        top, _, rest = name.partition(".")
        target = rest.partition(".")[0]
        if top == "vic_toolbox":
            if target in ("", part) or target.startswith("__"):
                continue
            if target not in ROWS:
                found.append(f"{name}: give {target} a row in ROWS")
            elif ROWS[target].layer >= layer and not earlier_in_layer_0(target, part):
                found.append(f"{name}: layer {ROWS[target].layer} from layer {layer}")
        elif top not in sys.stdlib_module_names and top not in allowed:
            found.append(f"{name}: not among {', '.join(sorted(allowed))}")
    return found


def earlier_in_layer_0(target: str, part: str) -> bool:
    return {target, part} <= set(LAYER_0) and LAYER_0.index(target) < LAYER_0.index(part)


SOURCES = sorted(path for path in PACKAGE.rglob("*.py") if part_of(path))
PARTS = sorted({part_of(path) for path in SOURCES})
LIGHT = [part for part in PARTS if part in ROWS and ROWS[part].layer <= 2]


def test_every_part_has_a_row():
    assert set(PARTS) <= ROWS.keys()


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_point_downward(path: Path):
    assert not complaints(path)


def test_an_upward_arrow_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys.modules[__name__], "PACKAGE", tmp_path)
    folder = tmp_path / "models"
    folder.mkdir()
    file = folder / "upward.py"
    for source in (
        "import torch",
        "def f():\n    import mujoco",
        "from vic_toolbox import tasks",
        "from vic_toolbox.control import law",
        "from ..learning.trpo import step",
        "from .. import experiments",
        "import vic_toolbox\nvic_toolbox.tasks.make",
    ):
        file.write_text(source)
        assert complaints(file), source
    file.write_text(
        "import math\nimport vic_toolbox\nfrom vic_toolbox.errors import InputError\nfrom . import other"
    )
    assert not complaints(file)


@pytest.mark.parametrize("module", ["vic_toolbox", *(f"vic_toolbox.{part}" for part in LIGHT)])
def test_import_is_light(module: str):
    """Neither directly nor through another package does a light part load torch, mujoco or a simulator."""
    code = f"import {module}, sys; print(*sorted({HEAVY | {'vic_toolbox.tasks'}!r} & sys.modules.keys()))"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert loaded.split() == []


def test_importing_the_package_loads_nothing_numeric():
    code = "import vic_toolbox, sys; print(*{'numpy', 'scipy', 'pinocchio', 'numba'} & sys.modules.keys())"
    loaded = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout
    assert loaded.split() == []
