"""The faces inside tip elements: they carry no nodes, but contact and loads by traction modes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..parallel import collective
from ..selement.coefficients import SElementError
from ..selement.face_tractions import (
    FaceTractions,
    face_tractions,
    opening_direction,
    single_face_directions,
)
from ..selement.sectors import Sectors
from .shapes import Group


@dataclass(frozen=True, eq=False)
class TipFaces:
    """Traction modes on the faces of one tip element that this rank holds.

    The first `modes` of them press the faces apart (contact); then follow tractions along x and y of the
    reference frame on the first and on the last face.

    Attributes
    ----------
    number : int
        Of the tip among those with an element.
    group : Group
    member : int
        Row of the group.
    tractions : FaceTractions
    modes : int
    stiffness : float
        E times the thickness, N/m.
    sets : (str, str)
        Edge sets to which the first and the last face of the reference shape belong.
    given_gaps : (float, float) or None
        Initial gaps at the tip and on the element's boundary, m, where they are not those of the drawn faces.
    """

    number: int
    group: Group
    member: int
    tractions: FaceTractions
    modes: int
    stiffness: float
    sets: tuple[str, str]
    given_gaps: tuple[float, float] | None = None

    @property
    def size(self) -> float:
        """m."""
        return float(self.group.sizes[self.member])

    @property
    def rotation(self) -> np.ndarray:
        """(2, 2): from the element's frame to the reference frame."""
        return self.group.rotations[self.member]

    @property
    def rows(self) -> np.ndarray:
        """(m, n): means of the modes for displacements of the element's nodes in its own frame."""
        return (self.tractions.rows.reshape(len(self.tractions.rows), -1, 2) @ self.rotation).reshape(
            len(self.tractions.rows), -1
        )

    @property
    def flexibility(self) -> np.ndarray:
        """(m, m), m/N."""
        return self.tractions.flexibility / self.stiffness

    def layer(self, thickness: float) -> np.ndarray:
        """(modes, modes): flexibility of an elastic layer of 1 m^3/N between the faces, m/N."""
        return self.tractions.layer() / (self.size * thickness)

    def initial_gap(self) -> np.ndarray:
        """(modes,): mean gaps of the undeformed faces, m."""
        if self.given_gaps is not None:
            return self.tractions.initial_mean(*self.given_gaps)
        return self.tractions.initial_mean(0.0, _drawn_gap(self.group.shape, self.size))

    def uniform(
        self, edge_set: str, traction: Callable[[np.ndarray], np.ndarray], thickness: float
    ) -> np.ndarray:
        """(m,): forces (N) of a traction (Pa), a function of the outward normal, on the faces of a set."""
        values = np.zeros(5)
        turn = np.linalg.det(self.rotation)
        for face, name in enumerate(self.sets):
            if name != edge_set:
                continue
            # along the outline, with the material on the left: out along the first face, back along the last,
            # and the other way round in a reflected shape
            along = (1.0 - 2.0 * face) * turn * (self.group.shape[(0, -1)[face]] @ self.rotation)
            normal = np.array([along[1], -along[0]]) / np.linalg.norm(along)
            values[1 + 2 * face : 3 + 2 * face] = self.rotation @ traction(normal)
        return self.tractions.uniform_force(values) * self.size * thickness


def tip_faces(model) -> list[TipFaces]:
    """Those of the tip elements that this rank holds. Collective."""
    found: list[TipFaces] = []
    shared: dict[int, FaceTractions] = {}  # similar tip elements have the same
    if not model.tip_modes:
        return found
    with collective(model.comm):
        for place in model.tip_places:
            group, material = place.group, model.materials[place.group.material]
            if id(group) not in shared:
                try:
                    shared[id(group)] = _tractions(group, material, model.tip_modes)
                except SElementError as error:
                    raise SElementError(f"tip {model.tip_elements[place.number].name}: {error}") from None
            tractions, stiffness = shared[id(group)], material.modulus * model.thickness
            gaps = _given_gaps(model, group, place.member, place.number)
            sets = model.tip_elements[place.number].faces
            if np.linalg.det(group.rotations[place.member]) < 0.0:
                sets = sets[::-1]  # a reflected shape runs through the element's chain backwards
            found.append(
                TipFaces(place.number, group, place.member, tractions, model.tip_modes, stiffness, sets, gaps)
            )
    return found


def _drawn_gap(shape: np.ndarray, size: float) -> float:
    """Distance of the faces on the element's boundary, m."""
    opening = float(opening_direction(shape)[0] @ (shape[0] - shape[-1]))
    return size * opening if opening > 1e-12 else 0.0  # faces of a closed crack coincide to round-off


def _given_gaps(model, group: Group, member: int, number: int) -> tuple[float, float] | None:
    """Initial gaps at the tip and on the boundary of its element, m, from the pair there and the next one, if
    they are not those of the drawn faces.
    """
    tip, pairs, part = model.tip_elements[number], model.pairs, model.part
    ends = np.sort(part.nodes[group.nodes[member][[0, -1]]])
    here = np.flatnonzero((np.sort(pairs.nodes, axis=1) == ends).all(axis=1) & (pairs.crack == tip.crack))
    drawn = _drawn_gap(group.shape, float(group.sizes[member]))
    if not len(here) or abs(pairs.gap[here[0]] - drawn) <= 1e-6 * max(pairs.gap[here[0]], drawn):
        return None
    first = int(here[0])
    line = np.flatnonzero(pairs.crack == tip.crack)
    beyond = np.abs(pairs.arc[line] - pairs.arc[first])
    beyond[pairs.arc[line] == pairs.arc[first]] = np.inf
    second = int(line[np.argmin(beyond)])
    reach = float(group.sizes[member] * np.linalg.norm(group.shape[[0, -1]], axis=1).mean())
    slope = float(pairs.gap[second] - pairs.gap[first]) / float(beyond.min())
    return max(float(pairs.gap[first]) - reach * slope, 0.0), float(pairs.gap[first])


def _tractions(group: Group, material, modes: int) -> FaceTractions:
    directions = np.concatenate(
        [opening_direction(group.shape)[None], single_face_directions(0), single_face_directions(1)]
    )
    return face_tractions(
        Sectors(group.shape, group.order, material.elasticity),
        stiffness=group.solution.stiffness,
        radial=group.solution.radial,
        directions=directions,
        modes=modes,
    )
