"""Cells before they become S-elements: polygons over shared vertices, some edges curved, faces of cracks kept
apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

Curve = Callable[[np.ndarray], np.ndarray]


@dataclass
class Cell:
    """One polygon.

    Attributes
    ----------
    vertices : list of int
        Counter-clockwise; the first is not repeated. An open cell is a chain from one face to the other.
    centre : (x, y) or None
        Prescribed scaling centre, m; None: to be searched.
    closed : bool
        False for the cell around a crack tip, whose scaling centre is the tip.
    material : int
    """

    vertices: list[int]
    centre: tuple[float, float] | None = None
    closed: bool = True
    material: int = 0

    def edges(self) -> list[tuple[int, int]]:
        """Directed edges as pairs of vertices."""
        following = self.vertices[1:] + (self.vertices[:1] if self.closed else [])
        return list(zip(self.vertices, following))


@dataclass
class CrackFaces:
    """A crack as the cells see it.

    Attributes
    ----------
    name : str
    tip : (x, y)
        m.
    axis : (x, y)
        Unit vector from the tip to the mouth.
    opening : float
        Radian.
    length : float
        From the tip to the mouth along the axis, m.
    right, left : list of (int, int)
        Edges of the two faces as pairs of vertices, in any order and direction. The right face is at the
        right hand of somebody who looks from the tip to the mouth (the free-end side of a notch in a beam).
    tip_cell : int
        Cell whose scaling centre is the tip, -1 if there is none.
    """

    name: str
    tip: tuple[float, float]
    axis: tuple[float, float]
    opening: float
    length: float
    right: list[tuple[int, int]]
    left: list[tuple[int, int]]
    tip_cell: int = -1


@dataclass
class CellComplex:
    """Vertices, cells and what is known about their edges.

    Two vertices may coincide in space (the faces of a closed crack): neighbourhood is decided by vertex
    numbers alone.

    Attributes
    ----------
    vertices : list of (x, y)
        m.
    cells : list of Cell
    curves : dict of (int, int) to callable
        True shape of curved edges: keyed by the edge's vertices, lower number first; maps (n,) parameters in
        [0, 1] from the first vertex to the second to (n, 2) points.
    edge_sets : dict of str to list of (int, int)
        Named edges, pairs of vertices.
    points : dict of str to int
        Named vertices.
    cracks : list of CrackFaces
    """

    vertices: list[tuple[float, float]] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)
    curves: dict[tuple[int, int], Curve] = field(default_factory=dict)
    edge_sets: dict[str, list[tuple[int, int]]] = field(default_factory=dict)
    points: dict[str, int] = field(default_factory=dict)
    cracks: list[CrackFaces] = field(default_factory=list)

    def add_vertex(self, x: float, y: float) -> int:
        """Append a vertex and return its number."""
        self.vertices.append((float(x), float(y)))
        return len(self.vertices) - 1

    def add_cell(
        self,
        vertices: Sequence[int],
        centre: tuple[float, float] | None = None,
        closed: bool = True,
        material: int = 0,
    ) -> int:
        """Append a cell (counter-clockwise vertices) and return its number."""
        self.cells.append(Cell(list(vertices), centre, closed, material))
        return len(self.cells) - 1

    def add_arc(self, first: int, second: int, centre: tuple[float, float], radius: float) -> None:
        """Make the edge between two vertices the shorter arc of a circle through them."""
        low, high = sorted((first, second))
        angle_low, angle_high = (
            np.arctan2(self.vertices[v][1] - centre[1], self.vertices[v][0] - centre[0]) for v in (low, high)
        )
        sweep = (angle_high - angle_low + np.pi) % (2 * np.pi) - np.pi

        def curve(parameter: np.ndarray) -> np.ndarray:
            angle = angle_low + sweep * np.asarray(parameter)
            return np.stack([centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)], axis=1)

        self.curves[low, high] = curve

    def edge_uses(self) -> dict[tuple[int, int], int]:
        """How many cells use each edge, keyed by its vertices, lower number first."""
        uses: dict[tuple[int, int], int] = {}
        for cell in self.cells:
            for edge in cell.edges():
                key = edge_key(edge)
                uses[key] = uses.get(key, 0) + 1
        return uses


def edge_key(edge: tuple[int, int]) -> tuple[int, int]:
    """An edge's vertices, lower number first."""
    return edge if edge[0] < edge[1] else (edge[1], edge[0])
