"""Faces whose meshes do not match: exact for motions that are linear in space, beside bars in closed form."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg

import sbfem_petsc as sb
from sbfem_petsc.bodies.faces import _shapes, between
from sbfem_petsc.bodies.rows import Row

# Corners of edges in VTK's order, by the corners of a solid.
SOLIDS = {4: "01 12 20 03 13 23".split(), 8: "01 12 23 30 45 56 67 74 04 15 26 37".split()}
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
        first + mesh.t[[0, 3, 6, 2, 1, 5, 7, 4]].T,  # in VTK's order
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
        elements={"hexahedron": np.concatenate([left[5], right[5]])},
    )


def test_linear_motions_leave_gaps_alone(body):
    """Where displacements are linear in space faces that coincide keep together; a block that moves opens
    them by that; forces on both sides have one resultant and the same moments.
    """
    crack = body.contact("LEFT", "RIGHT", normal="x", matching=False)
    assert crack.rows.shape[0] == len(body.sets["LEFT"]) == 20 and not crack.gap.any()
    place = {int(label): x for label, x in zip(body.labels, body.places, strict=True)}
    linear = np.array([[1.0, -2.0, 0.5], [0.3, 0.1, 4.0], [-1.0, 2.0, 0.7]])
    u = np.array([linear[d] @ place[int(node)] for node, d in body.unknowns])
    assert np.abs(crack.rows @ u).max() < 1e-14
    right = body.unknowns[:, 0] > 1000
    apart = np.where(right & (body.unknowns[:, 1] == 0), 1.0, 0.0)
    assert crack.rows @ apart == pytest.approx(np.ones(20), rel=1e-12)
    force = crack.rows.T @ np.arange(1.0, 21.0)
    assert force[right].sum() == pytest.approx(210.0, rel=1e-12)
    for d in (1, 2):
        arms = np.array([place[int(node)][d] for node, _ in body.unknowns])
        assert force[right] @ arms[right] == pytest.approx(-force[~right] @ arms[~right], rel=1e-12)


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


def test_a_front_that_both_faces_have():
    """Two squares each, of which the first ones begin at the same two nodes: these are no pairs, and all of a
    uniform pressure is shared out to the others, 2 on two squares, whose right nodes carry 1/4 or 1/2.
    """
    places = [(y, z) for z in (0.0, 1.0, 2.0) for y in (0.0, 1.0)]
    nodes = {side + k: (0.0, *place) for side in (1, 11) for k, place in enumerate(places)}
    left, right = [1, 2, 3, 4, 5, 6], [1, 2, 13, 14, 15, 16]
    squares = [[*(a[:2]), a[3], a[2]] for face in (left, right) for a in (face[:4], face[2:])]
    labels = sorted({*left, *right})
    body = sb.FiniteElementModel(
        scipy.sparse.identity(len(labels)),
        1e9 * scipy.sparse.identity(len(labels)),
        [(label, 0) for label in labels],
        nodes,
        elements={"quad": squares},
    )
    crack = body.contact(left, right, normal="x", matching=False)
    on_right = crack.rows.toarray()[:, [labels.index(label) for label in right[2:]]]
    assert crack.rows.shape[0] == 4 and not crack.rows[:, :2].toarray().any()
    forces = np.linalg.solve(on_right.T, [0.5, 0.5, 0.25, 0.25])
    assert (forces > 0.0).all() and forces.sum() == pytest.approx(2.0, rel=1e-12)


def test_two_bars_in_closed_form(body):
    """A pressure on the left bar's end closes a gap g: N = (F / k - g) / (2 / k), and the faces' meshes, 12
    and 4 cells, pass it on uniformly (each left node by itself before the right face: 1.8e-3 of N off).
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
    assert found.contact_resultant == pytest.approx(expected, rel=1e-9)
    assert found.displacement("face") == pytest.approx((push - expected) / k, rel=1e-9)


def halves(*kinds):
    """Two blocks of 30 x 10 x 10 mm, each of tetrahedra of ten nodes or hexahedra of twenty, so many along
    each axis, and with a face of its own at 30 mm: nodes and directions of the unknowns, places by label,
    elements, stiffness, and integrals of the shape function of each unknown over these faces.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    unknowns, nodes, elements, blocks, areas = [], {}, {}, [], []
    for first, start, (kind, *counts) in zip((1, 1001), (0.0, 0.03), kinds, strict=True):
        made, element = {
            "tetra10": (skfem.MeshTet, skfem.ElementTetP2),
            "hexahedron20": (skfem.MeshHex, skfem.ElementHexS2),
        }[kind]
        sides = zip((start, 0.0, 0.0), (0.03, 0.01, 0.01), counts, strict=True)
        mesh = made.init_tensor(*(np.linspace(at, at + size, n + 1) for at, size, n in sides))
        basis = skfem.Basis(mesh, skfem.ElementVector(element()))
        places, back = np.unique(basis.doflocs.T.round(12), axis=0, return_inverse=True)
        back, along = back.ravel(), np.zeros(basis.N, dtype=int)
        for dofs in (basis.nodal_dofs, basis.edge_dofs):
            for d in range(len(dofs)):
                along[dofs[d]] = d
        blocks.append(linear_elasticity(*lame_parameters(YOUNG, 0.3)).assemble(basis))
        corners = back[basis.nodal_dofs[0][mesh.t]]
        if len(corners) == 8:
            corners = corners[[0, 3, 6, 2, 1, 5, 7, 4]]
        middles = [
            [np.abs(places - 0.5 * (places[i] + places[j])).sum(axis=1).argmin() for i, j in zip(*ends)]
            for ends in (corners[[int(a), int(b)]] for a, b in SOLIDS[len(corners)])
        ]
        cells = first + np.vstack([corners, middles]).T
        elements[kind] = np.vstack([*([elements[kind]] if kind in elements else []), cells])
        nodes |= dict(enumerate(places, first))
        unknowns.append(np.stack([first + back, along], axis=1))
        face = mesh.facets_satisfying(lambda x: np.abs(x[0] - 0.03) < 1e-9)
        face = skfem.FacetBasis(mesh, skfem.ElementVector(element()), facets=face)
        areas.append(skfem.LinearForm(lambda v, _: v[0] + v[1] + v[2]).assemble(face))
    stiffness = scipy.sparse.block_diag(blocks).tocsr()
    return np.concatenate(unknowns), nodes, elements, stiffness, np.concatenate(areas)


def joined(parts, u, traction, held, law=None):
    """A body that is held at u in some unknowns; forces on its other ones that leave so much traction of the
    right face on the left one, or all that acts there; contact.
    """
    unknowns, nodes, elements, stiffness, areas = parts
    forces = stiffness @ u
    if traction is None:
        forces[np.abs([nodes[n][0] - 0.03 for n in unknowns[:, 0]]) < 1e-9] = 0.0
    else:
        forces -= np.where(unknowns[:, 0] < 1000, 1.0, -1.0) * areas * traction
    forces -= stiffness @ np.where(held, u, 0.0)  # known as they are
    free = stiffness[~held][:, ~held]
    given = {"fixed": unknowns[held], "elements": elements}
    body = sb.FiniteElementModel(
        7.85e-5 * scipy.sparse.identity(free.shape[0]), free, unknowns[~held], nodes, **given
    )
    faces = ([n for n, x in nodes.items() if abs(x[0] - 0.03) < 1e-9 and (n > 1000) == k] for k in (0, 1))
    return body, forces[~held], body.contact(*faces, normal="x", matching=False, law=law)


KINDS = [
    (("tetra10", 2, 3, 2), ("hexahedron20", 2, 2, 4)),
    (("hexahedron20", 1, 2, 2), ("tetra10", 1, 3, 3)),
    (("hexahedron20", 2, 3, 2), ("hexahedron20", 1, 1, 1)),
]


@pytest.mark.parametrize("kinds", KINDS)
def test_pressure_passes_through_faces_of_any_elements(kinds):
    """Patch test: a block under a pressure that is uniform or linear in y, of elements of second order, which
    have the displacements of pure bending, faces finer than the other in one direction or in both.
    Displacements are those, and forces between the faces go as the pressure at each node (each node by
    itself: 2e-2 off, some forces pull).
    """
    parts, found = halves(*kinds), []
    unknowns, nodes = parts[:2]
    x, y, z = (np.array([nodes[n] for n in unknowns[:, 0]]) - [0.03, 0.005, 0.005]).T
    held = (np.abs(x) > 0.0299) & ((unknowns[:, 1] > 0) | (x > 0.0))
    for bent in (0.0, 0.8):  # of the pressure, at y = 10 mm
        strain, rate = -1e8 / YOUNG, -bent * 1e8 / YOUNG / 0.005
        across = [
            -0.3 * (strain * y + rate * (y**2 - z**2) / 2.0) - rate * x**2 / 2.0,
            -0.3 * (strain + rate * y) * z,
        ]
        u = np.choose(unknowns[:, 1], [(strain + rate * y) * x, *across])
        body, push, crack = joined(parts, u, None, held)
        tied = scipy.sparse.bmat([[body.stiffness, crack.rows.T], [crack.rows, None]]).tocsc()
        answer = scipy.sparse.linalg.spsolve(tied, np.append(push, np.zeros(len(crack.gap))))
        assert answer[: len(push)] == pytest.approx(u[~held], rel=1e-8, abs=1e-8 * np.abs(u).max())
        found.append(-answer[len(push) :])
        assert (found[-1] > 0.0).all() and not crack.gap.any()
        assert found[-1].sum() == pytest.approx(1e8 * AREA, rel=1e-9)
    at = np.array([x[1] for n, x in nodes.items() if n < 1000 and abs(x[0] - 0.03) < 1e-9])
    assert found[1] / found[0] == pytest.approx(1.0 + 0.8 * (at / 0.005 - 1.0), rel=1e-6)


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("slip", [2e-5, 0.0, -2e-5])
def test_friction_passes_through_faces_of_any_elements(kinds, slip):
    """Patch test of rubbing faces: uniform pressure and shear in plane strain, the left half slid along y by
    so much, or stuck at half of the coefficient's shear. Displacements, slips and resultants are exact.
    """
    parts, pressure = halves(*kinds), 1e8
    shear = 0.3 * pressure * (np.sign(slip) or 0.5)
    unknowns, nodes = parts[:2]
    x, y, _ = (np.array([nodes[n] for n in unknowns[:, 0]]) - [0.03, 0.005, 0.005]).T
    left, along = unknowns[:, 0] < 1000, unknowns[:, 1]
    lateral = pressure * 0.3 * 1.3 / YOUNG * y - shear * 2.6 / YOUNG * x + np.where(left, slip, 0.0)
    u = np.choose(along, [-pressure * (1.0 - 0.3**2) / YOUNG * x, lateral, 0.0 * x])
    held = (np.abs(x) > 0.0299) | (along == 2)
    traction = np.choose(along, [-pressure, -shear, 0.0])
    body, push, crack = joined(parts, u, traction, held, sb.Coulomb(0.3))
    rom = sb.reduce(
        body,
        contact=crack,
        loads={"F": Row(scipy.sparse.csr_matrix(push))},
        points={"face": body.at(int(unknowns[~held][0, 0]), "y")},
        modes=10,
    )
    found = sb.static(rom, 1.0)
    values = found.field[np.searchsorted(body.labels, unknowns[~held][:, 0]), along[~held]]
    assert values == pytest.approx(u[~held], rel=1e-8, abs=1e-8 * np.abs(u).max())
    assert found.contact_resultant == pytest.approx(pressure * AREA, rel=1e-9)
    assert np.abs(found.slip) == pytest.approx(np.full(len(crack.gap), abs(slip)), abs=1e-12)
    assert abs(found.friction_force.sum()) == pytest.approx(abs(shear) * AREA, rel=1e-9)


def test_gaps_of_planes_that_lean(body):
    """The distance of a coarse plane is its mean about each node; a face that reaches beyond the other, or is
    a line: errors.
    """
    moved = {
        int(n): x + (1e-4 + 0.02 * x[1]) * (n > 1000) * np.eye(3)[0] for n, x in zip(body.labels, body.places)
    }
    held = sorted(body.fixed)
    given = {"sets": body.sets, "fixed": held}
    given["elements"] = {kind: body.labels[rows] for kind, rows in body.elements.items()}
    lean = sb.FiniteElementModel(body.mass, body.stiffness, body.unknowns, moved, **given)
    y = np.array([moved[label][1] for label in body.sets["LEFT"]])
    gap = lean.contact("LEFT", "RIGHT", normal="x", matching=False).gap
    shift = (gap - 1e-4) / 0.02 - y  # of nodes at the rims up to half the width of a cell inwards
    assert (
        np.abs(shift).max() < 0.00125 and (shift[y == 0.0] > 5e-4).all() and (shift[y == 0.01] < -5e-4).all()
    )
    crack = body.contact("LEFT", "RIGHT", normal="x", gap=lambda x, y, z: 1e-4 + 0.02 * y, matching=False)
    assert crack.gap == pytest.approx(gap, rel=1e-9)
    with pytest.raises(ValueError, match="have no partner .* say matching=False"):
        body.contact("LEFT", "RIGHT", normal="x")
    with pytest.raises(ValueError, match="right nodes lie behind each other; give those of one face"):
        body.contact("LEFT", [n for n in moved if n > 1000], normal="x", matching=False)
    inner = [n for n in body.sets["RIGHT"] if moved[n][1] < 0.006]
    with pytest.warns(sb.MeshWarning, match="8 of 20 left nodes, node .* lie beside the right face"):
        assert len(body.contact("LEFT", inner, normal="x", matching=False).gap) == 12
    cell = [n for n in body.sets["LEFT"] if moved[n][1] < 0.003 and moved[n][2] < 0.004]
    lone = [n for n in body.sets["LEFT"] if moved[n][1] > 0.009 and moved[n][2] > 0.009]
    with pytest.warns(sb.MeshWarning, match="1 of 5 left nodes, node .* lie on no outer face of their set"):
        with_lone = body.contact(cell + lone, "RIGHT", normal="x", matching=False).rows
    for node, d in ((lone[0], 0), (cell[0], 0)):
        assert with_lone[:, np.flatnonzero((body.unknowns == [node, d]).all(axis=1))].count_nonzero()
    assert len(cell) == 4 and len(lone) == 1 and with_lone.shape[0] == 5
    far = [n for n in moved if n > 1000 and moved[n][0] > 0.07]
    outer = [n for n in body.sets["LEFT"] if moved[n][1] > 0.006]
    lower = [n for n in far if moved[n][1] < 0.006]
    with pytest.raises(
        ValueError, match="8 of 8 left nodes, node .* lie beside the right face and make no pairs; do these"
    ):
        body.contact(outer, lower, normal="x", matching=False)
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
    with pytest.warns(sb.MeshWarning, match="1 of 2 left nodes, node 12 say, lie beside the right face"):
        assert len(body.contact([11, 12], right, normal="x", matching=False).gap) == 1
    crack = body.contact([11], right, normal="x", matching=False)
    y = np.array([nodes[label][1] + 2.0 * nodes[label][2] for label in nodes])
    assert abs((crack.rows @ y)[0]) < 1e-15
    hull = sb.FiniteElementModel(**given).contact([11, 12], right, normal="x", matching=False)
    assert hull.rows.shape[0] == 2


def test_faces_of_cells_of_very_different_sizes():
    """A mesh refined towards a corner, cells of 1 / 2600 of the largest one's area there: its gaps are those
    to the same mesh before it, of all nodes.
    """
    line = np.append(0.0, np.geomspace(1e-4, 1e-2, 8))
    grid = {1 + j + 9 * k: (0.0, y, z) for j, y in enumerate(line) for k, z in enumerate(line)}
    nodes = grid | {100 + n: (1e-3, *place[1:]) for n, place in grid.items()}
    cells = [[n, n + 1, n + 10, n + 9] for n in grid if n % 9 and n < 73]
    body = sb.FiniteElementModel(
        1e-3 * scipy.sparse.eye(162),
        1e9 * scipy.sparse.eye(162),
        [(label, 0) for label in nodes],
        nodes,
        elements={"quad": np.concatenate([cells, 100 + np.array(cells)])},
    )
    crack = body.contact(list(grid), [100 + n for n in grid], normal="x", matching=False)
    rows = crack.rows.toarray()
    assert rows.shape == (81, 162) and np.abs(rows[:, :81] + rows[:, 81:]).max() < 1e-12
    assert crack.gap == pytest.approx(np.full(81, 1e-3)) and (np.abs(rows).sum(axis=0) > 0.0).all()


def test_nodes_at_quarters_of_sides():
    """Second-order faces whose nodes beside a crack's front stand at quarters: one that turns about the front
    opens by what it turns there, and where both turn there is none.
    """
    nodes, faces = {}, []
    for first, count in ((1, 3), (101, 2)):
        y, z = np.meshgrid(np.linspace(0.0, 1.0, 2 * count + 1), np.linspace(0.0, 1.0, 5), indexing="ij")
        y[1] = 0.25 * y[2]
        label = first + np.arange(y.size).reshape(y.shape)
        nodes |= {int(n): (0.0, *at) for n, *at in zip(label.ravel(), y.ravel(), z.ravel())}
        corners = np.array([(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)])
        begins = [(2 * k, 2 * n) for k in range(count) for n in range(2)]
        faces += [[int(label[tuple(begin + at)]) for at in corners] for begin in begins]
    used = sorted({n for face in faces for n in face})
    eye = scipy.sparse.identity(len(used))
    given = {"nodes": {n: nodes[n] for n in used}, "elements": {"quad8": faces}}
    body = sb.FiniteElementModel(eye, 1e9 * eye, [(n, 0) for n in used], **given)
    left, right = ([n for n in used if (n > 100) == side] for side in (False, True))
    rows = body.contact(left, right, normal="x", matching=False).rows
    turned = np.array([nodes[n][1] for n in used])
    assert np.abs(rows @ turned).max() < 1e-12
    gap, about = rows @ np.where(np.array(used) > 100, turned, 0.0), np.array([nodes[n][1] for n in left])
    assert gap.min() > 0.0 and np.abs(gap - about).max() < 1.0 / 12.0  # of the middles of hats


def test_places_in_faces_of_curved_sides():
    """Beside scikit-fem's shape functions: the map of these nodes has another root nearby, from which weights
    of 56 had come.
    """
    skfem = pytest.importorskip("skfem")
    nodes = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.8, 0.2], [1.1, 0.4], [0.4, 1.0], [-0.1, 0.3]])
    at = np.array([[0.1, 0.1, 0.9, 0.9, 0.5], [0.1, 0.9, 0.1, 0.9, 0.05]])
    shapes = np.array([skfem.ElementQuadS2().lbasis(at, k)[0] for k in range(8)]).T
    np.testing.assert_allclose(_shapes(nodes, shapes @ nodes), shapes, atol=1e-10)


def test_round_faces_of_different_meshes():
    """Rims of polygons of 16 and of 12 sides on one circle lie beside each other: faces that move and turn
    together stay so, and one that moves away opens all pairs by that.
    """
    nodes, faces = {}, []
    for first, count in ((1, 16), (101, 12)):
        way = 2.0 * np.pi / count * np.arange(count)
        rim = np.column_stack([np.cos(way), np.sin(way)])
        nodes |= {first + k: (0.0, *at) for k, at in enumerate([(0.0, 0.0), *rim])}
        faces += [[first, first + k, first + 1 + k % count] for k in range(1, count + 1)]
    eye, labels = scipy.sparse.identity(len(nodes)), list(nodes)
    given = {"nodes": nodes, "elements": {"triangle": faces}}
    body = sb.FiniteElementModel(eye, 1e9 * eye, [(n, 0) for n in labels], **given)
    left, right = ([n for n in labels if (n > 100) == side] for side in (False, True))
    rows = body.contact(left, right, normal="x", matching=False).rows.toarray()
    assert rows.shape[0] == 17 and rows[:, 17:].sum(axis=1) == pytest.approx(np.ones(17), rel=1e-12)
    for moved in (np.ones(30), *(np.array([nodes[n][d] for n in labels]) for d in (1, 2))):
        assert np.abs(rows @ moved).max() < 1e-12


def test_faces_of_collapsed_elements():
    """Quadrilaterals that have a node twice, as those of collapsed hexahedra, are triangles (shares of right
    nodes had been .74 to .92, for 1, or a raw error of NumPy's where nodes meet); three nodes may be in one
    place, as about a crack's front, with a left one before them (the same error).
    """
    left = {1: (0.0, 0.0, 0.0), 2: (0.0, 0.9, 0.1), 3: (0.0, 1.0, 1.0), 4: (0.0, 0.1, 0.9)}
    square = {11: (1e-3, 0.0, 0.0), 12: (1e-3, 1.0, 0.0), 13: (1e-3, 1.0, 1.0), 14: (1e-3, 0.0, 1.0)}
    # behind each corner another one: two wedges, written as hexahedra
    below = {20 + k: (1.0, *place[1:]) for k, place in enumerate(square.values())}
    solids = [[11, 12, 13, 13, 20, 21, 22, 22], [13, 14, 11, 11, 22, 23, 20, 20]]
    front = {**square, 15: square[11], 16: square[11]} | {17: (1e-3, 0.25, 0.0), 18: (1e-3, 0.5, 0.5)}
    front |= {19: (1e-3, 0.0, 0.25), 20: (1e-3, 1.0, 0.5), 21: (1e-3, 0.5, 1.0)}
    halves = [[11, 12, 13], [13, 14, 11]]
    found = []
    for right, elements in (
        (square, {"triangle": halves}),
        (square, {"quad": [[11, 12, 13, 13], [13, 14, 11, 11]]}),
        (square, {"quad": [[11, 11, 12, 13], [13, 14, 14, 11]]}),
        (square, {"quad8": [[11, 12, 13, 13, 17, 20, 13, 18], [13, 14, 11, 11, 21, 19, 11, 18]]}),
        (square | below, {"hexahedron": solids}),
        (front, {"quad8": [[11, 16, 12, 14, 15, 17, 18, 19]], "triangle6": [[12, 13, 14, 20, 21, 18]]}),
    ):
        more = {k: front[k] for k in (17, 18, 19, 20, 21)} if "quad8" in elements else {}
        nodes = left | more | right
        eye, labels = scipy.sparse.identity(len(nodes)), list(nodes)
        mesh = {"triangle": [[1, 2, 3], [1, 3, 4], *elements.pop("triangle", [])]} | elements
        body = sb.FiniteElementModel(eye, 1e9 * eye, [(n, 0) for n in labels], nodes, elements=mesh)
        face = [n for n in nodes if n > 10 and nodes[n][0] == 1e-3]
        crack = body.contact(list(left), face, normal="x", matching=False)
        rows = crack.rows.toarray()
        assert crack.gap == pytest.approx(np.full(4, 1e-3), rel=1e-12)
        assert rows[:, 4:].sum(axis=1) == pytest.approx(np.ones(4), rel=1e-12)
        assert np.abs(rows @ np.array([nodes[n] for n in labels])[:, 1:]).max() < 1e-12
        found.append(rows[:, [labels.index(n) for n in square]])
    for same in (found[1], found[2], found[4]):
        assert same == pytest.approx(found[0], abs=1e-14)


def triangles_of(across: int, up: int) -> tuple[np.ndarray, list[list[int]]]:
    """Places in a square, those of one column after those of another, and triangles between them."""
    places = [[i / across, j / up, 0.0] for i in range(across + 1) for j in range(up + 1)]
    cells = [i * (up + 1) + j for i in range(across) for j in range(up)]
    halves = [([a, a + up + 1, a + 1], [a + up + 1, a + up + 2, a + 1]) for a in cells]
    return np.array(places), [list(half) for pair in halves for half in pair]


@pytest.mark.parametrize("fine_to_coarse", [True, False])
def test_nested_faces_have_the_same_means(fine_to_coarse):
    """However they lie in space, seen along a normal that may lean: displacements that are linear in the
    triangles of a coarse face, or of a part of it, are so in halves of them, and both have the same means
    (without a grid GEOS took common sides for whole triangles in the first five).
    """
    for seed in (2, 17, 29, 41, 53, 60):
        rng = np.random.default_rng(seed)
        across, up = rng.integers(1, 5, 2)
        (coarse, large), (fine, small) = triangles_of(across, up), triangles_of(2 * across, 2 * up)
        spread = np.zeros((len(fine), len(coarse)))
        for k, (i, j) in enumerate((i, j) for i in range(2 * across + 1) for j in range(2 * up + 1)):
            # on a corner, or halfway between two of them, which are those of the diagonal within a square
            for one, two in ((i // 2, (j + 1) // 2), ((i + 1) // 2, j // 2)):
                spread[k, one * (up + 1) + two] += 0.5
        turn, size = np.linalg.qr(rng.normal(size=(3, 3)))[0], [*rng.uniform(0.5, 2.0, 2), 1.0]
        normal = turn[:, 2] + rng.integers(0, 2) * 0.1 * turn[:, 0]
        kept = rng.integers(1, across + 1)  # columns of squares that the right face has
        left, right = (fine, small), (coarse, large[: 2 * up * kept])
        if not fine_to_coarse:
            left, right = (coarse, large), (fine, small[: 8 * up * kept])
        nodes = np.arange(len(left[0])), left[0] * size @ turn.T, right[0] * size @ turn.T
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", sb.MeshWarning)  # of the nodes beside a part
            means = between(
                nodes,
                normal / np.linalg.norm(normal),
                (left[1], right[1]),
                lambda s: np.ones(s.shape[0], bool),
            )
        own, other = -means[:, : len(left[0])], means[:, len(left[0]) :]
        apart = own @ spread - other if fine_to_coarse else own - other @ spread
        assert own.nnz and np.abs(apart).max() < 1e-8, seed
