"""Stress intensity factors of all crack tips as linear forms of the displacements."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...material import SectorMaterials
from ...ranks.parallel import collective
from ...selement.intensity import IntensityRows, intensity_rows
from ..elements.elements import Elements
from ..layout.layout import Layout
from ..layout.rows import Rows
from .tip_faces import TipElement, TipFaces
from .tip_facts import TipFacts

# Length at which stress intensity factors of a crack along an interface are taken, m: K_I + i K_II is then
# Rice's complex K in SI units.
REFERENCE_LENGTH = 1.0


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
    errors : (tips, 2) array
        Relative ones of what has K_I or K_II alone.
    local : dict of int to ((n,) int array, (2, 2 n) array)
        By the numbers of the tips that this rank holds: its nodes of their S-elements, and the two rows for
        their displacements.
    """

    rows: Rows
    contact: np.ndarray
    faces: dict[int, np.ndarray]
    errors: np.ndarray
    local: dict[int, tuple[np.ndarray, np.ndarray]]

    @property
    def facts(self) -> TipFacts:
        """What the tips are, without the forms."""
        return TipFacts(self.names, self.exponents, self.interfaces, self.contact_rows)

    def rows_on(self, layout: Layout) -> Rows:
        """The rows over the unknowns of a layout: of displacements, or of what supports hold. Collective."""
        return rows_on(layout, self.local)

    def evaluate(self, owned: np.ndarray, more: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from this rank's displacement unknowns and what tractions
        on the faces inside the tip elements add, (2 tips,). Collective.
        """
        values = (self.rows(owned) + more).reshape(-1, 2)
        return {name: (float(one), float(two)) for name, (one, two) in zip(self.names, values)}


def tip_intensities(
    elements: Elements,
    places: list[TipElement],
    faces_of: Mapping[int, TipFaces],
    first_rows: np.ndarray,
    count: int,
) -> TipIntensities:
    """The forms of the tips of a structure with so many contact rows. Collective."""
    layout = elements.layout
    tips = layout.tip_elements
    (exponents, errors), interfaces = np.zeros((2, len(tips), 2)), np.zeros(len(tips))
    contact = np.zeros((2 * len(tips), count))
    local: dict[int, tuple[np.ndarray, np.ndarray]] = {}
    columns: dict[int, np.ndarray] = {}
    known: dict[tuple, IntensityRows] = {}
    with collective(layout.comm):  # the rank that owns a tip must not fail alone
        for place in places:
            number, material = place.number, place.material
            several = isinstance(material, SectorMaterials)
            form = place.shared(
                known,
                partial(_form, place),
                *np.round(place.axis, 12),
                place.size if several else 0.0,  # exponents are complex
            )
            placed = form.placed(place.rotation, place.size, material.modulus).reshape(2, -1)
            local[number] = (place.nodes, placed)
            exponents[number], interfaces[number] = form.exponents, several
            errors[number] = form.errors
            if faces := faces_of.get(number):
                columns[number] = form.placed_of_tractions(
                    faces.tractions, place.rotation, place.size, elements.thickness
                )
                faces.place(contact[2 * number : 2 * number + 2], columns[number])
    exponents, contact, errors, interfaces = (
        layout.comm.allreduce(array) for array in (exponents, contact, errors, interfaces)
    )
    names = tuple(tip.name for tip in tips)
    facts = names, exponents, interfaces > 0.0, first_rows
    return TipIntensities(*facts, rows_on(layout, local), contact, columns, errors, local)


def _form(place: TipElement) -> IntensityRows:
    """Of the reference shape."""
    radial, length = place.group.solution.radial_form, REFERENCE_LENGTH / place.size
    return intensity_rows(radial, place.sectors, place.axis, reference_length=length)


def rows_on(layout: Layout, local: dict[int, tuple[np.ndarray, np.ndarray]]) -> Rows:
    """The rows of `TipIntensities.local` over the unknowns of a layout. Collective."""
    blocks = [
        (2 * number + np.arange(2), layout.part.unknowns[nodes].ravel(), placed)
        for number, (nodes, placed) in local.items()
    ]
    return Rows.gathered(layout.comm, layout.ranges, blocks, 2 * len(layout.tip_elements))
