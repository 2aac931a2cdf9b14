"""T-stress of crack tips as linear forms of the displacements."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...material import SectorMaterials
from ...selement.fracture import t_stress_row
from ..elements.elements import Elements
from .tip_faces import TipFaces, TipPlace


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


def t_stress_forms(elements: Elements, places: list[TipPlace], faces_of: list[TipFaces]) -> list[TStressForm]:
    """Those of the tips that this rank holds, but for open notches and interfaces, which have no T."""
    found = []
    tractions = {faces.number: faces for faces in faces_of}
    for number, group, member in places:
        material, rotation, size = (
            elements.materials[group.material],
            group.rotations[member],
            float(group.sizes[member]),
        )
        if isinstance(material, SectorMaterials):
            continue
        axis = rotation @ np.array(elements.layout.tip_elements[number].axis)
        form = t_stress_row(group.solution.radial, group.shape, material.elasticity, axis)
        if np.isnan(form.row).any():
            continue
        faces, columns = tractions.get(number), np.zeros(0)
        if faces is not None:
            columns = form.of_tractions(faces.tractions) / (size * elements.thickness)
        row = form.placed(rotation, size, material.modulus)
        found.append(TStressForm(number, group.nodes[member], row, faces, columns))
    return found
