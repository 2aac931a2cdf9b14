"""Lowest modes by block Lanczos, rational at its end: several right-hand sides pass over a factor once, and
ranks share them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy import sparse
from scipy.linalg.blas import dgemm, dger

from ..errors import failed_solve, wrong_input
from ..petsc import MPI, summed

# Relative residual of K^-1 M x = x / w2, at most, that a mode has.
TOLERANCE = 1e-11
# Parts of a vector that are rounding, and that one pass of orthogonalisation leaves exact enough: what loses
# more than that in a second one has been rounding.
LOST, ENOUGH = 1e-12, 0.5
# Vectors at most, in modes and in blocks.
SPACE, BLOCKS = 2, 60
# Of the last eigenvalue, its residual and the gap after it where a place is chosen, at most and at least;
# blocks within which it lies in a space, and after which it is looked at again. Of those that are found,
# residuals at most.
NEAR, GAP, LOOK, FOUND = 0.02, 1e-3, 2, 1e-6


def share(comm: MPI.Comm, count: int) -> slice:
    """This rank's part of so many rows or columns."""
    return slice(*_bounds(comm, count)[comm.rank : comm.rank + 2])


def _bounds(comm: MPI.Comm, count: int) -> list[int]:
    return [count * rank // comm.size for rank in range(comm.size + 1)]


def by_columns(
    comm: MPI.Comm, rows: np.ndarray, count: int, work: Callable[[np.ndarray], np.ndarray]
) -> np.ndarray:
    """What `work` makes of columns of so many rows, of which each rank has its share, and works on its share
    of the columns.
    """
    if comm.size == 1:
        return work(rows)
    found = work(np.asfortranarray(_turned(comm, rows, count)))
    return _turned(comm, found.T, rows.shape[1]).T


def _turned(comm: MPI.Comm, rows: np.ndarray, count: int) -> np.ndarray:
    """(count, own): this rank's share of the columns of (count, k), of which each rank has its rows."""
    columns = _bounds(comm, rows.shape[1])
    sent = np.concatenate([rows[:, first:last].ravel() for first, last in pairwise(columns)])
    result = np.empty((count, columns[comm.rank + 1] - columns[comm.rank]))
    sizes = len(rows) * np.diff(columns), np.diff(_bounds(comm, count)) * result.shape[1]
    comm.Alltoallv((sent, sizes[0]), (result, sizes[1]))
    return result


def whole(comm: MPI.Comm, own: np.ndarray, count: int) -> np.ndarray:
    """(count, k): the rows of all ranks, of which each has its share."""
    if comm.size == 1:
        return own
    result = np.empty((count, own.shape[1]))
    sizes = np.diff(_bounds(comm, count)) * own.shape[1]
    comm.Allgatherv(np.ascontiguousarray(own), (result, sizes))
    return result


def lowest(
    comm: MPI.Comm,
    solve: Callable[[np.ndarray], np.ndarray],
    mass: sparse.csr_matrix,
    sizes: tuple[int, int],
    near: Callable[[float], int | None] | None,
) -> tuple[tuple[np.ndarray, np.ndarray, np.ndarray], int, int | None]:
    """The largest eigenvalues of K^-1 M, so many, falling, their mass-normalised vectors and M times these,
    on each rank alike, by blocks of so many columns; how many of K below a place beyond the last of these
    are found, and how many there are. Collective.

    `solve` gives K^-1 of this rank's columns, and (K - place M)^-1 once `near` was called with a place, below
    which it counts eigenvalues. Those about it come in fewer blocks so.

    Eigenvalues of multiplicity `width` or less are all found but by round-off. All vectors are out of K^-1 M,
    and have no part in what has no mass.

    Raises
    ------
    ValueError
        If a motion has a negative mass.
    SolveError
        If modes are not found.
    """
    (count, width), size = sizes, mass.shape[0]
    most = min(SPACE * count + BLOCKS * width, size + width)
    space, random = _Space(comm, mass, most), np.random.default_rng(0)
    # Coefficients: K^-1 M of the former are the latter.
    before, after = np.eye(space.most), np.zeros((space.most, space.most))
    done, due, place = 0, count, 0.0
    below: int | None = None
    while True:
        if space.used == done:  # at the beginning, and where vectors are those of an invariant part
            space.add(by_columns(comm, space.mass @ random.standard_normal((size, width)), size, solve))
        last = slice(done, space.used)
        done = space.used
        if last.start == done or done + width > space.most:
            raise failed_solve(
                f"modal: fewer than {count} modes were found in {done} vectors; keep fewer modes, or "
                "check that the mass moves in so many ways"
            )
        block = by_columns(comm, space.inertia[:, last], size, solve)
        after[:done, last], after[done : space.used, last] = space.add(block)
        before[:, last] += place * after[:, last]
        if done < count or (done < due and space.used > done):
            continue
        span, images = before[: space.used, :done], after[: space.used, :done]
        if place:  # else these are unit vectors
            span, triangle = np.linalg.qr(span)
            images = images @ np.linalg.inv(triangle)
        projected = span.T @ images
        values, parts = (part[..., ::-1] for part in np.linalg.eigh(projected))  # by its lower triangle
        left = np.linalg.norm((images - span @ projected) @ parts, axis=0)
        excess = (left[:count] / (TOLERANCE * np.abs(values[:count]))).max()
        if excess <= 1.0:
            own = (part[:, : space.used] @ (span @ parts[:, :count]) for part in (space.basis, space.inertia))
            vectors, inertia = (whole(comm, part, size) for part in own)
            known = int(((values * place > 1.0) & (left <= FOUND * values)).sum())
            return (values[:count], vectors, inertia), known, below
        # a block gains two digits at most
        due = done + min(width * int(0.5 * np.log10(excess)), max(LOOK * width, count // 4))
        ends = np.arange(count, min(count + width, done - LOOK * width))
        gaps = values[ends - 1] - values[ends]
        ends = ends[(gaps >= GAP * values[ends - 1]) & (left[ends - 1] <= NEAR * values[ends - 1])]
        if near is not None and not place and len(ends):
            place = 2.0 / (values[ends[0] - 1] + values[ends[0]])
            below = near(place)


class _Space:
    """Vectors that are orthonormal by the mass, and M times these: this rank's rows.

    Attributes
    ----------
    most, used : int
        Vectors.
    basis, inertia : (own, most) arrays
    """

    def __init__(self, comm: MPI.Comm, mass: sparse.csr_matrix, most: int):
        self.comm, self.own = comm, share(comm, mass.shape[0])
        self.mass, self.most, self.used = mass[self.own], most, 0
        self.basis, self.inertia = (np.empty((self.mass.shape[0], most), order="F") for _ in range(2))

    def add(self, block: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Take in what columns, (own, k), have beside the vectors; they are overwritten.

        Returns
        -------
        inside, outside : (used before, k), (new, k) arrays
            Their coefficients of the vectors that were there, and of those that come in.
        """
        before, size = slice(self.used), block.shape[1]
        inside, outside, rows = np.zeros((self.used, size)), np.eye(size), np.asfortranarray(block)
        for lost in (LOST, ENOUGH):
            along = summed(self.comm, self.inertia[:, before].T @ rows)
            if rows.size:  # in place, without an array of that size
                rows = dgemm(-1.0, self.basis[:, before], along, 1.0, rows, overwrite_c=True)
            heavy = np.asfortranarray(self.mass @ whole(self.comm, rows, self.mass.shape[1]))
            inside += along @ outside
            kept, triangle, least = self._triangle(rows, heavy, (along**2).sum(axis=0), lost)
            rows, heavy, outside = rows[:, kept], heavy[:, kept], triangle @ outside
            if least > ENOUGH:
                break
        self.used += len(kept)
        self.basis[:, before.stop : self.used], self.inertia[:, before.stop : self.used] = rows, heavy
        return inside, outside

    def _triangle(
        self, rows: np.ndarray, heavy: np.ndarray, along: np.ndarray, lost: float
    ) -> tuple[list[int], np.ndarray, float]:
        """Make columns orthonormal in place; those of which more than `lost` is their own, their
        coefficients, and the least such part, `along` being squares of what was taken off before.
        """
        products = summed(self.comm, rows.T @ heavy)
        squares = along + products.diagonal()
        with contextlib.suppress(np.linalg.LinAlgError):  # at once, where that leaves no more than rounding
            triangle = np.linalg.cholesky(products).T
            least = np.linalg.svd(triangle / np.sqrt(squares), compute_uv=False)[-1]
            if least > ENOUGH:
                for part in (rows, heavy):
                    part[:] = part @ np.linalg.inv(triangle)
                return list(range(len(along))), triangle, least
        kept, triangle, least = list[int](), np.zeros((len(along), len(along))), 1.0
        for j, square in enumerate(squares):
            row = summed(self.comm, rows[:, j] @ heavy[:, j:])
            if not np.isfinite(row).all():
                raise failed_solve(
                    "modal: a solve overflows; are all entries of mass and stiffness of usual size?"
                )
            if min(row[0], square) < -LOST * abs(square):
                raise wrong_input(
                    "reduce_matrices: mass is indefinite, a motion has less than 0; give one of 0 or more"
                )
            if row[0] <= lost**2 * square:
                continue
            length = np.sqrt(row[0])
            least = min(least, length / np.sqrt(square))
            triangle[len(kept), j:] = row / length
            kept.append(j)
            for part in (rows, heavy):
                part[:, j] /= length
                if part[:, j + 1 :].size:
                    dger(-1.0 / length, part[:, j], row[1:], a=part[:, j + 1 :], overwrite_a=True)
        return kept, triangle[: len(kept)], least
