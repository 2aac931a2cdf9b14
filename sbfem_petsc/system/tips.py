"""Stress intensity factors of all crack tips from nodal displacements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..parallel import collective
from ..petsc import MPI
from ..selement.coefficients import SElementError
from ..selement.intensity import intensity_rows


@dataclass(frozen=True, eq=False)
class _TipRow:
    tip: int
    nodes: np.ndarray
    rows: np.ndarray


class TipIntensities:
    """K_I and K_II of every tip with an element around it, linear in the nodal displacements.

    Attributes
    ----------
    names : tuple of str
        Tips that have an element.
    exponents : (tips, 2) array
        Exponents lambda of the displacement modes; the unit of K is Pa m^(1 - lambda), Pa m^(1/2) at a crack.
    """

    def __init__(self, model):
        self.comm = model.comm
        tips = [tip for tip in model.crack_tips if tip.element >= 0]
        self.names = tuple(tip.name for tip in tips)
        self._local: list[_TipRow] = []
        exponents = np.zeros((len(self.names), 2))
        place = {int(element): row for row, element in enumerate(model.part.elements)}
        with collective(self.comm):  # the rank that owns a tip must not fail alone
            for index, tip in enumerate(tips):
                row = place.get(int(tip.element), -1)
                if row < 0:
                    continue
                group, member = next(
                    (g, int(np.flatnonzero(g.elements == row)[0]))
                    for g in model.groups
                    if (g.elements == row).any()
                )
                rotation, size, material = (
                    group.rotations[member],
                    group.sizes[member],
                    model.materials[group.material],
                )
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
                # lengths of the form are in units of the size, stresses of the modulus; a reflection turns
                # the sense of sliding
                scale = (
                    material.modulus
                    * size ** -np.nan_to_num(form.exponents, nan=1.0)
                    * np.array([1.0, np.linalg.det(rotation)])
                )
                turned = form.rows.reshape(2, -1, 2) @ rotation
                self._local.append(_TipRow(index, group.nodes[member], scale[:, None, None] * turned))
                exponents[index] = form.exponents
        self.exponents = self.comm.allreduce(exponents)

    def evaluate(self, field: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from the displacements (m, 2) of this rank's nodes.
        Collective.
        """
        values = np.zeros((len(self.names), 2))
        for row in self._local:
            values[row.tip] = np.einsum("kni,ni->k", row.rows, field[row.nodes])
        self.comm.Allreduce(MPI.IN_PLACE, values)
        return {name: (float(a), float(b)) for name, (a, b) in zip(self.names, values)}
