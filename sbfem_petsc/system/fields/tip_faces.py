"""The faces inside tip elements: they carry no nodes, but contact and loads by traction modes."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from meshing.mesh_arrays import ContactPairs, Tip

from ...material import AnyMaterial
from ...selement.coefficients import SElementError
from ...selement.face_tractions import (
    GAP_POWERS,
    FaceTractions,
    face_axis,
    face_tractions,
    opening_direction,
    single_face_directions,
)
from ...selement.sectors import Sectors
from ..elements.elements import Elements
from ..elements.shapes import Group, incompressible

_Shared = TypeVar("_Shared")


@dataclass(frozen=True, eq=False)
class TipElement:
    """A tip whose S-element this rank holds.

    Attributes
    ----------
    number : int
        Among the tips with an element.
    tip : Tip
    material : Material, OrthotropicMaterial or SectorMaterials
    group : Group
    member : int
        Row of the group.
    """

    number: int
    tip: Tip
    material: AnyMaterial
    group: Group
    member: int

    @property
    def size(self) -> float:
        """m."""
        return float(self.group.sizes[self.member])

    @property
    def rotation(self) -> np.ndarray:
        """(2, 2): from the element's frame to the reference frame."""
        return self.group.rotations[self.member]

    @property
    def axis(self) -> np.ndarray:
        """(2,): unit vector from the tip to the mouth in the reference frame."""
        return self.rotation @ np.array(self.tip.axis)

    @property
    def nodes(self) -> np.ndarray:
        """(n,): rows of this rank's nodes."""
        return self.group.nodes[self.member]

    @property
    def sectors(self) -> Sectors:
        """Of the reference shape."""
        return Sectors(self.group.shape, self.group.order, self.material.elasticity)

    def shared(self, known: dict[tuple, _Shared], make: Callable[[], _Shared], *key: Hashable) -> _Shared:
        """What similar tip elements with the same key have too, made once; an error names the tip."""
        key = (id(self.group), *key)
        if key not in known:
            try:
                known[key] = make()
            except SElementError as error:
                raise SElementError(f"tip {self.tip.name}: {error}{incompressible(self.material)}") from None
        return known[key]


def tip_elements(elements: Elements) -> list[TipElement]:
    """The tip elements that this rank holds."""
    row_of = {int(element): row for row, element in enumerate(elements.layout.part.elements)}
    found = []
    for number, tip in enumerate(elements.layout.tip_elements):
        if (row := row_of.get(int(tip.element))) is not None:
            of_group, member = elements.members[row].tolist()
            group = elements.groups[of_group]
            found.append(TipElement(number, tip, elements.materials[group.material], group, member))
    return found


@dataclass(frozen=True, eq=False)
class TipFaces(TipElement):
    """Traction modes on the faces of one tip element that this rank holds.

    The first `modes` of them press the faces apart (contact): polynomials, and the logarithm where the faces
    close a wedge. Among all modes the others are tractions along x and y of the reference frame on the first
    and on the last face.

    Attributes
    ----------
    first : int
        Contact row of its first mode.
    rubbing : int
        The tangential row of its first mode, -1 where its faces do not rub.
    modes : int
        Number of its contact rows.
    tractions : FaceTractions
    stiffness : float
        E times the thickness, N/m.
    sets : (str, str)
        Edge sets to which the first and the last face of the reference shape belong.
    gap : (4,) array
        Factors of the powers `GAP_POWERS` in the initial gap, m.
    """

    first: int
    rubbing: int
    modes: int
    tractions: FaceTractions
    stiffness: float
    sets: tuple[str, str]
    gap: np.ndarray

    @property
    def contact(self) -> slice:
        """Its contact rows."""
        return slice(self.first, self.first + self.modes)

    @property
    def wedge(self) -> bool:
        """Whether a contact row is the logarithm's."""
        return self.modes == self.tractions.modes

    def pressing(self, force: np.ndarray) -> np.ndarray:
        """(m,): forces of all modes from those of the contact rows (c,), N."""
        forces = np.zeros(len(self.tractions.growth))
        forces[: self.modes] = force[self.contact]
        if self.rubbing >= 0:
            forces += self.sliding @ force[self.tangential]
        return forces

    @property
    def tangential(self) -> slice:
        """Its tangential rows."""
        return slice(self.rubbing, self.rubbing + self.modes)

    @property
    def sliding(self) -> np.ndarray:
        """(m, modes): forces of all modes under friction of the same modes along the faces: what the
        tractions on either face alone are together.
        """
        axis, each = face_axis(self.group.shape), self.tractions.lengths[1:].reshape(2, 2)
        components = 2.0 * each / each[:, :1].sum() * [axis, -axis]
        every = np.eye(self.tractions.modes, self.modes)
        return np.concatenate([np.zeros_like(every), *(part * every for part in components.ravel())])

    def place(self, target: np.ndarray, columns: np.ndarray) -> None:
        """Put columns (k, m) of all modes where those of its contact rows are, in a view (k, c)."""
        target[:, self.contact] = columns[:, : self.modes]
        if self.rubbing >= 0:
            target[:, self.tangential] = columns @ self.sliding

    @property
    def rows(self) -> np.ndarray:
        """(m, n): means of the modes for displacements of the element's nodes in its own frame."""
        rows = self.tractions.rows
        return (rows.reshape(len(rows), -1, 2) @ self.rotation).reshape(rows.shape)

    @property
    def flexibility(self) -> np.ndarray:
        """(m, m), m/N."""
        return self.tractions.flexibility / self.stiffness

    def layer(self, thickness: float) -> np.ndarray:
        """(modes, modes): flexibility of an elastic layer of 1 m^3/N between the faces, m/N."""
        return self.tractions.layer()[: self.modes, : self.modes] / (self.size * thickness)

    def initial_gap(self) -> np.ndarray:
        """(modes,): mean gaps of the undeformed faces, m."""
        return self.tractions.initial_mean(self.gap)[: self.modes]

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


# Share of the gap on the boundary of a tip element up to which one at the tip is what a straight line through
# the gaps of curved faces leaves there: faces that stand apart at the tip would close no wedge.
_AT_THE_TIP = 0.1


def drawn_gap(place: TipElement) -> float:
    """Distance of the faces on the element's boundary, m."""
    shape = place.group.shape
    opening = float(opening_direction(shape)[0] @ (shape[0] - shape[-1]))
    return place.size * opening if opening > 1e-12 else 0.0  # faces of a closed crack coincide to round-off


def given_gap(pairs: ContactPairs, tip: Tip) -> np.ndarray | None:
    """(4,): factors of the powers in the gap inside a tip's element, m, through that of the pair on its
    boundary and that of the next one.

    Gaps run on straight, or as b r^(1/2) + c r^(3/2) where that meets the third pair better, as where the
    ends are round: straight ones would leave a wrong K_I there, however small the element.
    """
    start, stop = tip.arc
    line = np.flatnonzero(pairs.crack == tip.crack)
    outwards = (pairs.arc[line] - start) / (stop - start)
    _, rows = np.unique(np.round(outwards, 6), return_index=True)  # two pairs may stand at one place
    rows = rows[outwards[rows] > 1.0 - 1e-6][:3]
    r, gap = outwards[rows], pairs.gap[line[rows]]
    if len(r) < 2 or r[0] > 1.0 + 1e-6:
        return None  # its pair has been made one with another crack's, or is the only one
    straight, rounded = np.zeros((2, len(GAP_POWERS)))
    powers = r[:, None] ** GAP_POWERS
    straight[::2] = np.linalg.solve(powers[:2, ::2], gap[:2])
    rounded[1::2] = np.linalg.solve(powers[:2, 1::2], gap[:2])
    if straight[0] <= _AT_THE_TIP * gap[0]:
        return np.array([0.0, 0.0, gap[0], 0.0])
    line_misses, round_misses = np.abs(powers[-1] @ np.stack([straight, rounded], axis=1) - gap[-1])
    return rounded if len(r) > 2 and round_misses < line_misses else straight


def tractions_of(place: TipElement, modes: int) -> FaceTractions:
    """What tractions on the faces inside tip elements of a shape do: along the directions in which they open,
    of polynomials up to so many and a logarithm, and of either face alone.
    """
    opening, solution = opening_direction(place.group.shape), place.group.solution
    directions = np.concatenate([opening[None], single_face_directions(0), single_face_directions(1)])
    return face_tractions(
        place.sectors,
        stiffness=solution.stiffness,
        radial=solution.radial,
        directions=directions,
        modes=modes,
        logarithm=True,
    )
