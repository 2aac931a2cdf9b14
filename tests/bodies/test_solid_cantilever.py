"""A solid cantilever with a crack by gmsh and CalculiX: its matrices beside scikit-fem's, and results."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import sbfem_petsc as sb
from examples.tables.cracked_cantilever import calculix, mesh, write_deck


def assembled(places: np.ndarray, tets: np.ndarray, body: sb.FiniteElementModel, order: int):
    """Mass and stiffness of scikit-fem's tetrahedra of second order for the body's unknowns, with a mass that
    is integrated up to an order.
    """
    skfem = pytest.importorskip("skfem")
    from skfem.helpers import dot
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    used, corners = np.unique(tets[:, :4], return_inverse=True)
    grid = skfem.MeshTet(1e-3 * places[used].T, corners.reshape(-1, 4).T)
    element = skfem.ElementVector(skfem.ElementTetP2())
    basis, rough = skfem.Basis(grid, element), skfem.Basis(grid, element, intorder=order)
    stiffness = linear_elasticity(*lame_parameters(210e9, 0.3)).assemble(basis).tocsr()
    mass = skfem.BilinearForm(lambda u, v, _: 7850.0 * dot(u, v)).assemble(rough).tocsr()
    number = np.zeros((len(places), 3), dtype=int)
    for nodes, rows in zip(tets, basis.element_dofs.T, strict=True):
        apart = np.abs(1e-3 * places[nodes, None] - basis.doflocs[:, rows].T).sum(axis=2)
        number[nodes] = np.sort(rows[np.argsort(apart, axis=1, kind="stable")[:, :3]], axis=1)
    own = [number[node - 1, d] for node, d in body.unknowns.tolist()]
    return mass[own][:, own], stiffness[own][:, own]


@pytest.mark.long
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_matrices_and_what_follows(tmp_path):
    """CalculiX integrates the mass of ten-node tetrahedra at four points, which moves the third frequency by
    2e-6; so integrated, scikit-fem's matrices are the same. Of an exact mass harmonics are to 1e-4.
    """
    places, tets = mesh(20.0, 5.0)
    write_deck(tmp_path / "beam.inp", places, tets)
    calculix(tmp_path / "beam.inp")
    body = sb.read_calculix(tmp_path / "beam")
    mass, stiffness = assembled(places, tets, body, 2)
    assert abs(stiffness - body.stiffness).max() < 1e-8 * abs(stiffness).max()
    assert abs(mass - body.mass).max() < 1e-8 * abs(mass).max()
    exact = sb.FiniteElementModel(
        assembled(places, tets, body, 4)[0],
        stiffness,
        body.unknowns,
        dict(zip(body.labels, body.places)),
        sets=body.sets,
        fixed=sorted(body.fixed),
    )
    found = []
    for model in (body, exact):
        tip = model.at((0.2, 0.02, 0.01), "z")
        crack = model.contact("LEFT", "RIGHT", normal="x", gap=0.0)
        given = {"loads": {"F": tip}, "points": {"tip": tip}, "modes": 40, "damping": 0.005}
        rom = sb.reduce(model, contact=crack, shapes=False, **given)
        rest, orbit = sb.static(rom, 100.0), sb.periodic(rom, 100.0, 150.0)
        found.append((float(rest.displacement("tip")), rest.active, np.abs(orbit.harmonics("tip")[:4])))
    (u, closed, one), (v, same, other) = found
    assert u == pytest.approx(v, rel=1e-7) and (closed == same).all() and closed.sum() > 10
    assert one[:3] == pytest.approx(other[:3], rel=1e-4) and one[3] == pytest.approx(other[3], rel=1e-2)
