"""MED files (.med) of Salome and code_aster through meshio; runs in the child process only.

Groups of plane cells are materials, of line cells curves; groups of nodes are points or, of several nodes,
the curve of the outline's edges between them. meshio gives families, of which each is of several groups.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.gmsh.foreign import described, ends_first, sorted_groups
from meshing.gmsh.foreign.vtk import PLANE, read_by_meshio

_LINES = ("line", "line3")


def load() -> None:
    """Load meshio and what it loads late, while this process may still do so."""
    import h5py  # noqa: F401
    import meshio  # noqa: F401


def extract(*, file: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; `options` are those of `meshing.gmsh.foreign.described`.

    Raises
    ------
    Refusal
        meshio cannot read it, or it is no plane mesh.
    """
    mesh, nodes = read_by_meshio(file, (*_LINES, "vertex"))
    elements: dict[int, tuple[int, list[int]]] = {}
    element_groups: dict[str, list[int]] = {name: [] for name in _names(mesh.cell_tags)}
    node_groups: dict[str, list[int]] = {name: [] for name in _names(mesh.point_tags)}
    families = mesh.cell_data.get("cell_tags", [np.zeros(len(block.data), int) for block in mesh.cells])
    for block, own in zip(mesh.cells, families):
        for cell, family in zip(np.asarray(block.data).tolist(), np.ravel(own).tolist()):
            label, kind = len(elements), block.type
            dimension = 2 if kind in PLANE else 1 if kind in _LINES else 0
            elements[label] = dimension, cell
            for name in mesh.cell_tags.get(family, ()):
                element_groups[name.strip(" \0")].append(label)
    for node, family in enumerate(np.ravel(mesh.point_data.get("point_tags", ())).tolist()):
        for name in mesh.point_tags.get(family, ()):
            node_groups[name.strip(" \0")].append(node)
    groups = sorted_groups(ends_first(elements, nodes), element_groups, node_groups)
    return described(nodes, *groups, **options)


def _names(families: dict[int, list[str]]) -> list[str]:
    return [name.strip(" \0") for names in families.values() for name in names]
