"""One S-element against book values, exact solutions and its own invariants."""

import numpy as np
import pytest
from scipy import linalg

from meshing.gll import gll_nodes
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.coefficients import SElementError
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement


def polygon(corners, order, closed=True):
    """Boundary nodes of a straight-sided polygon about the origin."""
    corners = np.asarray(corners, dtype=float)
    fraction = 0.5 * (1.0 + gll_nodes(order))[:-1, None]
    following = np.roll(corners, -1, axis=0)
    sides = len(corners) if closed else len(corners) - 1
    nodes = [corners[i] + fraction * (following[i] - corners[i]) for i in range(sides)]
    return np.concatenate(nodes + ([] if closed else [corners[-1:]]))


def square(order, half=1.0):
    return polygon(half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), order)


def pencil(element):
    """Stiffness and mass with the auxiliary unknowns."""
    return (
        linalg.block_diag(element.stiffness, np.eye(element.inertia.size)),
        np.block([[element.mass, element.coupling], [element.coupling.T, np.diag(element.inertia)]]),
    )


def frequencies(element, keep=None, count=None):
    stiffness, mass = pencil(element)
    if keep is not None:
        index = np.concatenate([np.flatnonzero(keep), np.arange(len(keep), len(mass))])
        stiffness, mass = stiffness[np.ix_(index, index)], mass[np.ix_(index, index)]
    values = linalg.eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(np.abs(values))[:count]


def plane_stress(poisson):
    return Material(1.0, poisson, 1.0).elasticity


def test_book_square():
    """Song, The Scaled Boundary Finite Element Method (2018): square (+-1)^2, E = 10, nu = 0, rho = 2,
    two-node edges.
    """
    element = solve_selement(Sectors(square(1), 1, plane_stress(0.0)), True, 0)
    np.testing.assert_allclose(
        10 * element.stiffness[0], [4.8936, 1.25, -2.3936, -1.25, -2.6064, -1.25, 0.1064, 1.25], atol=6e-5
    )
    np.testing.assert_allclose(
        2 * element.mass[0], [0.8954, 0.0851, 0.4380, 0, 0.2287, 0.0851, 0.4380, 0], atol=6e-5
    )


def test_free_square_frequencies():
    """Free unit square, plane stress, nu = 0.3, order 10, four terms: printed digits of an independent
    prototype.
    """
    found = frequencies(solve_selement(Sectors(square(10, 0.5), 10, plane_stress(0.3)), True, 4), count=15)
    expected = [
        2.43265,
        2.59096,
        2.59096,
        2.75536,
        3.13163,
        3.61893,
        3.90289,
        3.90289,
        4.51085,
        5.20854,
        5.20854,
        5.28911,
    ]
    np.testing.assert_allclose(found[3:], expected, atol=6e-6)


@pytest.mark.parametrize("poisson", [0.0, 0.2, 0.3, 0.45])
def test_lame_mode(poisson):
    """The Lame mode of a free square, omega = sqrt(2) pi c_s / L for any Poisson's ratio."""
    found = frequencies(
        solve_selement(Sectors(square(10, 0.5), 10, plane_stress(poisson)), True, 4), count=12
    )
    exact = np.sqrt(2.0) * np.pi * np.sqrt(0.5 / (1.0 + poisson))
    assert (
        np.abs(found / exact - 1.0).min() < 1e-6
    )  # the continued fraction at 0.45 S wavelengths leaves 1e-7


def roller_exact(poisson, count):
    """omega = pi c sqrt(m^2 + n^2): P waves for (m, n) != (0, 0), S waves for m, n >= 1 (unit square)."""
    m, n = np.meshgrid(np.arange(30), np.arange(30))
    radius = np.pi * np.hypot(m, n)
    pressure = radius[(m + n) > 0] / np.sqrt(1.0 - poisson**2)
    shear = radius[(m > 0) & (n > 0)] * np.sqrt(0.5 / (1.0 + poisson))
    return np.sort(np.concatenate([pressure, shear]))[:count]


@pytest.mark.parametrize("terms, modes", [(0, 0), (1, 3), (2, 15), (3, 26), (4, 50), (6, 100)])
def test_roller_square(terms, modes):
    """Unit square on roller edges, one S-element of order 16: the modes below 1 % error grow with the
    continued fraction.
    """
    coordinates = square(16, 0.5)
    keep = np.stack(
        [np.abs(np.abs(coordinates[:, 0]) - 0.5) > 1e-9, np.abs(np.abs(coordinates[:, 1]) - 0.5) > 1e-9],
        axis=1,
    ).ravel()
    found = frequencies(
        solve_selement(Sectors(coordinates, 16, plane_stress(0.3)), True, terms), keep, modes + 1
    )
    error = np.abs(found / roller_exact(0.3, modes + 1) - 1.0)
    assert (error[:modes] < 0.01).all()
    assert error[modes] >= 0.01


def test_crack_exponents():
    """Radial exponents of an open square around a crack tip: 0, 0, 1/2, 1/2, 1, 1, 3/2, 3/2, 2."""
    corners = [[0, 1], [-1, 1], [-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1]]
    element = solve_selement(Sectors(polygon(corners, 8, closed=False), 8, plane_stress(0.3)), False, 1)
    exponents = np.sort(linalg.eigvals(element.radial).real)[:9]
    np.testing.assert_allclose(exponents, [0, 0, 0.5, 0.5, 1, 1, 1.5, 1.5, 2], atol=1e-6)


@pytest.mark.parametrize("order", range(1, 17))
def test_checks_hold_at_every_order(order):
    """Residual, symmetry and rigid-body motions stay at round-off from order 1 to 16 (200 unknowns: an
    independent prototype had 5e-15 and 3e-15; times 100).
    """
    element = solve_selement(Sectors(square(order), order, plane_stress(0.3)), True, 1)
    assert max(element.riccati_residual, element.asymmetry, element.rigid_body_residual) < 5e-13
    assert linalg.eigvalsh(element.mass)[0] > 0
    translation = np.tile([1.0, 0.0], 4 * order)
    assert translation @ element.mass @ translation == pytest.approx(4.0, rel=1e-12)


def test_dynamic_stiffness_equation():
    """The continued fraction satisfies (S - E1) F (S - E1') - E2 + 2 x S,x - x M0 = 0 with an error of order
    x^(2 Mcf + 2).
    """
    from sbfem_petsc.selement.coefficients import coefficient_matrices

    coordinates, elasticity = square(4), plane_stress(0.3)
    c = coefficient_matrices(coordinates, 4, True, elasticity)
    for terms in (1, 2, 3):
        element = solve_selement(Sectors(coordinates, 4, elasticity), True, terms)

        def residual(x, element=element):
            inverse = np.diag(1.0 / (1.0 + x * element.inertia))
            c1 = element.coupling @ inverse
            s = element.stiffness + x * element.mass - x * x * c1 @ element.coupling.T
            slope = element.mass - 2 * x * c1 @ element.coupling.T + x * x * (c1 * element.inertia) @ c1.T
            return np.abs(
                (s - c.e1) @ np.linalg.solve(c.e0, s - c.e1.T) - c.e2 + 2 * x * slope - x * c.m0
            ).max()

        # the rate is approached from above; three terms need a larger x to rise above round-off
        start = {1: -0.1, 2: -0.1, 3: -0.8}[terms]
        rate = np.log2(residual(2 * start) / residual(start))
        assert 2 * terms + 1.8 < rate < 2 * terms + 3.0


def test_similar_elements():
    """Rotation and reflection turn the matrices and change nothing else."""
    corners = np.array([[-1, -0.7], [0.9, -1], [1.2, 0.3], [0.2, 1.1], [-0.8, 0.9]])
    order, elasticity = 4, plane_stress(0.3)
    base = solve_selement(Sectors(polygon(corners, order), order, elasticity), True, 2)
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    turned = solve_selement(Sectors(polygon(corners @ turn.T, order), order, elasticity), True, 2)
    big = np.kron(np.eye(len(base.stiffness) // 2), turn)
    np.testing.assert_allclose(turned.stiffness, big @ base.stiffness @ big.T, atol=1e-12)
    np.testing.assert_allclose(turned.mass, big @ base.mass @ big.T, atol=1e-12)
    np.testing.assert_allclose(turned.inertia, base.inertia, rtol=1e-9)
    mirrored = solve_selement(Sectors(polygon(corners[::-1] * [-1, 1], order), order, elasticity), True, 2)
    np.testing.assert_allclose(
        linalg.eigvalsh(mirrored.stiffness), linalg.eigvalsh(base.stiffness), atol=1e-12
    )


def test_orthotropic_with_isotropic_constants():
    """An orthotropic material with isotropic constants is the isotropic one, at any angle, in both plane
    states.
    """
    for plane in ("stress", "strain"):
        isotropic = Material(3.0, 0.25, 1.0, plane)
        for angle in (0.0, 33.0):
            same = OrthotropicMaterial(3.0, 3.0, 0.25, 3.0 / 2.5, 1.0, angle=angle, plane=plane)
            np.testing.assert_allclose(
                same.elasticity * same.modulus,
                isotropic.elasticity * isotropic.modulus,
                rtol=1e-12,
                atol=1e-12,
            )


def test_scaling_centre_outside():
    with pytest.raises(SElementError, match="does not see edge"):
        solve_selement(Sectors(square(3) + [1.5, 0.0], 3, plane_stress(0.3)), True, 1)
