"""What the project says about itself: one version, the same requirements for pip and conda, an installed copy
that is complete and typed.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

tomllib = pytest.importorskip("tomllib", reason="Python 3.10 has no tomllib")

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
PACKAGES = ("meshing", "sbfem_petsc")
CONDA_NAMES = {"gmsh": "python-gmsh", "matplotlib": "matplotlib-base"}


def split(requirement: str) -> tuple[str, str]:
    """Name and condition of a requirement."""
    name = re.match(r"[\w.-]+", requirement)[0]
    return name, requirement[len(name) :].split(";")[0].strip()


def test_conda_and_pip_ask_for_the_same():
    """Every requirement of pyproject.toml stands in environment.yml with the same oldest version."""
    lines = (ROOT / "environment.yml").read_text().split("dependencies:\n")[1].splitlines()
    conda = dict(split(line.strip()[2:]) for line in lines if line.strip().startswith("- "))
    asked = [
        *PROJECT["dependencies"],
        *(r for extra in PROJECT["optional-dependencies"].values() for r in extra),
    ]
    for requirement in asked:
        name, condition = split(requirement)
        assert conda.get(CONDA_NAMES.get(name, name)) == condition, requirement


def test_version_stands_once():
    """In sbfem_petsc/__init__.py; pyproject.toml reads it there."""
    import sbfem_petsc

    assert "version" in PROJECT["dynamic"] and "version" not in PROJECT
    assert re.fullmatch(r"\d+\.\d+\.\d+", sbfem_petsc.__version__)
    holders = [
        path
        for path in (ROOT / "pyproject.toml", ROOT / "CITATION.cff", *(ROOT / "sbfem_petsc").rglob("*.py"))
        if f'"{sbfem_petsc.__version__}"' in path.read_text()
    ]
    assert holders == [ROOT / "sbfem_petsc" / "__init__.py"]


@pytest.mark.slow
def test_wheel(tmp_path):
    """A wheel holds every module, says that it is typed, and bears the version."""
    import sbfem_petsc

    source = tmp_path / "source"  # setuptools leaves what it builds where it builds it
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    pip = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation", "--quiet"]
    done = subprocess.run([*pip, "-w", tmp_path, source], capture_output=True, text=True, timeout=300)
    if "No module named 'setuptools" in done.stderr:
        pytest.skip("there is no setuptools of this project's age")
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name.split("-")[1] == sbfem_petsc.__version__
    names = set(zipfile.ZipFile(wheel).namelist())
    sources = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix == ".py" or path.name == "py.typed"
    }
    assert sources <= names and {"meshing/py.typed", "sbfem_petsc/py.typed"} <= names
    assert not {name for name in names if name.startswith(("tests/", "examples/"))}


def test_citation():
    """CITATION.cff is YAML with what readers of the format require, and the licence of the package."""
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["title"] == PROJECT["name"] and citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]


def test_contributing_names_what_exists():
    """Files and folders in backticks, and the commands' programs."""
    text = (ROOT / "CONTRIBUTING.md").read_text()
    names = {name for name in re.findall(r"`([^`\n]+)`", text) if re.fullmatch(r"[\w./-]*/[\w./-]*", name)}
    assert len(names) > 25
    missing = {name for name in names - {"./run"} if not (ROOT / name).exists()}
    assert not missing


def test_examples_are_short():
    """Programs of at most 60 lines, case files that are valid."""
    from sbfem_petsc.study.case import read_case

    programs = sorted((ROOT / "examples").glob("*.py"))
    cases = sorted((ROOT / "examples").glob("*.toml"))
    assert len(programs) >= 10 and len(cases) >= 4
    assert not [path.name for path in programs if len(path.read_text().splitlines()) > 60]
    assert all(read_case(path).tables.title for path in cases)
