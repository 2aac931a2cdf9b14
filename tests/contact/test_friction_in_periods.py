"""Steady states with friction: the derivative of a period against differences of it, histories located by
another integration, closed forms of motions that stick, figures of an independent program.
"""

import importlib
import math
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest
from scipy import optimize

import sbfem_petsc as sb
from meshing import Beam, CrackLine, VNotch
from sbfem_petsc.contact.friction import AGAINST, ALONG, STICKS
from sbfem_petsc.continuation import search as steady
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.errors import PetscFailure
from sbfem_petsc.loads import separate
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import DrivenPeriod, Period
from sbfem_petsc.petsc import PETSc
from sbfem_petsc.reduction.build import reduced
from tests.contact.test_friction_in_motion import FRICTION, PRESSURE, SLIDER, SPRING, jenkins, slider
from tests.contact.test_friction_on_masses import beam, stuck_share
from tests.parallel import ROOT, alone, answer, on_ranks

periodic_module = importlib.import_module("sbfem_petsc.analysis.periodic")
RATE = 1.7
FREQUENCY = RATE / (2.0 * math.pi)


def chain(modes=4):
    """Masses on springs with three elastic stops that rub, four of six modes kept."""
    k = np.diag(np.full(6, 2.0)) - np.eye(6, k=1) - np.eye(6, k=-1)
    rows = np.eye(6)
    return sb.reduce_matrices(
        np.eye(6),
        k,
        rows[[0, 2, 5]],
        np.array([0.05, 0.0, -0.1]),
        loads=rows[:, [1, 4]],
        sensors={"first": 0, "last": 5},
        modes=modes,
        damping=0.02,
        compliance=np.full(3, 0.05),
        contact_laws=sb.Coulomb(0.4),
        tangent_rows=rows[[1, 3, 4]] - 0.3 * rows[[0, 2, 5]],
        tangent_compliance=np.full(3, 0.1),
    )


def dependent(modes, rubs=True):
    """Four rows of six masses without compliance: of more than two kept modes some have no flexibility but by
    these.
    """
    k, rows = np.diag(np.full(6, 2.0)) - np.eye(6, k=1) - np.eye(6, k=-1), np.eye(6)
    faces = dict(contact_laws=sb.Coulomb(0.4), tangent_rows=rows[[1, 3]]) if rubs else {}
    normal = rows[[0, 2]] if rubs else rows[:4]
    return sb.reduce_matrices(
        np.eye(6),
        k,
        normal,
        np.zeros(len(normal)),
        loads=rows[:, [4, 5]],
        sensors={"5": 4},
        modes=modes,
        damping=0.02,
        **faces,
    )


def driven_chain(frequency=0.09, steps=512):
    signals = [sb.Harmonic(0.3, frequency) + 0.02, sb.Harmonic(0.4, 2 * frequency, 0.4)]
    return Period(chain(), Excitation.of(signals, frequency, None, 8), steps).at(frequency)


@pytest.fixture(scope="module")
def chain_motion():
    """All states of rows are met; slips are carried over both ends of the period."""
    driven = driven_chain()
    state = driven.linear_state
    for _ in range(3):
        state = state + driven.run(state).residual
    state[8:] *= 1.001
    motion = driven.run(state)
    assert set(np.unique(motion.rows[:, 3:])) == {0, STICKS, ALONG, AGAINST}
    assert (motion.rows[0, 3:] == STICKS).any() and (np.diff(motion.rows, axis=0) != 0).sum() > 20
    return driven, state, motion


def slope(driven, state, way, size):
    """Central difference of x(T); the rows keep their states."""
    ends = []
    for sign in (1.0, -1.0):
        there = state + sign * size * way
        motion = driven.run(there)
        ends.append(motion.residual + there)
    return (ends[0] - ends[1]) / (2.0 * size)


def test_derivative_with_state_and_memory(chain_motion):
    """Central differences by 1e-7, piecewise linear but for rounding; 1e-6 is asked for."""
    driven, state, motion = chain_motion
    exact = driven.carried(motion, np.eye(len(state)))
    size = 1e-7 * np.linalg.norm(state)
    for k, unit in enumerate(np.eye(len(state))):
        assert exact[:, k] == pytest.approx(slope(driven, state, unit, size), abs=1e-8 * np.abs(exact).max())
    assert np.abs(exact[:, 8:]).max() > 0.1


def test_no_more_directions_than_rows(chain_motion):
    """Where nothing changes and nothing is written contact has no more directions than rows are held."""
    driven, _, motion = chain_motion
    found = driven._derivative(motion, located=False, rough=False, keep=False).contacts
    changes = (np.diff(motion.rows, axis=0) != 0).any(axis=1)
    quiet = (found.instants > 0) & (found.instants < len(changes) - 1)
    quiet[quiet] = ~(changes[found.instants[quiet] - 1] | changes[found.instants[quiet]])
    held = (motion.rows[found.instants] != 0).sum(axis=1)
    assert quiet.sum() > 100 and (found.counts[quiet] <= held[quiet]).all()


def test_located_switches_of_several_rows():
    """Beside the derivative of the steps as they are, the largest of whose multipliers, 4.56, jumps by a few
    per cent with their length.
    """
    driven = driven_chain()
    motion = shoot(driven, driven.linear_state).motion
    unit = np.eye(driven.period.unknowns)
    one, other = (
        np.abs(np.linalg.eigvals(matrix)).max()
        for matrix in (driven.carried(motion, unit), driven.monodromy(motion, rubbing=True))
    )
    assert other == pytest.approx(one, rel=0.01)


@pytest.mark.long
def test_jacobian_test_of_petsc():
    """-shooting_snes_test_jacobian, PETSc's own differences: every ratio it prints is below 1e-6."""
    program = """
import sys
import petsc4py
petsc4py.init([sys.argv[0], "-shooting_snes_test_jacobian"])
import sbfem_petsc as sb
from tests.contact.test_friction_in_periods import chain
load = [sb.Harmonic(0.3, 0.09) + 0.02, sb.Harmonic(0.4, 0.18, 0.4)]
sb.periodic(chain(), load, 0.09, jacobian="dense", stability=False)
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if "||J - Jfd||_F/||J||_F = " in line]
    ratios = [float(line.split("||J - Jfd||_F/||J||_F = ")[1].split(",")[0]) for line in lines]
    assert len(ratios) >= 3 and max(ratios) < 1e-6, ratios


# ---------------------------------------------------------------------- few rows
def shaken(amplitude):
    """Loads of `slider`: a push, and what presses."""
    return [sb.Harmonic(amplitude, FREQUENCY), sb.Constant(-2.0)]


@pytest.fixture(scope="module")
def mass():
    return slider(modes=1)


def settled(amplitude, rate, steps, periods=12):
    """Displacement over a period that SciPy's history settles on, and what is lost in it."""
    times = 2.0 * math.pi / rate * np.arange((periods + 1) * steps) / steps
    x, lost = jenkins(amplitude, rate, times)
    return x[-steps:], lost - jenkins(amplitude, rate, times[: periods * steps])[1]


def test_orbit_against_located_events(mass):
    """Displacements and loss of a period are those that a history settles on, the better the more steps; the
    exact derivative makes Newton's method converge quadratically.
    """
    errors = []
    for steps in (256, 1024):
        found = sb.periodic(mass, shaken(1.0), FREQUENCY, steps=steps, jacobian="dense")
        x, lost = settled(1.0, RATE, steps)
        errors.append(np.abs(found.displacement("x")[:, 1] - x).max() / np.abs(x).max())
        assert found.friction_loss == pytest.approx(lost, rel=1e-3) and found.sticking == 0 and found.stable
        assert found.iterations <= 5 and found.residuals[-1] < 1e-10 * found.residuals[-2]
    assert errors[0] < 4e-4 and errors[1] < 2e-5
    assert found.contact_force == pytest.approx(PRESSURE)
    assert np.abs(found.friction_force).max() == pytest.approx(FRICTION * PRESSURE)


def test_multipliers_against_differences_of_the_map(mass):
    """The rate at which disturbances of the state and of what the faces remember die out."""
    period = Period(
        mass, Excitation.of([sb.Harmonic(1.0, FREQUENCY), sb.Constant(-2.0)], FREQUENCY, None, 8), 512
    )
    driven = period.at(FREQUENCY)
    found = sb.periodic(mass, shaken(1.0), FREQUENCY)
    whole = np.array([slope(driven, found.state, unit, 1e-6) for unit in np.eye(3)]).T
    expected = sorted(np.linalg.eigvals(whole), key=abs)[::-1]
    of_steps = np.linalg.eigvals(driven.carried(driven.run(found.state), np.eye(3)))
    assert sorted(of_steps, key=abs)[::-1] == pytest.approx(np.array(expected), abs=1e-6)
    # those that are told have switches inside the steps, between whose ends the map's jump
    assert found.multipliers == pytest.approx(np.array(expected), abs=1e-2)
    other = sb.periodic(mass, shaken(1.0), FREQUENCY, jacobian="matrix-free")
    assert other.displacement("x") == pytest.approx(found.displacement("x"), abs=1e-9)


@pytest.mark.parametrize("phase", [0.7, 1.5, 3.0])
def test_friction_that_falls_where_a_slip_begins(phase):
    """Wherever the period begins, within a slip as well, the motion is what a history settles on: a slip goes
    on through t = 0. Steps do not tell the multipliers (a history forgets by .31 a period, their largest is
    .26), which are refused.
    """
    reduced = slider(modes=1, damping=0.02, contact_laws=sb.Coulomb(FRICTION, 1.5 * FRICTION))
    drive = [sb.Harmonic(1.0, FREQUENCY, phase), sb.Constant(-2.0)]
    found = sb.periodic(reduced, drive, FREQUENCY, steps=512)
    step = 1.0 / (512 * FREQUENCY)
    history = sb.transient(reduced, drive, 20 * 512 * step, step, initial="equilibrium", decimation=1)
    x, expected = found.displacement("x")[:, 1], history.displacement("x")[-513:-1, 1]
    assert x == pytest.approx(expected, abs=1e-2 * np.abs(expected).max())  # slips begin up to a step late
    lost = history.energy.friction
    assert found.friction_loss == pytest.approx(lost[-1] - lost[-513], rel=1e-2)
    assert found.stable is None and not len(found.multipliers)
    assert "stability not told, as friction falls where a slip begins" in repr(found)
    with pytest.raises(ValueError, match="stability = True, and friction falls"):
        sb.periodic(reduced, drive, FREQUENCY, stability=True)


def test_curves_that_tell_no_stability():
    """Where friction falls, and where it was not asked for: neither stable nor unstable, which is said."""
    for static, asked, said in ((1.5, None, "not told, as friction falls"), (1.0, False, "not asked for")):
        reduced = slider(modes=1, damping=0.02, contact_laws=sb.Coulomb(FRICTION, static * FRICTION))
        drive, ends = [1.0, sb.Constant(-2.0)], (FREQUENCY, 1.01 * FREQUENCY)
        curve = sb.frequency_response(reduced, drive, *ends, steps=128, points=3, stability=asked)
        assert len(curve.value) > 1 and not curve.stability_known and curve.undecided.all()
        assert not curve.stable.any() and not curve.unstable.any() and said in repr(curve)


def test_motions_that_stick(mass, tmp_path):
    """A mass on both springs, in closed form. Where it rests between them depends on where the search began,
    and that is told; its multipliers are those of the two springs.
    """
    expected = 0.2 / (SPRING + SLIDER - RATE**2)
    pushed = sb.periodic(mass, [sb.Harmonic(1.0, FREQUENCY) + 0.5, sb.Constant(-2.0)], FREQUENCY)
    motions = [sb.periodic(mass, shaken(0.2), FREQUENCY, guess=guess) for guess in (None, pushed)]
    means = [motion.harmonics("x")[0].real for motion in motions]
    assert abs(means[0] - means[1]) > 1e-3
    for motion, mean in zip(motions, means):
        assert abs(motion.harmonics("x")[1]) == pytest.approx(expected, rel=1e-4)
        assert motion.sticking == 1 and motion.friction_loss == 0.0 and "stick throughout" in repr(motion)
        # the slider's pull holds the spring's
        assert motion.friction_force.mean() == pytest.approx(SPRING * mean, rel=1e-9)
        turn = np.exp(1j * math.sqrt(SPRING + SLIDER) * motion.period)
        assert sorted(motion.multipliers, key=np.imag) == pytest.approx(
            sorted([turn, turn.conjugate(), 0.0], key=np.imag), abs=1e-3
        )
    sb.save(tmp_path / "orbit.h5", motions[1])
    kept = sb.read(tmp_path / "orbit.h5")
    assert (kept.sticking, kept.friction_loss) == (1, 0.0) and np.array_equal(kept.slip, motions[1].slip)
    again = sb.periodic(mass, shaken(0.2), FREQUENCY, guess=motions[1])
    assert again.iterations == 0
    for jacobian in ("dense", "matrix-free", "differences"):  # what sticks has no part in the equations
        less = sb.periodic(mass, shaken(0.15), FREQUENCY, guess=again, jacobian=jacobian)
        assert less.path == "Newton" and less.slip == pytest.approx(again.slip, abs=1e-15)
    apart = sb.periodic(mass, shaken(1.0), FREQUENCY, contact=False)
    assert sb.periodic(mass, shaken(1.0), FREQUENCY, guess=apart).friction_loss > 0.0


def test_a_search_without_damping_ends(mass, monkeypatch):
    """Where friction alone damps, a history is followed for 300 periods, once, and there is no ramp of the
    damping. A plate took more than ten minutes, in which it did the same four times.
    """
    frequencies, run = [], DrivenPeriod.run
    monkeypatch.setattr(
        DrivenPeriod, "run", lambda self, x: (frequencies.append(self.frequency), run(self, x))[1]
    )

    def fails(*arguments, **options):
        raise sb.SolveError("Newton fails")

    monkeypatch.setattr(steady, "shoot", fails)
    search = steady.Search(ramp=0.0, neighbours=(0.01,))
    with pytest.raises(sb.SolveError) as caught:
        sb.periodic(mass, shaken(1.0), FREQUENCY, steps=64, search=search)
    assert "in vain as well: continuation" in str(caught.value) and "a history of 300" in str(caught.value)
    assert frequencies.count(FREQUENCY) == 300 and len(frequencies) == 540


def test_curves(mass):
    """Over the frequency and the load: histories settle on the same motions; the first slip is where friction
    reaches its bound.
    """
    curve = sb.frequency_response(mass, [1.0, sb.Constant(-2.0)], 0.24, 0.29)
    for k in (0, -1):
        x, _ = settled(1.0, 2.0 * math.pi * curve.value[k], 256, periods=8)
        assert curve.amplitude("x")[k] == pytest.approx(0.5 * np.ptp(x), rel=1e-3)
    assert curve.complete and curve.stable.all() and curve.orbit(3).friction_loss > 0.0
    found = sb.load_response(mass, [1.0, sb.Constant(-2.0)], FREQUENCY, 0.5, stop=1.0)
    alone = 1.0 / (SPRING + SLIDER - RATE**2)
    relative = found.amplitude("x") / found.value
    first = FRICTION * PRESSURE / SLIDER / alone
    assert relative[found.value < first] == pytest.approx(alone, rel=1e-3)
    assert relative[-1] > 1.2 * alone


def test_what_is_refused(mass):
    with pytest.raises(ValueError, match="in segments knows no friction yet"):
        sb.periodic(mass, shaken(1.0), FREQUENCY, segments=2)
    with pytest.raises(ValueError, match="backbone follows free motions, which friction brings to rest"):
        sb.backbone(mass, 1, 1e-3, 1.0)


def test_without_friction_nothing_changes():
    """A coefficient of zero is the frictionless law, bit by bit."""
    one, other = (
        sb.periodic(slider(contact_laws=law, modes=1, damping=0.1), shaken(1.0), FREQUENCY)
        for law in (None, sb.Coulomb(0.0))
    )
    assert np.array_equal(one.states.q, other.states.q) and other.friction_loss is None


def pressed(mass, stiffness, row, law, **options):
    """Masses of which one rubs under a constant load, which a stiff unknown beyond the modes hands on; the
    last sensor is its place.
    """
    n = len(mass)
    whole, held = np.eye(n + 1), np.eye(n + 1)
    whole[:n, :n], held[:n, :n] = mass, stiffness
    whole[n, n], held[n, n] = mass.diagonal().min(), 1e3 * stiffness.max()
    units = np.eye(n + 1)
    return sb.reduce_matrices(
        whole,
        held,
        units[[n]],
        np.zeros(1),
        loads=units[:, [n, n - 2 if n > 1 else 0]],
        sensors={"end": n - 2 if n > 1 else 0},
        tangent_rows=units[[row]],
        contact_laws=law,
        **options,
    )


def top(u):
    """Highest value, by the parabola through the highest three of equal samples of a period."""
    k = int(np.argmax(u))
    before, middle, after = u[k - 1], u[k], u[(k + 1) % len(u)]
    return middle - 0.125 * (after - before) ** 2 / (before - 2.0 * middle + after)


@pytest.mark.long
@pytest.mark.parametrize(
    "rate, friction, expected",
    [
        (0.8, 0.2, 2.711415),
        (0.8, 0.5, 2.332235),
        (0.9, 0.7, 2.871226),
        (1.2, 0.3, 2.072384),
        (1.2, 0.5, 1.657467),
        (1.5, 0.5, 0.553775),
    ],
)
def test_den_hartogs_oscillator(rate, friction, expected):
    """Rigid friction without stops: A = sqrt(V^2 - r^2 U^2), V = 1 / (1 - b^2), U = sin(pi / b) / (b (1 +
    cos(pi / b))). An elastic slider turns its pull over while the mass turns, a way that goes with its
    compliance, a time with the root of that: the error is a series in this root, which four compliances, each
    a quarter of the one before, tell to its third term. Errors halve, and what is left of them, each term by
    its own rate, is below 1e-5.
    """
    v, u = 1.0 / (1.0 - rate**2), math.sin(math.pi / rate) / (rate * (1.0 + math.cos(math.pi / rate)))
    assert expected == pytest.approx(math.sqrt(v**2 - (friction * u) ** 2), rel=1e-6)
    frequency, found = rate / (2.0 * math.pi), []
    for stiff in (256.0, 1024.0, 4096.0, 16384.0):
        mass = pressed(
            np.eye(1), np.eye(1), 0, sb.Coulomb(friction), modes=1, tangent_compliance=[1.0 / stiff]
        )
        load = [sb.Constant(-1.0), sb.Harmonic(1.0, frequency)]
        orbit = sb.periodic(mass, load, frequency, steps=16384)
        found.append(top(orbit.displacement("end")[:, 1]))
        assert orbit.stable and orbit.friction_loss == pytest.approx(
            4.0 * friction * (found[-1] - friction / stiff), rel=1e-4
        )
    limit = np.array(found)
    assert np.abs(limit - expected)[1:] == pytest.approx(0.5 * np.abs(limit - expected)[:-1], rel=5e-2)
    for order in (2.0, 4.0, 8.0):
        limit = (order * limit[1:] - limit[:-1]) / (order - 1.0)
    assert limit[0] == pytest.approx(math.sqrt(v**2 - (friction * u) ** 2), rel=1e-5)


def rigid_with_stops(rate, friction):
    """Amplitude of a rigid oscillator that stops twice a period, and the share of it that it stands still:
    from a rest on the one side to that on the other in closed form, ends located, until they are alike.
    """
    begins, place, gain, half = 0.0, 1.0, 1.0 / (1.0 - rate**2), math.pi / rate

    def next_zero(function, start):
        """From where it is above zero."""
        while function(start + 1e-2) > 0.0:
            start += 1e-2
        return optimize.brentq(function, start, start + 1e-2, xtol=1e-15)

    def slid(t, slips, place):
        """Displacement and speed of who slips down from a place, from a time on."""
        cosine, sine = place - gain * math.cos(rate * slips) - friction, gain * rate * math.sin(rate * slips)
        c, s = math.cos(t - slips), math.sin(t - slips)
        forced, speed = gain * math.cos(rate * t) + friction, -gain * rate * math.sin(rate * t)
        return forced + cosine * c + sine * s, speed - cosine * s + sine * c

    for _ in range(100):
        slips = next_zero(lambda t, place=place: friction + math.cos(rate * t) - place, begins)
        share = (slips - begins) / half
        ends = next_zero(lambda t, slips=slips, place=place: -slid(t, slips, place)[1], slips + 1e-2)
        begins, place = ends - half, -slid(ends, slips, place)[0]
    return place, share


@pytest.mark.long
@pytest.mark.parametrize(
    "rate, friction, expected, stuck", [(0.6, 0.6, 1.443224, 0.0579), (0.3, 0.4, 0.856730, 0.4885)]
)
def test_den_hartogs_oscillator_with_stops(rate, friction, expected, stuck):
    """An elastic slider of stiffness s trembles undamped where a rigid one stops, by 2 / s at most, and slips
    up to a period 2 pi / sqrt(s) of that earlier, in either stop, in which phase it may: errors have no
    series, and keep below bounds that fall with s (measured of 60 stiffnesses).
    """
    amplitude, share = rigid_with_stops(rate, friction)
    assert amplitude == pytest.approx(expected, abs=5e-7) and share == pytest.approx(stuck, abs=5e-5)
    frequency = rate / (2.0 * math.pi)
    load = [sb.Constant(-1.0), sb.Harmonic(1.0, frequency)]
    for stiff in (4.0**9, 4.0**13):
        mass = pressed(
            np.eye(1), np.eye(1), 0, sb.Coulomb(friction), modes=1, tangent_compliance=[1.0 / stiff]
        )
        orbit = sb.periodic(mass, load, frequency, steps=65536, stability=False)
        off = top(orbit.displacement("end")[:, 1]) - amplitude
        changes = np.diff(orbit.slip[:, 0], append=orbit.slip[:1, 0])
        assert abs(off) < 2.0 / stiff
        assert stuck_share(changes) == pytest.approx(share, abs=2.0 * rate / math.sqrt(stiff))
        assert abs(off) < 1e-5 * amplitude
    # the finest: the published figures to their last digit
    assert stuck_share(changes) == pytest.approx(stuck, abs=5e-5)


@pytest.mark.long
@pytest.mark.parametrize(
    "ratio, tip, stuck, lost", [(0.95, 0.07605, 0.6139, 38.82), (0.85, 0.0858, 0.5847, 42.61)]
)
def test_cantilever_with_a_slider(ratio, tip, stuck, lost):
    """NLstep's example 02: tip, share of the period in which the slider sticks, loss. Eight modes of
    sixteen; the flexibility of the others is the compliance that the slider needs.
    """
    rate = 248.973205
    frequency = ratio * rate / (2.0 * math.pi)
    body = pressed(*beam(), 4, sb.Coulomb(1.0), modes=8, rayleigh=(0.1 * rate, 0.0))
    load = [sb.Constant(-1500.0), sb.Harmonic(200.0, frequency)]
    found = sb.periodic(body, load, frequency, steps=4096)
    speed = np.abs(np.diff(found.slip[:, 0], append=found.slip[:1, 0]))
    assert np.abs(found.displacement("end")).max() == pytest.approx(tip, rel=1e-3)
    assert (speed < 1e-3 * speed.max()).mean() == pytest.approx(stuck, abs=1e-2)
    assert found.friction_loss == pytest.approx(lost, rel=1e-3) and found.stable


def elastic_slider(body, rate, press, push, periods, steps=20_000):
    """Loss in each of some periods of a body whose only slider gives way by what its modes leave out: its
    modes with the slider held by that spring and pulled by the whole friction, in closed form, from rest on;
    stick and slip end where that is located.
    """
    m, row, slack = len(body.omega), body.gap.modes[1], body.gap.contact[1, 1]
    direct, damping, bound = body.gap.loads[1], np.diag(2.0 * body.damping * body.omega), -press
    step, zero = 2.0 * math.pi / (rate * steps), np.zeros(m)
    drive = push * body.load_modes[:, 1]

    def slid(t, x):
        """Where the slider would be without friction, and how fast."""
        u = row @ x[:m] + direct[0] * press + direct[1] * push * np.sin(rate * t)
        return u, row @ x[m:] + direct[1] * push * rate * np.cos(rate * t)

    def solved(stiffness):
        whole = np.block([[np.zeros((m, m)), np.eye(m)], [-stiffness, -damping]])
        values, vectors = np.linalg.eig(whole)
        return whole, values, vectors, np.linalg.inv(vectors)

    free = solved(np.diag(body.omega**2))
    held = solved(np.diag(body.omega**2) + np.outer(row, row) / slack)

    def motion(system, begin, x, constant, wave):
        whole, values, vectors, inverse = system
        mean = -np.linalg.solve(whole, np.append(zero, constant))
        turn = np.linalg.solve(1j * rate * np.eye(2 * m) - whole, np.append(zero, wave) + 0j)
        share = inverse @ (x - mean - (turn * np.exp(1j * rate * begin)).imag)
        return lambda t: (
            (
                (vectors @ (np.exp(np.multiply.outer(values, t - begin)).T * share).T).real.T
                + mean
                + (np.multiply.outer(np.exp(1j * rate * t), turn)).imag
            ).T
        )

    time, x, lost, sense = 0.0, np.zeros(2 * m), np.zeros(periods), 0.0
    slip = slid(0.0, x)[0]
    while True:
        if sense:
            at = motion(free, time, x, sense * bound * row, drive)

            def over(t, at=at, sense=sense):
                return sense * slid(t, at(t))[1]
        else:
            pull = (slip - direct[0] * press) / slack
            at = motion(held, time, x, pull * row, drive - direct[1] * push / slack * row)

            def over(t, at=at, slip=slip):
                return np.abs(slip - slid(t, at(t))[0]) / slack - bound

        begin = time
        while not (late := over(begin + step * np.arange(1, 500)) > 0.0).any():
            begin += 499 * step
        first = begin + step * int(late.argmax())
        time = optimize.brentq(over, first, first + step, xtol=1e-16) if over(first) < 0.0 else first + step
        if time > periods * steps * step:
            return lost
        x = at(time)
        place = slid(time, x)[0]
        if sense:
            place += sense * slack * bound
            lost[int(time / (steps * step))] += bound * abs(place - slip)
            slip, sense = place, 0.0
        else:
            sense = math.copysign(1.0, slip - place)


@pytest.mark.long
def test_a_slip_as_short_as_its_spring():
    """NLstep's example at .7: the slider's spring, of what ten modes leave out, gives way by half of the
    slip, and a loss 1.9 % less than the rigid slider's (.0234715) is that of the elastic one.
    """
    rate = 248.973205
    body = pressed(*beam(), 4, sb.Coulomb(1.0), modes=10, rayleigh=(0.1 * rate, 0.0))
    expected = elastic_slider(body, 0.7 * rate, -1500.0, 200.0, 30)
    assert expected[-1] == pytest.approx(expected[-2], rel=1e-5)
    frequency = 0.7 * rate / (2.0 * math.pi)
    load = [sb.Constant(-1500.0), sb.Harmonic(200.0, frequency)]
    found = sb.periodic(body, load, frequency, steps=16384, stability=False)
    assert found.friction_loss == pytest.approx(expected[-1], rel=1e-3)
    assert np.abs(found.displacement("end")).max() == pytest.approx(0.07827, rel=1e-3)


def test_a_slider_that_steps_do_not_resolve():
    """Of 14 of 16 modes hardly any compliance is left: sticking forces change their sign from step to step
    and Newton's method fails. The compliance that is told finds the motion, near the published loss.
    """
    frequency = 0.95 * 248.973205 / (2.0 * math.pi)
    options = {"modes": 14, "rayleigh": (0.1 * 248.973205, 0.0)}
    load = [sb.Constant(-1500.0), sb.Harmonic(200.0, frequency)]
    body = pressed(*beam(), 4, sb.Coulomb(1.0), **options)
    with pytest.raises(
        sb.SolveError, match="1 of 1 rows that rub give way by as little as 7.12e-12"
    ) as caught:
        sb.periodic(body, load, frequency, steps=512, search=steady.NEWTON_ALONE)
    needed = float(str(caught.value).split("give them ")[1].split()[0])
    softer = pressed(*beam(), 4, sb.Coulomb(1.0), tangent_compliance=[needed], **options)
    assert sb.periodic(softer, load, frequency, steps=512).friction_loss == pytest.approx(38.82, rel=2e-2)


# ---------------------------------------------------------------------- bodies
# amplitude of the first harmonic, the second and third relative to it, J a period
FIGURES = {
    0.1: (8.335e-5, 0.01525, 2.1e-4, 4.07e-4),
    0.3: (8.217e-5, 0.01606, 4.6e-4, 8.86e-4),
    0.6: (8.046e-5, 0.01722, 5.9e-4, 1.07e-3),
}


def tilted(friction):
    """A beam whose crack leans by 45 degrees."""
    beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0, tilt=45.0)])
    laws = {"crack1": sb.Coulomb(friction)}
    return sb.Model(beam.mesh(), sb.Material(70e9, 0.33, 2700), damping=0.002, contact_laws=laws)


@pytest.mark.long
@pytest.mark.parametrize("friction", FIGURES)
def test_tilted_crack(friction):
    """Of a plain program with another mesh at the tip, which has two to four digits."""
    with tilted(friction) as model:
        found = sb.periodic(model, sb.PointForce("A", fy=300.0), 3000.0, modes=80)
    first, second, third, lost = FIGURES[friction]
    u = np.abs(found.harmonics("A"))
    assert u[1] == pytest.approx(first, rel=1e-3)
    assert u[2] / u[1] == pytest.approx(second, rel=1e-3)
    assert u[3] / u[1] == pytest.approx(third, abs=0.6e-5)
    assert found.friction_loss == pytest.approx(lost, rel=4e-3)
    assert found.stable and found.path == "Newton" and found.iterations <= 9


@pytest.mark.long
def test_errors_are_told_in_the_other_number_of_steps_too():
    """In 1,024 steps no motion in more modes was found at 2 kHz without friction, and inf was told; it is in
    512, and covers what three times the modes change.
    """
    with tilted(0.0) as model:
        load = sb.PointForce("A", fy=300.0)
        found = sb.periodic(model, load, 2000.0, modes=80, steps=512)
        own, wide = (
            sb.periodic(model, load, 2000.0, modes=modes, steps=2048, stability=False) for modes in (80, 240)
        )
    one, other = (np.abs(orbit.harmonics("A")[1:5]) for orbit in (own, wide))
    assert (np.abs(one - other) / other < found.mode_error[1:]).all() and found.mode_error.max() < 0.01


@pytest.mark.long
def test_errors_told_of_faces_that_press_as_the_period_begins():
    """Errors of harmonics are told at 3.1 kHz, and cover what twice the modes and steps change: further modes
    that begin at rest under the faces' pressure ring, and no motion was found in them.
    """
    with tilted(0.3) as model:
        load = sb.PointForce("A", fy=300.0)
        found = sb.periodic(model, load, 3100.0, modes=80, steps=512)
        finer = sb.periodic(model, load, 3100.0, modes=160, steps=1024, stability=False)
    one, other = (orbit.harmonics("A")[:5] for orbit in (found, finer))
    true = np.abs(one - other) / np.abs(other)
    assert found.contact_force[0].max() > 1.0
    assert (true < found.mode_error).all() and (found.mode_error[3:] < 10.0 * true[3:]).all()


@pytest.mark.long
@pytest.mark.parametrize(("frequency", "modes", "steps"), [(1000.0, 100, 2048), (3000.0, 300, 4096)])
def test_accuracy_of_faces_that_rub(frequency, modes, steps):
    """50 N come to 1e-3, with vectors behind the modes that do not ring: damped by .02 whatever their
    frequency they took 8,192 steps at 3 kHz, where 208 modes in 4,096 were told to be 4e-3 off. From so many
    modes and steps without vectors harmonics are no further than is told of both.
    """
    load, shares = sb.PointForce("A", fy=50.0), list[float]()
    with tilted(0.3) as model:
        found = sb.periodic(model, load, frequency, stability=False, progress=shares.append)
        other = sb.periodic(model, load, frequency, modes=modes, steps=steps, stability=False)
    own = found.reduced
    assert own.natural <= modes and len(found.time) <= steps
    least = 0.02 * own.omega[own.natural :] / own.omega[own.natural - 1]
    np.testing.assert_allclose(own.damping[own.natural :], least, rtol=1e-12)
    one, two = (orbit.harmonics("A")[1:5] for orbit in (found, other))
    apart = np.abs(one - two) / np.maximum(np.abs(two), 1e-3 * np.abs(two).max())
    told = found.mode_error[1:], other.mode_error[1:]
    assert (told[0] / np.arange(1, 5)).max() < 1e-3
    assert (apart < told[0] + told[1]).all()
    # each attempt in more modes tells that its motion is found, and its error
    assert shares and shares == [0.5, 1.0] * (len(shares) // 2)


def test_a_lost_motion_is_looked_for_in_twice_the_steps(monkeypatch):
    """In more modes, where 512 steps may leave the map of a period a kink; it went to 80 modes at once."""
    find, steps = periodic_module.find_steady_state, []

    def lost(driven, *arguments, **options):
        steps.append(driven.period.steps)
        if steps[1:] == [512]:
            raise sb.SolveError("lost")
        return find(driven, *arguments, **options)

    monkeypatch.setattr(periodic_module, "find_steady_state", lost)
    with tilted(0.3) as model, warnings.catch_warnings():
        warnings.simplefilter("error", sb.AccuracyWarning)
        found = sb.periodic(model, sb.PointForce("A", fy=3000.0), 500.0, stability=False)
    assert steps[:3] == [512, 512, 1024] and len(found.time) == steps[-1]
    assert found.largest_mode_error < 1e-3


def test_a_derivative_of_few_steps_that_fails_loses_no_motion(monkeypatch):
    """In more steps, where the period in an eighth of them cannot be integrated: Newton's method makes its
    own, and the motion is that found otherwise; it was lost, and told of as not within the accuracy.
    """
    loads, asked = [sb.Harmonic(0.3, 0.09) + 0.02, sb.Harmonic(0.4, 0.18, 0.4)], list[int]()
    usual = sb.periodic(chain(6), loads, 0.09, accuracy=1e-4, stability=False)

    def fails(fixed):
        asked.append(len(fixed.state))
        raise sb.SolveError("the steps are too few")

    monkeypatch.setattr(periodic_module, "known_derivative", fails)
    found = sb.periodic(chain(6), loads, 0.09, accuracy=1e-4, stability=False)
    assert asked and len(found.time) == len(usual.time) and found.largest_mode_error < 1e-4
    assert (
        np.abs(found.contact_resultant - usual.contact_resultant).max() < 1e-6 * usual.contact_resultant.max()
    )


@pytest.mark.slow
def test_newton_alone_far_from_a_motion_is_not_given_up():
    """From the linear response, as at the ends of a curve whose errors are told, it gains little at first; it
    was given up as one near a known motion is.
    """
    drawing = Beam(0.4, 0.02, cracks=[CrackLine([(0.1, 0.02), (0.112, 0.008)])])
    law, load = {"crack1": sb.Coulomb(0.3)}, sb.PointForce("A", fy=300.0)
    with sb.Model(
        drawing.mesh(order=4), sb.Material(70e9, 0.33, 2700.0), damping=0.005, contact_laws=law
    ) as model:
        twelve = reduced(model, tuple(separate(load)[0]), 12, True)
    options = {"steps": 512, "stability": False}
    given = sb.periodic(twelve, load, 1698.51, **options)
    found = sb.periodic(twelve, load, 1698.51, search=steady.NEWTON_ALONE, **options)
    assert found.path == "Newton" and len(found.residuals) > 10
    assert found.contact_resultant.max() == pytest.approx(given.contact_resultant.max(), rel=1e-6)


@pytest.mark.long
def test_accuracy_in_a_dozen_modes():
    """Behind 12 modes vectors damped by .02 leave 3.6e-3 of the third harmonic, of which 1.1e-3 was told;
    these ring with the modes. Beside 160 modes without vectors in 8,192 steps.
    """
    load = sb.PointForce("A", fy=3000.0)
    with tilted(0.3) as model:
        found = sb.periodic(model, load, 500.0, stability=False)
        other = sb.periodic(model, load, 500.0, modes=160, steps=8192, stability=False)
    one, two = (orbit.harmonics("A")[1:5] for orbit in (found, other))
    apart = np.abs(one - two) / np.maximum(np.abs(two), 1e-3 * np.abs(two).max())
    assert (apart / np.arange(1, 5)).max() < 1e-3
    assert (apart < 3.0 * (found.mode_error[1:] + other.mode_error[1:])).all()


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from meshing import Beam, CrackLine, VNotch
from mpi4py import MPI
beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0, tilt=45.0)])
laws = {"crack1": sb.Coulomb(0.3)}
with sb.Model(beam.mesh(order=2), sb.Material(70e9, 0.33, 2700), damping=0.01, contact_laws=laws) as model:
    load = sb.PointForce("A", fy=300.0)
    orbit = sb.periodic(model, load, 3000.0, modes=20)
    curve = sb.frequency_response(model, load, 2950.0, 3050.0, modes=20, points=3)
names = ("slip", "friction_force", "contact_force", "friction_loss")
found = {name: np.asarray(getattr(orbit, name)).tolist() for name in names}
found["multipliers"] = np.sort(np.abs(orbit.multipliers)).tolist()
found["curve"] = curve.frequency.tolist()
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(found))
"""


@pytest.mark.long
def test_two_ranks():
    """The numbers of one rank to 1e-9."""
    one, two = alone(RANKS), answer(on_ranks(2, RANKS))
    assert np.abs(one["slip"]).max() > 0.0 and one["friction_loss"] > 0.0 and len(one["curve"]) == 3
    for name, values in one.items():
        expected = np.array(values)
        assert np.array(two[name]) == pytest.approx(expected, abs=1e-9 * np.abs(expected).max()), name


@pytest.mark.parametrize(("modes", "rubs"), [(4, True), (5, True), (4, False), (5, False)])
def test_rows_that_kept_modes_alone_move_apart(modes, rubs):
    """The residual flexibility of four rows has rank 6 - modes, by NumPy: what four modes leave had been
    condensed by a pseudo-inverse without a word (a largest multiplier of 3.5), and the others were told to
    take more steps.
    """
    found, loads = dependent(modes, rubs), [sb.Harmonic(0.3, 0.09) - 0.2, sb.Harmonic(0.2, 0.18)]
    assert np.linalg.matrix_rank(found.gap.contact) == 6 - modes
    advice = "^contact: rows that are closed depend on each other;.* Keep fewer modes, or give the rows compl"
    with pytest.raises(sb.SolveError, match=advice):
        sb.periodic(found, loads, 0.09, steps=512, search=None if modes == 4 else steady.NEWTON_ALONE)
    if not rubs:
        with pytest.raises(sb.SolveError, match=advice):
            sb.transient(found, loads, duration=60.0, step=0.05)


@pytest.mark.parametrize("kind", ["anderson", "ngmres", "nrichardson", "qn"])
def test_methods_without_derivative_end_by_themselves(kind, monkeypatch):
    """-shooting_snes_type: each had been followed by a search that failed by it again and again, 6,400 to
    7,800 periods of a chain that rubs, minutes of a model.
    """
    ran, run = [], DrivenPeriod.run
    monkeypatch.setattr(DrivenPeriod, "run", lambda *given: ran.append(0) or run(*given))
    options = PETSc.Options()
    options.setValue("shooting_snes_type", kind)
    try:
        with pytest.raises(
            PetscFailure,
            match=rf"^periodic: -shooting_snes_type {kind} did not converge \(DIVERGED_.* iterations\): .*"
            " of the motion's size, .*; leave the option out",
        ):
            sb.periodic(
                chain(), [sb.Harmonic(0.3, 0.09) + 0.02, sb.Harmonic(0.4, 0.18, 0.4)], 0.09, steps=512
            )
    finally:
        options.delValue("shooting_snes_type")
    assert len(ran) < 200


def block(friction=0.5):
    """On a plane that is pressed to it by 1 m over 0.5 m/N beside a spring of 1e4 N/m; its loss by the
    amplitude, the elastic slider's 4 F (a - F c).
    """
    plane = sb.reduce_matrices(
        np.eye(2),
        np.diag([0.0, 1e4]),
        np.array([[0.0, 1.0]]),
        np.array([-1.0]),
        loads=np.array([[1.0], [0.0]]),
        sensors={"block": 0},
        damping=0.05,
        compliance=np.array([0.5]),
        tangent_rows=np.array([[1.0, 0.0]]),
        tangent_compliance=np.array([0.01]),
        contact_laws=sb.Coulomb(friction),
    )
    held = friction / (0.5 + 1e-4)
    return plane, lambda amplitude: 4.0 * held * (amplitude - 0.01 * held)


@pytest.mark.parametrize(
    ("friction", "force", "jacobian"),
    [
        (0.5, 3.0, "auto"),
        (0.5, 6.0, "auto"),
        (0.2, 10.0, "auto"),
        (0.5, 10.0, "dense"),
        (0.5, 10.0, "differences"),
        (0.2, 10.0, "matrix-free"),
    ],
)
def test_a_block_that_friction_alone_holds_stays_where_it_is(friction, force, jacobian):
    """Any place is a steady state's: rounding had been a pivot of Newton's method, and the block 67 m to
    47,545 m aside at 512 steps; then those of little friction were not found, as none was matrix-free.
    """
    plane, loss = block(friction)
    for steps in (200, 512, 1000):
        orbit = sb.periodic(plane, force, 1.0 / np.pi, steps=steps, jacobian=jacobian)
        amplitude = orbit.amplitude("block")
        # friction slows it down within what it slides in a half period
        assert abs(orbit.harmonics("block")[0]) < amplitude
        np.testing.assert_allclose(orbit.friction_loss, loss(amplitude), rtol=1e-3)


def test_slips_that_are_forgotten_alone_are_carried():
    """Of a block that slips at t = 0: NumPy's words on an empty array before."""
    orbit = sb.periodic(block()[0], 3.0, 1.0 / np.pi, steps=200)
    driven = Period(block()[0], Excitation.of([sb.Harmonic(3.0, 1.0 / np.pi)], 1.0 / np.pi, None, 8), 200).at(
        1.0 / np.pi
    )
    motion = driven.run(orbit.state)
    assert motion.rows[0, 1] != STICKS
    assert not driven.carried(motion, np.eye(5)[:, 4:]).any()
