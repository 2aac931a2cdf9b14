"""Histories with friction: events located by another integration, each step by enumeration, states that
follow each other slowly, energies, and what is kept in files.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.linalg import expm

import sbfem_petsc as sb
from sbfem_petsc.contact.complementarity import Complementarity
from sbfem_petsc.contact.friction import AGAINST, ALONG, STICKS, Friction, Memory, rubbing_of
from sbfem_petsc.contact.friction_solve import solve_friction
from sbfem_petsc.contact.law import FREE, RowLaws
from sbfem_petsc.contact.marching import march
from sbfem_petsc.contact.problem import Problem, empty_sets
from sbfem_petsc.contact.rubbing import rubbing_forces
from sbfem_petsc.contact.step_data import NEVER, StepHistory
from sbfem_petsc.motion import reduced_history
from sbfem_petsc.motion.integration import Steps
from tests.contact.test_friction import check, enumerated, problem, square

FRICTION, PRESSURE, SPRING, SLIDER = 0.3, 2.0 / 1.01, 4.0, 6.0


# ---------------------------------------------------------------------- kernel
@pytest.mark.parametrize("count", [30, pytest.param(500, marks=pytest.mark.long)])
def test_sequences_of_random_problems(count):
    """The compiled solve finds a solution of each with coefficients up to 0.5, the same as NumPy's; with
    those up to 1.5, where Lemke's method is missed, of nearly all, and tells of the others.
    """
    rng, unsolved = np.random.default_rng(11), 0
    for _ in range(count):
        rows, most = int(rng.integers(1, 21)), rng.choice([0.5, 1.5])
        flexibility, friction = problem(rng, rows, most)
        laws, rubbing = RowLaws.unilateral(rows), rubbing_of(friction, flexibility, rows)
        memory, sets = Memory.none(laws, friction), empty_sets(2 * rows)
        state, force, before = np.zeros(2 * rows, dtype=np.int8), np.zeros(2 * rows), np.zeros(2 * rows)
        for _ in range(3):
            free = 1e-6 * rng.normal(size=2 * rows)
            given = Problem(flexibility, free, before, laws.table, rubbing, state, sets, force)
            if rubbing_forces(given) < 0:
                assert most == 1.5
                unsolved += 1
                break
            gap = flexibility @ force + free
            check(flexibility, free, friction, memory, Complementarity(force, gap, state, 1))
            if most == 0.5:
                alone = solve_friction(flexibility, free, laws, friction, memory)
                assert force == pytest.approx(alone.force, abs=1e-9 * np.abs(force).max())
            before[rows:] = np.where(state[rows:] == STICKS, before[rows:], sets.free[rows:])
            memory = memory._replace(slip=before[rows:].copy())
    assert unsolved <= 3e-3 * count


# ---------------------------------------------------------------------- few rows
def slider(**given):
    """A mass on a spring and an elastic slider, beside one that presses it with a force that stays."""
    law = given.pop("contact_laws", sb.Coulomb(FRICTION))
    along = {"tangent_rows": np.array([[1.0, 0.0]]), "tangent_compliance": [1.0 / SLIDER]}
    return sb.reduce_matrices(
        np.eye(2),
        np.diag([SPRING, 10.0]),
        np.array([[0.0, 1.0]]),
        np.zeros(1),
        loads=np.eye(2),
        sensors={"x": 0},
        compliance=[1e-3],
        contact_laws=law,
        **({} if law is None else along),
        **given,
    )


def jenkins(amplitude, rate, times):
    """`pushed` by one tone."""
    return pushed(lambda t: amplitude * math.sin(rate * t), times)


def pushed(push, times, drag=0.0):
    """Displacement of the mass under a force of time and work lost: each state by itself, its end located."""
    bound = FRICTION * PRESSURE
    t, y, rests, way = 0.0, np.zeros(2), 0.0, 0
    x, lost = np.zeros(len(times)), 0.0
    while True:

        def rates(t, y, way=way, rests=rests):
            pull = -way * bound if way else -SLIDER * (y[0] - rests)
            return [y[1], push(t) - drag * y[1] - SPRING * y[0] + pull]

        events = [lambda t, y: y[1]]
        if not way:
            events = [lambda t, y, s=s, z=rests: s * SLIDER * (y[0] - z) - bound for s in (1, -1)]
        for event in events:
            event.terminal, event.direction = True, -way or 1
        found = solve_ivp(
            rates, (t, times[-1]), y, "DOP853", rtol=1e-11, atol=1e-13, events=events, dense_output=True
        )
        inside = (times >= t) & (times <= found.t[-1])
        x[inside] = found.sol(times[inside])[0]
        t, start, y = found.t[-1], y, found.y[:, -1]
        if way:
            lost += bound * abs(y[0] - start[0])
        if found.status == 0:
            return x, lost
        rests, way = (y[0] - way * bound / SLIDER, 0) if way else (rests, 1 if len(found.t_events[0]) else -1)


def test_elastic_slider_against_located_events():
    """Errors fall with the step; the loss is the other integration's, and the energies are in balance."""
    reduced, errors = slider(), []
    for step in (0.02, 0.01):
        load = [sb.Harmonic(1.0, 1.7 / (2.0 * math.pi)), -2.0]
        found = sb.transient(reduced, load, 15.0, step, initial="equilibrium")
        x, lost = jenkins(1.0, 1.7, found.time)
        errors.append(np.abs(found.displacement("x")[:, 1] - x).max() / np.abs(x).max())
        energy = found.energy
        assert energy.friction[-1] == pytest.approx(lost, rel=2e-3)
        assert (np.diff(energy.friction) >= 0.0).all()
        assert np.abs(energy.balance).max() < 1e-7 * lost and np.abs(energy.contact).max() < 1e-5 * lost
        assert found.contact_force == pytest.approx(PRESSURE)
        assert np.abs(found.friction_force).max() == pytest.approx(FRICTION * PRESSURE)
        slips = np.diff(found.slip[:, 0]) != 0.0
        assert 0.0 < slips.mean() < 1.0
        pulls = found.friction_force[1:, 0][slips] * np.diff(found.slip[:, 0])[slips]
        assert (pulls < 1e-15).all()
    assert errors[0] < 3e-4 and errors[1] < 0.5 * errors[0]


def test_friction_that_falls_where_a_slip_begins():
    """What is lost as it falls from the static to the kinetic one is friction's, not the contact's work: the
    balance of energies is its oracle, and no step is halved in vain.
    """
    load = [sb.Harmonic(1.0, 1.7 / (2.0 * math.pi)), -2.0]
    reduced = slider(contact_laws=sb.Coulomb(FRICTION, 1.5 * FRICTION))
    energy = sb.transient(reduced, load, 15.0, 0.01, initial="equilibrium").energy
    lost = energy.friction[-1]
    assert lost > 0.1 and (np.diff(energy.friction) >= 0.0).all()
    assert np.abs(energy.contact).max() < 1e-4 * lost and np.abs(energy.balance).max() < 1e-6 * lost


def test_states_and_slips_of_each_step():
    """Where asked the steps leave them, as what the history tells later."""
    reduced, steps = slider(), Steps(500, 0.02, True, "exact", 1)
    drive = [sb.Harmonic(1.0, 1.7 / (2.0 * math.pi)), sb.Step(-2.0)]
    found = sb.transient(reduced, drive, 10.0, 0.02)
    run = reduced_history.ReducedIntegrator(reduced, drive, steps, "rest")
    amplitudes = np.stack([signal(found.time) for signal in drive], axis=1)
    history = StepHistory(
        *(np.empty((500, n)) for n in (2, 2, 2)),
        np.empty(500),
        rows=np.empty((500, 2), dtype=np.int8),
        kept=np.empty(1),
    )
    march(run.constants, run._driven(amplitudes), run.state, history)
    assert history.kept == pytest.approx(found.slip[-2], abs=1e-12)
    assert np.array_equal(history.rows[:, 0] != FREE, found.contact_force[1:, 0] > 0.0)
    stays = np.abs(np.diff(found.slip[:, 0])) < 1e-12
    assert np.array_equal(history.rows[:, 1] == STICKS, stays & (history.rows[:, 0] != FREE))
    assert set(history.rows[:, 1].tolist()) >= {STICKS, ALONG, AGAINST}


@pytest.mark.parametrize("later", [0.0, 0.35, 0.7, 0.95])
@pytest.mark.parametrize("pull", [0.5, 0.8])
def test_a_landing_in_closed_form(pull, later):
    """A mass lands aslant on an elastic layer, at an instant inside a step. It sticks under a friction of so
    many times the pressure all the while, beyond the coefficient of slips too, and rebounds with its speeds
    reversed; nothing is lost.
    """
    compliance, steps = 0.02, 200
    half = math.pi * math.sqrt(compliance)
    step = half / steps
    body = sb.reduce_matrices(
        np.eye(2),
        1e-8 * np.eye(2),
        [[1.0, 0.0]],
        [(0.25 * steps + later) * step],
        loads=np.eye(2),
        sensors={"x": 0, "y": 1},
        compliance=[compliance],
        contact_laws=sb.Coulomb(0.6, 0.9),
        tangent_rows=[[0.0, 1.0]],
        tangent_compliance=[compliance],
    )
    shapes = body.points.modes[:, 1].reshape(-1, 2)
    begun = np.linalg.solve(shapes, [-1.0, pull])
    found = sb.transient(body, [0.0, 0.0], 1.75 * half, step, initial=(np.zeros(2), begun))
    left = [found.velocity(name)[-1, 1] for name in "xy"]
    assert left == pytest.approx([1.0, -pull], abs=1e-3)
    assert found.energy.friction[-1] == pytest.approx(0.0, abs=1e-12)
    most = np.argmax(found.contact_force[:, 0])
    assert found.friction_force[most, 0] == pytest.approx(-pull * found.contact_force[most, 0], rel=1e-3)


def test_free_decay_in_closed_form():
    """Pushed off so that the slider only sticks, the mass swings on both springs; faster, it slips on under a
    constant pull, turns, swings back on both springs, slips again: its first turns.
    """
    reduced, bound = slider(), FRICTION * PRESSURE
    rate, own, reach = math.sqrt(SPRING + SLIDER), math.sqrt(SPRING), bound / SLIDER
    rest = sb.transient(reduced, [0.0, -2.0], 0.01, 0.01, initial="equilibrium").states.q[-1]
    shapes = reduced.points.modes[0, 1]

    def pushed(velocity):
        start = (rest, velocity * shapes / (shapes @ shapes))
        return sb.transient(reduced, [0.0, -2.0], 3.5, 1e-3, initial=start)

    found = pushed(0.9 * reach * rate)
    expected = 0.9 * reach * np.sin(rate * found.time)
    assert found.displacement("x")[:, 1] == pytest.approx(expected, abs=1e-5 * reach)
    assert found.energy.friction[-1] == 0.0
    x = pushed(0.5).displacement("x")[:, 1]
    (turns,) = np.nonzero(np.diff(np.sign(np.diff(x))))
    begun, speed, turned = reach, math.sqrt(0.5**2 - (rate * reach) ** 2), []
    for sign in (1.0, -1.0):  # in the direction of the motion
        middle = -bound / SPRING
        peak = middle + math.hypot(begun - middle, speed / own)
        turned.append(sign * peak)
        centre = SLIDER * (peak - reach) / (SPRING + SLIDER)
        begun = 2.0 * reach - peak
        speed = rate * math.sqrt(max((peak - centre) ** 2 - (begun + centre) ** 2, 0.0))
    assert x[turns[:2] + 1] == pytest.approx(turned, rel=1e-5)


def test_equal_steps_by_enumeration(monkeypatch):
    """Three modes and two rows that part, close, stick and slip: each step by the exponential of each mode
    and by trying all states of the rows, without halved steps.
    """
    monkeypatch.setattr(reduced_history, "HALVING", NEVER)
    rng = np.random.default_rng(5)
    root = rng.normal(size=(6, 6))
    stiffness, rows = root @ root.T + np.eye(6), rng.normal(size=(4, 6))
    reduced = sb.reduce_matrices(
        np.eye(6),
        stiffness,
        rows[:2],
        np.array([0.05, 0.0]),
        loads=rng.normal(size=(6, 1)),
        sensors={"x": 0},
        modes=3,
        damping=0.02,
        compliance=[0.02, 0.03],
        contact_laws=[sb.Coulomb(0.4), sb.Coulomb(0.25)],
        tangent_rows=rows[2:],
        tangent_compliance=[0.05, 0.04],
    )
    step, count, load = 0.05, 150, sb.Harmonic(2.0, 0.35)
    found = sb.transient(reduced, load, step * count, step, decimation=1)
    omega, gap = reduced.omega, reduced.gap
    generators = np.zeros((3, 4, 4))
    generators[:, 0, 1] = generators[:, 1, 2] = generators[:, 2, 3] = step
    generators[:, 1, 0], generators[:, 1, 1] = -(omega**2) * step, -0.04 * omega * step
    moves = expm(generators)
    push = 0.5 * moves[:, :2, 2]
    w = (gap.modes * push[:, 0]) @ gap.modes.T + gap.contact
    friction = Friction(np.arange(2), np.array([0.4, 0.25]), np.array([0.4, 0.25]))
    q, v, force = np.zeros(3), np.zeros(3), np.zeros(4)
    memory, states = Memory.none(RowLaws.unilateral(2), friction), set()
    loads = load(found.time)
    for n in range(count):
        first, slope = (
            reduced.load_modes[:, 0] * part for part in (loads[n], (loads[n + 1] - loads[n]) / step)
        )
        parts = np.stack([q, v, first, slope * step], axis=1)
        free = np.einsum("mij,mj->mi", moves[:, :2] * [1.0, 1.0, 1.0, 1.0 / step], parts)
        free += push * (gap.modes.T @ force)[:, None]
        gaps = gap.modes @ free[:, 0] + gap.loads[:, 0] * loads[n + 1] + reduced.initial_gap
        (force,) = [f for f in enumerated(w, gaps, friction, memory)][:1]
        q, v = (free + push * (gap.modes.T @ force)[:, None]).T
        slip = (w @ force + gaps)[2:]
        states.update(zip(np.sign(force[:2]).round().tolist(), (np.abs(slip - memory.slip) > 1e-12).tolist()))
        memory = memory._replace(slip=slip)
        assert found.states.q[n + 1] == pytest.approx(q, abs=1e-9)
        assert found.states.contact[n + 1] == pytest.approx(force, abs=1e-8)
        assert found.slip[n + 1] == pytest.approx(slip, abs=1e-9)
    assert states == {(0.0, True), (1.0, True), (1.0, False)}
    assert found.energy.friction[-1] > 0.01 * found.energy.external.max()


# ---------------------------------------------------------------------- bodies
@pytest.fixture(scope="module")
def plate():
    """An oblique crack with tip elements inside, on the coarsest mesh."""
    with square([[(0.03, 0.035), (0.07, 0.065)]], sb.Coulomb(0.2), order=2) as model:
        yield model


@pytest.mark.long
def test_slow_loads_against_states_that_follow_each_other(plate):
    """Pressed, let go and pressed again: slips forth and back, friction and loss of `load_history`, whose
    states miss by up to their distance when a row begins to slip. Measured: slips 9e-4, contact forces 5e-4,
    friction 3e-3, loss 6e-4.
    """
    time = np.linspace(0.0, 0.1, 4001)
    levels = 1e6 * PchipInterpolator([0.0, 0.04, 0.07, 0.1], [0.1, 1.0, 0.3, 0.9])(time)
    load = [sb.EdgeLoad("edge3", pressure=sb.Samples(time, levels))]
    reduced = replace(sb.reduce(plate, load, modes=12), damping=np.full(12, 0.5))
    found = sb.transient(reduced, load, time[-1], time[1], initial="equilibrium")
    chosen = np.arange(0, len(time), 50)
    states = sb.load_history(plate, load, time[chosen])
    for name, most in (("slip", 2e-3), ("friction_force", 1e-2), ("contact_force", 2e-3)):
        expected = getattr(states, name)
        assert getattr(found, name)[chosen] == pytest.approx(expected, abs=most * np.abs(expected).max()), (
            name
        )
    lost = states.friction_loss - states.friction_loss[0]
    assert found.energy.friction[-1] == pytest.approx(lost[-1], rel=2e-3)
    (tip, *_) = states.states[0].stress_intensity
    factors = np.array([state.stress_intensity[tip] for state in states.states])
    assert found.stress_intensity(tip)[chosen] == pytest.approx(factors, abs=3e-3 * np.abs(factors).max())


@pytest.mark.long
def test_energies_of_an_undamped_body(plate):
    """A burst that opens, closes and slides: what it has supplied is there or lost to friction, and every row
    obeys the law at every instant.
    """
    frequency = plate.modes(3).frequencies[0]
    load = [
        sb.EdgeLoad("edge3", pressure=sb.ToneBurst(1e6, frequency=frequency, cycles=4)),
        sb.EdgeLoad("edge2", pressure=2e5),
    ]
    found = sb.transient(plate, load, 8.0 / frequency, modes=20)
    energy = found.energy
    scale = energy.external.max()
    assert energy.friction[-1] > 1e-3 * scale and (np.diff(energy.friction) >= 0.0).all()
    assert np.abs(energy.balance).max() < 5e-6 * scale  # loads work in the steps, contact in their parts
    assert np.abs(energy.contact).max() < 1e-3 * scale
    states, gaps = found.states, found.reduced.gaps
    pressing, along = states.contact[:, found.reduced.friction.rows], states.contact[:, gaps:]
    assert (np.abs(along) <= 0.2 * pressing * (1 + 1e-9) + 1e-9 * pressing.max()).all()
    assert (states.gap[:, :gaps] >= -1e-12 * np.abs(states.gap).max()).all()
    assert (pressing == 0.0).any() and found.contact_resultant == pytest.approx(
        states.contact[:, :gaps].sum(1)
    )


def test_files_hold_what_faces_remember(plate, tmp_path, monkeypatch):
    """A run that goes on from its file is the uninterrupted one, to the last bit; so is what is read."""
    monkeypatch.setattr(reduced_history, "CHUNK", 100)

    def stop(done):
        if done > 0.4:
            raise KeyboardInterrupt

    frequency = plate.modes(3).frequencies[0]
    load = [sb.EdgeLoad("edge3", pressure=sb.Harmonic(1e6, frequency)), sb.EdgeLoad("edge2", pressure=2e5)]
    step, file = 0.01 / frequency, str(tmp_path / "run.journal")
    whole = sb.transient(plate, load, 400 * step, step, modes=8, file=str(tmp_path / "whole.journal"))
    with pytest.raises(KeyboardInterrupt):
        sb.transient(plate, load, 400 * step, step, modes=8, file=file, progress=stop)
    gone_on = sb.transient(plate, load, 400 * step, step, modes=8, file=file, resume=True)
    sb.save(tmp_path / "saved.h5", whole)
    assert whole.energy.friction[-1] > 0.0
    for other in (gone_on, sb.read(file), sb.read(tmp_path / "saved.h5")):
        for name in ("slip", "friction_force", "gap", "contact_force", "point_displacements"):
            assert np.array_equal(getattr(other, name), getattr(whole, name)), name
        assert np.array_equal(other.energy.friction, whole.energy.friction)
    with square([[(0.03, 0.035), (0.07, 0.065)]], sb.Coulomb(0.1), order=2) as model:
        with pytest.raises(ValueError, match="its friction differs"):
            sb.transient(model, load, 500 * step, step, modes=8, file=file, resume=True)


def test_jumps_of_loads():
    """A push that jumps: what slips meanwhile is lost, and the energies stay in balance."""
    load = [sb.Step(1.5, time=1.003), -2.0]
    found = sb.transient(slider(), load, 5.0, 0.01, initial="equilibrium")
    assert found.energy.friction[-1] > 0.0
    assert np.abs(found.energy.balance).max() < 1e-6 * found.energy.external.max()


def test_without_friction_nothing_changes():
    """A coefficient of zero is the frictionless law, bit by bit; overlapping faces do not rub."""
    load = [sb.Harmonic(1.0, 0.3), -2.0]
    one, other = (sb.transient(slider(contact_laws=law), load, 5.0, 0.01) for law in (None, sb.Coulomb(0.0)))
    assert one.slip is None and other.friction_force is None and other.energy.friction is None
    assert np.array_equal(one.states.q, other.states.q)
    assert np.array_equal(one.states.contact, other.states.contact)
    apart = sb.transient(slider(), load, 5.0, 0.01, contact=False)
    alone = sb.transient(slider(contact_laws=None), load, 5.0, 0.01, contact=False)
    assert np.array_equal(apart.states.q, alone.states.q)
    assert not apart.friction_force.any() and not apart.energy.friction.any()
