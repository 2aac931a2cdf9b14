"""Beams and plates through gmsh: drawn, discretised, read, written and read again."""

import math
from concurrent.futures import ThreadPoolExecutor

import gmsh
import numpy as np
import pytest
from mesh_checks import check_mesh, smallest_angle
from scipy.spatial import cKDTree

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Hole, Plate, VNotch, read_gmsh
from meshing.gmsh.window import show_mesh

LENGTH, HEIGHT, OPENING = 0.4, 0.005, 0.0458366
HOLE = Hole(0.065, 0.0025, 0.0025)


def beam(*notches, **features):
    return Beam(LENGTH, HEIGHT, notches, **features)


PAPER = beam(VNotch(0.08, 0.0025, OPENING))
PLATE = Plate(
    [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)],
    holes=[Hole(0.05, 0.05, 0.02)],
    cracks=[
        CrackLine([(0, 0.03), (0.02, 0.03)]),
        CrackLine([(0.06, 0.05), (0.085, 0.06)]),
        CrackLine([(0.03, 0.075), (0.06, 0.085)]),
        CrackLine([(0.075, 0.02), (0.09, 0.035)]),
        CrackLine([(0.045, 0.1), (0.04, 0.09)]),
    ],
)
# Body, options of `mesh`, most S-elements and nodes: those of a mesher that made columns and stars itself.
BODIES = {
    "paper": (PAPER, {}, 79, 1038),
    "tilted": (beam(VNotch(0.08, 0.0025, OPENING, tilt=30.0)), {}, 84, 1088),
    "two notches": (beam(VNotch(0.08, 0.0025, OPENING), VNotch(0.2, 0.002, 5.0)), {}, 119, 1534),
    "hole": (beam(holes=[HOLE]), {}, 46, 634),
    "hole apart from a notch": (beam(VNotch(0.08, 0.0015, OPENING), holes=[HOLE]), {}, 107, 1339),
    "hole close to a notch": (beam(VNotch(0.068, 0.0015, OPENING), holes=[HOLE]), {}, 107, 1339),
    "bottom notch": (beam(VNotch(0.08, 0.0025, OPENING, edge="bottom")), {}, 79, 1038),
    "inner crack": (beam(cracks=[CrackLine([(0.08, 0.0015), (0.0825, 0.0035)])]), {}, 183, 1984),
    "plate": (PLATE, {}, 571, 5764),
    "1,100 cells": (beam(VNotch(0.068, 0.0015, OPENING), holes=[HOLE]), {"size": 0.0015}, 1121, 11625),
}


@pytest.mark.parametrize("name", BODIES)
def test_gmsh_discretises_every_body(name, monkeypatch):
    body, options, most_elements, most_nodes = BODIES[name]
    calls, generate = [], gmsh.model.mesh.generate

    def counted(dimension):
        calls.append(dimension)
        generate(dimension)

    monkeypatch.setattr(gmsh.model.mesh, "generate", counted)
    mesh = body.mesh(**options)
    assert 1 in calls and (2 in calls) == (name in ("inner crack", "plate"))
    assert mesh.elements <= most_elements and len(mesh.nodes) <= most_nodes
    check_mesh(mesh, body.area, 1e-7 if body.holes else 1e-12)
    assert smallest_angle(mesh) > math.radians(10)


def test_vertices_of_the_papers_beam():
    """Corners of columns, and copies of the fans' outlines scaled towards the tip and the clamped corners."""
    mesh = PAPER.mesh(face_edges=1)
    tip, half = np.array([0.08, 0.0025]), 0.0025 * math.tan(math.radians(OPENING) / 2)
    rim = [(-1, -1), (0, -1), (1, -1), (1, 0), (1, 1), (-1, 1), (-1, 0)]
    rim = tip + 0.0025 * np.array([*rim, (half / 0.0025, 1), (-half / 0.0025, 1)])
    wanted = [tip + 0.02 ** (1 - k / 5) * (rim - tip) for k in range(6)]
    for corner, up in (((0, 0), 1), ((0, HEIGHT), -1)):
        square = 0.0025 * np.array([(1, 0), (1, up), (0, up)])
        wanted += [np.array([corner]), corner + square, corner + 0.4 * square]
    for low, high, count in ((0.0025, 0.0775, 6), (0.0825, LENGTH, 26)):
        xs = low + (high - low) * np.arange(count + 1) / count
        wanted += [np.stack([xs, np.full(count + 1, y)], axis=1) for y in (0, HEIGHT)]
    wanted = np.concatenate(wanted)
    vertices = mesh.nodes[np.unique(mesh.edges[:, [0, -1]])]
    assert cKDTree(wanted).query(vertices)[0].max() < 1e-13
    assert cKDTree(vertices).query(wanted)[0].max() < 1e-13


def test_crowded_cracks_have_no_needles():
    crowded = Beam(0.1, HEIGHT, [VNotch(0.0381591, 0.0014739, 0), VNotch(0.038148, 0.0022351, 0)])
    assert smallest_angle(crowded.mesh(order=2)) > math.radians(7)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (k % 3 != 1)) for k, name in enumerate(BODIES)]
)
def test_written_and_read_again(name, tmp_path):
    body, options, *_ = BODIES[name]
    path = tmp_path / "body.geo_unrolled"
    body.write(path, **options)
    mesh, again = body.mesh(**options), read_gmsh(path)
    assert again.elements == mesh.elements and len(again.pairs) == len(mesh.pairs)
    extent = np.ptp(mesh.nodes, axis=0).max()
    for one, other in ((mesh, again), (again, mesh)):
        assert cKDTree(one.nodes).query(other.nodes)[0].max() < 1e-14 * extent
    assert [crack.name for crack in again.cracks] == [crack.name for crack in mesh.cracks]
    # of a notch of 5 degrees along its flanks, where a VNotch counts along its axis
    lengths = [crack.length for crack in mesh.cracks]
    assert [crack.length for crack in again.cracks] == pytest.approx(lengths, rel=1e-3)
    for faces in ("left", "right", "top", "bottom", "hole1", "crack1_left", "edge1"):
        assert (faces in again.edge_sets) == (faces in mesh.edge_sets)
        if faces in mesh.edge_sets:
            assert len(again.edge_sets[faces]) == len(mesh.edge_sets[faces])


def test_what_the_drawing_says_is_read(tmp_path):
    """Points, tip sizes, graded corners and closed notches from both edges."""
    options = {
        "points": {"P": (0.0833, 0.0), "Q": (LENGTH, 0.004)},
        "tip_size": 1e-6,
        "corners": ("left", "right"),
    }
    body = beam(VNotch(0.08, 0.0025, 0.0), VNotch(0.2, 0.001, 0.0, edge="bottom"))
    body.write(tmp_path / "b.geo_unrolled", **options, corner_size=1e-4)
    mesh, again = body.mesh(**options, corner_size=1e-4), read_gmsh(tmp_path / "b.geo_unrolled")
    assert cKDTree(mesh.nodes).query(again.nodes)[0].max() < 1e-14
    assert cKDTree(again.nodes).query(mesh.nodes)[0].max() < 1e-14
    for name in ("A", "P", "Q"):
        assert np.abs(mesh.nodes[mesh.points[name]] - again.nodes[again.points[name]]).max() < 1e-15


OPEN = {
    "beam": Beam(
        LENGTH,
        HEIGHT,
        [VNotch(0.3, 0.0025, 0.0)],
        cracks=[
            CrackLine([(0.08, 0.005), (0.08, 0.0025)], opening=2.0, name="open"),
            CrackLine([(0.2, 0.0015), (0.2025, 0.0035)], opening=1.0, name="inner"),
        ],
    ),
    "plate": Plate(
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        holes=[Hole(0.5, 0.75, 0.2)],
        cracks=[
            CrackLine([(0.5, 0), (0.5, 0.2), (0.6, 0.3)], opening=1.0 / 3.0, name="open"),
            CrackLine([(0.15, 0.5), (0.4, 0.4), (0.6, 0.45)], opening=3.0),
            CrackLine([(0.6, 0.75), (0.8, 0.7)]),
        ],
    ),
}


@pytest.mark.parametrize("name", OPEN)
def test_openings_are_written(name, tmp_path):
    """A crack's opening stands in the name of its group: the faces are moved apart alike."""
    body, path = OPEN[name], tmp_path / "body.geo_unrolled"
    body.write(path)
    mesh, again = body.mesh(), read_gmsh(path)
    extent = np.ptp(mesh.nodes, axis=0).max()
    for one, other in ((mesh, again), (again, mesh)):
        assert cKDTree(one.nodes).query(other.nodes)[0].max() < 1e-14 * extent
    assert [(c.name, c.length, c.opening) for c in again.cracks] == [
        (c.name, pytest.approx(c.length, rel=1e-12), pytest.approx(c.opening, rel=1e-12)) for c in mesh.cracks
    ]
    assert again.pairs.gap == pytest.approx(mesh.pairs.gap, rel=1e-9, abs=1e-15 * extent)
    # 2 s tan(opening / 2) at the mouth, the mean of the two faces being the drawn line
    crack = body.cracks[0]
    own = [crack.name for crack in again.cracks].index("open")
    widest = again.pairs.gap[again.pairs.crack == own].max()
    way = sum(math.dist(a, b) for a, b in zip(crack.points, crack.points[1:]))
    assert widest == pytest.approx(2 * way * math.tan(math.radians(crack.opening) / 2), rel=0.02)


@pytest.mark.parametrize(
    ("opening", "says"),
    [("31", "the opening 31, 0 to 30 degrees were expected"), ("wide", "the opening wide, 0 to 30 degrees")],
)
def test_openings_that_are_refused(opening, says, tmp_path):
    path = written(tmp_path, POLYGONS.replace("SIZE", "1") + CRACK.replace(":c", f":c:opening={opening}"))
    with pytest.raises(ValueError, match=says):
        read_gmsh(path)


def test_bodies_that_are_not_written(tmp_path):
    path = tmp_path / "body.geo_unrolled"
    with pytest.raises(ValueError, match=r"ending of .*\.msh' is \.msh, \.geo_unrolled was expected"):
        PAPER.write(tmp_path / "body.msh")
    with pytest.raises(ValueError, match="size 1e-06 m is below"):
        PAPER.write(path, size=1e-6)
    assert not list(tmp_path.iterdir())


# A hexagon around a tip, in six triangles, in a square that gmsh fills.
POLYGONS = """
Point(1) = {-1, -1, 0}; Point(2) = {1, -1, 0}; Point(3) = {1, 0, 0}; Point(4) = {1, 1, 0};
Point(5) = {-1, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 1};
Point(10) = {0, 0, 0, SIZE};
For i In {1 : 6}
  Point(10 + i) = {0.5 * Cos(i * Pi / 3), 0.5 * Sin(i * Pi / 3), 0};
  Line(20 + i) = {10, 10 + i};
EndFor
For i In {1 : 6}
  Line(30 + i) = {10 + i, 11 + i - 6 * (i == 6)};
  Curve Loop(i) = {20 + i, 30 + i, -(21 + i - 6 * (i == 6))};
  Plane Surface(i) = {i};
EndFor
Line(50) = {16, 3};
Transfinite Curve {21 : 26, 31 : 36, 50} = 2;
Transfinite Curve {1 : 5} = 4;
Curve Loop(7) = {1 : 5};
Curve Loop(8) = {31 : 36};
Plane Surface(7) = {7, 8};
Curve{50} In Surface{7};
Physical Surface("selement:steel") = {1 : 6};
Physical Surface("steel") = {7};
Physical Curve("right") = {2, 3};
Physical Curve("left") = {5};
Physical Point("O") = {1};
"""
CRACK = 'Physical Curve("crack:c") = {26, 50};'


def written(folder, text):
    path = folder / "model.geo"
    path.write_text(text)
    return path


@pytest.mark.parametrize("size", [0.02, 0.002])
def test_polygons_around_a_tip(size, tmp_path):
    """What gmsh says of the size at the tip is that of the S-element there."""
    path = written(tmp_path, POLYGONS.replace("SIZE", str(size)) + CRACK)
    for options, wanted in (({}, size), ({"tip_size": 0.1}, 0.1)):
        mesh = read_gmsh(path, **options)
        check_mesh(mesh, 4.0, 1e-12, covered=False)
        assert mesh.material_names == ("steel",)
        (tip,) = mesh.tips
        chain = mesh.nodes[mesh.element_nodes(tip.element)[:: mesh.order]]
        assert np.hypot(*chain.T) == pytest.approx(wanted)
        assert tip.position == (0, 0)


def test_polygons_pass_the_patch_test(tmp_path):
    """A uniform stress in triangles of one's own and gmsh's quadrilaterals: u = x S / E, exactly."""
    mesh = read_gmsh(written(tmp_path, POLYGONS.replace("SIZE", "1")), order=2)
    steel = sb.Material(young=200e9, poisson=0.3, density=7800)
    held = [sb.Support("left", x=True, y=False), sb.Support("O", x=False, y=True)]
    model = sb.Model(mesh, steel, clamped=None, supports=held)
    pulled = sb.static(model, sb.EdgeLoad("right", pressure=-1e6))
    assert pulled.displacement("O")[0] == pytest.approx(0.0, abs=1e-18)
    right = mesh.nodes[np.unique(mesh.edges[mesh.edge_sets["right"]])]
    for x, y in right:
        ux, uy = pulled.displacement((x, y))
        assert ux == pytest.approx(2 * 1e6 / 200e9, rel=1e-9)
        assert uy == pytest.approx(-0.3 * (y + 1) * 1e6 / 200e9, abs=1e-14)


ROW = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {1, 1, 0}; Point(5) = {1, 2, 0};
Point(6) = {0, 2, 0};
Point(7) = {4, 0, 0}; Point(8) = {4, 1, 0}; Point(9) = {3, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 5}; Line(5) = {5, 6}; Line(6) = {6, 1};
Line(7) = {2, 7}; Line(8) = {7, 8}; Circle(9) = {8, 9, 3};
Curve Loop(1) = {1 : 6}; Plane Surface(1) = {1};
Curve Loop(2) = {7, 8, 9, -2}; Plane Surface(2) = {2};
Transfinite Curve {1 : 8} = 2; Transfinite Curve {9} = 4;
Physical Surface("selement:concrete") = {1};
Physical Surface("selement:steel") = {2};
Physical Curve("foot") = {6};
"""


def test_an_angle_and_an_arc_are_two_elements(tmp_path):
    mesh = read_gmsh(written(tmp_path, ROW), order=8)
    assert mesh.elements == 2 and sorted(mesh.material_names) == ["concrete", "steel"]
    assert sorted(np.diff(mesh.element_start)) == [6, 6]
    check_mesh(mesh, 5.0 + math.pi / 2, 1e-7, covered=False)
    # the same as a mesh of gmsh's own, in which each surface is made of cells
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "model.geo"))
        gmsh.option.setNumber("Mesh.MeshSizeMax", 10)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "model.msh"))
    finally:
        gmsh.finalize()
    again = read_gmsh(tmp_path / "model.msh", order=8)
    assert again.elements == 2 and len(again.nodes) == len(mesh.nodes)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('"selement:steel"', '"selement:"', "'selement:' has no name of a material behind the colon"),
        (
            "Curve Loop(1) = {1 : 6}; Plane Surface(1) = {1};",
            "Point(20) = {.3, .3, 0}; Point(21) = {.6, .3, 0}; Point(22) = {.3, .6, 0}; Line(20) = {20, 21};"
            "Line(21) = {21, 22}; Line(22) = {22, 20}; Curve Loop(3) = {20 : 22};"
            "Curve Loop(1) = {1 : 6}; Plane Surface(1) = {1, 3};",
            r"surface 1 is to be one S-element \(selement:...\), whose outline is one closed line",
        ),
        (
            "Point(4) = {1, 1, 0}",
            "Point(4) = {0.0005, 0.0005, 0}",
            "is not star-convex: no point sees its whole outline",
        ),
        ('"selement:steel") = {2}', '"steel") = {1, 2}', "surface 1 belongs to the physical surfaces"),
    ],
)
def test_polygons_that_are_refused(old, new, says, tmp_path):
    assert old in ROW
    with pytest.raises(ValueError, match=says):
        read_gmsh(written(tmp_path, ROW.replace(old, new)))


def test_what_gmsh_shows_of_a_mesh(monkeypatch):
    """Every edge once, in pieces from node to node, by its edge set; points by name; nothing is left."""
    mesh, seen = PAPER.mesh(order=3), {}

    def look():
        for dimension, group in gmsh.model.getPhysicalGroups():
            (entity,) = gmsh.model.getEntitiesForPhysicalGroup(dimension, group)
            elements = gmsh.model.mesh.getElements(dimension, entity)[1][0]
            seen[gmsh.model.getPhysicalName(dimension, group)] = len(elements)
        seen["all"] = len(gmsh.model.mesh.getElements(1)[1][0])
        assert gmsh.option.getNumber("Mesh.Lines") == 1  # or nothing is drawn

    monkeypatch.setattr(gmsh.fltk, "initialize", lambda: None)
    monkeypatch.setattr(gmsh.fltk, "finalize", lambda: None)
    monkeypatch.setattr(gmsh.fltk, "run", look)
    show_mesh(mesh)
    wanted = {name: 3 * len(edges) for name, edges in mesh.edge_sets.items()} | dict.fromkeys(mesh.points, 1)
    assert seen == wanted | {"all": 3 * len(mesh.edges)}
    assert not gmsh.isInitialized()


def test_threads_take_turns():
    """gmsh has one state for all threads."""
    bodies = [beam(VNotch(0.05 + 0.02 * i, 0.0025, 0.05)) for i in range(6)]
    bodies += [
        Plate([(0, 0), (1, 0), (1, 1), (0, 1)], cracks=[CrackLine([(0, 0.5), (y, 0.5)])]) for y in (0.2, 0.4)
    ]
    alone = [body.mesh(order=2) for body in bodies]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda body: body.mesh(order=2), bodies))
    for one, other in zip(alone, together):
        assert np.array_equal(one.nodes, other.nodes)
