"""Displacement and stress at any point of the structure, as linear forms of the displacements and face
forces.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from meshing.warnings import PlaceWarning

from ...checks import integer, real, shown
from ...errors import warn
from ...petsc import MPI
from ...ranks.parallel import collective
from ...selement.coefficients import edge_nodes
from ...selement.interior import Located
from ...selement.interior_motion import inertial_operators
from ...selement.points import TOLERANCE, PointOperators, locate, point_operators
from ...selement.sectors import Sectors
from ..elements.elements import Elements
from ..elements.shapes import Group
from ..layout.rows import Rows, flat
from ..loads import LoadColumns
from ..solve.assembly import Triples
from .tips import Tips

# The name of a point, or coordinates in m.
Point = str | tuple[float, float]
# How near to a frequency of an S-element whose boundary is held, relatively, a mode counts as its own.
_ALONE = 1e-9
# Components of a place: two of displacement, three of stress.
_ALL = 5
# Share of its size by which an S-element's curved edges bulge over the box of its nodes at most.
_BULGE = 0.1
# Numbers of points and where they are, by the row of their S-element.
Held = dict[int, tuple[list[int], Located]]


@dataclass(frozen=True, eq=False)
class PlaceRows:
    """Forms of one kind at some places.

    Attributes
    ----------
    rows : Rows
        Over the displacement unknowns, all components of the first place first.
    contact : (rows, c) array
        What forces of the contact rows add at given displacements: those inside a tip element.
    faces : dict of int to (rows, m) array
        The same for all traction modes (N) of the tips that this rank holds, by the tip's number.
    inertia : Inertial or None
        What the inertia of the insides adds, where it was asked for.
    held : Rows or None
        Over the unknowns of `Layout.held`, where they were asked for.
    """

    rows: Rows
    contact: np.ndarray
    faces: dict[int, np.ndarray]
    inertia: Inertial | None = None
    held: Rows | None = None

    def direct(self, columns: LoadColumns) -> np.ndarray:
        """(rows, k): what loads on the faces inside tip elements, the inertia of moving supports and edges
        with a prescribed displacement add at given displacements. Collective.
        """
        total = np.zeros((len(self.rows), columns.acceleration.shape[1]))
        for number, form in self.faces.items():
            if number in columns.tip_forces:
                total += form @ columns.tip_forces[number]
        if self.inertia is not None:
            total -= self.inertia.body_force @ columns.acceleration
        result = self.rows.comm.allreduce(total)
        return result if self.held is None or columns.lift is None else result + self.held(columns.lift.held)

    def modes(self, shapes: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """(rows, k): of modes (owned, k) with circular frequencies omega. Collective."""
        values = self.rows(shapes)
        if self.inertia is None:
            return values
        return values + self.rows.comm.allreduce(self.inertia.of_modes(shapes, omega))

    def some(self, chosen: np.ndarray) -> PlaceRows:
        """Some of them."""
        inertia, held = self.inertia, self.held
        if inertia is not None:
            parts = {"fields": inertia.fields[chosen], "body_force": inertia.body_force[chosen]}
            inertia = replace(inertia, **parts)
        faces = {number: form[chosen] for number, form in self.faces.items()}
        held = None if held is None else held[chosen]
        return PlaceRows(self.rows[chosen], self.contact[chosen], faces, inertia, held)


@dataclass(frozen=True, eq=False)
class Inertial:
    """What inertia adds inside S-elements whose boundaries are given.

    Attributes
    ----------
    coupling : Rows
        C' over the displacement unknowns, one row for each auxiliary unknown of the S-elements that hold a
        place.
    stretch, squared : (a,) arrays
        rho h^2 / E, and J times it, of each auxiliary unknown, s^2.
    fields : (rows, a) sparse matrix
        Of unit auxiliary unknowns, at the places that this rank holds.
    body_force : (rows, 2) array
        Of a unit acceleration along x and y, at the places that this rank holds.
    own : dict of int to slice
        Which auxiliary unknowns are those of an S-element of this rank, by its row in the rank's part.
    """

    coupling: Rows
    stretch: np.ndarray
    squared: np.ndarray
    fields: sparse.csr_matrix
    body_force: np.ndarray
    own: dict[int, slice]

    def of_modes(self, shapes: np.ndarray, omega: np.ndarray) -> np.ndarray:
        """(rows, k): this rank's share. Collective."""
        away = 1.0 - self.squared[:, None] * omega**2
        # an S-element that vibrates alone, its boundary at rest: no mode that the mesh carries
        away[np.abs(away) < _ALONE] = np.inf
        return self.fields @ (self.stretch[:, None] * omega**2 * self.coupling(shapes) / away)


@dataclass(frozen=True, eq=False)
class Places:
    """Forms of displacement (2 a place, m) and stress (xx, yy, xy, 3 a place, Pa)."""

    displacement: PlaceRows
    stress: PlaceRows


def checked_place(owner: str, place: Any) -> tuple[float, float]:
    """(x, y) as finite numbers.

    Raises
    ------
    TypeError, ValueError
        If it is something else.
    """
    sized = hasattr(place, "__len__") and getattr(place, "ndim", 1) > 0
    if isinstance(place, (str, Mapping)) or not sized or len(place) != 2:
        raise TypeError(f"{owner}: {shown(place)} must be the name of a point or coordinates (x, y) in m")
    x, y = place
    return real(owner, "x of the point", x, "m"), real(owner, "y of the point", y, "m")


def checked_line(start: Any, end: Any, count: int) -> tuple[np.ndarray, list[tuple[float, float]]]:
    """Evenly spaced places of a straight line, as an array (count, 2) and as points, m.

    Raises
    ------
    TypeError, ValueError
        If the ends are no places, or for fewer than two of them.
    """
    ends = np.array([checked_place("along", start), checked_place("along", end)])
    line = np.linspace(ends[0], ends[1], integer("along", "count", count, least=2, most=10**6))
    return line, [(float(x), float(y)) for x, y in line]


def places(tips: Tips, points: Sequence[Point], inertia: bool = False, moved: bool = False) -> Places:
    """Forms at points, with what inertia adds inside S-elements, and what supports that move do, if it is
    asked for. Collective.

    On an edge between S-elements the stress is that of the one with the lower number; of a named point, of
    one that has its node, so that the corners of a crack's mouth are told apart where they coincide.

    Raises
    ------
    ValueError
        If a point lies outside the structure; on all ranks.

    Warns
    -----
    PlaceWarning
        On rank 0, if a point lies where the faces of a crack coincide.
    """
    elements, layout, comm = tips.elements, tips.layout, tips.layout.comm
    held, loaded = _held(elements, points), tips.faces
    _warn_of_faces(tips, points, held)
    every = np.arange(_ALL * len(points)).reshape(-1, _ALL)
    blocks, contact = list[Triples](), np.zeros((every.size, tips.count))
    face_forms: dict[int, np.ndarray] = {}
    for row, (numbers, located) in held.items():
        group = elements.one_of(elements.groups, row)
        faces = next((f for f in loaded.values() if f.tip.element == layout.part.elements[row]), None)
        forms = point_operators(
            group.solution.radial,
            Sectors(group.shape, group.order, elements.materials[group.material].elasticity),
            located=located,
            closed=group.closed,
            tractions=None if faces is None else faces.tractions,
        )
        rows, form = every[numbers].ravel(), _in_own_frame(elements, group, forms)
        blocks.append((rows, group.nodes[0], form[:, : forms.unknowns]))
        if faces is not None:
            columns, own = form[:, forms.unknowns :] / faces.stiffness, np.zeros((len(rows), tips.count))
            faces.place(own, columns)
            contact[rows] = own
            face_forms[faces.number] = np.zeros((every.size, columns.shape[1]))
            face_forms[faces.number][rows] = columns
    rows_on = [
        Rows.gathered(
            comm, of.ranges, [(r, of.part.unknowns[nodes].ravel(), v) for r, nodes, v in blocks], every.size
        )
        for of in ([layout, layout.held] if moved else [layout])
    ]
    moving = _inertial(elements, held, every) if inertia else None
    found = PlaceRows(rows_on[0], comm.allreduce(contact), face_forms, moving, *rows_on[1:])
    return Places(found.some(every[:, :2].ravel()), found.some(every[:, 2:].ravel()))


def _in_own_frame(elements: Elements, group: Group, forms: PointOperators) -> np.ndarray:
    """(5 places, n): displacement and stress of each place, m and Pa, in one S-element of a group of one."""
    turned = forms.turned(group.rotations[0])
    unit = elements.materials[group.material].modulus / float(group.sizes[0])
    both = np.concatenate([turned.displacement, unit * turned.stress], axis=1)
    return both.reshape(-1, both.shape[2])


def _held(elements: Elements, points: Sequence[Point]) -> Held:
    """The points that this rank evaluates. Collective.

    Raises
    ------
    ValueError
        If a point lies outside the structure; on all ranks.
    """
    comm, part = elements.layout.comm, elements.layout.part
    homes: list[tuple[int, Located] | None] = [None] * len(points)
    nowhere = np.iinfo(np.int64).max
    mine = owner = np.full(len(points), nowhere)
    for drawn in (False, True):  # what no S-element holds may be on a curve that edges stand for
        for k in np.flatnonzero(owner == nowhere):
            homes[k] = _home(elements, points[k], drawn)
        mine = np.array(
            [nowhere if home is None else part.elements[home[0]] for home in homes], dtype=np.int64
        )
        owner = mine.copy()
        comm.Allreduce(MPI.IN_PLACE, owner, MPI.MIN)
    with collective(comm):
        for point, element in zip(points, owner):
            if element == nowhere:
                lower, upper = elements.layout.extent
                raise ValueError(
                    f"the point ({point[0]:g}, {point[1]:g}) m lies outside the structure, which reaches "
                    f"from ({lower[0]:g}, {lower[1]:g}) to ({upper[0]:g}, {upper[1]:g}) m (and not inside "
                    "holes)"
                )
    inside: dict[int, list[tuple[int, Located]]] = {}
    for k, home in enumerate(homes):
        if home is not None and mine[k] == owner[k]:
            inside.setdefault(home[0], []).append((k, home[1]))
    return {
        row: ([k for k, _ in some], Located(*map(np.concatenate, zip(*(located for _, located in some)))))
        for row, some in inside.items()
    }


def _warn_of_faces(tips: Tips, points: Sequence[Any], held: Held) -> None:
    """Warn of coordinates where faces of a crack coincide, of which this rank holds some. Collective."""
    mine, gaps = {}, tips.gaps  # of all ranks, which hold no place, too
    for row, (numbers, located) in held.items():
        for k, *place in zip(numbers, *located):
            if not isinstance(points[k], str):
                mine[k] = _coinciding_faces(tips, gaps, row, Located(*place))
    found = {
        k: crack
        for part in tips.layout.comm.allgather(mine)
        for k, crack in part.items()
        if crack is not None
    }
    if not found or tips.layout.comm.rank > 0:
        return
    first = min(found)
    others = f" and {len(found) - 1} more" if len(found) > 1 else ""
    warn(
        f"the point ({points[first][0]:g}, {points[first][1]:g}) m{others} lies where both faces of "
        f"{tips.layout.cracks[found[first]].name} are: displacement and stress are those of one side, "
        "that of the S-element with the lower number; ask 1e-6 of the crack's length beside it for the "
        "side you mean",
        PlaceWarning,
    )


def _coinciding_faces(tips: Tips, tip_gaps: np.ndarray, row: int, located: Located) -> int | None:
    """Number of the crack of which an S-element's place is on two faces, that are at the same place."""
    group, (number, eta, level) = tips.elements.one_of(tips.elements.groups, row), located
    edges = edge_nodes(len(group.shape), group.order, group.closed)
    begins, ends = eta <= TOLERANCE - 1.0, eta >= 1.0 - TOLERANCE
    if level >= 1.0 - TOLERANCE:
        edge = edges[number][:1] if begins else edges[number][-1:] if ends else edges[number]
        nodes, pairs = tips.layout.part.nodes[group.nodes[0, edge]], tips.layout.pairs
        closed = np.isin(pairs.nodes, nodes) & (pairs.gap == 0.0)[:, None]
        if np.isin(nodes, pairs.nodes[closed]).all():
            return int(pairs.crack[closed.any(axis=1)][0])
    on_face = (number == 0 and begins) or (number == len(edges) - 1 and ends)
    for tip, gaps in zip(tips.layout.tip_elements, tip_gaps):
        inside = tip.element == tips.layout.part.elements[row] and on_face and level > 0.0
        if inside and not gaps.any():
            return int(tip.crack)
    return None


def _inertial(elements: Elements, held: Held, every: np.ndarray) -> Inertial:
    """Of displacement and stress, rows (points, 5), at places of which this rank holds some. Collective."""
    comm, moving = elements.layout.comm, elements.moving
    groups = [elements.one_of(moving, row) for row in held]
    sizes = [group.solution.inertia.size for group in groups]
    before = np.concatenate([[0], np.cumsum(comm.allgather(sum(sizes)))]).astype(int)
    first, total = int(before[comm.rank]), int(before[-1])
    stretch, squared, slices = np.zeros(total), np.zeros(total), {}
    coupling, fields, body = list[Triples](), list[Triples](), np.zeros((every.size, 2))
    for (row, (numbers, located)), group, size in zip(held.items(), groups, sizes):
        solution, own = group.solution, np.arange(first, first + size)
        slices[row] = slice(first, first + size)
        modulus, mass = elements.scales(group)
        scale = float(mass[0]) / modulus
        coupling.append((own, elements.unknowns_of(group)[0], group.turned(solution.coupling)[0].T))
        stretch[own], squared[own] = scale, scale * solution.inertia
        operators = inertial_operators(solution, elements.terms, located)
        rows, forms = every[numbers].ravel(), _in_own_frame(elements, group, operators)
        fields.append((rows, own, forms[:, :size]))
        body[rows] = scale * forms[:, size:] @ group.rotations[0]
        first += size
    rows_on = Rows.gathered(comm, elements.layout.ranges, coupling, total)
    stretch, squared = comm.allreduce(stretch), comm.allreduce(squared)
    at, which, values = flat(fields)
    table = sparse.coo_matrix((values, (at, which)), shape=(every.size, total)).tocsr()
    return Inertial(rows_on, stretch, squared, table, body, slices)


def _home(elements: Elements, point: Point, drawn: bool) -> tuple[int, Located] | None:
    """The S-element of this rank with the lowest number that holds a point, the node of a named one, or
    has it on a curve as drawn: its row, and the place in it.
    """
    boxes, part = elements.layout.element_boxes, elements.layout.part
    at, _, node = elements.layout.points[point] if isinstance(point, str) else (point, None, None)
    slack = (_BULGE if drawn else TOLERANCE) * (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)[:, None]
    inside = ((at >= boxes[:, :2] - slack) & (at <= boxes[:, 2:] + slack)).all(axis=1)
    for row in sorted(np.flatnonzero(inside).tolist(), key=lambda r: int(part.elements[r])):
        group = elements.one_of(elements.groups, row)
        nodes = part.nodes[group.nodes[0]]
        if node is not None and node not in nodes:
            continue
        relative = group.rotations[0] @ (at - part.centres[row]) / group.sizes[0]
        located = locate(group.shape, group.order, group.closed, relative[None], drawn)
        if node == nodes[-1] and not group.closed:  # the face of a tip's S-element that `locate` finds last
            last = len(edge_nodes(len(nodes), group.order, group.closed)) - 1
            located = Located(np.array([last]), np.ones(1), np.ones(1))
        if located.edge[0] >= 0:
            return row, located
    return None
