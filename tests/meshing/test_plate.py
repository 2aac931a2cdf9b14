"""Plates: outlines, holes and cracks of any path; what is refused."""

import math
from dataclasses import replace

import numpy as np
import pytest
from mesh_checks import check_mesh, distinct_shapes

from meshing import Beam, BoundaryMesh, CrackLine, Hole, Plate, VNotch

SIDE = 0.1
SQUARE = [(0, 0), (SIDE, 0), (SIDE, SIDE), (0, SIDE)]


def ray(angle, length=0.02):
    return CrackLine(
        [
            (0.05, 0.05),
            (0.05 + length * math.cos(math.radians(angle)), 0.05 + length * math.sin(math.radians(angle))),
        ]
    )


# Cracks, tips by name, S-elements with their scaling centre on a tip, length of all cracks.
CRACKS = {
    "edge": ([CrackLine([(0.05, 0.1), (0.05, 0.06)])], ["crack1"], 0.04),
    "bottom": ([CrackLine([(0.03, 0.0), (0.04, 0.03)], name="c")], ["c"], math.hypot(0.01, 0.03)),
    "embedded": (
        [CrackLine([(0.03, 0.04), (0.07, 0.06)])],
        ["crack1:1", "crack1:2"],
        math.hypot(0.04, 0.02),
    ),
    "kink": ([CrackLine([(0.05, 0.1), (0.05, 0.07), (0.08, 0.07)])], ["crack1"], 0.06),
    "kink at the tip": (
        [CrackLine([(0.05, 0.1), (0.05, 0.0601), (0.0501, 0.06)])],
        ["crack1"],
        0.0399 + 1e-4 * math.sqrt(2),
    ),
    "crossing": (
        [CrackLine([(0.03, 0.05), (0.07, 0.05)]), CrackLine([(0.05, 0.03), (0.05, 0.07)])],
        ["crack1:1", "crack1:2", "crack2:1", "crack2:2"],
        0.08,
    ),
    "T": (
        [CrackLine([(0.03, 0.05), (0.07, 0.05)]), CrackLine([(0.05, 0.1), (0.05, 0.05)])],
        ["crack1:1", "crack1:2"],
        0.09,
    ),
    "star": ([ray(10), ray(140), ray(260)], ["crack1", "crack2", "crack3"], 0.06),
    "through": ([CrackLine([(0, 0.05), (0.1, 0.06)])], [], math.hypot(0.1, 0.01)),
    "branch from the through one": (
        [CrackLine([(0, 0.05), (0.1, 0.05)]), CrackLine([(0.05, 0.05), (0.06, 0.07)])],
        ["crack2"],
        0.1 + math.hypot(0.01, 0.02),
    ),
    "from corner to corner": ([CrackLine([(0, 0), (0.1, 0.1)])], [], 0.1 * math.sqrt(2)),
    "closed ring": (
        [CrackLine([(0.04, 0.04), (0.06, 0.04), (0.06, 0.06), (0.04, 0.06), (0.04, 0.04)])],
        [],
        0.08,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CRACKS)
def test_cracks_of_any_path(name):
    cracks, tips, length = CRACKS[name]
    mesh = Plate(SQUARE, cracks=cracks).mesh(order=3)
    check_mesh(mesh, SIDE**2, 1e-12)
    assert [tip.name for tip in mesh.tips] == tips
    assert sum(crack.length for crack in mesh.cracks) == pytest.approx(length)
    assert sum(~mesh.closed) == len(tips)
    inside = 0.0
    for tip in mesh.tips:
        assert tuple(mesh.scaling_centres[tip.element]) == tip.position
        chain = mesh.nodes[mesh.element_nodes(tip.element)] - tip.position
        inside += math.hypot(*chain[0])
        # From the face at the left hand round to the one at the right; they coincide on the axis.
        assert chain[0] == pytest.approx(chain[-1], abs=1e-15)
        assert chain[0] / math.hypot(*chain[0]) == pytest.approx(tip.axis)
    pairs = mesh.pairs
    # Every bit of face outside the tip elements is someone's.
    assert pairs.weight.sum() == pytest.approx(length - inside)
    assert (pairs.gap == 0).all() and (pairs.nodes[:, 0] != pairs.nodes[:, 1]).all()
    assert np.abs(mesh.nodes[pairs.nodes[:, 0]] - mesh.nodes[pairs.nodes[:, 1]]).max() == 0
    assert np.hypot(*pairs.normal.T) == pytest.approx(1)
    # A right face's cells lie on the side to which the normal points.
    for side, sign in ((0, 1.0), (1, -1.0)):
        for node, normal in zip(pairs.nodes[::3, side], pairs.normal[::3]):
            cells = [e for e in range(mesh.elements) if node in mesh.element_nodes(e)]
            middle = mesh.scaling_centres[cells] - mesh.nodes[node]
            assert (sign * middle @ normal).max() > 0


def test_uniform_pressure_on_the_faces_is_in_balance():
    """Weight times normal are the forces of a unit pressure: their sum is the chord turned by 90 degrees."""
    mesh = Plate(SQUARE, cracks=[CrackLine([(0.05, 0.1), (0.05, 0.07), (0.08, 0.05)])]).mesh(order=4)
    tip = mesh.tips[0]
    start = mesh.nodes[mesh.element_nodes(tip.element)[0]]
    chord = np.array([0.05, 0.1]) - start
    assert mesh.pairs.weight @ mesh.pairs.normal == pytest.approx([chord[1], -chord[0]])
    # The kink has a pair for each side.
    at_kink = np.hypot(*(mesh.nodes[mesh.pairs.nodes[:, 0]] - [0.05, 0.07]).T) < 1e-12
    assert sum(at_kink) == 2 and len(set(mesh.pairs.nodes[at_kink, 0])) == 1


@pytest.mark.slow
def test_smooth_bends_have_one_pair_for_each_node():
    angle = np.linspace(0, np.pi / 2, 31)
    arc = np.stack([0.05 + 0.04 * (1 - np.cos(angle)), 0.1 - 0.04 * np.sin(angle)], axis=1)
    mesh = Plate(SQUARE, cracks=[CrackLine(arc)]).mesh(order=3)
    check_mesh(mesh, SIDE**2, 1e-12)
    assert len(np.unique(mesh.pairs.nodes[:, 0])) == len(mesh.pairs)
    centre = np.array([0.09, 0.1])
    outwards = mesh.nodes[mesh.pairs.nodes[:, 0]] - centre
    outwards /= np.hypot(*outwards.T)[:, None]
    # Chords of 3 degrees: the normal is at most half of that off the radius.
    assert np.abs(np.abs((mesh.pairs.normal * outwards).sum(axis=1))).min() > math.cos(math.radians(1.6))


def test_edge_sets_and_points():
    plate = Plate(
        SQUARE,
        holes=[Hole(0.03, 0.03, 0.02)],
        cracks=[CrackLine([(0.04, 0.03), (0.06, 0.04)], name="c"), CrackLine([(0.03, 0.04), (0.03, 0.1)])],
    )
    mesh = plate.mesh(order=6, points={"P": (0.07, 0.07), "Q": (0.1, 0.03)})
    check_mesh(mesh, plate.area, 1e-9)
    assert [f"edge{i}" for i in range(1, 5)] + ["hole1"] == list(mesh.edge_sets)[:5]
    assert {"c_left", "c_right", "crack2_left", "crack2_right"} == set(list(mesh.edge_sets)[5:])
    for name, axis, value in (("edge1", 1, 0), ("edge2", 0, 0.1), ("edge3", 1, 0.1), ("edge4", 0, 0)):
        assert (mesh.nodes[mesh.edges[mesh.edge_sets[name]]][..., axis] == value).all()
        ends = mesh.nodes[mesh.edges[mesh.edge_sets[name]][:, [0, -1]]]
        assert np.abs(np.diff(ends, axis=1)).sum() == pytest.approx(SIDE)
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([0.07, 0.07])
    assert mesh.nodes[mesh.points["Q"]] == pytest.approx([0.1, 0.03])
    hole = mesh.nodes[mesh.edges[mesh.edge_sets["hole1"]]].reshape(-1, 2)
    assert np.hypot(*(hole - 0.03).T) == pytest.approx(0.01, rel=1e-9)
    # The crack between hole and edge has no tip.
    assert [tip.name for tip in mesh.tips] == ["c"]
    named = Plate(SQUARE, edge_names=["below", "sides", "above", "sides"]).mesh(order=2)
    assert set(named.edge_sets) == {"below", "sides", "above"}


def test_tips_of_a_plate_are_congruent():
    """Stars of one crack's two tips and of a second, parallel crack of the same length."""
    cracks = [CrackLine([(0.02, y), (0.04, y)]) for y in (0.03, 0.07)]
    mesh = Plate(SQUARE, cracks=cracks).mesh(order=2)
    radius = 0.4 * 0.02
    near = [
        e
        for e in range(mesh.elements)
        if any(
            np.hypot(*(mesh.nodes[mesh.element_nodes(e)] - tip.position).T).max() < 1.001 * radius
            for tip in mesh.tips
        )
    ]
    parts = [mesh.element_nodes(e) for e in near]
    assert len(parts) >= 4 * 25
    few = Subset(mesh, near)
    assert distinct_shapes(few) <= 6


class Subset:
    """Some S-elements of a mesh, for the count of shapes."""

    def __init__(self, mesh, numbers):
        self.elements, self.order, self.nodes = len(numbers), mesh.order, mesh.nodes
        self.closed, self.scaling_centres = mesh.closed[numbers], mesh.scaling_centres[numbers]
        self.element_nodes = lambda e: mesh.element_nodes(numbers[e])


@pytest.mark.parametrize("opening", [0.05, 2.0, 8.0])
def test_opening(opening):
    tangent = math.tan(math.radians(opening / 2))
    mesh = Plate(SQUARE, cracks=[CrackLine([(0.05, 0.1), (0.05, 0.06)], opening=opening)]).mesh(order=3)
    check_mesh(mesh, SIDE**2 - 0.04**2 * tangent, 1e-12)
    assert mesh.pairs.gap == pytest.approx(2 * tangent * mesh.pairs.arc)
    assert mesh.tips[0].opening == pytest.approx(math.radians(opening))
    right, left = (mesh.nodes[mesh.points[f"crack1_{side}"]] for side in ("right", "left"))
    assert right == pytest.approx([0.05 + 0.04 * tangent, 0.1])
    assert left == pytest.approx([0.05 - 0.04 * tangent, 0.1])
    lens = Plate(SQUARE, cracks=[CrackLine([(0.03, 0.05), (0.07, 0.05)], opening=opening)]).mesh(order=3)
    assert lens.pairs.gap.max() == pytest.approx(2 * tangent * 0.02)
    assert lens.pairs.gap == pytest.approx(2 * tangent * np.minimum(lens.pairs.arc, 0.04 - lens.pairs.arc))


def test_opening_of_a_kinked_crack():
    """At each pair the faces are as far apart as the angle and the way from the tip say, also at the kink of
    27 degrees; as they run on to the mouth, they turn by a thousandth of a degree there.
    """
    line = CrackLine([(0.05, 0.1), (0.05, 0.07), (0.06, 0.05)], opening=0.2)
    pairs = Plate(SQUARE, cracks=[line]).mesh(order=2, face_edges=8).pairs
    kink = np.abs(pairs.arc - math.hypot(0.01, 0.02)) < 1e-6
    assert kink.sum() == 2
    assert pairs.gap == pytest.approx(2.0 * math.tan(math.radians(0.1)) * pairs.arc, rel=1e-4)


@pytest.mark.parametrize("opening", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("turn", [-90, -45, 30, 60, 90])
def test_wide_opening_of_a_sharp_kink(turn, opening):
    """Nothing is passed by what moves along the inner face of a kink; what stands open is a wedge of the
    crack's length, and as wide as the way from the tip says (apart from the turn of the faces at the kink).
    """
    tip = (0.03 + 0.02 * math.cos(math.radians(turn)), 0.05 + 0.02 * math.sin(math.radians(turn)))
    mesh = Plate(SQUARE, cracks=[CrackLine([(0, 0.05), (0.03, 0.05), tip], opening=opening)]).mesh(order=3)
    width = 2.0 * math.tan(math.radians(opening / 2))
    check_mesh(mesh, 0.1**2 - 0.5 * width * 0.05**2, 1e-12)
    assert mesh.cracks[0].length == pytest.approx(0.05)
    assert mesh.pairs.gap == pytest.approx(width * mesh.pairs.arc, rel=0.06 * width)


def test_an_end_that_lies_nearly_on_another_crack():
    """Of a branch that starts 1.8e-6 m beside a crack (2.8e-6 m are nothing in a plate of 28 m) and then
    crosses it: it meets it in its end.
    """
    main = [(-1.37939, 0.44923), (0.5, 1.13327)]
    branch = [(-0.43969, 0.79125), (0.20309, 1.55730)]
    square = [(-10, -10), (10, -10), (10, 10), (-10, 10)]
    mesh = Plate(square, cracks=[CrackLine(main), CrackLine(branch)]).mesh(order=2)
    check_mesh(mesh, 400.0, 1e-12)
    assert len(mesh.tips) == 3


def test_face_size_adds_pairs_and_no_elements():
    plate = Plate(SQUARE, cracks=[CrackLine([(0.05, 0.1), (0.05, 0.06)])])
    coarse, fine = plate.mesh(), plate.mesh(face_size=0.5e-3)
    assert coarse.elements == fine.elements and len(fine.pairs) > 5 * len(coarse.pairs) > 300
    longest = np.diff(np.unique(fine.pairs.arc)).max()
    assert longest < 0.5e-3
    assert len(plate.mesh(face_edges=40).pairs) > 200
    assert plate.mesh(tip_element=False).tips[0].element == -1
    small = plate.mesh(tip_size=1e-5)
    chain = small.nodes[small.element_nodes(small.tips[0].element)] - small.tips[0].position
    assert np.hypot(*chain.T).max() == pytest.approx(1e-5)


def test_save_and_load(tmp_path):
    mesh = Plate(SQUARE, cracks=[CrackLine([(0.03, 0.04), (0.07, 0.06)], name="c")]).mesh(order=2)
    mesh.save(tmp_path / "plate.h5")
    found = BoundaryMesh.load(tmp_path / "plate.h5")
    assert found.tips == mesh.tips and found.cracks == mesh.cracks
    for name in ("nodes", "normal", "gap", "crack", "position", "arc", "weight"):
        np.testing.assert_array_equal(getattr(found.pairs, name), getattr(mesh.pairs, name))


EDGE = CrackLine([(0.05, 0.1), (0.05, 0.06)])


@pytest.mark.parametrize(
    ("plate", "says"),
    [
        (lambda: Plate([(0, 0), (1, 0)]), "has 2 points, at least 3"),
        (lambda: Plate(SQUARE[::-1]), "runs clockwise"),
        (lambda: Plate([(0, 0), (1, 1), (1, 0), (0, 1)]), "crosses or touches itself"),
        (lambda: Plate([*SQUARE, (0, 0)]), "corners 5 and 1 of the outline coincide"),
        (lambda: Plate([(0, 0), (1, math.nan), (1, 1)]), "point 2 of outline: y = nan must"),
        (lambda: Plate(SQUARE, holes=[Hole(0.2, 0.05, 0.01)]), "hole 1"),
        (lambda: Plate(SQUARE, holes=[Hole(0.05, 0.05, 0.1)]), "leaves or touches the outline"),
        (
            lambda: Plate(SQUARE, holes=[Hole(0.05, 0.05, 0.02), Hole(0.06, 0.05, 0.02)]),
            "holes 1 and 2 overlap",
        ),
        (lambda: Plate(SQUARE, edge_names=["a"]), "edge_names has 1 entries"),
        (lambda: Plate(SQUARE, cracks=[CrackLine([(0.05, 0.1), (0.05, 0.06)], name="edge1")]), "given twice"),
        (lambda: Plate(SQUARE, cracks=[EDGE, CrackLine(EDGE.points, name="crack1")]), "given twice"),
        (lambda: CrackLine([(0, 0)]), "has 1 points, at least 2"),
        (
            lambda: Plate([(0, 0), (1e200, 0), (1e200, 1e200)]),
            "point 2 of outline: x = 1e+200 must be finite",
        ),
        (lambda: Plate([(0, 0), (10**400, 0), (1, 1)]), "point 2 of outline: x = 1000"),
        (lambda: Plate([(1e9 + x, 1e9 + y) for x, y in SQUARE]), "coordinates have too few digits"),
        (lambda: CrackLine([(0, 0), (1, 1)], name="a\0b"), "control characters"),
        (lambda: CrackLine([(0, 0), (0, 0), (1, 1)]), "stands twice in a row"),
        (lambda: CrackLine([(0, 0), (1, 1)], opening=-1), "opening is -1"),
        (lambda: CrackLine([(0, 0), (1, 1)], opening=90), "draw a wider notch"),
        (lambda: CrackLine([(0, 0), (1, 1, 1)]), "a pair (x, y) was expected"),
        (lambda: CrackLine([(0, 0), (1, 1)], name="a:b"), "without ':' and"),
    ],
)
def test_refused_plates(plate, says):
    with pytest.raises((ValueError, TypeError)) as caught:
        plate()
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("cracks", "says"),
    [
        ([[(0.05, 0.11), (0.05, 0.06)]], "point (0.05, 0.11) m is outside the body"),
        ([[(0.2, 0.1), (0.3, 0.06)]], "outside the body"),
        ([[(0.02, 0.0), (0.08, 0.0)]], "runs along side 1 of the outline"),
        ([[(0.05, 0.1), (0.05, 0.100001), (0.06, 0.06)]], "outside the body"),
        ([[(0.05, 0.1), (0.05, 0.06)], [(0.05, 0.09), (0.05, 0.05)]], "runs along crack"),
        ([[(0.05, 0.1), (0.05, 0.06), (0.05, 0.08)]], "runs along crack"),
        ([[(0.05, 0.1), (0.05, 0.06)], [(0.050001, 0.08), (0.07, 0.08)]], "without touching it"),
        ([[(0.05, 0.1), (0.05, 0.000003)]], "end it on the edge or move it"),
        ([[(0.02, 0.02), (0.03, 0.08)]], "crosses hole 1"),
        ([[(0.025, 0.05), (0.05, 0.08)]], "is inside hole 1"),
        # lines that pass between their points: touching a hole, next to one, cutting off a sliver of one
        ([[(0.01, 0.055), (0.05, 0.055)]], "it passes hole 1 at 0 m"),
        ([[(0.01, 0.05500001), (0.05, 0.05500001)]], "it passes hole 1 at 1e-08 m"),
        ([[(0.01, 0.0549999), (0.05, 0.0549999)]], "crosses hole 1"),
        ([[(0.0000001, 0.0), (0.05, 0.02)]], "it passes the outline's corner (0, 0) m at 1e-07 m"),
        ([[(0.05, 0.05), (0.05, 0.05000000001)]], "where all counts as one place"),
    ],
)
def test_refused_cracks(cracks, says):
    plate = Plate(SQUARE, holes=[Hole(0.025, 0.05, 0.01)], cracks=[CrackLine(points) for points in cracks])
    with pytest.raises(ValueError) as caught:
        plate.mesh(order=2)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"size": 0}, "size = 0 must"),
        ({"size": 1e-6}, "below 0.1 %"),
        ({"tip_size": 0.05}, "tip_size 0.05 m does not fit"),
        ({"tip_size": 1e-12}, "round-off"),
        ({"grading": 1.0}, "grading is 1"),
        ({"face_edges": 0}, "face_edges = 0 must be between 1 and 1000"),
        ({"face_edges": 2.5}, "face_edges = 2.5 must be an integer"),
        ({"face_size": -1}, "face_size = -1 must"),
        ({"points": {"P": (0.2, 0.2)}}, "outside the body"),
        ({"points": {"P": (0.05, 0.08)}}, "on or next to crack 'crack1'"),
        ({"points": {"P": 3}}, "a pair (x, y) was expected"),
        ({"order": 0}, "order = 0 must"),
    ],
)
def test_refused_options(options, says):
    with pytest.raises((ValueError, TypeError)) as caught:
        Plate(SQUARE, cracks=[EDGE]).mesh(**options)
    assert says in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("opening", [0.05, 5.0, 20.0])
@pytest.mark.parametrize("body", [Plate([(0, 0), (1, 0), (1, 1), (0, 1)]), Beam(1.0, 1.0)])
def test_named_points_stay_where_they_are(body, opening):
    """A crack that opens moves what lies around it, but not what is named."""
    lines = [CrackLine([(0.3, 1.0), (0.3, 0.7)], opening), CrackLine([(0.6, 0.3), (0.7, 0.7)], opening)]
    points = {"P": (0.35, 0.8), "Q": (0.25, 0.91), "R": (0.3, 0.68), "S": (0.71, 0.5)}
    mesh = replace(body, cracks=lines).mesh(points=points)
    for name, place in points.items():
        assert mesh.nodes[mesh.points[name]].tolist() == list(place)


def test_points_in_an_opening_are_refused():
    between = {"P": (0.01, 0.06)}  # m, the faces stand 21 mm apart there
    on = {"P": (0.01, 0.05)}
    line = [(0.0, 0.05), (0.07, 0.05)]
    for opening in (0.0, 20.0):
        plate = Plate(SQUARE, cracks=[CrackLine(line, opening)])
        beam = Beam(0.2, 0.1, cracks=[CrackLine([(0.1, 0.0), (0.1, 0.05)], opening)])
        # at a mouth, too, where there are two nodes; it had been the left one
        for body, place in ((plate, on["P"]), (plate, (0.0, 0.05)), (beam, (0.1, 0.02)), (beam, (0.1, 0.0))):
            with pytest.raises(ValueError, match="'P' at .* is (on or next to|in or on) crack"):
                body.mesh(points={"P": place})
    with pytest.raises(ValueError, match="opens by up to 20 degrees run into the cells near"):
        Plate(SQUARE, cracks=[CrackLine(line, 20.0)]).mesh(points=between)


def test_opening_is_refused():
    meeting = [CrackLine([(0.05, 0.1), (0.05, 0.06)], opening=1), CrackLine([(0.05, 0.08), (0.07, 0.08)])]
    with pytest.raises(ValueError, match="cracks that meet start closed"):
        Plate(SQUARE, cracks=meeting).mesh(order=2)
    # at the tip of an open notch, through it and on its flank a crack ended in KeyErrors or counts of edges
    flank = (0.2 + 0.01 * math.tan(math.radians(5.0)), 0.04)
    for line in ([(0.2, 0.03), (0.2, 0.02)], [(0.1, 0.03), (0.3, 0.03)], [(0.25, 0.04), flank]):
        beam = Beam(0.4, 0.05, [VNotch(0.2, 0.02, 10.0)], cracks=[CrackLine(line)])
        with pytest.raises(ValueError, match="10 degrees, but it meets crack 'crack2' .* draw the notch"):
            beam.mesh(order=2)
    with pytest.raises(ValueError, match="it has no tip to open from"):
        Plate(SQUARE, cracks=[CrackLine([(0, 0.05), (0.1, 0.05)], opening=1)]).mesh(order=2)


@pytest.mark.long
def test_checks_take_no_square_of_the_number_of_segments():
    """Outlines of many corners, and a mesh of a plate with many holes."""
    angle = np.linspace(0, 2 * np.pi, 20_000, endpoint=False)
    Plate(np.stack([np.cos(angle), np.sin(angle)], axis=1))
    Plate(
        [(0, 0), (100, 0), (100, 100), (0, 100)],
        holes=[Hole(x, y, 0.5) for x in range(1, 100) for y in range(1, 60)],
    )


@pytest.mark.slow
def test_needles_between_cracks():
    """Lines that meet at two degrees: gmsh's quadrilaterals overlap there, its triangles do not."""
    lines = [
        [(0.1, 0), (0.0521, 0.06), (0.1, 0.0714)],
        [(0, 0), (0.0137, 0.0222), (0.0824, 0.089), (0.0195, 0.0295)],
    ]
    square = [(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)]
    mesh = Plate(square, cracks=[CrackLine(points) for points in lines]).mesh(order=1)
    assert mesh.area == pytest.approx(0.01, rel=1e-12)
