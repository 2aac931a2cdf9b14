"""Geometry to boundary meshes for the scaled boundary finite element method: beams and plates with notches,
cracks and holes, and gmsh models.
"""

from meshing.beam import Beam
from meshing.boundary_mesh import BoundaryMesh, ContactPairs, Crack, Tip
from meshing.gmsh.reader import read_gmsh
from meshing.gmsh.report import GmshWarning
from meshing.plate import Plate
from meshing.shapes.features import CrackLine, Hole, VNotch

__all__ = [
    "Beam",
    "BoundaryMesh",
    "ContactPairs",
    "Crack",
    "CrackLine",
    "GmshWarning",
    "Hole",
    "Plate",
    "Tip",
    "VNotch",
    "read_gmsh",
]
