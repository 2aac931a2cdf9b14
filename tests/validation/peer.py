"""Natural frequencies of plain cantilevers by scikit-fem, an independent finite element code."""

from __future__ import annotations

import functools

import numpy as np
from scipy.sparse.linalg import eigsh
from skfem import Basis, BilinearForm, ElementQuadP, ElementVector, MeshQuad, condense
from skfem.helpers import ddot, dot, eye, sym_grad, trace


@functools.cache
def cantilever(length: float, height: float, count: int) -> np.ndarray:
    """Frequencies, Hz, of plane stress aluminium (70 GPa, 0.33, 2700), clamped at x = 0.

    Squares of half the height and order 5, halved five times towards the clamped corners.
    """
    young, poisson, density = 70e9, 0.33, 2700.0
    fine = height / 2 * 0.5 ** np.arange(5, 0, -1)
    x = np.concatenate([[0.0], fine, np.linspace(height / 2, length, round(2 * length / height))])
    y = np.unique(np.round(np.concatenate([[0.0], fine, [height / 2], height - fine, [height]]), 12))
    basis = Basis(MeshQuad.init_tensor(x, y), ElementVector(ElementQuadP(5)), intorder=11)
    shear, first = young / (2 * (1 + poisson)), young * poisson / (1 - poisson**2)

    @BilinearForm
    def stiffness(u, v, w):
        strain = sym_grad(u)
        return ddot(2 * shear * strain + eye(first * trace(strain), 2), sym_grad(v))

    @BilinearForm
    def mass(u, v, w):
        return density * dot(u, v)

    k, m = stiffness.assemble(basis), mass.assemble(basis)
    held = basis.get_dofs(lambda at: np.isclose(at[0], 0.0))
    k, m, *_ = condense(k, m, D=held)
    values = eigsh(k, count, m, sigma=0.0, return_eigenvectors=False)
    return np.sqrt(np.sort(values)) / (2 * np.pi)
