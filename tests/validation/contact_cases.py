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

WHOLE_RINGS = """
h = 0.2;
Point(1)={0,0,0}; Point(2)={.2,0,0,h}; Point(3)={0,.2,0,h}; Point(4)={-.2,0,0,h}; Point(5)={0,-.2,0,h};
Point(12)={.6,0,0,h}; Point(13)={0,.6,0,h}; Point(14)={-.6,0,0,h}; Point(15)={0,-.6,0,h};
Point(22)={1,0,0,h}; Point(23)={0,1,0,h}; Point(24)={-1,0,0,h}; Point(25)={0,-1,0,h};
Circle(1)={2,1,3}; Circle(2)={3,1,4}; Circle(3)={4,1,5}; Circle(4)={5,1,2};
Circle(11)={12,1,13}; Circle(12)={13,1,14}; Circle(13)={14,1,15}; Circle(14)={15,1,12};
Circle(21)={22,1,23}; Circle(22)={23,1,24}; Circle(23)={24,1,25}; Circle(24)={25,1,22};
Curve Loop(1)={1:4}; Curve Loop(2)={11:14}; Curve Loop(3)={21:24};
Plane Surface(1)={2,1}; Plane Surface(2)={3,2};
Physical Surface("rings")={1,2}; Physical Curve("outside")={21:24}; Physical Curve("crack:c")={11:14};
Physical Point("P")={22}; Physical Point("Q")={23}; Physical Point("R")={24};
Physical Point("p")={2}; Physical Point("q")={3}; Physical Point("r")={4};
"""

# Half of a roller above half of a block, drawn with meshes of their own.
ROLLER = """
h = 0.01; f = 0.001; R = 0.05; a = Pi / 9;
Point(1)={0,0,0,f}; Point(2)={R*Sin(a),R-R*Cos(a),0,f}; Point(3)={R,R,0,h}; Point(4)={0,R,0,h};
Circle(1)={1,4,2}; Circle(2)={2,4,3}; Line(3)={3,4}; Line(4)={4,1};
Curve Loop(1)={1:4}; Plane Surface(1)={1};
Point(11)={0,0,0,f}; Point(12)={.025,0,0,f}; Point(13)={.2,0,0,3*h}; Point(14)={.2,-.2,0,3*h};
Point(15)={0,-.2,0,3*h};
Line(11)={15,14}; Line(12)={14,13}; Line(13)={13,12}; Line(14)={12,11}; Line(15)={11,15};
Curve Loop(2)={11:15}; Plane Surface(2)={2};
Physical Surface("roller")={1}; Physical Surface("block")={2};
Physical Curve("axis")={4,15}; Physical Curve("top")={3}; Physical Curve("base")={11};
Physical Curve("crack:c:right")={1}; Physical Curve("crack:c:left")={14};
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


@case(
    "Pressed rings as whole rings",
    "The same rings drawn whole: the crack between them closes on itself. Each ring is held at three points.",
)
def whole_rings() -> Iterator[Row]:
    mesh = from_gmsh(WHOLE_RINGS)
    held = [sb.Support(name, x=False, y=True) for name in "PpRr"]
    held += [sb.Support(name, x=True, y=False) for name in "Qq"]
    model = sb.Model(mesh, sb.Material(1e9, 0.2, 1000), clamped=None, supports=held)
    found = sb.static(model, sb.EdgeLoad("outside", pressure=1e6))
    _, pressure = found.contact_pressure()
    exact = 1e6 / (1 - 0.04) * (1 - 0.04 / 0.36)
    note = "pairs at nodes of curved edges"
    mean = found.contact_resultant / (1.2 * math.pi)
    yield Row("resultant over the circle, as pressure, Pa", exact, mean, 1e-5)
    yield Row("largest contact pressure, Pa", exact, float(pressure.max()), 1e-4, note=note)
    yield Row("least contact pressure, Pa", exact, float(pressure.min()), 1e-4, note=note)


@case(
    "Roller on a block",
    "code_aster SSNP154: Hertz's line contact, E = 210 and 70 GPa, nu = 0.3, R = 50 mm, 35 kN/mm, plane "
    "strain. First two half-planes (blocks of 200 mm of one material with the same E*) with Hertz's parabola "
    "as the initial gap of the line between them, then half of a roller and a block as drawn, with the "
    "circle. Half-width and peak from a straight line through the squares of the pairs' pressures over the "
    "squares of their places.",
    long=True,
)
def roller() -> Iterator[Row]:
    radius, force, poisson = 0.05, 35e6, 0.3
    effective = 1.0 / ((1 - poisson**2) * (1 / 210e9 + 1 / 70e9))
    half_width = math.sqrt(4 * force * radius / (math.pi * effective))
    peak = 2 * force / (math.pi * half_width)
    h = 0.2
    lines = [CrackLine([(0, 0), (0.012, 0)], name="c"), CrackLine([(0.012, 0), (h, 0)], name="rest")]
    outline = [(0, -h), (h, -h), (h, 0), (h, h), (0, h), (0, 0)]
    sides = ["base", "right", "right", "top", "axis", "axis"]
    blocks = Plate(outline, cracks=lines, edge_names=sides).mesh(size=0.02, face_edges=16)
    for name in ("c", "rest"):
        blocks = blocks.with_gap(name, lambda x, y: x**2 / (2 * radius))
    one = sb.Material(2 * effective * (1 - poisson**2), poisson, 7800, plane="strain")
    two = {
        "roller": sb.Material(210e9, poisson, 7800, plane="strain"),
        "block": sb.Material(70e9, poisson, 2700, plane="strain"),
    }
    drawn = "a circle and a finite roller: (half-width / R)^2 is 1.5e-2"
    for what, mesh, materials, width, held, note in (
        ("parabola", blocks, one, h, 2e-3, ""),
        ("roller as drawn", from_gmsh(ROLLER), two, radius, 1e-2, drawn),
    ):
        # springs hold the upper body until the faces do; weaker ones cost digits
        supports = [
            sb.Support("axis", x=True, y=False),
            sb.Support("base", x=False, y=True),
            sb.Support("top", x=False, y=1e6),
        ]
        model = sb.Model(mesh, materials, clamped=None, supports=supports)
        found = sb.static(model, sb.EdgeLoad("top", pressure=0.5 * force / width))
        _, pressure = found.contact_pressure("c")
        x = mesh.nodes[mesh.pairs.nodes[mesh.pairs.crack == 0]].mean(axis=1)[:, 0]
        loaded = pressure > 0.2 * peak
        slope, square = np.polyfit(x[loaded] ** 2, pressure[loaded] ** 2, 1)
        yield Row(f"{what}: half-width, m", half_width, math.sqrt(-square / slope), held, note=note)
        yield Row(f"{what}: peak pressure, Pa", peak, math.sqrt(square), held, note=note)
        model.destroy()


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
    long=True,
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
    held = [sb.Support("edge1"), sb.Support("edge2", x=True, y=False), sb.Support("edge3", x=1e3, y=1e3)]
    model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700), clamped=None, supports=held)
    found = sb.static(model, sb.EdgeLoad("edge3", pressure=PRESSURE))
    force = found.contact_force @ mesh.pairs.normal
    yield Row("vertical resultant on the faces, N", PRESSURE * SIDE, abs(float(force[1])), 1e-6)
    reaction = found.reactions["edge1"]
    yield Row("vertical reaction of the base, N", PRESSURE * SIDE, abs(float(reaction[1])), 1e-6)
