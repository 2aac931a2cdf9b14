"""The two ways to the stiffness against each other, the inertia against SciPy, and inertia computed later."""

import numpy as np
import pytest
from scipy import linalg

from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement import stiffness
from sbfem_petsc.selement.coefficients import coefficient_matrices
from sbfem_petsc.selement.polynomial_modes import polynomial_modes
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon
from tests.systems import same_products

STRESS = Material(1.0, 0.3, 1.0)
NEARLY_INCOMPRESSIBLE = Material(1.0, 0.499, 1.0, plane="strain")
ORTHOTROPIC = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=30.0)
QUADRILATERAL = np.array([[-0.9, -0.7], [0.8, -0.9], [0.7, 0.6], [-0.6, 1.0]])
SQUARE = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
TIP = np.array([[1, 0], [1, 0.8], [-0.4, 1.1], [-1.2, -0.3], [-0.2, -0.9], [0.9, -0.8], [1, 0]]) / 1.3
NOTCH = np.array([[0.9, 0.4], [0, 1], [-1, 0], [0, -1], [0.9, -0.4]])
STEPS = np.concatenate([1.0 - 2.0 * 2.5 ** -np.arange(9.0), [1.0]])
GRADED = np.concatenate([np.stack([-STEPS[::-1], -np.ones(10)], axis=1), [[1, 1], [-1, 1]]])


def relative(a, b):
    return np.abs(a - b).max() / np.abs(b).max()


CASES = {
    **{f"quadrilateral of order {p}": (QUADRILATERAL, p, True, STRESS) for p in range(1, 17)},
    **{f"tip of order {p}": (TIP, p, False, STRESS) for p in (1, 2, 5, 9)},
    **{f"orthotropic tip of order {p}": (TIP, p, False, ORTHOTROPIC) for p in (1, 5, 9)},
    "symmetric square": (SQUARE, 5, True, STRESS),
    "notch": (NOTCH, 6, False, STRESS),
    "aspect ratio 10": (SQUARE * [1.0, 0.1], 5, True, STRESS),
    "aspect ratio 100": (SQUARE * [1.0, 0.01], 5, True, STRESS),
    "graded": (GRADED, 5, True, STRESS),
    "nearly incompressible": (QUADRILATERAL, 5, True, NEARLY_INCOMPRESSIBLE),
}


@pytest.mark.parametrize("case", CASES)
def test_doubling_and_schur_agree(case):
    corners, order, closed, material = CASES[case]
    shape = polygon(corners, order, closed)
    first, second = (
        solve_selement(Sectors(shape, order, material.elasticity), closed, method=method)
        for method in ("doubling", "schur")
    )
    # both lose what the equation's condition costs: 2e-13 in the graded and the flat shapes
    assert relative(first.stiffness, second.stiffness) < 1e-12
    assert first.asymmetry < 1e-13 and first.riccati_residual < 1e-12


def test_schur_where_doubling_fails(monkeypatch):
    """A residual above what is accepted leads to the Schur form, never to the poorer solution."""
    shape = polygon(QUADRILATERAL, 4)
    expected = solve_selement(Sectors(shape, 4, STRESS.elasticity), True, method="schur")
    called = []
    original = stiffness._invariant_subspace
    monkeypatch.setattr(stiffness, "_invariant_subspace", lambda *a: called.append(1) or original(*a))
    monkeypatch.setattr(stiffness, "ACCEPTED", 0.0)
    found = solve_selement(Sectors(shape, 4, STRESS.elasticity), True)
    assert called == [1]
    same_products(found.stiffness, expected.stiffness)
    monkeypatch.setattr(stiffness, "ACCEPTED", 1e-12)
    solve_selement(Sectors(shape, 4, STRESS.elasticity), True)
    assert called == [1]


def modes_of(shape, order, elasticity):
    """The polynomial modes of one S-element."""
    coefficients = coefficient_matrices(shape[None], order, True, elasticity)
    return next(known for _, known in polynomial_modes(shape[None], order, elasticity, coefficients))


POLYNOMIAL = [name for name, case in CASES.items() if case[2]]


@pytest.mark.parametrize("case", POLYNOMIAL)
def test_beyond_polynomial_modes(case):
    """What is left to solve beyond the polynomial modes gives the stiffness of the whole, and the modes of
    degree k have the exponent k.
    """
    corners, order, closed, material = CASES[case]
    shape, elasticity = polygon(corners, order, closed), material.elasticity
    found = solve_selement(Sectors(shape, order, elasticity), closed, 1)
    schur = solve_selement(Sectors(shape, order, elasticity), closed, method="schur").stiffness
    assert relative(found.stiffness, schur) < 1e-12
    known = modes_of(shape, order, elasticity)
    count = known.basis.shape[2]
    exponents = [0, 0, *np.repeat(range(1, order + 1), 4)]
    assert known.exponents.tolist() == exponents[:count]
    basis, modes = known.basis[0], known.basis[0] @ known.triangle[0]
    np.testing.assert_allclose(basis.T @ basis, np.eye(count), atol=1e-14)
    # round-off of the whole A, whose entries grow with the aspect ratio
    missed = found.radial @ modes - modes * known.exponents
    assert np.abs(missed).max() < 1e-12 * np.abs(found.radial).max()


@pytest.mark.parametrize("material", [STRESS, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
def test_fields_of_plane_elasticity_are_among_the_polynomial_modes(material):
    """Pure bending, of degree 2, and a cubic field of shear that varies along a beam, from their stresses."""
    order, elasticity = 3, material.elasticity
    shape = polygon(QUADRILATERAL, order)
    known = modes_of(shape, order, elasticity)
    assert known.basis.shape[2] == 14
    (x, y), s = shape.T, np.linalg.inv(elasticity)
    # sigma_xx = y alone: strains s[:, 0] y
    u = s[0, 0] * x * y + 0.5 * s[2, 0] * y**2
    v = 0.5 * s[1, 0] * y**2 - 0.5 * s[0, 0] * x**2
    field = np.stack([u, v], axis=1).ravel()
    rest = known.rest[0].T @ field
    assert np.abs(rest).max() < 1e-14 * np.abs(field).max()
    # its nodal forces do the work of the stress: area integral of s00 y^2
    forces = solve_selement(Sectors(shape, order, elasticity), True).stiffness @ field
    at, weight = np.polynomial.legendre.leggauss(6)
    corners = np.array([*QUADRILATERAL, QUADRILATERAL[0]])
    area = 0.0
    for a, b in zip(corners, corners[1:]):  # of the polygon, by triangles from the origin
        along = 0.5 * (1 - at)[:, None] * a + 0.5 * (1 + at)[:, None] * b
        area += (a[0] * b[1] - a[1] * b[0]) * (0.5 * weight * along[:, 1] ** 2).sum() / 4.0
    assert field @ forces == pytest.approx(s[0, 0] * area, rel=1e-12)


@pytest.mark.parametrize("order", [1, 3, 8, 16])
@pytest.mark.parametrize("closed", [True, False])
def test_mass_solves_its_lyapunov_equation(order, closed):
    """(A + I)^T M + M (A + I) = M0 by SciPy's solver."""
    shape = polygon(QUADRILATERAL if closed else TIP[::2], order, closed)
    element = solve_selement(Sectors(shape, order, STRESS.elasticity), closed, 0)
    m0 = coefficient_matrices(shape, order, closed, STRESS.elasticity).m0
    raised = element.radial + np.eye(len(m0))
    expected = linalg.solve_continuous_lyapunov(raised.T, m0)
    assert relative(element.mass, expected) < 1e-12


@pytest.mark.parametrize("terms", [1, 2, 4])
@pytest.mark.parametrize("order", [2, 5, 9])
def test_continued_fraction_by_scipy(terms, order):
    """The recursion (12)-(19) with SciPy's solver of Lyapunov equations in the nodal basis, and lower
    triangular scalings: the dynamic stiffness is the same.
    """
    shape = polygon(QUADRILATERAL, order)
    element = solve_selement(Sectors(shape, order, STRESS.elasticity), True, terms)
    c = coefficient_matrices(shape, order, True, STRESS.elasticity)
    identity = np.eye(len(shape) * 2)
    u, inverse = element.radial.T, np.linalg.inv(c.e0)
    v = element.mass @ inverse
    a, levels = v @ element.mass, []
    for _ in range(terms):
        x = np.linalg.cholesky(linalg.solve_continuous_lyapunov(u + 2.0 * identity, a))
        back = np.linalg.inv(x)
        b1 = (back @ v @ x).T
        u = back @ u @ x + 2.0 * identity
        s1 = linalg.solve_continuous_lyapunov(u + identity, b1 + b1.T)
        levels.append((x, s1))
        inner = back @ a @ back.T
        a = s1 @ inner @ s1 - s1 @ b1.T - b1 @ s1 + x.T @ inverse @ x
        v, inverse = s1 @ inner - b1, inner
    w2 = 0.3
    share = np.zeros_like(identity)
    for x, s1 in reversed(levels):
        share = x @ np.linalg.solve(identity - w2 * s1 - w2**2 * share, x.T)
    found = element.coupling / (1.0 - w2 * element.inertia) @ element.coupling.T
    assert relative(found, share) < 1e-11


def test_inertia_computed_later():
    shape = polygon(SQUARE, 4)
    at_once = solve_selement(Sectors(shape, 4, STRESS.elasticity), True, 2)
    static = solve_selement(Sectors(shape, 4, STRESS.elasticity), True)
    same_products(static.stiffness, at_once.stiffness)
    with pytest.raises(RuntimeError, match="with_inertia"):
        _ = static.mass
    later = static.with_inertia(2)
    assert later.stiffness is static.stiffness and static.dynamics is None
    for name in ("mass", "coupling", "inertia"):
        same_products(getattr(later, name), getattr(at_once, name))


def test_sectors_of_two_materials():
    """A closed square of two materials joined along the x axis: exact layered states, the mass of each half,
    and no use of the outline's mirrors.
    """
    order = 3
    corners = np.array([[-1, 0], [-1, -1], [1, -1], [1, 0], [1, 1], [-1, 1]], float) / np.sqrt(2.0)
    shape = polygon(corners, order)
    soft, stiff = 0.2 * STRESS.elasticity, STRESS.elasticity
    elasticity = np.array([soft] * 3 + [stiff] * 3)
    density = np.array([3.0] * 3 + [1.0] * 3)
    element = solve_selement(Sectors(shape, order, elasticity), True, 0, density=density)
    # tension along y: the strains across add up layer by layer, with sigma_xx for equal strain along x
    strain_x = 0.1
    u = np.zeros_like(shape)
    for d, inside in ((soft, shape[:, 1] < 0.0), (stiff, shape[:, 1] >= 0.0)):
        strain_y = (1.0 - d[1, 0] * strain_x) / d[1, 1]
        u[inside] = shape[inside] * [strain_x, strain_y]
    c = coefficient_matrices(shape, order, True, elasticity)
    forces = ((c.e0 + c.e1.T) @ u.ravel()).reshape(-1, 2)
    np.testing.assert_allclose(element.stiffness @ u.ravel(), forces.ravel(), atol=1e-13)
    top = np.abs(shape[:, 1] - shape[:, 1].max()) < 1e-12
    assert forces[top, 1].sum() == pytest.approx(np.sqrt(2.0), rel=1e-12)
    translation = np.tile([1.0, 0.0], len(shape))
    assert translation @ element.mass @ translation == pytest.approx(1.0 * 3.0 + 1.0 * 1.0, rel=1e-12)
    later = solve_selement(Sectors(shape, order, elasticity), True, density=density).with_inertia(0)
    same_products(later.mass, element.mass)


def test_a_triangle_of_first_order():
    """All its modes are polynomials of degree 0 and 1, and nothing is left of which a Schur form is taken:
    its mass is that of the constant-strain triangle about its centroid, rho A / 12 (1 + delta).
    """
    shape = np.array([(-0.5, -0.4), (0.6, -0.3), (0.0, 0.6)])
    shape = shape - shape.mean(axis=0)
    found = solve_selement(Sectors(shape, 1, STRESS.elasticity), True, 1)
    area = 0.5 * abs(np.linalg.det(shape[1:] - shape[0]))
    expected = np.kron(area / 12.0 * (np.ones((3, 3)) + np.eye(3)), np.eye(2))
    assert relative(found.mass, expected) < 1e-12
