"""Rigid-body motions."""

import numpy as np

from sbfem_petsc.selement.rigid_motions import rigid_body_basis, rigid_motions
from tests.selement.test_solution import polygon

SHAPE = polygon(np.array([[-1.0, -0.7], [0.9, -1.0], [1.2, 0.3], [-0.8, 0.9]]) / 1.3, 5)


def test_basis():
    """Orthonormal, and the motions about any point lie in its span."""
    basis = rigid_body_basis(SHAPE)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-15)
    motions = rigid_motions(SHAPE + [3.0, -2.0])
    assert np.abs(motions - basis @ (basis.T @ motions)).max() < 1e-14
