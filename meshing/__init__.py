"""Geometry to boundary meshes for the scaled boundary finite element method: beams and plates with notches,
cracks and holes, and gmsh models.
"""

from __future__ import annotations

from .lazily import loaded

# Public names by the module they stand in.
_HOME = {
    "beam": ("Beam",),
    "boundary_mesh": ("BoundaryMesh",),
    "mesh_arrays": ("ContactPairs", "Crack", "Tip"),
    "shapes.features": ("CrackLine", "Hole", "VNotch"),
    "warnings": ("GmshWarning", "UnitWarning"),
    "plate": ("Plate",),
    "gmsh.reader": ("read_gmsh",),
}

__all__ = [name for names in _HOME.values() for name in names]

__getattr__, __dir__ = loaded(__name__, _HOME)
