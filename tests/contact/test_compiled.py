"""What is compiled, where it is kept, and what an analysis computes once."""

import os
import shutil
import subprocess
import sys

import pytest

import sbfem_petsc as sb
from sbfem_petsc.contact.compiled import KernelFiles
from sbfem_petsc.contact.marching import Address
from sbfem_petsc.contact.pivoting import contact_forces
from sbfem_petsc.contact.precompile import compile_kernels
from sbfem_petsc.system import model as model_module
from tests.parallel import ROOT, answer
from tests.reference import paper_beam
from tests.systems import ALUMINIUM

# A module of `contact/`: a kernel, and what it calls.
SMALL = """
import numpy as np
from .compiled import compiled, inner_loops
@inner_loops
def twice(number):
    return 2.0 * number
@compiled
def doubled(numbers):
    return twice(numbers.sum())
print(doubled(np.ones(3)))
print(len(doubled.signatures), doubled.stats.cache_path)
"""


def run(folder, **environment):
    inherited = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")}
    done = subprocess.run(
        [sys.executable, "-m", "sbfem_petsc.contact.small"],
        cwd=folder,
        env={**inherited, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1", **environment},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.long
@pytest.mark.parametrize("cache", ["beside", "user", "none"])
def test_directories_that_cannot_be_written(tmp_path, cache):
    """Machine code is kept beside the source, else in the user's cache directory; with neither it runs."""
    shutil.copytree(
        ROOT / "sbfem_petsc", tmp_path / "sbfem_petsc", ignore=shutil.ignore_patterns("__pycache__")
    )
    (tmp_path / "sbfem_petsc" / "contact" / "small.py").write_text(SMALL)
    home = tmp_path / "home"
    if cache != "beside":
        # a file where the directory would be: nothing can be written there, not even by root
        (tmp_path / "sbfem_petsc" / "contact" / "__pycache__").write_text("")
    if cache == "none":
        home.write_text("")
    else:
        home.mkdir()
    first, second = run(tmp_path, HOME=str(home), XDG_CACHE_HOME=str(home / ".cache"))
    assert first == "6.0"
    kept = list(tmp_path.rglob("*.nbc"))
    if cache == "none":
        assert not kept and second == "1 None"
    else:
        where = tmp_path / "sbfem_petsc" if cache == "beside" else home
        assert kept and all(where in path.parents for path in kept)
    if cache == "user":  # what a kernel calls is compiled anew with it
        with open(tmp_path / "sbfem_petsc" / "contact" / "law.py", "a") as file:
            file.write("# a change\n")
        assert run(tmp_path, HOME=str(home), XDG_CACHE_HOME=str(home / ".cache"))[0] == first
        assert len(list(home.rglob("*.nbc"))) == 2 * len(kept)


def test_files_of_kernels(tmp_path):
    """Two processes that keep two kinds at once, each before it sees the other's, read each its own; what is
    cut or of other sources counts for nothing; a folder that is only read comes after one's own; one that
    cannot be written is no error.
    """
    one, other = KernelFiles(contact_forces), KernelFiles(contact_forces)
    for files in (one, other):
        files._cache_path, files.folders = str(tmp_path), [str(tmp_path)]
    assert one.load("a") is None
    one.save("a", "code of a")
    other.save("b", "code of b")
    assert [files.load(kind) for files in (one, other) for kind in "ab"] == 2 * ["code of a", "code of b"]
    mine = tmp_path / "mine"
    mine.mkdir()
    reader = KernelFiles(contact_forces)
    reader._cache_path, reader.folders = str(mine), [str(mine), str(tmp_path)]
    assert reader.load("a") == "code of a"
    reader.save("a", "mine")
    assert reader.load("a") == "mine" and one.load("a") == "code of a"
    (tmp_path / one.file_name("b")).write_bytes(b"")
    assert one.load("b") is None
    reader._cache_path = str(tmp_path / "missing")
    reader.save("c", "nowhere")
    assert reader.load("c") is None
    other._source_stamp = "changed"
    assert other.load("a") is None


KERNELS = """
import numba
import numpy as np
import sbfem_petsc as sb
from sbfem_petsc.contact import marching, pivoting, step_work
from tests.systems import coarse_beam
reduced = sb.reduce_matrices(
    np.eye(3),
    2.0 * np.eye(3) - np.eye(3, k=1) - np.eye(3, k=-1),
    np.eye(3)[:2],
    np.full(2, 0.1),
    loads=np.eye(3)[:, :1],
    sensors={"a": 2},
    damping=0.02,
    compliance=np.full(2, 0.01),
)
sb.transient(reduced, [sb.Harmonic(1.0, 0.1)], 30.0, step=0.05)
sb.periodic(reduced, [1.0], 0.1)
sb.transient(coarse_beam(), sb.PointForce("A", fy=100.0), 2e-4, step=2e-6)
names = vars(pivoting) | vars(step_work) | vars(marching)
kernels = {n: f for n, f in names.items() if isinstance(f, numba.core.dispatcher.Dispatcher)}
print(*(f"{name}:{len(kernel.signatures)}" for name, kernel in kernels.items()))
"""


@pytest.mark.long
def test_one_signature():
    """Each kernel is compiled for one kind of arrays, whatever the layout of what it is given; in a process
    of its own, for tests call kernels in their own ways.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", KERNELS], env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.returncode == 0, done.stderr
    compiled = {name: int(count) for name, count in (word.split(":") for word in done.stdout.split())}
    assert compiled["contact_forces"] == compiled["_march"] == 1
    assert (
        len(compiled) == 23 and max(compiled.values()) == 1
    )  # the inner ones come with the outer ones' file


OTHERS = """
sb.basins(reduced, [sb.Harmonic(1.0, 0.1)], 0.1, (np.zeros((1, 3)), np.zeros((1, 3))), steps=64, limit=8)
sb.transient(coarse_beam(), sb.PointForce("A", fy=100.0), 2e-5, step=2e-6, reduction=None)
"""
# Of what is kept on disk: the kinds of arguments, and whether files had them.
KINDS = """
import json, sys
from numba.core.caching import NullCache
from numba.core.dispatcher import Dispatcher
modules = [module for name, module in sys.modules.items() if name.startswith("sbfem_petsc.")]
kernels = {f for m in modules for f in vars(m).values() if isinstance(f, Dispatcher)}
kept = [kernel for kernel in kernels if not isinstance(kernel._cache, NullCache)]
found = [f"{kernel.__name__} {kind}" for kernel in kept for kind in kernel.signatures]
missed = [kernel.__name__ for kernel in kept if kernel.stats.cache_misses]
print(json.dumps({"kinds": found, "missed": missed}))
"""


def test_the_kind_of_an_address_is_not_looked_for_again(monkeypatch):
    """By numba, in each call of the steps."""
    compile_kernels()
    monkeypatch.delattr(Address, "signature")
    compile_kernels()


@pytest.mark.long
def test_compiled_ahead():
    """What is compiled after an installation is all that analyses need, and they find it: where the files
    stand as they are, for the kinds are those of an empty folder too.
    """
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ahead = "from sbfem_petsc.cli.precompile import compile_all\ncompile_all()\n"
    found = []
    for program in (ahead, KERNELS + OTHERS):
        done = subprocess.run(
            [sys.executable, "-c", program + KINDS], env=environment, capture_output=True, text=True
        )
        found.append(answer(done))
    compiled, used = found
    assert not used["missed"] and len(used["kinds"]) >= 5
    assert set(used["kinds"]) <= set(compiled["kinds"])


@pytest.mark.slow
def test_one_eigenproblem(monkeypatch):
    """A `periodic`, what tells its errors, and what follows it on the same model in as many modes, solve for
    these once; by default once for each attempt.
    """
    solved = []
    original = model_module.lowest_modes

    def counted(model, count, *args, **options):
        solved.append(count)
        return original(model, count, *args, **options)

    monkeypatch.setattr(model_module, "lowest_modes", counted)
    model = sb.Model(paper_beam().mesh(order=3), ALUMINIUM, damping=0.002)
    load = sb.PointForce("A", fy=300.0)
    orbit = sb.periodic(model, load, 3000.0, modes=80)
    assert solved == [80] and len(orbit.reduced.omega) == 80
    sb.periodic(model, load, 2000.0, modes=80)
    sb.transient(model, sb.PointForce("A", fy=sb.Harmonic(1.0, 3000.0)), 1e-4)
    assert solved == [80]
    sb.periodic(model, load, 3000.0)
    sb.periodic(model, load, 3000.0)
    assert len(solved) <= 4


SCARCE = """
import resource, sys
import sbfem_petsc as sb
from tests.systems import two_masses
system = two_masses(0.02)
calls = {
    "transient": lambda: sb.transient(system, [sb.Harmonic(0.1, 0.1)], 10.0, 0.01),
    "periodic": lambda: sb.periodic(system, [0.1], 0.092, steps=64),
    "backbone": lambda: sb.backbone(system, 1, 1e-3, 2e-3, steps=64),
}
if sys.argv[1] == "loaded":
    sb.transient, sb.periodic, sb.backbone
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + int(2e7), -1))
for name, call in calls.items():
    try:
        call()
    except (ImportError, RuntimeError) as error:
        print(name, type(error).__name__, error)
"""


@pytest.mark.long
@pytest.mark.parametrize(
    "when, kind, told",
    [("loaded", "OutOfMemory", "raise it (ulimit -v)"), ("new", "ImportError", "ulimit -v")],
)
def test_hardly_any_address_space(when, kind, told):
    """A sentence from each analysis, where the compiler would end in errors of its own or the process."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", SCARCE, when]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=300)
    lines = done.stdout.splitlines()
    assert [line.split()[:2] for line in lines] == [[n, kind] for n in ("transient", "periodic", "backbone")]
    assert all(told in line for line in lines) and done.returncode == 0, done.stderr
