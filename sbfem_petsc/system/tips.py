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
    crack: int
    nodes: np.ndarray
    rows: np.ndarray


class TipIntensities:
    """K_I and K_II of every crack with a tip element, linear in the nodal displacements.

    Attributes
    ----------
    names : tuple of str
        Cracks that have a tip element.
    exponents : (cracks, 2) array
        Exponents lambda of the displacement modes; the unit of K is Pa m^(1 - lambda), Pa m^(1/2) at a crack.
    """

    def __init__(self, model):
        self.comm = model.comm
        cracks = [c for c in model.cracks if c.tip_element >= 0]
        self.names = tuple(c.name for c in cracks)
        self._local: list[_TipRow] = []
        exponents = np.zeros((len(self.names), 2))
        place = {int(element): row for row, element in enumerate(model.part.elements)}
        with collective(self.comm):  # the rank that owns a tip must not fail alone
            for index, crack in enumerate(cracks):
                row = place.get(int(crack.tip_element), -1)
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
                        rotation @ np.array(crack.axis),
                        material.isotropic,
                    )
                except SElementError as error:
                    raise SElementError(f"tip of {crack.name}: {error}") from None
                placed = form.placed(rotation, size, material.modulus)
                self._local.append(_TipRow(index, group.nodes[member], placed))
                exponents[index] = form.exponents
        self.exponents = self.comm.allreduce(exponents)

    def evaluate(self, field: np.ndarray) -> dict[str, tuple[float, float]]:
        """K_I and K_II of each tip, on all ranks, from the displacements (m, 2) of this rank's nodes.
        Collective.
        """
        values = np.zeros((len(self.names), 2))
        for tip in self._local:
            values[tip.crack] = np.einsum("kni,ni->k", tip.rows, field[tip.nodes])
        self.comm.Allreduce(MPI.IN_PLACE, values)
        return {name: (float(a), float(b)) for name, (a, b) in zip(self.names, values)}
