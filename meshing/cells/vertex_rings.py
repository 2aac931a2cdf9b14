"""Rings around a vertex of a mesh: the cells around it are merged and divided anew into scaled copies."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from meshing.cells.complex import CellComplex, Curve, Edge
from meshing.vectors import turn

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
    vertex : int
    chain : list of int
        Vertices around it, counter-clockwise; a closed chain repeats its first one.
    members : list of int
        The cell of each edge of the chain.
    between : list of list of int
        Further vertices on each edge: of neighbours, on the straight side of a cell.
    away : (n, 2) array
        From the vertex to those of the chain, m.
    """

    vertex: int
    chain: list[int]
    members: list[int] = field(default_factory=list)
    between: list[list[int]] = field(default_factory=list)
    away: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    @property
    def reach(self) -> float:
        """Largest distance of the chain from the vertex, m."""
        return float(np.hypot(*self.away.T).max())

    def rim(self, first: int, last: int) -> list[int]:
        """All vertices from one place of the chain to another."""
        places = range(first, last)
        return [v for place in places for v in (self.chain[place], *self.between[place])] + [self.chain[last]]


class Rings:
    """Makes rings in a complex, whose cells it removes and adds.

    Parameters
    ----------
    cells : CellComplex
    grading : float
        Largest ratio of the distances of neighbouring levels from the vertex.

    Attributes
    ----------
    inserted : dict of (int, int) to list of int
        For each edge on a crack or an interface that has been divided, in both directions: the vertices
        between its ends.
    """

    def __init__(self, cells: CellComplex, grading: float) -> None:
        self.cells, self.grading = cells, grading
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
            following[loop[(i + 1) % len(loop)]] = (number, loop[i + 1 :] + loop[:i])
        fan = Fan(vertex, [first])
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
        where = self.cells.vertices
        fan.away = np.array([where[v] for v in fan.chain]) - where[vertex]
        return fan if fan.chain[-1] == last and not following else None

    def _straight(self, *vertices: int) -> bool:
        """Whether three vertices of a cell lie on one straight side."""
        steps = np.diff([self.cells.vertices[v] for v in vertices], axis=0)
        curved = any(self.cells.curve(*pair) for pair in pairwise(vertices))
        return not curved and abs(turn(*steps)) <= _STRAIGHT

    def refine(self, fan: Fan, rays: Sequence[int], innermost: float, tip: bool) -> int:
        """Replace the cells around a vertex by rings.

        Parameters
        ----------
        fan : Fan
        rays : sequence of int
            Vertices of the fan to which lines of a crack go from the vertex; the first one is where it
            starts.
        innermost : float
            Largest distance of the innermost level from the vertex, m.
        tip : bool
            Inside the innermost level: one open cell with its scaling centre at the vertex, of several
            materials where these meet there; else a closed cell for each sector between rays and interfaces,
            with the vertex.

        Returns
        -------
        int
            The tip's cell, -1 if there is none.
        """
        cells, members = self.cells, fan.members
        materials = [cells.cells[number].material for number in members]
        interfaces = {i for i, (one, other) in enumerate(pairwise(materials), 1) if one != other}
        places = [place for place, v in enumerate(fan.chain) if v in rays or place in interfaces]
        levels = self._levels(fan, places, innermost)
        self._remove(dict.fromkeys(members))
        for inner, outer in pairwise(levels):
            for i, material in enumerate(materials):
                between = fan.between[i] if outer is levels[-1] else []
                self._add([inner[i], outer[i], *between, outer[i + 1], inner[i + 1]], material)
        if tip:
            cell = self._add(levels[0], materials[0], centre=cells.vertices[fan.vertex])
            if interfaces:
                cells.cells[cell].sectors = materials
            return cell
        for first, last in pairwise(places):
            self._add([fan.vertex, *levels[0][first : last + 1]], materials[first])
        return -1

    def merge(self, fan: Fan, cuts: Sequence[int], innermost: float) -> None:
        """Replace the cells around a vertex by closed ones that meet in it, with edges graded towards it.

        Parameters
        ----------
        fan : Fan
        cuts : sequence of int
            Places in the fan at which cells part, beside its ends.
        innermost : float
            Length of the innermost edge of the longest ray, m.
        """
        places = sorted({0, *cuts, len(fan.members)})
        levels = self._levels(fan, places, innermost)
        material = self.cells.cells[fan.members[0]].material
        self._remove(fan.members)
        for first, last in pairwise(places):
            out = [level[first] for level in levels[:-1]]
            back = [level[last] for level in levels[-2::-1]]
            self._add([fan.vertex, *out, *fan.rim(first, last), *back], material)

    def _levels(self, fan: Fan, places: list[int], innermost: float) -> list[list[int]]:
        """Vertices of scaled copies of a fan's chain, from the innermost to the chain itself; the edges from
        the vertex to `places` of the chain are divided by them.
        """
        cells, vertex, chain = self.cells, fan.vertex, fan.chain
        centre, loop = np.array(cells.vertices[vertex]), int(chain[0] == chain[-1])
        scales = ring_scales(innermost / fan.reach, self.grading)[:-1]
        where = centre + scales[:, None, None] * (fan.away)
        curves = {place: curve for place in places if (curve := cells.curve(vertex, chain[place]))}
        at = {k: [_parameter(curve, centre, scale) for scale in scales] for k, curve in curves.items()}
        for place, curve in curves.items():
            where[:, place] = curve(np.array(at[place]))
        levels = [[cells.add_vertex(*point) for point in level[: len(chain) - loop]] for level in where]
        levels = [level + level[:loop] for level in levels] + [list(chain)]
        for place in places:
            ray = [level[place] for level in levels]
            if place in curves and not (loop and place == len(chain) - 1):
                cells.set_pieces(ray, curves[place], [*at[place], 1.0])
            self.inserted[vertex, chain[place]], self.inserted[chain[place], vertex] = ray[:-1], ray[-2::-1]
        return levels

    def _remove(self, numbers: Iterable[int]) -> None:
        for number in numbers:
            for v in self.cells.cells[number].vertices:
                self._around[v].discard(number)
            self.cells.cells[number].vertices = []

    def _add(self, vertices: list[int], material: int, centre: tuple[float, float] | None = None) -> int:
        number = self.cells.add_cell(vertices, material, centre)
        self._register(number, vertices)
        return number


def _parameter(curve: Curve, centre: np.ndarray, scale: float) -> float:
    """Where a curve that starts at `centre` has a fraction of its end's distance from it."""
    from scipy.optimize import brentq  # rarely needed, and slow to load

    wanted = scale * math.dist(curve(np.ones(1))[0], centre)
    return float(brentq(lambda at: math.dist(curve(np.array([at]))[0], centre) - wanted, 0.0, 1.0))
