"""PETSc matrices and vectors from element blocks, each entry sent to the rank that owns its row."""

from __future__ import annotations

import numpy as np
from scipy import sparse

from ..petsc import MPI, PETSc

Triples = tuple[np.ndarray, np.ndarray, np.ndarray]


def block_triples(rows: np.ndarray, columns: np.ndarray, blocks: np.ndarray) -> Triples:
    """Flat (rows, columns, values) of element blocks (k, n, m); rows (k, n) and columns (k, m) may hold -1,
    which is dropped.
    """
    r = np.broadcast_to(rows[:, :, None], blocks.shape)
    c = np.broadcast_to(columns[:, None, :], blocks.shape)
    keep = (r >= 0) & (c >= 0)
    return (r.ravel(), c.ravel(), blocks.ravel()) if keep.all() else (r[keep], c[keep], blocks[keep])


def assemble(
    comm: MPI.Comm,
    ranges: np.ndarray,
    triples: list[Triples],
    symmetric: bool = True,
    column_ranges: np.ndarray | None = None,
    block_size: int = 1,
) -> PETSc.Mat:
    """Sum triples of all ranks to a distributed matrix.

    Parameters
    ----------
    comm : Comm
    ranges : (ranks + 1,) int array
        Row ownership.
    triples : list of (rows, columns, values)
        Global numbers; rows owned by another rank are sent there.
    symmetric : bool
        Mark the matrix as symmetric positive definite (PETSc then offers Cholesky and half the work).
    column_ranges : (ranks + 1,) int array, optional
        Column ownership of a rectangular matrix.
    block_size : int
        Unknowns a node, where it is the same at all of them.
    """
    column_ranges = ranges if column_ranges is None else column_ranges
    rows, columns, values = (
        np.concatenate([np.asarray(t[k]) for t in triples] or [np.empty(0)]) for k in range(3)
    )
    rows, columns = rows.astype(np.int64, copy=False), columns.astype(np.int64, copy=False)
    if comm.size > 1:
        rows, columns, values = route(comm, ranges, rows, columns, values)
    first, last = ranges[comm.rank], ranges[comm.rank + 1]
    local = sparse.coo_matrix(
        (values, (rows - first, columns)), shape=(last - first, column_ranges[-1])
    ).tocsr()
    local.sort_indices()
    return from_rows(
        comm, ranges, column_ranges, (local.indptr, local.indices, local.data), symmetric, block_size
    )


def from_rows(
    comm: MPI.Comm,
    ranges: np.ndarray,
    column_ranges: np.ndarray,
    rows: Triples,
    symmetric: bool,
    block_size: int = 1,
) -> PETSc.Mat:
    """Distributed matrix from this rank's compressed rows (starts, global columns, values)."""
    sizes = tuple((int(r[comm.rank + 1] - r[comm.rank]), int(r[-1])) for r in (ranges, column_ranges))
    starts, columns, values = rows
    matrix = PETSc.Mat().createAIJ(
        size=sizes,
        bsize=block_size,
        csr=(starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), values),
        comm=comm,
    )
    if symmetric:
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        matrix.setOption(PETSc.Mat.Option.SPD, True)
    return matrix


def route(comm: MPI.Comm, ranges: np.ndarray, numbers: np.ndarray, *others: np.ndarray) -> list[np.ndarray]:
    """Bring global numbers, and what belongs to them, to the ranks that own them. Collective.

    Parameters
    ----------
    ranges : (ranks + 1,) int array
        Ownership.
    numbers : (k,) int64 array
    others : (k,) int64 or float arrays
    """
    owner = np.searchsorted(ranges, numbers, side="right") - 1
    order = np.argsort(owner, kind="stable")
    counts = np.bincount(owner, minlength=comm.size)
    received = np.array(comm.alltoall(counts.tolist()))
    result = []
    for array in (numbers, *others):
        kind = MPI.DOUBLE if array.dtype == float else MPI.INT64_T
        incoming = np.empty(received.sum(), dtype=array.dtype)
        comm.Alltoallv([np.ascontiguousarray(array[order]), counts, kind], [incoming, received, kind])
        result.append(incoming)
    return result
