"""What to type where a package, PETSc's most of all, is missing or does not fit, on this machine."""

from __future__ import annotations

import glob
import os
import shutil
import sys
import sysconfig

PETSC = ("petsc4py", "slepc4py", "mpi4py")
# Debian and Ubuntu keep each build in a folder of its own, which an environment does not look into by itself.
DEBIAN = (
    "/usr/lib/petscdir/petsc*/*-real/lib/python3*/dist-packages",
    "/usr/lib/slepcdir/slepc*/*-real/lib/python3*/dist-packages",
)
SYSTEM_PYTHON = "/usr/bin/python3"
GMSH = "libgl1 libglu1-mesa libxcursor1 libxft2 libxinerama1 libxrender1 libxfixes3 libfontconfig1 libgomp1"
PAGE = "see docs/installing.md"


def remedy(error: Exception) -> str:
    """What to do about a package that could not be imported, in a clause.

    Parameters
    ----------
    error : ImportError
        Of the import, which names the module.

    Returns
    -------
    str
    """
    package = (getattr(error, "name", None) or "").partition(".")[0]
    if isinstance(error, OSError) and ".so" in str(error):
        return f"a library of the system is missing; those that gmsh's wheel needs: apt-get install {GMSH}"
    if "numpy" in str(error) and package != "numpy":
        if package in PETSC:
            return "it was compiled for NumPy 1: pip install 'numpy<2'"
        return f"if it was compiled for another NumPy: pip install --force-reinstall {package}"
    if package and package not in PETSC:
        return f"pip install {package}"
    folders = sorted(folder for pattern in DEBIAN for folder in glob.glob(pattern))
    unseen = [folder for folder in folders if folder not in sys.path]
    if unseen and package != "mpi4py":
        return _made_visible(unseen)
    if os.environ.get("CONDA_PREFIX"):
        return f"conda install -c conda-forge 'petsc=*=real*' petsc4py slepc4py mpi4py ({PAGE})"
    if shutil.which("apt-get"):
        return (
            "use ./run in the project's folder, or: sudo apt-get install python3-petsc4py python3-slepc4py "
            f"python3-mpi4py, for an environment of {SYSTEM_PYTHON} ({PAGE})"
        )
    return (
        "`conda env create -f environment.yml`, or load your cluster's modules of petsc4py and slepc4py, or "
        f"pip install petsc petsc4py slepc slepc4py, which compiles PETSc ({PAGE})"
    )


def _made_visible(folders: list[str]) -> str:
    """How an environment is made to see the system's packages, if it is one of the Python they are for."""
    suffix = sysconfig.get_config_var("EXT_SUFFIX")
    if not any(glob.glob(f"{folder}/*/lib/*{suffix}") for folder in folders):
        return (
            f"the system's are made for {SYSTEM_PYTHON}, not for this Python: {SYSTEM_PYTHON} -m venv "
            f"--system-site-packages env ({PAGE})"
        )
    file = os.path.join(sysconfig.get_path("purelib"), "system-petsc.pth")
    return f"the system's are not seen here: printf '%s\\n' {' '.join(folders)} > {file}"
