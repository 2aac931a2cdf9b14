"""Bodies that several files of tests take."""

from __future__ import annotations

import numpy as np
import pytest

import sbfem_petsc as sb


@pytest.fixture(scope="package")
def whole():
    """Two blocks of steel, in mm, N and t, whose faces at x = 40 mm touch and join below z = 5 mm; the left
    end is held, and stands in the matrices.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = skfem.MeshHex.init_tensor(np.linspace(0, 80, 9), np.linspace(0, 10, 2), np.linspace(0, 10, 3))
    p, t = mesh.p, mesh.t.copy()
    crack = np.flatnonzero((np.abs(p[0] - 40) < 1e-9) & (p[2] > 5 + 1e-9))
    twin = dict(zip(crack, range(p.shape[1], p.shape[1] + len(crack)), strict=True))
    for e in np.flatnonzero(p[0, t].mean(axis=0) > 40):
        t[:, e] = [twin.get(k, k) for k in t[:, e]]
    mesh = skfem.MeshHex(np.hstack([p, p[:, crack]]), t)
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()))
    stiffness = linear_elasticity(*lame_parameters(210e3, 0.3)).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: 7.85e-9 * dot(u, v)).assemble(basis)
    place = np.zeros((basis.N, 2), int)
    for d in range(3):
        place[basis.nodal_dofs[d]] = np.stack(
            [np.arange(mesh.p.shape[1]) + 1, np.full(mesh.p.shape[1], d)], 1
        )
    held = mesh.p[0] < 1e-9
    return {
        "mass": mass.tocsr(),
        "stiffness": stiffness.tocsr(),
        "unknowns": place,
        "nodes": {k + 1: tuple(x) for k, x in enumerate(mesh.p.T)},
        "sets": {"LEFT": crack + 1, "RIGHT": [k + 1 for k in twin.values()]},
        "fixed": [(int(k) + 1, d) for k in np.flatnonzero(held) for d in range(3)],
        "elements": {"hexahedron": 1 + mesh.t[[0, 3, 6, 2, 1, 5, 7, 4]].T},  # in VTK's order
        "units": "mm-N-t",
    }


@pytest.fixture(scope="package")
def parts(whole):
    """The same without what is held."""
    held = {node for node, _ in whole["fixed"]}
    free = np.flatnonzero([node not in held for node, _ in whole["unknowns"]])
    matrices = {name: whole[name][free][:, free] for name in ("mass", "stiffness")}
    return {**whole, **matrices, "unknowns": whole["unknowns"][free]}


@pytest.fixture(scope="package")
def body(parts):
    return sb.FiniteElementModel(**parts)
