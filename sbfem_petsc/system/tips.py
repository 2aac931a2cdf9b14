"""Stress intensity factors of all crack tips as linear forms of the displacements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ..material import SectorMaterials
from ..parallel import collective
from ..selement.coefficients import SElementError
from ..selement.intensity import intensity_rows
from ..selement.sectors import Sectors
from .rows import Rows, flat_entries
from .shapes import Group

# Length at which stress intensity factors of a crack along an interface are taken, m: K_I + i K_II is then
# Rice's complex K in SI units.
REFERENCE_LENGTH = 1.0
# How near to 1/2 the exponents of a crack's tip are.
CRACK = 1e-6


class TipPlace(NamedTuple):
    """A tip whose S-element this rank holds."""

    number: int
    group: Group
    member: int


@dataclass(frozen=True, eq=False)
class TipIntensities:
    """K_I and K_II of every tip with a tip element.

    Attributes
    ----------
    names : tuple of str
    exponents : (tips, 2) array
        Exponents lambda of the displacement modes; the unit of K is Pa m^(1 - lambda), Pa m^(1/2) at a crack.
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
    interfaces : (tips,) bool array
        Whether several materials meet at the tip.
    """

    names: tuple[str, ...]
    exponents: np.ndarray
    rows: Rows
    contact: np.ndarray
    faces: dict[int, np.ndarray]
    exponent_errors: np.ndarray
    interfaces: np.ndarray

    @property
    def cracks(self) -> np.ndarray:
        """(tips,): whether stresses go with r^(-1/2), as at a crack, so that there is an energy release
        rate.
        """
        return (np.abs(self.exponents - 0.5) <= CRACK).all(axis=1)

    def units(self, tip: str) -> tuple[str, str]:
        """Of K_I and K_II of a tip."""
        powers = 1.0 - self.exponents[self.names.index(tip)]
        one, two = ("Pa m^(1/2)" if abs(p - 0.5) <= CRACK else f"Pa m^{p:.6g}" for p in powers)
        return one, two

    def evaluate(self, owned: np.ndarray, more: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from this rank's displacement unknowns and what tractions
        on the faces inside the tip elements add, (2 tips,). Collective.
        """
        values = (self.rows(owned) + more).reshape(-1, 2)
        return {name: (float(one), float(two)) for name, (one, two) in zip(self.names, values)}


def tip_places(model) -> list[TipPlace]:
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


def tip_intensities(model) -> TipIntensities:
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
                contact[2 * number : 2 * number + 2, faces.contact] = columns[number][:, : faces.modes]
    exponents, contact, errors, interfaces = (
        model.comm.allreduce(array) for array in (exponents, contact, errors, interfaces)
    )
    gathered = Rows.gathered(model.comm, model.ranges, flat_entries(rows), 2 * len(tips))
    names = tuple(tip.name for tip in tips)
    return TipIntensities(names, exponents, gathered, contact, columns, errors, interfaces > 0.0)
