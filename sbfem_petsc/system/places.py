"""Displacement and stress at any point of the structure, as linear forms of the displacements and face
forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import integer, real, shown
from ..parallel import agree, collective
from ..petsc import MPI
from ..selement.points import TOLERANCE, Located, locate, point_operators
from .rows import Rows, flat_entries


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
    """

    rows: Rows
    contact: np.ndarray
    faces: dict[int, np.ndarray]

    def direct(self, model, tip_forces: dict[int, np.ndarray], count: int) -> np.ndarray:
        """(rows, k): what loads on the faces inside tip elements add, from their forces (m, k).
        Collective.
        """
        total = np.zeros((len(self.rows), count))
        for number, form in self.faces.items():
            if number in tip_forces:
                total += form @ tip_forces[number]
        return model.comm.allreduce(total)


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
    if (
        isinstance(place, str)
        or not hasattr(place, "__len__")
        or getattr(place, "ndim", 1) == 0
        or len(place) != 2
    ):
        raise TypeError(f"{owner}: {shown(place)} must be the name of a point or coordinates (x, y) in m")
    if isinstance(place, Mapping):
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


def places(model, points: list[tuple[float, float]]) -> Places:
    """Forms at points (m). Collective.

    On an edge between S-elements the stress is that of the one with the lower number.

    Raises
    ------
    ValueError
        If a point lies outside the structure; on all ranks.
    RanksDiffer, SolveError
        If the ranks ask for different places, or another rank does not ask.
    """
    comm = model.comm
    agree(comm, "a result at places", places=points)
    homes = [_home(model, np.array(point)) for point in points]
    mine = np.array([-1 if home is None else home[0] for home in homes], dtype=np.int64)
    owner = np.where(mine < 0, np.iinfo(np.int64).max, mine)
    comm.Allreduce(MPI.IN_PLACE, owner, MPI.MIN)
    with collective(comm):
        for point, element in zip(points, owner):
            if element == np.iinfo(np.int64).max:
                lower, upper = model.extent
                raise ValueError(
                    f"the point ({point[0]:g}, {point[1]:g}) m lies outside the structure, which reaches "
                    f"from ({lower[0]:g}, {lower[1]:g}) to ({upper[0]:g}, {upper[1]:g}) m (and not inside "
                    "holes)"
                )
    tractions = {faces.number: faces for faces in model.tip_faces}
    numbers = {int(tip.element): number for number, tip in enumerate(model.tip_elements)}
    count, size = len(points), len(model.gap_operator)
    kinds: list[PlaceRows] = []
    local: tuple[dict, dict] = ({}, {})
    contact = (np.zeros((2 * count, size)), np.zeros((3 * count, size)))
    face_forms: tuple[dict, dict] = ({}, {})
    for k, home in enumerate(homes):
        if home is None or home[0] != owner[k]:
            continue
        element, group, member, located = home
        material = model.materials[group.material]
        faces = tractions.get(numbers.get(element, -1))
        forms = point_operators(
            group.solution.radial,
            group.shape,
            group.order,
            material.elasticity,
            located=located,
            closed=group.closed,
            tractions=None if faces is None else faces.tractions,
        ).turned(group.rotations[member])
        unknowns = model.part.unknowns[group.nodes[member]].ravel()
        scales = (1.0, material.modulus / float(group.sizes[member]))
        for kind, (form, scale) in enumerate(zip((forms.displacement[0], forms.stress[0]), scales)):
            first = (2 + kind) * k
            for row in range(2 + kind):
                local[kind][first + row] = (unknowns, scale * form[row, : forms.unknowns])
            if faces is not None:
                columns = scale * form[:, forms.unknowns :] / faces.stiffness
                place = model.gap_operator.pairs + faces.modes * faces.number
                contact[kind][first : first + 2 + kind, place : place + faces.modes] = columns[
                    :, : faces.modes
                ]
                table = face_forms[kind].setdefault(
                    faces.number, np.zeros(((2 + kind) * count, columns.shape[1]))
                )
                table[first : first + 2 + kind] = columns
    for kind in (0, 1):
        rows = Rows.gathered(comm, model.ranges, flat_entries(local[kind]), (2 + kind) * count)
        kinds.append(PlaceRows(rows, comm.allreduce(contact[kind]), face_forms[kind]))
    return Places(*kinds)


def _home(model, point: np.ndarray) -> tuple[int, Any, int, Located] | None:
    """The S-element of this rank with the lowest number that holds a point: its number, group, member,
    place.
    """
    boxes, part = model.element_boxes, model.part
    slack = TOLERANCE * (boxes[:, 2:] - boxes[:, :2]).max(axis=1, initial=0.0)[:, None]
    inside = ((point >= boxes[:, :2] - slack) & (point <= boxes[:, 2:] + slack)).all(axis=1)
    for row in sorted(np.flatnonzero(inside), key=lambda r: int(part.elements[r])):
        group = next(g for g in model.groups if (g.elements == row).any())
        member = int(np.flatnonzero(group.elements == row)[0])
        relative = group.rotations[member] @ (point - part.centres[row]) / group.sizes[member]
        located = locate(group.shape, group.order, group.closed, relative[None])
        if located.edge[0] >= 0:
            return int(part.elements[row]), group, member, located
    return None
