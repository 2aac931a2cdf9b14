"""Files of CalculiX 2.20 in tests/bodies/calculix beside scikit-fem's matrices of the same elements."""

from __future__ import annotations

import re
import shutil
import subprocess
import warnings
from pathlib import Path

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.bodies.readers import read_deck

FILES = Path(__file__).parent / "calculix"


def numbers(head: str) -> np.ndarray:
    """Of the lines below a head of the mesh."""
    text = (FILES / "blocks_mesh.inp").read_text().split(head)[1].split("*")[0]
    return np.array([[float(cell) for cell in line.split(",")] for line in text.strip().splitlines()])


@pytest.fixture
def job(tmp_path):
    """A copy of the files."""
    shutil.copytree(FILES, tmp_path, dirs_exist_ok=True)
    return tmp_path / "blocks"


def test_matrices_are_those_of_scikit_fem():
    """Tetrahedra of first order in SI; CalculiX integrates their mass at one point."""
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    nodes, tets = numbers("NSET=NALL\n")[:, 1:], numbers("ELSET=EALL\n")[:, 1:].astype(int)
    mesh, element = skfem.MeshTet(1e-3 * nodes.T, tets.T - 1), skfem.ElementVector(skfem.ElementTetP1())
    basis = skfem.Basis(mesh, element, intorder=1)
    stiffness = linear_elasticity(*lame_parameters(210e9, 0.3)).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: 7850.0 * dot(u, v)).assemble(basis)
    body = sb.read_calculix(FILES / "blocks")
    own = [basis.nodal_dofs[d, node - 1] for node, d in body.unknowns]
    for found, right in ((body.stiffness, stiffness), (body.mass, mass)):
        assert np.abs((found - right.tocsr()[own][:, own]).toarray()).max() < 1e-12 * abs(right).max()
    assert len(own) == 3 * len(nodes) - len(body.fixed) == 78


def test_deck():
    """Sets by label, by first and last, and by name; in capitals."""
    body = sb.read_calculix(FILES / "blocks.inp", units="mm-N-t")
    assert {name: sorted(labels) for name, labels in body.sets.items()} == {
        "NALL": list(range(1, 33)),
        "CLAMP": [1, 2, 11, 12, 21, 22],
        "LEFT": [25, 26],
        "RIGHT": [31, 32],
        "FACES": [25, 26, 31, 32],
    }
    assert body.fixed == {(node, d) for node in body.sets["CLAMP"] for d in range(3)}
    crack = body.contact("LEFT", "RIGHT", normal="x")
    tip = body.at((0.08, 0.01, 0.01), "z")
    rom = sb.reduce(body, contact=crack, loads={"F": tip}, points={"tip": tip}, modes=10)
    k, f = body.stiffness.toarray(), tip.weights.toarray()[0]
    down, up = sb.static(rom, -100.0), sb.static(rom, 100.0)
    assert down.active.tolist() == [False, False] and up.active.tolist() == [True, True]
    assert down.displacement("tip") == pytest.approx(-100.0 * f @ np.linalg.solve(k, f), rel=1e-7)
    tied = np.block([[k, crack.rows.toarray().T], [crack.rows.toarray(), np.zeros((2, 2))]])
    u = np.linalg.solve(tied, np.append(100.0 * f, [0.0, 0.0]))[: len(k)]
    assert up.displacement("tip") == pytest.approx(f @ u, rel=1e-7)


def test_a_node_may_have_a_mass_of_its_own(job):
    """As a weight on springs has, which no solid element shares."""
    held, mass = "*BOUNDARY\n", job.with_suffix(".mas").read_text()
    deck = job.with_suffix(".inp")
    deck.write_text(
        deck.read_text().replace("*STEP", "*NODE\n900, .02, .02, .02\n" + held + "900, 2, 3\n*STEP")
    )
    for ending, line in ((".dof", "900.1\n"), (".sti", "79 79 2.5\n"), (".mas", "79 79 1.e-6\n")):
        file = job.with_suffix(ending)
        file.write_text(file.read_text() + line)
    assert mass.count("\n") == job.with_suffix(".mas").read_text().count("\n") - 1
    body = sb.read_calculix(job)
    assert body.mass[78, 78] == pytest.approx(1e-3) and body.stiffness[78, 78] == pytest.approx(2.5e3)


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_itself(job):
    """The installed one writes the same numbers."""
    for ending in ("sti", "mas", "dof"):
        job.with_suffix(f".{ending}").unlink()
    subprocess.run(["ccx", "blocks"], cwd=job.parent, check=True, capture_output=True, timeout=300)
    found, right = sb.read_calculix(job), sb.read_calculix(FILES / "blocks")
    assert found.unknowns.tolist() == right.unknowns.tolist()
    assert np.abs((found.stiffness - right.stiffness).toarray()).max() < 1e-9 * abs(right.stiffness).max()
    assert np.abs((found.mass - right.mass).toarray()).max() < 1e-9 * abs(right.mass).max()


# Of a brick: its corners and edges; of a solid, and of another one that fills the brick with it.
BRICK = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = {8: "01 12 23 30 45 56 67 74 04 15 26 37", 6: "01 12 20 34 45 53 03 14 25"}
WEDGES = ["012456", "023467"]


def bar(kind: str, solver: str) -> str:
    """The deck of a bar of 40 x 10 x 10 mm with 16 bricks, which is held at one end."""
    labels, solids = dict[tuple[int, ...], int](), list[list[int]]()
    for corner in np.ndindex(4, 2, 2):
        for corners in ["01234567"] if "C3D8" in kind or "C3D20" in kind else WEDGES:
            places = [2 * np.array(corner) + BRICK[int(k)] for k in corners]
            if kind in ("C3D15", "C3D20", "C3D20R"):
                edges = EDGES[len(corners)].split()
                places += [(places[int(a)] + places[int(b)]) // 2 for a, b in edges]
            solids.append([labels.setdefault(tuple(place.tolist()), len(labels) + 1) for place in places])
    lines = ["*NODE", *(f"{k}, {5 * x}, {2.5 * y}, {2.5 * z}" for (x, y, z), k in labels.items())]
    lines += [f"*ELEMENT, TYPE={kind}, ELSET=ALL"]
    for number, nodes in enumerate(solids, 1):
        row = list(map(str, [number, *nodes]))
        lines += [
            ", ".join(row[:10]) + ("," if row[10:] else ""),
            *([", ".join(row[10:])] if row[10:] else []),
        ]
    lines += ["*NSET, NSET=HELD", *(f"{k}," for (x, _, _), k in labels.items() if x == 0)]
    lines += ["*MATERIAL, NAME=S", "*ELASTIC", "210e3, 0.3", "*DENSITY", "7.85e-9"]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=S", "*BOUNDARY", "HELD, 1, 3"]
    return "\n".join([*lines, "*STEP", f"*FREQUENCY{solver}", "6", "*END STEP", ""])


@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
@pytest.mark.parametrize("kind", ["C3D6", "C3D15", "C3D8", "C3D8R", "C3D20", "C3D20R"])
def test_frequencies_of_calculix_itself(tmp_path, kind):
    """Six of bricks and wedges, as far as it writes digits; C3D20R's mass, of eight points, is singular."""
    for name, solver in (("own", ""), ("stored", ", SOLVER=MATRIXSTORAGE")):
        (tmp_path / f"{name}.inp").write_text(bar(kind, solver))
        subprocess.run(["ccx", name], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    table = (tmp_path / "own.dat").read_text().split("FACTOR")[0]
    right = [float(line.split()[3]) for line in table.splitlines() if re.match(r"\s+\d+\s+\S+E", line)]
    body = sb.read_calculix(tmp_path / "stored")
    tip = body.at((0.04, 0.01, 0.01), "z")
    found = sb.reduce(body, loads={"F": tip}, points={"tip": tip}, modes=6).frequencies
    assert found == pytest.approx(right[:6], rel=1e-6)


def test_lines_of_a_deck(tmp_path):
    """Nodes of an element go on in the next line, with or without a comma; directions 4 to 6 are held, too,
    temperatures are not; springs, and sets of them, are passed over, so are loads in files of their own.
    """
    nodes = "".join(f"{k}, {k}., 0., 0.\n" for k in range(1, 21))
    one, two = ", ".join(map(str, range(1, 16))), ", ".join(map(str, range(16, 21)))
    springs = "*ELEMENT, TYPE=SPRINGA, ELSET=S\n9, 1, 2\n*ELSET, ELSET=T\n9, S\n"
    held = "*BOUNDARY\n3, 4, 6\n4, 2, , 0.0\n5, 11, 11, 20.\n*AMPLITUDE, NAME=A, INPUT=a.txt\n"
    held += "*ELSET, ELSET=U\n7, 9\n*NSET, NSET=ENDS, ELSET=T\n*NSET, NSET=ALL, ELSET=U\n"
    for comma in ("", ","):
        file = tmp_path / "lines.inp"
        file.write_text(f"*NODE\n{nodes}*ELEMENT, TYPE=C3D20R\n7, {one}{comma}\n{two}\n{springs}{held}")
        deck = read_deck("test", str(file))
        assert deck["elements"] == {"hexahedron20": [list(range(1, 21))]}
        assert deck["fixed"] == {(3, 3), (3, 4), (3, 5), (4, 1)}
        assert deck["sets"] == {"ALL": list(range(1, 21))}


# Rows of the file of unknowns by other nodes.
TURNED = "".join(f"{n}.{d}\n" for n in (*range(23, 33), *range(3, 11), *range(13, 21)) for d in (1, 2, 3))
# The file that is changed, what is found in it and what takes its place, and the sentence.
WRONG = [
    ("sti", None, "", r"blocks.sti: there is no such file; .* writes .sti, .mas and .dof"),
    ("mas", None, "", r"blocks.mas: there is no such file"),
    ("dof", None, "", r"blocks.dof: there is no such file"),
    ("inp", None, "", r"blocks.inp: there is no such file"),
    ("sti", r"\s\S+\n\Z", "\n", r"blocks.sti is cut, or no matrix"),
    ("sti", r"(.* 78 .*\n)+\Z", "", r"has rows 1 to 77, whole numbers from 1 to 78 were expected"),
    ("sti", r".*\n\Z", "", r"\.sti has \d+ entries, \.mas \d+; one is cut or of another run"),
    ("mas", r"\A.*\n", "", r"\.sti has \d+ entries, \.mas \d+; one is cut or of another run"),
    ("sti", r"\A(.*\n)*", "", r"blocks.sti has rows 0 to 0"),
    ("sti", r"\A1 1", "0 1", r"blocks.sti has rows 0 to 78"),
    ("sti", r"\A1 1", "1.5 1", r"blocks.sti has rows 1 to 78, whole numbers"),
    ("sti", r"\A1 1", "x 1", r"blocks.sti is cut, or no matrix"),
    ("sti", r"\A1 1 .*", "1 1 nan", r"stiffness.data"),
    ("sti", r"\A1 1 .*", "1 1 -1.0", r"stiffness of node 3, direction 0 is -1000"),
    ("sti", r"\A", "1 1 5.0\n", "blocks.sti has 1 entries twice; is it of two runs"),
    ("dof", r"\A3.1\n", "", r"78, whole numbers from 1 to 77 were expected"),
    ("dof", r"\A3.1", "3.7", r"'3.7' is no node.direction"),
    ("dof", r"\A3.1", "999.1", r"'999.1' is no node.direction of the deck.* elements that CalculiX expands"),
    ("dof", r"\A3.1", "1.1", r"node 3 has no unknown along x"),
    ("dof", r"\A3.1\n3.2", "3.2\n3.1", r"blocks.mas couples 3.2 and 4.1, which no element does"),
    (
        "dof",
        r"\A(?s:.*)",
        TURNED,
        r"couples 23.1 and 31.1, which",
    ),
    ("inp", r"\*BOUNDARY\n.*", "", r"node 1 has no unknown along x in .*, and no \*BOUNDARY"),
    ("inp", r"CLAMP, 1", "NOWHERE, 1", r"\*BOUNDARY in .*blocks.inp, line 18 names the set 'NOWHERE'"),
    (
        "inp",
        r"CLAMP, 1, 3",
        "CLAMP, 1, 3, 0.1",
        r"\*BOUNDARY in .*blocks.inp, line 19 moves what it holds \(CLAMP, 1, 3, 0.1\), and bodies are held",
    ),
    (
        "inp",
        r"\*STEP",
        "*BOUNDARY, OP=NEW\n5, 1\n*STEP",
        r"\*BOUNDARY in .*blocks.inp, line 20 frees what those before it hold",
    ),
    (
        "inp",
        r"\*STEP",
        "*EQUATION\n2\n3,1,1.,5,1,-1.\n*STEP",
        r"\*EQUATION in .*blocks.inp, line 20 changes what moves",
    ),
    ("inp", r"\*STEP", "*tie, name=a\n*STEP", r"\*TIE in .*blocks.inp, line 20 changes what moves"),
    ("inp", r"\*STEP", "*Rigid  Body, NSET=LEFT\n*STEP", r"\*RIGID BODY in .* changes what moves"),
    ("inp", r"\*STEP", "*INSTANCE, PART=A\n*STEP", r"\*INSTANCE in .*blocks.inp, line 20 numbers nodes anew"),
    ("inp", r"INPUT=\S+", "INPUT=blocks.inp", r"\*INCLUDE is in itself"),
    ("inp", r"INPUT=\S+", "INPUT=other.inp", r"other.inp: there is no such file"),
    ("inp", r"NSET=left", "ELSET=left", r"\*NSET in .* has no name; give it one, NSET="),
    ("inp", r"\*STEP", "*NODE, INPUT=a.txt\n*STEP", r"\*NODE in .* reads the file 'a.txt'"),
    ("inp", r"(?s).*", "SOL 103\nGRID,1,,0.,0.,0.\n", r"blocks.inp has no nodes .*; give a deck of CalculiX"),
    ("inp", r"\*STEP", "*NGEN, NSET=A\n1, 5\n*STEP", r"\*NGEN in .* makes nodes"),
    ("inp", r"\*STEP", "*NODE, SYSTEM=C\n99, 1., 90., 0.\n*STEP", r"\*NODE in .* or places them; write all"),
    ("inp", r"\*STEP", "*NSET, NSET=A\n99\n*STEP", r"\*NSET in .*, line 21 has node 99, which does not"),
    (
        "inp",
        r"\*STEP",
        "*NODE\n7, a, 0., 0.\n*STEP",
        r"\*NODE in .*, line 21 does not hold a number and coordinates: 7, a, 0., 0.\Z",
    ),
]


@pytest.mark.parametrize(("ending", "old", "new", "sentence"), WRONG)
def test_wrong_files(job, ending, old, new, sentence):
    """One sentence for each."""
    changed = job.with_suffix(f".{ending}")
    if old is None:
        changed.unlink()
    else:
        text, count = re.subn(old, lambda _: new, changed.read_text(), count=1)
        assert count == 1
        changed.write_text(text)
    with pytest.raises(ValueError, match=sentence) as raised:
        sb.read_calculix(job)
    assert "\n" not in str(raised.value)


def test_units_of_another_kind():
    """Millimetres for metres make waves a thousand times as fast, g for kg a body of 8,000 t/m^3; nothing is
    said of what is right.
    """
    with pytest.warns(sb.UnitWarning, match=r"waves run at about 4\.\d+e\+06 m/s.* units = 'SI' those"):
        sb.read_calculix(FILES / "blocks", units="SI")
    right = sb.read_calculix(FILES / "blocks")
    heavy = right.mass * 1e3, right.stiffness * 1e3, right.unknowns, dict(zip(right.labels, right.places))
    with pytest.warns(sb.UnitWarning, match=r"a mass of 51\.7 kg in 8e-06 m\^3 is more than any solid's"):
        sb.FiniteElementModel(*heavy)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb.read_calculix(FILES / "blocks")


def test_history_beside_calculix():
    """A force at once on faces that touch: CalculiX's own integration with gap elements of 1e10 N/m, steps of
    .1 us (`blocks_dynamic.inp`), over .19 ms: 3e-4. Without contact it is .27 off, with rigid faces 6e-3.
    """
    time, u = np.loadtxt(FILES / "blocks_dynamic.csv", delimiter=",").T
    body = sb.read_calculix(FILES / "blocks")
    tip, crack = body.at((0.08, 0.01, 0.01), "z"), body.contact("LEFT", "RIGHT", normal="x", gap=0.0)
    rom = sb.reduce_matrices(
        body.mass,
        body.stiffness,
        crack.rows,
        crack.gap,
        loads=tip.weights.T,
        sensors={"tip": tip},
        modes=76,
        compliance=np.full(2, 1e-10),
    )
    found = sb.transient(rom, 20.0, time[-1], step=1e-7)
    off = np.interp(time, found.time, found.displacement("tip")) - u
    assert np.abs(off).max() < 5e-4 * np.abs(u).max()
    apart = sb.transient(rom, 20.0, time[-1], step=1e-6, contact=False)
    assert np.abs(np.interp(time, apart.time, apart.displacement("tip")) - u).max() > 0.1 * np.abs(u).max()
