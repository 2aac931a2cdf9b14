"""Floquet multipliers of a periodic motion: all of them by LAPACK, or the largest by SLEPc (prefix
``floquet_``).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy import linalg

from ..errors import failed_solve, warn_of_options
from ..motion.period_map import DrivenPeriod, FixedPoint
from ..motion.period_motion import PeriodMotion
from ..petsc import LEFT, MPI, PETSc, SLEPc, chosen, configure, scripted, stepping
from .linear import Operator, operator
from .shooting import WHOLE

PREFIX = "floquet_"
# With little damping all multipliers lie near the unit circle: only a large subspace finds those of the
# largest modulus.
LARGEST, SUBSPACE = 6, 400
# Uncertainty of multipliers below which rounding is all there is.
FLOOR = 1e-9
# Multipliers whose modulus is this near to one are watched for excursions over the unit circle.
WATCHED = 0.05
# A multiplier that is no further inside the unit circle than this share of its change may have been outside:
# a real one near -1, and one of a pair by the change of its modulus.
HURRIED, PAIRED = 0.25, 0.02


class Multipliers:
    """Eigenvalues of the monodromy, by falling modulus.

    Parameters
    ----------
    values : (k,) complex array
    direction : callable
        The eigenvector of the k-th value, (2 m,) complex of unit length, in the state x = (Omega q, q'), a
        Floquet direction; its largest component is real and positive.
    """

    def __init__(self, values: np.ndarray, direction: Callable[[int], np.ndarray]):
        self.values, self._direction = values, direction

    def direction(self, k: int) -> np.ndarray:
        """(2 m,) complex: the Floquet direction of the k-th value."""
        found = self._direction(k)
        largest = found[np.abs(found).argmax()]
        return found * (largest.conjugate() / abs(largest) / np.linalg.norm(found))


def multipliers_of(fixed: FixedPoint, whole: bool | None = None) -> Multipliers:
    """Floquet multipliers of a fixed point, whose monodromy matrix is made once.

    Parameters
    ----------
    whole : bool, optional
        All of them from the monodromy matrix by LAPACK, or the largest by SLEPc's Krylov-Schur method on
        products with it. Default: all up to 1200 unknowns.

    Raises
    ------
    SolveError
        If SLEPc finds fewer than were asked for.
    """
    size = fixed.driven.period.unknowns
    if size > WHOLE if whole is None else not whole:
        return _largest(fixed.driven, fixed.motion, size)
    matrix = fixed.monodromy
    values = eigenvalues(matrix)
    order = np.argsort(-np.abs(values), kind="stable")
    values = values[order]
    return Multipliers(values, lambda k: inverse_iteration(matrix, values[k]))


def eigenvalues(matrix: np.ndarray) -> np.ndarray:
    """All eigenvalues of a real matrix by LAPACK, complex. Zero stands by itself for each row or column of
    zeros, those of slips that are forgotten.
    """
    acts = matrix.any(axis=0) & matrix.any(axis=1)
    n = int(acts.sum())
    if n < len(matrix):
        return np.append(eigenvalues(matrix[np.ix_(acts, acts)]), np.zeros(len(matrix) - n))
    return linalg.eigvals(matrix, check_finite=False) if n else np.zeros(0, dtype=complex)


def inverse_iteration(matrix: np.ndarray, value: complex) -> np.ndarray:
    """Eigenvector of a value that is known to rounding."""
    shifted = matrix - (value if value.imag else value.real) * np.eye(len(matrix))
    factorise = linalg.lapack.zgetrf if np.iscomplexobj(shifted) else linalg.lapack.dgetrf
    factors, exchanged, _ = factorise(shifted)
    # as LAPACK's own inverse iteration does: pivots that are rounding alone, or less, stand for it
    rounding = np.finfo(float).eps * max(float(np.abs(matrix).max()), 1e-100)
    small = np.flatnonzero(np.abs(np.diagonal(factors)) < rounding)
    factors[small, small] = rounding
    vector = np.ones(len(matrix))
    for _ in range(3):
        vector = linalg.lu_solve((factors, exchanged), vector / np.linalg.norm(vector), check_finite=False)
    return vector.astype(complex)


def _largest(driven: DrivenPeriod, motion: PeriodMotion, size: int) -> Multipliers:
    matrix = operator(
        MPI.COMM_SELF, size, Operator(lambda x: driven.carried(motion, x[:, None], located=True)[:, 0])
    )
    solver = SLEPc.EPS().create(PETSc.COMM_SELF)
    solver.setOptionsPrefix(PREFIX)
    solver.setOperators(matrix)
    solver.setProblemType(SLEPc.EPS.ProblemType.NHEP)
    solver.setWhichEigenpairs(SLEPc.EPS.Which.LARGEST_MAGNITUDE)
    wanted = min(LARGEST, size)
    solver.setDimensions(wanted, min(size, SUBSPACE))
    solver.setTolerances(tol=1e-10, max_it=10000)
    try:
        with scripted(matrix):
            configure(solver)
            with stepping(solver):
                solver.solve()
        found = solver.getConverged()
        if found < min(wanted, solver.getDimensions()[0]):
            raise failed_solve(
                f"Floquet multipliers: SLEPc found {found} of {wanted} (reason "
                f"{solver.getConvergedReason()} after {solver.getIterationNumber()} iterations); see "
                f"-{PREFIX}eps_..."
            )
        values = np.array([solver.getEigenvalue(k) for k in range(found)])
        real, imaginary = matrix.createVecs()
        vectors = np.empty((size, found), dtype=complex)
        for k in range(found):
            solver.getEigenvector(k, real, imaginary)
            vectors[:, k] = real.array_r + 1j * imaginary.array_r
        real.destroy()
        imaginary.destroy()
    finally:
        solver.destroy()
        matrix.destroy()
    if chosen(PREFIX):
        image = driven.carried(motion, np.hstack([vectors.real, vectors.imag]), located=True)
        missed = np.linalg.norm(image @ np.kron([[1.0], [1j]], np.eye(found)) - values * vectors, axis=0)
        if not (missed <= LEFT * abs(values)).all():
            warn_of_options(
                f"-{PREFIX}...",
                f"let multipliers miss their equations by {(missed / abs(values)).max():.2e}; leave them "
                "out, or ask for less to be left",
            )
    order = np.argsort(-np.abs(values), kind="stable")
    return Multipliers(values[order], lambda k: vectors[:, order[k]])


# ---------------------------------------------------------------------- passages of the unit circle
def outside(found: Multipliers) -> np.ndarray:
    """(k,) bool: which multipliers are outside the unit circle by more than rounding."""
    return np.abs(found.values) > 1.0 + FLOOR


def passages(one: Multipliers, other: Multipliers) -> int:
    """Multipliers that are outside the unit circle at one of two points of a branch, while the one that is
    nearest to them at the other is not; a complex pair counts once.
    """
    count = 0
    for here, there in ((one, other), (other, one)):
        leading = here.values[outside(here) & (here.values.imag >= 0.0)]
        count += int((~outside(there)[_nearest(there, leading)]).sum())
    return count


def ambiguous(one: Multipliers, other: Multipliers) -> bool:
    """Whether both the number of real multipliers outside the unit circle and that of complex pairs differ
    between two points: a pair may have come back before a real one left, or split into two of which one came
    back.
    """
    here, there = (item.values[outside(item)].imag for item in (one, other))
    real = np.count_nonzero(there == 0.0) - np.count_nonzero(here == 0.0)
    paired = np.count_nonzero(there > 0.0) - np.count_nonzero(here > 0.0)
    return real != 0 and paired != 0 and real + 2 * paired != 0


def hurried(one: Multipliers, other: Multipliers) -> bool:
    """Whether a multiplier is just inside -1 at one of two points of a branch, or a pair inside the unit
    circle, and far from there at the other: between them it may have been outside and come back.
    """
    for here, there in ((one, other), (other, one)):
        values = here.values
        turning = (values.imag > 0.0) | (values.imag == 0.0) & (values.real < 0.0)
        near = values[turning & (np.abs(values) > 1.0 - WATCHED) & ~outside(here)]
        beside = there.values[_nearest(there, near)]
        # of a pair what counts is how it nears the circle: without damping all run along it
        nears = PAIRED * np.abs(np.abs(beside) - np.abs(near))
        reach = np.where(near.imag > 0.0, nears, HURRIED * np.abs(beside - near))
        if ((1.0 - np.abs(near) < reach) & (reach > FLOOR)).any():
            return True
    return False


def excursion(around: list[tuple[float, Multipliers]]) -> float | None:
    """Where between two points of a branch, as a fraction of the way, a multiplier is expected furthest
    beyond the unit circle that is on the same side of it at both; None where none is.

    Parameters
    ----------
    around : list of (float, Multipliers)
        Four points in their order, the two in the middle at 0 and 1: the parabolas through either three of
        them must agree, so that a corner of the branch is not taken for a bend.
    """
    spectra = [found for _, found in around]
    middle = spectra[1].values
    middle = middle[(np.abs(np.abs(middle) - 1.0) < WATCHED) & (middle.imag >= 0.0)]
    before, following = (found.values[_nearest(found, middle)] for found in (spectra[0], spectra[2]))
    behind = spectra[3].values[_nearest(spectra[3], following)]
    heights = np.abs(np.array([before, middle, following, behind])) - 1.0
    heights *= -np.sign(heights[1])
    same = heights[2] < 0.0
    if not same.any():
        return None
    places, heights = np.array([place for place, _ in around]), heights[:, same]
    tops, beyond = zip(*(_top(places[n : n + 3], heights[n : n + 3]) for n in (0, 1)))
    within = ((np.array(tops) > 0.0) & (np.array(tops) < 1.0)).all(axis=0)
    reached = np.where(within, np.minimum(*beyond), -np.inf)
    furthest = int(reached.argmax())
    return float(np.mean(tops, axis=0)[furthest]) if reached[furthest] > FLOOR else None


def _nearest(found: Multipliers, values: np.ndarray) -> np.ndarray:
    """(n,) int: which multipliers are the nearest to (n,) values."""
    return np.abs(found.values - values[:, None]).argmin(axis=1)


def _top(places: np.ndarray, heights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places and heights of the tops of parabolas through three points each, (3, k); nan where there is
    none.
    """
    first, second = np.diff(heights, axis=0) / np.diff(places)[:, None]
    bend = (second - first) / (places[2] - places[0])
    bend[~(bend < 0.0)] = np.nan
    place = 0.5 * (places[0] + places[1]) - 0.5 * first / bend
    return place, heights[0] + (place - places[0]) * (first + bend * (place - places[1]))
