"""Cells before they become S-elements: polygons over shared vertices, some edges curved, faces of cracks kept
apart.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from meshing.vectors import line_length

Edge = tuple[int, int]
Point = tuple[float, float]
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
        The tip, m, that is the scaling centre of an open cell; None: to be searched.
    material : int
    sectors : list of int or None
        Of the cell around a tip at an interface: material of the sector between each edge and the tip.
    """

    vertices: list[int]
    centre: Point | None = None
    material: int = 0
    sectors: list[int] | None = None

    @property
    def closed(self) -> bool:
        """False for the cell around a crack's tip."""
        return self.centre is None

    def edges(self) -> list[Edge]:
        """Directed edges as pairs of vertices."""
        return around(self.vertices) if self.closed else list(pairwise(self.vertices))


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

    position: Point = (0.0, 0.0)
    axis: Point = (0.0, 0.0)
    opening: float = 0.0
    cell: int = -1
    arc: Point = (0.0, 0.0)


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

    @property
    def tips(self) -> list[TipCell]:
        """The one or two that it has."""
        return [tip for tip in (self.start, self.end) if tip is not None]

    @property
    def faces(self) -> tuple[list[Edge], list[Edge]]:
        """Right and left."""
        return self.right, self.left

    def divide(self, inserted: Mapping[Edge, Sequence[int]]) -> None:
        """Give the faces the vertices that have been put between the ends of edges."""
        self.right, self.left = (divided(face, inserted) for face in self.faces)


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

    vertices: list[Point] = field(default_factory=list)
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

    def add_cell(self, vertices: Sequence[int], material: int = 0, centre: Point | None = None) -> int:
        """Append a cell (counter-clockwise vertices) and return its number."""
        self.cells.append(Cell(list(vertices), centre, material))
        return len(self.cells) - 1

    def curve(self, first: int, second: int) -> Curve | None:
        """Shape of an edge from its first vertex to its second; None: straight."""
        curve = self.curves.get(edge_key((first, second)))
        return curve if curve is None or first < second else part_of_curve(curve, 1.0, 0.0)

    def set_curve(self, first: int, second: int, curve: Curve) -> None:
        """Give an edge the shape of `curve`, which runs from the first vertex to the second."""
        self.curves[edge_key((first, second))] = curve if first < second else part_of_curve(curve, 1.0, 0.0)

    def set_pieces(self, chain: Sequence[int], curve: Curve, bounds: Sequence[float]) -> None:
        """Give the edges of a chain the pieces of a curve between some of its parameters."""
        for (first, second), low, high in zip(pairwise(chain), bounds, bounds[1:]):
            self.set_curve(first, second, part_of_curve(curve, low, high))

    def along(self, edge: Edge, at: Sequence[float] | np.ndarray) -> np.ndarray:
        """Points of an edge (n, 2) at parameters in [0, 1], from its first vertex to its second."""
        return self.shape(edge)(np.asarray(at, float))

    def shape(self, edge: Edge) -> Curve:
        """Shape of an edge, also of a straight one."""
        first, last = (np.array(self.vertices[vertex]) for vertex in edge)
        return self.curve(*edge) or (lambda at: (1.0 - at[:, None]) * first + at[:, None] * last)

    def edge_length(self, first: int, second: int) -> float:
        """m."""
        curved = edge_key((first, second)) in self.curves
        return line_length(self.along((first, second), _FINE if curved else (0.0, 1.0)))

    def edge_uses(self) -> Counter[Edge]:
        """How many cells use each edge, keyed by its vertices, lower number first."""
        return Counter(edge_key(edge) for cell in self.cells for edge in cell.edges())

    def divide(self, wanted: Mapping[Edge, np.ndarray]) -> dict[Edge, list[int]]:
        """Divide edges in place; only the cells that have them get more vertices.

        Parameters
        ----------
        wanted : mapping of (int, int) to array
            For each edge, in its direction, the places of its new vertices, ascending in (0, 1).

        Returns
        -------
        dict of (int, int) to list of int
            New vertices between the ends of each divided edge, in both directions.
        """
        inserted: dict[Edge, list[int]] = {}
        for (first, last), fractions in wanted.items():
            curve = self.curve(first, last)
            new = [self.add_vertex(*point) for point in self.along((first, last), fractions)]
            if curve is not None:
                self.set_pieces([first, *new, last], curve, [0.0, *fractions.tolist(), 1.0])
                del self.curves[edge_key((first, last))]
            inserted[first, last], inserted[last, first] = new, new[::-1]
        self.divide_cells(inserted)
        self.divide_sets(inserted)
        return inserted

    def divide_cells(self, inserted: Mapping[Edge, Sequence[int]]) -> None:
        """Give cells the vertices that have been put between the ends of their edges."""
        for cell in self.cells:
            if any(edge in inserted for edge in cell.edges()):
                last_one = [] if cell.closed else cell.vertices[-1:]
                cell.vertices = [a for a, _ in divided(cell.edges(), inserted)] + last_one

    def divide_sets(self, inserted: Mapping[Edge, Sequence[int]]) -> None:
        """Give edge sets the vertices that have been put between the ends of edges."""
        self.edge_sets = {name: divided(edges, inserted) for name, edges in self.edge_sets.items()}


def edge_key(edge: Edge) -> Edge:
    """An edge's vertices, lower number first."""
    return edge if edge[0] < edge[1] else (edge[1], edge[0])


def around(loop: Sequence[int]) -> list[Edge]:
    """The edges of a closed loop of vertices."""
    return list(zip(loop, [*loop[1:], *loop[:1]]))


def neighbours(edges: Iterable[Edge]) -> dict[int, list[int]]:
    """The vertices at the other ends of each vertex's edges."""
    near: dict[int, list[int]] = {}
    for a, b in edges:
        near.setdefault(a, []).append(b)
        near.setdefault(b, []).append(a)
    return near


def divided(edges: Sequence[Edge], inserted: Mapping[Edge, Sequence[int]]) -> list[Edge]:
    """Directed edges with the vertices that have been put between their ends."""
    return [part for edge in edges for part in pairwise([edge[0], *inserted.get(edge, ()), edge[1]])]


def part_of_curve(curve: Curve, start: float, stop: float) -> Curve:
    """The piece of a curve from one of its parameters to another, backwards if that is smaller."""
    return lambda at: curve(start + (stop - start) * np.asarray(at))
