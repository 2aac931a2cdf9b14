"""What is said where a package is missing: the line that works on that machine."""

import re
import sys

import pytest

from sbfem_petsc import installation
from tests.parallel import ROOT

MISSING = ModuleNotFoundError("No module named 'petsc4py'", name="petsc4py")


def elsewhere(monkeypatch, tmp_path, *, folders=(), apt=False, conda=""):
    """A machine with these folders of the system's PETSc, apt-get and an active conda."""
    monkeypatch.setattr(installation, "DEBIAN", tuple(str(tmp_path / folder) for folder in folders))
    monkeypatch.setattr(installation.shutil, "which", lambda name: f"/usr/bin/{name}" if apt else None)
    monkeypatch.setenv("CONDA_PREFIX", conda)
    return installation.remedy(MISSING)


def test_system_packages_that_are_not_seen(monkeypatch, tmp_path):
    """The line makes them visible to the Python they were made for; another Python is told so."""
    suffix = installation.sysconfig.get_config_var("EXT_SUFFIX")
    library = tmp_path / "seen" / "petsc4py" / "lib" / f"PETSc{suffix}"
    other = tmp_path / "other" / "petsc4py" / "lib" / "PETSc.cpython-27-x86_64.so"
    for file in (library, other):
        file.parent.mkdir(parents=True)
        file.touch()
    line = elsewhere(monkeypatch, tmp_path, folders=["seen"], apt=True)
    assert f"{tmp_path / 'seen'} > " in line and line.endswith("site-packages/system-petsc.pth")
    assert "not for this Python" in elsewhere(monkeypatch, tmp_path, folders=["other"], apt=True)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path / "seen")])
    assert "apt-get install python3-petsc4py" in elsewhere(monkeypatch, tmp_path, folders=["seen"], apt=True)


def test_line_of_each_machine(monkeypatch, tmp_path):
    assert "conda install -c conda-forge" in elsewhere(monkeypatch, tmp_path, conda="/opt/conda", apt=True)
    assert "sudo apt-get install python3-petsc4py" in elsewhere(monkeypatch, tmp_path, apt=True)
    assert "compiles PETSc" in elsewhere(monkeypatch, tmp_path)


@pytest.mark.parametrize(
    "error, line",
    [
        (ModuleNotFoundError("No module named 'rich'", name="rich"), "pip install rich"),
        (ImportError("numpy.dtype size changed", name="petsc4py"), "pip install 'numpy<2'"),
        (
            ImportError("numpy.core.multiarray failed", name="h5py"),
            "pip install --force-reinstall h5py",
        ),
        (OSError("libGLU.so.1: cannot open shared object file"), "apt-get install libgl1 libglu1-mesa"),
    ],
)
def test_line_of_each_fault(error, line):
    assert line in installation.remedy(error)


def test_the_page_and_the_script_name_the_same_libraries():
    """Those that gmsh's wheel loads stand in `run`, in the page and in the sentence."""
    page = (ROOT / "docs" / "installing.md").read_text()
    script = " ".join(re.search(r"system_packages=\((.*?)\)", (ROOT / "run").read_text(), re.S)[1].split())
    assert installation.GMSH in page and installation.GMSH in script
    assert set(script.split()) <= set(page.split())
