"""Sphinx configuration: MyST pages, an API reference from the docstrings, and the notebooks."""

from __future__ import annotations

import shutil
from pathlib import Path

from vic_toolbox import __version__

HERE = Path(__file__).parent

# Sphinx reads only below its own folder: the notebooks are copied in beside the pages.
shutil.rmtree(HERE / "notebooks", ignore_errors=True)
(HERE / "notebooks").mkdir()
for notebook in sorted((HERE.parent / "notebooks").glob("*.ipynb")):
    shutil.copy(notebook, HERE / "notebooks")

project = "vic_toolbox"
author = "The vic_toolbox authors"
project_copyright = author
version = release = __version__

extensions = [
    "myst_nb",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
]
exclude_patterns = ["_build", "_templates"]
templates_path = ["_templates"]
suppress_warnings = ["ref.python"]  # two parts may use the same short name

myst_enable_extensions = ["amsmath", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # the notebooks carry their outputs, and `make notebooks` executes them

autosummary_generate = True
autosummary_ignore_module_all = True
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say types, shapes and units
autodoc_preserve_defaults = True
add_module_names = False
numpydoc_show_class_members = False  # autodoc lists them

html_theme = "furo"
html_title = f"vic_toolbox {version}"
html_show_sourcelink = False
