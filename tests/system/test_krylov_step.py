"""Krylov vectors that are made orthogonal once where twice is not needed."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine, Plate
from sbfem_petsc.petsc import PETSc
from sbfem_petsc.system.solve import krylov_step, modes
from sbfem_petsc.system.solve.krylov_step import KrylovStep
from tests.systems import ALUMINIUM

EDGES = ["left", "right", "top", "bottom"]


def beam():
    return sb.Model(Beam(0.4, 0.005).mesh(order=4), ALUMINIUM)


def free_plate():
    crack = CrackLine([(0.3, 0.5), (0.6, 0.55)])
    return sb.Model(
        Plate([(0, 0), (1, 0), (1, 1), (0, 1)], cracks=[crack]).mesh(order=3), ALUMINIUM, clamped=None
    )


def clamped_square():
    """With many double frequencies."""
    return sb.Model(Beam(1.0, 1.0).mesh(order=3, size=0.125, corners=()), ALUMINIUM, clamped=EDGES)


class Watched(KrylovStep):
    """Keeps SLEPc's vectors and the mass for a look at them."""

    seen: list = []

    def release(self):
        if self.vectors is not None:
            vectors, mass = self.vectors, self.solve.pencil.mass
            _, last = vectors.getActiveColumns()
            columns = []
            for k in range(last):
                column = vectors.getColumn(k)
                product = mass.createVecLeft()
                mass.mult(column, product)
                columns.append((column.array_r.copy(), product.array_r.copy()))
                vectors.restoreColumn(k, column)
            gram = np.array([a for a, _ in columns]) @ np.array([b for _, b in columns]).T
            self.seen.append(gram)
        super().release()


@pytest.mark.parametrize(
    "model, count",
    [
        (beam, 40),
        pytest.param(free_plate, 60, marks=pytest.mark.long),
        (clamped_square, 16),
        (clamped_square, 60),
    ],
)
def test_nearly_orthogonal_is_enough(monkeypatch, model, count):
    """The vectors are orthogonal to 1e-15 / SHARE**ONCE = 1.5e-11, the frequencies those of SLEPc's own
    process to that or to what its residuals leave.
    """
    Watched.seen = []
    monkeypatch.setattr(modes, "KrylovStep", Watched)
    with model() as body:
        found = sb.modal(body, count)
    gram = Watched.seen[-1]
    assert len(gram) >= count
    assert np.abs(gram - np.eye(len(gram))).max() < 1.5e-11
    options = PETSc.Options()
    options.setValue("modal_bv_orthog_refine", "always")
    try:
        Watched.seen = []
        with model() as body:
            expected = sb.modal(body, count)
    finally:
        options.delValue("modal_bv_orthog_refine")
    assert not Watched.seen  # the option was left alone
    scale = np.maximum(expected.frequencies, 1e-3 * expected.frequencies[-1])  # rigid-body modes
    assert np.abs(found.frequencies / scale - expected.frequencies / scale).max() < 1e-10


def test_restarts_save_solves(monkeypatch):
    """Fewer solves than by SLEPc's own restart, and the same frequencies."""

    class Counted(KrylovStep):
        taken: list = []

        def release(self):
            self.taken.append(self.steps)
            super().release()

    monkeypatch.setattr(modes, "KrylovStep", Counted)
    options = PETSc.Options()
    with beam() as body:
        found = modes.lowest_modes(body, 20)
        options.setValue("modal_eps_krylovschur_restart", 0.5)
        try:
            expected = modes.lowest_modes(body, 20)
        finally:
            options.delValue("modal_eps_krylovschur_restart")
    ours, slepcs = Counted.taken
    assert ours <= 0.92 * slepcs  # 43 and 49 were counted
    assert np.abs(found.frequencies / expected.frequencies - 1.0).max() < 1e-10


def test_bands():
    """With a shift far above the lowest modes, those of a free body among them, SLEPc's own process is left
    to itself.
    """
    with sb.Model(Plate([(0, 0), (1, 0), (1, 1), (0, 1)]).mesh(order=2), ALUMINIUM, clamped=None) as body:
        found = sb.modal(body, band=(0.0, 2500.0))
        expected = sb.modal(body, len(found.frequencies))
        assert found.residuals.max() < 1e-5  # which modes are held to; of rigid ones it is round-off
        assert found.residuals[3:].max() < 1e-10
        # of the auxiliary unknowns not the same ones are left out
        np.testing.assert_allclose(found.frequencies[3:], expected.frequencies[3:], rtol=1e-7)


@pytest.mark.long
def test_lost_orthogonality_is_told(monkeypatch):
    """Made orthogonal once throughout, vectors lose it, and the modes' residuals tell."""
    monkeypatch.setattr(krylov_step, "ONCE", 10**6)
    monkeypatch.setattr(krylov_step, "SHARE", 1e-3)
    with beam() as body, pytest.raises(sb.SolveError, match="residual|found"):
        sb.modal(body, 100)
