"""Geometry to boundary meshes for the scaled boundary finite element method: beams and plates with notches,
cracks and holes, and gmsh models.
"""

from __future__ import annotations

import importlib
from typing import Any

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


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f".{_HOME[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
