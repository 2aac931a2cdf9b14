"""Rings around a vertex of a mesh: the cells around it are merged and divided anew into scaled copies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from meshing.cells.complex import CellComplex, Curve, part_of_curve

Edge = tuple[int, int]
_STRAIGHT = 1e-9  # sine of an angle that is none


def ring_scales(innermost: float, grading: float) -> np.ndarray:
    """Geometric series from `innermost` < 1 to 1 in the fewest steps whose ratio is at most `grading`."""
    rings = max(1, math.ceil(math.log(1.0 / innermost) / math.log(grading) - 1e-9))
    scales = innermost ** (1.0 - np.arange(rings + 1) / rings)
    scales[-1] = 1.0
    return scales


@dataclass
class Fan:
    """The cells around a vertex as far as they reach.

    Attributes
    ----------
    chain : list of int
        Vertices around it, counter-clockwise; a closed chain repeats its first one.
    members : list of int
        The cell of each edge of the chain.
    between : list of list of int
        Further vertices on each edge: of neighbours, on the straight side of a cell.
    """

    chain: list[int]
    members: list[int]
    between: list[list[int]]

    def rim(self, first: int, last: int) -> list[int]:
        """All vertices from one place of the chain to another."""
        places = range(first, last)
        return [v for place in places for v in (self.chain[place], *self.between[place])] + [self.chain[last]]


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

    def fan(self, vertex: int, first: int, last: int) -> Fan | None:
        """The cells around a vertex from `first` to `last`; None if they do not reach from the one to the
        other.
        """
        following = {}
        for number in self._around.get(vertex, ()):
            loop = self.cells.cells[number].vertices
            i = loop.index(vertex)
            ordered = loop[i + 1 :] + loop[:i]
            following[ordered[0]] = (number, ordered)
        fan = Fan([first], [], [])
        while fan.chain[-1] in following and (len(fan.chain) == 1 or fan.chain[-1] != last):
            number, ordered = following.pop(fan.chain[-1])
            side: list[int] = []
            for v, beyond in zip(ordered[1:], [*ordered[2:], None]):
                if beyond is not None and self._straight(fan.chain[-1], v, beyond):
                    side.append(v)
                    continue
                fan.chain.append(v)
                fan.members.append(number)
                fan.between.append(side)
                side = []
        return fan if fan.chain[-1] == last and not following else None

    def _straight(self, *vertices: int) -> bool:
        """Whether three vertices of a cell lie on one straight side."""
        one, middle, other = (np.array(self.cells.vertices[v]) for v in vertices)
        ahead, behind = other - middle, middle - one
        across = abs(ahead[0] * behind[1] - ahead[1] * behind[0])
        curved = any(self.cells.curve(*pair) for pair in zip(vertices, vertices[1:]))
        return (
            not curved and ahead @ behind > 0 and across <= _STRAIGHT * np.hypot(*ahead) * np.hypot(*behind)
        )

    def refine(
        self,
        vertex: int,
        rays: Sequence[int],
        fan: Fan,
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
        fan : Fan
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
        cells, chain, members = self.cells, fan.chain, fan.members
        materials = {number: cells.cells[number].material for number in members}
        interfaces = {
            place
            for place, (one, other) in enumerate(zip(members, members[1:]), 1)
            if materials[one] != materials[other]
        }
        places = [place for place, v in enumerate(chain) if v in rays or place in interfaces]
        levels = self._levels(vertex, chain, places, innermost, grading)
        self._remove(materials)
        for inner, outer in zip(levels, levels[1:]):
            for i, number in enumerate(members):
                between = fan.between[i] if outer is levels[-1] else []
                self._add([inner[i], outer[i], *between, outer[i + 1], inner[i + 1]], materials[number])
        if tip:
            cell = self._add(levels[0], materials[members[0]], centre=cells.vertices[vertex])
            if interfaces:
                cells.cells[cell].sectors = [materials[number] for number in members]
            return cell
        for first, last in zip(places, places[1:]):
            self._add([vertex, *levels[0][first : last + 1]], materials[members[first]])
        return -1

    def merge(
        self,
        vertex: int,
        fan: Fan,
        cuts: Sequence[int],
        *,
        innermost: float,
        grading: float,
    ) -> None:
        """Replace the cells around a vertex by closed ones that meet in it, with edges graded towards it.

        Parameters
        ----------
        fan : Fan
        cuts : sequence of int
            Places in the fan at which cells part, beside its ends.
        innermost : float
            Length of the innermost edge of the longest ray, m.
        grading : float
            Largest ratio of neighbouring distances from the vertex.
        """
        places = sorted({0, *cuts, len(fan.members)})
        levels = self._levels(vertex, fan.chain, places, innermost, grading)
        material = self.cells.cells[fan.members[0]].material
        self._remove(fan.members)
        for first, last in zip(places, places[1:]):
            out = [level[first] for level in levels[:-1]]
            back = [level[last] for level in levels[-2::-1]]
            self._add([vertex, *out, *fan.rim(first, last), *back], material)

    def _levels(
        self, vertex: int, chain: list[int], places: list[int], innermost: float, grading: float
    ) -> list[list[int]]:
        """Vertices of scaled copies of a fan's chain, from the innermost to the chain itself; the edges from
        the vertex to `places` of the chain are divided by them.
        """
        cells = self.cells
        centre = np.array(cells.vertices[vertex])
        points = np.array([cells.vertices[v] for v in chain])
        reach = float(np.hypot(*(points - centre).T).max())
        loop = chain[0] == chain[-1]
        curves = {place: cells.curve(vertex, chain[place]) for place in places}
        levels: list[list[int]] = []
        at: dict[int, list[float]] = {place: [] for place, curve in curves.items() if curve}
        for scale in ring_scales(innermost / reach, grading)[:-1]:
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
        for place in places:
            between = [level[place] for level in levels[:-1]]
            self.inserted[vertex, chain[place]] = between
            self.inserted[chain[place], vertex] = between[::-1]
        return levels

    def _remove(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            for v in self.cells.cells[number].vertices:
                self._around[v].discard(number)
            self.cells.cells[number].vertices = []

    def _add(self, vertices: list[int], material: int, centre: tuple[float, float] | None = None) -> int:
        number = self.cells.add_cell(vertices, centre=centre, closed=centre is None, material=material)
        self._register(number, vertices)
        return number


def _parameter(curve: Curve, centre: np.ndarray, scale: float) -> float:
    """Where a curve that starts at `centre` has a fraction of its end's distance from it."""
    from scipy.optimize import brentq  # rarely needed, and slow to load

    wanted = scale * math.dist(curve(np.ones(1))[0], centre)
    return float(brentq(lambda at: math.dist(curve(np.array([at]))[0], centre) - wanted, 0.0, 1.0))
