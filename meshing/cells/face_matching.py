"""Faces of two bodies that were drawn and meshed each for itself, made to match.

Each place of the one face is paired with the place of the other one beside it, across the line along both.
Vertices that are nearly beside each other are moved along their faces until they are, edges of cells are
divided where the other face has a vertex, and all are run through at the same pace: their nodes face each
other.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree

from meshing.cells.complex import CellComplex, Curve, divided, edge_key
from meshing.vectors import turn

# Vertices of the two faces that are closer than this, in units of the shortest edge there, are put beside
# each other; others get a partner of their own. Short edges between long ones make the pressure uneven.
_NEAR = 0.25
_STEEPEST = 0.2  # least share of its length with which a face goes along the line along both
_SMOOTH = 1e-3  # turn of a face in a vertex that may be moved, radian
_NEAREST = 0.01  # of the faces' length: distances that are alike in the choice of a direction
_FINE = np.linspace(0.0, 1.0, 17)


def match_faces(
    cells: CellComplex, right: list[int], left: list[int], where: str
) -> tuple[list[int], list[int]]:
    """Divide the edges along two faces, in place, so that they match as far as they lie beside each other.

    Parameters
    ----------
    cells : CellComplex
    right, left : list of int
        Vertices along each face, in the same direction; the faces share none.
    where : str
        For messages.

    Returns
    -------
    right, left : list of int
        As many vertices each, beside each other.

    Raises
    ------
    ValueError
        The faces do not run beside each other, or turn back.
    """
    along = _direction([_samples(cells, path) for path in (right, left)])
    faces = [
        _Face(cells, path, along, f"{where}, {side} face")
        for path, side in ((right, "right"), (left, "left"))
    ]
    low, high = max(face.places[0] for face in faces), min(face.places[-1] for face in faces)
    if high - low < 1e-6 * min(face.places[-1] - face.places[0] for face in faces):
        raise ValueError(
            f"{where}: its two faces share 0 end nodes and do not lie beside each other; the faces of a "
            "notch share one (the tip), those of two bodies face each other."
        )
    faces[0].move_towards(faces[1].places)
    faces[1].move_towards(faces[0].places)
    stations = np.unique(np.concatenate([[low, high], *(face.places for face in faces)]))
    stations = stations[(stations >= low) & (stations <= high)]
    matched = [face.divided(stations) for face in faces]
    return matched[0], matched[1]


def _samples(cells: CellComplex, path: list[int]) -> np.ndarray:
    """(n, 2): points along a face."""
    pieces = [cells.along(edge, _FINE[1:]) for edge in pairwise(path)]
    return np.concatenate([[cells.vertices[path[0]]], *pieces])


def _direction(faces: list[np.ndarray]) -> np.ndarray:
    """(2,): unit vector along both faces, given by points: that of the straight one, or else the mean of
    their tangents, most of all where they are nearest to each other.
    """
    chords = [points[-1] - points[0] for points in faces]
    straight = [
        np.abs((points - points[0]) @ [-chord[1], chord[0]]).max() < _SMOOTH * (chord @ chord)
        for points, chord in zip(faces, chords)
    ]
    if any(straight):
        summed = np.sum([chord for chord, one in zip(chords, straight) if one], axis=0)
    else:
        trees = [cKDTree(points) for points in faces]
        middles = [0.5 * (points[1:] + points[:-1]) for points in faces]
        apart = [tree.query(middle)[0] for tree, middle in zip(trees[::-1], middles)]
        least = min(distance.min() for distance in apart) - _NEAREST * max(np.hypot(*c) for c in chords)
        summed = np.sum(
            [(np.diff(points, axis=0).T / (d - least) ** 2).sum(axis=1) for points, d in zip(faces, apart)],
            axis=0,
        )
    return summed / np.hypot(*summed)


class _Face:
    """A face as a function of the place along a direction.

    Parameters
    ----------
    cells : CellComplex
    path : list of int
        Its vertices.
    along : (2,) array
        Unit vector of the direction in which it must go forward.
    where : str
        For messages.

    Attributes
    ----------
    places : (n,) array
        Of its vertices along the direction, m.
    """

    def __init__(self, cells: CellComplex, path: list[int], along: np.ndarray, where: str) -> None:
        self._cells, self._path, self._along = cells, path, along
        edges = list(pairwise(path))
        self._curved = [edge_key(edge) in cells.curves for edge in edges]
        self._shapes = [cells.shape(edge) for edge in edges]
        self._bounds = np.array([cells.vertices[v] for v in path]) @ along
        self.places = self._bounds.copy()
        pieces = [shape(_FINE) for shape in self._shapes]
        for edge, piece in zip(edges, pieces):
            steps = np.diff(piece, axis=0)
            if ((steps @ along) < _STEEPEST * np.hypot(*steps.T)).any():
                x, y = cells.vertices[edge[0]]
                raise ValueError(
                    f"{where}: near ({x:.6g}, {y:.6g}) m it turns by more than 78 degrees from the line "
                    "along both faces; name only the parts of the bodies that may touch."
                )
        self._free = self._movable(pieces)

    def _movable(self, pieces: list[np.ndarray]) -> np.ndarray:
        """(n,): vertices that may be moved along the face: neither ends nor corners, named points, or ends
        of named curves and interfaces.
        """
        free = np.zeros(len(self._path), bool)
        named = set(self._cells.points.values())
        sets = [{edge_key(edge) for edge in edges} for edges in self._cells.edge_sets.values()]
        materials: dict[int, set[int]] = {v: set() for v in self._path}
        for cell in self._cells.cells:
            for v in cell.vertices:
                if v in materials:
                    materials[v].add(cell.material)
        for k, vertex in enumerate(self._path[1:-1], 1):
            before, after = pieces[k - 1][-1] - pieces[k - 1][-2], pieces[k][1] - pieces[k][0]
            # the chords of the finest pieces of an arc turn by its curvature times their length
            own = sum(abs(turn(one[1] - one[0], one[-1] - one[-2])) for one in pieces[k - 1 : k + 1])
            smooth = abs(turn(before, after)) < _SMOOTH + own / 8
            edges = [edge_key((self._path[i], self._path[i + 1])) for i in (k - 1, k)]
            whole = all((edges[0] in one) == (edges[1] in one) for one in sets)
            free[k] = smooth and whole and vertex not in named and len(materials[vertex]) == 1
        return free

    def points(self, places: np.ndarray) -> np.ndarray:
        """(m, 2): where the face has some places along the direction."""
        places = np.asarray(places, float)
        number = np.clip(np.searchsorted(self._bounds, places, side="right") - 1, 0, len(self._shapes) - 1)
        result = np.empty((len(places), 2))
        for k in np.unique(number):
            mine, shape, (first, last) = number == k, self._shapes[k], self._bounds[k : k + 2]
            share = (places[mine] - first) / (last - first)
            result[mine] = shape(self._parameters(shape, places[mine]) if self._curved[k] else share)
        return result

    def _parameters(self, curve: Curve, places: np.ndarray) -> np.ndarray:
        """Parameters of an edge at some places, by bisection: it goes forward."""
        low, high = np.zeros(len(places)), np.ones(len(places))
        for _ in range(54):
            middle = 0.5 * (low + high)
            below = curve(middle) @ self._along < places
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        return 0.5 * (low + high)

    def move_towards(self, others: np.ndarray) -> None:
        """Put vertices that are near one of the other face's beside it."""
        lengths = np.diff(others)
        shorter = np.minimum(np.append(lengths, np.inf), np.insert(lengths, 0, np.inf))
        own = self.places.copy()
        for k in range(1, len(own) - 1):
            nearest = int(np.argmin(np.abs(others - own[k])))
            reach = min(own[k] - own[k - 1], own[k + 1] - own[k], float(shorter[nearest]))
            distance = abs(float(others[nearest]) - own[k])
            if 0.0 < distance <= _NEAR * reach and (self._free[k] or distance <= 1e-6 * reach):
                self.places[k] = others[nearest]

    def divided(self, stations: np.ndarray) -> list[int]:
        """Put moved vertices in place, divide the edges at the stations, and return the vertices from the
        first station to the last one.
        """
        cells = self._cells
        moved = np.flatnonzero(self.places != self._bounds)
        for k, (x, y) in zip(moved, self.points(self.places[moved]).tolist()):
            cells.vertices[self._path[k]] = (x, y)
        cuts = {}
        for k, edge in enumerate(pairwise(self._path)):
            first, last = self.places[k : k + 2]
            if any(self._curved[max(k - 1, 0) : k + 2]):
                cells.set_curve(*edge, self._between(first, last))
            inside = stations[(stations > first) & (stations < last)]
            if len(inside):
                cuts[edge] = (inside - first) / (last - first)
        edges = divided(list(pairwise(self._path)), cells.divide(cuts))
        whole = [self._path[0], *(last for _, last in edges)]
        places = np.unique(np.concatenate([self.places, stations]))
        places = places[(places >= self.places[0]) & (places <= self.places[-1])]
        return [v for v, s in zip(whole, places) if stations[0] <= s <= stations[-1]]

    def _between(self, first: float, last: float) -> Curve:
        """The face between two places, run through evenly along the direction."""
        return lambda at: self.points(first + np.asarray(at, float) * (last - first))
