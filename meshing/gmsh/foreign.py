"""Meshes of other programs through meshio; runs in the child process only.

Abaqus (.inp): sets of elements that hold triangles and quadrilaterals are materials, sets of 2-node elements
are curves; a set of nodes is a point if it has one node, else the curve of the outline's edges between its
nodes. VTK (.vtu, .vtk) knows no names: cells are put into materials by whole-numbered cell data called
"material", "gmsh:physical", "CellEntityIds" or "medit:ref".
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.gmsh.child import Refusal
from meshing.gmsh.size_guard import Guard

# meshio's name: dimension, order, corners
_TYPES = {
    "line": (1, 1, 2),
    "line3": (1, 2, 2),
    "triangle": (2, 1, 3),
    "triangle6": (2, 2, 3),
    "quad": (2, 1, 4),
    "quad8": (2, 2, 4),
    "quad9": (2, 2, 4),
}
_IGNORED = ("vertex",)
_MATERIALS = ("material", "gmsh:physical", "CellEntityIds", "medit:ref")


def load() -> None:
    """Load meshio, while this process may still do so."""
    import meshio  # noqa: F401


def extract(
    *, folder: str, file: str, order: int, size: float | None, most_unknowns: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; the answer is that of `meshing.gmsh.extraction.extract`.

    Raises
    ------
    Refusal
        meshio cannot read it, it is no plane mesh, cells without a material or with two.
    """
    import meshio

    if size is not None:
        raise Refusal("it is a mesh already, size has no meaning for it; leave it out.")
    try:
        mesh = meshio.read(f"{folder}/{file}")
    except (Exception, SystemExit) as error:  # meshio's readers raise what they like
        raise Refusal(f"meshio cannot read it ({' '.join(str(error).split())}); mend the file.") from error
    solid = [block for block in mesh.cells if block.type not in (*_TYPES, *_IGNORED)]
    if solid:
        raise Refusal(
            f"it holds {len(solid[0].data)} cells of type {solid[0].type!r}, a plane mesh of triangles and "
            "quadrilaterals was expected."
        )
    if not any(block.type in _TYPES and _TYPES[block.type][0] == 2 for block in mesh.cells):
        raise Refusal("it has no triangles or quadrilaterals; check that the file is complete.")
    points = np.zeros((len(mesh.points), 3))
    points[:, : mesh.points.shape[1]] = mesh.points
    blocks: list[list] = []
    arrays = {"node_tags": np.arange(len(points)), "node_positions": points}
    entity_of: dict[tuple[int, str], int] = {}
    counts = {3: 0, 4: 0}
    for names, block in zip(_names(mesh), mesh.cells):
        if block.type in _IGNORED:
            continue
        dimension, element_order, corners = _TYPES[block.type]
        for name in np.unique(names):
            chosen = np.asarray(block.data, np.int64)[names == name]
            entity = entity_of.setdefault((dimension, str(name)), len(entity_of) + 1)
            arrays[f"block{len(blocks)}"] = chosen
            blocks.append([dimension, entity, block.type, element_order, corners])
            if dimension == 2:
                counts[corners] += len(chosen)
    Guard(order, most_unknowns).check_cells(counts[3], counts[4])
    told: dict[str, Any] = {
        "geometry": False,
        "unnamed": False,
        "groups": [[dimension, name, [entity]] for (dimension, name), entity in entity_of.items() if name],
        "empty": [],
        "skipped": [],
        "log": [],
        "blocks": blocks,
        "points": {},
    }
    _add_node_sets(mesh, told, arrays, len(entity_of) + 1)
    return told, arrays


def _names(mesh) -> list[np.ndarray]:
    """Name of the group of each cell, by block; empty where a line has none."""
    names = [np.full(len(block.data), "", dtype=object) for block in mesh.cells]
    for name, chosen in mesh.cell_sets.items():
        for of_block, cells in zip(names, chosen):
            cells = np.asarray(cells, np.int64)
            twice = [other for other in of_block[cells] if other]
            if twice:
                raise Refusal(
                    f"a cell is in the sets {twice[0]!r} and {name!r}; it can be of one material only."
                )
            of_block[cells] = name
    for key in _MATERIALS:
        if not mesh.cell_sets and key in mesh.cell_data:
            names = [
                np.array([f"material{int(v)}" for v in np.ravel(d)], object) for d in mesh.cell_data[key]
            ]
            break
    plane = [(n, b) for n, b in zip(names, mesh.cells) if b.type in _TYPES and _TYPES[b.type][0] == 2]
    if not any(n.any() for n, _ in plane):
        for of_block, _ in plane:
            of_block[:] = "material"
    for of_block, block in plane:
        lost = np.flatnonzero(of_block == "")
        if len(lost):
            raise Refusal(
                f"cell {lost[0]} of its {block.type} cells is in no set; every cell needs a set, its name is "
                "the material's."
            )
    return names


def _add_node_sets(mesh, told: dict[str, Any], arrays: dict[str, np.ndarray], free: int) -> None:
    """Sets of one node are points, others curves of the outline's edges between their nodes."""
    outline = _outline_edges(mesh)
    for name, nodes in mesh.point_sets.items():
        nodes = np.unique(np.asarray(nodes, np.int64))
        if len(nodes) == 1:
            told["points"][str(free)] = nodes.tolist()
            told["groups"].append([0, name, [free]])
        else:
            edges = outline[np.isin(outline, nodes).all(axis=1)]
            if not len(edges):
                told["empty"].append([1, name])
                continue
            arrays[f"block{len(told['blocks'])}"] = edges
            told["blocks"].append([1, free, "line", 1, 2])
            told["groups"].append([1, name, [free]])
        free += 1


def _outline_edges(mesh) -> np.ndarray:
    """Edges that one cell only has, (n, 2)."""
    edges = [np.zeros((0, 2), np.int64)]
    for block in mesh.cells:
        if block.type in _TYPES and _TYPES[block.type][0] == 2:
            corners = np.asarray(block.data, np.int64)[:, : _TYPES[block.type][2]]
            edges += [corners[:, [i, (i + 1) % corners.shape[1]]] for i in range(corners.shape[1])]
    found, counts = np.unique(np.sort(np.vstack(edges), axis=1), axis=0, return_counts=True)
    return found[counts == 1]
