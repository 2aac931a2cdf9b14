"""Cells before they become S-elements: polygons over shared vertices, some edges curved, faces of cracks kept
apart.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

Edge = tuple[int, int]
Curve = Callable[[np.ndarray], np.ndarray]
_FINE = np.linspace(0.0, 1.0, 65)


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
    sectors : list of int or None
        Of the cell around a tip at an interface: material of the sector between each edge and the tip.
    """

    vertices: list[int]
    centre: tuple[float, float] | None = None
    closed: bool = True
    material: int = 0
    sectors: list[int] | None = None

    def edges(self) -> list[Edge]:
        """Directed edges as pairs of vertices."""
        following = self.vertices[1:] + (self.vertices[:1] if self.closed else [])
        return list(zip(self.vertices, following))


@dataclass
class TipCell:
    """A tip as the cells see it.

    Attributes
    ----------
    position : (x, y)
        m.
    axis : (x, y)
        Unit vector from the tip back along the crack.
    opening : float
        Radian.
    cell : int
        Open cell whose scaling centre is the tip, -1 if there is none.
    arc : (float, float)
        Where the tip and the boundary of that cell stand along the crack, m; `crack_pairs` finds them.
    """

    position: tuple[float, float]
    axis: tuple[float, float]
    opening: float = 0.0
    cell: int = -1
    arc: tuple[float, float] = (0.0, 0.0)


@dataclass
class FacePath:
    """The two faces along one unbranched line, edge beside edge; from a tip where there is one.

    Attributes
    ----------
    right, left : list of (int, int)
        Directed edges from the line's start to its end. The right face is at the right hand of somebody who
        walks that way. One list until the cells at an embedded line are split.
    embedded : bool
        A line inside the material.
    joined : bool
        False for faces of two bodies.
    start, end : TipCell or None
        The tip before the first edge and the one after the last.
    mouths : (bool, bool)
        Whether the line starts and ends on the outline.
    """

    right: list[Edge]
    left: list[Edge]
    embedded: bool = True
    joined: bool = True
    start: TipCell | None = None
    end: TipCell | None = None
    mouths: tuple[bool, bool] = (False, False)


@dataclass
class CrackFaces:
    """A crack as the cells see it.

    Attributes
    ----------
    name : str
    where : str
        Names it in messages.
    paths : list of FacePath
        Its unbranched lines.
    opening : float
        Angle by which the faces are still to be moved apart, degrees.
    drawn : float
        Length of its lines before their edges are divided, m.
    length : float or None
        m; None: that of the faces.
    """

    name: str
    where: str
    paths: list[FacePath] = field(default_factory=list)
    opening: float = 0.0
    drawn: float = 0.0
    length: float | None = None


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
    materials : list of str
    groups : dict of str to list of (int, int)
        Edges of cracks that are still to be made, by the names of physical curves: see
        `meshing.cells.crack_lines`.
    tip_sizes : dict of int to float
        Wanted sizes of tips' elements at some vertices, m.
    cracks : list of CrackFaces
    """

    vertices: list[tuple[float, float]] = field(default_factory=list)
    cells: list[Cell] = field(default_factory=list)
    curves: dict[Edge, Curve] = field(default_factory=dict)
    edge_sets: dict[str, list[Edge]] = field(default_factory=dict)
    points: dict[str, int] = field(default_factory=dict)
    materials: list[str] = field(default_factory=lambda: ["material"])
    groups: dict[str, list[Edge]] = field(default_factory=dict)
    tip_sizes: dict[int, float] = field(default_factory=dict)
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

    def curve(self, first: int, second: int) -> Curve | None:
        """Shape of an edge from its first vertex to its second; None: straight."""
        curve = self.curves.get(edge_key((first, second)))
        return curve if curve is None or first < second else reversed_curve(curve)

    def set_curve(self, first: int, second: int, curve: Curve) -> None:
        """Give an edge the shape of `curve`, which runs from the first vertex to the second."""
        self.curves[edge_key((first, second))] = curve if first < second else reversed_curve(curve)

    def along(self, edge: Edge, at: Sequence[float] | np.ndarray) -> np.ndarray:
        """Points of an edge (n, 2) at parameters in [0, 1], from its first vertex to its second."""
        curve, at = self.curve(*edge), np.asarray(at, float)
        if curve is not None:
            return curve(at)
        first, last = (np.array(self.vertices[vertex]) for vertex in edge)
        return (1.0 - at[:, None]) * first + at[:, None] * last

    def edge_length(self, first: int, second: int) -> float:
        """m."""
        points = self.along(
            (first, second), _FINE if edge_key((first, second)) in self.curves else (0.0, 1.0)
        )
        return float(np.hypot(*np.diff(points, axis=0).T).sum())

    def edge_uses(self) -> dict[Edge, int]:
        """How many cells use each edge, keyed by its vertices, lower number first."""
        uses: dict[Edge, int] = {}
        for cell in self.cells:
            for edge in cell.edges():
                key = edge_key(edge)
                uses[key] = uses.get(key, 0) + 1
        return uses


def edge_key(edge: Edge) -> Edge:
    """An edge's vertices, lower number first."""
    return edge if edge[0] < edge[1] else (edge[1], edge[0])


def edges_of(path: Sequence[int]) -> list[Edge]:
    """The edges from vertex to vertex of a path."""
    return list(zip(path, path[1:]))


def divided(edges: Sequence[Edge], inserted: Mapping[Edge, Sequence[int]]) -> list[Edge]:
    """Directed edges with the vertices that have been put between their ends."""
    return [part for edge in edges for part in edges_of([edge[0], *inserted.get(edge, ()), edge[1]])]


def reversed_curve(curve: Curve) -> Curve:
    """The same curve from its end to its start."""
    return lambda at: curve(1.0 - np.asarray(at))


def part_of_curve(curve: Curve, start: float, stop: float) -> Curve:
    """The piece of a curve between two of its parameters."""
    return lambda at: curve(start + (stop - start) * np.asarray(at))
