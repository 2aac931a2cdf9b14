"""PETSc matrices from element blocks, a batch of elements at a time into rows of known length."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from ...petsc import MPI, PETSc, solving, stage

Triples = tuple[np.ndarray, np.ndarray, np.ndarray]

# Entries of the blocks that are in memory at a time.
_BATCH = 2**17


@dataclass(frozen=True, eq=False)
class ElementBlocks:
    """Dense blocks to be summed to a matrix.

    Attributes
    ----------
    rows : (k, n) int array
        Global numbers; -1 (held fixed) is dropped.
    columns : (k, m) int array
    values : callable
        (k', n, m) blocks of a slice of the k elements: computed when they are needed.
    """

    rows: np.ndarray
    columns: np.ndarray
    values: Callable[[slice], np.ndarray]

    def batches(self) -> Iterator[slice]:
        """Slices of the elements that bound the memory of their blocks."""
        length = max(1, _BATCH // max(1, self.rows.shape[1] * self.columns.shape[1]))
        for first in range(0, len(self.rows), length):
            yield slice(first, min(first + length, len(self.rows)))


_TYPES = {"upper": PETSc.Mat.Type.SBAIJ, "blocks": PETSc.Mat.Type.BAIJ}


@stage("Assembly")
def assemble(
    comm: MPI.Comm,
    ranges: np.ndarray,
    blocks: list[ElementBlocks],
    kind: str = "symmetric",
    *,
    column_ranges: np.ndarray | None = None,
    block_size: int = 1,
) -> PETSc.Mat:
    """Sum the element blocks of all ranks to a distributed matrix. Collective.

    Parameters
    ----------
    comm : Comm
    ranges : (ranks + 1,) int array
        Row ownership.
    blocks : list of ElementBlocks
        Rows owned by another rank are sent there.
    kind : {"symmetric", "upper", "blocks", "general"}
        All but "general" are marked as symmetric positive definite: PETSc then offers Cholesky and half the
        work. "upper": the upper half alone is kept, which takes least memory and time, and products read half
        as much; rows cannot be asked for. "blocks": full blocks of the block size, whose products are the
        fastest where caches hold the matrix.
    column_ranges : (ranks + 1,) int array, optional
        Column ownership of a rectangular matrix.
    block_size : int
        Unknowns a node, where rows and columns of all blocks are all unknowns of nodes in their order.
    """
    column_ranges = ranges if column_ranges is None else column_ranges
    upper, width, blocked = kind == "upper", block_size, kind in _TYPES
    nodes = [ElementBlocks(_of_nodes(b.rows, width), _of_nodes(b.columns, width), b.values) for b in blocks]
    with solving("assembly"):
        # of nodes: a quarter of the entries to be counted where each has two unknowns
        lengths = row_lengths(comm, ranges // width, column_ranges // width, nodes, upper)
        if blocked:
            blocks = nodes
        else:
            lengths = (np.repeat(width * lengths[0], width), np.repeat(width * lengths[1], width))
        matrix = PETSc.Mat().create(comm)
        matrix.setType(_TYPES.get(kind, PETSc.Mat.Type.AIJ))
        matrix.setSizes(_sizes(comm, ranges, column_ranges))
        matrix.setBlockSize(block_size)
        matrix.setPreallocationNNZ(lengths)
        # Implied by the lengths where a rank has rows; but the end of an assembly waits for all ranks unless
        # it is said on all of them.
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, True)
        if upper:
            matrix.setOption(PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True)
        _add(matrix, blocks, matrix.setValuesBlockedRCV if blocked else matrix.setValuesRCV)
    _mark(matrix, kind != "general")
    return matrix


@stage("Assembly")
def assemble_like(matrix: PETSc.Mat, blocks: list[ElementBlocks], definite: bool) -> PETSc.Mat:
    """Sum of other element blocks of all ranks where `matrix` has entries, itself assembled from blocks of
    the same rows and columns: their lengths are not counted again. Symmetric, and told whether it is
    positive definite. Collective.
    """
    with solving("assembly"):
        result = matrix.duplicate(copy=False)
        _add(result, blocks, result.setValuesRCV)
    _mark(result, True, definite)
    return result


def _of_nodes(unknowns: np.ndarray, width: int) -> np.ndarray:
    """Numbers of nodes from those of all their unknowns; -1 stays -1."""
    return unknowns if width == 1 else unknowns[:, ::width] // width


def _add(matrix: PETSc.Mat, blocks: list[ElementBlocks], add: Callable) -> None:
    for block in blocks:
        rows, columns = (np.ascontiguousarray(n, dtype=PETSc.IntType) for n in (block.rows, block.columns))
        for batch in block.batches():
            values = np.ascontiguousarray(block.values(batch))
            add(rows[batch], columns[batch], values, addv=True)
    matrix.assemble()


@stage("Assembly")
def assemble_by_ranks(
    comm: MPI.Comm, ranges: np.ndarray, blocks: list[ElementBlocks], block_size: int = 1
) -> PETSc.Mat:
    """The same sum kept apart by ranks, a MATIS: what domain decomposition (PCBDDC) works with. Collective.

    Parameters
    ----------
    comm, ranges, blocks, block_size
        See `assemble`; rows and columns alike.
    """
    touched = np.unique(np.concatenate([np.empty(0, dtype=np.int64), *(b.rows.ravel() for b in blocks)]))
    touched = touched[touched >= 0]

    def local(numbers: np.ndarray) -> np.ndarray:
        return np.where(numbers >= 0, np.searchsorted(touched, numbers), -1)

    own = [ElementBlocks(local(block.rows), local(block.columns), block.values) for block in blocks]
    sizes = _sizes(comm, ranges, ranges)
    nodes = (touched[::block_size] // block_size).astype(PETSc.IntType)
    numbers = PETSc.LGMap().create(nodes, bsize=block_size, comm=comm)
    with solving("assembly"):
        matrix = PETSc.Mat().create(comm)
        matrix.setType(PETSc.Mat.Type.IS)
        matrix.setSizes(sizes, bsize=block_size)
        matrix.setLGMap(numbers)
        part = assemble(MPI.COMM_SELF, np.array([0, len(touched)]), own, block_size=block_size)
        matrix.setISLocalMat(part)
        matrix.assemble()
    part.destroy()
    numbers.destroy()
    _mark(matrix, True)
    return matrix


def from_rows(
    comm: MPI.Comm,
    ranges: np.ndarray,
    column_ranges: np.ndarray,
    rows: Triples,
    symmetric: bool,
) -> PETSc.Mat:
    """Distributed matrix from this rank's compressed rows (starts, global columns, values)."""
    starts, columns, values = rows
    with solving("assembly"):
        matrix = PETSc.Mat().createAIJ(
            size=_sizes(comm, ranges, column_ranges),
            csr=(starts.astype(PETSc.IntType), columns.astype(PETSc.IntType), values),
            comm=comm,
        )
    _mark(matrix, symmetric)
    return matrix


def _sizes(comm: MPI.Comm, *ranges: np.ndarray) -> tuple[tuple[int, int], ...]:
    return tuple((int(r[comm.rank + 1] - r[comm.rank]), int(r[-1])) for r in ranges)


def _mark(matrix: PETSc.Mat, symmetric: bool, definite: bool = True) -> None:
    if symmetric:
        matrix.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        matrix.setOption(PETSc.Mat.Option.SPD, definite)


def row_lengths(
    comm: MPI.Comm,
    ranges: np.ndarray,
    column_ranges: np.ndarray,
    blocks: list[ElementBlocks],
    upper: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of nonzeros of this rank's rows, in the columns that it owns and in the others. Collective.

    Parameters
    ----------
    ranges, column_ranges : (ranks + 1,) int arrays
    blocks : list of ElementBlocks
    upper : bool
        Of the upper half alone.
    """
    first, last = (int(ranges[comm.rank + k]) for k in (0, 1))
    pattern = _Pattern(blocks)
    mine = (pattern.rows >= first) & (pattern.rows < last)
    foreign_rows, foreign_columns = pattern.entries(np.flatnonzero(~mine))
    counts = np.zeros((2, last - first), dtype=PETSc.IntType)
    columns = (int(column_ranges[comm.rank]), int(column_ranges[comm.rank + 1]))
    touched = np.zeros(last - first, dtype=bool)
    if comm.size > 1:
        foreign_rows, foreign_columns = route(comm, ranges, foreign_rows, foreign_columns)
        touched[foreign_rows - first] = True
        # rows that other ranks add to: their entries with this rank's own, each once
        shared = np.flatnonzero(mine)[touched[pattern.rows[mine] - first]]
        own_rows, own_columns = pattern.entries(shared)
        width = int(column_ranges[-1])
        pairs = np.unique(
            np.concatenate([foreign_rows, own_rows]) * width + np.concatenate([foreign_columns, own_columns])
        )
        _count(counts, first, *np.divmod(pairs, width), owned=columns, upper=upper)
    alone = np.flatnonzero(mine)
    alone = alone[~touched[pattern.rows[alone] - first]]
    # so few at a time that memory is used again instead of being got from the system, which takes longer
    for part in np.array_split(alone, max(1, len(alone) // 5_000)):
        rows, found = pattern.entries(part)
        _count(counts, first, rows, found, owned=columns, upper=upper)
    return counts[0], counts[1]


def _count(
    counts: np.ndarray,
    first: int,
    rows: np.ndarray,
    columns: np.ndarray,
    *,
    owned: tuple[int, int],
    upper: bool,
) -> None:
    if upper:
        kept = columns >= rows
        rows, columns = rows[kept], columns[kept]
    rows = rows - first
    elsewhere = (columns < owned[0]) | (columns >= owned[1])
    everything, others = (np.bincount(some, minlength=counts.shape[1]) for some in (rows, rows[elsewhere]))
    counts[0] += (everything - others).astype(counts.dtype)
    counts[1] += others.astype(counts.dtype)


class _Pattern:
    """Where a rank's blocks have entries: rows that share a block with a column.

    Attributes
    ----------
    rows : (r,) int64 array
        Global numbers of the rows that the blocks touch, ascending.
    """

    def __init__(self, blocks: list[ElementBlocks]):
        self.rows, self._of_rows = _incidence([block.rows for block in blocks])
        self._columns, self._of_columns = _incidence([block.columns for block in blocks])
        self._of_rows = self._of_rows.T.tocsr()

    def entries(self, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Global (rows, columns) of the entries in some of the rows, each once."""
        found = self._of_rows[chosen] @ self._of_columns
        return np.repeat(self.rows[chosen], np.diff(found.indptr)), self._columns[found.indices]


def _incidence(numbers: list[np.ndarray]) -> tuple[np.ndarray, sparse.csr_matrix]:
    """Numbers that occur, and which of them each of the elements (rows of the arrays) has."""
    counts = np.concatenate([np.empty(0, dtype=int), *(np.full(len(n), n.shape[1]) for n in numbers)])
    flat = np.concatenate([np.empty(0, dtype=np.int64), *(n.ravel() for n in numbers)])
    elements = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
    free = flat >= 0
    found, places = np.unique(flat[free], return_inverse=True)
    # whether, not how often: a byte holds it, as long as no element is met 128 times
    ones = np.ones(len(places), dtype=np.int8)
    table = sparse.csr_matrix(
        (ones, (elements[free], places.astype(np.int32))), shape=(len(counts), len(found))
    )
    return found, table


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
