"""Which kernels OpenBLAS is told to take."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from meshing import processor

ROOT = Path(__file__).resolve().parents[2]
WIDE = "fpu avx2 fma avx512f avx512cd avx512bw avx512dq avx512vl"
# Two processors of one machine, the first of which is looked at.
INFORMATION = "processor\t: 0\nvendor_id\t: {}\nmodel name\t: X: 2\nflags\t\t: {}\n\nflags\t: none\n"


@pytest.mark.parametrize(
    ("vendor", "flags", "kernels"),
    [
        ("GenuineIntel", WIDE, "SKYLAKEX"),
        ("GenuineIntel", WIDE.replace(" avx512vl", ""), "HASWELL"),
        ("GenuineIntel", "fpu avx2", None),
        ("AuthenticAMD", WIDE, None),
    ],
)
def test_kernels(tmp_path, monkeypatch, vendor, flags, kernels):
    path = tmp_path / "cpuinfo"
    path.write_text(INFORMATION.format(vendor, flags))
    monkeypatch.setattr(processor, "_INFORMATION", path)
    monkeypatch.setenv("OPENBLAS_CORETYPE", "")
    monkeypatch.delenv("OPENBLAS_CORETYPE")
    processor.name_kernels()
    assert os.environ.get("OPENBLAS_CORETYPE") == kernels
    monkeypatch.setenv("OPENBLAS_CORETYPE", "ZEN")
    processor.name_kernels()
    assert os.environ["OPENBLAS_CORETYPE"] == "ZEN"


def test_elsewhere(tmp_path, monkeypatch):
    monkeypatch.setattr(processor, "_INFORMATION", tmp_path / "none")
    monkeypatch.delenv("OPENBLAS_CORETYPE", raising=False)
    processor.name_kernels()
    assert "OPENBLAS_CORETYPE" not in os.environ


@pytest.mark.skipif(os.name != "posix", reason="run is a bash script")
def test_run_says_the_same():
    """On this machine, whatever it is: by the package, and by the script's own function."""
    bare = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}

    def said(*command: str) -> str:
        done = subprocess.run(command, env=bare, cwd=ROOT, capture_output=True, text=True, timeout=60)
        return done.stdout.strip()

    asked = "import os, sbfem_petsc; print(os.environ.get('OPENBLAS_CORETYPE', ''))"
    by_package = said(sys.executable, "-c", asked)
    assert said("bash", "-c", "source ./run; openblas_kernels") == by_package
