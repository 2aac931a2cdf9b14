"""Meshes of other programs (.unv, .med, .bdf) as gmsh writes them: what its own format gives, all groups."""

import re

import numpy as np
import pytest

from meshing import GmshWarning, read_gmsh

PLATE = """
SetFactory("OpenCASCADE");
Rectangle(1) = {0, 0, 0, 60, 40};
Rectangle(2) = {60, 0, 0, 60, 40};
Point(100) = {30, 40, 0};
Point(101) = {30, 20, 0};
Line(100) = {100, 101};
BooleanFragments{ Surface{1, 2}; Delete; }{ Curve{100}; Delete; }
Mesh.MeshSizeMax = 20;
e = 1e-3;
Physical Surface("steel") = Surface In BoundingBox{-e, -e, -e, 60 + e, 40 + e, e};
Physical Surface("brass") = Surface In BoundingBox{60 - e, -e, -e, 120 + e, 40 + e, e};
Physical Curve("clamp") = Curve In BoundingBox{-e, -e, -e, e, 40 + e, e};
Physical Curve("load") = Curve In BoundingBox{120 - e, -e, -e, 120 + e, 40 + e, e};
Physical Curve("crack:c") = Curve In BoundingBox{30 - e, 20 - e, -e, 30 + e, 40 + e, e};
Physical Point("P") = Point In BoundingBox{120 - e, 40 - e, -e, 120 + e, 40 + e, e};
"""


def save(folder, order, *endings, nodes=1, incomplete=1):
    """Write the plate's mesh, as triangles or, of order 2, as quadrilaterals of eight nodes."""
    gmsh = pytest.importorskip("gmsh")
    (folder / "plate.geo").write_text(PLATE)
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.SaveElementTagType", 2)  # Nastran's properties are the groups' numbers
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", nodes)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", incomplete)
        gmsh.option.setNumber("Mesh.RecombineAll", order - 1)
        gmsh.merge(str(folder / "plate.geo"))
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        for ending in endings:
            gmsh.write(str(folder / f"plate{ending}"))
    finally:
        gmsh.finalize()


def places(mesh):
    """Nodes in an order of their own, mm."""
    return np.array(sorted(np.round(mesh.nodes * 1e3, 3).tolist()))


@pytest.mark.parametrize("ending", [".unv", ".med"])
def test_quadrilaterals_of_nine_nodes_are_told_the_way_out(tmp_path, ending):
    save(tmp_path, 2, ending, incomplete=0)
    with pytest.raises(ValueError, match=r"3, 4, 6 or 8\s+nodes.*by gmsh as \.msh"):
        read_gmsh(tmp_path / f"plate{ending}", order=2, scale=1e-3)


LONG = pytest.mark.long


@pytest.mark.slow
@pytest.mark.parametrize(
    "ending, order",
    [(".unv", 2), (".med", 1), pytest.param(".unv", 1, marks=LONG), pytest.param(".med", 2, marks=LONG)],
)
def test_groups_by_name(tmp_path, ending, order):
    save(tmp_path, order, ".msh", ending)
    ours, expected = (read_gmsh(tmp_path / f"plate{e}", order=2, scale=1e-3) for e in (ending, ".msh"))
    np.testing.assert_allclose(places(ours), places(expected), atol=1e-3)
    assert set(ours.edge_sets) == set(expected.edge_sets) == {"clamp", "load", "c_right", "c_left"}
    assert set(ours.material_names) == {"steel", "brass"} and "P" in ours.points
    assert ours.nodes[ours.points["P"]] == pytest.approx([0.12, 0.04])
    assert ours.area == pytest.approx(0.12 * 0.04) and ours.cracks[0].length == pytest.approx(0.02)


@pytest.mark.slow
def test_numbers_of_nastran_and_names_by_a_script(tmp_path):
    """Properties are groups; a script that merges the file names them, and makes cracks."""
    save(tmp_path, 1, ".bdf")
    with pytest.warns(GmshWarning, match=r"curve\d' lies inside a material and is an edge set, not a crack"):
        mesh = read_gmsh(tmp_path / "plate.bdf", order=1, scale=1e-3)
    assert len(mesh.material_names) == 2 and len(mesh.edge_sets) == 3
    steel, brass = (name.removeprefix("material") for name in mesh.material_names)
    crack = next(name for name, edges in mesh.edge_sets.items() if mesh.nodes[mesh.edges[edges]].max() < 0.05)
    inside = [n for n, e in mesh.edge_sets.items() if np.ptp(mesh.nodes[mesh.edges[e]][..., 0]) < 1e-9]
    numbers = {
        name: round(1e3 * float(mesh.nodes[mesh.edges[mesh.edge_sets[name]]][..., 0].mean()))
        for name in inside
    }
    cracked = next(name for name, x in numbers.items() if x == 30)
    assert crack in numbers
    (tmp_path / "named.geo").write_text(
        f'Merge "plate.bdf";\nPhysical Surface("all") = {{{steel}, {brass}}};\n'
        f'Physical Curve("crack:c") = {{{cracked.removeprefix("curve")}}};\n'
    )
    named = read_gmsh(tmp_path / "named.geo", order=1, scale=1e-3)
    assert named.material_names == ("all",) and named.cracks[0].length == pytest.approx(0.02)


def test_groups_that_would_be_dropped_are_told(tmp_path):
    """gmsh writes a group of a point that is not in the file."""
    save(tmp_path, 1, ".unv", nodes=0)
    with pytest.raises(ValueError, match="its group 'P' holds nothing that is in the file"):
        read_gmsh(tmp_path / "plate.unv", order=1, scale=1e-3)


@pytest.mark.parametrize(
    "change, sentence",
    [
        (
            (r"\n *2 +(\d+ +){6}\d+\nbrass\n(?s:.*?)(?=\n    -1)", ""),
            "is in no group, whose name is the material's",
        ),
        ((r"\bbrass\b", "steel "), None),
        ((r"(?m)^(clamp)$", "\\1\n x"), "is not understood"),
        ((r"\n    -1\s*\Z", "\n"), "truncated or damaged"),
    ],
)
def test_universal_files_that_are_wrong(tmp_path, change, sentence):
    save(tmp_path, 1, ".unv")
    text = (tmp_path / "plate.unv").read_text()
    changed = re.sub(change[0], change[1], text, count=1)
    assert changed != text
    (tmp_path / "plate.unv").write_text(changed)
    if sentence is None:
        assert read_gmsh(tmp_path / "plate.unv", order=1, scale=1e-3).material_names == ("steel",)
        return
    with pytest.raises(ValueError, match=sentence) as caught:
        read_gmsh(tmp_path / "plate.unv", order=1, scale=1e-3)
    assert "plate.unv" in str(caught.value) and "\n" not in str(caught.value)
