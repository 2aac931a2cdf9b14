"""A body's section as a drawing for gmsh: vertices, straight edges and arcs, surfaces, named groups."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
import shapely

from meshing.cells.complex import CellComplex, Edge, around, divided, edge_key

RIM = 0.77  # edges of a rosette's rim, relative to its radius


@dataclass
class Filled:
    """A surface that gmsh divides into cells.

    Attributes
    ----------
    loops : list of list of int
        Vertices of the outer loop, then of those of holes.
    segments : list of (int, int)
        Lines inside that become edges of cells.
    points : list of int
        Vertices inside that become vertices of cells.
    size : float
        Largest edge, m.
    rosettes : dict of int to float
        Radius of the rim of edges in all directions around a vertex, a tip, a sharp kink or a junction, m.
    """

    loops: list[list[int]]
    segments: list[Edge]
    points: list[int]
    size: float
    rosettes: dict[int, float] = field(default_factory=dict)

    def edges(self) -> list[Edge]:
        """Directed edges of the loops."""
        return [edge for loop in self.loops for edge in around(loop)]


@dataclass
class Drawing(CellComplex):
    """What gmsh is told of a body: every edge is one curve of its boundary discretisation.

    `cells` are the surfaces that are one S-element each.

    Attributes
    ----------
    filled : list of Filled
        Surfaces that gmsh divides.
    arcs : dict of (int, int) to (x, y)
        Centre of edges that are arcs, lower vertex first, m.
    near : float
        Vertices that are not farther apart are one, m; 0: each is one of its own.
    """

    filled: list[Filled] = field(default_factory=list)
    arcs: dict[Edge, tuple[float, float]] = field(default_factory=dict)
    near: float = 0.0
    _at: dict[Edge, int] = field(default_factory=dict)

    @property
    def largest(self) -> float | None:
        """Largest edge in filled surfaces, m; None without any."""
        return max((surface.size for surface in self.filled), default=None)

    def add_vertex(self, x: float, y: float) -> int:
        """The vertex at a place, a new one if there is none."""
        if not self.near:
            return super().add_vertex(x, y)
        column, row = round(x / self.near), round(y / self.near)
        for beside in product((column, column - 1, column + 1), (row, row - 1, row + 1)):
            vertex = self._at.get(beside)
            if vertex is not None and math.dist((x, y), self.vertices[vertex]) <= self.near:
                return vertex
        return self._at.setdefault((column, row), super().add_vertex(x, y))

    def add_circle(self, loop: Sequence[int], centre: tuple[float, float]) -> None:
        """Make the edges of a loop of vertices arcs of a circle."""
        for edge in around(loop):
            self.arcs[edge_key(edge)] = centre

    def edge_uses(self) -> Counter[Edge]:
        """How many surfaces use each edge, lower vertex first."""
        filled = Counter(edge_key(edge) for surface in self.filled for edge in surface.edges())
        return super().edge_uses() + filled

    def name_openings(self, openings: Mapping[str, float]) -> None:
        """Sort the cracks, and put their openings, degrees, into the names of their groups."""
        self.groups = {
            f"{group}:opening={angle!r}" if angle else group: edges
            for name, angle in openings.items()
            for group, edges in self.groups.items()
            if group.split(":")[1] == name
        }

    def conform(self) -> None:
        """Put vertices that lie on edges of other surfaces into these."""
        self.cells = [cell for cell in self.cells if cell.vertices]
        uses = self.edge_uses()
        loose = set(self.points.values()) - {v for edge in uses for v in edge}
        alone = [edge for edge, count in uses.items() if count == 1 or loose]
        ends = np.array(sorted({v for edge in alone for v in edge} | loose))
        where = np.array(self.vertices)
        tree = shapely.STRtree(shapely.linestrings(where[np.array(alone)]))
        between: dict[Edge, list[int]] = {}
        for end, line in tree.query(shapely.points(where[ends]), predicate="dwithin", distance=self.near).T:
            edge = alone[line]
            if ends[end] not in edge and edge not in self.arcs:
                between.setdefault(edge, []).append(int(ends[end]))
        for (a, b), found in list(between.items()):
            found.sort(key=lambda v: math.dist(where[v], where[a]))
            between[b, a] = found[::-1]
        self.divide_cells(between)
        for surface in self.filled:
            surface.loops = [[a for a, _ in divided(around(loop), between)] for loop in surface.loops]
