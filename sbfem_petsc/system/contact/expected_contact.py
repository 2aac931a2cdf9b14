"""Rows that a load may close, before the stiffness is factorised: those that touch in the linear solution of
a coarse model, whose displacements are linear along each edge: of order 5 a ninth of the unknowns.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy import sparse

from meshing.gll import gll_nodes

from ...petsc import PETSc, freeing, make_ksp
from ...selement.coefficients import edge_nodes
from ..elements.elements import Elements
from ..solve.assembly import from_rows
from ..solve.stiffness import Stiffness
from .rows import Contact


def expected_contact(
    stiffness: Stiffness, contact: Contact, forces: np.ndarray, gap: np.ndarray
) -> np.ndarray | None:
    """(c,) states to begin from; None where nothing is expected to touch, and where solves with the
    stiffness need refinement. Collective.

    Parameters
    ----------
    stiffness : Stiffness
        Held against every rigid-body motion.
    contact : Contact
    forces : (owned,) array
        Of the load, N.
    gap : (c,) array
        Gaps of the faces where nothing moves, m.
    """
    along = _along_edges(stiffness.elements)
    coarse = stiffness.matrix.ptap(along)
    # the coarse space is one of displacements, so the product is as definite as the stiffness
    coarse.setOption(PETSc.Mat.Option.SPD, True)
    ksp = make_ksp(coarse, "static_coarse_")
    field, right = along.createVecs(side="left"), coarse.createVecRight()
    with freeing(stiffness.layout.comm, right.duplicate(), ksp, coarse, along, field, right) as (
        solution,
        *_,
    ):
        field.array = forces
        size = field.norm()
        along.multTranspose(field, right)
        ksp.solve(right, solution)
        along.mult(solution, field)
        state = contact.laws.touched(contact.rows(field.array_r) + gap)
        # what a poor guess does is another factorisation
        found = ksp.getConvergedReason() > 0 and np.isfinite(field.norm()) and state.any()
        return state if found and not stiffness.refinement.needed(size, field.norm()) else None


def _along_edges(elements: Elements) -> PETSc.Mat:
    """Displacement unknowns from those of the ends of edges, linear between them. Collective."""
    layout = elements.layout
    order, part, comm = layout.order, layout.part, layout.comm
    edges = np.concatenate([np.empty((0, order + 1), dtype=int), *_edges(elements)])
    ends = np.zeros(part.unknowns.shape)
    ends[edges[:, [0, -1]]] = 1.0
    chosen = layout.summed(ends) > 0.0
    ranges = np.concatenate([[0], np.cumsum(comm.allgather(int(chosen.sum())))])
    numbers = np.where(chosen, ranges[comm.rank] + np.cumsum(chosen) - 1.0, -1.0)
    coarse = np.where(part.unknowns >= 0, layout.nodal(numbers), -1.0).astype(np.int64)
    # of the edges that share a node one has its place
    at = np.empty(len(part.nodes), dtype=int)
    at[edges.ravel()] = np.arange(edges.size)
    edge, place = np.divmod(at, order + 1)
    share = 0.5 * (1.0 + gll_nodes(order)[place])
    rows, columns, values = (
        np.concatenate(parts)
        for parts in zip(
            *(
                (part.unknowns[:, k], coarse[edges[edge, end], k], weight)
                for k in (0, 1)
                for end, weight in ((0, 1.0 - share), (-1, share))
            )
        )
    )
    mine = (rows >= layout.owned.start) & (rows < layout.owned.stop) & (columns >= 0) & (values != 0.0)
    shape = (layout.owned.stop - layout.owned.start, int(ranges[-1]))
    entries = (values[mine], (rows[mine] - layout.owned.start, columns[mine]))
    table = sparse.coo_matrix(entries, shape=shape).tocsr()
    compressed = (table.indptr, table.indices, table.data)
    return from_rows(comm, layout.ranges, ranges, compressed, symmetric=False)


def _edges(elements: Elements) -> Iterator[np.ndarray]:
    """(k, order + 1) nodes of the edges of this rank's S-elements, as rows of the part's nodes."""
    order = elements.layout.order
    alike: dict[tuple[int, bool], list[np.ndarray]] = {}
    for group in elements.groups:
        alike.setdefault((group.nodes.shape[1], group.closed), []).append(group.nodes)
    for (count, closed), nodes in alike.items():
        yield np.concatenate(nodes)[:, edge_nodes(count, order, closed)].reshape(-1, order + 1)
