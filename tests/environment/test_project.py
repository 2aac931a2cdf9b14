"""What the project says about itself: one version, the same requirements for pip and conda, an installed copy
that is complete and typed, rooms that use only those before them, functions with few arguments by position.
"""

from __future__ import annotations

import ast
import functools
import graphlib
import importlib
import importlib.util
import inspect
import os
import re
import shutil
import subprocess
import sys
import tarfile
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
    """Every requirement of pyproject.toml stands in environment.yml with the same oldest version, but for the
    reader of Ansys' files, which conda has not and pip builds for some Pythons alone.
    """
    lines = (ROOT / "environment.yml").read_text().split("dependencies:\n")[1].splitlines()
    conda = dict(split(line.strip()[2:]) for line in lines if line.strip().startswith("- "))
    asked = [
        *PROJECT["dependencies"],
        *(r for extra in PROJECT["optional-dependencies"].values() for r in extra if "ansys" not in r),
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
    released = re.findall(r"^## \[([\d.]+)\] - \d{4}-\d\d-\d\d$", (ROOT / "CHANGELOG.md").read_text(), re.M)
    assert released[0] == sbfem_petsc.__version__


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sources as in a clone, and the wheel and the sdist that setuptools makes of them."""
    folder = tmp_path_factory.mktemp("built")
    source = folder / "source"  # setuptools leaves what it builds where it builds it
    source.mkdir()
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    for package in PACKAGES:
        shutil.copytree(ROOT / package, source / package, ignore=shutil.ignore_patterns("__pycache__"))
    program = (
        "from setuptools import build_meta as b; "
        f"b.build_sdist({str(folder)!r}); b.build_wheel({str(folder)!r})"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=source, capture_output=True, text=True, timeout=300
    )
    if done.returncode and ("setuptools" in done.stderr or "license" in done.stderr):
        pytest.skip("there is no setuptools of this project's age")
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.long
def test_wheel_and_sdist(built):
    """Both hold every module, say that it is typed, and bear the version."""
    import sbfem_petsc

    (wheel,), (sdist,) = built.glob("*.whl"), built.glob("*.tar.gz")
    assert wheel.name.split("-")[1] == sbfem_petsc.__version__
    sources = {
        str(path.relative_to(ROOT))
        for package in PACKAGES
        for path in (ROOT / package).rglob("*")
        if path.suffix in (".py", ".toml", ".geo") or path.name == "py.typed"
    }
    inside = f"sbfem_petsc-{sbfem_petsc.__version__}/"
    for names in (
        set(zipfile.ZipFile(wheel).namelist()),
        {name.removeprefix(inside) for name in tarfile.open(sdist).getnames()},
    ):
        assert sources <= names and {"meshing/py.typed", "sbfem_petsc/py.typed"} <= names
        assert not {name for name in names if name.startswith(("tests/", "examples/"))}


@pytest.mark.long
def test_the_wheel_runs(built, tmp_path):
    """Installed beside nothing of the sources, by its second name for meshing too, with its starter cases."""
    (wheel,) = built.glob("*.whl")
    place = tmp_path / "place"
    pip = [sys.executable, "-m", "pip", "install", "--no-deps", "--no-index", "--quiet", "--target"]
    subprocess.run([*pip, place, wheel], check=True, timeout=300)
    program = """
import sbfem_petsc as sb
from sbfem_petsc.meshing import Beam
import meshing
assert meshing.Beam is Beam
model = sb.Model(Beam(1.0, 0.1).mesh(order=2), sb.Material(70e9, 0.3, 2700.0))
print(sb.__file__, float(sb.modal(model, 1).frequencies[0]))
from sbfem_petsc.cli import main
main(["new", "beam", "case.toml"])
"""
    environment = {**os.environ, "PYTHONPATH": str(place)}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    file, frequency = done.stdout.split()[:2]
    assert Path(file).is_relative_to(place) and (tmp_path / "case.toml").exists()
    # a slender beam's first frequency by Bernoulli, with shear and rotation 1 % less
    assert float(frequency) == pytest.approx(0.1615 * 0.1 * (70e9 / 2700.0) ** 0.5, rel=0.015)


@pytest.mark.long
def test_an_environment_by_the_pages_lines(built, tmp_path):
    """On Debian: the lines of docs/installing.md make an environment whose doctor finds the system's PETSc;
    what pip would load is that which this one has.
    """
    if not [*Path("/usr/lib/petscdir").glob("petsc3*/*-real")] or sys.base_prefix != "/usr":
        pytest.skip("there is no PETSc of Debian's for this Python")
    page = (ROOT / "docs/installing.md").read_text().split("## An environment of your own on Debian")[1]
    venv, visible, install, doctor = re.search(r"```\n(.*?)```", page, re.S)[1].splitlines()[2:]
    assert install.startswith("env/bin/pip install") and "'.[plot]'" in install
    (wheel,) = built.glob("*.whl")
    here = next(p for p in sys.path if p.startswith(sys.prefix) and p.endswith("site-packages"))
    offline = f"env/bin/pip install --quiet --no-deps --no-index --force-reinstall --no-compile {wheel}"
    # behind the line that is tested, and without what pip has linked there
    borrowed = f"for place in env/lib/*/site-packages; do echo {here} > $place/zz-others.pth; done"
    script = "\n".join(["set -eu", venv, visible, offline, borrowed, doctor])
    kept = {n: v for n, v in os.environ.items() if n not in ("PYTHONPATH", "VIRTUAL_ENV")}
    kept["PATH"] = f"/usr/bin:{kept['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=kept, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"PETSc +3\.\d+", done.stdout) and "no fault was found" in done.stdout
    program = "import sbfem_petsc, petsc4py; print(sbfem_petsc.__file__, petsc4py.__file__)"
    found = subprocess.run(
        [tmp_path / "env/bin/python", "-c", program], cwd=tmp_path, env=kept, capture_output=True, text=True
    )
    ours, theirs = map(Path, found.stdout.split())
    assert ours.is_relative_to(tmp_path / "env") and theirs.is_relative_to("/usr/lib/petscdir")


def test_a_file_of_the_users_called_meshing(tmp_path):
    """It stands before the package, and is named."""
    (tmp_path / "meshing.py").write_text("")
    done = subprocess.run(
        [sys.executable, "-c", "import sbfem_petsc"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 1
    assert re.search(r"ImportError: \S*meshing\.py is found .* another name", done.stderr.splitlines()[-1])


def test_versions_that_ci_takes():
    """Each package that pip installs is held to one version, which is one that pyproject.toml allows."""
    held = dict(
        line.split("==") for line in (ROOT / ".ci/constraints.txt").read_text().splitlines() if "==" in line
    )
    taken = re.search(r"developers_extras=\((.*?)\)", (ROOT / "run").read_text())[1].split()
    asked = [*PROJECT["dependencies"], *(r for e in taken for r in PROJECT["optional-dependencies"][e])]
    for requirement in asked:
        name, condition = split(requirement)
        if name in ("mpi4py", "tomli"):  # the system's, and older Pythons'
            continue
        lowest = [int(part) for part in condition.removeprefix(">=").split(".")]
        version = re.findall(r"\d+", held[name.lower().replace("_", "-")])
        assert [int(part) for part in version[: len(lowest)]] >= lowest, requirement


def test_citation():
    """CITATION.cff is YAML with what readers of the format require, and the licence of the package."""
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    assert citation["title"] == PROJECT["name"] and citation["license"] == PROJECT["license"]
    assert citation["authors"] == PROJECT["authors"]


def test_contributing_names_what_exists():
    """Files and folders in backticks, and the commands' programs."""
    text = (ROOT / "CONTRIBUTING.md").read_text() + (ROOT / "docs/extending.md").read_text()
    names = {name for name in re.findall(r"`([^`\n]+)`", text) if re.fullmatch(r"[\w./-]*/[\w./-]*", name)}
    assert len(names) > 25
    missing = {name for name in names - {"./run"} if not (ROOT / name).exists()}
    assert not missing


def test_examples_are_short():
    """Programs of 20 to 60 lines that import the library alone, case files that are valid."""
    from sbfem_petsc.study.case.case import read_case

    programs = sorted((ROOT / "examples").glob("*.py"))
    cases = sorted((ROOT / "examples").glob("*.toml"))
    assert len(programs) >= 10 and len(cases) >= 4
    assert all(20 <= len(path.read_text().splitlines()) <= 60 for path in programs)
    assert not [
        path.name
        for path in programs
        if re.search(r"^ *(from|import) (examples|paper|tests)", path.read_text(), re.M)
    ]
    assert all(read_case(path).tables.title for path in cases)


def test_programs_import_what_exists():
    """Also those that no short test starts: the paper's report, benchmarks, what draws the pages."""
    missing = set()
    for path in (p for folder in ("examples", "benchmarks", "docs") for p in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PACKAGES:
                module = importlib.import_module(node.module)
                for name in (alias.name for alias in node.names):
                    whole = f"{node.module}.{name}"
                    inside = hasattr(module, "__path__") and importlib.util.find_spec(whole)
                    if not hasattr(module, name) and not inside:
                        missing.add(f"{path.name}: {whole}")
    assert not missing


@functools.cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@functools.cache
def imported(*, in_functions: bool = True) -> dict[str, set[str]]:
    """Modules of the packages that each of them uses, for types alone or within functions too."""
    files = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
    }

    def used(name: str, tree: ast.AST):
        waiting = [tree]
        while waiting:
            node = waiting.pop()
            if isinstance(node, ast.FunctionDef) and not in_functions:
                continue
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                ours = name.split(".") + ["__init__"] * (files[name].name == "__init__.py")
                above = ".".join(ours[: -node.level]) if node.level else ""
                base = ".".join(part for part in (above, node.module) if part)
                whole = (f"{base}.{alias.name}" for alias in node.names)
                yield from (one if one in files else base for one in whole)
            # expressions hold no imports
            waiting += [child for child in ast.iter_child_nodes(node) if not isinstance(child, ast.expr)]

    return {
        name: {other for other in used(name, parsed(path)) if other in files} - {name}
        for name, path in files.items()
    }


def test_folders_are_small():
    """At most 20 modules side by side."""
    folders = {path.parent for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    found = {str(f.relative_to(ROOT)): len([*f.glob("*.py")]) - (f / "__init__.py").exists() for f in folders}
    assert len(found) > 25
    assert not {name: count for name, count in found.items() if count > 20}


@pytest.mark.slow
def test_no_circles():
    """Neither of modules nor of rooms, which stand in the order that CONTRIBUTING.md gives, for types alone
    either.
    """
    modules = imported()
    assert sum(map(len, modules.values())) > 500
    rooms: dict[str, set[str]] = {}
    for name, others in modules.items():
        room = tuple(name.split(".")[:2])
        rooms.setdefault(room, set()).update({tuple(o.split(".")[:2]) for o in others} - {room})
    for graph in (modules, rooms):
        graphlib.TopologicalSorter(graph).prepare()  # CycleError names a circle
    drawing = (ROOT / "CONTRIBUTING.md").read_text().split("```")[1]
    sections = {part.split("/")[0]: part for part in re.split(r"\n(?=\S)", drawing)}
    order = [
        (package, room) for package in PACKAGES for room in re.findall(r"\n    (\w+)/", sections[package])
    ]
    there = {
        path.relative_to(ROOT).parts[:2] for package in PACKAGES for path in ROOT.glob(f"{package}/*/*.py")
    }
    assert len(order) == len(set(order)) and set(order) == there - {("sbfem_petsc", "ranks")}
    place = {room: k for k, room in enumerate(order)}
    upwards = {
        (room, other)
        for room, others in rooms.items()
        for other in others
        if room in place and other in place and place[other] > place[room]
    }
    assert not upwards
    # beside the rooms stands what they use, and the program that begins with the last one
    beside = {
        (room[-1], other[-1])
        for room, others in rooms.items()
        for other in others & place.keys()
        if room not in place and room[0] == "sbfem_petsc"
    }
    assert beside == {("loads", "signals"), ("__main__", "cli")}


# Neither is imported while a thread of ours may wait for it: under an MPI launcher alone, before all else.
AT_THE_START = {"sbfem_petsc.ranks", "sbfem_petsc.ranks.abort"}


@pytest.mark.slow
def test_no_thread_waits_for_another():
    """A thread that imports a.b.c holds its lock while it imports a, a.b and what a.b.c imports: without a
    circle among these two threads never wait for each other, which Python ends by handing out a module that
    is half made.
    """
    waits = {}
    for name, others in imported(in_functions=False).items():
        parts = [module.split(".") for module in (name, *others)]
        waits[name] = {".".join(p[:k]) for p in parts for k in range(1, len(p) + 1)} - {name}
    assert sum(map(len, waits.values())) > 1000
    assert AT_THE_START <= waits["sbfem_petsc"]
    waits["sbfem_petsc"] -= AT_THE_START
    graphlib.TopologicalSorter(waits).prepare()  # CycleError names a circle


@pytest.mark.slow
def test_faces_are_for_users():
    """Modules of ours import from the module that a name comes from; studies write `sb.` and `plot.`
    as users do.
    """
    faces = {"meshing", "sbfem_petsc", "sbfem_petsc.indicators", "sbfem_petsc.plot"}
    assert all(hasattr(importlib.import_module(face), "_HOME") for face in faces)
    taken = {(name.split(".")[1], face) for name, found in imported().items() for face in faces & found}
    names = {("meshing", "meshing")}  # its second name
    assert taken - names == {("study", "sbfem_petsc"), ("study", "sbfem_petsc.plot"), ("cli", "sbfem_petsc")}


@pytest.mark.slow
def test_few_arguments_by_position():
    """At most four of each public function and method; more would be read as a row of numbers."""
    checked = 0
    for module in ("sbfem_petsc", "sbfem_petsc.plot", "sbfem_petsc.indicators", "meshing"):
        home = importlib.import_module(module)
        for name in home.__all__:
            item = getattr(home, name)
            own = [item] if inspect.isfunction(item) else []
            if inspect.isclass(item):
                functions = inspect.getmembers(item, lambda f: inspect.isfunction(f) or inspect.ismethod(f))
                own = [function for n, function in functions if not n.startswith("_")]
            for function in own:
                parameters = inspect.signature(function).parameters.values()
                given = [p.name for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]
                checked += 1
                assert len([n for n in given if n != "self"]) <= 4, (name, function)
    assert checked > 150


# Public functions whose options, by keyword only, are more than six arguments in all.
OPTIONS = {
    "sbfem_petsc/analysis/backbone.py: backbone",
    "sbfem_petsc/bodies/finite_element_model.py: contact",
    "sbfem_petsc/bodies/readers.py: read_matrices",
    "sbfem_petsc/analysis/basins.py: basins",
    "sbfem_petsc/analysis/estimate.py: estimate",
    "sbfem_petsc/analysis/locus.py: loci",
    "sbfem_petsc/analysis/locus.py: locus",
    "sbfem_petsc/analysis/periodic.py: periodic",
    "sbfem_petsc/analysis/quasi_periodic.py: quasi_periodic",
    "sbfem_petsc/analysis/quasi_periodic_response.py: quasi_periodic_response",
    "sbfem_petsc/analysis/response.py: frequency_response",
    "sbfem_petsc/analysis/response.py: load_response",
    "sbfem_petsc/analysis/swept.py: swept_response",
    "sbfem_petsc/analysis/estimate_error.py: estimate_error",
    "sbfem_petsc/analysis/transient.py: transient",
    "sbfem_petsc/plot/animation.py: animate_crack",
    "sbfem_petsc/plot/branches.py: plot_branches",
    "sbfem_petsc/plot/histories.py: plot_history",
    "sbfem_petsc/plot/histories.py: plot_load_history",
    "sbfem_petsc/plot/histories.py: plot_spectra",
    "sbfem_petsc/plot/lines.py: plot_harmonics",
    "sbfem_petsc/plot/orbits.py: plot_orbit",
    "sbfem_petsc/plot/rubbing.py: plot_losses",
    "sbfem_petsc/plot/sweeps.py: plot_swept",
    "sbfem_petsc/plot/lines.py: plot_lines",
    "sbfem_petsc/plot/branches.py: plot_quasi_periodic",
    "sbfem_petsc/bodies/finite_element_model.py: __init__",
    "sbfem_petsc/reduction/build.py: reduce",
    "sbfem_petsc/reduction/matrices.py: reduce_matrices",
    "sbfem_petsc/results/animation.py: write_animation",
    "sbfem_petsc/study/sweep.py: sweep",
    "sbfem_petsc/system/model.py: __init__",
    "meshing/beam.py: mesh",
    "meshing/beam.py: write",
    "meshing/gmsh/reader.py: read_gmsh",
    "meshing/plate.py: mesh",
}


@pytest.mark.slow
def test_few_arguments():
    """At most six of each function, method and kernel, whoever calls it: what belongs together is one."""
    longer, checked = set(), 0
    for room in ("sbfem_petsc", "meshing", "benchmarks"):
        for path in sorted((ROOT / room).rglob("*.py")):
            for node in ast.walk(parsed(path)):
                if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
                    continue
                a = node.args
                given = [x.arg for x in (*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg) if x]
                checked += 1
                if len([name for name in given if name not in ("self", "cls")]) > 6:
                    longer.add(f"{path.relative_to(ROOT).as_posix()}: {getattr(node, 'name', 'lambda')}")
    assert longer == OPTIONS
    assert checked > 2000
