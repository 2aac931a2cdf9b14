"""The unreduced model against the reduced one, its order in the step, damping, energy and solver options."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam
from sbfem_petsc.analysis.full_transient import rayleigh_factors
from tests.reference import paper_beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
LOAD = sb.PointForce("A", fy=sb.ToneBurst(6000.0, 3000, 5))


@pytest.fixture(scope="module")
def model():
    return sb.Model(paper_beam().mesh(order=3, size=0.02, tip_size=2e-4), ALUMINIUM)


def relative(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


def test_reduced_history_converges_to_the_full_one(model):
    """Both by Newmark at one step: more modes come closer, and what is left is the contact nodes' mass and the implicit contact."""
    full = sb.transient(model, LOAD, 0.002, step=2e-6, reduction=None)
    assert full.contact_resultant.max() > 1000
    gaps = [relative(sb.transient(model, LOAD, 0.002, step=2e-6, scheme="newmark", modes=modes).displacement("A"), full.displacement("A")) for modes in (10, 40, 160)]
    assert gaps[0] > 3 * gaps[1] > 0 and gaps[2] < 2e-4


def test_second_order_in_the_step(model):
    """Towards the reduced model's exact steps: a factor of 4 a halving."""
    exact = sb.transient(model, LOAD, 0.002, step=0.5e-6, modes=160)
    far = []
    for step in (4e-6, 2e-6):
        history = sb.transient(model, LOAD, 0.002, step=step, reduction=None)
        reference = np.column_stack([np.interp(history.time, exact.time, exact.displacement("A")[:, k]) for k in (0, 1)])
        far.append(relative(history.displacement("A"), reference))
    assert far[0] / far[1] == pytest.approx(4, rel=0.2)


def test_energy(model):
    """Stored energy equals the work done but for what contact dissipates, and contact never feeds energy in."""
    history = sb.transient(model, LOAD, 0.003, step=1e-6, reduction=None, decimation=5)
    lost = history.external - history.kinetic - history.strain
    assert lost.min() > -1e-6 * history.external.max()
    assert lost[-1] < 1e-3 * history.external.max()
    assert (history.contact_force >= 0).all() and history.gap.min() > -1e-15


def test_rayleigh_damping_meets_its_ratio():
    """Free decay after a short burst at the first mode: the logarithmic decrement is that of the damping ratio."""
    model = sb.Model(Beam(0.1, 0.005).mesh(order=3, corners=()), ALUMINIUM, damping=0.02)
    frequency = sb.modal(model, 1).frequencies[0]
    a, b = rayleigh_factors(model, 5 * frequency)
    for f in (frequency, 5 * frequency):
        assert a / (4 * np.pi * f) + b * np.pi * f == pytest.approx(0.02, rel=1e-9)
    period = 1 / frequency
    history = sb.transient(model, sb.PointForce("A", fy=sb.ToneBurst(1.0, frequency, 4)), 30 * period, step=period / 200, reduction=None)
    u = np.abs(history.displacement("A")[:, 1])
    swing = [u[(history.time >= k * period) & (history.time < (k + 1) * period)].max() for k in (8, 24)]
    assert np.log(swing[0] / swing[1]) / (2 * np.pi * 16) == pytest.approx(0.02, rel=0.02)


def test_papers_scheme_is_there_to_be_compared_with(model):
    """Eqs. (28)-(34): pairs tied with tension allowed; without contact it is the same Newmark."""
    paper, implicit = (sb.transient(model, LOAD, 0.002, step=2e-6, reduction=None, scheme=scheme) for scheme in ("paper", "exact"))
    assert (paper.contact_force < 0).any()
    quiet = sb.PointForce("A", fy=sb.ToneBurst(0.01, 3000, 5))
    paper, implicit = (sb.transient(model, quiet, 0.001, step=2e-6, reduction=None, scheme=scheme) for scheme in ("paper", "exact"))
    np.testing.assert_array_equal(paper.displacement("A"), implicit.displacement("A"))


def test_options_reach_the_solve(model):
    """Conjugate gradients under -newmark_ give the direct solver's history; an impossible limit is an error that names it."""
    from sbfem_petsc.petsc import PETSc

    options = PETSc.Options()
    direct = sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None).displacement("A")
    given = {"newmark_ksp_type": "cg", "newmark_pc_type": "icc"}
    for name, value in given.items():
        options.setValue(name, value)
    try:
        np.testing.assert_allclose(sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None).displacement("A"), direct, atol=1e-7 * np.abs(direct).max())
        options.setValue("newmark_ksp_max_it", "1")
        with pytest.raises(sb.SolveError, match="transient: the linear solve did not converge.*newmark_ksp"):
            sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None)
    finally:
        for name in (*given, "newmark_ksp_max_it"):
            options.delValue(name)


def test_equilibrium_start_is_for_the_reduced_model(model):
    with pytest.raises(ValueError, match="starts from rest"):
        sb.transient(model, LOAD, 1e-4, reduction=None, start="equilibrium")
