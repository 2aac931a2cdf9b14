"""Meshes of other programs in one form, and what `meshing.gmsh.model` reads of them; in the child process
only.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.size_guard import Guard

# dimension and nodes of an element: its order and corners
KINDS = {
    (1, 2): (1, 2),
    (1, 3): (2, 2),
    (2, 3): (1, 3),
    (2, 6): (2, 3),
    (2, 4): (1, 4),
    (2, 8): (2, 4),
    (2, 9): (2, 4),
}


@dataclass(frozen=True)
class ForeignMesh:
    """A plane mesh as another program has written it.

    Attributes
    ----------
    tags : (n,) int array
        Of the nodes.
    positions : (n, 3) array
        In the file's unit.
    groups : dict of (int, str) to list of list of int
        Elements of each curve (1, name) and each material (2, name): node tags, corners first. An element may
        be of several curves, and of one material.
    node_sets : dict of str to (k,) int array
        Node tags.
    """

    tags: np.ndarray
    positions: np.ndarray
    groups: dict[tuple[int, str], list[list[int]]]
    node_sets: dict[str, np.ndarray] = field(default_factory=dict)


def described(
    mesh: ForeignMesh, *, size: float | None, order: int, most_unknowns: int
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The answer of `meshing.gmsh.extraction.extract`.

    Raises
    ------
    Refusal
        There are no cells, or too many.
    """
    if size is not None:
        raise Refusal("it is a mesh already, size has no meaning for it; leave it out.")
    if not any(dimension == 2 and cells for (dimension, _), cells in mesh.groups.items()):
        raise Refusal("it has no triangles or quadrilaterals; check that the file is complete.")
    told: dict[str, Any] = {
        "geometry": False,
        "unnamed": False,
        "groups": [],
        "empty": [],
        "skipped": [],
        "log": [],
        "merged_step": None,
        "blocks": [],
        "points": {},
    }
    arrays = {"node_tags": mesh.tags, "node_positions": mesh.positions}

    def add(dimension: int, name: str, elements: dict[int, np.ndarray]) -> None:
        entity = len(told["groups"]) + 1
        told["groups"].append([dimension, name, [entity]])
        for count, nodes in elements.items():
            arrays[f"block{len(told['blocks'])}"] = nodes
            told["blocks"].append([dimension, entity, f"{count} nodes", *KINDS[dimension, count]])

    counts, sides = {3: 0, 4: 0}, [np.zeros((0, 2), np.int64)]
    for (dimension, name), elements in mesh.groups.items():
        by_count = _by_count(elements)
        add(dimension, name, by_count)
        for count, nodes in by_count.items() if dimension == 2 else ():
            corners = KINDS[2, count][1]
            counts[corners] += len(nodes)
            sides += [nodes[:, [i, (i + 1) % corners]] for i in range(corners)]
    Guard(order, most_unknowns).check_cells(counts[3], counts[4])
    found, uses = np.unique(np.sort(np.vstack(sides), axis=1), axis=0, return_counts=True)
    outline = found[uses == 1]
    for name, tags in mesh.node_sets.items():
        tags = np.unique(tags)
        if len(tags) == 1:
            told["points"][str(len(told["groups"]) + 1)] = tags.tolist()
            add(0, name, {})
            continue
        edges = outline[np.isin(outline, tags).all(axis=1)]
        if len(edges):
            add(1, name, {2: edges})
        else:
            told["empty"].append([1, name])
    return told, arrays


def _by_count(elements: list[list[int]]) -> dict[int, np.ndarray]:
    """Elements of one number of nodes together."""
    rows: dict[int, list[list[int]]] = {}
    for element in elements:
        rows.setdefault(len(element), []).append(element)
    return {count: np.array(nodes, np.int64) for count, nodes in rows.items()}
