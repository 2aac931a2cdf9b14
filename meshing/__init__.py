"""Geometry to boundary meshes for the scaled boundary finite element method: beams and plates with notches,
cracks and holes, and gmsh models.
"""

from __future__ import annotations

from typing import Any

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


def __getattr__(name: str) -> Any:
    from .lazily import loaded  # at the start it would wait for this package, and be waited for

    return loaded(__name__, _HOME)[0](name)


def __dir__() -> list[str]:
    return sorted(__all__)
