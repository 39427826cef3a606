"""Each notebook is a pair, the script and its .ipynb; both agree, and the script runs from top to bottom.

``VIC_FAST=1`` asks a notebook for its small settings.
"""

from __future__ import annotations

from pathlib import Path

import jupytext
import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parents[1] / "notebooks"
SCRIPTS = sorted(FOLDER.glob("*.py"))


def cells(notebook: nbformat.NotebookNode) -> list[tuple[str, str]]:
    return [(cell.cell_type, cell.source.strip()) for cell in notebook.cells]


def test_no_notebook_is_alone():
    assert [path.stem for path in SCRIPTS] == sorted(path.stem for path in FOLDER.glob("*.ipynb"))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_pair_agrees(script: Path):
    pair = script.with_suffix(".ipynb")
    message = f"bring the pair together with `jupytext --sync {script.relative_to(FOLDER.parent)}`"
    assert cells(jupytext.read(script)) == cells(nbformat.read(pair, as_version=4)), message


@pytest.mark.notebook
@pytest.mark.timeout(900)
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_runs_from_top_to_bottom(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("VIC_FAST", "1")
    notebook = jupytext.read(script)
    # run in an empty folder: a notebook depends on the installed package only, and leaves nothing in the tree
    NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
