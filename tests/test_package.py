"""The distribution: version, contents of the wheel, pinned versions, and what must not be in the sources."""

from __future__ import annotations

import ast
import importlib.metadata
import re
import subprocess
import sys
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import vic_toolbox

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
SOURCES = sorted((ROOT / "vic_toolbox").rglob("*.py"))


def tracked_files() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.stdout.split("\0") if name and (ROOT / name).is_file()]


def pins() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(name): version for name, version in pairs}


# version and parts --------------------------------------------------------------------------------


def test_version_is_the_same_everywhere():
    version = vic_toolbox.__version__
    assert importlib.metadata.version("vic-toolbox") == version
    headings = re.findall(r"^## \[(.+?)\]", (ROOT / "CHANGELOG.md").read_text(), flags=re.MULTILINE)
    assert version in headings or headings == ["Unreleased"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()


def test_parts_are_found_by_attribute_and_by_name():
    assert vic_toolbox.errors.VicError is vic_toolbox.errors.InputError.__mro__[1]
    assert {"errors", "spatial", "gains", "models", "control", "__version__"} <= set(dir(vic_toolbox))
    with pytest.raises(AttributeError, match="no attribute 'nonsense'.*spatial"):
        vic_toolbox.nonsense  # noqa: B018


# the wheel ----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_wheel_carries_the_robots_and_the_studies(tmp_path: Path):
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path]
    subprocess.run(build, cwd=ROOT, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    for robot in ("fanuc_lrmate200id7l", "cup_gripper", "peg"):
        assert {f"vic_toolbox/robots/{robot}/{robot}.urdf", f"vic_toolbox/robots/{robot}/robot.toml"} <= names
    assert {
        "vic_toolbox/py.typed",
        "vic_toolbox/studies/paper.toml",
        "vic_toolbox/studies/quick.toml",
    } <= names
    assert not any(name.startswith(("tests/", "robots/", "studies/")) for name in names)


# pinned versions ----------------------------------------------------------------------------------


def test_constraints_pin_every_dependency():
    pinned = pins()
    assert pinned["torch"] == "2.13.0"
    assert not [name for name in pinned if re.match(r"nvidia|cuda|triton", name)]
    groups = {name: group for name, group in PROJECT["optional-dependencies"].items() if name != "cluster"}
    for line in [*PROJECT["dependencies"], *chain.from_iterable(groups.values())]:
        requirement = Requirement(line)
        name = canonicalize_name(requirement.name)
        if name != "vic-toolbox":
            assert name in pinned, f"run `make constraints`: {name} has no exact version"
            assert requirement.specifier.contains(pinned[name], prereleases=True), line


def test_constraints_are_versions_and_nothing_else():
    for line in (ROOT / "constraints.txt").read_text().splitlines():
        assert line.startswith("#") or re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line), line


# the README ---------------------------------------------------------------------------------------


def test_readme_example_runs():
    (example,) = re.findall(
        r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    )
    subprocess.run([sys.executable, "-W", "error", "-c", example], check=True)


def test_links_between_pages_lead_somewhere():
    pages = [*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")]
    links = [(page, link) for page in pages for link in re.findall(r"\]\(([^)#]+)", page.read_text())]
    assert not [
        (page.name, link) for page, link in links if ":" not in link and not (page.parent / link).exists()
    ]


# what must not be there ---------------------------------------------------------------------------


UNSAFE_MODULES = {"pickle", "cloudpickle", "dill", "marshal", "shelve"}


def forbidden(source: str) -> list[str]:
    """Ways to run or load code that a file of data could carry."""
    found = []
    for node in ast.walk(ast.parse(source)):
        match node:
            case ast.Import(names=names):
                modules = [alias.name for alias in names]
            case ast.ImportFrom(module=str(module)):
                modules = [module]
            case ast.Call(func=ast.Name(id="eval" | "exec" as name)):
                found.append(name)
                continue
            case ast.keyword(arg="allow_pickle", value=ast.Constant(value=True)):
                found.append("allow_pickle=True")
                continue
            case _:
                continue
        found += [name for name in modules if name.split(".")[0] in UNSAFE_MODULES]
    return found


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_pickle_and_no_evaluation(path: Path):
    assert not forbidden(path.read_text(encoding="utf-8"))


def test_forbidden_constructs_are_seen():
    for source in ("import pickle", "from dill import load", "eval('1')", "np.load(f, allow_pickle=True)"):
        assert forbidden(source), source
    assert not forbidden("network.eval()\nnp.load(f, allow_pickle=False)")


def test_no_package_registry_is_named():
    domains = ["pypi", "pythonhosted", "npmjs", "debian"]  # joined here, so that this file names none either
    hosts = [f"{domain}.{top}" for domain in domains for top in ("org", "com", "io")]
    for path in tracked_files():
        text = path.read_bytes().decode("utf-8", errors="ignore")
        assert not [host for host in hosts if host in text], path
