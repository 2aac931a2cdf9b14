"""Loci of bifurcations and basins of attraction with friction: multipliers, folds and where histories
settle against integrations of the equations as they stand.
"""

import math

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.contact.closed_sets import ClosedSets
from sbfem_petsc.contact.friction import AGAINST, ALONG
from sbfem_petsc.contact.located_switches import switches
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import Period
from tests.contact.test_friction_in_motion import FRICTION, PRESSURE, jenkins, slider
from tests.contact.test_friction_of_tones import BOUND, DAMPING, PULL, STOP, rubbed_masses

LOAD = [0.1, sb.Constant(-1.0)]


def integrated(places, speeds, slip, frequency, load, periods, steps=400):
    """Largest displacement of the first of `rubbed_masses` in the last of some periods, of many motions:
    Runge and Kutta's steps of the equations, the slider after each of them.
    """
    bound, step, rate = BOUND / 1.004, 1.0 / (steps * frequency), 2.0 * math.pi * frequency
    x, v = np.array(places, dtype=float), np.array(speeds, dtype=float)  # (2, n)

    def rates(t, x, v):
        pull = np.clip(PULL * (slip - x[1]), -bound, bound)
        first = x[1] - x[0] + STOP * np.maximum(-x[0] - 1.0, 0.0) - DAMPING * (v[0] - v[1])
        other = x[0] - 2.0 * x[1] + load * np.sin(rate * t) + pull - DAMPING * (2.0 * v[1] - v[0])
        return v, np.array([first, other])

    largest = np.zeros(x.shape[1])
    for n in range(periods * steps):
        t = n * step
        one = rates(t, x, v)
        two = rates(t + 0.5 * step, x + 0.5 * step * one[0], v + 0.5 * step * one[1])
        three = rates(t + 0.5 * step, x + 0.5 * step * two[0], v + 0.5 * step * two[1])
        four = rates(t + step, x + step * three[0], v + step * three[1])
        x = x + step / 6.0 * (one[0] + 2.0 * two[0] + 2.0 * three[0] + four[0])
        v = v + step / 6.0 * (one[1] + 2.0 * two[1] + 2.0 * three[1] + four[1])
        slip = np.clip(slip, x[1] - bound / PULL, x[1] + bound / PULL)
        if n >= (periods - 1) * steps:
            largest = np.maximum(largest, np.abs(x[0]))
    return largest


def as_they_stand(system, weights, states):
    """Places and speeds of both masses, (2, n) each, of states (n, 2 m)."""
    shapes = system.points.modes[:, -1]
    return shapes @ (states[:, :3] / weights).T, shapes @ states[:, 3:6].T


@pytest.fixture(scope="module")
def curve():
    return turning(1.0)


def turning(factor):
    """From the large motion on over its fold."""
    load = [factor * LOAD[0], LOAD[1]]
    return sb.frequency_response(rubbed_masses(), load, 0.09, 0.125, steps=512, points=300)


def test_multipliers_of_rows_that_land():
    """Six masses with an oblique stop that lands, sticks and slips, against differences of the map over a
    period by SciPy's integration with located events (1.1240, a pair of 0.9014): where a row lands later it
    has slid on, without which 0.9327 would be told, a stable motion.
    """
    rng = np.random.default_rng(2)
    assert rng.integers(3, 7) == 6 and rng.integers(1, 4) == 1
    root, mass = rng.normal(size=(6, 6)), np.diag(rng.uniform(0.5, 2.0, 6))
    rows, along = rng.normal(size=(1, 6)), rng.normal(size=(1, 6))
    gap, across, give = rng.uniform(-0.02, 0.03, 1), rng.uniform(0.02, 0.1, 1), rng.uniform(0.02, 0.1, 1)
    coefficient, loads = float(rng.uniform(0.1, 1.2, 1)[0]), rng.normal(size=(6, 2))
    system = sb.reduce_matrices(
        mass,
        root @ root.T + 6.0 * np.eye(6),
        rows,
        gap,
        loads=loads,
        sensors={"u": 0},
        rayleigh=(0.02, 0.01),
        compliance=across,
        contact_laws=sb.Coulomb(coefficient),
        tangent_rows=along,
        tangent_compliance=give,
    )
    frequency = system.frequencies[0] * rng.uniform(0.6, 1.3)
    size, rest = rng.uniform(0.3, 1.0, 2), rng.uniform(-0.3, 0.3, 2)
    push = [
        sb.Harmonic(size[0], frequency) + float(rest[0]),
        sb.Harmonic(size[1], 2.0 * frequency, 0.7) + float(rest[1]),
    ]
    found = sb.periodic(system, push, frequency, steps=1024)
    assert np.abs(found.multipliers[:3]) == pytest.approx([1.1240, 0.9014, 0.9014], abs=1e-3)
    assert found.stable is False


def test_multipliers_with_switches_located():
    """How fast SciPy's history, its switches located, comes to its steady state: to second order in the step,
    where steps as they are jump about it.
    """
    rate, mass = 1.7, slider(modes=1)
    frequency = rate / (2.0 * math.pi)
    x, _ = jenkins(1.0, rate, np.arange(640) / (64.0 * frequency))
    ratios = np.diff(x[::64])[1:] / np.diff(x[::64])[:-1]
    gains = np.diff(ratios[-3:])
    expected = ratios[-1] + gains[1] ** 2 / (
        gains[0] - gains[1]
    )  # of a sequence that converges geometrically
    errors = []
    for steps in (128, 512):
        signals = [sb.Harmonic(1.0, frequency), sb.Constant(-2.0)]
        driven = Period(mass, Excitation.of(signals, frequency, None, 8), steps).at(frequency)
        state = driven.linear_state
        for _ in range(12):
            state = state + driven.run(state).residual
        motion = shoot(driven, state).motion
        found = np.linalg.eigvals(driven.monodromy(motion, rubbing=True))
        errors.append(np.abs(found - expected).min())
    assert errors[0] < 7e-3 and errors[1] < 5e-4


@pytest.mark.parametrize("turn", [18.2, 18.8])
def test_switches_inside_a_step(turn):
    """Of a slider under a pressure that stays, whose place is a sine, turned about at `turn` steps: it sticks
    until its spring has been wound to the other side, by a way that takes about the root of some `size`
    steps. Turning and leaving, in one step or in several, are told near where the sine has them.
    """
    steps, rate = 64, 2.0 * math.pi / 64.0
    body = slider(modes=1)
    constants = (
        Period(body, Excitation.of([sb.Harmonic(1.0, 0.1), sb.Constant(-2.0)], 0.1, None, 8), steps)
        .at(0.1)
        .constants
    )
    bound = FRICTION * PRESSURE
    wound = 2.0 * bound * constants.residual[1, 1]  # the way from sliding to sliding
    for size in (0.05, 0.3, 0.6, 3.0):
        peak = 2.0 * wound / (size * rate**2)  # sin'' there moves by this way in root(size) steps
        place = -peak * np.cos(rate * (np.arange(2 * steps + 1) - turn))
        trial, friction = 0.0, np.zeros(2 * steps + 1)
        states = np.ones((2 * steps + 1, 2), dtype=np.int8)
        for n in range(1, 2 * steps + 1):  # a period to settle
            trial = friction[n - 1] - (place[n] - place[n - 1]) / constants.residual[1, 1]
            friction[n] = np.clip(trial, -bound, bound)
            if abs(trial) > bound:
                states[n, 1] = ALONG if trial > 0.0 else AGAINST
        states, friction, place = states[steps:], friction[steps:], place[steps:]
        forces = np.column_stack([np.full(steps + 1, PRESSURE), friction])
        slips = place + constants.residual[1, 1] * friction
        told = switches(
            constants,
            (states, forces, np.zeros((steps, 1, 3))),
            lambda n, rows, slips=slips: np.where(rows == 1, slips[n], 0.0),
            ClosedSets(constants.left.T, constants.residual, constants.rubbing),
        ).time
        leaves = math.acos(1.0 - wound / peak) / rate
        exact = np.sort([turn, turn + leaves, turn + steps / 2.0, turn + steps / 2.0 + leaves])
        np.testing.assert_allclose(told[::2], exact[::2], atol=0.13)
        np.testing.assert_allclose(told[1::2], exact[1::2], atol=0.07)


@pytest.mark.long
def test_loci_meet_the_bifurcations_of_curves(curve):
    """A fold's line ends at the turn of a curve under another load, which no multiplier tells, and a
    Neimark-Sacker point's line where those of its steps leave the circle, to what these jump by.
    """
    other = turning(1.1)
    for kind, tolerance in (("fold", 3e-6), ("Neimark-Sacker", 3e-4)):
        begin, end = (next(item for item in one.bifurcations if item.kind == kind) for one in (curve, other))
        line = sb.locus(curve, begin, 1.0, 1.1, points=20)
        reached = line.frequency[line.value == 1.1]
        assert np.abs(reached / end.own_value - 1.0).min() < tolerance
        assert np.abs(np.abs(line.multiplier) - 1.0).max() < 1e-6


@pytest.mark.long
def test_motions_fall_beyond_a_line_of_folds(curve):
    """Histories that begin with the motion at a point of the line stay with the large one below its
    frequency and fall above it.
    """
    system, period = curve.reduced, curve.period
    first = next(item for item in curve.bifurcations if item.kind == "fold")
    line = sb.locus(curve, first, 0.8, 1.2)
    apart = np.array([[1.0 - 5e-4], [1.0 + 5e-4]])
    chosen = np.arange(0, len(line), 4)
    states = np.tile(line.states[chosen], (2, 1))
    frequency, load = (apart * line.frequency[chosen]).ravel(), 0.1 * np.tile(line.value[chosen], 2)
    slip = period.slip_units[1] * states[:, 7]
    found = integrated(*as_they_stand(system, period.weights, states), slip, frequency, load, 150)
    stays, falls = np.split(found, 2)
    assert (stays > 1.1).all() and (falls < 1.0).all()


@pytest.mark.long
def test_basins_against_histories(curve):
    """Which motion histories from many states settle on, slips being zero at first."""
    system, period, frequency = curve.reduced, curve.period, 0.11
    load = [sb.Harmonic(0.1, frequency), LOAD[1]]
    grid = np.array(np.meshgrid(np.linspace(-2.0, 2.0, 7), np.linspace(-2.0, 2.0, 7))).reshape(2, -1).T
    q, v = np.zeros((49, 3)), np.zeros((49, 3))
    q[:, 0], v[:, 0] = grid.T
    q[:, 2] = period.rest[2] / period.weights[2]  # what presses is at rest
    found = sb.basins(system, load, frequency, (q, v), steps=256)
    assert len(found.orbits) == 2 and found.states.shape == (49, 6)
    places, speeds = as_they_stand(system, period.weights, found.states)
    largest = integrated(places, speeds, np.zeros(49), frequency, 0.1, 60)
    large = max(orbit.amplitude("1") for orbit in found.orbits)
    expected = [orbit.amplitude("1") == large for orbit in found.orbits]
    assert np.array_equal(np.array(expected)[found.reached], largest > 0.8)
    assert 0.2 < found.share[0] < 0.8
    one = sb.basins(system, load, frequency, (q[:1], v[:1]), around=found.orbits[0])
    assert one.orbits and one.reached[0] in (0, 1)


def test_slips_that_stick_throughout_are_one_motion():
    """A mass that swings on its slider rests wherever it has come to: one orbit, and that is no failure."""
    frequency = 1.7 / (2.0 * math.pi)
    system = slider(modes=1, damping=0.05)
    load = [sb.Harmonic(0.2, frequency), sb.Constant(-2.0)]
    axes = [sb.StartAxis(np.linspace(-0.8, 0.8, 5))]
    found = sb.basins(system, load, frequency, axes, steps=128)
    assert len(found.orbits) == 1 and found.share[0] == 1.0 and found.orbits[0].sticking == 1


def test_what_is_refused():
    falling = slider(modes=1, contact_laws=sb.Coulomb(FRICTION, 1.5 * FRICTION))
    load = [1.0, sb.Constant(-2.0)]
    branch = sb.frequency_response(falling, load, 0.26, 0.27, steps=64, points=3)
    with pytest.raises(ValueError, match="loci: friction falls where a slip begins"):
        sb.loci(branch, 0.5, 1.5)
    with pytest.raises(ValueError, match="basins: friction falls where a slip begins"):
        sb.basins(falling, [sb.Harmonic(1.0, 0.26), load[1]], 0.26, [sb.StartAxis([0.0])])


def test_slips_that_stick_make_no_orbits_of_their_own():
    """Of twelve blocks in a chain, each pressed on a rough ground, some stick throughout: histories that seem
    to repeat themselves after several periods, for they decay slowly, come to one orbit as others do.
    """
    count = 12
    stiffness = np.zeros((2 * count, 2 * count))
    stiffness[:count, :count] = 2.0 * np.eye(count) - np.eye(count, k=1) - np.eye(count, k=-1)
    stiffness[count:, count:] = 10.0 * np.eye(count)
    pressed, along = np.zeros((2, count, 2 * count))
    pressed[:, count:], along[:, :count] = np.eye(count), np.eye(count)
    loads = np.zeros((2 * count, 2))
    loads[0, 0], loads[count:, 1] = 1.0, 1.0
    chain = sb.reduce_matrices(
        np.eye(2 * count),
        stiffness,
        pressed,
        np.zeros(count),
        loads=loads,
        sensors={"x": 0},
        damping=0.05 * stiffness,
        compliance=[1e-3] * count,
        contact_laws=[sb.Coulomb(0.1)] * count,
        tangent_rows=along,
        tangent_compliance=[0.05] * count,
    )
    signals = [sb.Harmonic(0.4, 0.15), sb.Constant(-1.0)]
    found = sb.basins(chain, signals, 0.15, [sb.StartAxis([-0.5, 0.5])], steps=128)
    assert len(found.orbits) == 1 and found.orbits[0].sticking


@pytest.mark.long
def test_a_line_of_a_crack():
    """Of the 75 pairs of a closed notch that leans by 45 degrees, between which there is no length: what
    doubles its period under one load does so at the same frequency under every other one, and where the curve
    has located it.
    """
    beam = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0, tilt=45.0)])
    with sb.Model(
        beam.mesh(), sb.Material(70e9, 0.33, 2700), damping=0.002, contact_laws={"crack1": sb.Coulomb(0.3)}
    ) as model:
        push = sb.PointForce("A", fy=300.0)
        curve = sb.frequency_response(model, push, 2838.0, 2843.0, modes=80, steps=256)
        (begin,) = (item for item in curve.bifurcations if item.kind == "period doubling")
        line = sb.locus(curve, begin, 1.0, 1.01)
    assert len(line) > 2 and line.value[-1] == 1.01
    assert line.frequency == pytest.approx(np.full(len(line), line.frequency[0]), rel=1e-8)
    # the curve's multipliers are those of its steps, which jump
    assert abs(line.frequency[0] - begin.value) < 2.0 * begin.error < 3e-4 * begin.value
