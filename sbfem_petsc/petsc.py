"""The one door to PETSc and SLEPc: import with a remedy, options prefixes, direct solvers, checked solves."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

try:
    import petsc4py
    import slepc4py
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"sbfem_petsc needs petsc4py, slepc4py and mpi4py ({error}). Use ./run in the project's folder, "
        "or `conda env create -f environment.yml`, or `pip install petsc petsc4py slepc slepc4py` (a source "
        "build)."
    ) from error

from .errors import SolveError, on_all_ranks
from .parallel import install_abort

__all__ = [
    "MPI",
    "PETSc",
    "SLEPc",
    "direct_solver",
    "make_ksp",
    "check_ksp",
    "told",
    "solver_name",
    "version_line",
]

if PETSc.Sys.getVersion() < (3, 18, 0):  # pragma: no cover - depends on the machine
    raise ImportError(f"petsc4py {petsc4py.__version__} is too old: 3.18 or newer is needed")

install_abort(MPI.COMM_WORLD)

# PETSC_ERR_MEM
_OUT_OF_MEMORY = 55


def version_line() -> str:
    """Versions of PETSc, SLEPc and the MPI library in one line."""
    petsc, slepc = (".".join(map(str, v)) for v in (PETSc.Sys.getVersion(), SLEPc.Sys.getVersion()))
    return f"PETSc {petsc}, SLEPc {slepc}, {MPI.Get_library_version().splitlines()[0].split(',')[0].strip()}"


def direct_solver(comm: MPI.Comm, positive_definite: bool = True) -> tuple[str, str]:
    """Factorisation and package for a direct solve: MUMPS, else SuperLU_DIST, else PETSc's own on one rank.

    Returns
    -------
    factorisation, package : str
        ("cholesky", "mumps"), ("lu", "superlu_dist") or ("cholesky" | "lu", "petsc").
    """
    if PETSc.Sys.hasExternalPackage("mumps"):
        return "cholesky", "mumps"
    if PETSc.Sys.hasExternalPackage("superlu_dist"):
        return "lu", "superlu_dist"
    if comm.size > 1:
        raise SolveError(
            "this PETSc has neither MUMPS nor SuperLU_DIST, so a direct solve runs on one rank only: use one "
            "rank, or an iterative solver (for statics: -static_ksp_type cg -static_pc_type gamg)"
        )
    return ("cholesky" if positive_definite else "lu"), "petsc"


def make_ksp(matrix: PETSc.Mat, prefix: str, positive_definite: bool = True) -> PETSc.KSP:
    """Linear solver for a symmetric matrix: direct by default, all of it an option under `prefix`.

    An iterative solver chosen on the command line stops at a relative residual of 1e-12 unless told
    otherwise.
    """
    factorisation, package = direct_solver(matrix.comm.tompi4py(), positive_definite)
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    ksp.setTolerances(rtol=1e-12, max_it=10000)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(factorisation)
    pc.setFactorSolverType(package)
    with told(f"linear solver -{prefix}..."):
        ksp.setFromOptions()
        ksp.setUp()
    return ksp


@contextlib.contextmanager
def told(what: str) -> Iterator[None]:
    """Errors of PETSc in the body as a `SolveError` of one sentence.

    The body is collective, so that the error is one of all ranks.
    """
    try:
        yield
    except PETSc.Error as error:
        if error.ierr == _OUT_OF_MEMORY:
            reason = (
                "there is not enough memory; use more ranks on more machines, a coarser mesh, or for statics an "
                "iterative solver (-static_ksp_type cg -static_pc_type gamg)"
            )
        else:
            lines = [line.split("] ", 1)[-1].strip() for line in str(error).splitlines()]
            reason = f"PETSc says: {lines[-1]} (error {error.ierr}); check the options"
        raise on_all_ranks(SolveError(f"{what}: {reason}")) from None


def solver_name(ksp: PETSc.KSP) -> str:
    """What a linear solver does, for the output: "preonly + cholesky by mumps"."""
    pc = ksp.getPC()
    package = f" by {pc.getFactorSolverType()}" if pc.getType() in ("cholesky", "lu") else ""
    return f"{ksp.getType()} + {pc.getType()}{package}"


def check_ksp(ksp: PETSc.KSP, what: str) -> None:
    """Raise `SolveError` unless the last solve of `ksp` converged."""
    reason = ksp.getConvergedReason()
    if reason > 0:
        return
    names = {value: name for name, value in vars(PETSc.KSP.ConvergedReason).items() if isinstance(value, int)}
    if _memory_failed(ksp):
        remedy = (
            "the factorisation ran out of memory; use more ranks on more machines, a coarser mesh, or for statics "
            "an iterative solver (-static_ksp_type cg -static_pc_type gamg)"
        )
    elif reason == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
        remedy = (
            "the factorisation failed: is the structure supported against every rigid-body motion, and is "
            "every part of it connected?"
        )
    else:
        remedy = f"try another solver or more iterations under -{ksp.getOptionsPrefix()}ksp_..."
    raise on_all_ranks(
        SolveError(
            f"{what}: the linear solve did not converge ({names.get(reason, reason)} after "
            f"{ksp.getIterationNumber()} iterations); {remedy}"
        )
    )


def _memory_failed(ksp: PETSc.KSP) -> bool:
    """Whether MUMPS has told that it had too little memory: -9 and -13, or -8 and -19 for parts of it."""
    pc = ksp.getPC()
    if pc.getType() not in ("cholesky", "lu") or pc.getFactorSolverType() != "mumps":
        return False
    return pc.getFactorMatrix().getMumpsInfog(1) in (-8, -9, -13, -19)
