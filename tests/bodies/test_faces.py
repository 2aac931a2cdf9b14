"""Faces whose meshes do not match: exact for motions that are linear in space, beside bars in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse

import sbfem_petsc as sb

YOUNG, AREA, LENGTH = 210e9, 1e-4, 0.04


def block(start: float, cells: tuple[int, int, int], first: int, held: float):
    """Matrices of a block of LENGTH x 10 x 10 mm without Poisson's effect, its unknowns, and nodes from a
    label on; it is held along x at one end, and elsewhere along y and z.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    lines = [np.linspace(0.0, size, n + 1) for size, n in zip((LENGTH, 0.01, 0.01), cells, strict=True)]
    mesh = skfem.MeshHex.init_tensor(lines[0] + start, *lines[1:])
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
    stiffness = linear_elasticity(*lame_parameters(YOUNG, 0.0)).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: 7850.0 * dot(u, v)).assemble(basis)
    unknowns = np.zeros((basis.N, 2), int)
    for d in range(3):
        unknowns[basis.nodal_dofs[d]] = np.stack([np.arange(mesh.nvertices), np.full(mesh.nvertices, d)], 1)
    fixed = (np.abs(mesh.p[0, unknowns[:, 0]] - held) < 1e-9) & (unknowns[:, 1] == 0)
    fixed |= (unknowns[:, 1] > 0) & (np.abs(mesh.p[0, unknowns[:, 0]] - held) < 1e-9)
    free = np.flatnonzero(~fixed)
    unknowns[:, 0] += first
    nodes = {first + k: tuple(x) for k, x in enumerate(mesh.p.T)}
    return (
        mass.tocsr()[free][:, free],
        stiffness.tocsr()[free][:, free],
        unknowns[free],
        nodes,
        unknowns[fixed],
    )


@pytest.fixture(scope="module")
def body():
    """A block held at x = 0 with a fine face at 40 mm, and one held at 80 mm with a coarse face there."""
    left, right = block(0.0, (3, 4, 3), 1, 0.0), block(LENGTH, (3, 2, 2), 1001, 2.0 * LENGTH)
    nodes = left[3] | right[3]
    faces = {
        name: [label for label, x in part[3].items() if abs(x[0] - LENGTH) < 1e-9]
        for name, part in (("LEFT", left), ("RIGHT", right))
    }
    return sb.FiniteElementModel(
        scipy.sparse.block_diag([left[0], right[0]]),
        scipy.sparse.block_diag([left[1], right[1]]),
        np.concatenate([left[2], right[2]]),
        nodes,
        sets=faces,
        fixed=np.concatenate([left[4], right[4]]),
    )


def test_linear_motions_leave_gaps_alone(body):
    """Where displacements are linear in space faces that coincide keep together; motions of one block alone
    open them by what they are; forces have their resultant and their moments.
    """
    crack = body.contact("LEFT", "RIGHT", normal="x", matching=False)
    assert crack.rows.shape[0] == len(body.sets["LEFT"]) == 20 and not crack.gap.any()
    place = {int(label): x for label, x in zip(body.labels, body.places, strict=True)}
    linear = np.array([[1.0, -2.0, 0.5], [0.3, 0.1, 4.0], [-1.0, 2.0, 0.7]])
    u = np.array([linear[d] @ place[int(node)] for node, d in body.unknowns])
    assert np.abs(crack.rows @ u).max() < 1e-14
    apart = np.where(body.unknowns[:, 0] > 1000, u, 0.0)
    at = np.array([place[label] for label in body.sets["LEFT"]])
    assert crack.rows @ apart == pytest.approx(at @ linear[0], rel=1e-12)
    force = np.arange(1.0, 21.0)
    on_right = np.where(body.unknowns[:, 0] > 1000, crack.rows.T @ force, 0.0)
    for arm in (lambda x: 1.0, lambda x: x[1], lambda x: x[2]):
        arms = np.array([arm(place[int(node)]) for node, _ in body.unknowns])
        assert on_right @ arms == pytest.approx(force @ [arm(x) for x in at], rel=1e-12)


def test_rows_of_rounding_are_none(body):
    """Nodes that meet themselves, as those of a crack's front that stand in both sets, and components of a
    normal that are rounding: forces of 1e19 N pressed on such rows and held the body.
    """
    with pytest.raises(ValueError, match="no displacement moves a gap"):
        body.contact("LEFT", "LEFT", normal=(1.0, 0.3, 0.2), matching=False)
    crack = body.contact("LEFT", "RIGHT", normal="x", matching=False)
    turned = body.contact("LEFT", "RIGHT", normal=(1.0, np.cos(np.pi / 2), 1e-17), matching=False)
    assert turned.rows.nnz == crack.rows.nnz and abs(turned.rows - crack.rows).max() < 1e-14
    with pytest.raises(ValueError, match="held along"):
        body.at(sorted(body.fixed)[0][0], (np.cos(np.pi / 2), 1.0, 0.0))


def test_pairs_that_are_given_twice(body):
    """Labels count once; contact that is added again, and equal rows of matrices, are told."""
    labels = list(body.sets["LEFT"])
    crack = body.contact(labels, normal="x", gap=1e-6)
    assert len(body.contact(labels + labels[:3], normal="x", gap=1e-6).gap) == len(crack.gap)
    with pytest.raises(ValueError, match="pair 0 that is added is there already"):
        crack + body.contact(labels[4:6], normal="x", gap=2e-6)
    stiffness, row = np.array([[2.0, -1.0], [-1.0, 2.0]]), np.array([[1.0, 0.0]])
    given = dict(loads=row.T, sensors={"x": 0}, modes=1)
    twice = sb.reduce_matrices(np.eye(2), stiffness, np.repeat(row, 2, axis=0), np.zeros(2), **given)
    with pytest.raises(sb.SolveError, match="is a pair given twice"):
        sb.static(twice, -1.0)


def test_two_bars_in_closed_form(body):
    """A force on the left bar's end closes a gap g: N = (F / k - g) / (2 / k). The faces' meshes differ, so
    that stresses next to it are not uniform: measured 1.8e-3 of N here, 9e-4 with half the size of cells.
    """
    gap, push, k = 2e-6, 5e3, YOUNG * AREA / LENGTH
    crack = body.contact("LEFT", "RIGHT", normal="x", gap=gap, matching=False)
    face = body.at("LEFT", "x")
    stiff = body.stiffness.toarray()
    area = np.zeros(len(stiff))  # consistent forces of a uniform pressure: K u of a uniform stretch
    for i, (node, d) in enumerate(body.unknowns):
        if node < 1000 and d == 0:
            area[i] = body.places[body.labels == node][0, 0]
    uniform = stiff @ area
    uniform *= push / uniform.sum()
    rom = sb.reduce(
        body,
        contact=crack,
        loads={"F": type(face)(scipy.sparse.csr_matrix(uniform))},
        points={"face": face},
        modes=10,
    )
    found = sb.static(rom, 1.0)
    expected = (push / k - gap) / (2.0 / k)
    assert found.contact_resultant == pytest.approx(expected, rel=3e-3)
    assert found.displacement("face") == pytest.approx((push - expected) / k, rel=3e-3)


def test_gaps_of_planes_that_lean(body):
    """The distance of a coarse plane is exact; a face that reaches beyond the other, or is a line: errors."""
    moved = {
        int(n): x + (1e-4 + 0.02 * x[1]) * (n > 1000) * np.eye(3)[0] for n, x in zip(body.labels, body.places)
    }
    held = sorted(body.fixed)
    lean = sb.FiniteElementModel(body.mass, body.stiffness, body.unknowns, moved, sets=body.sets, fixed=held)
    y = np.array([moved[label][1] for label in body.sets["LEFT"]])
    assert lean.contact("LEFT", "RIGHT", normal="x", matching=False).gap == pytest.approx(
        1e-4 + 0.02 * y, rel=1e-9
    )
    with pytest.raises(ValueError, match="have no partner .* say matching=False"):
        body.contact("LEFT", "RIGHT", normal="x")
    inner = [n for n in body.sets["RIGHT"] if moved[n][1] < 0.006]
    with pytest.raises(ValueError, match="8 of 20 left nodes, node .* lie beside the right face"):
        body.contact("LEFT", inner, normal="x", matching=False)
    with pytest.raises(ValueError, match="span no surface across the normal"):
        body.contact(
            "LEFT", [n for n in body.sets["RIGHT"] if moved[n][1] < 0.001], normal="x", matching=False
        )


def test_a_face_with_a_notch():
    """Three of four squares: the node before the fourth one lies in the hull of the others' nodes, and beside
    the face; without elements nobody knows.
    """
    grid = {1 + j + 3 * k: (0.0, 0.01 * j, 0.01 * k) for j in range(3) for k in range(3)}
    nodes = {label: place for label, place in grid.items() if label != 9}
    nodes |= {11: (0.0, 0.004, 0.013), 12: (0.0, 0.0135, 0.0125)}
    count = len(nodes)
    given = {
        "mass": 1e-3 * scipy.sparse.eye(count),
        "stiffness": 1e9 * scipy.sparse.eye(count),
        "unknowns": [(label, 0) for label in nodes],
        "nodes": nodes,
    }
    squares = {"quad": [(1, 2, 5, 4), (2, 3, 6, 5), (4, 5, 8, 7)]}
    body = sb.FiniteElementModel(**given, elements=squares)
    right = [label for label in nodes if label < 10]
    with pytest.raises(ValueError, match="1 of 2 left nodes, node 12 say, lie beside the right face"):
        body.contact([11, 12], right, normal="x", matching=False)
    crack = body.contact([11], right, normal="x", matching=False)
    y = np.array([nodes[label][1] + 2.0 * nodes[label][2] for label in nodes])
    assert abs((crack.rows @ y)[0]) < 1e-15
    hull = sb.FiniteElementModel(**given).contact([11, 12], right, normal="x", matching=False)
    assert hull.rows.shape[0] == 2
