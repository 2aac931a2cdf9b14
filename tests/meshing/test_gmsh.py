"""A user's gmsh models: geometry and meshes, straight and curved, cracks, materials, and models that are
refused.
"""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from mesh_checks import check_mesh

from meshing import read_gmsh

gmsh = pytest.importorskip("gmsh")

PLATE = """
h = 0.2;
Point(1)={0,0,0,h}; Point(2)={1.5,0,0,h}; Point(3)={2,0,0,h}; Point(4)={2,1,0,h}; Point(5)={1.5,1,0,h};
Point(6)={1,1,0,h}; Point(7)={0,1,0,h}; Point(8)={1,0.5,0,h};
Point(9)={0.4,0.5,0,h}; Point(10)={0.55,0.5,0,h}; Point(11)={0.4,0.65,0,h};
Point(12)={0.25,0.5,0,h}; Point(13)={0.4,0.35,0,h};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,6};
Line(6)={6,7}; Line(7)={7,1}; Line(8)={2,5}; Line(9)={6,8};
Circle(10)={10,9,11}; Circle(11)={11,9,12}; Circle(12)={12,9,13}; Circle(13)={13,9,10};
Curve Loop(1)={1,8,5,6,7}; Curve Loop(2)={10,11,12,13}; Curve Loop(3)={2,3,4,-8};
Plane Surface(1)={1,2}; Plane Surface(2)={3};
Curve{9} In Surface{1};
Physical Surface("steel")={1}; Physical Surface("brass")={2};
Physical Curve("clamp")={7}; Physical Curve("load")={3}; Physical Curve("hole")={10:13};
Physical Curve("rest")={1,2,4,5,6};
Physical Curve("crack:main")={9};
Physical Point("P")={4};
"""
AREA = 2.0 - np.pi * 0.15**2

# A plate whose notch is part of the outline.
NOTCHED = """
h = 0.25;
Point(1)={0,0,0,h}; Point(2)={1,0,0,h}; Point(3)={1,1,0,h}; Point(4)={0.55,1,0,h}; Point(5)={0.5,0.5,0,h};
Point(6)={0.45,1,0,h}; Point(7)={0,1,0,h};
Line(1)={1,2}; Line(2)={2,3}; Line(3)={3,4}; Line(4)={4,5}; Line(5)={5,6}; Line(6)={6,7}; Line(7)={7,1};
Transfinite Curve{4}=%d; Transfinite Curve{5}=%d;
Curve Loop(1)={1:7}; Plane Surface(1)={1};
Physical Surface("steel")={1}; Physical Curve("clamp")={7}; Physical Curve("rest")={1,2,3,6};
Physical Curve("crack:V:right")={4}; Physical Curve("crack:V:left")={5};
"""


def write(folder, text, name="model.geo"):
    path = folder / name
    path.write_text(text)
    return path


def to_msh(geo, order=1, quads=False, version=4.1):
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(geo))
        gmsh.option.setNumber("Mesh.RecombineAll", quads)
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        path = geo.with_suffix(".msh")
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


def msh2(points, elements, groups):
    """Text of an .msh file, version 2: elements are (type, physical tag, nodes)."""
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat"]
    if groups:
        lines += [
            "$PhysicalNames",
            str(len(groups)),
            *(f'{d} {tag} "{name}"' for d, tag, name in groups),
            "$EndPhysicalNames",
        ]
    lines += [
        "$Nodes",
        str(len(points)),
        *(f"{i} {x} {y} 0" for i, (x, y) in enumerate(points, 1)),
        "$EndNodes",
    ]
    lines += ["$Elements", str(len(elements))]
    lines += [
        f"{i} {kind} 2 {tag} {max(tag, 1)} {' '.join(map(str, nodes))}"
        for i, (kind, tag, nodes) in enumerate(elements, 1)
    ]
    return "\n".join([*lines, "$EndElements", ""])


@pytest.mark.parametrize("tip_element", [True, False])
def test_geo_with_hole_materials_and_crack(tmp_path, tip_element):
    mesh = read_gmsh(write(tmp_path, PLATE), order=4, tip_element=tip_element)
    check_mesh(mesh, AREA, 1e-7)
    assert mesh.material_names == ("steel", "brass")
    assert set(mesh.edge_sets) == {"clamp", "load", "hole", "rest", "main_right", "main_left"}
    hole = mesh.nodes[mesh.edges[mesh.edge_sets["hole"]]].reshape(-1, 2)
    assert np.hypot(*(hole - [0.4, 0.5]).T) == pytest.approx(0.15, abs=1e-14)
    crack = mesh.cracks[0]
    assert (crack.name, crack.tip, crack.axis, crack.opening) == ("main", (1.0, 0.5), (0.0, 1.0), 0.0)
    assert (crack.tip_element >= 0) == tip_element
    assert crack.length == pytest.approx(0.5)
    assert len(mesh.pairs) == 4 * len(mesh.edge_sets["main_right"]) + tip_element
    assert (mesh.pairs.nodes[:, 0] != mesh.pairs.nodes[:, 1]).all() and (mesh.pairs.gap == 0).all()
    # The right face belongs to cells at x > 1.
    right = [e for e in range(mesh.elements) if mesh.points["main_right"] in mesh.element_nodes(e)]
    assert (mesh.scaling_centres[right, 0] > 1).all()
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([2, 1])
    brass = mesh.materials == 1
    assert (mesh.scaling_centres[brass, 0] > 1.5).all() and (mesh.scaling_centres[~brass, 0] < 1.5).all()


@pytest.mark.parametrize("tag", [4, 6])
def test_points_on_cracks_are_warned_of(tmp_path, tag):
    """There are two nodes; it is the left one's, at the mouth here, which was not said."""
    text = PLATE.replace('Physical Point("P")={4}', f'Physical Point("P")={{{tag}}}')
    says = "point 'P' at (1, 1) m lies on crack 'main' and is on its left face there, main_left, alone"
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = read_gmsh(write(tmp_path, text), order=3)
    assert [says in str(warning.message) for warning in told] == [True] * (tag == 6)
    assert (mesh.points["P"] == mesh.points["main_left"]) == (tag == 6)


def test_edges_around_tips_are_missed(tmp_path):
    """A curve's part inside the element on a tip has no edges and no loads: .018 of 1.4 m were left out. On a
    crack's line it is both faces (it was told to be no crack).
    """
    text = PLATE.replace('Physical Curve("rest")', 'Physical Curve("slit")={9}; Physical Curve("rest")')
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        mesh = read_gmsh(write(tmp_path, text), order=3, tip_size=0.02)
    reach = abs(np.diff(mesh.tips[0].arc)[0])
    says = f"{reach:.3g} m of 'slit' lie inside the elements around crack tips, which have no edges there"
    assert "'slit' lies on 'crack:main' and is an edge set of both its faces" in str(told[0].message)
    assert [says in str(warning.message) for warning in told] == [False, True]
    ends = mesh.nodes[mesh.edges[mesh.edge_sets["slit"]][:, [0, -1]]]
    assert np.hypot(*(ends[:, 1] - ends[:, 0]).T).sum() == pytest.approx(2 * (0.5 - reach))


def test_two_cracks_on_one_line(tmp_path):
    """Are refused, and none is said to be an edge set on the other."""
    text = PLATE.replace('Physical Curve("rest")', 'Physical Curve("crack:b")={9}; Physical Curve("rest")')
    with warnings.catch_warnings(), pytest.raises(ValueError, match="belongs to one crack"):
        warnings.simplefilter("error")
        read_gmsh(write(tmp_path, text), order=3)


@pytest.mark.slow
def test_geo_size(tmp_path):
    path = write(tmp_path, PLATE)
    assert read_gmsh(path, size=0.1).elements > 2 * read_gmsh(path).elements


@pytest.mark.parametrize(("order", "error"), [(1, 2e-2), (2, 2e-4), (3, 2e-4)])
@pytest.mark.parametrize(("quads", "version"), [(False, 4.1), (True, 2.2)])
def test_msh(tmp_path, order, error, quads, version):
    mesh = read_gmsh(to_msh(write(tmp_path, PLATE), order, quads, version), order=4)
    check_mesh(mesh, AREA, error)
    assert len(mesh.pairs) > 0 and mesh.cracks[0].tip_element >= 0
    # Rings around the tip are quadrilaterals; beside the faces there are more edges.
    apart = np.hypot(*(mesh.scaling_centres - mesh.cracks[0].tip).T) > 0.6
    assert np.diff(mesh.element_start)[apart].max() == (4 if quads else 3)


def test_notch_with_two_faces(tmp_path):
    mesh = read_gmsh(write(tmp_path, NOTCHED % (5, 5)), order=3)
    check_mesh(mesh, 1 - 0.5 * 0.1 * 0.5, 1e-12)
    assert mesh.pairs.gap == pytest.approx(0.1 * mesh.pairs.position)
    assert mesh.cracks[0].opening == pytest.approx(2 * np.arctan(0.1))
    assert mesh.nodes[mesh.points["V_right"]] == pytest.approx([0.55, 1])
    swapped = (
        (NOTCHED % (5, 5))
        .replace("V:right", "V:other")
        .replace("V:left", "V:right")
        .replace("V:other", "V:left")
    )
    again = read_gmsh(write(tmp_path, swapped, "swapped.geo"), order=3)
    assert again.pairs.gap == pytest.approx(mesh.pairs.gap)


def test_faces_from_the_crack_plugin(tmp_path):
    geo = write(tmp_path, PLATE.replace("crack:main", "line"))
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.merge(str(geo))
        gmsh.model.mesh.generate(2)
        line = next(
            tag for _, tag in gmsh.model.getPhysicalGroups(1) if gmsh.model.getPhysicalName(1, tag) == "line"
        )
        mouth = gmsh.model.addPhysicalGroup(0, [6])
        gmsh.plugin.setNumber("Crack", "Dimension", 1)
        gmsh.plugin.setNumber("Crack", "PhysicalGroup", line)
        gmsh.plugin.setNumber("Crack", "OpenBoundaryPhysicalGroup", mouth)
        gmsh.plugin.setNumber("Crack", "NewPhysicalGroup", 99)
        gmsh.plugin.run("Crack")
        gmsh.model.removePhysicalGroups([(0, mouth)])
        gmsh.model.setPhysicalName(1, 99, "crack:main:right")
        gmsh.model.removePhysicalName("line")
        gmsh.model.setPhysicalName(1, line, "crack:main:left")
        path = tmp_path / "cracked.msh"
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    mesh = read_gmsh(path, order=4)
    check_mesh(mesh, AREA, 2e-2)
    assert len(mesh.pairs) == len(read_gmsh(to_msh(write(tmp_path, PLATE)), order=4).pairs)
    assert (mesh.pairs.gap == 0).all() and mesh.cracks[0].tip == pytest.approx((1, 0.5))


def test_a_session_of_the_user_is_left_alone(tmp_path):
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.model.add("mine")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.77)
        read_gmsh(write(tmp_path, PLATE), order=2, size=0.3)
        assert gmsh.isInitialized() and gmsh.model.getCurrent() == "mine" and "user" not in gmsh.model.list()
        assert gmsh.option.getNumber("Mesh.MeshSizeMax") == 0.77
    finally:
        gmsh.finalize()


SQUARE = [(0, 0), (1, 0), (1, 1), (0, 1)]
STEEL = [(2, 1, "steel")]
BENT = [(0, 0), (1, 0), (1, 1), (0, 1), (0.5, 0.98), (0.02, 0.5)]


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("no groups", msh2(SQUARE, [(3, 0, (1, 2, 3, 4))], []), "no physical surfaces"),
        ("no cells", msh2(SQUARE, [(1, 1, (1, 2))], [(1, 1, "edge")]), "no physical surfaces"),
        (
            "degenerate",
            msh2([*SQUARE, (0.5, 0.0)], [(3, 1, (1, 2, 3, 4)), (2, 1, (1, 5, 2))], STEEL),
            "inverted or degenerate",
        ),
        (
            "inverted",
            msh2(
                [*SQUARE, (2, 0), (2, 1)], [(3, 1, (1, 2, 3, 4)), (2, 1, (2, 5, 6)), (2, 1, (2, 3, 6))], STEEL
            ),
            "inverted or degenerate",
        ),
        (
            "bow-tie",
            msh2([*SQUARE, (2, 0), (2, 1.2)], [(3, 1, (1, 2, 3, 4)), (3, 1, (2, 5, 3, 6))], STEEL),
            "inverted or degenerate",
        ),
        # A second-order triangle whose sides bend far inwards.
        ("not star-convex", msh2(BENT, [(9, 1, (1, 2, 3, 6, 5, 4))], STEEL), "star-convex"),
        (
            "not plane",
            msh2(SQUARE, [(3, 1, (1, 2, 3, 4))], STEEL).replace("3 1 1 0\n", "3 1 1 0.5\n"),
            "plane",
        ),
        (
            "lines off edges",
            msh2(SQUARE, [(3, 1, (1, 2, 3, 4)), (1, 2, (1, 3))], [*STEEL, (1, 2, "crack:c")]),
            "crack line 'crack:c' does not lie on cell",
        ),
        (
            "set off edges",
            msh2(SQUARE, [(3, 1, (1, 2, 3, 4)), (1, 2, (1, 3))], [*STEEL, (1, 2, "clamp")]),
            "curve 'clamp' does not lie on cell edges",
        ),
        (
            "on the outline",
            msh2(SQUARE, [(3, 1, (1, 2, 3, 4)), (1, 2, (1, 2))], [*STEEL, (1, 2, "crack:c")]),
            "lies on the outline",
        ),
        ("junk", "hello", "not a gmsh mesh"),
        ("empty", "", "it is empty"),
    ],
)
def test_refused_meshes(tmp_path, name, text, says):
    path = write(tmp_path, text, "model.msh")
    with pytest.raises(ValueError) as caught:
        read_gmsh(path, order=3)
    assert says in str(caught.value) and str(path) in str(caught.value) and "\n" not in str(caught.value)
    assert not gmsh.isInitialized()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("Physical Surface", "//"), "no physical surfaces"),
        (("crack:main", "crack:"), "empty or misnamed"),
        (("crack:main", "crack:main:left"), "give either crack:main alone or both"),
        (("Curve{9} In Surface{1};", ""), "does not lie on cell edges"),
        (('Physical Curve("crack:main")={9}', 'Physical Curve("crack:main")={9,5}'), "lies on the outline"),
        (('Physical Point("P")={4}', 'Physical Point("P")={8}'), "point 'P' is a crack tip"),
        (("Point(8)={1,0.5,0,h}", "Point(8)={1,-0.5,0,h}"), "curves of surface 1 cross each other near"),
        (("Point(2)={1.5,0,0,h}", "Point(2)={1.5,2,0,h}"), "cross each other near"),
        (("Plane Surface(2)={3};", "Plane Surface(2)={3"), "cannot read or mesh it"),
    ],
)
def test_refused_geometry(tmp_path, change, says):
    assert change[0] in PLATE
    with pytest.raises(ValueError) as caught:
        read_gmsh(write(tmp_path, PLATE.replace(*change)), order=3)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_what_follows_an_error_does_not_show(tmp_path):
    """gmsh's parser keeps it for the next file."""
    with pytest.raises(ValueError, match="cannot read or mesh it"):
        read_gmsh(write(tmp_path, PLATE.replace("Plane Surface(2)={3};", "Plane Surface(2)={3")), order=3)
    assert len(read_gmsh(write(tmp_path, PLATE), order=3).tips) == 1


def test_faces_that_do_not_match(tmp_path):
    with pytest.raises(
        ValueError,
        match=r"model.geo: crack 'V': the faces do not match, 4 edges on the "
        r"right face and 6 on the left",
    ):
        read_gmsh(write(tmp_path, NOTCHED % (5, 7)), order=3, tip_element=False)
    uneven = (NOTCHED % (5, 5)).replace(
        "Transfinite Curve{4}=5", "Transfinite Curve{4}=5 Using Progression 1.3"
    )
    with pytest.raises(
        ValueError, match="crack 'V': the faces do not match, node .* lies at .* of the right face"
    ):
        read_gmsh(write(tmp_path, uneven), order=3)


def test_missing_and_truncated_files(tmp_path):
    with pytest.raises(ValueError, match="there is no such file"):
        read_gmsh(tmp_path / "none.msh")
    path = to_msh(write(tmp_path, PLATE))
    text = path.read_text()
    for size in (20, len(text) // 4, len(text) // 2, text.index("$Elements"), len(text) - 300):
        path.write_text(text[:size])
        with pytest.raises(ValueError, match=r"model\.msh"):
            read_gmsh(path)


@pytest.mark.parametrize("order", [0, 21])
def test_order_out_of_range(tmp_path, order):
    with pytest.raises(ValueError, match=f"order = {order} must"):
        read_gmsh(write(tmp_path, PLATE), order=order)


def test_geometry_that_gmsh_would_hang_on(tmp_path):
    """Curves that meet in separate nodes at one place: a bow tie, and a crack whose mouth is no point of
    the outline.
    """
    bow = "\n".join(
        [
            "Point(1)={0,0,0,.2};",
            "Point(2)={1,1,0,.2};",
            "Point(3)={1,0,0,.2};",
            "Point(4)={0,1,0,.2};",
            "Line(1)={1,2};",
            "Line(2)={2,3};",
            "Line(3)={3,4};",
            "Line(4)={4,1};",
            "Curve Loop(1)={1,2,3,4};",
            "Plane Surface(1)={1};",
            'Physical Surface("s")={1};',
            "",
        ]
    )
    (tmp_path / "bow.geo").write_text(bow)
    with pytest.raises(ValueError, match="cross each other near"):
        read_gmsh(tmp_path / "bow.geo")


@pytest.mark.parametrize(
    "last",
    [
        'Physical Surface("a")={1}; Physical Curve("left")={4};',
        pytest.param('If (1) Physical Curve("left")={4}; EndIf', marks=pytest.mark.long),
        pytest.param('EndIf Physical Curve("left")={4};', marks=pytest.mark.long),
    ],
)
def test_a_last_line_without_end_of_which_gmsh_drops_statements(tmp_path, last):
    """Refused by the file's name, in the script as in what it reads; a single statement is read."""
    begin = 'SetFactory("OpenCASCADE");\nRectangle(1)={0,0,0,1,1};\n'
    (tmp_path / "cut.geo").write_text(begin + ("If (1)\n" if last.startswith("EndIf") else "") + last)
    with pytest.raises(ValueError, match="last line of 'cut.geo' holds several statements"):
        read_gmsh(tmp_path / "cut.geo", order=1)
    (tmp_path / "named.geo").write_text(last)
    for reads in ("Include", "Merge") if not last.startswith("EndIf") else ():
        (tmp_path / "whole.geo").write_text(begin + f'{reads} "named.geo";')
        with pytest.raises(ValueError, match="last line of 'named.geo' .* add a line break"):
            read_gmsh(tmp_path / "whole.geo", order=1)
    script = begin + 'Physical Surface("a")={1};\nPhysical Curve("left")={4}; // clamped'
    (tmp_path / "whole.geo").write_text(script)
    assert list(read_gmsh(tmp_path / "whole.geo", order=1).edge_sets) == ["left"]
    assert (tmp_path / "whole.geo").read_text() == script


def test_geometry_files_that_would_lose_a_part(tmp_path):
    """A surface in no physical group."""
    (tmp_path / "two.geo").write_text(
        'SetFactory("OpenCASCADE");\nRectangle(1)={0,0,0,1,1};\nRectangle(2)={1,0,0,1,1};\nCoherence;\n'
        'Physical Surface("a")={1};\n'
    )
    with pytest.raises(ValueError, match="belongs to no physical group"):
        read_gmsh(tmp_path / "two.geo")


def test_a_file_is_read_without_scipy():
    """Which takes longer to load than gmsh: each file is read by a process of its own."""
    program = "import sys, meshing.gmsh.extraction as reader; reader.load(); print('scipy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=300)
    assert (done.stdout, done.stderr) == ("False\n", "")
