"""A Python environment of its own for the reference learner, made once with pip in exact versions.

The reference needs gymnasium 0.29 and NumPy 1, the toolbox later ones: they cannot share an environment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from vic_toolbox.errors import VicError

REQUIREMENTS = Path(__file__).with_name("requirements-imitation.txt")
SUPPORTED = ((3, 11), (3, 12))  # what the pinned NumPy 1.26 has wheels for


class BenchmarkError(VicError):
    """The reference learner cannot be installed or does not run, so there is nothing to compare with."""


def reference_python(folder: Path) -> Path:
    """The interpreter of the reference environment in `folder`, made if it is missing or out of date.

    A stamp is written last, so an interrupted installation is simply done again.

    Raises
    ------
    BenchmarkError : the folder holds something else, there is no supported Python, or pip failed.
    """
    python, stamp = folder / "bin" / "python", folder / "installed.txt"
    requirements = REQUIREMENTS.read_text(encoding="utf-8")
    if python.exists() and stamp.exists() and stamp.read_text(encoding="utf-8") == requirements:
        return python
    if folder.exists() and not _may_be_cleared(folder):
        raise BenchmarkError(
            f"{folder} is neither a Python environment nor an empty folder, and making the reference "
            "environment would clear it; give another --environment. Nothing was measured."
        )
    print(f"making the reference environment {folder} (once, about 2 GB) ...", flush=True)
    _run([_supported_interpreter(), "-m", "venv", "--clear", str(folder)])
    pip = [str(python), "-m", "pip", "--disable-pip-version-check", "--no-input"]
    _run([*pip, "install", "--quiet", "--requirement", str(REQUIREMENTS)])
    stamp.write_text(requirements, encoding="utf-8")
    return python


def _may_be_cleared(folder: Path) -> bool:
    return folder.is_dir() and ((folder / "pyvenv.cfg").exists() or not any(folder.iterdir()))


def clean_environment() -> dict[str, str]:
    """The environment variables of a process, without those that would point Python at other packages."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "PYTHONHOME")}


def _supported_interpreter() -> str:
    if sys.version_info[:2] in SUPPORTED:
        return sys.executable
    names = [f"python{major}.{minor}" for major, minor in SUPPORTED]
    for name in names:
        if found := shutil.which(name):
            return found
    raise BenchmarkError(
        f"the reference library needs {' or '.join(names)} and neither is on the PATH (this is Python "
        f"{sys.version_info.major}.{sys.version_info.minor}); install one of them. Nothing was measured."
    )


def _run(command: list[str]) -> None:
    try:
        result = subprocess.run(command, env=clean_environment(), capture_output=True, text=True, check=False)
    except OSError as error:
        failure = str(error)
    else:
        if not result.returncode:
            return
        failure = result.stderr.strip() or result.stdout.strip()
    raise BenchmarkError(
        f"the reference environment cannot be made: `{' '.join(command)}` failed with\n{failure[-2000:]}\n"
        "It needs a package index once: connect to the network, or point PIP_INDEX_URL or PIP_FIND_LINKS at "
        "one. Nothing was measured."
    )
