"""Meshes of other programs to a `FileModel`; in the child process only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.model import Block, FileModel
from meshing.gmsh.size_guard import Guard

Groups = Mapping[tuple[int, str], Sequence[Sequence[int]]]
# Dimension and nodes of each element, by its label.
Elements = dict[int, tuple[int, list[int]]]


def described(
    nodes: Mapping[int, Sequence[float]],
    groups: Groups,
    node_sets: Mapping[str, Sequence[int]],
    *,
    size: float | None,
    order: int,
    most_unknowns: int,
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """A plane mesh as another program has written it as a `FileModel`, packed.

    Parameters
    ----------
    nodes : mapping of int to (x, y, z)
        Positions by tag, in the file's unit.
    groups : mapping of (int, str) to sequence of sequence of int
        Elements of each curve (1, name) and each material (2, name): node tags, corners first. An element may
        be of several curves, and of one material.
    node_sets : mapping of str to sequence of int
        Node tags.
    size, order, most_unknowns
        See `meshing.gmsh.extraction.extract`.

    Raises
    ------
    Refusal
        There are no cells, or too many.
    """
    if size is not None:
        raise Refusal("it is a mesh already, size has no meaning for it; leave it out.")
    tags, positions = np.array(list(nodes), np.int64), np.array(list(nodes.values()), float).reshape(-1, 3)
    model = FileModel(False, [], [], tags, positions, {})
    for (dimension, name), elements in groups.items():
        _add(model, dimension, name, elements)
    cells = [(block.nodes, block.corners) for block in model.blocks if block.dimension == 2]
    if not cells:
        raise Refusal("it has no triangles or quadrilaterals; check that the file is complete.")
    Guard(order, most_unknowns).check_cells(model)
    sides = [nodes[:, [i, (i + 1) % corners]] for nodes, corners in cells for i in range(corners)]
    found, uses = np.unique(np.sort(np.vstack(sides), axis=1), axis=0, return_counts=True)
    outline = found[uses == 1]
    for name, labels in node_sets.items():
        tags = np.unique(np.array(labels, np.int64))
        edges = outline[np.isin(outline, tags).all(axis=1)]
        if len(tags) == 1:
            model.points[_add(model, 0, name, ())] = tags.tolist()
        elif len(edges):
            _add(model, 1, name, edges)
        else:
            model.empty.append([1, name])
    return model.packed()


def ends_first(elements: Elements, nodes: Mapping[int, Sequence[float]]) -> Elements:
    """Elements as they are but for lines of three nodes: programs disagree on the place of the middle one."""
    made = dict(elements)
    for label, (dimension, line) in elements.items():
        if dimension == 1 and len(line) == 3:
            where = np.array([nodes[node] for node in line])
            middle = int(np.argmin([np.linalg.norm(where - own, axis=1).max() for own in where]))
            made[label] = 1, [*line[:middle], *line[middle + 1 :], line[middle]]
    return made


def sorted_groups(
    elements: Elements,
    element_groups: Mapping[str, Sequence[int]],
    node_groups: Mapping[str, Sequence[int]],
) -> tuple[dict[tuple[int, str], list[Sequence[int]]], dict[str, Sequence[int]]]:
    """Groups by dimension and name, and sets of nodes, of files that name groups of elements and of nodes:
    those of plane elements are materials ("material" where there are none), of lines curves, of points sets.

    Parameters
    ----------
    elements : mapping of int to (dimension, nodes)
    element_groups, node_groups : mapping of str to sequence of int
        Labels.

    Raises
    ------
    Refusal
        A plane element is of no material or of two, or a group of elements holds none.
    """
    groups: dict[tuple[int, str], list[Sequence[int]]] = {}
    sets = {name: list(labels) for name, labels in node_groups.items()}
    owner: dict[int, str] = {}
    for name, labels in element_groups.items():
        own = [label for label in dict.fromkeys(labels) if label in elements]
        if not own and not sets.get(name):
            raise Refusal(
                f"its group {name!r} holds nothing that is in the file; remove it, or export it again "
                "(points are in those of gmsh with Mesh.SaveGroupsOfNodes = 1)."
            )
        for label in own:
            dimension, nodes = elements[label]
            if dimension == 0:
                sets.setdefault(name, []).extend(nodes)
                continue
            groups.setdefault((dimension, name), []).append(nodes)
            if dimension == 2 and owner.setdefault(label, name) != name:
                raise Refusal(
                    f"element {label} is in the groups {owner[label]!r} and {name!r}; it can be of one "
                    "material only: leave out one of them, or all but lines and one group for each material."
                )
    plane = {label: nodes for label, (dimension, nodes) in elements.items() if dimension == 2}
    if not owner:
        groups[2, "material"] = list(plane.values())
    elif left := [label for label in plane if label not in owner]:
        raise Refusal(f"element {left[0]} is in no group, whose name is the material's; give it one.")
    used = {name for _, name in groups}
    return groups, {name: labels for name, labels in sets.items() if name not in used}


def _add(model: FileModel, dimension: int, name: str, elements: Sequence[Sequence[int]]) -> int:
    """Add a group to a model, elements of one number of nodes together; its entity."""
    entity = len(model.groups) + 1
    model.groups.append([dimension, name, [entity]])
    for count in dict.fromkeys(map(len, elements)):
        corners = 2 if dimension == 1 else 3 if count in (3, 6) else 4
        own = np.array([element for element in elements if len(element) == count], np.int64)
        order = 1 if count == corners else 2
        model.blocks.append(Block(dimension, entity, f"{count} nodes", order, corners, own))
    return entity
