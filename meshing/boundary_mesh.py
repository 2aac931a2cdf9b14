"""The boundary mesh: plain arrays that describe S-elements, contact pairs and named sets, with its files."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass, replace

from meshing import mesh_files, mesh_summary
from meshing.contact_checks import check_contents
from meshing.initial_gaps import Gap, gaps_with, remade_with_gap
from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip
from meshing.recipe import Recipe

__all__ = ["BoundaryMesh", "ContactPairs", "Crack", "Tip"]


@dataclass(frozen=True, eq=False, repr=False)
class BoundaryMesh(MeshArrays):
    """S-elements given by their boundary edges alone; `MeshArrays` describes the arrays."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_contents(self)

    def summary(self) -> str:
        """Extent, S-elements, unknowns, materials, edge sets, points, cracks and tips, as a text."""
        return mesh_summary.summary(self)

    def with_gap(self, crack: str, gap: Gap) -> BoundaryMesh:
        """The mesh with other initial gaps between the faces of a crack.

        The faces stay where they are drawn, the contact sees the gap, as in the theory of small
        displacements: a cylinder on a plane is a line between two bodies with the gap ``x**2 / (2 * R)``.
        Inside a tip's S-element the gap runs straight on to the tip.

        Parameters
        ----------
        crack : str
        gap : float, callable or (n,) array
            Distance of the faces along the pairs' normals, m, in place of the drawn one: a number, a function
            of x and y (arrays, m, halfway between the faces) or one value for each of the crack's pairs in
            their order. A finer mesh of the same structure (`sb.estimate`) asks the function again.

        Raises
        ------
        TypeError, ValueError
            The mesh has no such crack; the gaps are no finite numbers >= 0, one for each pair.
        """
        recipe = self.recipe and Recipe(
            functools.partial(remade_with_gap, self.recipe.make, crack, gap), self.recipe.options
        )
        pairs = replace(self.pairs, gap=gaps_with(self, crack, gap))
        return replace(self, pairs=pairs, recipe=recipe)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write to an HDF5 file; an existing file is replaced only once the new one is complete. See
        `meshing.mesh_files`.
        """
        mesh_files.save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> BoundaryMesh:
        """Read what `save` has written; ValueError if the file is missing, truncated or something else."""
        return mesh_files.load(path, cls)

    def export(self, path: str | os.PathLike[str]) -> None:
        """Write the edges as polylines through their nodes in any format meshio writes (.vtu, .vtk, .xdmf
        ...). See `meshing.mesh_files`.
        """
        mesh_files.export(self, path)
