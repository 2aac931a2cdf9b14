"""The one door to PETSc and SLEPc: import with a remedy, options prefixes, direct solvers, checked solves."""

from __future__ import annotations

try:
    import petsc4py
    import slepc4py
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"sbfem_petsc needs petsc4py, slepc4py and mpi4py ({error}). Use ./run in the project's folder, "
        "or `conda env create -f environment.yml`, or `pip install petsc petsc4py slepc slepc4py` (a source build)."
    ) from error

from .errors import SolveError, on_all_ranks
from .parallel import install_abort

__all__ = ["MPI", "PETSc", "SLEPc", "direct_solver", "configure_direct", "make_ksp", "check_ksp", "version_line"]

if PETSc.Sys.getVersion() < (3, 18, 0):  # pragma: no cover - depends on the machine
    raise ImportError(f"petsc4py {petsc4py.__version__} is too old: 3.18 or newer is needed")

install_abort(MPI.COMM_WORLD)


def version_line() -> str:
    """Versions of PETSc, SLEPc and the MPI library in one line."""
    petsc, slepc = (".".join(map(str, v)) for v in (PETSc.Sys.getVersion(), SLEPc.Sys.getVersion()))
    return f"PETSc {petsc}, SLEPc {slepc}, {MPI.Get_library_version().splitlines()[0].split(',')[0].strip()}"


def direct_solver(comm: MPI.Comm, symmetric: bool = True) -> tuple[str, str]:
    """Factorisation and package for a direct solve: MUMPS, else SuperLU_DIST, else PETSc's own on one rank.

    Returns
    -------
    factorisation, package : str
        ("cholesky", "mumps"), ("lu", "superlu_dist") or ("cholesky" | "lu", "petsc").
    """
    if PETSc.Sys.hasExternalPackage("mumps"):
        return ("cholesky" if symmetric else "lu"), "mumps"
    if PETSc.Sys.hasExternalPackage("superlu_dist"):
        return "lu", "superlu_dist"
    if comm.size > 1:
        raise SolveError("this PETSc has neither MUMPS nor SuperLU_DIST, so a direct solve runs on one rank only: use one rank, or an iterative solver (for statics: -static_ksp_type cg -static_pc_type gamg)")
    # PETSc's Cholesky does not pivot, its LU reorders rows: the latter for indefinite matrices.
    return ("cholesky" if symmetric else "lu"), "petsc"


def configure_direct(ksp: PETSc.KSP, positive_definite: bool = True) -> str:
    """Make a direct solve the default of `ksp` (before its setFromOptions); returns the package's name."""
    factorisation, package = direct_solver(ksp.comm.tompi4py(), positive_definite or PETSc.Sys.hasExternalPackage("mumps"))
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(factorisation)
    pc.setFactorSolverType(package)
    return package


def make_ksp(matrix: PETSc.Mat, prefix: str) -> PETSc.KSP:
    """Linear solver for a symmetric positive definite matrix: direct by default, all of it an option under `prefix`.

    An iterative solver chosen on the command line stops at a relative residual of 1e-12 unless told otherwise.
    """
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    ksp.setTolerances(rtol=1e-12, max_it=10000)
    configure_direct(ksp)
    ksp.setFromOptions()
    ksp.setUp()
    return ksp


def check_ksp(ksp: PETSc.KSP, what: str) -> None:
    """Raise `SolveError` unless the last solve of `ksp` converged."""
    reason = ksp.getConvergedReason()
    if reason > 0:
        return
    names = {value: name for name, value in vars(PETSc.KSP.ConvergedReason).items() if isinstance(value, int)}
    if reason == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
        remedy = "the factorisation failed: is the structure supported against every rigid-body motion, and is every part of it connected?"
    else:
        remedy = f"try another solver or more iterations under -{ksp.getOptionsPrefix()}ksp_..."
    raise on_all_ranks(SolveError(f"{what}: the linear solve did not converge ({names.get(reason, reason)} after {ksp.getIterationNumber()} iterations); {remedy}"))
