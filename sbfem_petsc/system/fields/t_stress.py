"""T-stress of crack tips as linear forms of the displacements."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from ...material import SectorMaterials
from ...selement.fracture import TStressRow, t_stress_row
from .tip_faces import TipElement, TipFaces


class TStressForm(NamedTuple):
    """T of a tip as a linear form, Pa.

    Attributes
    ----------
    number : int
        Of the tip.
    nodes : (n,) int array
        This rank's nodes of its S-element.
    row : (n, 2) array
        For their displacements, m.
    faces : TipFaces or None
    columns : (modes,) array
        For the forces of its traction modes, N.
    """

    number: int
    nodes: np.ndarray
    row: np.ndarray
    faces: TipFaces | None
    columns: np.ndarray


def t_stress_forms(
    places: list[TipElement], faces_of: Mapping[int, TipFaces], thickness: float
) -> list[TStressForm]:
    """Those of the tips that this rank holds, but for open notches and interfaces, which have no T."""
    found, known = [], dict[tuple, TStressRow]()
    for place in places:
        material = place.material
        if isinstance(material, SectorMaterials):
            continue
        form = place.shared(known, partial(_form, place), *np.round(place.axis, 12))
        if np.isnan(form.row).any():
            continue
        faces, columns = faces_of.get(place.number), np.zeros(0)
        if faces is not None:
            columns = form.of_tractions(faces.tractions) / (place.size * thickness)
        row = form.placed(place.rotation, place.size, material.modulus)
        found.append(TStressForm(place.number, place.nodes, row, faces, columns))
    return found


def _form(place: TipElement) -> TStressRow:
    """Of the reference shape."""
    group = place.group
    return t_stress_row(group.solution.radial_form, group.shape, place.material.elasticity, place.axis)
