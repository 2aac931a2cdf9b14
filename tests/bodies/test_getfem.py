"""Files that getfem 5.4 wrote of a plate of shear-flexible elements, whose rotations have no mass."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import nnls

import sbfem_petsc as sb

FILES = Path(__file__).parent / "getfem"


def plate():
    """300 x 60 x 4 mm of steel, held at x = 0; along z and two rotations."""
    names = ("plate_k.mtx", "plate_m.mtx", "plate_nodes.inp", "plate_unknowns.txt")
    return sb.read_matrices(*(FILES / name for name in names))


def test_frequency_and_mass():
    """The first one is that of a beam or, at most, of a plate that cannot bend across."""
    body = plate()
    rom = sb.reduce(body, loads={"F": body.at(12, "z")}, points={"tip": body.at(12, "z")}, modes=3)
    beam = 1.875104**2 / (2 * np.pi * 0.3**2) * np.sqrt(210e9 * 0.004**2 / (12 * 7850.0))
    assert beam < rom.frequencies[0] < 1.01 * beam / np.sqrt(1 - 0.3**2)
    assert len(body.unknowns) == 30 and len(body.fixed) == 12


def test_unknowns_as_editors_of_windows_save_them(tmp_path):
    """With a byte order mark, which had been refused."""
    text = (FILES / "plate_unknowns.txt").read_text()
    (tmp_path / "unknowns.txt").write_text(text, encoding="utf-8-sig")
    names = ("plate_k.mtx", "plate_m.mtx", "plate_nodes.inp")
    body = sb.read_matrices(*(FILES / name for name in names), tmp_path / "unknowns.txt")
    assert body.unknowns.tolist() == plate().unknowns.tolist()


def test_shells_by_an_offset():
    """Two plates, midplanes 4.5 mm apart, the upper one pressed down: gaps of .5 mm, frequencies, deflection
    and forces of dense matrices, in which rotations are condensed and forces solve a complementarity problem.
    """
    lower = plate()
    raised = {int(label): place + [0.0, 0.0, 0.0045] for label, place in zip(lower.labels, lower.places)}
    upper = sb.FiniteElementModel(lower.mass, lower.stiffness, lower.unknowns, raised, fixed=lower.fixed)
    both = sb.join(lower, upper)
    free = np.unique(both.unknowns[:, 0])
    low, high = (free[both.places[np.searchsorted(both.labels, free), 2] == z] for z in (0.0, 0.0045))
    contact = both.contact(low, high, normal="z", offset=0.004)
    assert contact.gap == pytest.approx(np.full(10, 5e-4), rel=1e-9)
    tip = both.at((0.3, 0.06, 0.0045), "z")
    rom = sb.reduce(both, contact=contact, loads={"F": tip}, points={"tip": tip}, modes=8)

    k, m = both.stiffness.toarray(), both.mass.toarray()
    heavy = m.diagonal() > 0.0
    assert heavy.sum() == 20
    follow = -np.linalg.solve(k[np.ix_(~heavy, ~heavy)], k[np.ix_(~heavy, heavy)])
    condensed = k[np.ix_(heavy, heavy)] + k[np.ix_(heavy, ~heavy)] @ follow
    own = scipy.linalg.eigh(condensed, m[np.ix_(heavy, heavy)], eigvals_only=True)[:8]
    assert rom.omega**2 == pytest.approx(own, rel=1e-7)
    rows, force = contact.rows.toarray(), -4.0 * tip.weights.toarray().ravel()
    u = np.linalg.solve(k, np.column_stack([force, rows.T]))
    root = np.linalg.cholesky(rows @ u[:, 1:]).T
    pressed = nnls(root, -np.linalg.solve(root.T, contact.gap + rows @ u[:, 0]))[0]
    found = sb.static(rom, -4.0)
    assert 0 < (pressed > 0.0).sum() < 10 and found.active.tolist() == (pressed > 0.0).tolist()
    assert found.contact_resultant == pytest.approx(pressed.sum(), rel=1e-6)
    right = (tip.weights @ (u[:, 0] + u[:, 1:] @ pressed)).item()
    assert float(found.displacement("tip")) == pytest.approx(right, rel=1e-7)
