"""The documentation site: built without a warning, its snippets run, its reference leaves nothing out."""

import importlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from meshing import read_gmsh
from tests.environment.test_readme import assert_printed

ROOT = Path(__file__).resolve().parents[2]
SNIPPETS = {
    page: re.findall(r"```python\n(.*?)```", page.read_text(), re.S)
    for page in sorted(ROOT.glob("docs/*.md"))
}
_spec = importlib.util.spec_from_file_location("pictures", ROOT / "docs/pictures.py")
PICTURES = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(PICTURES)
WITH_SNIPPETS = [page for page, found in SNIPPETS.items() if found]


@pytest.mark.parametrize("face", ["meshing", "sbfem_petsc", "sbfem_petsc.indicators", "sbfem_petsc.plot"])
def test_every_public_name_stands_in_the_reference(face):
    """At the module that it comes from."""
    page = (ROOT / "docs/reference" / f"{face.split('.')[-1]}.md").read_text()
    home = importlib.import_module(face)
    named = re.findall(r"^::: ([\w.]+)\.(\w+)$", page, re.M)
    assert {name for _, name in named} == set(home.__all__) - {"__version__"}
    assert all(vars(importlib.import_module(place))[name] is getattr(home, name) for place, name in named)


@pytest.mark.long
def test_the_added_analysis(tmp_path):
    """The change that CONTRIBUTING.md shows can be put on, and its test and those of all kinds pass."""
    if shutil.which("git") is None:
        pytest.skip("there is no git")
    for folder in ("meshing", "sbfem_petsc", "tests", "docs", "examples", "pyproject.toml"):
        place, unread = ROOT / folder, shutil.ignore_patterns("__pycache__", "*.png", "*.ipynb")
        shutil.copytree(place, tmp_path / folder, ignore=unread) if place.is_dir() else shutil.copy(
            place, tmp_path
        )
    subprocess.run(["git", "apply", "docs/adding_an_analysis.patch"], cwd=tmp_path, check=True)
    own = os.environ | {"PYTHONPATH": str(tmp_path)}
    subprocess.run([sys.executable, "docs/make_pages.py"], cwd=tmp_path, env=own, check=True)
    tests = [
        "tests/analysis/test_receptance.py",
        "tests/study/test_kinds.py",
        "tests/analysis/test_options.py",
        "tests/study/test_case_file.py::test_documentation_in_sync",
        "tests/environment/test_documentation.py::test_every_public_name_stands_in_the_reference",
    ]
    run = [sys.executable, "-m", "pytest", "-q", "-n0", "-p", "no:cacheprovider", *tests]
    done = subprocess.run(run, cwd=tmp_path, env=own, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
def test_built_without_a_warning(tmp_path):
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path / "site")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "site" / "tutorial.html").stat().st_size > 10_000
    reference = tmp_path / "site" / "reference"
    assert "detection_probability" in (reference / "indicators.html").read_text()
    assert ">look<" not in (reference / "plot.html").read_text()  # pictures' keywords are written out


@pytest.mark.long
@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=lambda page: page.stem)
def test_snippets_run(page, tmp_path, monkeypatch, capsys):
    """From the first to the last, which need nothing that a page does not say, and print what it shows."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(ROOT / "tests/bodies/calculix", tmp_path, dirs_exist_ok=True)  # what bodies.md shows
    for number, drawing in enumerate(re.findall(r"```geo\n(.*?)```", page.read_text(), re.S)):
        saved = Path("plate.geo" if number == 0 else f"further{number}.geo")  # the name that the page says
        saved.write_text(drawing)
        read_gmsh(str(saved), scale=1e-3)
    names: dict = {}
    for snippet in SNIPPETS[page]:
        exec(compile(snippet, page.name, "exec"), names)
    shown = re.findall(r"```python\n.*?```\n\n```text\n(.*?)```", page.read_text(), re.S)
    assert_printed("\n".join(shown), capsys.readouterr().out)


def test_pictures_of_the_pages():
    """Each picture is drawn by docs/pictures.py, and stands in a page."""
    drawn = {*PICTURES.PAGES, *PICTURES.PROGRAMS}
    assert drawn == {path.name for path in (ROOT / "docs").glob("*.[pg][ni][gf]")}
    pages = [ROOT / "README.md", *(ROOT / "docs").rglob("*.md")]
    text = "".join(page.read_text() for page in pages)
    assert all(f"{name})" in text for name in drawn)


@pytest.mark.long
def test_pictures_are_what_the_programs_draw(tmp_path):
    """Those of the cheapest page and example, anew: they differ in less than one of 500 pixels."""
    names = ["swept.png", "discretisation.png", "crack.png"]
    PICTURES.draw(names, tmp_path)
    for name in names:
        drawn, stands = (imread(folder / name)[..., :3] for folder in (tmp_path, ROOT / "docs"))
        assert drawn.shape == stands.shape, name
        assert (np.abs(drawn - stands).max(axis=2) > 0.3).mean() < 0.002, name


def _stream(output):
    return output.get("name", "")


@pytest.mark.long
@pytest.mark.parametrize("name", [path.stem for path in sorted((ROOT / "docs").glob("*.ipynb"))])
def test_notebooks_run(name, tmp_path):
    """From the first cell to the last, with the numbers and as many pictures as stand there."""
    import nbclient  # slow to load, for all that find tests
    import nbformat

    notebook = nbformat.read(ROOT / f"docs/{name}.ipynb", as_version=4)
    shown = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    client = nbclient.NotebookClient(
        notebook, timeout=240, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute(env=environment)
    again = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    pictures = [["image/png" in o.get("data", {}) for o in outputs] for outputs in shown]
    assert sum(map(sum, pictures)) >= 2
    for before, after in zip(shown, again, strict=True):
        kinds = [[("image/png" in o.data) for o in part if "data" in o] for part in (before, after)]
        assert sum(kinds[0]) == sum(kinds[1])
        # prints and warnings apart: which of the two streams arrives first is chance
        texts = [
            "".join(o.get("text", "") for o in sorted(outputs, key=_stream)) for outputs in (before, after)
        ]
        # what solvers leave is rounding
        texts = [re.sub(r"largest residual \S+", "", text) for text in texts]
        numbers = [
            [float(n) for n in re.findall(r"(?<![\w.])-?\d+\.\d+(?:e[+-]\d+)?", text)] for text in texts
        ]
        # four digits: the tutorial's mesh is coarser than the default, on the same machine the rest is equal
        assert numbers[1] == pytest.approx(numbers[0], rel=1e-3, abs=1e-12)
