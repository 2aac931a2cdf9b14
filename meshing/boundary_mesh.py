"""The boundary mesh: plain arrays that describe S-elements, contact pairs and named sets, with its files."""

from __future__ import annotations

import os
from dataclasses import dataclass

from meshing import mesh_files, mesh_summary
from meshing.contact_checks import check_contents
from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip

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
