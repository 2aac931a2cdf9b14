"""Small bodies that several groups take: coarse meshes, whose numbers are to stay, not to be right."""

from __future__ import annotations

import functools
import pathlib
import tempfile
from collections.abc import Sequence

import numpy as np

import sbfem_petsc as sb
from meshing import Beam, BoundaryMesh, CrackLine, Hole, Plate, VNotch, read_gmsh

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
UNIT = sb.Material(1.0, 0.3, 1.0)
SQUARE = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
WIDE = ((-50.0, -50.0), (50.0, -50.0), (50.0, 50.0), (-50.0, 50.0))


@functools.cache
def beam() -> sb.Model:
    """100 x 20 mm, a notch whose faces meet at a push."""
    shape = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 0.02),))
    return sb.Model(shape.mesh(order=3, face_edges=6), ALUMINIUM, damping=0.01)


@functools.cache
def slit_beam() -> sb.Model:
    """A closed crack, oblique, in the bottom edge, and a hole."""
    shape = Beam(0.1, 0.02, (VNotch(0.05, 0.008, 0.0, 15.0, edge="bottom"),), (Hole(0.08, 0.01, 0.006),))
    return sb.Model(shape.mesh(order=3, face_edges=6), ALUMINIUM, damping=0.01)


@functools.cache
def tilted_beam(tilt: float) -> sb.Model:
    """A notch that leans, wide open."""
    shape = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 4.0, tilt),))
    return sb.Model(shape.mesh(order=3, face_edges=6), ALUMINIUM, damping=0.01)


@functools.cache
def plate(opening: float = 0.0) -> sb.Model:
    """A unit square, held at its lower side, with an oblique crack inside."""
    shape = Plate(SQUARE, cracks=[CrackLine([(0.3, 0.45), (0.65, 0.6)], opening=opening, name="c")])
    return sb.Model(shape.mesh(order=3, face_edges=6, points={"P": (1.0, 1.0)}), UNIT, "edge1", damping=0.02)


@functools.cache
def small_crack(opening: float) -> sb.Model:
    """A crack of half length 1 in a plate of 100, in plane stress."""
    shape = Plate(WIDE, cracks=[CrackLine([(-1.0, 0.0), (1.0, 0.0)], opening=opening, name="c")])
    return sb.Model(shape.mesh(order=4, face_edges=6), UNIT, "edge1")


def drawn(x: tuple[float, ...], y: tuple[float, ...], groups: str) -> BoundaryMesh:
    """The mesh of a grid and physical groups of it, order 3."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "body.geo"
        path.write_text(grid(x, y) + groups)
        return read_gmsh(path, order=3, face_edges=6)


def grid(x: Sequence[float], y: Sequence[float], first: int = 1) -> str:
    """A script of gmsh for a grid of rectangles, which every version meshes alike: one edge a side. Points,
    surfaces and lines, those of rows from right to left before those of columns upwards, are numbered from
    `first` on.
    """
    nx, ny = len(x), len(y)
    points = np.arange(first, first + nx * ny).reshape(ny, nx)
    rows = np.arange(first, first + ny * (nx - 1)).reshape(ny, nx - 1)
    columns = np.arange(first + rows.size, first + rows.size + nx * (ny - 1)).reshape(nx, ny - 1)
    text = [f"Point({points[k, i]}) = {{{x[i]}, {y[k]}, 0}};" for k, i in np.ndindex(ny, nx)]
    text += [
        f"Line({rows[k, i]}) = {{{points[k, i + 1]}, {points[k, i]}}};" for k, i in np.ndindex(ny, nx - 1)
    ]
    text += [
        f"Line({columns[i, k]}) = {{{points[k, i]}, {points[k + 1, i]}}};" for i, k in np.ndindex(nx, ny - 1)
    ]
    for n, (k, i) in enumerate(np.ndindex(ny - 1, nx - 1), first):
        sides = -rows[k, i], columns[i + 1, k], rows[k + 1, i], -columns[i, k]
        text.append(f"Curve Loop({n}) = {{{', '.join(map(str, sides))}}}; Plane Surface({n}) = {{{n}}};")
        text.append(f"Transfinite Surface{{{n}}}; Recombine Surface{{{n}}};")
    text.append(f"Transfinite Curve{{{first}:{columns[-1, -1]}}} = 2;\n")
    return "\n".join(text)


GRID = (0.0, 0.3, 0.5, 0.7, 1.0)
TWO_HALVES = """
Physical Surface("low") = {1:8}; Physical Surface("high") = {9:16};
Physical Curve("crack:c") = {10, 11};
Physical Curve("wall") = {1:4}; Physical Curve("top") = {17:20}; Physical Point("P") = {25};
"""
# the arms meet in the middle: two along the row, one up a column
BRANCHING = """
Physical Surface("steel") = {1:16};
Physical Curve("crack:c") = {10, 11, 31};
Physical Curve("wall") = {1:4}; Physical Curve("top") = {17:20}; Physical Point("P") = {25};
"""


@functools.cache
def two_halves(second: float = 3.0) -> sb.Model:
    """A crack in the interface of two materials."""
    materials = {"low": UNIT, "high": sb.Material(second, 0.2, 2.0)}
    return sb.Model(drawn(GRID, GRID, TWO_HALVES), materials, "wall", damping=0.02)


@functools.cache
def branching() -> sb.Model:
    """A crack with three tips, its arms drawn from right to left and upwards."""
    return sb.Model(drawn(GRID, GRID, BRANCHING), UNIT, "wall", damping=0.02)
