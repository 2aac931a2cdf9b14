"""Geometry from CAD: step, brep and iges files made here with gmsh's OpenCASCADE kernel."""

import warnings

import numpy as np
import pytest
from mesh_checks import check_mesh

from meshing import UnitWarning, read_gmsh

gmsh = pytest.importorskip("gmsh")

AREA = 0.2 * 0.1 - np.pi * 0.02**2


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """plate: 200 x 100 mm with a hole; two: touching squares of 100 mm side; tilted and solid: not plane.
    Lengths in step and iges are mm.
    """
    path = tmp_path_factory.mktemp("cad")
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ

        def write(name, *endings):
            occ.synchronize()
            for ending in endings:
                gmsh.write(str(path / f"{name}.{ending}"))
            gmsh.clear()

        for size, endings in ((1e3, ("step", "iges")), (1.0, ("brep",))):
            occ.cut(
                [(2, occ.addRectangle(0, 0, 0, 0.2 * size, 0.1 * size))],
                [(2, occ.addDisk(0.1 * size, 0.05 * size, 0, 0.02 * size, 0.02 * size))],
            )
            write("plate", *endings)
            for x in (0.0, 0.1):
                occ.addRectangle(x * size, 0, 0, 0.1 * size, 0.1 * size)
            write("two", *endings)
        occ.rotate([(2, occ.addRectangle(0, 0, 0, 100, 100))], 0, 0, 0, 1, 0, 0, np.pi / 2)
        write("tilted", "step")
        occ.rotate([(2, occ.addRectangle(0, 0, 0, 0.1, 0.1))], 0.05, 0, 0, 0, 1, 0, np.pi)
        write("downwards", "brep")
        occ.addBox(0, 0, 0, 100, 100, 100)
        write("solid", "step")
        occ.addLine(occ.addPoint(0, 0, 0), occ.addPoint(1, 0, 0))
        write("curve", "brep")
    finally:
        gmsh.finalize()
    return path


@pytest.mark.parametrize("ending", ["step", "brep", "iges"])
def test_plate_with_hole(folder, ending):
    """The hole is one closed curve: its edges lie on the true circle, across the curve's seam too."""
    mesh = read_gmsh(folder / f"plate.{ending}", order=5, size=0.02)
    # order 5 on arcs of a radian
    check_mesh(mesh, AREA, 1e-9)
    assert mesh.material_names == ("material",) and all(name.startswith("curve") for name in mesh.edge_sets)
    assert np.ptp(mesh.nodes, axis=0) == pytest.approx([0.2, 0.1])
    distance = np.hypot(*(mesh.nodes - [0.1, 0.05]).T)
    hole = next(name for name, edges in mesh.edge_sets.items() if distance[mesh.edges[edges]].max() < 0.03)
    assert distance[mesh.edges[mesh.edge_sets[hole]]] == pytest.approx(
        0.02, abs=1e-9 if ending == "iges" else 1e-14
    )  # iges: a spline
    corners = {tuple(np.round(mesh.nodes[node], 9)) for node in mesh.points.values()}
    assert {(0, 0), (0.2, 0), (0.2, 0.1), (0, 0.1)} <= corners


@pytest.mark.parametrize("ending", ["step", "brep", "iges"])
def test_touching_parts_are_one_body(folder, ending):
    """Each part of a file has edges of its own where it touches another; they are joined."""
    mesh = read_gmsh(folder / f"two.{ending}", order=2, size=0.05)
    inside = np.setdiff1d(np.arange(len(mesh.edges)), mesh.outline_edges())
    assert mesh.area == pytest.approx(0.02) and len(mesh.edge_sets) == 7
    seam = next(
        edges
        for edges in mesh.edge_sets.values()
        if (np.abs(mesh.nodes[mesh.edges[edges], 0] - 0.1) < 1e-12).all()
    )
    assert np.isin(seam, inside).all()
    assert len(np.unique(np.round(mesh.nodes, 9), axis=0)) == len(mesh.nodes)


MM = "( LENGTH_UNIT() NAMED_UNIT(*) SI_UNIT(.MILLI.,.METRE.) );"
STEP_UNITS = {
    1e-3: MM,
    1e-2: MM.replace(".MILLI.", ".CENTI."),
    1.0: MM.replace(".MILLI.", "$"),
    0.0254: "( CONVERSION_BASED_UNIT('INCH',#9003) LENGTH_UNIT() NAMED_UNIT(#9002) );\n"
    f"#9001 = {MM}\n#9002 = DIMENSIONAL_EXPONENTS(1.,0.,0.,0.,0.,0.,0.);\n"
    "#9003 = LENGTH_MEASURE_WITH_UNIT(LENGTH_MEASURE(25.4),#9001);",
}


def wide(path, **options):
    """Width of a model, m, and what was said of its unit."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh = read_gmsh(path, order=1, **options)
    assert all(issubclass(one.category, UnitWarning) for one in caught)
    return np.ptp(mesh.nodes[:, 0]), " ".join(str(one.message) for one in caught)


@pytest.mark.slow
@pytest.mark.parametrize(
    "unit", [1.0, 0.0254, *(pytest.param(unit, marks=pytest.mark.long) for unit in (1e-3, 1e-2))]
)
def test_units_of_step_files(folder, unit):
    """200 of the unit that each says; a scale is the length of that unit, and said where it is another."""
    text = (folder / "plate.step").read_text()
    path = folder / f"in_{unit:g}.step"
    assert text.count(MM) == 1
    path.write_text(text.replace(MM, STEP_UNITS[unit]))
    width, said = wide(path, size=50 * unit)
    assert width == pytest.approx(200 * unit) and ("it is 200 m wide" in said) == (unit == 1.0)
    assert wide(path, scale=unit, size=50 * unit) == (pytest.approx(200 * unit), "")
    other = 1.0 if unit == 1e-3 else 1e-3
    width, said = wide(path, scale=other, size=50 * other)
    assert width == pytest.approx(200 * other)
    assert f"its unit is {unit:g} m, as the file says, and scale={other:g} makes the body" in said


@pytest.mark.long
def test_units_of_iges_files(folder):
    """In inches by their header: the numbers are the same."""
    path = folder / "inches.iges"
    text = (folder / "plate.iges").read_text()
    assert text.count(",1.,2,2HMM,") == 1
    path.write_text(text.replace(",1.,2,2HMM,", ",1.,1,2HIN,"))
    for file, unit in ((folder / "plate.iges", 1e-3), (path, 0.0254)):
        assert wide(file, size=50 * unit) == (pytest.approx(200 * unit), "")
        assert wide(file, scale=unit, size=50 * unit) == (pytest.approx(200 * unit), "")
    width, said = wide(path, scale=1e-3, size=0.05)
    assert width == pytest.approx(0.2) and "its unit is 0.0254 m, as the file says, and scale=0.001" in said


def test_a_unit_that_is_not_understood(folder):
    path = folder / "furlongs.step"
    path.write_text((folder / "plate.step").read_text().replace(MM, MM.replace("METRE", "FURLONG")))
    with pytest.raises(ValueError, match="its unit of length is not understood, so scale = 0.001 has no"):
        read_gmsh(path, scale=1e-3)


@pytest.mark.slow
def test_a_step_file_that_a_script_merges(folder):
    """Its lengths are in m there, and a scale is said to make them wrong; a script may want mm."""
    path, names = folder / "merge.geo", 'Merge "plate.step";\nPhysical Surface("s") = {1};\n'
    path.write_text(names)
    assert wide(path, size=0.05) == (pytest.approx(0.2), "")
    width, said = wide(path, scale=1e-3, size=5e-5)
    assert width == pytest.approx(2e-4)
    assert "lengths in 'plate.step', which it merges, are converted to m, and scale=0.001" in said
    assert "it is 0.0002 m wide and 0.0001 m high; scale=0.001 is the length of the file's unit" in said
    path.write_text('Geometry.OCCTargetUnit = "MM";\n' + names)
    assert wide(path, scale=1e-3, size=0.05) == (pytest.approx(0.2), "")


def test_a_surface_that_faces_downwards(folder):
    check_mesh(read_gmsh(folder / "downwards.brep", order=2, size=0.05), 0.01, 1e-12)


def test_names_by_a_geo_file_that_merges_the_step(folder):
    """Materials, sets and a crack for a CAD file; the lengths are converted to m here too."""
    (folder / "named.geo").write_text("""
SetFactory("OpenCASCADE");
Merge "plate.step";
Point(100) = {0.15, 0.1, 0}; Point(101) = {0.15, 0.05, 0}; Line(100) = {100, 101};
BooleanFragments{ Surface{1}; Delete; }{ Curve{100}; Delete; }
Mesh.MeshSizeMax = 0.015;
Physical Surface("steel") = {1};
eps = 1e-6;
Physical Curve("clamp") = Curve In BoundingBox{-eps, -eps, -eps, eps, 0.1 + eps, eps};
Physical Curve("crack:c") = Curve In BoundingBox{0.15 - eps, 0.05 - eps, -eps, 0.15 + eps, 0.1 + eps, eps};
Physical Point("P") = Point In BoundingBox{0.2 - eps, 0.1 - eps, -eps, 0.2 + eps, 0.1 + eps, eps};
""")
    mesh = read_gmsh(folder / "named.geo", order=4)
    check_mesh(mesh, AREA, 1e-7, covered=False)
    assert mesh.material_names == ("steel",) and set(mesh.edge_sets) == {"clamp", "c_right", "c_left"}
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([0.2, 0.1])
    assert mesh.cracks[0].tip == pytest.approx((0.15, 0.05)) and mesh.cracks[0].length == pytest.approx(0.05)
    assert len(mesh.pairs) > 0 and (mesh.pairs.gap == 0).all()


def test_closed_circle_in_a_geo_file(tmp_path):
    path = tmp_path / "disk.geo"
    path.write_text(
        'SetFactory("OpenCASCADE"); Disk(1) = {0, 0, 0, 0.02}; Physical Surface("steel") = {1}; Physical '
        'Curve("rim") = {1};\n'
    )
    mesh = read_gmsh(path, order=5, size=0.01)
    check_mesh(mesh, np.pi * 0.02**2, 1e-9)


def test_a_hole_of_one_or_two_edges(tmp_path):
    """Which gmsh fills: the area had been that of the plate without a hole, without a word. Sizes are of no
    use where a script says how many nodes there are.
    """
    path = tmp_path / "plate.geo"
    text = (
        'SetFactory("OpenCASCADE"); Rectangle(1) = {-1, -1, 0, 2, 2}; Disk(2) = {0, 0, 0, 0.4};\n'
        "BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };\n"
        'Physical Surface("steel") = {3}; Transfinite Curve {5} = NODES;\n'
    )
    says = (
        r"surface 3 one or two edges make a closed line near .*, or more nodes where Transfinite Curve says"
    )
    for nodes in "23":
        path.write_text(text.replace("NODES", nodes))
        with pytest.raises(ValueError, match=says):
            read_gmsh(path, size=0.5)
    path.write_text(text.replace("NODES", "25"))
    assert read_gmsh(path, size=0.5).area == pytest.approx(4.0 - np.pi * 0.4**2, rel=1e-9)


@pytest.mark.parametrize("curve", [1, 20])
def test_a_curve_that_is_said_twice(tmp_path, curve):
    """One that is embedded twice, or is in the outline as well, is one curve, no closed line of two edges."""
    path = tmp_path / "plate.geo"
    path.write_text(
        "Point(1) = {0, 0, 0, 0.3}; Point(2) = {1, 0, 0, 0.3}; Point(3) = {1, 1, 0, 0.3};\n"
        "Point(4) = {0, 1, 0, 0.3}; Point(5) = {0.3, 0.5, 0, 0.1}; Point(6) = {0.7, 0.5, 0, 0.1};\n"
        "Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1}; Line(20) = {5, 6};\n"
        "Curve Loop(1) = {1 : 4}; Plane Surface(1) = {1};\n"
        f"Curve{{20}} In Surface{{1}}; Curve{{{curve}}} In Surface{{1}};\n"
        'Physical Surface("steel") = {1}; Physical Curve("crack:c") = {20};\n'
    )
    mesh = read_gmsh(path)
    assert mesh.area == pytest.approx(1.0, rel=1e-12) and len(mesh.cracks) == 1


def test_a_session_of_the_user_keeps_its_unit(folder):
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setString("Geometry.OCCTargetUnit", "CM")
        read_gmsh(folder / "plate.step", order=1, size=0.05)
        assert gmsh.option.getString("Geometry.OCCTargetUnit") == "CM"
    finally:
        gmsh.finalize()


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("tilted.step", "not in the plane z = 0"),
        ("solid.step", "1 volume, a plane model was expected"),
        ("curve.brep", "has no surfaces"),
        ("cut.step", "truncated or damaged"),
        ("junk.brep", "not an OpenCASCADE BREP file"),
    ],
)
def test_refused_files(folder, name, says):
    text = (folder / "plate.step").read_text()
    (folder / "cut.step").write_text(text[: len(text) // 2])
    (folder / "junk.brep").write_text("hello")
    with pytest.raises(ValueError, match=says) as caught:
        read_gmsh(folder / name, order=2)
    assert name in str(caught.value) and "\n" not in str(caught.value) and not gmsh.isInitialized()
