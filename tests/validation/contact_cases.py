"""Contact at rest."""

from __future__ import annotations

import math
import pathlib
import tempfile
from collections.abc import Iterator

import numpy as np

import sbfem_petsc as sb
from meshing import CrackLine, Plate, read_gmsh
from meshing.boundary_mesh import BoundaryMesh
from tests.validation.page import Row, case

RINGS = """
h = 0.15;
Point(1)={0,0,0,h}; Point(2)={.2,0,0,h}; Point(3)={.6,0,0,h}; Point(4)={1,0,0,h};
Point(5)={0,1,0,h}; Point(6)={0,.6,0,h}; Point(7)={0,.2,0,h};
Line(1)={2,3}; Line(2)={3,4}; Circle(3)={4,1,5}; Line(4)={5,6}; Line(5)={6,7}; Circle(6)={7,1,2};
Circle(7)={3,1,6};
Curve Loop(1)={1,7,5,6}; Plane Surface(1)={1}; Curve Loop(2)={2,3,4,-7}; Plane Surface(2)={2};
Physical Surface("rings")={1,2}; Physical Curve("below")={1,2}; Physical Curve("left")={4,5};
Physical Curve("outside")={3}; Physical Curve("crack:c")={7}; Physical Point("P")={4};
"""

ARC = """
h = 0.02;
Point(1)={0,0,0,h}; Point(2)={.1,0,0,h}; Point(3)={.1,.1,0,h}; Point(4)={.05,.1,0,h}; Point(5)={0,.1,0,h};
Point(10)={.09,.1,0,h}; Point(11)={.09,.06,0,h/4};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,1}; Circle(10)={4,10,11};
Curve Loop(1)={1:5}; Plane Surface(1)={1}; Curve{10} In Surface{1};
Physical Surface("s")={1}; Physical Curve("edge1")={1}; Physical Curve("edge2")={2};
Physical Curve("edge3")={3,4}; Physical Curve("edge4")={5}; Physical Curve("crack:c")={10};
Physical Point("O")={1}; Physical Point("P")={3};
"""


def from_gmsh(text: str) -> BoundaryMesh:
    """The mesh of a gmsh script."""
    with tempfile.TemporaryDirectory() as folder:
        path = pathlib.Path(folder) / "model.geo"
        path.write_text(text)
        return read_gmsh(path)


@case(
    "Pressed rings",
    "code_aster SSNP152: radii 1, 0.6 and 0.2 m, E = 1e9, nu = 0.2, plane stress, 1 MPa outside: Lame. A "
    "quarter, the "
    "faces between the rings are a crack along an arc through the body.",
)
def pressed_rings() -> Iterator[Row]:
    mesh = from_gmsh(RINGS)
    rollers = [sb.Support("below", x=False, y=True), sb.Support("left", x=True, y=False)]
    model = sb.Model(mesh, sb.Material(1e9, 0.2, 1000), clamped=None, supports=rollers)
    found = sb.static(model, sb.EdgeLoad("outside", pressure=1e6))
    _, pressure = found.contact_pressure()
    exact = 1e6 / (1 - 0.04) * (1 - 0.04 / 0.36)
    yield Row(
        "resultant over the arc, as pressure, Pa", exact, found.contact_resultant / (0.3 * math.pi), 1e-5
    )
    yield Row(
        "largest contact pressure, Pa",
        exact,
        float(pressure.max()),
        1e-4,
        note="pairs at nodes of curved edges",
    )
    yield Row(
        "least contact pressure, Pa",
        exact,
        float(pressure.min()),
        1e-4,
        note="pairs at nodes of curved edges",
    )
    # Two rings in contact all round are one ring.
    outer = -1e6 / 1e9 * ((1 + 0.04) / (1 - 0.04) - 0.2)
    yield Row("radial displacement outside, m", outer, float(found.displacement("P")[0]), 1e-5)


SIDE, PRESSURE = 0.1, 1e6
SQUARE = [(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE)]


def arc(corners: int) -> list[tuple[float, float]]:
    """From the top edge, a quarter of a circle."""
    angle = np.linspace(0, np.pi / 2, corners)
    return [(0.05 + 0.04 * (1 - math.cos(a)), 0.1 - 0.04 * math.sin(a)) for a in angle]


def ray(angle: float) -> list[tuple[float, float]]:
    """One of several that meet in the middle."""
    return [(0.05, 0.05), (0.05 + 0.02 * math.cos(angle), 0.05 + 0.02 * math.sin(angle))]


LINES = {
    "straight": [[(0.05, 0.1), (0.05, 0.06)]],
    "kink of 30 degrees": [[(0.05, 0.1), (0.05, 0.07), (0.065, 0.07 - 0.015 / math.tan(math.radians(30)))]],
    "L, kink of 90 degrees": [[(0.05, 0.1), (0.05, 0.07), (0.08, 0.07)]],
    "arc of 90 degrees in 12 segments": [arc(13)],
    "embedded, inclined": [[(0.03, 0.04), (0.07, 0.06)]],
    "crossing pair": [[(0.03, 0.05), (0.07, 0.05)], [(0.05, 0.03), (0.05, 0.07)]],
    "T": [[(0.03, 0.05), (0.07, 0.05)], [(0.05, 0.1), (0.05, 0.05)]],
    "star of three": [ray(0.3), ray(2.4), ray(4.5)],
}


@case(
    "Closed cracks under uniform compression",
    "Closed form: the same pressure from all sides of a block of 0.1 m leaves uniform compression and no "
    "slip, whatever "
    "the path of the crack. Default meshes; differences of displacements at the far corner, of K relative to "
    "p sqrt(pi 40 mm).",
)
def uniform_compression() -> Iterator[Row]:
    strain = -0.7 * PRESSURE / 70e9
    scale = PRESSURE * math.sqrt(math.pi * 0.04)
    places = {"O": (0.0, 0.0), "P": (SIDE, SIDE)}
    meshes = {
        name: Plate(SQUARE, cracks=[CrackLine(points) for points in lines]).mesh(points=places)
        for name, lines in LINES.items()
    }
    meshes["circular arc of 90 degrees (gmsh)"] = from_gmsh(ARC)
    for name, mesh in meshes.items():
        held = [sb.Support("edge1", x=False, y=True), sb.Support("O", x=True, y=False)]
        model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700), clamped=None, supports=held)
        found = sb.static(model, [sb.EdgeLoad(f"edge{k}", pressure=PRESSURE) for k in (2, 3, 4)])
        corner = np.abs(found.displacement("P") - strain * SIDE).max()
        k = np.abs(list(found.stress_intensity.values())).max()
        limit = 1e-8
        yield Row(
            f"{name}: displacement of the corner, m", 0.0, float(corner), limit, scale=abs(strain * SIDE)
        )
        yield Row(f"{name}: largest K, Pa m^1/2", 0.0, float(k), limit, scale=scale)
        model.destroy()


@case(
    "Closed crack under far compression",
    "Closed form for an infinite plate without friction: K_I = 0, |K_II| = p sqrt(pi a) sin(beta) "
    "cos(beta). Half-"
    "length 1 at 37 degrees in a plate of 100 x 100.",
)
def far_compression() -> Iterator[Row]:
    angle = math.radians(37)
    end = (math.cos(angle), math.sin(angle))
    plate = Plate(
        [(-50, -50), (50, -50), (50, 50), (-50, 50)], cracks=[CrackLine([(-end[0], -end[1]), end], name="c")]
    )
    mesh = plate.mesh(points={"O": (-50, -50), "X": (50, -50)})
    model = sb.Model(
        mesh,
        sb.Material(2e11, 0.3, 7800),
        clamped=None,
        supports=[sb.Support("O"), sb.Support("X", x=False, y=True)],
    )
    found = sb.static(model, [sb.EdgeLoad("edge1", pressure=1.0), sb.EdgeLoad("edge3", pressure=1.0)])
    exact = math.sqrt(math.pi) * math.sin(angle) * math.cos(angle)
    for tip, (first, second) in found.stress_intensity.items():
        yield Row(f"K_I at {tip}", 0.0, first, 1e-3, scale=exact)
        yield Row(
            f"magnitude of K_II at {tip}", exact, abs(second), 1.5e-3, note="finite plate: 1e-3 more at most"
        )


@case(
    "Crack through a block",
    "Balance: a block of 0.1 m in two pieces, an oblique crack through it, pressed together; what the faces "
    "carry is "
    "what is applied.",
)
def through_crack() -> Iterator[Row]:
    mesh = Plate(SQUARE, cracks=[CrackLine([(0, 0.04), (0.1, 0.06)], name="c")]).mesh(
        points={"P": (SIDE, SIDE)}
    )
    held = [sb.Support("edge1"), sb.Support("edge2", x=True, y=False), sb.Support("edge3", x=1.0, y=1.0)]
    model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700), clamped=None, supports=held)
    found = sb.static(model, sb.EdgeLoad("edge3", pressure=PRESSURE))
    force = found.contact_force @ mesh.pairs.normal
    yield Row("vertical resultant on the faces, N", PRESSURE * SIDE, abs(float(force[1])), 1e-6)
    reaction = found.reactions["edge1"]
    yield Row("vertical reaction of the base, N", PRESSURE * SIDE, abs(float(reaction[1])), 1e-6)
