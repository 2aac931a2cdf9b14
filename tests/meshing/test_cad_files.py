"""Geometry from CAD: step, brep and iges files made here with gmsh's OpenCASCADE kernel."""

import numpy as np
import pytest
from mesh_checks import check_mesh

from meshing import read_gmsh

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
