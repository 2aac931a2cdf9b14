"""Drawings through gmsh: to their boundary discretisation and, in surfaces to be filled, cells; to a file
that gmsh opens and `read_gmsh` reads.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from meshing.cells.complex import CellComplex
from meshing.geometry.drawing import Drawing
from meshing.gmsh import describe
from meshing.gmsh.building import cells_of
from meshing.gmsh.draw import draw_geometry
from meshing.gmsh_session import gmsh_session
from meshing.input_checks import path as checked_path
from meshing.vectors import cross, polygon_area
from meshing.whole_file import replaced

# Quadrilaterals or triangles, and gmsh's algorithm (6 frontal, 5 Delaunay, 1 adaptive): needles between lines
# that meet at a few degrees may be too much for one of them.
_WAYS = ((True, 6), (False, 6), (False, 5), (False, 1))
ENDING = ".geo_unrolled"
# Blossom's repositioning may fold the cells around embedded points over each other.
OPTIONS = {"Mesh.ElementOrder": 1, "Mesh.RecombinationAlgorithm": 0}


def boundary_discretisation(gmsh: Any, size: float | None) -> tuple[describe.Groups, dict[int, int]]:
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
        See `describe.physical_groups`.
    algorithms : dict of int to int
        gmsh's algorithm for each filled surface.

    Raises
    ------
    RuntimeError
        gmsh fails.
    """
    groups = describe.physical_groups(gmsh)
    whole = set(describe.whole_surfaces(groups))
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
        nodes = gmsh.model.mesh.getNodes(2, left[0], includeBoundary=True)[1]
        x, y, _ = np.reshape(nodes, (-1, 3)).mean(axis=0)
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


def _covered(gmsh: Any, surface: int) -> bool:
    """Whether the cells of a surface have the area within its outline."""
    where = describe.node_positions(gmsh)
    blocks = describe.element_blocks(gmsh, 2, [surface])
    area = sum(float(np.abs(polygon_area(where[block.nodes])).sum()) for block in blocks)
    curves = describe.signed_curves(gmsh, surface)
    ends = [describe.line_ends(gmsh, abs(tag))[:, :: 1 if tag > 0 else -1] for tag in curves]
    first, last = np.moveaxis(where[np.vstack(ends)], 1, 0)
    wanted = 0.5 * abs(float(cross(first, last).sum()))
    return abs(area - wanted) <= 1e-9 * wanted


def discretised(drawing: Drawing, order: int, origin: str) -> CellComplex:
    """Cells of a drawing, before its cracks are made.

    Parameters
    ----------
    drawing : Drawing
    order : int
        Of the S-elements' edges.
    origin : str
        For messages.

    Raises
    ------
    RuntimeError
        gmsh cannot be loaded or fails.
    """
    with gmsh_session(origin) as gmsh:
        draw_geometry(drawing, gmsh)
        groups, _ = boundary_discretisation(gmsh, drawing.largest)
        found = describe.described(gmsh, groups, order, True)
    return cells_of(found, origin)


def write_drawing(drawing: Drawing, path: str | os.PathLike[str], origin: str) -> None:
    """Write a drawing in m as gmsh's .geo_unrolled.

    Raises
    ------
    ValueError
        Another ending; the file cannot be written.
    RuntimeError
        gmsh cannot be loaded or fails.
    """
    target = Path(checked_path(origin, "path", path))
    if target.suffix != ENDING:
        raise ValueError(
            f"{origin}: the ending of {str(target)!r} is {target.suffix or '(none)'}, {ENDING} was expected: "
            "other formats of gmsh lose arcs or the names of what is drawn."
        )
    with gmsh_session(origin) as gmsh:
        draw_geometry(drawing, gmsh)
        _, algorithms = boundary_discretisation(gmsh, drawing.largest)

        options: dict[str, float] = dict(OPTIONS)
        if drawing.largest is not None:
            options["Mesh.MeshSizeMax"] = drawing.largest
        lines = [f"{name} = {value!r};" for name, value in options.items()]
        lines += [f"MeshAlgorithm Surface {{{tag}}} = {way};" for tag, way in algorithms.items()]
        with replaced(str(target), "drawing") as temporary:
            gmsh.write(temporary)
            file = Path(temporary)
            file.write_text("\n".join([f"// {origin}, m", file.read_text(), *lines, ""]))
