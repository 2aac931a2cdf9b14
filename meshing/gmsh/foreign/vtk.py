"""VTK files (.vtu, .vtk) through meshio; runs in the child process only.

They know no names: cells are put into materials by whole-numbered cell data called "material",
"gmsh:physical", "CellEntityIds" or "medit:ref".
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

import numpy as np

from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign import described

PLANE = ("triangle", "triangle6", "quad", "quad8", "quad9")  # meshio's names
_IGNORED = ("vertex", "line", "line3")
_MATERIALS = ("material", "gmsh:physical", "CellEntityIds", "medit:ref")


def load() -> None:
    """Load meshio and what it loads late, while this process may still do so."""
    import xml.etree.ElementTree  # noqa: F401

    import meshio  # noqa: F401


def extract(*, file: str, **options: Any) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read a mesh; `options` are those of `meshing.gmsh.foreign.described`.

    Raises
    ------
    Refusal
        meshio cannot read it, or it is no plane mesh.
    """
    mesh, nodes = read_by_meshio(file, _IGNORED)
    key = next((key for key in _MATERIALS if key in mesh.cell_data), None)
    numbers = mesh.cell_data[key] if key else [None] * len(mesh.cells)
    groups: dict[tuple[int, str], list[list[int]]] = {}
    for block, values in zip(mesh.cells, numbers):
        if block.type in _IGNORED:
            continue
        names = ["material"] * len(block.data)
        if values is not None:
            names = [f"material{int(value)}" for value in np.ravel(values)]
        for name, cell in zip(names, np.asarray(block.data).tolist()):
            groups.setdefault((2, name), []).append(cell)
    return described(nodes, groups, {}, **options)


def read_by_meshio(file: str, others: tuple[str, ...]) -> tuple[Any, dict[int, list[float]]]:
    """What meshio reads, and places (x, y, z) of its nodes; a Refusal of cells that are neither plane nor of
    some other kinds, and of what it cannot read.
    """
    import meshio

    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed):  # where meshio says what it does not understand
            mesh = meshio.read(file)
    except (Exception, SystemExit) as error:  # meshio's readers raise what they like
        why = " ".join((printed.getvalue().strip() or str(error)).split())
        raise Refusal(
            f"meshio cannot read it ({why}); mend the file, or export it with triangles and quadrilaterals "
            "of 3, 4, 6 or 8 nodes, or by gmsh as .msh."
        ) from error
    for block in mesh.cells:
        if block.type not in (*PLANE, *others):
            raise Refusal(
                f"it holds {len(block.data)} cells of type {block.type!r}, a plane mesh of triangles and "
                "quadrilaterals was expected."
            )
    positions = np.zeros((len(mesh.points), 3))
    positions[:, : mesh.points.shape[1]] = mesh.points
    return mesh, dict(enumerate(positions.tolist()))
