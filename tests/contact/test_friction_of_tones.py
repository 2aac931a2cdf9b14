"""Steady states of two tones and slow sweeps with friction: located events, histories, the common period of
tones that have one, closed forms of what sticks, another integration.
"""

import math

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

import sbfem_petsc as sb
from sbfem_petsc.continuation.problems.curve_system import filtered, shift
from tests.contact.test_friction_in_motion import FRICTION, PRESSURE, SLIDER, SPRING, pushed, slider
from tests.parallel import answer, on_ranks

RATE = 1.7
FREQUENCY = RATE / (2.0 * math.pi)
# the lines that friction makes of two tones: an odd law has odd ones alone
ODD = ((1, 0), (0, 1), (2, 1), (1, 2), (1, -2), (0, 3))


def tones(fast, slow, ratio, mean=0.0):
    """Loads of `slider`: two tones that push, and what presses."""
    return [
        sb.Harmonic(fast, FREQUENCY) + sb.Harmonic(slow, ratio * FREQUENCY) + mean,
        sb.Constant(-2.0),
    ]


def windowed(time, x, frequency):
    """Amplitude at a frequency through Blackman's window, for which lines a few bins away are nothing."""
    window = np.blackman(len(x))
    return 2.0 * abs((window * x * np.exp(-2j * np.pi * frequency * time)).sum()) / window.sum()


def lines_of_history(time, x, ratio):
    """Those of `ODD`."""
    return np.array([windowed(time, x, (m + n * ratio) * FREQUENCY) for m, n in ODD])


def lines_of(found):
    return np.array([abs(found.line(m, n, "x")) for m, n in ODD])


def history(load, periods, skipped):
    """Time and displacement of a history behind so many periods."""
    step = 1.0 / (512 * FREQUENCY)
    found = sb.transient(
        slider(modes=1, damping=0.05), load, periods * 512 * step, step, initial="equilibrium", decimation=8
    )
    return found.time[64 * skipped :], found.displacement("x")[64 * skipped :, 1]


@pytest.fixture(scope="module")
def mass():
    return slider(modes=1, damping=0.05)


def test_common_period(mass):
    """Eight samples of tones as 8 to 3 are what their common period is: the same lines, the same loss."""
    load = tones(1.0, 0.6, 0.375, 0.4)
    found = sb.quasi_periodic(mass, load, (FREQUENCY, 0.375 * FREQUENCY), samples=8, steps=256)
    whole = sb.periodic(mass, load, FREQUENCY, steps=256)
    spectrum = np.abs(whole.spectrum("x"))
    expected = [spectrum[8 * m + 3 * n] for m, n in ODD]
    assert lines_of(found) == pytest.approx(np.array(expected), abs=1e-9)
    assert found.friction_power == pytest.approx(whole.friction_loss / whole.period, rel=1e-9)
    assert found.contact_peak == pytest.approx(PRESSURE) and found.sticking == 0 and found.stable
    # twenty-one samples know nothing of the common period
    other = sb.quasi_periodic(mass, load, (FREQUENCY, 0.375 * FREQUENCY), steps=256, stability=False)
    assert lines_of(other) == pytest.approx(np.array(expected), abs=2e-5)


def test_what_faces_remember_is_carried_along(mass, tmp_path):
    """Under a strong slow tone faces slip in some periods of the fast one and stick through others, in which
    they remember what came before: the lines of a history, and how fast histories come together.
    """
    ratio, load = 0.0937, tones(0.5, 1.8, 0.0937, 0.3)
    found = sb.quasi_periodic(mass, load, (FREQUENCY, ratio * FREQUENCY), samples=41)
    expected = lines_of_history(*history(load, 160, 50), ratio)
    assert lines_of(found) == pytest.approx(expected, abs=3e-4 * expected.max())
    assert expected[2:].min() > 0.02 * expected[1]
    step = 1.0 / (512 * FREQUENCY)
    pair = [
        sb.transient(mass, load, 64 * 512 * step, step, initial=([place], [0.0]), decimation=512)
        for place in (0.0, 1e-6)
    ]
    apart = np.hypot(
        *[2.0 * (pair[1].states.q - pair[0].states.q)[:, 0], (pair[1].states.v - pair[0].states.v)[:, 0]]
    )
    growth = math.log(apart[64] / apart[32]) / (pair[0].time[64] - pair[0].time[32])
    assert found.exponents[0] == pytest.approx(growth, rel=0.05) and found.resolved
    sb.save(tmp_path / "tones.h5", found)
    kept = sb.read(tmp_path / "tones.h5")
    assert kept.friction_power == found.friction_power > 0.0 and kept.sticking == 0
    assert "W lost to friction" in repr(kept)
    again = sb.quasi_periodic(
        mass, load, (FREQUENCY, ratio * FREQUENCY), samples=41, guess=found, stability=False
    )
    assert len(again.residuals) == 1


@pytest.mark.long
@pytest.mark.parametrize("fast, slow, ratio", [(1.0, 0.6, 0.3712), (0.5, 1.8, 0.0937)])
def test_lines_against_located_events(mass, fast, slow, ratio):
    """SciPy's history of the mass with the slider, each state by itself."""

    def push(t):
        return fast * math.sin(RATE * t) + slow * math.sin(ratio * RATE * t)

    time = np.arange(160 * 64) / (64 * FREQUENCY)
    x, _ = pushed(push, time, drag=0.2)
    expected = lines_of_history(time[40 * 64 :], x[40 * 64 :], ratio)
    found = sb.quasi_periodic(
        mass,
        tones(fast, slow, ratio),
        (FREQUENCY, ratio * FREQUENCY),
        samples=61,
        steps=1024,
        stability=False,
    )
    assert lines_of(found) == pytest.approx(expected, abs=2e-4 * expected.max())


def test_tones_under_which_faces_stick(mass):
    """The mass on both springs, in closed form; where it rests between them depends on the search."""
    load = tones(0.15, 0.1, 0.3712)
    found = sb.quasi_periodic(mass, load, (FREQUENCY, 0.3712 * FREQUENCY))
    assert found.sticking == 1 and found.friction_power == 0.0 and "1 slips stick throughout" in repr(found)
    for (m, n), force in (((1, 0), 0.15), ((0, 1), 0.1)):
        rate = (m + 0.3712 * n) * RATE
        expected = force / abs(SPRING + SLIDER - rate**2 + 0.2j * rate)
        assert abs(found.line(m, n, "x")) == pytest.approx(expected, rel=1e-4)
    assert lines_of(found)[2:] == pytest.approx(np.zeros(4), abs=1e-12)
    # disturbances die out as the mass's own swing does, whatever the springs
    assert found.exponents[0] == pytest.approx(-0.1, rel=5e-3)


def test_slow_sweeps(mass):
    """Along the curve of steady states, off it in proportion to the rate; from the first cycle on, for faces
    begin with what they remember of the steady state.
    """
    load, low, high = [1.0, sb.Constant(-2.0)], 0.24, 0.36
    curve = sb.frequency_response(mass, load, low, high, stability=False)
    steady = PchipInterpolator(curve.value, curve.amplitude("x"))
    off = []
    for cycles in (100, 400):
        swept = sb.swept_response(mass, load, low, high, duration=cycles / 0.3)
        off.append(np.abs(swept.amplitude("x") / steady(swept.frequency) - 1.0))
        assert swept.contact_peak == pytest.approx(np.full(cycles, PRESSURE))
    assert off[0].max() < 0.1 and off[0].max() / off[1].max() == pytest.approx(4.0, abs=0.6)
    assert off[1][0] < 2e-3


# ---------------------------------------------------------------------- a tone of the motion's own
STOP, DAMPING, BOUND, PULL = 10.0, 0.02, 0.05, 2.0


def rubbed_masses():
    """Two masses, a stop for the first, an elastic slider on the second under a third one that presses it."""
    stiffness = np.zeros((3, 3))
    stiffness[:2, :2] = [[1.0, -1.0], [-1.0, 2.0]]
    damping = DAMPING * stiffness
    stiffness[2, 2], damping[2, 2] = 4.0, 0.4
    return sb.reduce_matrices(
        np.eye(3),
        stiffness,
        np.eye(3)[[0, 2]],
        np.array([1.0, 0.0]),
        loads=np.eye(3)[:, 1:],
        sensors={"1": 0, "2": 1},
        damping=damping,
        compliance=np.array([1.0 / STOP, 1e-3]),
        contact_laws=[sb.Unilateral(), sb.Coulomb(BOUND)],
        tangent_rows=np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
        tangent_compliance=[0.0, 1.0 / PULL],
    )


def integrated(state, slip, frequency, periods, steps=3000):
    """Places of both masses at multiples of the period: Runge and Kutta's steps of the equations as they
    stand, the slider after each of them.
    """
    step, rate, pressure, found = 1.0 / (steps * frequency), 2.0 * math.pi * frequency, 1.0 / 1.004, []
    bound = BOUND * pressure

    def rates(t, y):
        x1, x2, v1, v2 = y
        pull = min(max(PULL * (slip - x2), -bound), bound)
        pushed = STOP * max(0.0, -x1 - 1.0) - DAMPING * (v1 - v2)
        other = 0.1 * math.sin(rate * t) + pull - DAMPING * (2.0 * v2 - v1)
        return v1, v2, x2 - x1 + pushed, x1 - 2.0 * x2 + other

    def moved(y, k, length):
        return [a + length * b for a, b in zip(y, k)]

    y = list(state)
    for n in range(periods * steps):
        if n % steps == 0:
            found.append(y[:2])
        t = n * step
        k1 = rates(t, y)
        k2 = rates(t + 0.5 * step, moved(y, k1, 0.5 * step))
        k3 = rates(t + 0.5 * step, moved(y, k2, 0.5 * step))
        k4 = rates(t + step, moved(y, k3, step))
        y = [a + step / 6.0 * (p + 2.0 * q + 2.0 * r + s) for a, p, q, r, s in zip(y, k1, k2, k3, k4)]
        slip = min(max(slip, y[1] - bound / PULL), y[1] + bound / PULL)
    return np.array(found)


@pytest.mark.long
def test_own_tone_behind_a_branch_with_friction(tmp_path):
    """A branch of steady states loses its stability where a second tone grows; a motion further on, of a
    branch of such, is what another integration from one of its states goes through.
    """
    system = rubbed_masses()
    curve = sb.frequency_response(system, [0.1, sb.Constant(-1.0)], 0.0980, 0.0966, steps=512)
    point = next(item for item in curve.bifurcations if item.kind == "Neimark-Sacker")
    assert abs(point.multiplier) == pytest.approx(1.0, abs=2e-3)
    motion = sb.switch_branch(curve, point)
    assert motion.stable and motion.resolved and motion.sticking == 0
    branch = sb.quasi_periodic_response(motion, 0.0962, points=3, file=str(tmp_path / "curve.h5"))
    kept = sb.read(tmp_path / "curve.h5").motions[-1]
    last = branch.motions[-1]
    assert kept.friction_power == last.friction_power > 0.0 and np.array_equal(kept.states, last.states)
    driven = last.own.driven(last.frequencies[0])
    states = last.states + driven.linear_state
    rows = system.points.modes[:, -1]
    q, v = rows @ (states[0, :3] / driven.period.weights), rows @ states[0, 3:6]
    slip = driven.period.slip_units[1] * states[0, 7]
    found = integrated([*q, *v], slip, last.frequencies[0], 12)
    turns = last.frequencies[1] / last.frequencies[0] * np.arange(12)
    expected = [
        rows @ (filtered(states, shift(len(states), turn))[0, :3] / driven.period.weights) for turn in turns
    ]
    assert found == pytest.approx(np.array(expected), abs=2e-3 * np.abs(found).max())
    assert np.ptp(found, axis=0).min() > 0.05


# ---------------------------------------------------------------------- a body
BEAM = """
import json
import numpy as np
import sbfem_petsc as sb
from meshing import Beam, VNotch
from mpi4py import MPI
beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0, tilt=45.0)])
laws = {"crack1": sb.Coulomb(0.3)}
with sb.Model(beam.mesh(order=2), sb.Material(70e9, 0.33, 2700), damping=0.01, contact_laws=laws) as model:
    load = sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0) + sb.Harmonic(100.0, 375.0))
    found = sb.quasi_periodic(model, load, (3000.0, 375.0), samples=8, modes=20, stability=False)
    whole = sb.periodic(model, load, 3000.0, modes=20, stability=False)
lines = [abs(found.line(m, n, "A")) for m, n in ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (1, -2))]
spectrum = np.abs(whole.spectrum("A"))
told = {"lines": lines, "whole": spectrum[[8, 1, 9, 7, 10, 6]].tolist()}
told["lost"] = [found.friction_power, whole.friction_loss / whole.period]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps(told))
"""


@pytest.mark.long
def test_crack_on_two_ranks():
    """Lines of a tilted crack are those of the common period, to what both solve to, on one rank and two."""
    one, two = (answer(on_ranks(ranks, BEAM)) for ranks in (1, 2))
    for told in (one, two):
        lines, whole = np.array(told["lines"]), np.array(told["whole"])
        assert lines == pytest.approx(whole, rel=1e-6) and told["lost"][0] == pytest.approx(told["lost"][1])
    assert one["lines"] == pytest.approx(two["lines"], rel=1e-8)


def test_what_is_refused(mass):
    load = [1.0, sb.Constant(-2.0)]
    falling = slider(modes=1, contact_laws=sb.Coulomb(FRICTION, 1.5 * FRICTION))
    with pytest.raises(ValueError, match="quasi_periodic: friction falls where a slip begins"):
        sb.quasi_periodic(falling, tones(1.0, 0.6, 0.3712), (FREQUENCY, 0.3712 * FREQUENCY))
    curve = sb.frequency_response(mass, load, 0.26, 0.28, points=3)
    with pytest.raises(ValueError, match="grazing_points knows no friction yet"):
        sb.grazing_points(curve)
