"""A solid cantilever with a crack by gmsh and CalculiX: its matrices beside scikit-fem's, and results."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import sbfem_petsc as sb
from examples.cracked_cantilever import store

FILES = Path(__file__).parent / "calculix"


def assembled(places: np.ndarray, tets: np.ndarray, unknowns: np.ndarray, order: int):
    """Mass and stiffness of scikit-fem's tetrahedra of second order for unknowns (node, from 1, and
    direction), with a mass that is integrated up to an order.
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
    own = [number[node - 1, d] for node, d in unknowns.tolist()]
    return mass[own][:, own], stiffness[own][:, own]


@pytest.mark.long
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_matrices_and_what_follows(tmp_path):
    """CalculiX integrates the mass of ten-node tetrahedra at four points, which moves the third frequency by
    2e-6; so integrated, scikit-fem's matrices are the same. Of an exact mass harmonics are to 1e-4.
    """
    store(tmp_path, 20.0, 5.0)
    body = sb.read_calculix(tmp_path / "cantilever")
    row = {label: k for k, label in enumerate(body.labels)}
    places, tets = 1e3 * body.places, body.elements["tetra10"]
    unknowns = np.array([(row[node] + 1, d) for node, d in body.unknowns.tolist()])
    mass, stiffness = assembled(places, tets, unknowns, 2)
    assert abs(stiffness - body.stiffness).max() < 1e-8 * abs(stiffness).max()
    assert abs(mass - body.mass).max() < 1e-8 * abs(mass).max()
    exact = sb.FiniteElementModel(
        assembled(places, tets, unknowns, 4)[0],
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


@pytest.fixture(scope="module")
def cantilever():
    """Of 56 pairs, its mass and stiffness, which are CalculiX's where the mass is integrated at its four
    points, its load and its crack.
    """
    found = np.load(FILES / "cantilever.npz")
    places, tets = found["places"], found["tets"].astype(int)
    free = [(k, d) for k in np.flatnonzero(places[:, 0] > 1e-6).tolist() for d in range(3)]
    mass, stiffness = assembled(places, tets, np.array(free) + [1, 0], 2)
    pairs, low = cKDTree(places).query_pairs(1e-6, output_type="ndarray"), np.zeros(len(places), dtype=bool)
    low[tets[places[tets[:, :4], 0].mean(axis=1) < 80.0]] = True
    left = np.where(low[pairs[:, 0]], pairs[:, 0], pairs[:, 1])
    right = pairs.sum(axis=1) - left
    body = sb.FiniteElementModel(
        mass,
        stiffness,
        free,
        dict(enumerate(1e-3 * places)),
        sets={"LEFT": left, "RIGHT": right},
        fixed=[(k, d) for k in np.flatnonzero(places[:, 0] <= 1e-6).tolist() for d in range(3)],
    )
    tip, crack = body.at((0.2, 0.02, 0.01), "z"), body.contact("LEFT", "RIGHT", normal="x", gap=0.0)
    return body, mass, stiffness, tip, crack


@pytest.mark.long
def test_statics_and_a_steady_state(cantilever):
    """What a prototype with SLEPc's modes and CalculiX's own matrices gave."""
    body, *_, tip, crack = cantilever
    given = {"loads": {"F": tip}, "points": {"tip": tip}, "modes": 80, "damping": 0.005}
    rom = sb.reduce(body, contact=crack, shapes=False, **given)
    rest, orbit = sb.static(rom, 100.0), sb.periodic(rom, 100.0, 150.0)
    assert rom.frequencies[:3] == pytest.approx([199.0294, 408.8890, 1207.5466], rel=1e-6)
    assert rest.displacement("tip") == pytest.approx(0.7626032e-3, rel=1e-6)
    assert rest.contact_resultant == pytest.approx(1799.68, rel=1e-5) and rest.active.sum() == 54
    harmonics = np.abs(orbit.harmonics("tip")[:4])
    assert harmonics[:3] == pytest.approx([68.334e-6, 1733.56e-6, 29.022e-6], rel=1e-4)
    assert harmonics[3] == pytest.approx(0.2833e-6, rel=1e-2)


@pytest.mark.long
def test_history_beside_calculix(cantilever):
    """4 ms from rest without damping: CalculiX's own integration with gap elements of 1e10 N/m and steps of
    10 us, which are 1e-4 of the peak off themselves; without contact .19.
    """
    time, u = np.loadtxt(FILES / "cantilever_dynamic.csv", delimiter=",").T
    _, mass, stiffness, tip, crack = cantilever
    given = {"loads": tip.weights.T, "sensors": {"tip": tip}, "modes": 80}
    stops = np.full(len(crack.gap), 1e-10)
    rom = sb.reduce_matrices(mass, stiffness, crack.rows, crack.gap, compliance=stops, **given)
    for contact, tolerance in ((True, 5e-4), (False, 0.3)):
        history = sb.transient(rom, sb.Harmonic(10.0, 150.0), time[-1], contact=contact)
        off = np.abs(np.interp(time, history.time, history.displacement("tip")) - u).max() / np.abs(u).max()
        assert off < tolerance and (contact or off > 0.1)
