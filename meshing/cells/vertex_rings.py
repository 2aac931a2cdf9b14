"""Rings around a vertex of a mesh: the cells around it are merged and divided anew into scaled copies."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import brentq

from meshing.cells.complex import CellComplex, Curve, part_of_curve
from meshing.cells.stars import ring_scales

Edge = tuple[int, int]


class Rings:
    """Makes rings in a complex, whose cells it removes and adds.

    Attributes
    ----------
    inserted : dict of (int, int) to list of int
        For each edge on a crack or an interface that has been divided, in both directions: the vertices
        between its ends.
    """

    def __init__(self, cells: CellComplex) -> None:
        self.cells = cells
        self.inserted: dict[Edge, list[int]] = {}
        self._around: dict[int, set[int]] = {}
        for number, cell in enumerate(cells.cells):
            self._register(number, cell.vertices)

    def _register(self, number: int, vertices: Sequence[int]) -> None:
        for vertex in vertices:
            self._around.setdefault(vertex, set()).add(number)

    def fan(self, vertex: int, first: int, last: int) -> tuple[list[int], list[int]] | None:
        """Vertices around a vertex, counter-clockwise from `first` to `last`, and for each edge between them
        its cell; None if the cells do not reach from the one to the other.
        """
        following = {}
        for number in self._around.get(vertex, ()):
            loop = self.cells.cells[number].vertices
            i = loop.index(vertex)
            ordered = loop[i + 1 :] + loop[:i]
            following[ordered[0]] = (number, ordered)
        chain, members = [first], []
        while chain[-1] in following and (len(chain) == 1 or chain[-1] != last):
            number, ordered = following.pop(chain[-1])
            members += [number] * (len(ordered) - 1)
            chain += ordered[1:]
        return (chain, members) if chain[-1] == last and not following else None

    def refine(
        self,
        vertex: int,
        rays: Sequence[int],
        fan: tuple[list[int], list[int]],
        *,
        innermost: float,
        grading: float,
        tip: bool,
    ) -> int:
        """Replace the cells around a vertex by rings.

        Parameters
        ----------
        rays : sequence of int
            Vertices of the fan to which lines of a crack go from the vertex; the first one is where it
            starts.
        fan
            From `fan`.
        innermost : float
            Largest distance of the innermost level from the vertex, m.
        grading : float
            Largest ratio of levels.
        tip : bool
            Inside the innermost level: one open cell with its scaling centre at the vertex, of several
            materials where these meet there; else a closed cell for each sector between rays and interfaces,
            with the vertex.

        Returns
        -------
        int
            The tip's cell, -1 if there is none.
        """
        cells, (chain, members) = self.cells, fan
        centre = np.array(cells.vertices[vertex])
        points = np.array([cells.vertices[v] for v in chain])
        reach = float(np.hypot(*(points - centre).T).max())
        scales = ring_scales(min(innermost / reach, 1.0 / grading), grading)
        loop = chain[0] == chain[-1]
        materials = {number: cells.cells[number].material for number in members}
        interfaces = {
            place
            for place, (one, other) in enumerate(zip(members, members[1:]), 1)
            if materials[one] != materials[other]
        }
        places = [place for place, v in enumerate(chain) if v in rays or place in interfaces]
        curves = {place: cells.curve(vertex, chain[place]) for place in places}
        levels: list[list[int]] = []
        at: dict[int, list[float]] = {place: [] for place, curve in curves.items() if curve}
        for scale in scales[:-1]:
            level: list[int] = []
            for place, point in enumerate(points):
                if loop and place == len(chain) - 1:
                    level.append(level[0])
                    continue
                curve, position = curves.get(place), centre + scale * (point - centre)
                if curve is not None:
                    at[place].append(_parameter(curve, centre, scale))
                    position = curve(np.array(at[place][-1:]))[0]
                level.append(cells.add_vertex(*position))
            levels.append(level)
        levels.append(list(chain))
        for place, curve in curves.items():
            if curve is None or (loop and place == len(chain) - 1):
                continue
            bounds = [*at[place], 1.0]
            for inner, outer, low, high in zip(levels, levels[1:], bounds, bounds[1:]):
                cells.set_curve(inner[place], outer[place], part_of_curve(curve, low, high))
        for number in materials:
            for v in cells.cells[number].vertices:
                self._around[v].discard(number)
            cells.cells[number].vertices = []
        for inner, outer in zip(levels, levels[1:]):
            for i, number in enumerate(members):
                self._add([inner[i], outer[i], outer[i + 1], inner[i + 1]], materials[number])
        for place in places:
            between = [level[place] for level in levels[:-1]]
            self.inserted[vertex, chain[place]] = between
            self.inserted[chain[place], vertex] = between[::-1]
        if tip:
            cell = self._add(levels[0], materials[members[0]], centre=cells.vertices[vertex])
            if interfaces:
                cells.cells[cell].sectors = [materials[number] for number in members]
            return cell
        for first, last in zip(places, places[1:]):
            self._add([vertex, *levels[0][first : last + 1]], materials[members[first]])
        return -1

    def _add(self, vertices: list[int], material: int, centre: tuple[float, float] | None = None) -> int:
        number = self.cells.add_cell(vertices, centre=centre, closed=centre is None, material=material)
        self._register(number, vertices)
        return number


def _parameter(curve: Curve, centre: np.ndarray, scale: float) -> float:
    """Where a curve that starts at `centre` has a fraction of its end's distance from it."""
    wanted = scale * math.dist(curve(np.ones(1))[0], centre)
    return float(brentq(lambda at: math.dist(curve(np.array([at]))[0], centre) - wanted, 0.0, 1.0))
