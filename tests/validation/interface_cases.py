"""Bodies of two materials with a crack that ends at their interface, or runs along it, drawn in gmsh."""

from __future__ import annotations

import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np
from scipy import optimize

import sbfem_petsc as sb
from meshing import read_gmsh
from sbfem_petsc.selement.fracture import dundurs
from tests.validation.page import Row, case
from tests.validation.peer_cracks import Body, Grading, Solution, triangles

# The one ahead of the crack, or above it, and the other.
FIRST = sb.Material(2.0, 0.2, 1.0, plane="strain")
SECOND = sb.Material(0.5, 0.35, 2.0, plane="strain")

# Unit squares [0, 1] x [-0.5, 0.5], pulled along y by 1; the crack starts at (0, 0) on the left side.
_SCRIPT = """SetFactory("OpenCASCADE");
{surfaces}
BooleanFragments{{ Surface{{:}}; Delete; }}{{ Curve{{100}}; Delete; }}
Mesh.MeshSizeMax = 0.15;
e = 1e-6;
{groups}
Physical Curve("bottom") = Curve In BoundingBox{{-e, -0.5 - e, -e, 1 + e, -0.5 + e, e}};
Physical Curve("top") = Curve In BoundingBox{{-e, 0.5 - e, -e, 1 + e, 0.5 + e, e}};
Physical Curve("crack:c") = Curve In BoundingBox{{-e, -e, -e, 0.4 + e, e, e}};
Physical Curve("bond") = Curve In BoundingBox{{{bond}}};
Physical Point("O") = Point In BoundingBox{{-e, -0.5 - e, -e, e, -0.5 + e, e}};
Physical Point("X") = Point In BoundingBox{{1 - e, -0.5 - e, -e, 1 + e, -0.5 + e, e}};
Physical Point("P") = Point In BoundingBox{{1 - e, 0.5 - e, -e, 1 + e, 0.5 + e, e}};
Physical Point("Q") = Point In BoundingBox{{-e, 0.5 - e, -e, e, 0.5 + e, e}};
"""
_LINE = "Point(100) = {0, 0, 0}; Point(101) = {0.4, 0, 0}; Line(100) = {100, 101};"
_ENDING = _SCRIPT.format(
    surfaces="Rectangle(1) = {0, -0.5, 0, 0.4, 1}; Rectangle(2) = {0.4, -0.5, 0, 0.6, 1};\n" + _LINE,
    groups='Physical Surface("second") = Surface In BoundingBox{-e, -1, -e, 0.4 + e, 1, e};\n'
    'Physical Surface("first") = Surface In BoundingBox{0.4 - e, -1, -e, 1 + e, 1, e};',
    bond="0.4 - e, -0.5 - e, -e, 0.4 + e, 0.5 + e, e",
)
_ALONG = _SCRIPT.format(
    surfaces="Rectangle(1) = {0, -0.5, 0, 1, 0.5}; Rectangle(2) = {0, 0, 0, 1, 0.5};\n" + _LINE,
    groups='Physical Surface("second") = Surface In BoundingBox{-e, -1, -e, 1 + e, e, e};\n'
    'Physical Surface("first") = Surface In BoundingBox{-e, -e, -e, 1 + e, 1, e};',
    bond="0.4 - e, -e, -e, 1 + e, e, e",
)
BODIES = {"ending": _ENDING, "along": _ALONG}
PULL = [sb.EdgeLoad("bottom", pressure=-1.0), sb.EdgeLoad("top", pressure=-1.0)]


def model(folder: pathlib.Path, name: str, **options) -> sb.Model:
    """The body that a script draws."""
    path = folder / f"{name}.geo"
    path.write_text(BODIES[name])
    held = [sb.Support("O"), sb.Support("X", x=False, y=True)]
    materials = {"first": FIRST, "second": SECOND}
    return sb.Model(read_gmsh(path, **options), materials, clamped=None, supports=held)


def lame(material: sb.Material) -> np.ndarray:
    """Lame's constants of a plane problem."""
    return material.young * np.array([material.elasticity[0, 1], material.elasticity[2, 2]])


def exponent() -> float:
    """Zak and Williams (1963), in the form of He and Hutchinson (1989), of the crack normal to the interface:
    cos(s pi) = 2 (beta - alpha) / (1 + beta) (1 - s)^2 + (alpha + beta^2) / (1 - beta^2), stresses r^-s, with
    Dundurs' parameters of the material ahead and the other.
    """
    alpha, beta = dundurs(np.stack([m.young * m.elasticity for m in (FIRST, SECOND)]))

    def equation(s: float) -> float:
        right = 2 * (beta - alpha) / (1 + beta) * (1 - s) ** 2 + (alpha + beta**2) / (1 - beta**2)
        return float(np.cos(np.pi * s) - right)

    return 1.0 - optimize.brentq(equation, 0.05, 0.95, xtol=1e-14)


def second_computation(interface: list[tuple[float, float]], is_first) -> Solution:
    """By scikit-fem."""
    square = [(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)]
    body = Body(square, [[(0.0, 0.0), (0.4, 0.0)]], interface=interface)
    singular = [(0.4, 0.0), interface[0], interface[-1]]
    first, second = (lame(m)[:, None] for m in (FIRST, SECOND))
    return Solution(
        *triangles(body, Grading(1e-6, 0.35, 0.1, singular)),
        lambda at: np.where(is_first(at), first, second),
        lambda at, normal: np.stack([0.0 * at[0], normal[1]]),
        lambda at: np.abs(at[1]) > 0.5 - 1e-9,
    )


def rows(name: str, solved: Solution, is_first) -> Iterator[Row]:
    """Opening, frequencies and what contact does, beside the second computation."""
    with tempfile.TemporaryDirectory() as folder:
        body = model(pathlib.Path(folder), name)
    pulled = sb.static(body, PULL)
    opening = pulled.displacement("c_right") - pulled.displacement("c_left")
    across = float(abs(opening[1]))
    exact = solved.opening((0.0, 0.0))
    yield Row("opening of the mouth, across", float(exact[1]), across, 1e-3)
    if name == "along":
        slip = float(opening[0] * np.sign(opening[1]))
        yield Row("opening of the mouth, along", float(exact[0]), slip, 1e-3, scale=float(exact[1]))
        g = solved.energy_release_rate((0.4, 0.0), (1.0, 0.0), 0.35)
        yield Row("energy release rate", g, pulled.energy_release_rate["c"], 1e-3)
    frequencies = solved.frequencies(6, lambda at: np.where(is_first(at), FIRST.density, SECOND.density))
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "body.geo"
        path.write_text(BODIES[name])
        free = sb.Model(read_gmsh(path), {"first": FIRST, "second": SECOND}, clamped=None)
    for k, (known, found) in enumerate(zip(frequencies, sb.modal(free, 9).frequencies[3:]), 1):
        yield Row(f"elastic frequency {k}, Hz", float(known), float(found), 1e-3)


SQUARES = (
    "Square of 1 in two materials (E = 2, nu = 0.2, rho = 1 and E = 0.5, nu = 0.35, rho = 2, plane strain), "
    "crack of 0.4 from the left side, pulled across."
)


@case(
    "Crack that ends at an interface",
    f"{SQUARES} Exponent of the displacements: Zak and Williams, Bull. Seismol. Soc. Am. 53 (1963); the "
    "rest, computed a second time by scikit-fem, triangles of order 3 graded to 1e-6.",
    long=True,
)
def crack_ending_at_an_interface() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as folder:
        found = model(pathlib.Path(folder), "ending").tips.intensities.exponents[0]
    yield Row("exponent, opening", exponent(), float(found[0]), 1e-6)
    yield Row("exponent, sliding", exponent(), float(found[1]), 1e-6)

    def is_first(at: np.ndarray) -> np.ndarray:
        return at[0] > 0.4

    solved = second_computation([(0.4, -0.5), (0.4, 0.0), (0.4, 0.5)], is_first)
    yield from rows("ending", solved, is_first)


@case(
    "Crack along an interface",
    f"{SQUARES} Computed a second time by scikit-fem, triangles of order 3 graded to 1e-6.",
    long=True,
)
def crack_along_an_interface() -> Iterator[Row]:
    def is_first(at: np.ndarray) -> np.ndarray:
        return at[1] > 0.0

    yield from rows("along", second_computation([(0.4, 0.0), (1.0, 0.0)], is_first), is_first)
