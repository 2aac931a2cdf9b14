"""Stress intensity factors of tip elements without symmetry, whose double exponent 1/2 is split by the edges'
error.
"""

import numpy as np
import pytest

from meshing.gll import gll_nodes
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.intensity import intensity_rows
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement

# Around a tip at the origin, the crack along (1, 3.25) from it: the tip element of a mesh of quadrilaterals
# by gmsh.
CORNERS = (
    np.array(
        [
            [1.0, 3.25],
            [-2.85526235, 3.41505402],
            [-5.92451438, 0.4540056],
            [-9.86937, -3.88106756],
            [-4.27320727, -6.24621206],
            [-0.179351, -7.35611291],
            [2.00396131, -3.05632154],
            [2.81903217, 0.78057162],
            [1.0, 3.25],
        ]
    )
    / 10.0
)
AXIS = CORNERS[0] / np.linalg.norm(CORNERS[0])
NU = 0.3


def boundary(order):
    at = 0.5 * (gll_nodes(order) + 1.0)
    points = [first + at[:-1, None] * (last - first) for first, last in zip(CORNERS, CORNERS[1:])]
    return np.vstack([*points, CORNERS[-1:]])


def displacement(shape, opening, sliding):
    """Williams' singular modes in plane stress, E = 1, of unit stress intensity factors times the given ones;
    the two faces apart.
    """
    ahead = -AXIS
    across = np.array([-ahead[1], ahead[0]])
    r = np.hypot(*shape.T)
    theta = np.unwrap(np.arctan2(shape @ across, shape @ ahead))
    theta -= 0.5 * (theta[0] + theta[-1])
    shear, kappa = 0.5 / (1.0 + NU), (3.0 - NU) / (1.0 + NU)
    c, s = np.cos(0.5 * theta), np.sin(0.5 * theta)
    along = opening * c * (kappa - 1.0 + 2.0 * s**2) + sliding * s * (kappa + 1.0 + 2.0 * c**2)
    normal = opening * s * (kappa + 1.0 - 2.0 * c**2) - sliding * c * (kappa - 1.0 - 2.0 * s**2)
    return (np.sqrt(r / (2.0 * np.pi)) / (2.0 * shear))[:, None] * (
        along[:, None] * ahead + normal[:, None] * across
    )


@pytest.mark.parametrize(
    "order, bound", [(2, 6e-2), (3, 7e-3), (4, 1.3e-3), (5, 1.6e-4), (6, 4e-5), (8, 8e-7)]
)
def test_unsymmetric_tip_element(order, bound):
    """K_I and K_II of the exact boundary displacements; errors about three times those measured, falling with
    the order. By Williams' modes, and by those of an anisotropic material that happens to be isotropic.
    """
    shape = boundary(order)
    for material in (
        Material(1.0, NU, 1.0),
        OrthotropicMaterial(1.0, 1.0, NU, 0.5 / (1.0 + NU), 1.0, angle=20.0),
    ):
        element = solve_selement(Sectors(shape, order, material.elasticity), False, 0)
        form = intensity_rows(element.radial_form, Sectors(shape, order, material.elasticity), AXIS)
        np.testing.assert_allclose(form.exponents, 0.5, atol=1e-15)
        for factors in ((1.0, 0.0), (0.0, 1.0), (2.0, -0.7)):
            found = form.rows @ displacement(shape, *factors).ravel()
            assert np.abs(found - factors).max() < bound * np.linalg.norm(factors)
