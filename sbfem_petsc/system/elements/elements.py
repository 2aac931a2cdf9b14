"""The S-elements of a structure: their shapes, materials and matrices, each in its own place."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...material import AnyMaterial
from ..layout.layout import Layout
from ..solve.assembly import ElementBlocks
from .shapes import Group, add_forces, solve_groups, turned_both


class Elements:
    """S-elements with their materials. Collective.

    Parameters
    ----------
    layout : Layout
    materials : sequence of Material
        By the numbers of `Part.materials`.
    thickness : float
        m.
    terms : int
        Of the continued fraction.

    Attributes
    ----------
    groups : list of Group
        Of this rank, with the stiffness alone.
    shapes : int
        Different ones over all ranks.
    unknowns : int
        Displacement unknowns and those auxiliary ones of the continued fraction, of all ranks.
    """

    def __init__(self, layout: Layout, materials: Sequence[AnyMaterial], thickness: float, terms: int):
        self.layout, self.materials, self.thickness, self.terms = layout, list(materials), thickness, terms
        self.groups, self._solutions = solve_groups(layout.comm, layout.part, layout.order, self.materials)
        self.shapes = self._solutions.count
        # a term of the continued fraction has as many unknowns as the S-element's boundary
        auxiliary = terms * sum(2 * group.nodes.size for group in self.groups)
        self.unknowns = layout.count + layout.comm.allreduce(auxiliary)

    @functools.cached_property
    def moving(self) -> list[Group]:
        """The groups with mass and continued fraction, computed when the first analysis asks. Collective."""
        found = self._solutions.inertia(self.terms)
        return [
            replace(group, solution=replace(group.solution, dynamics=inertia))
            for group, inertia in zip(self.groups, found)
        ]

    @functools.cached_property
    def members(self) -> np.ndarray:
        """(e, 2): number of the group of each S-element of this rank, and its row there."""
        result = np.empty((len(self.layout.part.elements), 2), dtype=int)
        for number, group in enumerate(self.groups):
            result[group.elements] = np.stack(
                [np.full(len(group.sizes), number), np.arange(len(group.sizes))], 1
            )
        return result

    def one_of(self, groups: list[Group], row: int) -> Group:
        """A group of one, the S-element of a row of this rank's part; of `groups` or `moving`."""
        number, member = self.members[row]
        return groups[number].select(slice(member, member + 1))

    @property
    def modulus(self) -> float:
        """The largest of the materials', Pa."""
        return max(material.modulus for material in self.materials)

    def unknowns_of(self, group: Group) -> np.ndarray:
        """(k, n) unknowns of the S-elements of a group, -1 where held fixed."""
        return self.layout.part.unknowns[group.nodes].reshape(len(group.sizes), -1)

    def scales(self, group: Group) -> tuple[float, np.ndarray]:
        """Stiffness scale E t (N/m) and inertia scale rho h^2 t (kg), (k,)."""
        material = self.materials[group.material]
        return material.modulus * self.thickness, material.density * group.sizes**2 * self.thickness

    def named_materials(self, number: int) -> tuple[int, ...]:
        """Indices into the mesh's names of an entry of `materials`: one, or that of each edge's sector."""
        count = len(self.layout.material_names)
        return (number,) if number < count else self.layout.compositions[number - count]

    def blocks(self) -> list[ElementBlocks]:
        """Of the stiffness."""
        alike = itertools.groupby(self.groups, key=lambda group: (group.material, len(group.shape)))
        return [self._alike_blocks(list(groups)) for _, groups in alike]

    def _alike_blocks(self, groups: list[Group]) -> ElementBlocks:
        """Those of S-elements of one material and one number of nodes, of however many shapes: what is done
        for each of them at a time takes longer than its numbers.
        """
        nodes = np.concatenate([group.nodes for group in groups])
        rotations = np.concatenate([group.rotations for group in groups])
        of_element = np.repeat(np.arange(len(groups)), [len(group.sizes) for group in groups])
        unknowns, scale = self.layout.part.unknowns[nodes].reshape(len(nodes), -1), self.scales(groups[0])[0]

        def values(part: slice) -> np.ndarray:
            matrices = np.stack([groups[k].solution.stiffness for k in of_element[part]])
            return scale * turned_both(rotations[part], matrices)

        return ElementBlocks(unknowns, unknowns, values)

    def inner_forces(self, field: np.ndarray) -> np.ndarray:
        """(m, 2, ...): this rank's part of the nodal forces that displacements (m, 2, ...) of its nodes take,
        N.
        """
        forces = np.zeros(field.shape)
        for group in self.groups:
            stiffness = self.scales(group)[0] * group.turned_both(group.solution.stiffness)
            add_forces(forces, group.nodes, stiffness, field)
        return forces

    def inertia_forces(self, field: np.ndarray) -> np.ndarray:
        """(m, 2, ...): this rank's part of the nodal forces of inertia under accelerations (m, 2, ...) of its
        nodes that the insides of S-elements follow as they do at rest, N.
        """
        forces = np.zeros(field.shape)
        for group in self.moving:
            mass = self.scales(group)[1][:, None, None] * group.turned_both(group.solution.mass)
            add_forces(forces, group.nodes, mass, field)
        return forces
