"""Models as users draw them, right and wrong: each gives the right structure, or a sentence that names the "
"item."""

import re
import warnings

import numpy as np
import pytest

from meshing import GmshWarning, UnitWarning, read_gmsh
from meshing.warnings import warn

# Without a kernel for solids: points, lines, one surface. 100 x 50 mm in m.
LINES = """
h = 0.01;
Point(1) = {0, 0, 0, h}; Point(2) = {0.1, 0, 0, h}; Point(3) = {0.1, 0.05, 0, h}; Point(4) = {0, 0.05, 0, h};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
Plane Surface(1) = {1};
"""
NAMES = 'Physical Surface("steel") = {1};\nPhysical Curve("clamp") = {4};\n'


def cracked(*lines, size=0.15, groups=""):
    """A unit square with lines cut into it by a Boolean operation, as most users do it."""
    text = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1};\n'
    for i, (x, y, to_x, to_y) in enumerate(lines):
        text += f"Point({100 + 2 * i}) = {{{x}, {y}, 0}}; Point({101 + 2 * i}) = {{{to_x}, {to_y}, 0}};\n"
        text += f"Line({100 + i}) = {{{100 + 2 * i}, {101 + 2 * i}}};\n"
    names = ", ".join(str(100 + i) for i in range(len(lines)))
    text += f"BooleanFragments{{ Surface{{1}}; Delete; }}{{ Curve{{{names}}}; Delete; }}\n"
    return text + f'Mesh.MeshSizeMax = {size};\nPhysical Surface("steel") = Surface{{:}};\n' + groups


def within(name, x, y, to_x, to_y):
    """A physical curve of all that lies in a box."""
    box = f"{x} - e, {y} - e, -e, {to_x} + e, {to_y} + e, e"
    return f'e = 1e-6; Physical Curve("{name}") = Curve In BoundingBox{{{box}}};\n'


EDGE = [(0.5, 1, 0.5, 0.6)]
HALVES = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1}; Rectangle(2) = {1, 0, 0, 1, 1};\n'

# Name: text, options, then what must come out: area, and the cracks with their tips and lengths.
RIGHT = {
    "lines only": (LINES + NAMES, {}, 0.005, {}),
    "drawn in mm": (
        LINES.replace("0.1", "100").replace("0.05", "50").replace("0.01", "10") + NAMES,
        {"scale": 1e-3},
        0.005,
        {},
    ),
    "groups without names": (LINES + "Physical Surface(7) = {1}; Physical Curve(9) = {2};\n", {}, 0.005, {}),
    "a crack from an edge": (
        cracked(*EDGE, groups=within("crack:c", 0.5, 0.6, 0.5, 1)),
        {},
        1.0,
        {"c": (1, 0.4)},
    ),
    "a crack with a blank and a capital in its name": (
        cracked(*EDGE, groups=within("crack:My crack", 0.5, 0.6, 0.5, 1)),
        {},
        1.0,
        {"My crack": (1, 0.4)},
    ),
    "a curve inside without a group": (cracked(*EDGE), {}, 1.0, {}),
    "a crack inside": (
        cracked((0.3, 0.5, 0.7, 0.5), groups=within("crack:c", 0.3, 0.5, 0.7, 0.5)),
        {},
        1.0,
        {"c": (2, 0.4)},
    ),
    "a kinked crack": (
        cracked((0.5, 1, 0.5, 0.7), (0.5, 0.7, 0.7, 0.6), groups=within("crack:c", 0.5, 0.6, 0.7, 1)),
        {},
        1.0,
        {"c": (1, 0.3 + np.hypot(0.2, 0.1))},
    ),
    "a crossing of two": (
        cracked((0.3, 0.5, 0.7, 0.5), (0.5, 0.3, 0.5, 0.7), groups=within("crack:c", 0.3, 0.3, 0.7, 0.7)),
        {},
        1.0,
        {"c": (4, 0.8)},
    ),
    "a branch": (
        cracked((0.3, 0.5, 0.7, 0.5), (0.5, 0.5, 0.5, 0.8), groups=within("crack:c", 0.3, 0.5, 0.7, 0.8)),
        {},
        1.0,
        {"c": (3, 0.7)},
    ),
    "a crack through the body": (
        cracked((0, 0.5, 1, 0.5), groups=within("crack:c", 0, 0.5, 1, 0.5)),
        {},
        1.0,
        {"c": (0, 1.0)},
    ),
    "two cracks": (
        cracked(
            (0.3, 1, 0.3, 0.7),
            (0.7, 1, 0.7, 0.7),
            groups=within("crack:a", 0.3, 0.7, 0.3, 1) + within("crack:b", 0.7, 0.7, 0.7, 1),
        ),
        {},
        1.0,
        {"a": (1, 0.3), "b": (1, 0.3)},
    ),
    "two materials": (
        HALVES
        + 'Coherence;\nMesh.MeshSizeMax = 0.5;\nPhysical Surface("a") = {1}; Physical Surface("b") = {2};\n'
        + within("interface", 1, 0, 1, 1),
        {},
        2.0,
        {},
    ),
    "a hole": (
        'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1}; Disk(2) = {0.5, 0.5, 0, 0.2};\n'
        "BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }\nMesh.MeshSizeMax = 0.2;\n"
        'Physical Surface("steel") = {1};\n' + within("hole", 0.3, 0.3, 0.7, 0.7),
        {},
        1 - 0.04 * np.pi,
        {},
    ),
    "quadrilaterals by transfinite sides": (
        LINES + "Transfinite Curve{1:4} = 5; Transfinite Surface{1}; Recombine Surface{1};\n" + NAMES,
        {},
        0.005,
        {},
    ),
    "meshed by the script itself": (LINES + NAMES + "Mesh 2;\n", {}, 0.005, {}),
    "names with blanks and accents": (LINES + 'Physical Surface("Stahl grün (1)") = {1};\n', {}, 0.005, {}),
    "a smaller size": (LINES + NAMES, {"size": 0.004}, 0.005, {}),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (k % 2)) for k, n in enumerate(RIGHT)]
)
def test_right(tmp_path, name):
    text, options, area, cracks = RIGHT[name]
    path = tmp_path / "model.geo"
    path.write_text(text, encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("error", GmshWarning)
        mesh = read_gmsh(path, **{"order": 4, **options})
    assert mesh.area == pytest.approx(area, rel=1e-7)  # the hole's arcs of order 4; exact elsewhere
    found = {
        crack.name: (sum(tip.crack == i for tip in mesh.tips), pytest.approx(crack.length, rel=1e-12))
        for i, crack in enumerate(mesh.cracks)
    }
    assert found == cracks
    pairs = np.bincount(mesh.pairs.crack, minlength=len(mesh.cracks))
    assert (pairs > 5).all() and all(crack in mesh.summary() for crack in cracks)
    if name == "groups without names":
        assert mesh.material_names == ("surface7",) and list(mesh.edge_sets) == ["curve9"]


# Name: text, options, and what the sentence must say.
WRONG = {
    "no groups": (LINES, {}, "no physical surfaces"),
    "no surface": (LINES.replace("Plane Surface(1) = {1};", "") + NAMES, {}, "surface"),
    "a curve that does not exist": (
        LINES + NAMES + 'Physical Curve("crack:c") = {60};\n',
        {},
        "physical curve 'crack:c' names curve 60, which does not exist",
    ),
    "one of two curves that does not exist": (
        LINES + NAMES + 'Physical Curve("load") = {2, 61};\n',
        {},
        "physical curve 'load' names curve 61",
    ),
    "a curve that the Boolean operation renumbered": (
        cracked(*EDGE, groups='Physical Curve("crack:c") = {160};\n'),
        {},
        "'crack:c' names curve 160",
    ),
    "a group of nothing": (
        LINES + NAMES + within("load", 7, 7, 8, 8),
        {},
        "physical curve 'load' holds no curve",
    ),
    "a point that does not exist": (
        LINES + NAMES + 'Physical Point("P") = {99};\n',
        {},
        "physical point 'P' names point 99",
    ),
    "Crack:c": (
        cracked(*EDGE, groups=within("Crack:c", 0.5, 0.6, 0.5, 1)),
        {},
        "'Crack:c' is not how a crack",
    ),
    "crack": (cracked(*EDGE, groups=within("crack", 0.5, 0.6, 0.5, 1)), {}, "write 'crack:1'"),
    "crack_2": (cracked(*EDGE, groups=within("crack_2", 0.5, 0.6, 0.5, 1)), {}, "write 'crack:2'"),
    "crakc:c": (cracked(*EDGE, groups=within("crakc:c", 0.5, 0.6, 0.5, 1)), {}, "write 'crack:c'"),
    "crack: c": (cracked(*EDGE, groups=within("crack: c", 0.5, 0.6, 0.5, 1)), {}, "write 'crack:c'"),
    "CRACK:c:Left": (LINES + NAMES + 'Physical Curve("CRACK:c:left") = {1};\n', {}, "write 'crack:c:left'"),
    "a crack as a surface": (
        LINES + 'Physical Surface("crack:c") = {1};\n',
        {},
        "a crack is a physical curve",
    ),
    "a crack that is not embedded": (
        LINES
        + 'Point(9) = {0.05, 0.02, 0, h}; Line(9) = {3, 9};\nPhysical Curve("crack:c") = {9};\n'
        + NAMES,
        {},
        "'crack:c' does not lie on cell edges (curve 9)",
    ),
    "a crack on the outline": (
        LINES + NAMES + 'Physical Curve("crack:c") = {3};\n',
        {},
        "part of its line lies on the outline",
    ),
    "an edge set named like a face": (
        cracked(*EDGE, groups=within("crack:c", 0.5, 0.6, 0.5, 1) + within("c_left", 0, 0, 0, 1)),
        {},
        "'c_left' is that of a face of crack 'c'",
    ),
    "surfaces that overlap": (
        HALVES.replace("{1, 0, 0, 1, 1}", "{0.5, 0, 0, 1, 1}") + 'Physical Surface("a") = {1, 2};\n',
        {},
        "surfaces overlap near (1, ",
    ),
    "a disk over the surface": (
        HALVES + 'Coherence; Disk(9) = {0.5, 0.5, 0, 0.1}; Physical Surface("a") = {1, 2, 9};\n',
        {},
        "surfaces overlap near (0.4",
    ),
    "a surface in two groups": (
        LINES + NAMES + 'Physical Surface("all") = {1};\n',
        {},
        "surface 1 belongs to the physical surfaces 'steel' and 'all'",
    ),
    "a surface in no group": (
        HALVES + 'Coherence;\nPhysical Surface("a") = {1};\nMesh.MeshSizeMax = 0.5;\n',
        {},
        "surface 2 belongs to no physical group",
    ),
    "a volume": (
        'SetFactory("OpenCASCADE");\nBox(1) = {0, 0, 0, 1, 1, 1};\nPhysical Volume("steel") = {1};\n',
        {},
        "1 volume, a plane model was expected",
    ),
    "out of the plane": (
        LINES.replace("0.05, 0,", "0.05, 0.01,") + NAMES,
        {},
        "is not in the plane z = 0",
    ),
    "curves that cross": (
        LINES.replace("Point(2) = {0.1, 0, 0, h}", "Point(2) = {0.05, 0.07, 0, h}") + NAMES,
        {},
        "cross each other near",
    ),
    "a size of nothing": (LINES + NAMES, {"size": 1e-9}, "would make about 1.2e+16 cells"),
    "a size for a low order": (LINES + NAMES, {"size": 2e-4, "order": 20}, "unknowns at order 20, more than"),
    "sizes of nothing at the points": (
        LINES.replace("h = 0.01", "h = 1e-9") + NAMES,
        {},
        "at the ends of curve 1",
    ),
    "a semicolon that is missing": (LINES.replace("{1, 2};", "{1, 2}") + NAMES, {}, "line 4: syntax error"),
    "a word that gmsh does not know": (LINES + "Plane Surfaec(2) = {1};\n" + NAMES, {}, "line 7"),
    "in mm and said to be in m": (LINES + NAMES, {"scale": -1e-3}, "scale = -0.001 must"),
    "a mesh with the wrong ending": (
        "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n",
        {},
        "give it the ending of its",
    ),
    "a switch that is a word": (LINES + NAMES, {"tip_element": "no"}, "tip_element = 'no' must"),
}


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.long] * (k % 3 > 0)) for k, n in enumerate(WRONG)]
)
def test_wrong(tmp_path, name):
    text, options, says = WRONG[name]
    path = tmp_path / "model.geo"
    path.write_text(text)
    with pytest.raises((ValueError, TypeError)) as caught:
        read_gmsh(path, **{"order": 2, **options})
    assert says in str(caught.value) and "\n" not in str(caught.value)
    assert str(path) in str(caught.value) or "read_gmsh" in str(caught.value)


@pytest.mark.parametrize("version", ["1", "2.2.1", "3.0", "."])
def test_versions_of_meshes_that_are_not_read(tmp_path, version):
    path = tmp_path / "model.msh"
    path.write_text(f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Nodes\n0\n$EndNodes\n")
    with pytest.raises(ValueError, match=f"version {re.escape(version)} of gmsh's format is not read"):
        read_gmsh(path)


LARGE = LINES.replace("0.1", "100").replace("0.05", "50").replace("0.01", "10") + NAMES
WARNED = {
    "a crack by another name": (
        cracked(*EDGE, groups=within("Riss", 0.5, 0.6, 0.5, 1)),
        "'Riss' lies inside a material and is an edge set.*'crack:Riss'",
    ),
    "a notch without contact": (
        LINES + NAMES + 'Physical Curve("crack_left") = {3};\n',
        "'crack_left' lies on the outline and is an edge set without contact",
    ),
    "halves that are not joined": (
        HALVES + 'Physical Surface("a") = {1, 2}; Mesh.MeshSizeMax = 0.5;\n',
        r"outlines lie on one another near \(1, 0.\d*\) m and are not joined",
    ),
    "a disk that is not joined": (
        'SetFactory("OpenCASCADE");\nRectangle(1) = {0, 0, 0, 1, 1}; Disk(2) = {0.5, 0.5, 0, 0.2};\n'
        "BooleanDifference{ Surface{1}; Delete; }{ Surface{2}; Delete; }\nDisk(2) = {0.5, 0.5, 0, 0.2};\n"
        'Mesh.MeshSizeMax = 0.2; Physical Surface("steel") = Surface{:};\n',
        "outlines lie on one another near",
    ),
    "what gmsh warns of": (LINES + NAMES + 'Warning("mind the gap");\n', "gmsh warns: mind the gap"),
}


@pytest.mark.parametrize("name", WARNED)
def test_warned(tmp_path, name):
    """The warning names the file and points at the line that read it."""
    text, says = WARNED[name]
    path = tmp_path / "model.geo"
    path.write_text(text)
    with pytest.warns(GmshWarning, match=says) as caught:
        read_gmsh(path, order=1)
    assert len(caught) == 1 and caught[0].filename == __file__ and str(path) in str(caught[0].message)


@pytest.mark.long
def test_models_whose_size_hints_at_another_unit(tmp_path):
    """Above 20 m unless scale says that it is meant, below 1 mm whatever it says."""
    path = tmp_path / "model.geo"
    path.write_text(LARGE)
    with pytest.warns(UnitWarning, match="it is 100 m wide and 50 m high.*scale=1e-3 if it was") as caught:
        read_gmsh(path, order=1)
    assert len(caught) == 1 and caught[0].filename == __file__ and str(path) in str(caught[0].message)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UnitWarning)
        assert np.ptp(read_gmsh(path, order=1, scale=1.0).nodes) == 100.0
        assert np.ptp(read_gmsh(path, order=1, scale=1e-3).nodes) == pytest.approx(0.1)
    with pytest.warns(UnitWarning, match="0.0001 m wide and 5e-05 m high; scale=1e-06 is the length of the"):
        read_gmsh(path, order=1, scale=1e-6)


def test_what_meshio_says_is_told(tmp_path):
    """meshio prints it, and ends with a number, or amid its words where it may load no more to print them."""
    path = tmp_path / "model.vtk"
    points, cell = "POINTS 3 double\n0 0 0\n1 0 0\n0 1 0\n", "CELLS 1 4\n3 0 1 2\nCELL_TYPES 1\n77\n"
    path.write_text(f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\n{points}{cell}")
    with pytest.raises(ValueError, match=r"cells that meshio cannot handle \(types 77\)"):
        read_gmsh(path)


@pytest.mark.parametrize("ending", ["vtu", "vtk"])
def test_vtk(tmp_path, ending):
    meshio = pytest.importorskip("meshio")
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    cells = [("triangle", np.array([[0, 1, 2], [0, 2, 3]]))]
    path = tmp_path / f"model.{ending}"
    meshio.Mesh(points, cells, cell_data={"material": [np.array([1, 2])]}).write(path)
    mesh = read_gmsh(path, order=2)
    assert mesh.material_names == ("material1", "material2") and mesh.area == pytest.approx(1.0)


@pytest.mark.slow
def test_the_estimate_of_cells(tmp_path):
    """Within 10 % of the mesh that gmsh then makes, at order 1 and 6."""
    path = tmp_path / "model.geo"
    path.write_text(LINES + NAMES)
    mesh = read_gmsh(path, order=6, size=0.002)
    for order, unknowns in ((1, 2 * len(np.unique(mesh.edges[:, [0, -1]]))), (6, 2 * len(mesh.nodes))):
        with pytest.raises(ValueError) as caught:
            read_gmsh(path, order=order, size=0.002, max_unknowns=100)
        told = re.search(r"about ([\d.e+]+) cells, about ([\d.e+]+) unknowns", str(caught.value))
        assert float(told[1]) == pytest.approx(mesh.elements, rel=0.1)
        assert float(told[2]) == pytest.approx(unknowns, rel=0.15)  # the outline adds a few


ONE_EDGE = """
Point(1) = {0, 0, 0}; Point(2) = {3, 0, 0}; Point(3) = {3, 2, 0}; Point(4) = {0, 2, 0};
Point(5) = {1, 1, 0}; Point(6) = {2, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(5) = {5, 6};
Transfinite Curve {1, 3} = 4; Transfinite Curve {2, 4} = 3; Transfinite Curve {5} = 2;
Curve Loop(1) = {1 : 4}; Plane Surface(1) = {1}; Curve{5} In Surface{1};
Physical Surface("m") = {1}; Physical Curve("crack:c") = {5};
"""


def test_crack_of_one_edge(tmp_path):
    path = tmp_path / "model.geo"
    path.write_text(ONE_EDGE)
    says = (
        r"crack 'c': its line from \(1, 1\) to \(2, 1\) m is one edge of cells, which both tips would divide"
    )
    with pytest.raises(ValueError, match=says):
        read_gmsh(path)
    assert len(read_gmsh(path, tip_element=False, order=2).cracks) == 1


def test_a_warning_by_way_of_the_other_package_is_shown_at_the_users_line():
    """As of a mesh that an estimate makes anew; it was shown inside the package."""
    between: dict = {"__name__": "sbfem_petsc.between", "warn": warn}
    exec("def made():\n    warn('plate.geo', 'a line')", between)
    with pytest.warns(GmshWarning, match="plate.geo: a line") as told:
        between["made"]()
    assert told[0].filename == __file__
