"""What gmsh holds to cells, edge sets, points and lines of cracks."""

from __future__ import annotations

import math
from collections import Counter
from typing import NoReturn

import numpy as np

from meshing.cells.complex import CellComplex, Edge, around, edge_key
from meshing.gll import gll_nodes, lagrange_values
from meshing.gmsh.describe import WHOLE
from meshing.gmsh.model import Block, FileModel
from meshing.gmsh.report import right_spelling
from meshing.vectors import cross, polygon_area, unit
from meshing.warnings import warn

_STRAIGHT = 1e-9  # deviation from the chord, relative to it
_FLATTEST = 0.05  # smallest sine of a corner of a quadrilateral that gmsh made here
_DEGENERATE = 1e-12  # smallest area of a cell relative to the square of its extent


def cells_of(model: FileModel, origin: str) -> CellComplex:
    """Cells, edge sets, points and lines of cracks of what a file holds; `origin` names it in messages.

    Raises
    ------
    ValueError
        One sentence: surfaces in no group or two, cells that are not plane or inverted, names like those of
        cracks, curves that do not lie on edges of cells.
    """
    return _Builder(model, origin).cells


class _Builder:
    def __init__(self, model: FileModel, origin: str) -> None:
        self.cells = CellComplex()
        self.vertex_of: dict[int, int] = {}
        self._whole: set[int] = set()
        self._model, self._origin = model, origin
        surfaces = model.entities(2)
        self._check_surfaces(surfaces)
        self.cells.materials = list(dict.fromkeys(name.removeprefix(WHOLE) for name in surfaces))
        for name, entities in surfaces.items():
            material = self.cells.materials.index(name.removeprefix(WHOLE))
            count = len(self.cells.cells)
            for entity in entities:
                self._add_surface(entity, material)
            if len(self.cells.cells) == count:
                self._fail(
                    f"physical surface {name!r} has no triangles or quadrilaterals; mesh it, or check that "
                    "the file is complete"
                )
        for (first, last), points in zip(model.curved_ends.tolist(), model.curved_points):
            self._put_on_curve(first, last, points)
        self._add_curves(model.entities(1))
        self._add_points(model.entities(0))
        self.cells.tip_sizes = self._tip_sizes()

    def _fail(self, sentence: str) -> NoReturn:
        raise ValueError(f"{self._origin}: {sentence}.")

    def _check_surfaces(self, surfaces: dict[str, list[int]]) -> None:
        """Every surface in exactly one group."""
        if not surfaces:
            self._fail(
                "it has no surfaces; export the plane area as a face, and check that the file is complete"
                if self._model.unnamed
                else "it has no physical surfaces; put every surface in a physical group, its name is the "
                "material's"
            )
        owner: dict[int, str] = {}
        for name, entities in surfaces.items():
            if name == WHOLE:
                self._fail(f"physical surface {name!r} has no name of a material behind the colon; add one")
            if name.startswith("crack:"):
                self._fail(f"physical surface {name!r} is named like a crack; a crack is a physical curve")
            for entity in entities:
                if owner.setdefault(entity, name) != name:
                    self._fail(
                        f"surface {entity} belongs to the physical surfaces {owner[entity]!r} and {name!r}; "
                        "it can be of one material only"
                    )
        nameless = [b.entity for b in self._model.blocks if b.dimension == 2 and b.entity not in owner]
        if nameless:
            self._fail(
                f"surface {nameless[0]} belongs to no physical group and would be left out; add it to one, "
                "or delete it"
            )

    def _add_surface(self, entity: int, material: int) -> None:
        """Cells of one surface; curved edges by interpolation through the elements' own nodes."""
        if entity in self._model.whole:
            self._add_whole(entity, material)
            return
        blocks = self._model.blocks_of(2, entity)
        for block in blocks:
            if block.corners not in (3, 4):
                self._fail(
                    f"surface {entity} contains elements of type {block.name!r}; only triangles and "
                    "quadrilaterals become S-elements"
                )
        new = [
            ([self._vertex(tag) for tag in element[: block.corners]], element, block)
            for block in blocks
            for element in block.nodes.tolist()
        ]
        corners = [np.array([self.cells.vertices[v] for v in loop]) for loop, *_ in new]
        areas = [polygon_area(points) for points in corners]
        # A surface may be oriented downwards as a whole; single cells against the others are inverted.
        downwards = sum(areas) < 0
        for (loop, element, block), points, area in zip(new, corners, areas):
            size = np.ptp(points, axis=0).max()
            if (-area if downwards else area) <= _DEGENERATE * size**2:
                x, y = points.mean(axis=0)
                self._fail(
                    f"the cell near ({x:.6g}, {y:.6g}) m in surface {entity} is inverted or degenerate; mend "
                    "the mesh there"
                )
            if downwards:
                loop, points = loop[::-1], points[::-1]
            made_here = self._model.geometry and block.order == 1
            for piece in _sound_pieces(loop, points) if made_here else [loop]:
                self.cells.add_cell(piece, material=material)
            if block.order > 1:
                self._add_sides(loop[::-1] if downwards else loop, element, block)

    def _add_whole(self, entity: int, material: int) -> None:
        """A surface that is one S-element: its outline is the cell."""
        edges = self._outline(entity)
        following = dict(edges)
        loop = [edges[0][0]] if edges else []
        while loop and following[loop[-1]] != loop[0] and len(loop) <= len(edges):
            loop.append(following[loop[-1]])
        if len(loop) < 3 or len(loop) != len(edges):
            self._fail(
                f"surface {entity} is to be one S-element ({WHOLE}...), whose outline is one closed line of "
                "at least three edges without holes and lines inside; divide it, or let gmsh mesh it"
            )
        cell = [self._vertex(tag) for tag in loop]
        downwards = polygon_area(np.array([self.cells.vertices[v] for v in cell])) < 0
        self._whole.add(self.cells.add_cell(cell[::-1] if downwards else cell, material=material))

    def _outline(self, entity: int) -> list[Edge]:
        """Directed edges around a surface: lines on its curves or, in a file without these, sides of its
        cells.
        """
        curves = self._model.whole[entity]
        if curves is None:
            blocks = self._model.blocks_of(2, entity)
            loops = [cell[: block.corners] for block in blocks for cell in block.nodes.tolist()]
            edges = [edge for loop in loops for edge in around(loop)]
        else:
            edges = [
                (a, b) if curve > 0 else (b, a)
                for curve in curves
                for block in self._model.blocks_of(1, abs(curve))
                for a, b in block.nodes[:, :2].tolist()
            ]
        known = set(edges)
        return [(a, b) for a, b in edges if (b, a) not in known]

    def _tip_sizes(self) -> dict[int, float]:
        """Sizes given at vertices all of whose cells are S-elements as drawn: there they can only mean the
        element on a crack's tip.
        """
        cells = [cell for number, cell in enumerate(self.cells.cells) if number not in self._whole]
        others = {vertex for cell in cells for vertex in cell.vertices}
        sizes = {self.vertex_of[tag]: h for tag, h in self._model.sizes.items() if tag in self.vertex_of}
        return {vertex: size for vertex, size in sizes.items() if vertex not in others}

    def _add_sides(self, loop: list[int], element: list[int], block: Block) -> None:
        """Curved sides of an element of higher order."""
        corners, inner = block.corners, block.order - 1
        for i in range(corners):
            between = element[corners + i * inner : corners + (i + 1) * inner]
            tags = [element[i], *between, element[(i + 1) % corners]]
            points = np.array([self._model.where[tag][:2] for tag in tags])
            self._add_curve(loop[i], loop[(i + 1) % corners], np.linspace(0, 1, block.order + 1), points)

    def _vertex(self, tag: int) -> int:
        if tag not in self.vertex_of:
            x, y, z = self._model.where[tag]
            if not (math.isfinite(x) and math.isfinite(y)) or z != 0.0:
                self._fail(
                    f"node {tag} at ({x:g}, {y:g}, {z:g}) m is not in the plane z = 0; the model must be "
                    "plane"
                )
            self.vertex_of[tag] = self.cells.add_vertex(x, y)
        return self.vertex_of[tag]

    def _add_curve(self, first: int, last: int, parameters: np.ndarray, points: np.ndarray) -> None:
        """Give an edge the shape of the polynomial through points (n, 2) at parameters (n,) in [0, 1], unless
        it is straight.
        """
        chord = points[-1] - points[0]
        straight = points[0] + parameters[:, None] * chord
        if np.abs(points - straight).max() <= _STRAIGHT * np.hypot(*chord):
            return
        self.cells.set_curve(first, last, lambda at: lagrange_values(parameters, at) @ points)

    def _put_on_curve(self, first: int, last: int, points: np.ndarray) -> None:
        """GLL nodes of an edge on curved geometry."""
        if first not in self.vertex_of or last not in self.vertex_of:
            return
        ends = self.vertex_of[first], self.vertex_of[last]
        points = points.copy()
        # The ends are vertices that other edges share: they stay as they are.
        points[0], points[-1] = (self.cells.vertices[end] for end in ends)
        self.cells.curves.pop(edge_key(ends), None)
        self._add_curve(*ends, 0.5 * (gll_nodes(len(points) - 1) + 1.0), points)

    def _add_curves(self, groups: dict[str, list[int]]) -> None:
        uses = self.cells.edge_uses()
        for name, entities in sorted(groups.items(), key=lambda group: not group[0].startswith("crack:")):
            directed = [edge for entity in entities for edge in self._line_edges(name, entity, uses)]
            by_key = {edge_key(edge): edge for edge in directed}  # once, if lines are drawn twice
            edges = list(by_key)
            if not self._model.unnamed:
                self._check_name(name, edges, uses)
            if name.startswith("crack:"):
                self.cells.groups[name] = list(by_key.values())
            elif edges:
                self.cells.edge_sets[name] = edges
            elif not self._model.unnamed:
                self._fail(f"physical curve {name!r} has no lines; mesh it, or remove it")

    def _check_name(self, name: str, edges: list[Edge], uses: dict[Edge, int]) -> None:
        """A curve inside the body that is no crack, and names that are nearly those of cracks."""
        inside = [edge for edge in edges if uses[edge] == 2]
        spelled = right_spelling(name)
        if spelled and (inside or ":" in name):  # a misspelt crack would be none, without a word
            self._fail(f"physical curve {name!r} is not how a crack is named; write {spelled!r}")
        elif spelled:
            where = "lies on the outline and is an edge set without contact; name the two faces of a notch"
            mend = f"{spelled}:right and {spelled}:left if they shall close"
            warn(self._origin, f"physical curve {name!r} {where} {mend}.")
        elif name.startswith("crack:"):
            pass
        elif crack := self._crack_along(inside):
            where = (
                f"lies on {crack!r} and is an edge set of both its faces, each of which loads and supports"
            )
            mend = "act on; the crack's own sets, NAME_right and NAME_left, are of one face"
            warn(self._origin, f"physical curve {name!r} {where} {mend}.")
        elif inside and self._same_material(inside):
            where = "lies inside a material and is an edge set, not a crack"
            warn(self._origin, f"physical curve {name!r} {where}; name it 'crack:{name}' if it is one.")

    def _crack_along(self, edges: list[Edge]) -> str | None:
        """A crack that has one of these edges."""
        keys, cracks = {edge_key(edge) for edge in edges}, self.cells.groups.items()
        return next((name for name, lines in cracks if not keys.isdisjoint(map(edge_key, lines))), None)

    def _same_material(self, edges: list[Edge]) -> bool:
        """Whether an edge of these has one material on both sides."""
        found = {(edge_key(edge), cell.material) for cell in self.cells.cells for edge in cell.edges()}
        materials = Counter(edge for edge, _ in found)
        return any(materials[edge] == 1 for edge in edges)

    def _line_edges(self, name: str, entity: int, uses: dict[Edge, int]) -> list[Edge]:
        """Edges of cells along a physical curve, in its direction."""
        edges = []
        for block in self._model.blocks_of(1, entity):
            for element in block.nodes.tolist():
                first, last = (self.vertex_of.get(tag, -1) for tag in element[:2])
                if edge_key((first, last)) not in uses:
                    what = "crack line" if name.startswith("crack:") else "physical curve"
                    self._fail(
                        f"{what} {name!r} does not lie on cell edges (curve {entity}); embed the curve in "
                        "the surface or make it part of its outline"
                    )
                edges.append((first, last))
        return edges

    def _add_points(self, groups: dict[str, list[int]]) -> None:
        for name, entities in groups.items():
            nodes = [node for entity in entities for node in self._model.points.get(entity, [])]
            if len(nodes) == 1 and nodes[0] in self.vertex_of:
                self.cells.points[name] = self.vertex_of[nodes[0]]
            elif not self._model.unnamed:
                self._fail(
                    f"physical point {name!r} is not one vertex of a cell; give one point on the mesh per "
                    "name"
                )


def _sound_pieces(cell: list[int], points: np.ndarray) -> list[list[int]]:
    """The cell; a quadrilateral that is not safely convex in two triangles."""
    ahead, behind = (unit(np.roll(points, way, axis=0) - points) for way in (-1, 1))
    sine = cross(ahead, behind)
    if len(cell) == 3 or sine.min() > _FLATTEST:
        return [cell]
    a, b, c, d = np.roll(cell, -int(sine.argmin())).tolist()
    return [[a, b, c], [a, c, d]]
