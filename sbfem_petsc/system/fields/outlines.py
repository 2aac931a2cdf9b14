"""Outlines and regions of a structure with its fields, sampled and gathered on rank 0 for pictures."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from meshing.gll import shape_functions

from ..model import Model
from .sampling import as_field, outline_edges, point_grid_cells, sample


@dataclass(frozen=True, eq=False)
class Piece:
    """A polyline of the structure's outline, material on its left.

    Attributes
    ----------
    key : tuple of int
        The same for an edge seen from both of its S-elements.
    start, end : int
        Global nodes.
    positions : (n, 2) array
        m.
    displacements : (fields, n, 2) array
        m.
    """

    key: tuple[int, ...]
    start: int
    end: int
    positions: np.ndarray
    displacements: np.ndarray


def gather_outline(model: Model, fields: Collection[Any]) -> list[Piece] | None:
    """Outline of the structure, crack faces included, with displacement fields, on rank 0. Collective.

    Parameters
    ----------
    model : Model
    fields : Static, Field or (m, 2) array of each
        Displacements of this rank's nodes.

    Returns
    -------
    list of Piece on rank 0, None elsewhere
    """
    part = model.layout.part
    at = np.linspace(-1.0, 1.0, max(2 * model.order, 8) + 1)
    values, _ = shape_functions(model.order, at)
    stacked = np.stack([part.coordinates, *(as_field(state).nodal for state in fields)])

    def edge(nodes: np.ndarray) -> Piece:
        ends = (int(part.nodes[nodes[0]]), int(part.nodes[nodes[-1]]))
        inner = sorted(int(n) for n in part.nodes[nodes[1:-1]][[0, -1]]) if model.order > 1 else []
        sampled = values @ stacked[:, nodes]
        return Piece((min(ends), max(ends), *inner), *ends, sampled[0], sampled[1:])

    edges = (edge(nodes) for k in range(len(part.chains)) for nodes in outline_edges(model.layout, k))
    gathered = model.comm.gather(_outer([*edges, *_open_faces(model, fields)]))
    return None if gathered is None else _outer(piece for several in gathered for piece in several)


def _outer(pieces: Iterable[Piece]) -> list[Piece]:
    """Those that come once: an edge between two S-elements, or two ranks, comes from both."""
    several = list(pieces)
    times = Counter(piece.key for piece in several)
    return [piece for piece in several if times[piece.key] == 1]


def _open_faces(model: Model, fields: Collection[Any]) -> list[Piece]:
    """The two faces of each open S-element, from the end of its chain over the scaling centre to the
    start.
    """
    pieces, part = [], model.layout.part
    named = {str(k): field for k, field in enumerate(fields)}
    for patch in sample(model.tips, named, stress=False, keep=~part.closed):
        sampled = np.stack([patch.positions, *patch.displacements.values()])
        lines = np.concatenate([sampled[:, :, :, -1, -1], sampled[:, :, -2::-1, 0, 0]], axis=2)
        lines[:, patch.mirrored] = lines[:, patch.mirrored, ::-1]
        for row, element in enumerate(patch.elements):
            chain, key = part.nodes[part.chains[element]], (-1 - int(part.elements[element]),)
            pieces.append(Piece(key, int(chain[-1]), int(chain[0]), lines[0, row], lines[1:, row]))
    return pieces


def loops(pieces: list[Piece]) -> list[list[int]]:
    """Indices of the pieces that follow one another, one list a closed loop."""
    following: dict[int, list[int]] = defaultdict(list)
    for index, piece in enumerate(pieces):
        following[piece.start].append(index)
    left, result = set(range(len(pieces))), []
    while left:
        index, loop = min(left), list[int]()
        while index in left:
            left.remove(index)
            loop.append(index)
            index = next((i for i in following[pieces[index].end] if i in left), -1)
        result.append(loop)
    return result


@dataclass(frozen=True, eq=False)
class Region:
    """Sampled interior of a window: points (n, 2), displacements (n, 2), stress (n, 4) as in `Patches`,
    triangles (t, 3).
    """

    positions: np.ndarray
    displacements: np.ndarray
    stress: np.ndarray
    triangles: np.ndarray


def gather_region(
    model: Model, field: Any, centre: np.ndarray, half: float, *, subdivisions: int = 0, refine: int = 4
) -> Region | None:
    """Interior of the S-elements that reach into the square window ``centre`` +- ``half``, on rank 0.
    Collective.

    Parameters
    ----------
    subdivisions, refine
        See `sample`. Default: twice the order, six at least.
    """
    part = model.layout.part
    keep = np.zeros(len(part.chains), dtype=bool)
    for k, chain in enumerate(part.chains):
        corners = np.vstack([part.coordinates[chain], part.centres[k]])
        keep[k] = (corners.min(axis=0) < centre + half).all() and (corners.max(axis=0) > centre - half).all()
    pieces = []
    pieces_an_edge = subdivisions or max(2 * model.order, 6)
    for patch in sample(model.tips, {"u": field}, keep=keep, subdivisions=pieces_an_edge, refine=refine):
        quads, triangles = (corners.reshape(-1, corners.shape[-1]) for corners in point_grid_cells(patch))
        joined = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]], triangles])
        sampled = (patch.positions, patch.displacements["u"], patch.stresses["u"])
        pieces.append([*(array.reshape(-1, array.shape[-1]) for array in sampled), joined])
    gathered = model.comm.gather(pieces)
    if gathered is None:
        return None
    positions, displacements, stress, cells = zip(*(piece for several in gathered for piece in several))
    begin = np.cumsum([0, *map(len, positions)])
    triangles = np.concatenate([some + first for some, first in zip(cells, begin)])
    return Region(np.concatenate(positions), np.concatenate(displacements), np.concatenate(stress), triangles)
