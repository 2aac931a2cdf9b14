"""The boundary mesh: plain arrays that describe S-elements, contact pairs and named sets, with its files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from meshing import mesh_files
from meshing.mesh_arrays import ContactPairs, Crack, MeshArrays, Tip

__all__ = ["BoundaryMesh", "ContactPairs", "Crack", "Tip"]


@dataclass(frozen=True, eq=False, repr=False)
class BoundaryMesh(MeshArrays):
    """S-elements given by their boundary edges alone; `MeshArrays` describes the arrays."""

    def save(self, path: str | Path) -> None:
        """Write to an HDF5 file; an existing file is replaced only once the new one is complete. See
        `meshing.mesh_files`.
        """
        mesh_files.save(self, path)

    @classmethod
    def load(cls, path: str | Path) -> BoundaryMesh:
        """Read what `save` has written; ValueError if the file is missing, truncated or something else."""
        return mesh_files.load(path, cls)

    def export(self, path: str | Path) -> None:
        """Write the edges as polylines through their nodes in any format meshio writes (.vtu, .vtk, .xdmf
        ...). See `meshing.mesh_files`.
        """
        mesh_files.export(self, path)
