"""T-stress of crack tips as linear forms of the displacements."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from ...material import SectorMaterials
from ...selement.fracture import TStressRow, t_stress_row
from .tip_faces import TipElement, TipFaces

# T of a tip, Pa: row (n, 2) for displacements of the nodes of its S-element, m, and columns (modes,) for the
# forces of its traction modes, N.
TStressForm = tuple[np.ndarray, np.ndarray]


def t_stress_forms(
    places: list[TipElement], faces_of: Mapping[int, TipFaces], thickness: float
) -> dict[int, TStressForm]:
    """By the numbers of the tips that this rank holds; open notches and interfaces have no T."""
    found, known = dict[int, TStressForm](), dict[tuple, TStressRow | None]()
    for place in places:
        material, faces = place.material, faces_of.get(place.number)
        if isinstance(material, SectorMaterials):
            continue
        form = place.shared(known, partial(_form, place), *np.round(place.axis, 12))
        if form is None:
            continue
        row, columns = form.placed(place.rotation, place.size, material.modulus), np.zeros(0)
        if faces is not None:
            columns = form.of_tractions(faces.tractions) / (place.size * thickness)
        found[place.number] = row, columns
    return found


def _form(place: TipElement) -> TStressRow | None:
    """Of the reference shape."""
    group = place.group
    return t_stress_row(group.solution.radial_form, group.shape, place.material.elasticity, place.axis)
