"""Elements of a body as VTK names and numbers them: what is drawn and written of it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sized

import numpy as np

# Corners of the faces, and ends of the edges in whose middles the further nodes of second order lie.
SHAPES = {
    "triangle": ("012", "01 12 20"),
    "quad": ("0123", "01 12 23 30"),
    "tetra": ("021 013 123 032", "01 12 20 03 13 23"),
    "wedge": ("021 345 0143 1254 0352", "01 12 20 34 45 53 03 14 25"),
    "hexahedron": ("0321 4567 0154 1265 2376 0473", "01 12 23 30 45 56 67 74 04 15 26 37"),
}


def _kinds() -> Iterator[tuple[str, tuple[int, list[list[int]]]]]:
    """The number of nodes of each kind, and nodes of its faces, corners first."""
    for shape, (faces, edges) in SHAPES.items():
        corners = [[int(node) for node in face] for face in faces.split()]
        count = 1 + max(map(max, corners))
        middles = {frozenset(map(int, edge)): k for k, edge in enumerate(edges.split(), count)}
        yield shape, (count, corners)
        sides = [[middles[frozenset(ends)] for ends in zip(face, face[1:] + face[:1])] for face in corners]
        count += len(middles)
        yield f"{shape}{count}", (count, [face + own for face, own in zip(corners, sides)])


KINDS = dict(_kinds())


def corners(face: Sized) -> int:
    """How many nodes of a face, of 3, 4, 6 or 8, are corners."""
    return 3 if len(face) in (3, 6) else 4


def outer_faces(cells: Mapping[str, np.ndarray]) -> list[list[int]]:
    """Rows of nodes, corners first, of the faces that one element alone has; quadrilaterals of collapsed
    elements, which have a node twice, are triangles, or none.
    """
    each = ((elements, own) for kind, elements in cells.items() for own in KINDS[kind][1])
    faces = [face for elements, own in each for face in elements[:, own].tolist()]
    ends = [frozenset(face[: corners(face)]) for face in faces]
    count = Counter(ends)
    return [[*dict.fromkeys(face)] for face, own in zip(faces, ends) if count[own] == 1 and len(own) > 2]
