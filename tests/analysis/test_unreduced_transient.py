"""The unreduced model against the reduced one, its order in the step, damping, energy and solver options."""

import tracemalloc

import numpy as np
import pytest

import sbfem_petsc as sb
from examples.paper.time_scheme import integrate
from meshing import Beam, VNotch
from sbfem_petsc.motion.integration import Steps
from sbfem_petsc.motion.unreduced import steps as unreduced_steps
from sbfem_petsc.motion.unreduced.steps import UnreducedSteps
from sbfem_petsc.system.solve.pencil import Pencil
from tests.parallel import alone, answer, on_ranks
from tests.reference import paper_beam

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
LOAD = sb.PointForce("A", fy=sb.ToneBurst(6000.0, 3000, 5))


@pytest.fixture(scope="module")
def model():
    return sb.Model(paper_beam().mesh(order=3, size=0.02, tip_size=2e-4), ALUMINIUM)


def relative(found, exact):
    return np.linalg.norm(found - exact) / np.linalg.norm(exact)


@pytest.mark.long
def test_reduced_history_converges_to_the_full_one(model):
    """Both by Newmark at one step: more modes come closer, and what is left is the contact nodes' mass and
    the implicit contact.
    """
    full = sb.transient(model, LOAD, 0.002, step=2e-6, reduction=None)
    assert full.contact_resultant.max() > 1000
    gaps = [
        relative(
            sb.transient(model, LOAD, 0.002, step=2e-6, scheme="newmark", modes=modes).displacement("A"),
            full.displacement("A"),
        )
        for modes in (10, 40, 160)
    ]
    assert gaps[0] > 3 * gaps[1] > 0 and gaps[2] < 2e-4


@pytest.mark.slow
def test_second_order_in_the_step(model):
    """Towards the reduced model's exact steps: a factor of 4 a halving, and near to them."""
    exact = sb.transient(model, LOAD, 0.002, step=1e-6, modes=160)
    far = []
    for step in (4e-6, 2e-6):
        history = sb.transient(model, LOAD, 0.002, step=step, reduction=None)
        reference = np.column_stack(
            [np.interp(history.time, exact.time, exact.displacement("A")[:, k]) for k in (0, 1)]
        )
        far.append(relative(history.displacement("A"), reference))
    assert far[0] / far[1] == pytest.approx(4, rel=0.2)
    assert far[1] < 0.0025  # measured: 0.0019
    force = np.interp(history.time, exact.time, exact.contact_resultant)
    assert relative(history.contact_resultant, force) < 0.04  # of first order; measured: 0.033


def test_contact_by_a_second_solve(model, monkeypatch):
    """Many contact rows: the forces are solved for with the loads, instead of responses that are kept."""
    load, found = sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0, phase=1.0)), []
    for kept in (200, 0):
        monkeypatch.setattr(unreduced_steps, "KEPT_RESPONSES", kept)
        history = sb.transient(model, load, 1e-4, 5e-6, initial="equilibrium", reduction=None)
        found.append((history.displacement("A"), history.contact_force, history.energy.total))
    assert found[0][1].max() > 1.0
    for one, other in zip(*found):
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-10 * np.abs(one).max())


def test_memory_of_many_contact_rows(monkeypatch):
    """No array with a column for each contact row, but up to three of a block of them, and one of the rows by
    themselves.
    """
    notches = [VNotch(x, 0.005, 0.0) for x in (0.02, 0.04, 0.06, 0.08)]
    model = sb.Model(Beam(0.1, 0.01, notches).mesh(order=3), ALUMINIUM)
    rows, pencil = len(model.contact), Pencil(model.statics, 1.0, 0.0)
    march = UnreducedSteps(model, pencil, [], Steps(1, 1e-6, True, "implicit", 1), None)
    monkeypatch.setattr(unreduced_steps, "block_width", lambda _: 8)

    def columns() -> float:
        tracemalloc.start()
        try:
            march._respond()
            return tracemalloc.get_traced_memory()[1] / (8 * model.unknowns)
        finally:
            tracemalloc.stop()

    assert columns() > rows > 100
    monkeypatch.setattr(unreduced_steps, "KEPT_RESPONSES", 0)
    assert columns() < 3 * 8 + 2 * rows**2 / model.unknowns
    march.release()
    pencil.destroy()


@pytest.mark.long
def test_energy(model):
    """Stored energy equals the work done but for what contact dissipates, and contact never feeds energy
    in.
    """
    history = sb.transient(model, LOAD, 0.003, step=1e-6, reduction=None, decimation=5)
    energy, scale = history.energy, history.energy.external.max()
    assert np.diff(energy.contact).max() < 1e-15 * scale and 0 < -energy.contact[-1] < 1e-3 * scale
    assert np.abs(energy.balance).max() < 1e-9 * scale and energy.damping.max() == 0.0
    assert (history.contact_force >= 0).all() and history.gap.min() > -1e-15


@pytest.mark.long
def test_papers_scheme(model):
    """Eqs. (28)-(34) as the examples have them: with contact energy is not kept; without, they are the steps
    of the unreduced model.
    """
    shape = sb.ToneBurst(6000.0, 3000, 5)
    found = integrate(model, sb.PointForce("A", fy=1.0), shape, 2e-6, 1000)
    assert np.abs(found.energy - found.work).max() > 1e-6 * found.work.max() and found.resultant.max() > 1000
    shape = sb.ToneBurst(0.01, 3000, 5)
    quiet = integrate(model, sb.PointForce("A", fy=1.0), shape, 2e-6, 500)
    implicit = sb.transient(model, sb.PointForce("A", fy=shape), 0.001, step=2e-6, reduction=None).energy
    for one, other in ((quiet.energy, implicit.total), (quiet.work, implicit.external)):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-10 * np.abs(other).max())


@pytest.mark.slow
def test_options_reach_the_solve(model):
    """Conjugate gradients under -newmark_ give the direct solver's history; an impossible limit is an error
    that names it.
    """
    from sbfem_petsc.petsc import PETSc

    options = PETSc.Options()
    direct = sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None).displacement("A")
    given = {"newmark_ksp_type": "cg", "newmark_pc_type": "icc"}
    for name, value in given.items():
        options.setValue(name, value)
    try:
        np.testing.assert_allclose(
            sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None).displacement("A"),
            direct,
            atol=1e-7 * np.abs(direct).max(),
        )
        options.setValue("newmark_ksp_max_it", "1")
        with pytest.raises(sb.SolveError, match="transient: the linear solve did not converge.*newmark_ksp"):
            sb.transient(model, LOAD, 2e-4, step=2e-6, reduction=None)
    finally:
        for name in (*given, "newmark_ksp_max_it"):
            options.delValue(name)


@pytest.mark.long
def test_modal_damping_is_that_of_the_reduced_model(model):
    """zeta = 0.002 in 40 modes, with contact: within 5e-5 of the reduced history, where a M + b K through the
    first mode and the load's frequency is at 5e-4 and more.
    """
    load, mesh = (
        sb.PointForce("A", fy=sb.ToneBurst(600.0, 3000, 12)),
        paper_beam().mesh(order=3, size=0.02, tip_size=2e-4),
    )
    damped, fitted = (
        sb.Model(mesh, ALUMINIUM, damping=0.002, tip_modes=0),
        sb.Model(
            mesh,
            ALUMINIUM,
            rayleigh=sb.rayleigh_factors(sb.modal(model, 1).frequencies[0], 0.002, 3000.0, 0.002),
            tip_modes=0,
        ),
    )
    exact, free = (
        sb.transient(m, load, 0.006, step=2e-6, scheme="newmark", modes=160).displacement("A")
        for m in (damped, model)
    )
    full = sb.transient(damped, load, 0.006, step=2e-6, reduction=None, modes=40)
    assert full.contact_resultant.max() > 1000 and full.damped_modes == 40
    assert relative(free, exact) > 0.05
    assert relative(full.displacement("A"), exact) < 5e-5
    assert (
        relative(sb.transient(fitted, load, 0.006, step=2e-6, reduction=None).displacement("A"), exact) > 5e-4
    )
    assert full.energy.damping[-1] > 0.05 * full.energy.external.max()
    assert np.abs(full.energy.balance).max() < 1e-8 * full.energy.external.max()


@pytest.mark.long
def test_contact_inside_the_tip_element_is_of_first_order_in_the_step():
    """The force of a step is its mean, and the tip element's own flexibility gives way to it at the step's
    end: the distance to the reduced history halves with the step, and is 1e-6 without those rows.
    """
    load = sb.PointForce("A", fy=sb.ToneBurst(600.0, 3000, 12))
    model = sb.Model(
        paper_beam().mesh(order=3, size=0.02, tip_size=2e-4, face_edges=1), ALUMINIUM, damping=0.002
    )
    errors = []
    for step in (2e-6, 1e-6):
        reduced = sb.transient(model, load, 0.003, step, scheme="newmark", modes=160)
        unreduced = sb.transient(model, load, 0.003, step, reduction=None, modes=40)
        errors.append(relative(unreduced.displacement("A"), reduced.displacement("A")))
    assert errors[0] < 3e-5
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)


@pytest.mark.long
def test_damping_matrix_of_mass_and_stiffness():
    """Both kinds together are those of the reduced model's ratios, with the same energy lost."""
    model = sb.Model(
        paper_beam().mesh(order=3, size=0.02, tip_size=2e-4), ALUMINIUM, damping=0.002, rayleigh=(50.0, 2e-8)
    )
    full, reduced = (
        sb.transient(model, LOAD, 0.003, step=2e-6, reduction=None),
        sb.transient(model, LOAD, 0.003, step=2e-6, scheme="newmark", modes=160),
    )
    np.testing.assert_allclose(
        reduced.reduced.damping,
        0.002 + 25.0 / reduced.reduced.omega + 1e-8 * reduced.reduced.omega,
        rtol=1e-12,
    )
    assert relative(full.displacement("A"), reduced.displacement("A")) < 3e-4
    assert full.energy.damping[-1] == pytest.approx(reduced.energy.damping[-1], rel=0.01)
    assert np.abs(full.energy.balance).max() < 1e-8 * full.energy.external.max()
    assert "50 1/s M + 2e-08 s K" in repr(model)


@pytest.mark.long
@pytest.mark.parametrize("modal", [True, False])
def test_decrement(modal):
    """Free decay after a short burst at the first mode: the logarithmic decrement is that of the ratio, by
    modes or by a M + b K.
    """
    mesh = Beam(0.1, 0.005).mesh(order=3, corners=())
    frequency = sb.modal(sb.Model(mesh, ALUMINIUM), 1).frequencies[0]
    a, b = sb.rayleigh_factors(frequency, 0.02, 5 * frequency, 0.02)
    for f in (frequency, 5 * frequency):
        assert a / (4 * np.pi * f) + b * np.pi * f == pytest.approx(0.02, rel=1e-9)
    model = sb.Model(mesh, ALUMINIUM, damping=0.02) if modal else sb.Model(mesh, ALUMINIUM, rayleigh=(a, b))
    period = 1 / frequency
    history = sb.transient(
        model,
        sb.PointForce("A", fy=sb.ToneBurst(1.0, frequency, 4)),
        30 * period,
        step=period / 200,
        reduction=None,
    )
    u = np.abs(history.displacement("A")[:, 1])
    swing = [u[(history.time >= k * period) & (history.time < (k + 1) * period)].max() for k in (8, 24)]
    assert np.log(swing[0] / swing[1]) / (2 * np.pi * 16) == pytest.approx(0.02, rel=0.02)


@pytest.mark.parametrize(
    "value, error",
    [
        ((-1.0, 0.0), ValueError),
        ((0.0, float("nan")), ValueError),
        (0.1, TypeError),
        ((1.0,), ValueError),
        (("1", 0.0), TypeError),
    ],
)
def test_bad_rayleigh_factors(value, error):
    with pytest.raises(error, match="rayleigh"):
        sb.Model(Beam(0.1, 0.005).mesh(order=2), ALUMINIUM, rayleigh=value)


@pytest.mark.slow
def test_start_at_equilibrium(model):
    """Under a constant load nothing moves, contact included."""
    load = sb.PointForce("A", fy=300.0)
    history, static = (
        sb.transient(model, load, 2e-4, step=1e-6, reduction=None, initial="equilibrium"),
        sb.static(model, load),
    )
    u = history.displacement("A")
    assert static.contact_resultant > 1000
    np.testing.assert_allclose(u, np.broadcast_to(static.displacement("A"), u.shape), rtol=1e-7)
    np.testing.assert_allclose(
        history.contact_force,
        np.broadcast_to(static.contact_force, history.contact_force.shape),
        atol=1e-5 * static.contact_force.max(),
    )
    factors = np.array(static.stress_intensity["crack1"])  # K_I of the closed notch is what rounding leaves
    np.testing.assert_allclose(history.stress_intensity()[-1], factors, atol=1e-6 * np.abs(factors).max())


@pytest.mark.long
def test_start_from_functions_of_position():
    """A turning body on hardly any springs: kinetic energy of rigid motion, in both models; a bent one: the
    same history.
    """
    soft = sb.Model(
        Beam(0.4, 0.005).mesh(order=3), ALUMINIUM, clamped=None, supports=[sb.Support("left", x=1e6, y=1e6)]
    )
    load, spin = sb.PointForce("A", fy=0.0), 3.0
    start = (None, lambda x, y: (-spin * y, 2.0 + spin * x))
    inertia = (
        2700 * 0.4 * 0.005 * np.array([1.0, 0.2, (0.4**2 + 0.005**2) / 3])
    )  # mass, first moment about y, polar moment about the origin
    energy = 0.5 * (inertia[0] * 4.0 + 2 * 2.0 * spin * inertia[0] * 0.2 + inertia[2] * spin**2)
    full, reduced = (
        sb.transient(soft, load, 1e-4, step=1e-6, initial=start, reduction=r) for r in (None, "modes")
    )
    assert full.energy.kinetic[0] == pytest.approx(energy, rel=1e-9) and reduced.energy.kinetic[
        0
    ] == pytest.approx(energy, rel=1e-6)
    assert full.velocity("A")[0] == pytest.approx([-spin * 0.005, 2.0 + spin * 0.4], rel=1e-9)
    clamped = sb.Model(Beam(0.4, 0.005).mesh(order=3), ALUMINIUM)
    bent = (lambda x, y: (-0.01 * x * (y - 0.0025), 0.005 * x**2), lambda x, y: (0.0 * x, x**2))
    full, reduced = (
        sb.transient(
            clamped, load, 0.01, step=5e-6, scheme="newmark" if r else "exact", initial=bent, reduction=r
        )
        for r in (None, "modes")
    )
    assert relative(reduced.displacement("A"), full.displacement("A")) < 2e-4
    again = sb.transient(reduced.reduced, load, 1e-4, step=5e-6, scheme="newmark", initial=bent)
    np.testing.assert_allclose(again.states.q, reduced.states.q[:21], atol=1e-12)
    for given in ((lambda x, y: x, None), (lambda x, y: (x, y / 0.0 * 0.0), None), (lambda x, y: None, None)):
        with (
            np.errstate(all="ignore"),
            pytest.raises(ValueError, match="displacement of initial must be a function"),
        ):
            sb.transient(clamped, load, 1e-4, step=1e-6, reduction=None, initial=given)
    with pytest.raises(ValueError, match="functions of x and y"):
        sb.transient(clamped, load, 1e-4, step=1e-6, reduction=None, initial=(np.zeros(3), np.zeros(3)))


def test_moving_supports_of_a_loose_body():
    """It stays behind as a whole, u = -a t^2 / 2, without any strain: the inertia of the auxiliary unknowns
    is part of the load.
    """
    loose = sb.Model(
        Beam(0.1, 0.02).mesh(order=3), ALUMINIUM, clamped=None, supports=[sb.Support("left", x=1.0, y=1.0)]
    )
    history = sb.transient(loose, sb.SupportMotion(ay=2.0), 1e-4, step=1e-6, reduction=None)
    np.testing.assert_allclose(history.displacement("A")[:, 1], -(history.time**2), rtol=1e-6, atol=1e-18)
    assert history.energy.strain[-1] < 1e-9 * history.energy.kinetic[-1]
    np.testing.assert_allclose(history.acceleration("A")[:, 1], -2.0, rtol=1e-6)


@pytest.mark.slow
def test_acceleration(model):
    """It is the derivative of the velocity, second order in the step, and in a smooth motion that of the
    reduced model.
    """
    load = sb.SupportMotion(ay=sb.ToneBurst(1.0, 500, 2))
    errors = []
    for step in (1e-5, 5e-6):
        history = sb.transient(model, load, 0.004, step=step, reduction=None)
        slope = np.gradient(history.velocity("A")[:, 1], history.time)[2:-2]
        errors.append(np.abs(history.acceleration("A")[2:-2, 1] - slope).max() / np.abs(slope).max())
    assert errors[0] < 0.02 and errors[1] < 0.4 * errors[0]
    reduced = sb.transient(model, load, 0.004, step=5e-6, scheme="newmark")
    assert relative(history.acceleration("A")[:, 1], reduced.acceleration("A")[:, 1]) < 0.01
    assert relative(history.displacement("A")[:, 1], reduced.displacement("A")[:, 1]) < 1e-5
    with pytest.raises(KeyError, match="point 'Q'"):
        history.acceleration("Q")
    with pytest.raises(KeyError, match="crack tip .c."):
        history.stress_intensity("c")


RANKS = """
import json
import sbfem_petsc as sb
from mpi4py import MPI
from tests.reference import paper_beam
mesh = paper_beam().mesh(order=3, size=0.02, tip_size=2e-4)
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.002, rayleigh=(5.0, 1e-9))
load, found = sb.PointForce("A", fy=sb.ToneBurst(6000.0, 3000, 5)), {}
begin = (None, lambda x, y: (0.0 * x, 1e-3 * x))
for name, options in (("reduced", {}), ("unreduced", {"reduction": None, "initial": begin})):
    h = sb.transient(model, load, 0.001, step=2e-6, modes=40, **options)
    found[name] = {
        "u": h.displacement("A").tolist(),
        "a": h.acceleration("B").tolist(),
        "force": h.contact_force.tolist(),
        "energy": h.energy.total.tolist(),
        "K": h.stress_intensity().tolist(),
        "touching": (h.contact_force > 0).tolist(),
    }
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.long
def test_histories_on_several_ranks():
    """Reduced from rest and unreduced with a velocity, with contact and both kinds of damping: within 1e-6
    (2e-9 is met), the same pairs in contact at the same instants.
    """
    found, expected = answer(on_ranks(3, RANKS)), alone(RANKS)
    assert np.max(expected["unreduced"]["force"]) > 100
    for name, history in expected.items():
        assert found[name].pop("touching") == history["touching"]
        for quantity, values in found[name].items():
            np.testing.assert_allclose(
                values,
                history[quantity],
                rtol=0,
                atol=1e-6 * np.abs(history[quantity]).max(),
                err_msg=f"{name} {quantity}",
            )


def test_any_point(tmp_path):
    """Displacement and stress at any place: those of statics where a motion starts from equilibrium, with
    contact and a pressure on the faces inside the tip's S-element, and those of a named point in between.
    """
    model = sb.Model(paper_beam().mesh(order=3, size=0.02, tip_size=2e-4), ALUMINIUM, damping=0.01)
    load = sb.PointForce("A", fy=100.0) + sb.EdgeLoad("crack1_left", pressure=1e5)
    still = sb.static(model, load)
    assert still.contact_resultant > 100
    history = sb.transient(model, load, 1e-5, step=1e-6, initial="equilibrium", reduction=None)
    for place in ((0.05, 0.001), (0.08005, 0.00253), (0.0801, 0.00249)):
        for kind in ("displacement", "stress"):
            exact, found = getattr(still, kind)(place), getattr(history, kind)(place)
            assert np.abs(found - exact).max() < 2e-6 * np.abs(exact).max()
    _, u, stress = history.along((0.03, 0.001), (0.06, 0.002), count=3)
    _, *exact = still.along((0.03, 0.001), (0.06, 0.002), count=3)
    assert np.abs(u - exact[0]).max() < 2e-6 * np.abs(exact[0]).max()
    assert np.abs(stress - exact[1]).max() < 2e-6 * np.abs(exact[1]).max()
    assert np.abs(np.array(history.field(0.0)) - still.field).max() < 1e-9 * np.abs(still.field).max()
    load = sb.PointForce("A", fy=100.0) + sb.EdgeLoad("crack1_left", pressure=sb.Harmonic(1e6, 5e4))
    pressed = sb.transient(model, load, 2e-6, step=1e-6, initial="equilibrium", reduction=None)
    inside = pressed.states.contact[:, pressed.states.pairs :]
    assert np.abs(np.diff(inside, axis=0)).max(axis=1).min() > 0.01 * inside.max() > 0.0
    assert pressed.field(2e-6).tip_forces[0][: inside.shape[1]] == pytest.approx(inside[2])
    place = model.points["A"][0]
    run = {"duration": 5e-5, "step": 1e-6, "decimation": 5, "reduction": None, "modes": 10}
    file = tmp_path / "history.h5"
    moving = sb.transient(model, LOAD, file=file, **run)
    named = moving.displacement("A")
    assert np.abs(moving.displacement(place) - named).max() < 1e-9 * np.abs(named).max()
    with pytest.raises(
        sb.SolveError, match="displacement: a motion of an unreduced model keeps its fields up to"
    ):
        sb.read(file).displacement(place)
    with pytest.raises(sb.SolveError, match="keeps velocities and accelerations of named points"):
        moving.velocity(place)
    with pytest.raises(sb.UnknownName, match="crack tip 0 does not exist"):
        moving.stress_intensity(0)
    with pytest.raises(ValueError, match="lies outside the structure"):
        moving.stress((1.0, 0.0))
    with pytest.raises(sb.UnknownName, match="point 'Z' does not exist"):
        moving.displacement("Z")
