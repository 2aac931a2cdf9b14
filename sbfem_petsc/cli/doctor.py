"""What the installation has, and common faults with their remedies."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from typing import Any

import sbfem_petsc as sb

from ..installation import remedy

PACKAGES = "numpy scipy numba gmsh meshio h5py matplotlib rich pydantic mpi4py petsc4py slepc4py".split()


def examine(comm: Any) -> dict[str, Any]:
    """Versions, solvers, and a list of faults, each one sentence with a remedy."""
    faults: list[str] = []
    packages: dict[str, str | None] = dict.fromkeys(PACKAGES)
    for name in PACKAGES:
        try:
            packages[name] = str(getattr(importlib.import_module(name), "__version__", "present"))
        except Exception as error:  # a broken installation raises anything
            faults.append(f"{name} cannot be imported ({error}): {remedy(error)}")
    found: dict[str, Any] = {
        "sbfem_petsc": sb.__version__,
        "python": platform.python_version(),
        "executable": sys.executable,
        "platform": platform.platform(),
        "cores": os.cpu_count(),
        "packages": packages,
        "ranks": comm.size,
        "mpiexec": shutil.which("mpiexec"),
        "OMP_NUM_THREADS": (threads := os.environ.get("OMP_NUM_THREADS")),
    }
    if packages["petsc4py"] and packages["slepc4py"]:
        try:
            _petsc(found, faults)
        except ImportError as error:  # it is there, but cannot be loaded
            faults.append(str(error))
    if packages["h5py"]:
        import h5py

        found["hdf5"] = h5py.version.hdf5_version
    if packages["matplotlib"]:
        importlib.import_module("..plot", __package__)  # which imports it first
        from matplotlib import font_manager

        found["font"] = os.path.basename(font_manager.findfont("DejaVu Sans"))
    if comm.size > 1 and threads != "1":
        faults.append(
            f"OMP_NUM_THREADS is {threads or 'not set'} with {comm.size} ranks, which then disturb each "
            "other; set it to 1"
        )
    if found["mpiexec"] is None:
        faults.append("there is no mpiexec on PATH; install an MPI's programs to run on several ranks")
    return {**found, "faults": faults}


def _petsc(found: dict[str, Any], faults: list[str]) -> None:
    from ..petsc import PETSc, version_line

    found["libraries"] = version_line()
    found["scalar"] = str(PETSc.ScalarType.__name__)
    found["integer_bits"] = 8 * PETSc.IntType().itemsize
    known = ("mumps", "superlu_dist", "suitesparse")
    found["direct_solvers"] = solvers = [name for name in known if PETSc.Sys.hasExternalPackage(name)]
    if "complex" in found["scalar"]:
        faults.append(
            "this PETSc computes with complex numbers; use a build with real scalars (PETSC_ARCH "
            "ending in -real)"
        )
    if "mumps" not in solvers:
        faults.append(
            "this PETSc has no MUMPS: factorisations are slower, run on one rank alone unless there is "
            "SuperLU_DIST, and multiple frequencies are not counted; install a PETSc with MUMPS"
        )


def as_text(findings: dict[str, Any]) -> str:
    """Findings as text."""
    lines = []
    for name, value in findings.items():
        if name in ("packages", "faults"):
            continue
        shown = ", ".join(map(str, value)) if isinstance(value, list) else value
        lines.append(f"{name:16s} {shown if shown not in (None, '') else 'none'}")
    lines += [f"{name:16s} {version or 'MISSING'}" for name, version in findings["packages"].items()]
    faults = findings["faults"]
    return "\n".join([*lines, "", *(faults or ["no fault was found"])])
