"""Sparse matrices of other codes against dense computations of the tests' own, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse

import sbfem_petsc as sb
from sbfem_petsc.petsc import PETSc


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


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"stiffness": scipy.sparse.diags([1.0, -0.5, 2.0])}, "stiffness is indefinite"),
        ({"stiffness": scipy.sparse.diags([1.0, 2.0])}, "stiffness has shape"),
        ({"stiffness": scipy.sparse.csr_matrix(np.triu(np.ones((3, 3))))}, "stiffness is not symmetric"),
        ({"mass": scipy.sparse.diags([1.0, np.nan, 1.0])}, "mass.data"),
        ({"modes": 3}, "modes = 3"),
        ({"sensors": {"A": np.ones(2)}}, "sensors\\['A'\\] has 2 entries"),
        pytest.param(
            {"stiffness": scipy.sparse.csr_matrix([[1.0, -1, 0], [-1, 2, -1], [0, -1, 1]])},
            "rigid-body motions",
            marks=pytest.mark.skipif(
                not PETSc.Sys.hasExternalPackage("mumps"), reason="MUMPS alone counts null pivots"
            ),
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
