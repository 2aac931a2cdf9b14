"""Elements of a body as VTK names and numbers them: what is drawn and written of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..checks import choice, instance, real_array, shown

# Corners of the faces by shape, and nodes by kind.
FACES: dict[str, tuple[tuple[int, ...], ...]] = {
    "triangle": ((0, 1, 2),),
    "quad": ((0, 1, 2, 3),),
    "tetra": ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    "wedge": ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (0, 3, 5, 2)),
    "hexahedron": ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (0, 4, 7, 3)),
}
# Edges by the nodes in their middles.
EDGES: dict[str, tuple[tuple[int, int], ...]] = {
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": (
        *((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
}
NODES = {"triangle": 3, "triangle6": 6, "quad": 4, "quad8": 8, "tetra": 4, "tetra10": 10, "wedge": 6}
NODES |= {"wedge15": 15, "hexahedron": 8, "hexahedron20": 20}


def checked_cells(owner: str, given: Any, nodes: Mapping[int, int]) -> dict[str, np.ndarray]:
    """(elements, k) rows of nodes by kind, from labels."""
    found = {}
    for kind, labels in instance(owner, "elements", given, Mapping, "a dict of kinds to labels").items():
        choice(owner, "elements", kind, tuple(NODES))
        cells = real_array(owner, f"elements[{kind!r}]", labels, 2)
        if cells.shape[1] != NODES[kind]:
            raise ValueError(f"{owner}: elements {kind!r} have {cells.shape[1]} nodes, not {NODES[kind]}")
        require_known(owner, f"elements[{kind!r}]", cells.ravel().tolist(), nodes)
        found[kind] = np.array([[nodes[int(a)] for a in cell] for cell in cells])
    return found


def require_known(owner: str, what: str, labels: Iterable[float], nodes: Mapping[int, int]) -> None:
    """ValueError for a label that no node has."""
    if lost := {*labels} - {*nodes}:
        raise ValueError(f"{owner}: {what} has node {shown(min(lost))}, which nodes has not; is it internal?")


def outer_faces(cells: Mapping[str, np.ndarray]) -> list[tuple[int, list[int]]]:
    """Number of corners and rows of nodes, corners first, of the faces that one element alone has."""
    found = dict[tuple[int, ...], tuple[int, list[int]] | None]()
    for kind, elements in cells.items():
        shape = kind.rstrip("0123456789")
        first = 1 + max(map(max, FACES[shape]))
        middles = {frozenset(edge): first + k for k, edge in enumerate(EDGES[shape])}
        for corners in FACES[shape]:
            edges = map(frozenset, zip(corners, corners[1:] + corners[:1]))
            own = [*corners, *(middles[edge] for edge in edges if first < NODES[kind])]
            for face in elements[:, own].tolist():
                key = tuple(sorted(face[: len(corners)]))
                found[key] = None if key in found else (len(corners), face)
    return [face for face in found.values() if face is not None]


def surface(cells: Mapping[str, np.ndarray]) -> list[np.ndarray]:
    """(faces, corners) rows of nodes of the faces that one element alone has, those of triangles first."""
    outer = outer_faces(cells)
    return [np.array([face[:k] for n, face in outer if n == k], dtype=int).reshape(-1, k) for k in (3, 4)]
