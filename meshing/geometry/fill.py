"""A plane graph as a surface that gmsh fills: lines divided, rosettes around tips and junctions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from meshing.cells.complex import around
from meshing.geometry.drawing import Drawing, Edge, Filled
from meshing.geometry.graph import Graph
from meshing.geometry.lengths import ARCS, Lengths, divided, divided_line
from meshing.geometry.planar import find_crossing
from meshing.vectors import on_circle

_SPOKE = math.radians(46.0)  # widest angle between spokes


def draw_filled(
    drawing: Drawing, graph: Graph, size: float, side_names: Sequence[str], tips: Sequence[int] = ()
) -> list[list[int]]:
    """Add a graph's inside to a drawing; holes and named sides become edge sets, cracks groups.

    Parameters
    ----------
    size : float
        Largest edge, m.
    side_names : sequence of str
        An empty name gives no edge set.
    tips : sequence of int
        Corners that are tips of notches: the side from one is divided as that to it.

    Returns
    -------
    list of list of int
        Vertices along each side.

    Raises
    ------
    RuntimeError
        Divided lines cross or touch each other.
    """
    return _Filler(drawing, graph, size, tips).draw(side_names)


class _Filler:
    def __init__(self, drawing: Drawing, graph: Graph, size: float, tips: Sequence[int]) -> None:
        self.drawing, self.graph, self.tips = drawing, graph, tips
        self.wanted = Lengths(graph, size, {graph.sides[k][-1]: graph.sides[k - 1][0] for k in tips})
        self.own = [drawing.add_vertex(*place) for place in graph.vertices]
        self.segments: list[Edge] = []
        self.rays: dict[int, dict[float, int]] = {v: {} for v in self.wanted.rosettes}

    def draw(self, side_names: Sequence[str]) -> list[list[int]]:
        drawing, graph = self.drawing, self.graph
        sides = self.sides()
        for name, side in zip(side_names, sides):
            if name:
                drawing.edge_sets.setdefault(name, []).extend(pairwise(side))
        loops = [[v for side in sides for v in side[:-1]]]
        for (name, (centre, radius)), fixed in zip(graph.holes.items(), graph.circles):
            loops.append(self.circle(np.array(centre), radius, fixed))
            drawing.add_circle(loops[-1], centre)
            drawing.edge_sets[name] = around(loops[-1])
        for name, path in graph.cracks.items():
            drawing.groups[f"crack:{name}"] = list(pairwise(self.crack(path)))
        for v, radius in self.wanted.rosettes.items():
            self.rosette(v, radius)
        rosettes = {self.own[v]: radius for v, radius in self.wanted.rosettes.items()}
        where = np.array(drawing.vertices)
        lines = [edge for loop in loops for edge in around(loop)] + self.segments
        crossing = find_crossing(where[np.array(lines)], np.array(lines))
        if crossing is not None:
            raise RuntimeError(
                f"the outline of what is to be filled by gmsh crosses itself near ({crossing[0]:.6g}, "
                f"{crossing[1]:.6g}) m."
            )
        inside = [self.own[v] for v in graph.points.values()]
        drawing.filled.append(Filled(loops, self.segments, inside, self.wanted.largest, rosettes))
        drawing.points |= {name: self.own[v] for name, v in graph.points.items()}
        return sides

    def sides(self) -> list[list[int]]:
        """Vertices along each side of the outline."""
        chains, at = [], np.zeros(0)
        for number, side in enumerate(self.graph.sides):
            chain = [self.own[side[0]]]
            for a, b in pairwise(side):
                start, stop = self.graph.vertices[[a, b]]
                at = 1.0 - at[::-1] if number in self.tips else divided_line(start, stop, self.wanted)
                chain += [*self.added(start + at[:, None] * (stop - start)), self.own[b]]
            chains.append(chain)
        return chains

    def added(self, places: np.ndarray) -> list[int]:
        """New vertices."""
        return [self.drawing.add_vertex(*place) for place in places]

    def circle(self, centre: np.ndarray, radius: float, fixed: Sequence[int]) -> list[int]:
        """Vertices on a hole, counter-clockwise, with those that are fixed."""
        angles = np.arctan2(*(self.graph.vertices[list(fixed)] - centre).T[::-1])
        first = 0.5 * math.pi / ARCS
        bounds: list[tuple[float, int]] = sorted(zip(angles.tolist(), (self.own[v] for v in fixed)))
        bounds = bounds or [(first, self.added(on_circle(centre, radius, np.full(1, first)))[0])]
        loop = []
        for (angle, vertex), (following, _) in pairwise([*bounds, (bounds[0][0] + 2 * math.pi, -1)]):
            rim = on_circle(centre, radius, np.linspace(angle, following, 65))
            arcs = math.ceil((following - angle) / (2 * math.pi / ARCS) - 1e-6)
            inner = divided(rim, self.wanted, max(1, arcs))
            loop += [vertex, *self.added(on_circle(centre, radius, angle + (following - angle) * inner))]
        return loop

    def crack(self, path: Sequence[int]) -> list[int]:
        """Vertices along a crack; those on the rims of rosettes are remembered."""
        line = [self.own[path[0]]]
        for a, b in pairwise(path):
            start, stop = self.graph.vertices[[a, b]]
            radii = (self.wanted.rosettes.get(a, 0.0), self.wanted.rosettes.get(b, 0.0))
            at = divided_line(start, stop, self.wanted, radii)
            inner = self.added(start + at[:, None] * (stop - start))
            for v, rim in ((a, inner[:1]), (b, inner[-1:])):
                if v in self.rays:
                    x, y = np.subtract(self.drawing.vertices[rim[0]], self.graph.vertices[v])
                    self.rays[v][math.atan2(y, x)] = rim[0]
            line += [*inner, self.own[b]]
        self.segments += pairwise(line)
        return line

    def rosette(self, v: int, radius: float) -> None:
        """Rim and spokes around a vertex; the rays of cracks are there already."""
        rays = self.rays[v]
        angles, rim = sorted(rays), []
        for angle, following in pairwise([*angles, angles[0] + 2 * math.pi]):
            parts = math.ceil((following - angle) / _SPOKE)
            turns = angle + (following - angle) * np.arange(1, parts) / parts
            new = self.added(on_circle(self.graph.vertices[v], radius, turns))
            rim += [rays[angle], *new]
            self.segments += [(self.own[v], spoke) for spoke in new]
        self.segments += around(rim)
