"""Cracks of any path in plates and gmsh models: uniform compression, stress intensity, balance of forces."""

import math

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Hole, Plate, VNotch, read_gmsh
from tests.validation.contact_cases import arc, ray

YOUNG, POISSON, PRESSURE, SIDE = 70e9, 0.3, 1e6, 0.1
SQUARE = [(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE)]
MATERIAL = sb.Material(young=YOUNG, poisson=POISSON, density=2700)


# Lines of cracks; the first goes from the top edge in most.
LINES = {
    "straight": [[(0.05, 0.1), (0.05, 0.06)]],
    "kink of 30 degrees": [[(0.05, 0.1), (0.05, 0.07), (0.065, 0.07 - 0.015 / math.tan(math.radians(30)))]],
    "kink of 90 degrees": [[(0.05, 0.1), (0.05, 0.07), (0.08, 0.07)]],
    "arc of 90 degrees": [arc(13)],
    "embedded": [[(0.03, 0.04), (0.07, 0.06)]],
    "crossing": [[(0.03, 0.05), (0.07, 0.05)], [(0.05, 0.03), (0.05, 0.07)]],
    "T": [[(0.03, 0.05), (0.07, 0.05)], [(0.05, 0.1), (0.05, 0.05)]],
    "star": [ray(0.3), ray(2.4), ray(4.5)],
}


def compressed(mesh):
    """The square under equal pressure from three sides, on rollers: exact displacements are linear."""
    model = sb.Model(
        mesh,
        MATERIAL,
        clamped=None,
        supports=[sb.Support("edge1", x=False, y=True), sb.Support("O", x=True, y=False)],
    )
    pressure = [sb.EdgeLoad(f"edge{i}", pressure=PRESSURE) for i in (2, 3, 4)]
    return sb.static(model, pressure)


def check_uniform(mesh, found):
    """The exact state is uniform, without slip, to the tips and on curved faces too: 1e-10 is met."""
    strain = -(1 - POISSON) * PRESSURE / YOUNG
    assert found.displacement("P") == pytest.approx([strain * SIDE, strain * SIDE], rel=1e-9)
    assert found.active.all()
    for crack in mesh.cracks:
        _, pressure = found.contact_pressure(crack.name)
        assert pressure == pytest.approx(PRESSURE, rel=1e-9)
    for factors in found.stress_intensity.values():
        assert np.abs(factors).max() < 1e-9 * PRESSURE * math.sqrt(math.pi * 0.04)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (k % 2)) for k, name in enumerate(LINES)]
)
def test_uniform_compression(name):
    plate = Plate(SQUARE, cracks=[CrackLine(points) for points in LINES[name]])
    mesh = plate.mesh(points={"O": (0, 0), "P": (SIDE, SIDE)})
    check_uniform(mesh, compressed(mesh))


GEO = """
h = 0.02;
Point(1)={0,0,0,h}; Point(2)={.1,0,0,h}; Point(3)={.1,.1,0,h}; Point(4)={.05,.1,0,h}; Point(5)={0,.1,0,h};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,1};
Curve Loop(1)={1:5}; Plane Surface(1)={1};
%s
Physical Surface("s")={1}; Physical Curve("edge1")={1}; Physical Curve("edge2")={2};
Physical Curve("edge3")={3,4}; Physical Curve("edge4")={5}; Physical Point("O")={1}; Physical Point("P")={3};
"""
GMSH_CRACKS = {
    "arc": """Point(10)={.09,.1,0,h}; Point(11)={.09,.06,0,h/4}; Circle(10)={4,10,11};
        Curve{10} In Surface{1}; Physical Curve("crack:c")={10};""",
    "spline": """Point(10)={.03,.03,0,h/2}; Point(11)={.05,.06,0,h/2}; Point(12)={.07,.05,0,h/2};
        Spline(10)={10,11,12}; Curve{10} In Surface{1}; Physical Curve("crack:c")={10};""",
    "branching": """Point(10)={.05,.06,0,h/2}; Point(11)={.03,.04,0,h/2}; Point(12)={.07,.04,0,h/2};
        Line(10)={4,10}; Line(11)={10,11}; Line(12)={10,12}; Curve{10,11,12} In Surface{1};
        Physical Curve("crack:c")={10,11,12};""",
    "crossing": """Point(10)={.05,.05,0,h/2}; Point(11)={.03,.05,0,h/2}; Point(12)={.07,.05,0,h/2};
        Point(13)={.05,.03,0,h/2}; Point(14)={.05,.07,0,h/2}; Line(10)={11,10}; Line(11)={10,12};
        Line(12)={13,10}; Line(13)={10,14}; Curve{10:13} In Surface{1};
        Physical Curve("crack:a")={10,11}; Physical Curve("crack:b")={12,13};""",
}
GMSH_TIPS = {"arc": ["c"], "spline": ["c:1", "c:2"], "branching": ["c:1", "c:2"]}


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (k % 2)) for k, name in enumerate(GMSH_CRACKS)]
)
def test_uniform_compression_of_gmsh_models(tmp_path, name):
    path = tmp_path / "model.geo"
    path.write_text(GEO % GMSH_CRACKS[name])
    mesh = read_gmsh(path)
    assert [tip.name for tip in mesh.tips] == GMSH_TIPS.get(name, ["a:1", "a:2", "b:1", "b:2"])
    check_uniform(mesh, compressed(mesh))


def pulled(plate, **options):
    """K of a plate under unit tension on its upper and lower edge."""
    mesh = plate.mesh(points={"O": plate.outline[0], "X": plate.outline[1]}, **options)
    supports = [sb.Support("O"), sb.Support("X", x=False, y=True)]
    model = sb.Model(mesh, MATERIAL, clamped=None, supports=supports)
    return sb.static(model, [sb.EdgeLoad("edge1", pressure=-1.0), sb.EdgeLoad("edge3", pressure=-1.0)])


@pytest.mark.parametrize(("depth", "factor"), [(0.2, 1.368040), (0.3, 1.661122), (0.5, 2.825465)])
def test_edge_crack_in_tension(depth, factor):
    """Half-height equal to the width; the factors are converged to their last digit."""
    plate = Plate([(0, -1), (1, -1), (1, 1), (0, 1)], cracks=[CrackLine([(0, 0), (depth, 0)])])
    found = pulled(plate).stress_intensity["crack1"]
    assert found[0] == pytest.approx(factor * math.sqrt(math.pi * depth), rel=3e-4)
    assert abs(found[1]) < 3e-4 * found[0]


def test_edge_crack_of_the_test_book():
    """SSLP101: W = 100 mm, H = 500 mm, a = 37.5 mm, 1 MPa: K_I = 21.491 MPa mm^1/2 (5e-3)."""
    plate = Plate([(0, -250), (100, -250), (100, 250), (0, 250)], cracks=[CrackLine([(0, 0), (37.5, 0)])])
    assert pulled(plate).stress_intensity["crack1"][0] == pytest.approx(21.491, rel=5e-3)


@pytest.mark.slow
def test_inclined_crack_in_a_wide_plate():
    """Half-length 1, 37 degrees off the horizontal: sqrt(pi) cos^2 and sqrt(pi) sin cos in an infinite plate.

    In a plate of 50 half-lengths to each side K is 1e-3 larger at most.
    """
    angle = math.radians(37)
    end = (math.cos(angle), math.sin(angle))
    plate = Plate(
        [(-50, -50), (50, -50), (50, 50), (-50, 50)], cracks=[CrackLine([(-end[0], -end[1]), end], name="c")]
    )
    found = pulled(plate).stress_intensity
    assert set(found) == {"c:1", "c:2"}
    exact = math.sqrt(math.pi) * np.array([math.cos(angle) ** 2, math.cos(angle) * math.sin(angle)])
    for values in found.values():
        assert np.abs(values) == pytest.approx(exact, rel=1.5e-3)


def test_through_crack_carries_the_load():
    """A block in two pieces, pressed together: contact has the whole load."""
    line = CrackLine([(0, 0.04), (0.1, 0.06)], name="c")
    mesh = Plate(SQUARE, cracks=[line]).mesh(points={"P": (SIDE, SIDE)})
    springs = [sb.Support("edge1"), sb.Support("edge2", x=True, y=False), sb.Support("edge3", x=1.0, y=1e6)]
    model = sb.Model(mesh, MATERIAL, clamped=None, supports=springs)
    found = sb.static(model, sb.EdgeLoad("edge3", pressure=PRESSURE))
    total = found.contact_force @ mesh.pairs.normal
    # The soft springs on top take less than 1e-4; rollers at the right take the horizontal component.
    assert abs(total[1]) == pytest.approx(PRESSURE * SIDE, rel=1e-3)
    assert found.contact_force.min() >= 0


def test_crack_between_a_hole_and_the_edge():
    plate = Plate(SQUARE, holes=[Hole(0.05, 0.05, 0.03)], cracks=[CrackLine([(0.05, 0.1), (0.05, 0.065)])])
    mesh = plate.mesh(points={"P": (SIDE, SIDE)})
    model = sb.Model(mesh, MATERIAL, clamped="edge1")
    found = sb.static(model, [sb.EdgeLoad(f"edge{i}", pressure=PRESSURE) for i in (2, 4)])
    # Half of the block right of the crack, cut at mid-height of the hole: bending closes the mouth.
    assert found.contact_resultant > 0.1 * PRESSURE * 0.035
    assert found.stress_intensity == {}


@pytest.mark.long
def test_notch_from_the_bottom_edge():
    """The mirror image of a notch from the top: the same frequencies and contact, also if gmsh fills it."""
    beams = [
        Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366, tilt=15)]),
        Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366, tilt=15, edge="bottom")]),
        # A second, far crack: gmsh fills the blocks.
        Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0458366, tilt=15, edge="bottom"), VNotch(0.3, 6e-5, 0.0)]),
    ]
    results = []
    for beam, force in zip(beams, (100.0, -100.0, -100.0)):
        mesh = beam.mesh(points={"M": (0.4, 0.0025)}, tip_size=5e-6)
        model = sb.Model(mesh, MATERIAL, clamped="left")
        found = sb.static(model, sb.PointForce("M", fy=force))
        results.append(
            [*sb.modal(model, count=6).frequencies, abs(found.displacement("M")[1]), found.contact_resultant]
        )
    assert results[1] == pytest.approx(results[0], rel=1e-7)
    assert results[2][:7] == pytest.approx(results[0][:7], rel=1e-4)
    assert results[2][7] == pytest.approx(results[0][7], rel=1e-3)


@pytest.mark.slow
def test_cracks_in_a_beam():
    """A closed crack drawn as a line is the notch without opening."""
    notch = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.0)])
    line = Beam(0.1, 0.01, cracks=[CrackLine([(0.04, 0.01), (0.04, 0.006)])])
    values = []
    for beam in (notch, line):
        model = sb.Model(beam.mesh(tip_size=4e-6), MATERIAL, clamped="left")
        opened = sb.static(model, sb.PointForce("A", fy=-100.0))
        closed = sb.static(model, sb.EdgeLoad("right", pressure=1e6))
        values.append(
            [
                *sb.modal(model, count=5).frequencies,
                opened.displacement("A")[1],
                opened.stress_intensity["crack1"][0],
                closed.contact_resultant,
            ]
        )
    assert values[1] == pytest.approx(values[0], rel=2e-4)


def test_body_held_by_contact_alone():
    """A crack cuts the block in two: modes of a body that is free, a sentence where it must be held, and weak
    springs that do not show.
    """
    outline = [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)]
    mesh = Plate(outline, cracks=[CrackLine([(0, 0.04), (0.1, 0.06)])]).mesh(
        order=3, face_edges=4, points={"P": (0.1, 0.1)}
    )
    steel = sb.Material(210e9, 0.3, 7800)
    cut = sb.Model(mesh, steel, clamped="edge1")
    assert len(cut.layout.bodies) == 2 and not cut.statics.supported
    frequencies = sb.modal(cut, 5).frequencies
    # the square root of rounding: 1e-16 of the stiffness is 1e-8 of the highest frequencies
    assert (frequencies[:3] < 1e-6 * frequencies[3]).all() and frequencies[3] > 1e4
    push = sb.EdgeLoad("edge3", ty=-1e6)
    with pytest.raises(ValueError, match=r"one around \(0.05, 0.07\) m is held by contact alone"):
        sb.static(cut, push)
    with pytest.raises(ValueError, match="held by contact alone"):
        sb.transient(cut, push, 1e-4)
    with pytest.raises(ValueError, match="leave one free"):  # nothing holds either
        sb.static(sb.Model(mesh, steel, clamped=None), push)
    found = [
        sb.static(sb.Model(mesh, steel, clamped="edge1", supports=[sb.Support("edge3", x=k, y=k)]), push)
        for k in (1e9, 1e8)
    ]
    assert found[0].contact_resultant == pytest.approx(found[1].contact_resultant, rel=1e-3)
