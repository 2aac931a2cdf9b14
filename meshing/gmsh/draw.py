"""A drawing put into gmsh."""

from __future__ import annotations

import math
from typing import Any

from meshing.cells.complex import Edge, around, edge_key
from meshing.geometry.drawing import RIM, Drawing, Filled
from meshing.gmsh.describe import MATERIAL, WHOLE

# Growth of cells with the distance from a rosette: K and T of cracks 400 to 1600 times smaller than a plate
# are within 2e-5 with 0.7 and less, as with 0.45; 3e-4 with 0.8, 2e-2 with 1.
_GROWTH = 0.6


def draw_geometry(drawing: Drawing, gmsh: Any) -> None:
    """Draw a body in gmsh's present model, in m: a curve is one edge of the boundary discretisation."""
    _Pen(drawing, gmsh).draw()


def _written(value: float) -> float:
    """A length as it stands in a file of gmsh, which is then discretised bit for bit like the drawing."""
    return float(f"{value:.16g}")


class _Pen:
    def __init__(self, drawing: Drawing, gmsh: Any) -> None:
        self.drawing, self.model = drawing, gmsh.model
        self.geo = gmsh.model.geo
        self.where = [(_written(x), _written(y)) for x, y in drawing.vertices]
        self.sizes = self._sizes()
        self.points: dict[int, int] = {}
        self.curves: dict[Edge, int] = {}
        self.centres: dict[tuple[float, float], int] = {}

    def draw(self) -> None:
        drawing = self.drawing
        named = drawing.groups | drawing.edge_sets  # cracks first: their curves run as they do
        curves = {name: [abs(self.curve(*edge)) for edge in edges] for name, edges in named.items()}
        points = {name: [self.point(v)] for name, v in drawing.points.items()}
        whole = [self.surface([cell.vertices]) for cell in drawing.cells]
        filled = [self.surface(surface.loops) for surface in drawing.filled]
        inside = [self.inside(surface) for surface in drawing.filled]
        # Twice, as when a file is read: only then the plane that gmsh lays through a surface, in whose
        # coordinates it fills it, is the same however often this is done again.
        self.geo.synchronize()
        self.geo.synchronize()
        for tag, embedded in zip(filled, inside):
            for dimension, tags in enumerate(embedded):
                self.model.mesh.embed(dimension, tags, 2, tag)
            self.model.mesh.setRecombine(2, tag)
        self.limit_growth()
        for dimension, groups in enumerate((points, curves, {WHOLE + MATERIAL: whole, MATERIAL: filled})):
            for name, tags in groups.items():
                if tags:
                    self.model.addPhysicalGroup(dimension, tags, name=name)

    def inside(self, surface: Filled) -> tuple[list[int], list[int]]:
        """Points and curves inside a filled surface."""
        lines = [abs(self.curve(*edge)) for edge in surface.segments]
        known = {v for edge in [*surface.edges(), *surface.segments] for v in edge}
        return [self.point(v) for v in surface.points if v not in known], lines

    def _sizes(self) -> dict[int, float]:
        """Sizes of points: of tips, and inside filled surfaces the mean length of the edges there."""
        lengths: dict[int, list[float]] = {}
        for surface in self.drawing.filled:
            for v in surface.points:
                lengths.setdefault(v, []).append(surface.size)
            for a, b in [*surface.edges(), *surface.segments]:
                span = math.dist(self.where[a], self.where[b])
                lengths.setdefault(a, []).append(span)
                lengths.setdefault(b, []).append(span)
        sizes = {v: sum(own) / len(own) for v, own in lengths.items()}
        return {v: _written(size) for v, size in (sizes | self.drawing.tip_sizes).items()}

    def point(self, vertex: int) -> int:
        if vertex not in self.points:
            x, y = self.where[vertex]
            self.points[vertex] = self.geo.addPoint(x, y, 0.0, self.sizes.get(vertex, 0.0))
        return self.points[vertex]

    def curve(self, first: int, last: int) -> int:
        """The curve of an edge, negative if it runs the other way."""
        if (first, last) not in self.curves:
            ends = self.point(first), self.point(last)
            centre = self.drawing.arcs.get(edge_key((first, last)))
            if centre is None:
                tag = self.geo.addLine(*ends)
            else:
                if centre not in self.centres:
                    self.centres[centre] = self.geo.addPoint(*map(_written, centre), 0.0)
                tag = self.geo.addCircleArc(ends[0], self.centres[centre], ends[1])
            self.geo.mesh.setTransfiniteCurve(tag, 2)
            self.curves[first, last], self.curves[last, first] = tag, -tag
        return self.curves[first, last]

    def surface(self, loops: list[list[int]]) -> int:
        curves = ([self.curve(*edge) for edge in around(loop)] for loop in loops)
        return self.geo.addPlaneSurface([self.geo.addCurveLoop(own) for own in curves])

    def limit_growth(self) -> None:
        """Bound the growth of cells around rosettes: gmsh spreads the lengths of the loops' edges alone, and
        cells 30 times as long as the edges of a small crack may stand beside it.
        """
        field, bounds = self.model.mesh.field, []
        for surface in self.drawing.filled:
            largest = surface.size
            for vertex, radius in surface.rosettes.items():
                edge = RIM * radius
                distance, bound = field.add("Distance"), field.add("Threshold")
                field.setNumbers(distance, "PointsList", [self.points[vertex]])
                field.setNumber(bound, "InField", distance)
                numbers = {"SizeMin": edge, "DistMin": radius, "SizeMax": largest}
                numbers["DistMax"] = radius + max(largest - edge, 0.0) / _GROWTH
                for name, value in numbers.items():
                    field.setNumber(bound, name, _written(value))
                bounds.append(bound)
        if bounds:
            least = field.add("Min")
            field.setNumbers(least, "FieldsList", bounds)
            field.setAsBackgroundMesh(least)
