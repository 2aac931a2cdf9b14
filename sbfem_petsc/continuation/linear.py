"""Linearised equations: a matrix, dense or sparse, and its factors, or products and GMRES (prefix
``shooting_``).
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg, sparse
from scipy.sparse.linalg import splu

from ..petsc import MPI, PETSc, check_ksp, configure, free, require_thread, scripted, solving
from .problem import Linear, Lost

PREFIX = "shooting_"
# GMRES: residual relative to the right side, vectors kept, restarts.
TOLERANCE, KEPT, RESTARTS = 1e-8, 100, 3


class Dense:
    """Equations as a matrix (n, n + 1)."""

    def __init__(self, matrix: np.ndarray):
        self.matrix, self.rows = matrix, len(matrix)

    def bordered(self, row: np.ndarray) -> DenseBorder:
        """See `problem.Linear`."""
        return DenseBorder(self.matrix, row)

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Dense:
        """See `problem.Linear`."""
        return Dense(np.tensordot(weights, [other.matrix for other in others], 1))


class Factors:
    """LU factors of a square matrix, by LAPACK itself: of small ones the checks of its wrappers take most of
    the time.

    Attributes
    ----------
    sign : float
        Of the determinant; of a real matrix.

    Raises
    ------
    Lost
        If it is singular.
    """

    def __init__(self, matrix: np.ndarray):
        lapack, whole = linalg.lapack, np.iscomplexobj(matrix)
        factorise, self._solve = (lapack.zgetrf, lapack.zgetrs) if whole else (lapack.dgetrf, lapack.dgetrs)
        self._factors, self._exchanged, singular = factorise(matrix)
        if singular:
            raise Lost(f"solutions are not isolated: pivot {singular} of {len(matrix)} is zero")
        # each exchange of rows turns the determinant
        turned = (self._exchanged != np.arange(len(matrix))).sum() + (
            np.diagonal(self._factors).real < 0.0
        ).sum()
        self.sign: float | None = -1.0 if turned % 2 else 1.0

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The inverse times a right side."""
        return self._solve(self._factors, self._exchanged, right)[0]

    def solve_transposed(self, right: np.ndarray) -> np.ndarray:
        """That of the transposed matrix."""
        return self._solve(self._factors, self._exchanged, right, trans=1)[0]


class DenseBorder(Factors):
    """LU factors of a bordered matrix, whose border is made as large as the other rows."""

    def __init__(self, matrix: np.ndarray, row: np.ndarray):
        self.size = float(np.abs(matrix).max(initial=0.0)) / max(float(np.abs(row).max()), 1e-300) or 1.0
        super().__init__(np.vstack([matrix, self.size * row]))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        right = right.copy()
        right[-1] *= self.size
        return super().solve(right)


class Krylov:
    """Equations as products, over ranks: along the first n unknowns, of which each rank has its own, with a
    column for the last one, which all of them have. Subclasses say what these are.

    Attributes
    ----------
    rows : int
        n.
    size : float
        Unit of the first unknowns.
    comm : Comm
    tolerance : float
        Residual of a solve relative to the right side.
    """

    rows: int
    size = 1.0
    comm: MPI.Comm = MPI.COMM_SELF
    tolerance = TOLERANCE

    def products(self, vector: np.ndarray) -> np.ndarray:
        """(n,) of (n,)."""
        raise NotImplementedError

    def nearby(self, right: np.ndarray) -> np.ndarray:
        """(n,) of (n,): the inverse of products that are near these, for preconditioning."""
        raise NotImplementedError

    @functools.cached_property
    def column(self) -> np.ndarray:
        """(n,): what the last unknown does, made once where it is asked for."""
        raise NotImplementedError

    def bordered(self, row: np.ndarray) -> KrylovBorder:
        """See `problem.Linear`."""
        return KrylovBorder(self, row)

    def mixed(self, others: Sequence[Any], weights: Sequence[float]) -> Krylov:
        """See `problem.Linear`."""
        return self


class KrylovBorder:
    """GMRES of PETSc on bordered products (prefix ``shooting_``), preconditioned by the bordered inverse
    nearby; the border's value is the last of rank 0's unknowns.

    The last entry of the row is this rank's share of it. A row that is about the last unknown alone tells it
    at once, and where that does not change, nobody asks for its column.
    """

    sign: float | None = None

    def __init__(self, linear: Krylov, row: np.ndarray):
        self.linear, self.comm = linear, linear.comm
        own = float(row[:-1] @ row[:-1])
        self.alone = not self._total(own)
        # the border is made as large as the other rows
        self.size = linear.size / self._total(own + self.comm.size * float(row[-1] ** 2)) ** 0.5
        self.row, self.last = self.size * row[:-1], self.size * self._total(float(row[-1]))

    def _total(self, local: float) -> float:
        return float(self.comm.allreduce(local))

    @functools.cached_property
    def _bordering(self) -> tuple[np.ndarray, float]:
        """What stands for the last unknown in the inverse nearby, and the border's value of it."""
        column = self.linear.nearby(self.linear.column)
        return column, self.last - self._total(float(self.row @ column))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        linear, first, value = self.linear, right[:-1], self.size * float(right[-1])
        if self.alone:
            last = value / self.last
            first = first - last * linear.column if last else first
            return np.append(self._by_gmres(first, linear.products, linear.nearby), last)
        own = self.own(np.append(first, value))
        return self.gathered(self._by_gmres(own, self.of_own(self.product), self.of_own(self.nearby)))

    def product(self, z: np.ndarray) -> np.ndarray:
        """The equations' left side of unknowns, with the border's value."""
        image = self.linear.products(z[:-1]) + z[-1] * self.linear.column
        return np.append(image, self._total(float(self.row @ z[:-1])) + self.last * z[-1])

    def nearby(self, right: np.ndarray) -> np.ndarray:
        """The inverse nearby, of equations with the border's value."""
        x, (column, beside) = self.linear.nearby(right[:-1]), self._bordering
        last = (right[-1] - self._total(float(self.row @ x))) / beside
        return np.append(x - last * column, last)

    def gathered(self, local: np.ndarray) -> np.ndarray:
        """A vector's entries with the border's, which rank 0 has, on all ranks."""
        own, last = (local[:-1], local[-1]) if self.comm.rank == 0 else (local, 0.0)
        return np.append(own, self.comm.bcast(last))

    def own(self, array: np.ndarray) -> np.ndarray:
        """What of them is this rank's in a vector."""
        return array if self.comm.rank == 0 else array[:-1]

    def of_own(self, function: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
        """A function of what all ranks know of a vector, as one of this rank's part of it to its part."""
        return lambda vector: self.own(function(self.gathered(vector)))

    def _by_gmres(self, right: np.ndarray, product: Any, nearby: Any) -> np.ndarray:
        settings = GmresSettings("continuation", PREFIX, self.linear.tolerance, KEPT)
        return by_gmres(self.comm, right, product, nearby, settings)


class Operator:
    """A matrix or a preconditioner of PETSc by what it makes of this rank's part of a vector.

    Parameters
    ----------
    product : callable
        May be set later.
    set_up : callable, optional
        Called with PETSc's own before the first product of each solve.
    """

    def __init__(self, product: Any = None, set_up: Any = None):
        self.product, self._set_up = product, set_up

    def setUp(self, item: PETSc.Mat | PETSc.PC) -> None:
        """Called by PETSc."""
        if self._set_up is not None:
            self._set_up(item)

    def mult(self, item: PETSc.Mat | PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        """y of x: PETSc's name of it for a matrix, and that for a preconditioner."""
        y.array[:] = self.product(x.array_r)

    apply = mult


def operator(comm: MPI.Comm, size: int, of: Operator) -> PETSc.Mat:
    """It as a matrix, of which this rank has so many rows and columns."""
    matrix = PETSc.Mat().createPython([(size, None)] * 2, context=of, comm=comm)
    matrix.setUp()
    return matrix


def by_operator(pc: PETSc.PC, of: Operator) -> PETSc.PC:
    """A preconditioner that is one."""
    pc.setType(PETSc.PC.Type.PYTHON)
    pc.setPythonContext(of)
    return pc


class GmresSettings(NamedTuple):
    """Of a solve by GMRES: what asks for it, the options' prefix, residual relative to the right side,
    vectors kept, and what helps where it does not converge.
    """

    owner: str
    prefix: str
    tolerance: float
    kept: int
    remedy: str | None = None


def preconditioned(ksp: PETSc.KSP, kept: int, tolerance: float, nearby: Operator) -> PETSc.PC:
    """Let a solver be GMRES, whose residual is that of the system itself; its preconditioner."""
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.setGMRESRestart(kept)
    ksp.setTolerances(rtol=tolerance, max_it=RESTARTS * kept)
    return by_operator(ksp.getPC(), nearby)


def by_gmres(
    comm: MPI.Comm, right: np.ndarray, product: Any, nearby: Any, settings: GmresSettings
) -> np.ndarray:
    """This rank's part of what a product with has the right side; `nearby` is an inverse of about it.
    Collective.

    Raises
    ------
    SolveError
        If the iteration does not converge; a `PetscFailure` if PETSc cannot do it.
    """
    require_thread()
    owner, prefix, tolerance, kept, remedy = settings
    matrix = operator(comm, len(right), Operator(product))
    found, given = matrix.createVecs()
    given.array = right
    ksp = PETSc.KSP().create(comm)
    ksp.setOptionsPrefix(prefix)
    ksp.setOperators(matrix)
    pc = preconditioned(ksp, min(kept, given.getSize()), tolerance, Operator(nearby))
    try:
        with solving(owner), scripted(matrix, pc):
            configure(ksp)
            ksp.solve(given, found)
        check_ksp(ksp, owner, remedy)
        return found.array_r.copy()
    finally:
        free(comm, ksp, pc, given, found, matrix)


class Sparse(Linear):
    """Equations as a sparse matrix (n, n + 1), solved one by one, along no line."""

    def __init__(self, matrix: sparse.spmatrix):
        self.matrix, self.rows = matrix, matrix.shape[0]

    def bordered(self, row: np.ndarray) -> SparseBorder:
        """See `problem.Linear`."""
        return SparseBorder(self.matrix, row)


class SparseBorder:
    """Sparse LU factors with partial pivoting; the border is made as large as the other rows."""

    sign: float | None = None

    def __init__(self, matrix: sparse.spmatrix, row: np.ndarray):
        self.size = float(abs(matrix).max()) / max(float(np.abs(row).max()), 1e-300) or 1.0
        try:
            self._factors = splu(sparse.vstack([matrix, self.size * row], format="csc"))
        except RuntimeError as error:
            raise Lost(f"solutions are not isolated: {error}") from None

    def solve(self, right: np.ndarray) -> np.ndarray:
        """See `problem.Border`."""
        found: np.ndarray = self._factors.solve(np.append(right[:-1], self.size * right[-1]))
        return found
