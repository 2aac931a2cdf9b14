"""Drawings through gmsh: meshed in memory, or written as a file that gmsh opens and `read_gmsh` reads."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from meshing.geometry.drawing import Drawing
from meshing.gmsh.building import Builder
from meshing.gmsh.describe import describe
from meshing.gmsh.discretise import OPTIONS, boundary_discretisation
from meshing.gmsh.draw import draw_geometry
from meshing.gmsh.model import from_answer
from meshing.gmsh_session import gmsh_session
from meshing.input_checks import path as checked_path
from meshing.shapes.features import CrackLine
from meshing.whole_file import replaced

ENDING = ".geo_unrolled"


def cells_of(drawing: Drawing, order: int, origin: str) -> Builder:
    """Cells, lines of cracks and points of a drawing.

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
        told, arrays = describe(gmsh, groups, order, True)
    return Builder(from_answer(told, arrays, 1.0), origin)


def refuse_openings(origin: str, cracks: Mapping[str, CrackLine]) -> None:
    """ValueError for a crack that stands open, which the drawing of its line would not say."""
    for name, crack in cracks.items():
        if crack.opening:
            raise ValueError(
                f"{origin}: crack {name!r} has the opening {crack.opening:g} degrees, which a line in a gmsh "
                "model does not carry; write it with 0, or draw its two faces as part of the outline."
            )


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
