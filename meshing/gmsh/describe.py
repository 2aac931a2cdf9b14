"""What gmsh's present model holds, as plain data."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.gll import gll_nodes
from meshing.gmsh.model import Block, FileModel

WHOLE = "selement:"  # a physical surface of this name: each of its surfaces is one S-element
MATERIAL = "material"
KIND = ("point", "curve", "surface", "volume")
NO_SIZE = 1e21  # gmsh's "no size given" is 1e22

Groups = list[list[Any]]  # [dimension, name, entities] of each physical group


def physical_groups(gmsh: Any) -> Groups:
    """The physical groups of points, curves and surfaces; one without a name is called by its tag."""
    groups = []
    for dimension, tag in gmsh.model.getPhysicalGroups():
        if dimension <= 2:
            name = gmsh.model.getPhysicalName(dimension, tag) or f"{KIND[dimension]}{tag}"
            entities = {abs(int(e)) for e in gmsh.model.getEntitiesForPhysicalGroup(dimension, tag)}
            groups.append([dimension, name, sorted(entities)])
    return groups


def whole_surfaces(groups: Groups) -> list[int]:
    """Surfaces that are one S-element each."""
    found = [e for d, name, entities in groups if d == 2 and name.startswith(WHOLE) for e in entities]
    return list(dict.fromkeys(found))


def node_positions(gmsh: Any) -> np.ndarray:
    """Positions by node tag, (highest tag + 1, 3)."""
    tags, positions, _ = gmsh.model.mesh.getNodes()
    where = np.full((int(max(tags, default=0)) + 1, 3), np.nan)
    where[np.asarray(tags, np.int64)] = np.reshape(positions, (-1, 3))
    return where


def signed_curves(gmsh: Any, surface: int) -> list[int]:
    """The curves around a surface in the sense of going round, negative where they run the other way."""
    found = gmsh.model.getBoundary([(2, surface)], combined=False, oriented=True)
    return [int(curve) for _, curve in found]


def line_ends(gmsh: Any, curve: int) -> np.ndarray:
    """Node tags of the ends of the lines on a curve, (n, 2)."""
    blocks = element_blocks(gmsh, 1, [curve])
    return np.vstack([np.zeros((0, 2), np.int64), *(block.nodes[:, :2] for block in blocks)])


def described(gmsh: Any, groups: Groups, order: int, geometry: bool) -> FileModel:
    """The meshed model by few calls.

    Parameters
    ----------
    gmsh : module
    groups : list
        From `physical_groups`.
    order : int
        Order of the S-elements' edges.
    geometry : bool
        gmsh has meshed a geometry: its points have sizes, its curves a shape.
    """
    tags, positions, _ = gmsh.model.mesh.getNodes()
    points = _point_nodes(gmsh)
    curves, surfaces = ([tag for _, tag in gmsh.model.getEntities(d)] for d in (1, 2))
    whole: dict[int, list[int] | None] = dict.fromkeys(whole_surfaces(groups))
    lines, sizes = None, {}
    shapes: dict[str, Any] = {}
    if geometry:
        surfaces = [tag for tag in surfaces if tag not in whole]
        lines = _line_blocks(gmsh, curves, {node for nodes in points.values() for node in nodes})
        whole = {tag: signed_curves(gmsh, tag) for tag in whole}
        given = gmsh.model.mesh.getSizes([(0, tag) for tag in points]) if whole else ()
        sizes = {node: float(h) for tag, h in zip(points, given) if 0 < h < NO_SIZE for node in points[tag]}
        shapes = _true_curves(gmsh, order, curves, points)
    blocks = (element_blocks(gmsh, 1, curves) if lines is None else lines) + element_blocks(gmsh, 2, surfaces)
    tags, where = np.asarray(tags, np.int64), np.reshape(positions, (-1, 3))
    return FileModel(geometry, groups, blocks, tags, where, points, whole=whole, sizes=sizes, **shapes)


def element_blocks(gmsh: Any, dimension: int, entities: list[int]) -> list[Block]:
    """Elements of each type in each entity."""
    blocks: list[Block] = []
    for entity in entities:
        for kind, _, nodes in zip(*gmsh.model.mesh.getElements(dimension, entity)):
            name, _, order, count, _, corners = gmsh.model.mesh.getElementProperties(kind)
            table = np.asarray(nodes, np.int64).reshape(-1, count)
            blocks.append(Block(dimension, entity, name, order, corners, table))
    return blocks


def _point_nodes(gmsh: Any) -> dict[int, list[int]]:
    """Node tags of each point."""
    return {tag: gmsh.model.mesh.getNodes(0, tag)[0].tolist() for _, tag in gmsh.model.getEntities(0)}


def _line_blocks(gmsh: Any, curves: list[int], ends: set[int]) -> list[Block] | None:
    """Blocks of curves that are one straight element each, all at once; None where there are others."""
    kinds, _, nodes = gmsh.model.mesh.getElements(1)
    if list(kinds) != [1] or len(nodes[0]) != 2 * len(curves) or not ends >= set(nodes[0].tolist()):
        return None
    lines = np.reshape(nodes[0], (-1, 1, 2)).astype(np.int64)
    return [Block(1, tag, "Line 2", 1, 2, line) for tag, line in zip(curves, lines)]


def _true_curves(
    gmsh: Any, order: int, curves: list[int], points: dict[int, list[int]]
) -> dict[str, np.ndarray]:
    """GLL nodes of the line elements on curved geometry by its parametrisation."""
    at = 0.5 * (gll_nodes(order) + 1.0)
    ends_of, points_of = [np.zeros((0, 2), np.int64)], [np.zeros((0, order + 1, 2))]
    for curve in curves:
        straight = gmsh.model.getType(1, curve) in ("Line", "Discrete curve")
        if straight or not (used := set(line_ends(gmsh, curve).ravel().tolist())):
            continue
        # Not combined: gmsh would leave out the point at which a closed curve starts and ends.
        (_, first), (_, last) = gmsh.model.getBoundary([(1, curve)], combined=False, oriented=False)
        tags, _, parameters = gmsh.model.mesh.getNodes(1, curve, returnParametricCoord=True)
        inner = sorted((p, tag) for p, tag in zip(parameters.tolist(), tags.tolist()) if tag in used)
        nodes = np.array([*points[first], *(tag for _, tag in inner), *points[last]], np.int64)
        low, high = (float(bound[0]) for bound in gmsh.model.getParametrizationBounds(1, curve))
        places = np.array([low, *(p for p, _ in inner), high])
        where = places[:-1, None] + at * np.diff(places)[:, None]
        values = np.array(gmsh.model.getValue(1, curve, where.ravel()))
        ends_of.append(np.stack([nodes[:-1], nodes[1:]], axis=1))
        points_of.append(values.reshape(len(where), order + 1, 3)[..., :2])
    return {"curved_ends": np.vstack(ends_of), "curved_points": np.concatenate(points_of)}
