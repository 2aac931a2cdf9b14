"""The one door to PETSc and SLEPc: import with a remedy, options prefixes, direct solvers, checked solves."""

from __future__ import annotations

import contextlib
import math
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from . import installation, petsc_options

try:
    petsc_options.start()
    import petsc4py
    import slepc4py  # noqa: F401
    from mpi4py import MPI
    from petsc4py import PETSc
    from slepc4py import SLEPc
except ImportError as error:  # pragma: no cover - depends on the machine
    raise ImportError(
        f"sbfem_petsc needs petsc4py, slepc4py and mpi4py ({error}): {installation.remedy(error)}"
    ) from error

from .errors import OutOfMemory, PetscFailure, SolveError, failed_solve, on_all_ranks, warn_of_options
from .ranks import abort
from .ranks.parallel import alone

# Right-hand sides that MUMPS solves for at a time: a fifth of the time of its own choice.
_MUMPS_BLOCK = 64
# Workspace beyond what MUMPS expects to need, per cent, where its own 20 are too little.
_WORKSPACE = (100, 400, 1600)

__all__ = ["MPI", "PETSc", "SLEPc"]  # what is passed on

# The thread that PETSc, which keeps no order between threads, works for, and what guards a change of it.
_at_work: list[threading.Thread] = []
_changing = threading.Lock()
# Relative residual below which what options of the command line leave is not told.
LEFT = 1e-6
# What a direct solver leaves of K u = f, beside the norms of K and u: of slender bodies more than LEFT of f.
ROUNDING = 10.0 * sys.float_info.epsilon
OUT_OF_MEMORY = 55  # PETSc's PETSC_ERR_MEM
# Stages of -log_view, registered in one order on all ranks.
STAGES = ("Mesh", "S-elements", "Inertia", "Assembly", "Factorisation", "Contact", "Modes", "Steps")

if PETSc.Sys.getVersion() < (3, 18, 0):  # pragma: no cover - depends on the machine
    raise ImportError(f"petsc4py {petsc4py.__version__} is too old: 3.18 or newer is needed")

if MPI.COMM_WORLD.size > 1:
    abort.install()


_LOGGED = {name: PETSc.Log.Stage(f"sbfem: {name}") for name in STAGES}


def require_thread() -> None:
    """Raise a RuntimeError unless this is the thread that first called PETSc, or that one has ended."""
    here = threading.current_thread()
    if _at_work and _at_work[0] is here:
        return
    with _changing:
        if _at_work and _at_work[0].is_alive():
            raise RuntimeError(
                f"a call in the thread {here.name!r} needs PETSc, which works for {_at_work[0].name!r} alone "
                "as long as that thread lives: call it there, or start a process for it"
            )
        _at_work[:] = [here]


@contextlib.contextmanager
def stage(name: str) -> Iterator[None]:
    """Context whose work -log_view shows as a stage of `STAGES`; one inside another counts by itself."""
    require_thread()
    _LOGGED[name].push()
    try:
        yield
    finally:
        _LOGGED[name].pop()


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


def count_pivots(pc: PETSc.PC) -> PETSc.Mat:
    """Let MUMPS, as a factorisation that is not done yet, count the signs of pivots; its factor."""
    pc.setFactorSetUpSolverType()
    factor = pc.getFactorMatrix()
    factor.setMumpsIcntl(24, 1)  # null pivots are looked for, which the count needs
    factor.setMumpsIcntl(13, 1)  # no ScaLAPACK at the root: its pivots would not be counted
    width = pc.getOperators()[1].getBlockSize()
    if width > 1:
        factor.setMumpsIcntl(15, -width)  # nodes are ordered, not their unknowns
    return factor


def negative_eigenvalues(matrix: PETSc.Mat, what: str) -> int | None:
    """Number of negative eigenvalues of a symmetric matrix by Sylvester's law of inertia (prefix
    ``modal_inertia_``); None where the direct solver does not tell it (MUMPS does). Collective.
    """
    comm = matrix.comm.tompi4py()
    if direct_solver(comm)[1] != "mumps":
        return None
    with freeing(comm, PETSc.PC().create(comm)) as (pc,):
        pc.setOptionsPrefix("modal_inertia_")
        pc.setOperators(matrix)
        pc.setType(PETSc.PC.Type.CHOLESKY)
        pc.setFactorSolverType("mumps")
        count_pivots(pc)
        configure(pc)
        with solving(what):
            factorise(pc, pc.setUp, count_pivots)
            negative = pivot_signs(pc, what)[0]
            pc.getFactorMatrix().destroy()  # before its owner, which would leave MUMPS' memory behind
    return negative


def factorise(
    pc: PETSc.PC, set_up: Callable[[], None], prepare: Callable[[PETSc.PC], object] | None = None
) -> None:
    """Factorise by `set_up`, and again by PC.setUp with more workspace where MUMPS has had too little:
    pivots of indefinite matrices that are put off take more than its analysis expects. `prepare` sets up the
    factor anew. Collective.
    """
    set_up()
    for percentage in _WORKSPACE:
        if _mumps_error(pc) not in (-8, -9):
            return
        operators = pc.getOperators()
        pc.reset()
        pc.setOperators(*operators)
        pc.setFactorSetUpSolverType()
        if prepare is not None:
            prepare(pc)
        pc.getFactorMatrix().setMumpsIcntl(14, percentage)
        pc.setUp()


def pivot_signs(pc: PETSc.PC, what: str) -> tuple[int, int, int]:
    """Negative, zero and positive pivots of a factorisation after `count_pivots`. Collective."""
    if _mumps_error(pc) < 0:
        raise failed_solve(f"{what}: {_failure(pc)}")
    negative, zero, positive = pc.getFactorMatrix().getInertia()
    return int(negative), int(zero), int(positive)


def make_ksp(
    matrix: PETSc.Mat,
    prefix: str,
    positive_definite: bool = True,
    *,
    by_ranks: Callable[[], PETSc.Mat] | None = None,
    small: bool = False,
    later: bool = False,
) -> PETSc.KSP:
    """Linear solver for a symmetric matrix: direct by default, all of it an option under `prefix`.

    An iterative solver chosen on the command line stops at a relative residual of 1e-12 unless told
    otherwise. `by_ranks` makes the matrix kept apart by ranks, a MATIS, that PCBDDC works with. `small` takes
    PETSc's own factors of a positive definite matrix on one rank; those of LU, whose rows go several at a
    time, solve twice as fast as the one of Cholesky. `later` leaves the factorisation to `set_up`.
    """
    factorisation, package = (
        ("lu", "petsc") if small else direct_solver(matrix.comm.tompi4py(), positive_definite)
    )
    ksp = PETSc.KSP().create(matrix.comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    ksp.setTolerances(rtol=1e-12, max_it=10000)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    pc = ksp.getPC()
    pc.setType(factorisation)
    pc.setFactorSolverType(package)
    if small:
        pc.setFactorOrdering("qmd")
    configure(ksp)
    if pc.getType() == PETSc.PC.Type.BDDC and by_ranks is not None:
        apart = by_ranks()
        ksp.setOperators(matrix, apart)
        apart.destroy()
    if not later:
        set_up(ksp)
    return ksp


def set_up(ksp: PETSc.KSP) -> None:
    """Factorise, or make a preconditioner."""
    with stage("Factorisation"), solving(ksp.getOptionsPrefix().rstrip("_")):
        factorise(ksp.getPC(), ksp.setUp)
        ksp.setUp()


def asked(name: str, bare: Any = "") -> Any:
    """Value that the command line gives an option, of the type of `bare`, which an option without one has;
    None if it is not there.
    """
    options = PETSc.Options()
    get = {bool: options.getBool, int: options.getInt, str: options.getString}[type(bare)]
    return get(name, bare) if options.hasName(name) else None


def all_asked() -> dict[str, str]:
    """All options of the command line, none of which counts as used by this."""
    found: dict[str, str] = PETSc.Options().getAll()
    return found


def chosen(prefix: str) -> bool:
    """Whether the command line has options that begin with a prefix."""
    return any(name.startswith(prefix) for name in all_asked())


def configure(item: Any) -> None:
    """Apply the options of the command line to a solver.

    Raises
    ------
    PetscFailure
        If PETSc refuses one of them; the sentence has PETSc's reason. If an eigensolver is to find all
        eigenvalues of an interval, for which it needs a factor that PETSc has: without, SLEPc crashes.
    """
    require_thread()
    try:
        item.setFromOptions()
    except PETSc.Error as error:
        raise on_all_ranks(
            PetscFailure(
                f"PETSc refuses an option that begins with -{item.getOptionsPrefix()}: {_said(error)}; give "
                "it another value or leave it out"
            )
        ) from None
    if isinstance(item, SLEPc.EPS) and item.getWhichEigenpairs() == SLEPc.EPS.Which.ALL:
        prefix = item.getOptionsPrefix()
        raise on_all_ranks(
            PetscFailure(
                f"-{prefix}eps_interval or -{prefix}eps_all asks for all eigenvalues of an interval, which "
                "no solve here finds; leave it out: modal(model, band=(low, high)) has all of a band"
            )
        )


def finite(tolerance: float) -> float:
    """A tolerance that PETSc takes. PETSc 3.26 refuses that of a motion too large for floating point as if it
    were an option; the motion's first norm tells what is wrong.
    """
    return min(tolerance, float(np.finfo(float).max))


@contextlib.contextmanager
def solving(what: str) -> Iterator[None]:
    """Context in which an error of PETSc, and a lack of memory, becomes one sentence, a `SolverFailure`."""
    require_thread()
    try:
        yield
    except (PETSc.Error, MemoryError) as error:
        if isinstance(error, MemoryError) or error.ierr == OUT_OF_MEMORY:
            raise OutOfMemory(
                f"{what}: there is not enough memory for it; use more ranks on more machines, a coarser "
                "mesh, or for statics an iterative solver (-static_ksp_type cg -static_pc_type gamg)"
            ) from error
        raise PetscFailure(
            f"{what}: PETSc gave up with error {error.ierr} ({_said(error)}); are all numbers of the model "
            "of usual size, and options for PETSc right for this solve?"
        ) from error


def _said(error: PETSc.Error) -> str:
    """The reason in an error of PETSc, without the places in its source."""
    lines = [line.split("]", 1)[-1].strip() for line in str(error).splitlines()]
    told = [line for line in lines if line and "() at " not in line and not line.startswith("error code")]
    return "; ".join(told) or f"error code {error.ierr}"


@contextlib.contextmanager
def scripted(*items: PETSc.Mat | PETSc.PC) -> Iterator[None]:
    """Context of a solve that calls Python, to stand inside `solving`. An error of a call comes out as
    what it is, also from PETSc 3.26, which makes one of its own of it. Matrices and preconditioners in
    Python have no part in it afterwards: a traceback, or a cycle of references, may keep them until Python
    has ended, and then PETSc crashes on such parts.
    """
    try:
        yield
    except (PETSc.Error, SystemError) as error:
        first: BaseException = error
        while isinstance(first, (PETSc.Error, SystemError)) and first.__cause__ is not None:
            first = first.__cause__
        if first is error:
            raise
        raise first from None
    finally:
        for item in items:
            item.setType(PETSc.PC.Type.NONE if isinstance(item, PETSc.PC) else PETSc.Mat.Type.AIJ)


@contextlib.contextmanager
def stepping(eps: SLEPc.EPS) -> Iterator[None]:
    """Context of a solve by SLEPc that calls Python. A solver that an error ends within a step has parts that
    cannot be freed, and is kept for good; its vectors are freed if no other rank has to be waited for.
    """
    try:
        yield
    except BaseException:
        eps.incRef()
        if not alone(eps.comm.tompi4py()):
            with contextlib.suppress(PETSc.Error):
                eps.reset()
        raise


def free(comm: MPI.Comm, *items: Any) -> None:
    """Destroy PETSc objects, unless an error is on its way that other ranks do not know of: the end of a
    factorisation is collective, and they would be waited for.
    """
    if alone(comm):
        return
    for item in items:
        item.destroy()


@contextlib.contextmanager
def freeing(comm: MPI.Comm, *items: Any) -> Iterator[tuple[Any, ...]]:
    """Context that gives PETSc objects and destroys them at its end, see `free`."""
    try:
        yield items
    finally:
        free(comm, *items)


def collect(comm: MPI.Comm) -> None:
    """Destroy the objects that Python has let go of, which PETSc keeps until all ranks ask for that.
    Collective.
    """
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
    PETSc.garbage_cleanup(comm)


def summed(comm: MPI.Comm, array: np.ndarray) -> np.ndarray:
    """The sum over the ranks of an array that each has, in its place if it is contiguous. Collective."""
    array = np.asarray(array, order="C")
    comm.Allreduce(MPI.IN_PLACE, array)
    return array


def dense_columns(matrix: PETSc.Mat, columns: np.ndarray) -> PETSc.Mat:
    """Columns (owned, k), in Fortran's order, as a dense matrix that shares their memory."""
    size = (matrix.getSizes()[0], columns.shape[1])
    result = PETSc.Mat().createDense(size, array=columns, comm=matrix.comm)
    result.assemble()
    return result


def block_solve(ksp: PETSc.KSP, right: PETSc.Mat) -> np.ndarray:
    """(owned, k): the factor of a direct solver that has solved before applied to a block of right-hand
    sides, which are freed. Collective.
    """
    factor, matrix = ksp.getPC().getFactorMatrix(), ksp.getOperators()[0]
    if ksp.getPC().getFactorSolverType() == "mumps":
        factor.setMumpsIcntl(27, _MUMPS_BLOCK)
    result = np.empty((matrix.getLocalSize()[0], right.getSize()[1]), order="F")
    with freeing(matrix.comm.tompi4py(), dense_columns(matrix, result), right) as (found, _):
        factor.matSolve(right, found)
    return result


def solver_name(ksp: PETSc.KSP) -> str:
    """What a linear solver does, for the output: "preonly + cholesky by mumps"."""
    pc = ksp.getPC()
    package = f" by {pc.getFactorSolverType()}" if pc.getType() in ("cholesky", "lu") else ""
    return f"{ksp.getType()} + {pc.getType()}{package}"


def check_ksp(ksp: PETSc.KSP, what: str, remedy: str | None = None) -> None:
    """Raise `SolveError` unless the last solve of `ksp` converged; `remedy` is what helps where the iteration
    is too long.
    """
    reason = ksp.getConvergedReason()
    if reason > 0:
        return
    if reason == PETSc.KSP.ConvergedReason.DIVERGED_PCSETUP_FAILED:
        told = _failure(ksp.getPC())
    else:
        told = remedy or f"try another solver or more iterations under -{ksp.getOptionsPrefix()}ksp_..."
    raise failed_solve(
        f"{what}: the linear solve did not converge ({reason_of(ksp)} after "
        f"{ksp.getIterationNumber()} iterations); {told}"
    )


def judge_ksp(ksp: PETSc.KSP) -> None:
    """Warn of what the options of the command line have let the last solve of `ksp` leave. Collective.

    Warns
    -----
    OptionWarning
    """
    prefix = ksp.getOptionsPrefix()
    if not chosen(prefix):
        return
    matrix, given, found = ksp.getOperators()[0], ksp.getRhs(), ksp.getSolution()
    missed, right, size = given.duplicate(), given.norm(), 0.0
    matrix.mult(found, missed)  # KSPBuildResidual of GMRES is wrong after a solve
    missed.axpy(-1.0, given)
    left = missed.norm()
    missed.destroy()
    if matrix.getType() != PETSc.Mat.Type.PYTHON:
        size = matrix.norm(PETSc.NormType.FROBENIUS) * found.norm()
    if not left <= max(LEFT * right, ROUNDING * size):
        share = left / right if right else math.inf
        warn_of_options(
            f"-{prefix}...",
            f"let a linear solve end ({reason_of(ksp)}) with {share:.2e} of its right-hand side left; leave "
            "them out, or ask for less to be left",
        )


def reason_of(solver: PETSc.KSP | PETSc.SNES) -> str:
    """PETSc's name of the reason for which a solver has stopped."""
    reason = solver.getConvergedReason()
    names = {value: name for name, value in vars(solver.ConvergedReason).items() if isinstance(value, int)}
    return str(names.get(reason, reason))


def _failure(pc: PETSc.PC) -> str:
    """What is told of a factorisation that failed."""
    if _mumps_error(pc) in (-8, -9, -13, -19):
        return (
            "the factorisation ran out of memory; use more ranks on more machines, a coarser mesh, or for "
            "statics an iterative solver (-static_ksp_type cg -static_pc_type gamg)"
        )
    return (
        "the factorisation failed: is the structure supported against every rigid-body motion, and is every "
        "part of it connected?"
    )


def _mumps_error(pc: PETSc.PC) -> int:
    """What MUMPS tells of a factorisation, 0 or more where it succeeded or another package made it: -9 and
    -13 of too little memory, -8 and -19 for parts of it.
    """
    if pc.getType() not in ("cholesky", "lu") or pc.getFactorSolverType() != "mumps":
        return 0
    return int(pc.getFactorMatrix().getMumpsInfog(1))
