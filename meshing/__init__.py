"""Geometry to boundary meshes for the scaled boundary finite element method: beams with notches and holes,
and gmsh models.
"""

from meshing.beam import Beam
from meshing.boundary_mesh import BoundaryMesh, ContactPairs, Crack
from meshing.gmsh.reader import read_gmsh
from meshing.shapes.features import Hole, VNotch

__all__ = ["Beam", "BoundaryMesh", "ContactPairs", "Crack", "Hole", "VNotch", "read_gmsh"]
