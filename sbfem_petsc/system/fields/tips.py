"""Stress intensity factors of all crack tips as linear forms of the displacements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ...material import SectorMaterials
from ...ranks.parallel import collective
from ...selement.coefficients import SElementError
from ...selement.intensity import intensity_rows
from ...selement.sectors import Sectors
from ..elements.shapes import Group
from ..layout.rows import Rows, flat_entries
from .tip_facts import TipFacts

if TYPE_CHECKING:
    from ..structure import Structure

# Length at which stress intensity factors of a crack along an interface are taken, m: K_I + i K_II is then
# Rice's complex K in SI units.
REFERENCE_LENGTH = 1.0


class TipPlace(NamedTuple):
    """A tip whose S-element this rank holds."""

    number: int
    group: Group
    member: int


@dataclass(frozen=True, eq=False)
class TipIntensities(TipFacts):
    """K_I and K_II of every tip with a tip element.

    Attributes
    ----------
    rows : Rows
        Two for each tip.
    contact : (2 tips, c) array
        What forces of the contact rows add at given displacements, Pa m^(1/2)/N: those inside the tip
        elements.
    faces : dict of int to (2, m) array
        The same for all traction modes of the tips that this rank holds, by the tip's number.
    exponent_errors : (tips,) array
        Of tips that are not in one isotropic material: how far the exponents of their S-elements are from the
        exact ones; zero at others.
    """

    rows: Rows
    contact: np.ndarray
    faces: dict[int, np.ndarray]
    exponent_errors: np.ndarray

    @property
    def facts(self) -> TipFacts:
        """What the tips are, without the forms."""
        return TipFacts(self.names, self.exponents, self.interfaces, self.contact_rows)

    def evaluate(self, owned: np.ndarray, more: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from this rank's displacement unknowns and what tractions
        on the faces inside the tip elements add, (2 tips,). Collective.
        """
        values = (self.rows(owned) + more).reshape(-1, 2)
        return {name: (float(one), float(two)) for name, (one, two) in zip(self.names, values)}


def tip_places(model: Structure) -> list[TipPlace]:
    """The tip elements that this rank holds."""
    row_of = {int(element): row for row, element in enumerate(model.part.elements)}
    open_ones = {
        int(row): (group, member)
        for group in model.groups
        if not group.closed
        for member, row in enumerate(group.elements)
    }
    rows = [(number, row_of.get(int(tip.element), -1)) for number, tip in enumerate(model.tip_elements)]
    return [TipPlace(number, *open_ones[row]) for number, row in rows if row >= 0]


def tip_intensities(model: Structure) -> TipIntensities:
    """The forms of a model. Collective."""
    tips = model.tip_elements
    exponents, errors, interfaces = np.zeros((len(tips), 2)), np.zeros(len(tips)), np.zeros(len(tips))
    contact = np.zeros((2 * len(tips), len(model.gap_operator)))
    tractions = {faces.number: faces for faces in model.tip_faces}
    rows: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    columns: dict[int, np.ndarray] = {}
    shared: dict[tuple, Any] = {}  # similar tip elements with the same axis have the same forms
    with collective(model.comm):  # the rank that owns a tip must not fail alone
        for number, group, member in model.tip_places:
            tip, rotation, size = tips[number], group.rotations[member], group.sizes[member]
            material = model.materials[group.material]
            axis = rotation @ np.array(tip.axis)
            key: tuple = (id(group), *np.round(axis, 12))
            if isinstance(material, SectorMaterials):
                key += (float(size),)  # complex exponents
            if key not in shared:
                try:
                    shared[key] = intensity_rows(
                        group.solution.radial,
                        Sectors(group.shape, group.order, material.elasticity),
                        axis,
                        material.isotropic,
                        reference_length=REFERENCE_LENGTH / size,
                    )
                except SElementError as error:
                    raise SElementError(f"tip {tip.name}: {error}") from None
            form = shared[key]
            placed = form.placed(rotation, size, material.modulus).reshape(2, -1)
            unknowns = model.part.unknowns[group.nodes[member]].ravel()
            rows |= {2 * number + k: (unknowns, placed[k]) for k in (0, 1)}
            exponents[number], interfaces[number] = form.exponents, isinstance(material, SectorMaterials)
            errors[number] = 0.0 if material.isotropic else np.nan_to_num(form.exponent_error)
            if number in tractions:
                faces = tractions[number]
                columns[number] = form.placed_of_tractions(faces.tractions, rotation, size, model.thickness)
                faces.place(contact[2 * number : 2 * number + 2], columns[number])
    exponents, contact, errors, interfaces = (
        model.comm.allreduce(array) for array in (exponents, contact, errors, interfaces)
    )
    gathered = Rows.gathered(model.comm, model.ranges, flat_entries(rows), 2 * len(tips))
    names = tuple(tip.name for tip in tips)
    facts = names, exponents, interfaces > 0.0, model.tip_rows
    return TipIntensities(*facts, gathered, contact, columns, errors)
