"""Meshes of beams: topology, areas, congruent shapes, pairs, points and sets."""

import math

import numpy as np
import pytest
from mesh_checks import check_mesh, distinct_shapes

from meshing import Beam, BoundaryMesh, Hole, VNotch

LENGTH, HEIGHT = 0.4, 0.005
PAPER = Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0025, 0.0458366)])

BEAMS = {
    "healthy": Beam(LENGTH, HEIGHT),
    "paper": PAPER,
    "long": Beam(0.406, 0.012, [VNotch(0.176, 0.0038, 0)]),
    "hole beside notch": Beam(
        LENGTH, HEIGHT, [VNotch(0.08, 0.0015, 0.0458366)], [Hole(0.065, 0.0025, 0.0025)]
    ),
    "small hole": Beam(LENGTH, HEIGHT, holes=[Hole(0.1, 0.002, 0.0004)]),
    "hole near the edge": Beam(LENGTH, HEIGHT, holes=[Hole(0.1, 0.00105, 0.002)]),
    "two notches apart": Beam(LENGTH, HEIGHT, [VNotch(0.3, 0.001, 0), VNotch(0.08, 0.0025, 30)]),
    "two notches together": Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0015, 0.05), VNotch(0.083, 0.002, 10)]),
    "parallel tilted": Beam(0.1, HEIGHT, [VNotch(0.05, 0.0025, 0, 30), VNotch(0.0515, 0.003, 2, 30)]),
    "notch above a hole": Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0015, 0)], [Hole(0.0805, 0.0015, 0.0015)]),
    "three holes": Beam(
        0.1,
        HEIGHT,
        holes=[Hole(0.05, 0.0025, 0.0015), Hole(0.0512, 0.0013, 0.0012), Hole(0.0519, 0.0035, 0.0008)],
    ),
    "notch at the clamp": Beam(0.1, HEIGHT, [VNotch(0.0006, 0.0025, 0)]),
    # So close that a mesher sees crossing faces unless it is careful with how far it opens them.
    "nearly touching cracks": Beam(
        0.1, HEIGHT, [VNotch(0.0381591, 0.0014739, 0), VNotch(0.038148, 0.0022351, 0)]
    ),
    "thin wall": Beam(0.01, HEIGHT, holes=[Hole(0.0038, 0.00334, 0.00318), Hole(0.0059, 0.0017, 0.00035)]),
    "short beam": Beam(0.002, HEIGHT, [VNotch(0.001, 0.0025, 0)]),
}


@pytest.mark.parametrize("layout", ["tip", "vertex"])
@pytest.mark.parametrize("name", BEAMS)
def test_beams(name, layout):
    beam = BEAMS[name]
    mesh = beam.mesh(order=4, layout=layout)
    # With holes the area is that of polynomial arcs.
    check_mesh(mesh, beam.area, 1e-6 if beam.holes else 1e-12)
    assert len(mesh.cracks) == len(beam.notches)
    assert all((crack.tip_element >= 0) == (layout == "tip") for crack in mesh.cracks)
    assert sum(mesh.closed) == mesh.elements - (len(beam.notches) if layout == "tip" else 0)


@pytest.mark.parametrize("tilt", [-30, 0, 30])
@pytest.mark.parametrize("opening", [0, 30, 60, 90])
@pytest.mark.parametrize("depth", [0.1, 0.3, 0.5, 0.8, 0.9])
def test_openings_depths_and_tilts(depth, opening, tilt):
    beam = Beam(0.1, HEIGHT, [VNotch(0.05, depth * HEIGHT, opening, tilt)])
    mesh = beam.mesh(order=3)
    check_mesh(mesh, beam.area, 1e-12)
    crack, pairs = mesh.cracks[0], mesh.pairs
    assert crack.opening == pytest.approx(math.radians(opening))
    assert crack.length == pytest.approx(depth * HEIGHT / math.cos(math.radians(tilt)))
    # Both faces' points of equal fraction lie at the same height: the gap is their distance times the
    # normal's x component.
    mouth = mesh.nodes[mesh.points["B"]] - mesh.nodes[mesh.points["C"]]
    assert pairs.gap == pytest.approx(pairs.position * mouth[0] * math.cos(math.radians(tilt)), abs=1e-15)
    assert (np.diff(pairs.position) > 0).all() and pairs.position[-1] == pytest.approx(1)
    assert list(pairs.nodes[-1]) == [mesh.points["B"], mesh.points["C"]]
    assert pairs.position[0] < 0.06


def test_tilt_is_positive_with_the_mouth_towards_the_free_end():
    mesh = Beam(0.1, HEIGHT, [VNotch(0.05, 0.0025, 1, 20)]).mesh()
    for name, sign in (("B", 1), ("C", -1)):
        assert mesh.nodes[mesh.points[name]] == pytest.approx(
            [0.05 + 0.0025 * math.tan(math.radians(20 + sign * 0.5)), HEIGHT]
        )
    assert mesh.cracks[0].axis == pytest.approx((math.sin(math.radians(20)), math.cos(math.radians(20))))


class TestPaperCase:
    mesh = PAPER.mesh()

    def test_size(self):
        left = np.unique(self.mesh.edges[self.mesh.edge_sets["left"]])
        assert self.mesh.elements == 79
        # Eighteen edges more where those on the faces are longer than a twelfth of the notch.
        assert 2 * (len(self.mesh.nodes) - len(left)) == 1854 + 18 * 2 * 5
        plain = PAPER.mesh(face_edges=1)
        assert 2 * (len(plain.nodes) - len(left)) == 1854 and len(plain.pairs) == 26
        assert PAPER.mesh(corners=(), size=0.01).elements == 81

    def test_gap_of_a_symmetric_notch(self):
        tip = np.array(self.mesh.cracks[0].tip)
        half = math.radians(0.0458366) / 2
        along = (self.mesh.nodes[self.mesh.pairs.nodes[:, 0]] - tip)[:, 1]
        assert self.mesh.pairs.gap == pytest.approx(2 * along * math.tan(half), rel=1e-9)
        assert self.mesh.pairs.gap[-1] == pytest.approx(2.0e-6, rel=1e-6)
        assert len(self.mesh.pairs) == 71
        assert (self.mesh.pairs.normal == [1.0, 0.0]).all()

    def test_rings_are_congruent(self):
        # Seven shapes serve all: the tip element, the trapezoids and those that end on the two faces
        # (mirrored), two columns and their neighbours with a hanging vertex.
        assert distinct_shapes(PAPER.mesh(corners=(), face_edges=1)) <= 7
        assert distinct_shapes(PAPER.mesh(corners=(), tip_size=1e-6, face_edges=1)) <= 7
        # Those on the faces differ only in the two outer rings, by the number of their edges.
        assert distinct_shapes(PAPER.mesh(corners=(), tip_size=1e-6)) <= 10

    def test_points_and_tip(self):
        assert self.mesh.nodes[self.mesh.points["A"]] == pytest.approx([LENGTH, HEIGHT], abs=0)
        element = self.mesh.cracks[0].tip_element
        assert tuple(self.mesh.scaling_centres[element]) == self.mesh.cracks[0].tip == (0.08, 0.0025)
        chain = self.mesh.nodes[self.mesh.element_nodes(element)] - self.mesh.cracks[0].tip
        assert np.abs(chain).max() == pytest.approx(0.02 * 0.0025)
        # Counter-clockwise from the left face to the right one.
        assert chain[0, 0] < 0 < chain[-1, 0] and chain[0, 1] == pytest.approx(chain[-1, 1])


def test_closed_crack_has_two_faces():
    mesh = Beam(LENGTH, HEIGHT, [VNotch(0.08, 0.0025, 0)]).mesh(order=4)
    assert (mesh.pairs.gap == 0).all()
    assert (mesh.pairs.nodes[:, 0] != mesh.pairs.nodes[:, 1]).all()
    assert np.abs(mesh.nodes[mesh.pairs.nodes[:, 0]] - mesh.nodes[mesh.pairs.nodes[:, 1]]).max() == 0
    assert mesh.points["B"] != mesh.points["C"]


def test_notches_keep_the_order_in_which_they_are_given():
    mesh = BEAMS["two notches apart"].mesh()
    assert [crack.tip[0] for crack in mesh.cracks] == [0.3, 0.08]
    assert (np.diff(mesh.pairs.crack) >= 0).all()
    assert mesh.nodes[mesh.points["B2"]][0] > mesh.nodes[mesh.points["C2"]][0] > 0.07
    assert mesh.nodes[mesh.points["B"]][0] == 0.3
    assert {"crack1_left", "crack1_right", "crack2_left", "crack2_right"} <= set(mesh.edge_sets)


@pytest.mark.parametrize("name", ["small hole", "hole near the edge", "three holes", "notch above a hole"])
def test_nodes_of_holes_lie_on_the_circle(name):
    beam = BEAMS[name]
    mesh = beam.mesh(order=6)
    for i, hole in enumerate(beam.holes, 1):
        nodes = mesh.nodes[mesh.edges[mesh.edge_sets[f"hole{i}"]]].reshape(-1, 2)
        assert np.hypot(*(nodes - [hole.x, hole.y]).T) == pytest.approx(hole.radius, abs=1e-15 * beam.length)


def test_the_area_converges_with_the_order_on_curved_edges():
    beam = Beam(0.02, HEIGHT, holes=[Hole(0.01, 0.0025, 0.002)])
    errors = [abs(beam.mesh(order=p).area / beam.area - 1) for p in (1, 2, 4, 6)]
    assert errors[0] > 1e-3 > errors[1] > 1e-6 > errors[2] * 1e3 > 1e-11 > errors[3]


@pytest.mark.parametrize("kind", ["columns", "rows", "filled", "corners"])
def test_user_points_are_nodes(kind):
    points = {
        "inside": (0.2, 0.0013),
        "edge": (0.081, 0.0),
        "near": (0.0815, 0.002),
        "end": (LENGTH, 0.004),
        "clamp": (0.0, 0.001),
        "top": (0.0795, HEIGHT),
    }
    if kind == "filled":
        points["close to the tip"] = (0.0802, 0.0011)
    options = {"rows": {"size": 0.0013}, "corners": {"corner_size": 1e-4, "corners": ("left", "right")}}.get(
        kind, {}
    )
    mesh = PAPER.mesh(order=3, points=points, **options)
    for name, point in points.items():
        assert mesh.nodes[mesh.points[name]] == pytest.approx(point, abs=1e-12)
    check_mesh(mesh, PAPER.area, 1e-12)


def test_graded_corners():
    mesh = PAPER.mesh(corner_size=2e-5)
    check_mesh(mesh, PAPER.area, 1e-12)
    y = np.unique(mesh.nodes[mesh.edges[mesh.edge_sets["left"]]][..., [0, -1], 1])
    assert y[1] == pytest.approx(2e-5) and y[-2] == pytest.approx(HEIGHT - 2e-5)
    assert len(mesh.edge_sets["left"]) == len(
        PAPER.mesh(corner_size=2e-5, corners=["left", "right"]).edge_sets["right"]
    )
    # Rings of the four squares are similar: two trapezoids that mirror each other, and the squares in the
    # corners.
    assert distinct_shapes(mesh) <= distinct_shapes(PAPER.mesh(corners=())) + 4


def test_paper_layout_has_four_cells_at_the_tip():
    mesh = PAPER.mesh(layout="vertex")
    tip = np.flatnonzero(np.hypot(*(mesh.nodes - mesh.cracks[0].tip).T) < 1e-12)
    assert len(tip) == 1 and tip[0] not in mesh.pairs.nodes
    assert sum(tip[0] in mesh.element_nodes(e) for e in range(mesh.elements)) == 4


@pytest.mark.parametrize(
    ("beam", "points"),
    [
        # gmsh's Blossom recombination folded the cells around these embedded points.
        (
            Beam(0.003, HEIGHT, holes=[Hole(0.000813126, 0.000438446, 0.00025813)]),
            {"p": (0.00140653, 0.00484011), "q": (0.00235, 0.0)},
        ),
        (
            Beam(0.01, HEIGHT, [VNotch(0.00603966, 0.00275299, 100)]),
            {"p": (0.00499234, 0.0), "q": (0.00436926, 3.15654e-05)},
        ),
    ],
)
def test_points_that_the_mesher_stumbled_over(beam, points):
    check_mesh(beam.mesh(points=points), beam.area, 1e-6)


@pytest.mark.parametrize("order", [1, 2, 9, 20])
def test_orders(order):
    check_mesh(PAPER.mesh(order=order), PAPER.area, 1e-12)


def test_size_and_grading():
    assert PAPER.mesh(size=0.005).elements > PAPER.mesh().elements
    assert PAPER.mesh(size=0.0025).elements > 300
    coarse, fine = PAPER.mesh(grading=5.0), PAPER.mesh(grading=1.5)
    assert len(coarse.pairs) < len(PAPER.mesh().pairs) < len(fine.pairs)


def test_save_and_load(tmp_path):
    mesh = BEAMS["hole beside notch"].mesh(points={"a/b": (0.2, 0.0)})
    mesh.save(tmp_path / "mesh.h5")
    again = BoundaryMesh.load(tmp_path / "mesh.h5")
    for name in ("order", "material_names", "points", "cracks"):
        assert getattr(again, name) == getattr(mesh, name)
    for name in (
        "nodes",
        "edges",
        "element_start",
        "element_edges",
        "element_reversed",
        "scaling_centres",
        "closed",
        "materials",
    ):
        assert np.array_equal(getattr(again, name), getattr(mesh, name))
    assert all(np.array_equal(again.edge_sets[name], edges) for name, edges in mesh.edge_sets.items())
    assert all(
        np.array_equal(getattr(again.pairs, name), getattr(mesh.pairs, name))
        for name in ("nodes", "normal", "gap", "crack", "position")
    )
    assert [path.name for path in tmp_path.iterdir()] == ["mesh.h5"]


def test_export(tmp_path):
    meshio = pytest.importorskip("meshio")
    mesh = PAPER.mesh(order=3)
    mesh.export(tmp_path / "mesh.vtu")
    read = meshio.read(tmp_path / "mesh.vtu")
    assert len(read.cells[0].data) == 3 * len(mesh.edges)
    assert read.cell_data["set_left"][0].sum() == 3 * len(mesh.edge_sets["left"])


def test_repr_tells_what_it_is():
    mesh = PAPER.mesh()
    assert "79 S-elements of order 5" in repr(mesh) and "71 contact pairs" in repr(mesh)
    assert repr(PAPER).startswith("Beam(length=0.4 m") and "deg" in repr(PAPER)
    assert "crack1" in repr(mesh.cracks[0]) and "71" in repr(mesh.pairs)
