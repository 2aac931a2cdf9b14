"""A drawing in gmsh to its boundary discretisation and, in surfaces to be filled, cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from meshing.gmsh.describe import Groups, line_ends, node_positions, physical_groups, whole_surfaces

# Quadrilaterals or triangles, and gmsh's algorithm (6 frontal, 5 Delaunay, 1 adaptive): needles between lines
# that meet at a few degrees may be too much for one of them.
_WAYS = ((True, 6), (False, 6), (False, 5), (False, 1))
# Blossom's repositioning may fold the cells around embedded points over each other.
OPTIONS = {"Mesh.ElementOrder": 1, "Mesh.RecombinationAlgorithm": 0}
_CORNERS = {2: 3, 3: 4}  # of gmsh's types of cells


def boundary_discretisation(gmsh: Any, size: float | None) -> tuple[Groups, dict[int, int]]:
    """Mesh the curves; mesh the surfaces that are no S-elements as a whole, by the first of gmsh's ways that
    does it.

    Parameters
    ----------
    gmsh : module
        With a drawing.
    size : float or None
        Largest edge in filled surfaces, m.

    Returns
    -------
    groups : list
        See `physical_groups`.
    algorithms : dict of int to int
        gmsh's algorithm for each filled surface.

    Raises
    ------
    RuntimeError
        gmsh fails.
    """
    groups = physical_groups(gmsh)
    whole = set(whole_surfaces(groups))
    ways = {tag: 0 for _, tag in gmsh.model.getEntities(2) if tag not in whole}
    for name, value in OPTIONS.items():
        gmsh.option.setNumber(name, value)
    if size is not None:
        gmsh.option.setNumber("Mesh.MeshSizeMax", size)
    left = list(ways)
    try:
        gmsh.model.mesh.generate(1)
        while left:
            for tag in left:
                quadrilaterals, algorithm = _WAYS[ways[tag]]
                gmsh.model.mesh.setAlgorithm(2, tag, algorithm)
                if not quadrilaterals:
                    gmsh.model.mesh.removeConstraints([(2, tag)])  # setRecombine
            mesh_surfaces(gmsh, list(ways))
            left = [tag for tag in ways if not _covered(gmsh, tag)]
            if any(ways[tag] + 1 == len(_WAYS) for tag in left):
                break
            ways |= {tag: ways[tag] + 1 for tag in left}
            if left:  # all anew, as of the file, which knows of no attempts
                gmsh.model.mesh.clear()
                gmsh.model.mesh.generate(1)
    except Exception as error:  # gmsh raises nothing more precise
        raise RuntimeError(f"gmsh could not mesh the drawing: {error}") from error
    if left:
        x, y = _outline(gmsh, left[0], node_positions(gmsh))[:, 0].mean(axis=0)
        raise RuntimeError(
            f"gmsh's cells around ({x:.6g}, {y:.6g}) m overlap or leave gaps, as they may where lines meet "
            "at a few degrees or pass close to each other; give a smaller size, or move the lines."
        )
    return groups, {tag: _WAYS[way][1] for tag, way in ways.items()}


def mesh_surfaces(gmsh: Any, surfaces: list[int]) -> None:
    """Let gmsh fill some surfaces and no others."""
    others = [(2, tag) for _, tag in gmsh.model.getEntities(2) if tag not in set(surfaces)]
    gmsh.option.setNumber("Mesh.MeshOnlyVisible", 1)
    gmsh.model.setVisibility(others, 0)
    gmsh.model.mesh.generate(2)
    gmsh.model.setVisibility(others, 1)
    gmsh.option.setNumber("Mesh.MeshOnlyVisible", 0)


def _outline(gmsh: Any, surface: int, where: np.ndarray) -> np.ndarray:
    """Ends of the lines around a surface, directed, (n, 2, 2)."""
    curves = [curve for _, curve in gmsh.model.getBoundary([(2, surface)], oriented=True)]
    ends = [
        line_ends(gmsh, abs(curve))[:: 1 if curve > 0 else -1, :: 1 if curve > 0 else -1] for curve in curves
    ]
    return where[np.vstack(ends)][..., :2]


def _covered(gmsh: Any, surface: int) -> bool:
    """Whether the cells of a surface have the area within its outline."""
    where, twice = node_positions(gmsh), 0.0
    for kind, _, nodes in zip(*gmsh.model.mesh.getElements(2, surface)):
        cells = where[np.asarray(nodes, np.int64), :2].reshape(-1, _CORNERS[kind], 2)
        twice += float(np.abs(_cross(cells, np.roll(cells, -1, axis=1)).sum(axis=1)).sum())
    line = _outline(gmsh, surface, where)
    wanted = abs(float(_cross(line[:, 0], line[:, 1]).sum()))
    return abs(twice - wanted) <= 1e-9 * wanted


def _cross(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0]
