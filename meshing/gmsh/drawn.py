"""Drawings through gmsh: meshed in memory, or written as a file that gmsh opens and `read_gmsh` reads."""

from __future__ import annotations

import os
from pathlib import Path

from meshing.cells.complex import CellComplex
from meshing.geometry.drawing import Drawing
from meshing.gmsh.building import cells_of
from meshing.gmsh.describe import describe
from meshing.gmsh.discretise import OPTIONS, boundary_discretisation
from meshing.gmsh.draw import draw_geometry
from meshing.gmsh_session import gmsh_session
from meshing.input_checks import path as checked_path
from meshing.whole_file import replaced

ENDING = ".geo_unrolled"


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
        found = describe(gmsh, groups, order, True)
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
