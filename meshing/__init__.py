"""Geometry to boundary meshes for the scaled boundary finite element method: beams and plates with notches,
cracks and holes, and gmsh models.
"""

from __future__ import annotations

from .lazily import loaded

_HOME = {
    "Beam": "beam",
    "BoundaryMesh": "boundary_mesh",
    "ContactPairs": "mesh_arrays",
    "Crack": "mesh_arrays",
    "CrackLine": "shapes.features",
    "GmshWarning": "warnings",
    "Hole": "shapes.features",
    "Plate": "plate",
    "Tip": "mesh_arrays",
    "UnitWarning": "warnings",
    "VNotch": "shapes.features",
    "read_gmsh": "gmsh.reader",
}

__all__ = [*_HOME]

__getattr__, __dir__ = loaded(__name__, _HOME)
