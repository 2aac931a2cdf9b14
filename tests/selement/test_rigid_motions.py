"""Forces without the round-off of rigid motions."""

import numpy as np

from sbfem_petsc.material import Material
from sbfem_petsc.selement.rigid_motions import (
    deformation_forces,
    rigid_body_basis,
    rigid_motions,
    without_rigid_motions,
)
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon

SHAPE = polygon(np.array([[-1.0, -0.7], [0.9, -1.0], [1.2, 0.3], [-0.8, 0.9]]) / 1.3, 5)
STIFFNESS = solve_selement(Sectors(SHAPE, 5, Material(1.0, 0.3, 1.0).elasticity), True).stiffness


def test_basis():
    """Orthonormal, and the motions about any point lie in its span."""
    basis = rigid_body_basis(SHAPE)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-15)
    motions = rigid_motions(SHAPE + [3.0, -2.0])
    assert np.abs(without_rigid_motions(basis, motions)).max() < 1e-14


def test_deformation_forces():
    """They are K u, and in equilibrium to their own round-off, not to that of a large rotation."""
    basis = rigid_body_basis(SHAPE)
    deformation = np.stack([SHAPE[:, 0] ** 2, SHAPE[:, 0] * SHAPE[:, 1]], axis=1).ravel()
    forces = deformation_forces(STIFFNESS, basis, deformation)
    np.testing.assert_allclose(forces, STIFFNESS @ deformation, atol=1e-13)
    large = deformation + 1e7 * rigid_motions(SHAPE)[:, 2]
    forces, plain = deformation_forces(STIFFNESS, basis, large), STIFFNESS @ large
    assert np.abs(basis.T @ forces).max() < 1e-14 * np.linalg.norm(forces)
    assert np.abs(basis.T @ plain).max() > 1e-11 * np.linalg.norm(forces)
    both = deformation_forces(STIFFNESS, basis, np.stack([deformation, large], axis=1))
    np.testing.assert_array_equal(both.shape, (len(large), 2))
