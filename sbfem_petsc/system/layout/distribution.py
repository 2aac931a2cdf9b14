"""A boundary mesh on its ranks: what all of them know of it, and the part of each."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.boundary_mesh import BoundaryMesh

from ...checks import shown
from ...errors import UnknownName, listed
from ...petsc import MPI, stage
from ...ranks.parallel import agree, collective
from ...supports import Support
from . import partition
from .layout import Layout


def declared_clamp(comm: MPI.Comm, mesh: BoundaryMesh | None) -> str | None:
    """Edge set that a mesh declares as its clamped one (a beam its left end), on all ranks. Collective."""
    return next((name for name in comm.allgather(getattr(mesh, "clamped", None)) if name is not None), None)


@stage("Mesh")
def distribute(comm: MPI.Comm, mesh: BoundaryMesh | None, supports: tuple[Support, ...]) -> Layout:
    """Number the unknowns and give each rank its part of a mesh.

    Parameters
    ----------
    comm : Comm
    mesh : BoundaryMesh or None
        On every rank, or on rank 0 alone: each rank then receives its part.
    supports : tuple of Support

    Raises
    ------
    TypeError, ValueError, KeyError
        If the mesh is none, or a support names something that does not exist; on all ranks.
    """
    everywhere = all(comm.allgather(mesh is not None))
    if everywhere:
        agree(comm, "Model", {"mesh": mesh})
    facts: dict[str, Any] = {}
    parts: partition.Parts | None = None
    with collective(comm):
        if mesh is not None and not isinstance(mesh, BoundaryMesh):
            raise TypeError(
                f"Model: mesh = {shown(mesh)} is not a BoundaryMesh; call its .mesh() or read_gmsh(path)"
            )
        if comm.rank == 0 and mesh is None:
            raise ValueError("Model: mesh is None on rank 0; give the mesh on rank 0 at least")
        if mesh is not None and (everywhere or comm.rank == 0):
            numbering = partition.number_unknowns(mesh, _fixed(mesh, supports), comm.size)
            parts = partition.Parts(mesh, numbering)
            facts = _facts(mesh, numbering, parts.bodies)
    if everywhere:
        assert parts is not None  # made on every rank
        part = parts.of(comm.rank)
    else:
        facts, part = comm.bcast(facts), _handed_out(comm, parts)
    return Layout(comm, **facts, part=part)


def _handed_out(comm: MPI.Comm, parts: partition.Parts | None) -> partition.Part:
    """Each rank's part from rank 0, which makes and sends one after the other. Collective."""
    if parts is None:
        return comm.recv(source=0)
    for rank in range(1, comm.size):
        comm.send(parts.of(rank), dest=rank)
    return parts.of(0)


def _facts(mesh: BoundaryMesh, numbering: partition.Numbering, bodies: np.ndarray) -> dict[str, Any]:
    # the area is exact for the polynomial edges, which are polylines in the perimeter
    outline, chain = mesh.outline_edges(), mesh.nodes[mesh.edges]
    lengths = np.linalg.norm(np.diff(chain, axis=1), axis=2).sum(axis=1)
    return {
        "order": mesh.order,
        "elements": mesh.elements,
        "cracks": mesh.cracks,
        "tip_elements": tuple(tip for tip in mesh.tips if tip.element >= 0),
        "material_names": tuple(mesh.material_names),
        "compositions": partition.compositions(mesh),
        "edge_sets": tuple(mesh.edge_sets),
        "inner_edges": {
            name: int((~np.isin(edges, outline)).sum()) for name, edges in mesh.edge_sets.items()
        },
        "pairs": mesh.pairs,
        "points": {
            name: (tuple(mesh.nodes[n]), tuple(numbering.unknowns[n]), int(n))
            for name, n in mesh.points.items()
        },
        "pair_unknowns": numbering.unknowns[mesh.pairs.nodes].reshape(-1, 2, 2),
        "bodies": _body_middles(mesh, bodies),
        "extent": (mesh.nodes.min(axis=0), mesh.nodes.max(axis=0)),
        "area": mesh.area,
        "perimeter": float(lengths[outline].sum()),
        "ranges": numbering.ranges,
    }


def _body_middles(mesh: BoundaryMesh, body: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Middles of the bodies' extents, from the body of each node."""
    middles = []
    for number in range(body.max() + 1):
        places = mesh.nodes[body == number]
        x, y = 0.5 * (places.min(axis=0) + places.max(axis=0))
        middles.append((float(x), float(y)))
    return tuple(middles)


def _fixed(mesh: BoundaryMesh, supports: tuple[Support, ...]) -> np.ndarray:
    """(nodes, 2): displacements held fixed by the supports."""
    fixed = np.zeros((len(mesh.nodes), 2), dtype=bool)
    for support in supports:
        if support.where in mesh.edge_sets:
            nodes = np.unique(mesh.edges[np.asarray(mesh.edge_sets[support.where], dtype=int)])
        elif support.where in mesh.points:
            nodes = np.array([mesh.points[support.where]])
        else:
            raise UnknownName(
                f"Model: support {support.where!r} is neither an edge set ({listed(mesh.edge_sets)}) nor a "
                "point "
                f"({listed(mesh.points)}) of the mesh"
            )
        fixed[nodes] |= np.array(support.fixed)
    return fixed
