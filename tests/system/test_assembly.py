"""Assembly by blocks against a dense sum; inertia when it is asked for; contact of many rows."""

import functools

import numpy as np
import pytest
from mpi4py import MPI

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate
from sbfem_petsc.petsc import PETSc
from sbfem_petsc.selement import solution
from sbfem_petsc.system.contact import bordered_contact
from sbfem_petsc.system.contact.expected_contact import expected_contact
from sbfem_petsc.system.solve import assembly, equilibrium
from sbfem_petsc.system.solve.assembly import ElementBlocks, assemble, assemble_like
from tests.parallel import alone, answer, on_ranks

STEEL = sb.Material(70e9, 0.3, 2700)


def dense(matrix):
    starts, columns, values = matrix.getValuesCSR()
    result = np.zeros(matrix.getSize())
    result[np.repeat(np.arange(len(starts) - 1), np.diff(starts)), columns] = values
    return result


def test_blocks_are_summed(monkeypatch):
    """Random blocks of two sizes, with unknowns that are held, in batches of one element: the dense sum, and
    no room but what the entries take.
    """
    monkeypatch.setattr(assembly, "_BATCH", 1)
    rng = np.random.default_rng(1)
    blocks, expected = [], np.zeros((30, 30))
    for count, rows, columns in ((7, 4, 4), (5, 3, 6)):
        numbers = [
            np.stack([rng.permutation(np.arange(-1, 30))[:n] for _ in range(count)]) for n in (rows, columns)
        ]
        values = rng.standard_normal((count, rows, columns))
        blocks.append(ElementBlocks(*numbers, values.__getitem__))
        for r, c, v in zip(*numbers, values):
            kept = np.ix_(r >= 0, c >= 0)
            expected[np.ix_(r[r >= 0], c[c >= 0])] += v[kept]
    matrix = assemble(MPI.COMM_SELF, np.array([0, 30]), blocks, "general")
    np.testing.assert_allclose(dense(matrix), expected, rtol=1e-14, atol=1e-14)
    info = matrix.getInfo()
    assert info["mallocs"] == 0 and info["nz_unneeded"] == 0
    assert info["nz_used"] == np.count_nonzero(expected)


def test_full_blocks_and_a_pattern_taken_over():
    """Nodes of two unknowns, some held: in full blocks and in those of the upper half, and summed again with
    other values where a matrix has its entries, the dense sums, and no room but what the entries take.
    """
    rng = np.random.default_rng(2)
    nodes = np.stack([rng.permutation(np.arange(-1, 15))[:4] for _ in range(6)])
    numbers = np.where(nodes[..., None] >= 0, 2 * nodes[..., None] + [0, 1], -1).reshape(6, 8)
    single = np.array([[2, 3], [28, 29]])
    comm, ranges = MPI.COMM_SELF, np.array([0, 30])

    def blocks_and_sum():
        blocks, expected = [], np.zeros((30, 30))
        for rows in (numbers, single):
            values = rng.standard_normal((*rows.shape, rows.shape[1]))
            values += values.transpose(0, 2, 1)
            blocks.append(ElementBlocks(rows, rows, values.__getitem__))
            for r, v in zip(rows, values):
                expected[np.ix_(r[r >= 0], r[r >= 0])] += v[np.ix_(r >= 0, r >= 0)]
        return blocks, expected

    blocks, expected = blocks_and_sum()
    full, half = (assemble(comm, ranges, blocks, kind, block_size=2) for kind in ("blocks", "upper"))
    plain = assemble(comm, ranges, blocks, "general")
    again, other = blocks_and_sum()
    like = assemble_like(plain, again, definite=False)
    for matrix, total in ((full, expected), (half, expected), (plain, expected), (like, other)):
        np.testing.assert_allclose(dense(matrix.convert("aij")), total, rtol=1e-14, atol=1e-14)
        info = matrix.getInfo()
        assert info["mallocs"] == 0 and info["nz_unneeded"] == 0


ROOM = """
import json
import sbfem_petsc as sb
from mpi4py import MPI
from petsc4py import PETSc
from tests.reference import paper_beam
model = sb.Model(paper_beam().mesh(order=4), sb.Material(70e9, 0.33, 2700))
matrix = model.stiffness
info = matrix.getInfo(PETSc.Mat.InfoType.GLOBAL_SUM)
norms = [matrix.norm(kind) for kind in (PETSc.NormType.FROBENIUS, PETSc.NormType.NORM_1)]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"unneeded": info["nz_unneeded"], "mallocs": info["mallocs"], "used": info["nz_used"],
                      "norms": norms}))
"""


@pytest.mark.long
def test_room_on_ranks():
    """Rows that several ranks add to are counted exactly: no room left over, none to be got while filling."""
    one = alone(ROOM)
    for ranks in (2, 3):
        found = answer(on_ranks(ranks, ROOM))
        assert found["unneeded"] == 0 and found["mallocs"] == 0
        assert found["used"] == one["used"]
        np.testing.assert_allclose(found["norms"], one["norms"], rtol=1e-12)  # another order of the sum


def test_statics_compute_no_inertia(monkeypatch):
    """Not one mass matrix in statics, one for each shape in the first analysis that needs them, none
    after.
    """
    calls = []
    original = solution.SElement.with_inertia
    monkeypatch.setattr(
        solution.SElement, "with_inertia", lambda self, terms: calls.append(terms) or original(self, terms)
    )
    model = sb.Model(Beam(0.1, 0.005).mesh(order=3), STEEL, continued_fraction=2)
    sb.static(model, sb.PointForce("A", fy=1.0))
    assert calls == []
    auxiliary = sum(2 * group.nodes.size for group in model.cells.groups)
    assert model.unknowns == model.boundary_unknowns + 2 * auxiliary
    sb.modal(model, 3)
    assert calls == [2] * model.shapes
    sb.static(model, sb.SupportMotion(ay=9.81))
    sb.modal(model, 5)
    assert len(calls) == model.shapes


def test_weight_of_whole_numbers():
    """Accelerations that are given as ints: the supports bear the mass, in kg, times them."""
    model = sb.Model(Beam(0.1, 0.005).mesh(order=3), STEEL)
    mass = STEEL.density * 0.1 * 0.005
    borne = sb.static(model, sb.SupportMotion(ax=3, ay=-10)).reactions["left"]
    np.testing.assert_allclose(borne, [3.0 * mass, -10.0 * mass], rtol=1e-8)


@functools.cache
def cracked():
    cracks = [CrackLine([(0.03, y), (0.07, y + 0.006)]) for y in (0.02, 0.05, 0.08)]
    return Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=cracks).mesh(order=4)


# Bending, so that some of each crack's pairs open and others close.
LOADS = [
    sb.EdgeLoad("edge3", pressure=1e6),
    sb.EdgeLoad("edge3", ty=-1e6, tx=8e5),
    sb.EdgeLoad("edge2", pressure=-1e6),
]


LAWS = {
    "unilateral": sb.Unilateral(),
    "tied": sb.Tied(),
    "layer": sb.Unilateral(6e-17),
    "clearance": sb.Clearance(6e-17, width=1e-7),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("close", "name", "number"),
    [("joined", name, 0) for name in LAWS]
    + [pytest.param("joined", name, k, marks=pytest.mark.long) for name in LAWS for k in (1, 2)]
    + [
        pytest.param("factorised anew", name, k % 3, marks=[pytest.mark.long] * (k > 0))
        for k, name in enumerate(LAWS)
    ],
)
def test_bordered_contact(monkeypatch, close, name, number):
    """Factorisations with the active rows, and rows that join and leave them, against the flexibility of all
    rows: at once with those that are expected to close, and after the linear solution.
    """
    monkeypatch.setattr(bordered_contact, "_CLOSE", 400 if close == "joined" else 0)
    mesh, law, load = cracked(), LAWS[name], LOADS[number]
    make = lambda: sb.Model(mesh, STEEL, clamped="edge1", contact_laws=law)
    expected = sb.static(make(), load)
    monkeypatch.setattr(bordered_contact, "MANY", 0)
    calls = []

    class Counted(bordered_contact.Bordered):
        def __init__(self, *given):
            super().__init__(*given)
            calls.append(self)

    monkeypatch.setattr(bordered_contact, "Bordered", Counted)
    model = make()
    at_once = sb.static(model, load)
    touched = expected.active.any()
    assert len(calls) == touched and model.solver.factorised != touched
    agree(at_once, expected)
    sb.static(model, load, contact=False)
    assert model.solver.factorised
    agree(sb.static(model, load), expected)
    assert len(calls) == 2 * touched and model.contact.kept_compliance is None


def agree(found, expected):
    assert (found.active == expected.active).all()
    for name in ("contact_force", "gap"):
        one, other = getattr(found, name), getattr(expected, name)
        assert np.abs(one - other).max(initial=0.0) <= 1e-9 * np.abs(other).max(initial=0.0), name
    owned = expected.equilibrium.owned
    assert np.abs(found.equilibrium.owned - owned).max() <= 1e-10 * np.abs(owned).max()
    for tip, value in expected.stress_intensity.items():
        np.testing.assert_allclose(found.stress_intensity[tip], value, rtol=1e-8, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(
    "close", [400, pytest.param(3, marks=pytest.mark.long)], ids=["joined", "factorised anew"]
)
@pytest.mark.parametrize(
    "law", [sb.Unilateral(), sb.Clearance(6e-17, width=1e-7)], ids=["unilateral", "clearance"]
)
def test_wrong_expectations(monkeypatch, law, close):
    """Whatever is expected to close, all rows, the others, any: the loop finds the rows that do, and the
    stiffness itself is not factorised. Where none is, it is.
    """
    monkeypatch.setattr(bordered_contact, "_CLOSE", close)
    mesh, generator = cracked(), np.random.default_rng(1)
    make = lambda: sb.Model(mesh, STEEL, clamped="edge1", contact_laws=law)
    known = sb.static(make(), LOADS[2])
    monkeypatch.setattr(bordered_contact, "MANY", 0)
    model, closed = make(), known.equilibrium.active
    assert 0 < closed.sum() < len(closed)
    for start in (~closed | True, ~closed, generator.random(len(closed)) < 0.5, ~closed & False):
        monkeypatch.setattr(equilibrium, "expected_contact", lambda *_, start=start: start.astype(np.int8))
        agree(sb.static(model, LOADS[2]), known)
        assert model.solver.factorised != start.any()


BY_RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.system.contact import bordered_contact
from tests.system.test_assembly import LOADS, STEEL, cracked

comm, bordered_contact.MANY = MPI.COMM_WORLD, 0
model = sb.Model(sb.on_root(comm, cracked), STEEL, clamped="edge1")
found = sb.static(model, LOADS[2])
if comm.rank == 0:
    print(json.dumps({
        "factorised": model.solver.factorised,
        "active": found.active.tolist(),
        "force": found.contact_force.tolist(),
    }))
"""


@pytest.mark.long
def test_contact_at_once_by_ranks():
    """The coarse model and the bordered stiffness on three ranks, as on one."""
    one, three = (answer(on_ranks(n, BY_RANKS)) for n in (1, 3))
    assert not one["factorised"] and not three["factorised"]
    assert three["active"] == one["active"] and any(one["active"])
    np.testing.assert_allclose(three["force"], one["force"], atol=1e-9 * max(one["force"]))


@pytest.mark.slow
def test_expected_contact():
    """The coarse model's linear solution closes nearly the rows that the linear solution does."""
    model = sb.Model(cracked(), STEEL, clamped="edge1")
    for load in (*LOADS, sb.EdgeLoad("edge3", pressure=-1e6)):
        columns = model.load_columns([load])
        state = expected_contact(
            model.statics, model.contact, columns.forces[:, 0], columns.gaps[:, 0] + model.contact.initial
        )
        found = np.zeros(len(model.contact), dtype=bool) if state is None else state != 0
        linear = model.equilibrium(columns, touching=False).gap < 0.0
        assert (found != linear).sum() <= 0.1 * len(linear)


@pytest.mark.slow
@pytest.mark.parametrize(
    "load, law",
    [
        (LOADS[1], sb.Unilateral()),
        (LOADS[0], sb.Unilateral(6e-17)),
        (LOADS[1], sb.Clearance(6e-17, width=1e-7)),
    ],
)
def test_dual_contact(load, law):
    """Conjugate gradients on the contact forces, which stop at 1e-11 of the gaps, against the flexibility of
    all rows. Their own options are taken.
    """
    mesh = cracked()
    make = lambda: sb.Model(mesh, STEEL, clamped="edge1", contact_laws=law)
    expected = sb.static(make(), load)
    assert expected.active.any()
    options = PETSc.Options()
    options["contact_dual"] = "true"
    try:
        model = make()
        found = sb.static(model, load)
        options["contact_dual_ksp_max_it"] = 1
        with pytest.raises(sb.SolveError, match="static contact"):
            sb.static(make(), load)
    finally:
        options.delValue("contact_dual")
        options.delValue("contact_dual_ksp_max_it")
    assert model.contact.kept_compliance is None
    assert (found.active == expected.active).all()
    owned = expected.equilibrium.owned
    assert np.abs(found.equilibrium.owned - owned).max() < 1e-9 * np.abs(owned).max()
    most = np.abs(expected.contact_force).max()
    np.testing.assert_allclose(found.contact_force, expected.contact_force, atol=1e-7 * most)
