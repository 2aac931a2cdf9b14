"""Sparse matrices of other codes against dense computations of the tests' own, and what is refused."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

import sbfem_petsc as sb
from meshing.warnings import BandWarning, SolverWarning
from sbfem_petsc.petsc import MPI, PETSc
from sbfem_petsc.reduction import sparse


@pytest.fixture(scope="module")
def beam():
    """Mass, stiffness of a square steel beam of scikit-fem, held at one end, whose bending modes are double;
    rows of x, y, z at the other end's nodes.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = skfem.MeshHex.init_tensor(np.linspace(0, 0.2, 9), np.linspace(0, 0.02, 3), np.linspace(0, 0.02, 3))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
    stiffness = linear_elasticity(*lame_parameters(210e9, 0.3)).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: 7850.0 * dot(u, v)).assemble(basis)
    free = np.setdiff1d(np.arange(basis.N), basis.get_dofs(lambda x: x[0] < 1e-9).all())
    place = {int(unknown): k for k, unknown in enumerate(free)}
    end = np.flatnonzero(mesh.p[0] > 0.2 - 1e-9)
    ends = [[place[int(basis.nodal_dofs[d, node])] for node in end] for d in range(3)]
    return mass.tocsr()[free][:, free], stiffness.tocsr()[free][:, free], ends


def rows_of(places, count):
    rows = scipy.sparse.lil_matrix((len(places), count))
    rows[np.arange(len(places)), places] = 1.0
    return rows.tocsr()


def test_sparse_beside_dense(beam):
    """Frequencies, double ones among them, static compliances of stops, loads and sensors, and a history
    with contact are those of dense matrices; residual flexibility is that of K^-1.
    """
    mass, stiffness, (_, y, z) = beam
    n = mass.shape[0]
    contact, loads = -rows_of(z[:4], n), rows_of([z[8], y[8]], n).T
    oblique = np.zeros(n)
    oblique[[y[8], z[8]]] = 0.6, 0.8
    sensors = {"z": z[8], "oblique": oblique, "mean": rows_of(z, n).mean(axis=0)}
    sensors["mean"] = scipy.sparse.csr_matrix(sensors["mean"])
    given = {"loads": loads, "sensors": sensors, "modes": 20, "damping": 0.02}
    found = sb.reduce_matrices(mass, stiffness, contact, np.zeros(4), **given)

    k, m, b = stiffness.toarray(), mass.toarray(), contact.toarray()
    own = np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)[:20]) / (2 * np.pi)
    assert own[1] / own[0] - 1 < 1e-6  # a double frequency
    assert found.frequencies == pytest.approx(own, rel=1e-9)
    seen = np.array([np.eye(n)[z[8]], oblique, np.eye(n)[z].mean(axis=0)])
    for right, part, modal in (
        (b.T, found.gap.contact, found.gap.modes.T),
        (loads.toarray(), found.gap.loads, found.load_modes),
    ):
        exact = np.linalg.solve(k, right)
        whole = part + found.gap.modes @ (modal / found.omega[:, None] ** 2)
        assert whole == pytest.approx(b @ exact, rel=1e-8, abs=1e-10 * np.abs(b @ exact).max())
        share = found.points.contact if modal.shape[1] == 4 else found.points.loads
        whole = share[:, 1] + found.points.modes[:, 1] @ (modal / found.omega[:, None] ** 2)
        assert whole == pytest.approx(seen @ exact, rel=1e-8, abs=1e-10 * np.abs(seen @ exact).max())

    dense = sb.reduce_matrices(m, k, b, np.zeros(4), **{**given, "loads": loads.toarray()})
    load = [sb.Harmonic(20.0, 0.4 * own[0]), 0.0]
    one, other = (sb.transient(r, load, 2.0 / own[0], step=0.01 / own[0]) for r in (found, dense))
    assert one.contact_force.max() > 1.0
    for name in sensors:
        first, second = (h.displacement(name)[:, 1] for h in (one, other))
        assert np.abs(first - second).max() < 1e-6 * np.abs(second).max()


def test_zeros_that_a_mass_has_stored():
    """As sums of entries leave them: an unknown without mass as one that is not stored."""
    n, e = np.arange(6), np.eye(6)
    stiffness = scipy.sparse.diags([[-1e6] * 5, [2e6] * 6, [-1e6] * 5], [-1, 0, 1]).tocsr()
    mass = scipy.sparse.coo_matrix(([1.0, 1.0, 1.0, 0.0, 1.0, 1.0], (n, n)), shape=(6, 6)).tocsr()
    given = {"loads": e[:, :1], "sensors": {"a": 0}, "modes": 2}
    found = sb.reduce_matrices(mass, stiffness, e[:1], np.ones(1), **given)
    kept = np.flatnonzero(mass.diagonal())
    k = stiffness.toarray()
    schur = np.linalg.inv(np.linalg.inv(k)[np.ix_(kept, kept)])
    omega = np.sqrt(np.linalg.eigvalsh(schur)[:2])
    np.testing.assert_allclose(found.omega, omega, rtol=1e-9)


def test_unknowns_without_mass(beam):
    """Lumped rotations have none: the frequencies are those of the condensed matrices."""
    mass, stiffness, (_, _, z) = beam
    n = mass.shape[0]
    weights = np.asarray(mass.sum(axis=1)).ravel()
    weights[z] = 0.0
    kept = np.flatnonzero(weights)
    k = stiffness.toarray()
    condensed = k[np.ix_(kept, kept)] - k[np.ix_(kept, z)] @ np.linalg.solve(
        k[np.ix_(z, z)], k[np.ix_(z, kept)]
    )
    own = scipy.linalg.eigh(condensed, np.diag(weights[kept]), eigvals_only=True)[:6]
    found = sb.reduce_matrices(
        scipy.sparse.diags(weights),
        stiffness,
        np.zeros((0, n)),
        np.zeros(0),
        loads=rows_of(z[:1], n).T,
        sensors={},
        modes=6,
    )
    assert found.omega**2 == pytest.approx(own, rel=1e-8)


def test_modes_beside_unknowns_without_mass_are_orthonormal(beam):
    """Products by the mass are sums over all unknowns, whose rounding is so many times a double's at most."""
    mass, stiffness, (_, _, z) = beam
    weights = np.asarray(mass.sum(axis=1)).ravel()
    weights[::2] = 0.0
    n = len(weights)
    vectors = sparse.sparse_modes(scipy.sparse.diags(weights).tocsr(), stiffness, rows_of(z[:1], n).T, 40)[1]
    assert np.abs(vectors.T @ (weights[:, None] * vectors) - np.eye(40)).max() < n * np.finfo(float).eps


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"stiffness": scipy.sparse.diags([1.0, -0.5, 2.0])}, "stiffness is indefinite"),
        ({"stiffness": scipy.sparse.diags([1.0, 2.0])}, "stiffness has shape"),
        ({"stiffness": scipy.sparse.csr_matrix(np.triu(np.ones((3, 3))))}, "stiffness is not symmetric"),
        ({"mass": scipy.sparse.diags([1.0, np.nan, 1.0])}, "mass.data"),
        ({"modes": 3}, "modes = 3"),
        ({"sensors": {"A": np.ones(2)}}, "sensors\\['A'\\] has 2 entries"),
        ({"sensors": {"A": [1.0, 2.0]}}, "sensors\\['A'\\] has 2 entries"),
        (
            {"stiffness": scipy.sparse.csr_matrix([[1.0, -1, 0], [-1, 1, 0], [0, 0, 0]])},
            "motions that take no energy beside the lowest 1 modes",
        ),
    ],
)
def test_refused(changes, sentence):
    given = {
        "mass": scipy.sparse.identity(3),
        "stiffness": scipy.sparse.diags([1.0, 2.0, 3.0]),
        "contact_rows": np.array([[1.0, 1.0, 1.0]]),
        "gap": np.ones(1),
        "loads": np.ones((3, 1)),
        "sensors": {"A": 0},
        "modes": 1,
    }
    with pytest.raises(ValueError, match=sentence):
        sb.reduce_matrices(**{**given, **changes})


def slender(count):
    """A clamped steel beam of 1 m x 5 mm in Euler-Bernoulli elements, and its first frequency, Hz."""
    young, density, height, h = 210e9, 7850.0, 5e-3, 1.0 / count
    bend, line = young * height**3 / 12.0, density * height
    length = np.diag([1.0, h, 1.0, h])
    k = np.array([[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
    m = np.array([[156, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]])
    k, m = bend / h**3 * length @ k @ length, line * h / 420.0 * length @ m @ length
    mass, stiffness = (np.zeros((2 * count + 2, 2 * count + 2)) for _ in range(2))
    for element in range(count):
        part = slice(2 * element, 2 * element + 4)
        mass[part, part] += m
        stiffness[part, part] += k
    return mass[2:, 2:], stiffness[2:, 2:], 1.875104**2 / (2.0 * np.pi) * np.sqrt(bend / line)


@pytest.mark.parametrize("modes", [2, 30])
def test_a_frequency_of_many_equal_parts(modes):
    """Fourteen beams that nothing connects have each frequency as often, more than right-hand sides are
    taken together: frequencies of one beam by SciPy, flexibility of K^-1 left of all modes that are kept.
    """
    mass, stiffness, _ = slender(20)
    k, m = (scipy.sparse.block_diag([part] * 14).tocsr() for part in (stiffness, mass))
    n = k.shape[0]
    push = np.zeros((n, 2))
    push[38, 0] = push[-2, 1] = 1.0  # the tips of the first and last beam
    given = {"loads": push, "sensors": {"tip": 38}, "modes": modes}
    found = sb.reduce_matrices(m, k, np.zeros((0, n)), np.zeros(0), **given)
    one = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    assert found.omega**2 == pytest.approx(np.repeat(one, 14)[:modes], rel=1e-8)
    whole = found.load_flexibility + found.load_modes.T @ (found.load_modes / found.omega[:, None] ** 2)
    assert whole == pytest.approx(push.T @ np.linalg.solve(k.toarray(), push), rel=1e-8, abs=1e-18)


def soft_chain(count):
    """Masses of 1 on springs of 1, the first on one of 1e-10."""
    diagonal = np.append(2.0 * np.ones(count - 1), 1.0)
    diagonal[0] = 1.0 + 1e-10
    aside = -np.ones(count - 1)
    return scipy.sparse.diags([aside, diagonal, aside], [-1, 0, 1]).tocsr()


def soft_grid(seed):
    """Masses on a grid of springs of .25 to 4, one of them on a spring of 1e-12 to 1e-9."""
    rng = np.random.default_rng(seed)
    soft, (rows, columns) = 10.0 ** rng.uniform(-12.0, -9.0), rng.integers(4, 12, 2)
    number = np.arange(rows * columns).reshape(rows, columns)
    ends = [number[:, :-1].ravel(), number[:-1].ravel()], [number[:, 1:].ravel(), number[1:].ravel()]
    one, other = map(np.concatenate, ends)
    springs = 2.0 ** rng.integers(-2, 3, len(one))  # whose sums have no rounding
    ways = scipy.sparse.csr_matrix((np.ones(len(one)), (one, other)), (number.size, number.size))
    ways.data[:] = scipy.sparse.csr_matrix((springs, (one, other)), ways.shape).data
    whole = ways + ways.T
    degree = np.asarray(whole.sum(axis=1)).ravel()
    degree[0] += soft
    return (scipy.sparse.diags(degree) - whole).tocsr()


@pytest.mark.parametrize("stiffness, modes", [(soft_chain(26), 12), (soft_chain(35), 12)])
@pytest.mark.filterwarnings("error")
def test_a_soft_spring_is_no_rigid_motion(stiffness, modes):
    """Of 1e-10 of the others': its motion, which takes digits of all else, is held in place as a rigid one
    is; modes beside it had 6 digits by SciPy's, and the flexibility 3.
    """
    count = stiffness.shape[0]
    push = np.eye(count)[:, -1:]
    values, vectors = scipy.linalg.eigh(stiffness.toarray())
    exact = (vectors[:, modes:] / values[modes:]) @ (vectors[:, modes:].T @ push)
    given = scipy.sparse.identity(count).tocsr(), stiffness, scipy.sparse.csr_matrix(push), modes
    found, _, flexibility = sparse.sparse_modes(*given)
    assert found[1:] == pytest.approx(values[1:modes], rel=1e-11)
    assert found[0] == pytest.approx(1e-10 / count, rel=1e-4)  # the rounding of 1 + 1e-10
    assert flexibility == pytest.approx(exact, abs=1e-7 * np.abs(exact).max())


def test_softer_and_softer_springs():
    """Where no soft motions stand apart from the others, by a factor of 1e6, what these lose is told."""
    springs = 2.0 ** np.random.default_rng(10).integers(-2, 3, 30)
    springs[:20:10] = 1e-10, 1e-5
    stiffness = scipy.sparse.diags(
        [-springs[1:], springs + np.append(springs[1:], 0.0), -springs[1:]], [-1, 0, 1]
    )
    push = np.eye(30)[:, -1:]
    values, vectors = scipy.linalg.eigh(stiffness.toarray())
    exact = (vectors[:, 7:] / values[7:]) @ (vectors[:, 7:].T @ push)
    given = scipy.sparse.identity(30).tocsr(), stiffness.tocsr(), scipy.sparse.csr_matrix(push), 7
    told = "softest of the lowest 7 modes takes digits of the others.* misses its equations by [0-9.e-]+;"
    with pytest.warns(SolverWarning, match=told) as caught:
        _, _, flexibility = sparse.sparse_modes(*given)
    with pytest.warns(SolverWarning, match=told) as again:  # loads in another unit miss as much of themselves
        sparse.sparse_modes(*given[:2], 1024.0 * given[2], 7)
    assert [str(item.message) for item in again] == [str(item.message) for item in caught]
    error = np.abs(flexibility - exact).max() / np.abs(exact).max()
    assert 1e-9 < error < 1e-4


def test_soft_springs_of_grids():
    """Some digits were lost in a fifth of them, and one of 300 was refused for modes that were left out."""
    for seed in range(30):
        stiffness = soft_grid(seed)
        count = stiffness.shape[0]
        values, vectors = scipy.linalg.eigh(stiffness.toarray())
        exact = (vectors[:, 6:] / values[6:]) @ vectors[-1:, 6:].T
        push = scipy.sparse.csr_matrix(np.eye(count)[:, -1:])
        found, _, flexibility = sparse.sparse_modes(scipy.sparse.identity(count).tocsr(), stiffness, push, 6)
        assert found[1:] == pytest.approx(values[1:6], rel=1e-11)
        assert flexibility == pytest.approx(exact, abs=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize(
    "form, count", [(np.asarray, 300), (scipy.sparse.csr_matrix, 300), (scipy.sparse.csr_matrix, 700)]
)
def test_a_slender_beam_that_is_held_has_no_rigid_motion(form, count):
    """Its first frequency, though eigenvalues are up to 1e15 apart: it was zero, or refused."""
    mass, stiffness, first = slender(count)
    push = np.zeros((2 * count, 1))
    push[-2] = 1.0
    row = np.ascontiguousarray(push.T)
    loads = {"loads": push, "sensors": {"tip": 0}, "modes": 5}
    made = sb.reduce_matrices(form(mass), form(stiffness), row, np.ones(1), **loads)
    assert made.frequencies[0] == pytest.approx(first, rel=2e-5)


@pytest.mark.parametrize("change", [(3, 3, -0.5), (3, 4, 1.4), (20, 20, -20.0)])
def test_a_mass_that_is_indefinite_is_refused(change):
    mass, stiffness = np.eye(40), 1e6 * (2.0 * np.eye(40) - np.eye(40, k=1) - np.eye(40, k=-1))
    i, j, value = change
    mass[i, j] = mass[j, i] = value
    row = np.eye(40)[:1]
    given = scipy.sparse.csr_matrix(mass), scipy.sparse.csr_matrix(stiffness), row, np.ones(1)
    with pytest.raises(ValueError, match="mass is indefinite"):
        sb.reduce_matrices(*given, loads=row.T, sensors={"u": 0}, modes=3)


def test_parts_of_an_indefinite_mass_that_nothing_couples():
    """Along x, y and z, with one negative eigenvalue each (by NumPy), are counted all."""
    part = np.eye(40)
    part[3, 4] = part[4, 3] = 1.4
    mass = np.kron(part, np.eye(3))
    assert (np.linalg.eigvalsh(mass) < 0.0).sum() == 3
    stiffness = 1e6 * (2.0 * np.eye(120) - np.eye(120, k=1) - np.eye(120, k=-1))
    row = np.eye(120)[:1]
    given = scipy.sparse.csr_matrix(mass), scipy.sparse.csr_matrix(stiffness), row, np.ones(1)
    with pytest.raises(ValueError, match=r"mass is indefinite \(3 negative eigenvalues\)"):
        sb.reduce_matrices(*given, loads=row.T, sensors={"u": 0}, modes=3)


def test_a_mass_of_few_points_is_singular_and_no_more():
    """As of CalculiX's C3D20R, where rounding leaves eigenvalues below 0: bars of three nodes, whose mass is
    taken at one point each. Frequencies by SciPy as those of M phi = K phi / w2, statics by NumPy.
    """
    cells, n = 30, 60
    bar = np.array([[7.0, -8.0, 1.0], [-8.0, 16.0, -8.0], [1.0, -8.0, 7.0]]) / 3.0
    at = np.array([0.31, -0.17])[:, None]  # each for half of the cells
    shapes = np.hstack([at * (at - 1.0) / 2.0, 1.0 - at**2, at * (at + 1.0) / 2.0])
    stiffness, mass = np.zeros((2, n + 1, n + 1))
    for cell in range(cells):
        own = np.ix_(*[range(2 * cell, 2 * cell + 3)] * 2)
        stiffness[own] += 1e6 * bar
        mass[own] += np.outer(shapes[cell % 2], shapes[cell % 2])
    stiffness, mass = stiffness[1:, 1:], mass[1:, 1:]
    assert (np.linalg.eigvalsh(mass) < 0.0).any() and np.linalg.matrix_rank(mass) == cells
    row = np.eye(n)[-1:]
    given = scipy.sparse.csr_matrix(mass), scipy.sparse.csr_matrix(stiffness), row, np.ones(1)
    made = sb.reduce_matrices(*given, loads=row.T, sensors={"u": n - 1}, modes=8)
    values = scipy.linalg.eigh(mass, stiffness, eigvals_only=True)[::-1][:8]
    assert made.omega**2 == pytest.approx(1.0 / values, rel=1e-10)
    assert sb.static(made, 3.0, contact=False).displacement("u") == pytest.approx(
        3.0 * np.linalg.solve(stiffness, row[0])[-1], rel=1e-10
    )


@pytest.mark.parametrize("hold", [1e-4, 1e-10])
def test_flexibility_beside_a_mode_that_takes_all_digits(hold):
    """A chain on a weak spring (of 1e-10 of the others': a condition of 1e13), pressed at one end: what all
    but five modes give is that of SciPy's modes, whose high ones know nothing of the spring.
    """
    diagonal = np.append(2.0 * np.ones(299), 1.0)
    diagonal[0] = 1.0 + hold
    stiffness = scipy.sparse.diags([-np.ones(299), diagonal, -np.ones(299)], [-1, 0, 1]).tocsr()
    columns = scipy.sparse.csr_matrix(([1.0, 1.0, -1.0], ([100, 299, 298], [0, 1, 1])), (300, 2))
    values, vectors = (part.T[5:].T for part in scipy.linalg.eigh(stiffness.toarray()))
    exact = (vectors / values) @ (vectors.T @ columns.toarray())
    found = sparse.sparse_modes(scipy.sparse.identity(300).tocsr(), stiffness, columns, 5)[2]
    assert found == pytest.approx(exact, abs=1e-11 * np.abs(exact).max())  # without a second solve 2.7e-6


def test_without_mumps_it_is_said_that_nothing_was_counted(monkeypatch):
    from sbfem_petsc.reduction import sparse as module

    monkeypatch.setattr(module._Columns, "movable", lambda *_: False)
    monkeypatch.setattr(module, "_negative", lambda *_: None)
    mass = scipy.sparse.csr_matrix(np.eye(40))
    stiffness = 1e6 * scipy.sparse.diags([-np.ones(39), 2.0 * np.ones(40), -np.ones(39)], [-1, 0, 1])
    row = np.eye(40)[:1]
    with pytest.warns(SolverWarning, match="no MUMPS"):
        sb.reduce_matrices(mass, stiffness, row, np.ones(1), loads=row.T, sensors={"u": 0}, modes=3)


@pytest.mark.parametrize("form", [np.asarray, scipy.sparse.csr_matrix])
def test_modes_that_a_superelement_has_not(form):
    """Craig-Bampton of a slender beam with eight modes inside: above the highest of these nothing is right,
    below it the lowest frequencies are; without modal coordinates nothing is said.
    """
    mass, stiffness, _ = slender(30)
    edge = np.arange(len(mass) - 2, len(mass))
    inner = np.arange(len(mass) - 2)
    values, shapes = scipy.linalg.eigh(stiffness[np.ix_(inner, inner)], mass[np.ix_(inner, inner)])
    basis = np.zeros((len(mass), 10))
    basis[edge, [0, 1]] = 1.0
    basis[inner, :2] = -np.linalg.solve(stiffness[np.ix_(inner, inner)], stiffness[np.ix_(inner, edge)])
    basis[inner, 2:] = shapes[:, :8]
    m, k = (basis.T @ a @ basis for a in (mass, stiffness))
    k[2:], k[:, 2:] = 0.0, 0.0
    k[range(2, 10), range(2, 10)] = values[:8]
    load = np.eye(10)[:, :1]

    def reduced(modes):
        return sb.reduce_matrices(
            form(m), form(k), np.zeros((0, 10)), [], loads=load, sensors={"tip": 0}, modes=modes
        )

    own = np.sqrt(scipy.linalg.eigh(stiffness, mass, eigvals_only=True))
    right = int((np.sqrt(scipy.linalg.eigh(k, m, eigvals_only=True)) <= np.sqrt(values[7])).sum())
    with pytest.warns(BandWarning, match=rf"{9 - right} of 9 modes lie above .* keep modes = {right}"):
        reduced(9)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert reduced(right).omega[:7] == pytest.approx(own[:7], rel=1e-2)


@pytest.mark.parametrize("count", [60, 90, 110])
def test_most_of_all_modes(count):
    """Of 120 unknowns, where blocks come to more vectors than there are directions: beside SciPy."""
    generator = np.random.default_rng(3)
    half = generator.standard_normal((120, 120)) * (generator.random((120, 120)) < 0.1)
    stiffness = half @ half.T + 0.1 * np.eye(120)
    row = np.eye(120)[:1]
    found = sb.reduce_matrices(
        scipy.sparse.eye(120, format="csr"),
        scipy.sparse.csr_matrix(stiffness),
        scipy.sparse.csr_matrix(row),
        np.zeros(1),
        loads=row.T,
        sensors={"a": 0},
        modes=count,
    )
    expected = scipy.linalg.eigvalsh(stiffness)[:count]
    np.testing.assert_allclose(np.sort(found.omega) ** 2, expected, rtol=1e-11)


@pytest.mark.parametrize("count", [6, 8, 20])
def test_a_load_that_left_out_modes_have_no_part_in(count):
    """The highest mode of a chain of an even number is one side against the other, which equal forces at both
    ends do not move: all modes but that one are kept, statics are those of the whole chain.
    """
    ones = np.ones(count - 1)
    stiffness = 1e6 * scipy.sparse.diags([2.0 * np.ones(count), -ones, -ones], [0, 1, -1]).tocsr()
    load = np.zeros((count, 1))
    load[[0, -1]] = 1.0
    none = {"contact_rows": np.zeros((0, count)), "gap": []}
    rom = sb.reduce_matrices(
        scipy.sparse.identity(count), stiffness, **none, loads=load, sensors={"a": 1}, modes=count - 1
    )
    right = np.linalg.solve(stiffness.toarray(), load)[1, 0]
    assert sb.static(rom, 1.0).displacement("a") == pytest.approx(right, rel=1e-12)


def test_rigid_motions_take_no_digits():
    """Four chains that nothing holds beside w^2 = 2 k / m (1 - cos(pi j / n)); fewer modes than chains are
    refused, the four motions of all of them are modes.
    """
    n, k = 60, 1e6 * (1.0 + 0.1 * np.arange(4))
    springs = np.diff(np.eye(n), axis=0)
    one = scipy.sparse.csr_matrix(springs.T @ springs)
    stiffness = scipy.sparse.block_diag([factor * one for factor in k]).tocsr()
    mass = 0.01 * scipy.sparse.eye(4 * n, format="csr")
    push = np.eye(4 * n)[:, :1]

    def squares(modes):
        given = {"loads": push, "sensors": {"a": 0}, "modes": modes}
        found = sb.reduce_matrices(mass, stiffness, np.zeros((0, 4 * n)), np.zeros(0), **given)
        return found.omega**2

    exact = np.sort(np.outer(k, 200.0 * (1.0 - np.cos(np.arange(n) * np.pi / n))).ravel())
    assert not squares(4).any()
    assert squares(40) == pytest.approx(exact[:40], rel=1e-12, abs=0.0)
    for modes in (1, 3):
        with pytest.raises(ValueError, match=f"beside the lowest {modes} modes; keep more"):
            squares(modes)


@pytest.mark.parametrize("count", range(10, 30))
def test_free_beam_of_lumped_masses(count):
    """Bending of so many bars, no inertia of rotations, beside SciPy's condensed matrices: rounding leaves
    pivots of the two rigid-body motions above 0 in some of them, which were refused.
    """
    bar = np.array([[12.0, 6.0, -12.0, 6.0], [6.0, 4.0, -6.0, 2.0]])
    bar = np.vstack([bar, -bar[0], [6.0, 2.0, -6.0, 4.0]])
    stiffness = np.zeros((2 * count + 2, 2 * count + 2))
    for k in range(count):
        stiffness[2 * k : 2 * k + 4, 2 * k : 2 * k + 4] += 1e-6 * count**3 * bar
    mass = np.tile([1e-3, 0.0], count + 1)
    moved, turned = np.s_[::2, ::2], np.s_[1::2, 1::2]
    coupled = stiffness[::2, 1::2]
    condensed = stiffness[moved] - coupled @ np.linalg.solve(stiffness[turned], coupled.T)
    exact = scipy.linalg.eigvalsh(condensed)[:5] / 1e-3
    given = scipy.sparse.diags(mass).tocsr(), scipy.sparse.csr_matrix(stiffness)
    values = sparse.sparse_modes(*given, scipy.sparse.csr_matrix((2 * count + 2, 1)), 5)[0]
    assert not values[:2].any() and values[2:] == pytest.approx(exact[2:], rel=1e-8)


@pytest.mark.parametrize("kind", ["arnoldi", "krylovschur"])
def test_eigensolver_by_options(beam, kind):
    """SLEPc's solver that options name beside SciPy; one that there is not is refused by its prefix."""
    mass, stiffness, *_ = beam
    n = mass.shape[0]
    push, options = np.eye(n)[:, -1:], PETSc.Options()
    given = {"loads": push, "sensors": {"a": 0}, "modes": 6}
    try:
        options.setValue("modal_eps_type", kind)
        found = sb.reduce_matrices(mass, stiffness, np.zeros((0, n)), np.zeros(0), **given)
        options.setValue("modal_eps_type", "nonsense")
        with pytest.raises(sb.SolverFailure, match="refuses an option that begins with -modal_"):
            sb.reduce_matrices(mass, stiffness, np.zeros((0, n)), np.zeros(0), **given)
    finally:
        options.delValue("modal_eps_type")
    k, m = (matrix.toarray() for matrix in (stiffness, mass))
    assert found.omega**2 == pytest.approx(scipy.linalg.eigh(k, m, eigvals_only=True)[:6], rel=1e-9)
    whole = found.load_flexibility + found.load_modes.T @ (found.load_modes / found.omega[:, None] ** 2)
    assert whole == pytest.approx(push.T @ np.linalg.solve(k, push), rel=1e-8)


def test_eigensolver_by_options_where_nothing_holds(monkeypatch):
    """Rigid motions would take the digits of its modes (.0118 for .0120 of a stiff and soft chain): refused,
    as are modes that miss their equations, and a stiffness that 1e-9 of the mass does not make definite.
    """
    n, options = 60, PETSc.Options()
    differences = np.diff(np.eye(n), axis=0)

    def squares(stiff: float, held: float) -> np.ndarray:
        springs = np.where(np.arange(n - 1) < 10, stiff, 1.0)
        stiffness = differences.T @ (springs[:, None] * differences)
        stiffness[0, 0] += held
        given = {"loads": np.eye(n)[:, :1], "sensors": {"a": 0}, "modes": 8}
        mass, stiffness = scipy.sparse.eye(n, format="csr"), scipy.sparse.csr_matrix(stiffness)
        return sb.reduce_matrices(mass, stiffness, np.zeros((0, n)), np.zeros(0), **given).omega ** 2

    with pytest.raises(sb.SolveError, match="singular to working precision even with"):
        squares(1e8, 0.0)
    try:
        options.setValue("modal_eps_type", "krylovschur")
        with pytest.raises(sb.SolveError, match="-modal_eps_ options are for bodies that are held"):
            squares(1e4, 0.0)
        slepc = sparse.lowest_by_slepc

        def carelessly(*asked):
            inverse, vectors, heavy = slepc(*asked)
            return inverse, vectors * (1.0 + 1e-5 * np.arange(n)[:, None]), heavy

        monkeypatch.setattr(sparse, "lowest_by_slepc", carelessly)
        with pytest.raises(sb.SolveError, match="miss their equations by .*lower -modal_eps_tol"):
            squares(1e4, 1.0)
    finally:
        options.delValue("modal_eps_type")


def test_orderings_take_nodes(beam):
    """Three unknowns of a node are one to MUMPS, in a mass that couples no directions, too, and not where an
    unknown is missing; rows of the user's keep their zeros.
    """
    mass, stiffness, (_, y, _) = beam
    for matrix in (mass, stiffness):
        assert sparse._matrix(matrix).getBlockSize() == 3
        assert sparse._matrix(matrix[1:, 1:]).getBlockSize() != 3
    rows = scipy.sparse.csr_matrix(([1.0, 0.0], ([0, 0], y[:2])), (1, mass.shape[0]))
    sb.reduce_matrices(mass, stiffness, rows, np.zeros(1), loads=rows.T, sensors={"y": y[0]}, modes=4)
    assert rows.nnz == 2


def test_eigenvalues_are_counted_in_the_place_of_a_factor(beam):
    """Below a number, and of a mass that is none, with entries where the stiffness has some and elsewhere: as
    many as of dense matrices.
    """
    mass, stiffness, _ = beam
    n = mass.shape[0]
    own = scipy.linalg.eigh(stiffness.toarray(), mass.toarray(), eigvals_only=True)
    other = scipy.sparse.lil_matrix((n, n))
    other[0, n - 1] = other[n - 1, 0] = 2.0 * mass.diagonal().max()
    assert stiffness[0, n - 1] == 0.0
    for changed in (mass - 0.4 * scipy.sparse.diags(mass.diagonal()), mass + other.tocsr()):
        below = int((scipy.linalg.eigvalsh(changed.toarray()) < 0.0).sum())
        solver = sparse._Columns(MPI.COMM_SELF, stiffness, "modal_st_")
        assert solver.factorised(sure=True)
        first = solver.below(float(own[29:31].mean()), mass)
        parts = sparse._negative_parts(scipy.sparse.csr_matrix(changed))
        assert 0 < below < n and first == 30 and sum(parts) == below
        solver.close()


def test_vectors_of_many_blocks_stay_orthonormal():
    """Evenly spread eigenvalues, half of them wanted: rounding had grown by up to ten in each block."""
    n, count = 400, 200
    random = np.random.default_rng(0)
    squares = np.sort(random.uniform(1.0, 100.0, n))
    mass, stiffness = scipy.sparse.identity(n, format="csr"), scipy.sparse.diags(squares).tocsr()
    values, vectors, _ = sparse.sparse_modes(mass, stiffness, mass[:, :1], count)
    assert values == pytest.approx(squares[:count], rel=1e-12)
    assert vectors.T @ vectors == pytest.approx(np.eye(count), abs=1e-12)


def test_eigenvalues_are_counted_beside_stiff_rows():
    """Of a long chain of springs, whose lowest eigenvalue is 8e-10 of its rows, by their closed form: what
    is added to a mass for its rounding, 1e-10 of the diagonal, would lift them over the place here. The mass
    has an entry where the stiffness has none, so that a matrix of its own is counted.
    """
    n = 40_000
    squares = 4.0 * np.sin((2.0 * np.arange(1, 3) - 1.0) * np.pi / (4.0 * n + 2.0)) ** 2
    diagonal = np.full(n, 2.0)
    diagonal[-1] = 1.0
    stiffness = scipy.sparse.diags([-np.ones(n - 1), diagonal, -np.ones(n - 1)], [-1, 0, 1]).tocsr()
    far = scipy.sparse.csr_matrix((np.full(2, 1e-9), ([0, n - 1], [n - 1, 0])), (n, n))
    mass = (scipy.sparse.identity(n) + far).tocsr()
    solver = sparse._Columns(MPI.COMM_SELF, stiffness, "modal_st_")
    assert solver.factorised(sure=False) and not solver.movable(mass)
    assert [solver.below(place, mass) for place in 1.05 * squares] == [1, 2]
    solver.close()


def test_no_stiffness_at_all():
    """Is a sentence where matrices are sparse (SciPy's on the dimensions of a matrix before)."""
    row = scipy.sparse.csr_matrix([[1.0, 0.0, 0.0]])
    with pytest.raises(sb.SolveError, match="the factorisation failed"):
        sb.reduce_matrices(
            scipy.sparse.eye(3, format="csr"),
            scipy.sparse.csr_matrix((3, 3)),
            row,
            [1.0],
            loads=row.T,
            sensors={},
        )
