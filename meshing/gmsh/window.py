"""A boundary mesh in gmsh's window."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.boundary_mesh import BoundaryMesh
from meshing.gmsh_session import gmsh_session

# Edges, which gmsh does not draw by itself, with their ends, in a colour for each edge set.
_VIEW = {"Mesh.Lines": 1, "Mesh.LineWidth": 2, "Mesh.Nodes": 1, "Mesh.NodeSize": 3, "Mesh.ColorCarousel": 2}


def show_mesh(mesh: BoundaryMesh) -> None:
    """Show S-elements by their edges, edge sets in colours of their own, until the window is closed; Tools,
    Visibility names sets and points.

    Raises
    ------
    RuntimeError
        gmsh cannot be loaded, or there is no display.
    """
    with gmsh_session("mesh") as gmsh:
        add_mesh(gmsh, mesh)
        for option, value in _VIEW.items():
            gmsh.option.setNumber(option, value)
        try:
            gmsh.fltk.initialize()
        except Exception as error:  # gmsh raises nothing more precise
            raise RuntimeError(
                f"gmsh's window cannot be opened ({' '.join(str(error).split())}); run it where there is a "
                "display, as on a desktop or by ssh -X, or have a picture drawn."
            ) from error
        gmsh.fltk.run()
        gmsh.fltk.finalize()


def add_mesh(gmsh: Any, mesh: BoundaryMesh) -> None:
    """Put a mesh's nodes and edges into gmsh's present model: each set of edges is a curve."""
    named = {name: edges for name, edges in mesh.edge_sets.items() if len(edges)}
    rest = np.setdiff1d(np.arange(len(mesh.edges)), np.concatenate([*named.values(), np.zeros(0, int)]))
    tags = np.arange(1, len(mesh.nodes) + 1)
    places = np.column_stack([mesh.nodes, np.zeros(len(tags))])
    for curve, (name, edges) in enumerate([("", rest), *named.items()], 1):
        gmsh.model.addDiscreteEntity(1, curve)
        if curve == 1:
            gmsh.model.mesh.addNodes(1, curve, tags, places.ravel())
        pieces = np.stack([mesh.edges[edges, :-1], mesh.edges[edges, 1:]], axis=-1)
        gmsh.model.mesh.addElementsByType(curve, 1, [], tags[pieces].ravel())
        if name:
            gmsh.model.addPhysicalGroup(1, [curve], name=name)
            gmsh.model.setEntityName(1, curve, name)
    for point, (name, node) in enumerate(mesh.points.items(), 1):
        gmsh.model.addDiscreteEntity(0, point)
        gmsh.model.mesh.addElementsByType(point, 15, [], [tags[node]])
        gmsh.model.addPhysicalGroup(0, [point], name=name)
        gmsh.model.setEntityName(0, point, name)
