"""Stress intensity factors of all crack tips as linear forms of the displacements."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..parallel import collective
from ..selement.coefficients import SElementError
from ..selement.intensity import intensity_rows
from .rows import Rows
from .shapes import Group


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
    """

    names: tuple[str, ...]
    exponents: np.ndarray
    rows: Rows

    def evaluate(self, owned: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from this rank's displacement unknowns. Collective."""
        values = self.rows(owned).reshape(-1, 2)
        return {name: (float(one), float(two)) for name, (one, two) in zip(self.names, values)}


def tip_places(model) -> list[TipPlace]:
    """The tip elements that this rank holds."""
    row_of = {int(element): row for row, element in enumerate(model.part.elements)}
    places = []
    for number, tip in enumerate(model.tip_elements):
        row = row_of.get(int(tip.element), -1)
        if row >= 0:
            group = next(g for g in model.groups if (g.elements == row).any())
            places.append(TipPlace(number, group, int(np.flatnonzero(group.elements == row)[0])))
    return places


def tip_intensities(model) -> TipIntensities:
    """The forms of a model. Collective."""
    tips = model.tip_elements
    exponents = np.zeros((len(tips), 2))
    rows = {}
    with collective(model.comm):  # the rank that owns a tip must not fail alone
        for number, group, member in tip_places(model):
            tip, rotation, size = tips[number], group.rotations[member], group.sizes[member]
            material = model.materials[group.material]
            try:
                form = intensity_rows(
                    group.solution.radial,
                    group.shape,
                    group.order,
                    material.elasticity,
                    rotation @ np.array(tip.axis),
                    material.isotropic,
                )
            except SElementError as error:
                raise SElementError(f"tip {tip.name}: {error}") from None
            # lengths of the form are in units of the size, stresses of the modulus; a reflection turns the
            # sense of sliding
            scale = (
                material.modulus
                * size ** -np.nan_to_num(form.exponents, nan=1.0)
                * np.array([1.0, np.linalg.det(rotation)])
            )
            turned = (form.rows.reshape(2, -1, 2) @ rotation).reshape(2, -1) * scale[:, None]
            unknowns = model.part.unknowns[group.nodes[member]].ravel()
            rows |= {2 * number + k: (unknowns, turned[k]) for k in (0, 1)}
            exponents[number] = form.exponents
    exponents = model.comm.allreduce(exponents)
    gathered = Rows.gathered(model.comm, model.ranges, rows, 2 * len(tips))
    return TipIntensities(tuple(tip.name for tip in tips), exponents, gathered)
