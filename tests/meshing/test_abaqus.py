"""Abaqus input files: every set has what the deck gives it, checked by hand, by gmsh and by meshio."""

import re
from pathlib import Path

import numpy as np
import pytest

from meshing import GmshWarning, read_gmsh
from meshing.gmsh.confined import Refusal
from meshing.gmsh.foreign import abaqus

ROOT = Path(__file__).resolve().parents[2]
INP = """*HEADING
two plates of 1 m
*NODE
1, 0., 0.
2, 1., 0.
3, 2., 0.
4, 0., 1.
5, 1., 1.
6, 2., 1.
*ELEMENT, TYPE=CPS4, ELSET=steel
1, 1, 2, 5, 4
*ELEMENT, TYPE=CPS4, ELSET=brass
2, 2, 3, 6, 5
*NSET, NSET=clamp
1, 4
*NSET, NSET=P
6
*NSET, NSET=crack:c
2, 5
"""
# Three squares in a row, the middle one in two triangles, with lines on three sides.
ROW = """*HEADING
** a comment
*NODE, NSET=all
1, 0.
2, 1., 0., 0.
3, 2.D0, 0.
 4, 3., 0.
*Node
5, 0., 1.
6, 1., 1.
7, 2., 1.
8, 3., 1.
*ELEMENT, TYPE=CPS4R, ELSET=steel
1, 1, 2, 6, 5
*ELEMENT, TYPE=T2D2, ELSET=bottom
11, 1, 2
*ELEMENT, type=CPE3, elset=Steel
2, 2, 3, 7
3, 2, 7, 6
*ELEMENT, TYPE=B21, ELSET=top
15, 6, 5
*ELEMENT, TYPE=T2D2, ELSET=bottom
13, 2, 3
14, 3, 4
*ELEMENT, TYPE=CPS4,
 ELSET=STEEL
4, 3, 4,
8, 7
"""


def read(tmp_path, text, **options):
    path = tmp_path / "model.inp"
    path.write_text(text)
    return read_gmsh(path, **{"order": 1, **options})


def edges(mesh, name):
    """Middles of the edges of a set."""
    ends = mesh.nodes[mesh.edges[mesh.edge_sets[name]][:, [0, -1]]]
    return sorted(map(tuple, ends.mean(axis=1).tolist()))


@pytest.mark.slow
def test_two_plates(tmp_path):
    mesh = read(tmp_path, INP.replace("crack:c\n2, 5", "load\n3, 6"), order=3)
    assert mesh.area == pytest.approx(2.0, rel=1e-12) and mesh.material_names == ("steel", "brass")
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([2, 1])
    assert edges(mesh, "clamp") == [(0.0, 0.5)] and edges(mesh, "load") == [(2.0, 0.5)]
    assert read_gmsh(tmp_path / "model.inp", order=1, scale=1e-3).area == pytest.approx(2e-6, rel=1e-12)
    text = (tmp_path / "model.inp").read_text()
    (tmp_path / "model.inp").write_text(text, encoding="utf-8-sig")  # as editors of Windows save it
    assert read_gmsh(tmp_path / "model.inp", order=1).area == pytest.approx(2.0, rel=1e-12)


def test_sets_of_several_blocks_and_of_cells_of_two_sizes(tmp_path):
    """Blocks of one name, in whatever letters, are one set; sets of lines may overlap, and a node may stand
    twice in one place.
    """
    text = (
        ROW.replace("4, 3., 0.", "4, 3., 0.\n3, 2.")
        + "*ELSET, ELSET=load, GENERATE\n11, 13, 2\n*ELSET, ELSET=load\n15\n*ELSET, ELSET=rim\nload, bottom"
    )
    mesh = read(tmp_path, text)
    assert mesh.material_names == ("steel",) and mesh.area == pytest.approx(3.0, rel=1e-15)
    bottom = [(0.5, 0.0), (1.5, 0.0), (2.5, 0.0)]
    assert edges(mesh, "bottom") == bottom and edges(mesh, "top") == [(0.5, 1.0)]
    assert edges(mesh, "load") == [(0.5, 0.0), (0.5, 1.0), (1.5, 0.0)]
    assert edges(mesh, "rim") == [(0.5, 0.0), (0.5, 1.0), (1.5, 0.0), (2.5, 0.0)]
    assert edges(mesh, "all") == bottom  # nodes of the first card


def test_materials_by_sections(tmp_path):
    """Then sets of cells may overlap, and their names are no materials."""
    text = ROW + (
        "*ELSET, ELSET=left\n1, 2,\n3\n*ELSET, ELSET=probe, GENERATE\n2, 4\n*ELSET, ELSET=right\n4\n"
        "*ELSET, ELSET=all of it\nleft, right\n*MATERIAL, NAME=Alu\n*ELASTIC\n7e10, .3\n"
        "*SOLID SECTION, ELSET=LEFT, MATERIAL=ALU\n.01\n*SOLID SECTION, ELSET=right, MATERIAL=brass\n"
    )
    mesh = read(tmp_path, text)
    assert mesh.material_names == ("Alu", "brass")
    assert sorted(mesh.materials.tolist()) == [0, 0, 0, 1]


def test_surfaces(tmp_path):
    """Sides of elements and of sets, all sides on the outline where none is named, lines, and nodes; a set of
    nodes of the same name counts behind them.
    """
    text = ROW + (
        "*ELSET, ELSET=ends\n1, 4\n*SURFACE, NAME=left\n1, S4\n*Surface, name=Flanks, type=ELEMENT\n"
        "ends, s3\n4, S2,\n*SURFACE, NAME=triangle\n2, S2\n*SURFACE, NAME=free\n3\n ends,\n"
        "*SURFACE, NAME=lines\ntop\nbottom, SPOS\n*SURFACE, TYPE=NODE, NAME=right\n4, 1.\n8\n"
        "*NSET, NSET=left\n1, 2\n"
        "*SURFACE, NAME=Bottom\nbottom\n*SURFACE, NAME=inside, INTERNAL, TYPE=CUTTING SURFACE\nends, 1.\n"
        "*MATERIAL, NAME=a\n*SOLID SECTION, ELSET=steel, MATERIAL=a\n"
    )
    mesh = read(tmp_path, text.replace("triangle\n2, S2", "corner\n2, S1"))
    bottom = [(0.5, 0.0), (1.5, 0.0), (2.5, 0.0)]
    top = [(0.5, 1.0), (1.5, 1.0), (2.5, 1.0)]
    assert edges(mesh, "left") == [(0.0, 0.5)] and edges(mesh, "corner") == [bottom[1]]
    assert edges(mesh, "Flanks") == sorted([top[0], top[2], (3.0, 0.5)])
    assert edges(mesh, "free") == sorted([*top, bottom[0], bottom[2], (0.0, 0.5), (3.0, 0.5)])
    assert edges(mesh, "lines") == sorted([top[0], *bottom]) and edges(mesh, "right") == [(3.0, 0.5)]
    assert edges(mesh, "bottom") == bottom and not {"inside", "ends", "Bottom"} & mesh.edge_sets.keys()
    with pytest.warns(GmshWarning, match="triangle"):  # between two cells
        read(tmp_path, text)


@pytest.mark.parametrize(
    "kind, sides", [("CPS8R", "S1 S2 S3 S4"), ("S8R", "E1 E2 E3 E4"), ("S8", "S3 S4 S5 S6")]
)
def test_surfaces_of_curved_elements(tmp_path, kind, sides):
    """Abaqus numbers the edges of shells, CalculiX counts their two faces first."""
    text = (
        f"*NODE\n1, 0, 0\n2, .5, -.1\n3, 1, 0\n4, 1, 1\n5, 0, 1\n6, 1, .5\n7, .5, 1\n8, 0, .5\n"
        f"*ELEMENT, TYPE={kind}, ELSET=a\n7, 1, 3, 4, 5, 2, 6, 7, 8\n"
    )
    for name, side in zip("srqp", sides.split()):
        text += f"*SURFACE, NAME={name}\n{'a' if name in 'sq' else 7}, {side}\n"
    mesh = read(tmp_path, text, order=2)
    assert [mesh.nodes[mesh.edges[mesh.edge_sets[name][0]]][1].tolist() for name in "srqp"] == [
        [0.5, -0.1],
        [1.0, 0.5],
        [0.5, 1.0],
        [0.0, 0.5],
    ]


@pytest.mark.parametrize("lines", ["11, 1, 2, 3", "11, 1, 3, 2"])
def test_lines_of_three_nodes(tmp_path, lines):
    """With the middle node in the middle, as CalculiX and gmsh have it, or last, as meshio does."""
    text = (
        "*NODE\n1, 0, 0\n2, .5, -.1\n3, 1, 0\n4, 1, 1\n5, 0, 1\n6, 1, .5\n7, .5, 1\n8, 0, .5\n"
        "*ELEMENT, TYPE=CPS8R, ELSET=a\n1, 1, 3, 4, 5, 2, 6, 7, 8\n*ELEMENT, TYPE=B22, ELSET=bottom\n" + lines
    )
    mesh = read(tmp_path, text, order=2)
    assert mesh.area == pytest.approx(1.0 + 2 / 3 * 0.1, rel=1e-12)  # under a parabola
    assert [len(mesh.edge_sets[name]) for name in mesh.edge_sets] == [1]
    assert mesh.nodes[mesh.edges[mesh.edge_sets["bottom"][0]]][1] == pytest.approx([0.5, -0.1])


def test_a_part_in_an_assembly(tmp_path):
    """As Abaqus/CAE writes it: sets of its own, a reference point, an instance that stays where it is."""
    nodes, rest = ROW.split("*ELEMENT", 1)
    text = (
        f"*Part, name=P\n{nodes}*ELEMENT{rest}"
        "*Elset, elset=_Picked2, internal, generate\n 1, 4, 1\n"
        "*Solid Section, elset=_Picked2, material=Steel\n,\n*End Part\n"
        "*Assembly, name=A\n*Instance, name=P-1, part=P\n 0., 0.0, 0.\n*End Instance\n*Node\n 1, 9., 9., 0.\n"
        "*Nset, nset=RP\n 1\n*Nset, nset=Load, instance=P-1\n 4, 8\n*Elset, elset=Load, instance=P-1\n 4\n"
        "*Elset, elset=_Push_S2, internal, instance=P-1\n 4\n*Surface, type=ELEMENT, name=Push\n"
        "_Push_S2, S2\n*Surface, type=NODE, name=Hold\nP-1.1, 1.\nP-1.5\n"
        "*Surface, type=NODE, name=RP_CNS_\nRP, 1.\n"
        "*End Assembly\n*Material, name=Steel\n*Step\n*Cload\nRP, 1, 5.\n*Node Output\nU\n*End Step\n"
    )
    mesh = read(tmp_path, text)
    assert mesh.material_names == ("Steel",) and edges(mesh, "Load") == [(3.0, 0.5)]
    assert edges(mesh, "Push") == [(3.0, 0.5)] and edges(mesh, "Hold") == [(0.0, 0.5)]
    assert "RP" not in mesh.points and not {"_Picked2", "_Push_S2", "RP_CNS_"} & mesh.edge_sets.keys()
    with pytest.raises(ValueError, match="INSTANCE in line .* is a second one, or moves its part"):
        read(tmp_path, text.replace(" 0., 0.0, 0.", " 0., 1.0, 0."))
    with pytest.raises(ValueError, match="makes the set 'Bottom', which the part has too"):
        read(tmp_path, text.replace("elset=Load", "elset=Bottom"))


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("nodes", [0, 1])
def test_the_documented_model_written_by_gmsh(tmp_path, order, nodes):
    """The same mesh as by gmsh's own format, with the crack; its points only where gmsh writes them."""
    gmsh = pytest.importorskip("gmsh")
    page = (ROOT / "docs/gmsh_models.md").read_text()
    (tmp_path / "plate.geo").write_text(re.search(r"```geo\n(.*?)```", page, re.S)[1])
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "plate.geo"))
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", nodes)
        for ending in ("msh", "inp"):
            gmsh.write(str(tmp_path / f"plate.{ending}"))
    finally:
        gmsh.finalize()
    expected, found = (read_gmsh(tmp_path / f"plate.{end}", order=2, scale=1e-3) for end in ("msh", "inp"))
    assert found.material_names == expected.material_names == ("steel",)
    assert found.area == pytest.approx(expected.area, rel=1e-12) and found.elements == expected.elements
    named = set(expected.edge_sets)
    assert named == {"clamp", "load", "hole", "c_right", "c_left"}
    assert named == {name for name in found.edge_sets if not name.startswith("Line")}
    for name in named:
        assert np.allclose(edges(found, name), edges(expected, name), rtol=0, atol=1e-14)
    assert ("P" in found.points) == bool(nodes)


@pytest.mark.slow
def test_decks_written_by_meshio(tmp_path):
    """Of two blocks of cells and two of lines, in sets that overlap where they hold lines."""
    meshio = pytest.importorskip("meshio")
    points = np.array([[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1.0]])
    cells = [
        ("line", np.array([[0, 1], [1, 2]])),
        ("quad", np.array([[0, 1, 4, 3]])),
        ("triangle", np.array([[1, 2, 5], [1, 5, 4]])),
        ("line", np.array([[2, 5]])),
    ]
    none = np.array([], int)
    sets = {
        "a": [none, np.array([0]), np.array([1]), none],
        "b": [none, none, np.array([0]), none],
        "rim": [np.array([0]), none, none, np.array([0])],
        "bottom": [np.array([0, 1]), none, none, none],
    }
    path = tmp_path / "model.inp"
    meshio.Mesh(points, cells, cell_sets=sets, point_sets={"P": np.array([3])}).write(path)
    mesh = read_gmsh(path, order=1)
    assert mesh.area == pytest.approx(2.0) and mesh.material_names == ("a", "b")
    assert edges(mesh, "rim") == [(0.5, 0.0), (2.0, 0.5)] and edges(mesh, "bottom") == [
        (0.5, 0.0),
        (1.5, 0.0),
    ]
    assert mesh.nodes[mesh.points["P"]] == pytest.approx([0, 1])


def random_deck(random) -> tuple[str, dict[str, set], dict[str, int]]:
    """A grid of triangles and quadrilaterals in random blocks, its outline in random blocks and sets: the
    deck, the ends of each set's lines and the number of cells of each material.
    """
    nx, ny = random.integers(2, 5, 2)
    label = random.permutation(900)[: (nx + 1) * (ny + 1)].reshape(nx + 1, ny + 1) + 1
    text = "*NODE\n" + "".join(f"{label[i, j]}, {i}, {j}\n" for i in range(nx + 1) for j in range(ny + 1))
    cells, owners = [], []
    for i in range(nx):
        for j in range(ny):
            loop = [label[i, j], label[i + 1, j], label[i + 1, j + 1], label[i, j + 1]]
            parts = [loop] if random.random() < 0.5 else [loop[:3], [loop[0], *loop[2:]]]
            cells += parts
            owners += [f"m{random.integers(3)}" for _ in parts]
    rim = [(label[i, j], label[i + 1, j]) for i in range(nx) for j in (0, ny)]
    rim += [(label[i, j], label[i, j + 1]) for i in (0, nx) for j in range(ny)]
    numbers = iter(random.permutation(9000)[: len(cells) + len(rim)] + 1)
    sets: dict[str, set] = {}
    members: dict[str, list[int]] = {}
    blocks = []
    for nodes, owner in zip(cells, owners):
        blocks.append((f"CPS{len(nodes)}", owner, next(numbers), nodes))
    for ends in rim:
        number, own = next(numbers), f"s{random.integers(3)}"
        blocks.append(("T2D2", own, number, ends))
        sets.setdefault(own, set()).add(frozenset(ends))
        for name in ("t0", "t1"):
            if random.random() < 0.5:
                members.setdefault(name, []).append(number)
                sets.setdefault(name, set()).add(frozenset(ends))
    for k in random.permutation(len(blocks)):
        kind, name, number, nodes = blocks[k]
        name = name.upper() if random.random() < 0.3 else name
        row = f"{number}, {', '.join(map(str, nodes))}\n"
        header = f"*ELEMENT, TYPE={kind}, ELSET={name}\n"
        text += row if text.rfind(header) > text.rfind("*") - 1 and header in text else header + row
    for name, found in members.items():
        for half in np.array_split(found, random.integers(1, 4)):
            text += f"*ELSET, ELSET={name}\n" + "".join(f"{k},\n" for k in half)
    where = {label[i, j]: (float(i), float(j)) for i in range(nx + 1) for j in range(ny + 1)}
    middles = {
        name: sorted(tuple(np.mean([where[k] for k in ends], axis=0).tolist()) for ends in found)
        for name, found in sets.items()
    }
    return text, middles, {name: owners.count(name) for name in set(owners)}


@pytest.mark.slow
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=[pytest.mark.long] * (seed > 3)) for seed in range(12)]
)
def test_random_decks(tmp_path, seed):
    text, sets, materials = random_deck(np.random.default_rng(seed))
    mesh = read(tmp_path, text)
    found = {name.lower(): name for name in mesh.edge_sets}
    assert found.keys() == sets.keys()
    assert {name: edges(mesh, found[name]) for name in sets} == sets
    names = [name.lower() for name in mesh.material_names]
    assert {name: int((mesh.materials == k).sum()) for k, name in enumerate(names)} == materials


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("*NSET, NSET=P", "*INCLUDE, INPUT=/etc/passwd\n*NSET, NSET=P"), "*INCLUDE in line 16"),
        (("CPS4", "C3D4"), "*ELEMENT in line 10 has elements of type C3D4; a plane mesh"),
        (("CPS4", "CAX4"), "type CAX4"),
        (("2, 2, 3, 6, 5", "2, 2, 3, 66, 5"), "*ELEMENT in line 13 has node 66 in element 2"),
        (("2, 2, 3, 6, 5", "2, 2, 3, 6"), "has 3 nodes of element 2, not 4"),
        (("2, 2, 3, 6, 5", "2, 2, 3, 6,"), "ends within element 2"),
        (("2, 2, 3, 6, 5", "1, 2, 3, 6, 5"), "holds element 1, which there is already"),
        (("2, 2, 3, 6, 5", "2, 2, 3, 6, x"), "does not hold whole numbers: 2, 2, 3, 6, x"),
        (("2, 2, 3, 6, 5", "9" * 19 + ", 2, 3, 6, 5"), "does not hold whole numbers: 999"),
        (("6, 2., 1.", "6, 2., one"), "*NODE in line 9 does not hold a number and coordinates"),
        (("6, 2., 1.", "6, 2., 1.\n5, 2., 1."), "holds node 5, which stands elsewhere already"),
        ((", ELSET=brass", ""), "element 2 is in no set, whose name is the material's"),
        (("*NSET, NSET=P", "*ELSET, ELSET=b\n1\n*NSET, NSET=P"), "is in the sets 'steel' and 'b'"),
        (("*NSET, NSET=P\n6", "*ELSET, ELSET=b\n7"), "has element 7, which does not exist"),
        (("*NSET, NSET=P\n6", "*ELSET, ELSET=b\nnone"), "names the set 'none'"),
        (("*NSET, NSET=P\n6", "*ELSET, ELSET=b, GENERATE\n1"), "first and a last number"),
        (("*NSET, NSET=P\n6", "*SOLID SECTION, ELSET=steel, MATERIAL=s"), "2 is in no *SOLID SECTION"),
        (("*NSET, NSET=P", "*NGEN\n1, 2\n*NSET, NSET=P"), "*NGEN in line 16 makes nodes"),
        (("*NSET, NSET=P", "*SURFACE\n1, S1\n*NSET, NSET=P"), "*SURFACE in line 16 has no name"),
        (
            ("*NSET, NSET=P", "*SURFACE, TYPE=CYLINDER, NAME=s\n1\n*NSET, NSET=P"),
            "made by CYLINDER; give its elements",
        ),
        (("*NSET, NSET=P", "*SURFACE, NAME=s\n1, S5\n*NSET, NSET=P"), "side 'S5' of element 1"),
        (
            ("*NSET, NSET=P", "*SURFACE, NAME=s\n9, S1\n*NSET, NSET=P"),
            "has element 9, which does not exist",
        ),
        (("*NSET, NSET=P", "*SURFACE, NAME=s\nx, S1\n*NSET, NSET=P"), "names the set 'x'"),
        (("*NSET, NSET=P", "*SURFACE, NAME=s\n*NSET, NSET=P"), "holds no side of the outline"),
        (
            ("*NSET, NSET=P", "*SURFACE, NAME=s\n1, S1\n*SURFACE, NAME=S\n1, S4\n*NSET, NSET=P"),
            "makes the curve 'S', which there is already",
        ),
    ],
)
def test_wrong_decks(tmp_path, change, says):
    """As it is refused in the child process, whose sentence `test_wrong_meshes` sees arrive."""
    assert change[0] in INP
    (tmp_path / "model.inp").write_text(INP.replace(*change))
    with pytest.raises(Refusal) as caught:
        abaqus.extract(file=str(tmp_path / "model.inp"), order=1, size=None, most_unknowns=1000)
    assert says in str(caught.value)


@pytest.mark.parametrize(
    ("change", "options", "says"),
    [
        (("*NODE\n", "*NODE, INPUT=nodes.txt\n"), {}, "*NODE in line 3 reads the file 'nodes.txt'"),
        (("*HEADING", "*HEADING"), {"size": 0.1}, "size has no meaning"),
        (("*HEADING", "*HEADING"), {"order": 20, "max_unknowns": 100}, "more than max_unknowns = 100"),
        (("*HEADING", "*HEADING"), {}, "'crack:c' holds no curve"),
        ((", NSET=crack:c\n2, 5", ", NSET=Q\n1, 6"), {}, "'Q' holds no curve"),
    ],
)
def test_wrong_meshes(tmp_path, change, options, says):
    assert change[0] in INP
    with pytest.raises(ValueError) as caught:
        read(tmp_path, INP.replace(*change), **options)
    assert says in str(caught.value) and str(tmp_path / "model.inp") in str(caught.value)
