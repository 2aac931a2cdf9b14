"""Free motions over the energy: one mass with a stop in closed form, two masses, the paper's beam with a
closed and an open crack, damping.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar, root

import sbfem_petsc as sb
from sbfem_petsc.continuation.problems.free import FreeMotions, FreeSystem
from tests.reference import paper_beam
from tests.systems import beside_another, coarse_beam

# a mass on a spring, with a stop on one side: N/m, m
SPRING, STOP, GAP = 10.0, 50.0, 0.01


def one_mass(damping=0.0):
    return sb.reduce_matrices(
        np.eye(1),
        np.array([[SPRING]]),
        np.array([[1.0]]),
        np.array([GAP]),
        loads=np.ones((1, 1)),
        sensors={"x": 0},
        damping=damping,
        compliance=np.array([1.0 / STOP]),
    )


def exact(energy):
    """Hz: times on either side of the stop, each part of a sine."""
    free, both = math.sqrt(SPRING), math.sqrt(SPRING + STOP)
    at_stop = 0.5 * SPRING * GAP**2
    if energy <= at_stop:
        return free / (2.0 * math.pi)
    outside = (math.pi + 2.0 * math.asin(GAP / math.sqrt(2.0 * energy / SPRING))) / free
    # beyond the stop about the rest position at which both springs are in balance
    speed, rest = math.sqrt(2.0 * (energy - at_stop)), SPRING * GAP / both**2
    return 1.0 / (outside + 2.0 * (math.pi / 2.0 - math.atan2(rest * both, speed)) / both)


def test_closed_form_itself():
    """Published values of the closed form, and its limit 2 f1 f2 / (f1 + f2)."""
    assert exact(1e-3) == pytest.approx(0.5568893, abs=5e-8)
    assert exact(1.0) == pytest.approx(0.7088064, abs=5e-8)
    assert exact(1e12) == pytest.approx(0.7147775, abs=5e-8)


@pytest.mark.slow
def test_one_mass_with_a_stop():
    """Within 1e-6 at every energy; the highest point is that of the free spring, the deepest where all energy
    is in both springs, but for half a step.
    """
    found = sb.backbone(one_mass(), 1, 4e-4, 1.0)
    expected = np.array([exact(energy) for energy in found.energy])
    assert found.complete and found.energy[0] == 4e-4 and found.energy[-1] == 1.0 and len(found.energy) > 10
    error = np.abs(found.frequency - expected)
    assert (error < 1e-6 * expected).all() and (found.frequency_error < 2e-6 * expected).all()
    assert (np.abs(found.damping_ratio) < 1e-10).all()
    motion = found.orbit(-1)
    assert motion.displacement("x")[:, 1].max() == pytest.approx(math.sqrt(2.0 / SPRING), rel=1e-6)
    both = SPRING + STOP
    root = math.sqrt((STOP * GAP) ** 2 - both * (STOP * GAP**2 - 2.0))
    assert motion.displacement("x")[:, 1].min() == pytest.approx(-(STOP * GAP + root) / both, rel=2e-5)


def test_progress():
    """The fraction of the range in logarithms, point by point up to the end."""
    told = []
    found = sb.backbone(
        one_mass(), 1, 4e-4, 1e-2, steps=128, refine=False, stability=False, progress=told.append
    )
    assert told == pytest.approx(np.log(found.energy[1:] / 4e-4) / np.log(25.0), abs=1e-9)
    assert len(told) > 3 and told[-1] == 1.0
    assert "Hz, stability not asked for, end of" in repr(found) and not found.stable.any()
    with pytest.raises(TypeError, match="backbone: progress = 3"):
        sb.backbone(one_mass(), 1, 4e-4, 1e-2, progress=3)


@pytest.mark.slow
def test_downwards_and_from_within():
    """From 1 J, where the stop is at work, down: the same curve."""
    found = sb.backbone(one_mass(), 1, 1.0, 1e-4, steps=2048)
    assert found.energy[0] == 1.0 and found.energy[-1] == 1e-4
    assert found.frequency == pytest.approx([exact(energy) for energy in found.energy], rel=1e-6)


@pytest.mark.slow
def test_damping_of_one_mass():
    """A damper c on one mass takes c v^2 whatever the motion: the self-excitation is c / m at every energy,
    the frequency that without damping, the ratio 0.01 f1 / f.
    """
    found = sb.backbone(one_mass(0.01), 1, 4e-4, 1.0, damping=True, steps=2048)
    assert found.frequency == pytest.approx([exact(energy) for energy in found.energy], rel=1e-6)
    own = math.sqrt(SPRING) / (2.0 * math.pi)
    assert found.damping_ratio == pytest.approx(0.01 * own / found.frequency, rel=1e-5)


def taken(energy, spring, stop, gap, damper):
    """What a damper takes of a mass 1 in a period, over 4 pi times the energy: c times the area that the
    free motion of this energy goes about in its phase plane.
    """

    def speed(u):
        return math.sqrt(max(0.0, 2.0 * energy - spring * u * u - stop * max(0.0, u - gap) ** 2))

    lower = -math.sqrt(2.0 * energy / spring)
    upper = brentq(lambda u: 2.0 * energy - spring * u * u - stop * max(0.0, u - gap) ** 2, 0.0, -lower)
    area = sum(
        quad(speed, one, other, epsabs=0.0, epsrel=1e-10)[0] for one, other in ((lower, gap), (gap, upper))
    )
    return damper * 2.0 * area / (4.0 * math.pi * energy)


def test_both_damping_ratios_beyond_a_stop():
    """Mass 1, spring 1, damping ratio 0.01, a stop of 8 at a distance of 1, at 0.898 J: by the rate of decay
    0.01 f1 / f, by the energy 0.0097369, both in closed form.
    """
    system = sb.reduce_matrices(
        np.eye(1),
        np.eye(1),
        np.eye(1),
        np.ones(1),
        loads=np.ones((1, 1)),
        sensors={"x": 0},
        damping=0.01,
        compliance=np.array([0.125]),
    )
    found = sb.backbone(system, 1, 0.4, 0.898, damping=True, stability=False)
    by_energy = [taken(energy, 1.0, 8.0, 1.0, 0.02) for energy in found.energy[found.energy > 0.5]]
    assert by_energy[-1] == pytest.approx(0.0097369, abs=5e-8)
    # within twice what half the step changes: switches inside the steps scatter
    error = np.abs(found.energy_damping_ratio[found.energy > 0.5] - by_energy)
    assert (error <= 2.0 * found.energy_damping_error[found.energy > 0.5] + 1e-15).all()
    assert found.energy_damping_ratio[-1] == pytest.approx(by_energy[-1], rel=1e-5)
    assert found.damping_ratio[-1] == pytest.approx(0.01 / (2.0 * math.pi * found.frequency[-1]), rel=1e-9)
    assert found.damping_ratio[-1] == pytest.approx(0.0089685, abs=5e-8)
    # below, nothing but the mode
    alone = found.energy < 0.5
    assert alone.any() and found.energy_damping_ratio[alone] == pytest.approx(0.01, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.05, 1e-4])
def test_multiplier_of_one_mass(ratio):
    """The self-excitation makes up for the damper at every instant: the motion is that without either, whose
    two multipliers are 1, and a disturbance of the driven one decays by exp(-c T / 2), exactly.
    """
    found = sb.backbone(one_mass(ratio), 1, 1e-4, 1.0, damping=True, refine=False)
    assert (found.energy > 5e-4).sum() > 15 and found.stable.all()
    expected = np.exp(-ratio * math.sqrt(SPRING) / found.frequency)
    assert found.multipliers.shape == (len(found.energy), 1) and not found.multipliers.imag.any()
    assert found.multipliers[:, 0].real == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
def test_damping_with_coarse_steps():
    """Extrapolated as the frequency is: within 1e-5 with 256 steps, and mostly within what is told."""
    found = sb.backbone(one_mass(0.01), 1, 4e-4, 1.0, damping=True, steps=256, stability=False)
    expected = 0.01 * math.sqrt(SPRING) / (2.0 * math.pi * np.array([exact(e) for e in found.energy]))
    error = np.abs(found.damping_ratio - expected)
    assert (error < 1e-5 * expected).all()
    assert (error <= found.damping_error + 1e-15).mean() > 0.9
    assert found.damping_error.max() > 1e-5 * 0.01


def test_extrapolation_takes_the_steps_error_away():
    """Of second order in the step: what half the step leaves of it is gone as well, to some per cent."""
    coarse, refined = (
        sb.backbone(one_mass(0.01), 1, 4e-4, 1.0, damping=True, steps=128, stability=False, refine=refine)
        for refine in (False, True)
    )
    expected = np.array([exact(energy) for energy in coarse.energy])
    beyond = coarse.energy > 0.01
    for left in (
        np.abs(np.array([item.frequency for item in (coarse, refined)]) - expected),
        np.abs(
            np.array([item.damping_ratio * expected for item in (coarse, refined)])
            - 0.01 * math.sqrt(SPRING) / (2.0 * math.pi)
        ),
    ):
        assert (left[1] < 0.05 * left[0])[beyond].all() and beyond.sum() > 5


@pytest.mark.long
def test_resonance_peak_is_on_it():
    """The peak of the forced response stands on the backbone at its amplitude, but for what a damping ratio
    of 0.02 moves a peak by: its square.
    """
    curve = sb.frequency_response(one_mass(0.02), 0.02, 0.5, 0.8, steps=1024, stability=False)
    top = int(np.argmax(curve.amplitude("x")))
    found = sb.backbone(one_mass(), 1, 4e-4, 1.0, largest_change=0.1, stability=False)
    expected = np.interp(curve.amplitude("x")[top], found.amplitude("x"), found.frequency)
    assert expected > 0.6 and curve.frequency[top] == pytest.approx(expected, rel=2e-3)


@pytest.mark.long
def test_forced_peaks_of_the_paper_come_to_it_as_damping_falls():
    """Mode 17, at 14.1 kHz, whose forced response is Fig. 11: forces in proportion to the damping, so that
    the amplitude stays; the distance falls with the square of the damping ratio.
    """
    reduced = sb.reduce(coarse_beam(0.002), sb.PointForce("A", fy=1.0), modes=50)
    options = {"refine": False, "stability": False, "steps": 512}
    free = sb.backbone(reduced, 17, 0.06, 0.14, largest_change=0.05, **options)
    frequency_of = PchipInterpolator(free.amplitude("A"), free.frequency)
    distance = []
    for ratio in (0.008, 0.004):
        damped = replace(reduced, damping=np.full(50, ratio))
        low, high = (14155.0 + side * 3500.0 * ratio + 4e5 * ratio**2 for side in (-1, 1))
        step = (high - low) / 25.0
        curve = sb.frequency_response(
            damped, [9e4 * ratio], low, high, steps=512, stability=False, largest_step=step
        )
        peak = curve.peak("A")
        assert 4e-6 < peak.amplitude < 5e-6
        distance.append(peak.frequency / float(frequency_of(peak.amplitude)) - 1.0)
    # 1.07e-3, 2.9e-4; then 7.7e-5, 2.0e-5, 4.6e-6
    assert distance[1] < 3.2e-4
    assert np.log2(np.array(distance[:-1]) / distance[1:]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.long
def test_a_high_mode_with_damping():
    """What makes up for the damping of mode 17 gives the lowest modes a ratio of -1.1: beyond critical."""
    reduced = sb.reduce(coarse_beam(0.002), sb.PointForce("A", fy=1.0), modes=50)
    options = {"refine": False, "stability": False, "steps": 512}
    found = sb.backbone(reduced, 17, 1e-4, 1e-3, damping=True, **options)
    # the faces do not meet at these energies
    assert found.frequency == pytest.approx(reduced.frequencies[16], rel=1e-9)
    assert found.damping_ratio == pytest.approx(0.002, rel=1e-6)


@pytest.mark.slow
def test_an_internal_resonance_is_followed():
    """The frequency of mode 1 rises towards half of that of mode 2 and stays there: the motion passes its
    energy on to mode 2. A motion of this part against an independent integration of the two masses, which
    returns after the period of the branch.
    """
    matrix, stop = np.array([[1.3, -0.3], [-0.3, 5.5]]), 2.0
    r = sb.reduce_matrices(
        np.eye(2),
        matrix,
        np.array([[1.0, 0.0]]),
        np.ones(1),
        loads=np.zeros((2, 1)),
        sensors={"1": 0, "2": 1},
        compliance=np.array([1.0 / stop]),
    )
    found = sb.backbone(r, 1, 0.4, 8.0, largest_change=0.05, refine=False, steps=1024)
    resonance = 0.5 * r.frequencies[1]
    assert found.complete and r.frequencies[0] < 0.97 * resonance
    assert np.abs(found.frequency[-10:] / resonance - 1.0).max() < 1e-3
    share = found.amplitude("2") / found.amplitude("1")
    assert share[0] < 0.1 and share[-1] > 1.0 and (np.diff(share[-10:]) > 0.0).all()
    shapes, m = r.points.modes[:, 1], len(r.omega)
    state = found.states[-1]
    start = np.concatenate([shapes @ (state[:m] / r.omega), shapes @ state[m:]])

    def rate(_, y):
        force = -matrix @ y[:2]
        force[0] += stop * max(0.0, -1.0 - y[0])
        return np.concatenate([y[2:], force])

    end = solve_ivp(rate, (0.0, 1.0 / found.frequency[-1]), start, rtol=1e-10, atol=1e-12, max_step=0.05)
    # the branch is of second order in its 1024 steps, (2 pi / 1024)^2 / 12 = 3e-6; found: 1.5e-6
    assert np.abs(end.y[:, -1] - start).max() < 1e-5 * np.abs(start).max()


def two_masses(gap=1.0, damping=0.0):
    """Unit masses and springs in a chain, stops of stiffness 30 on either side of mass 1."""
    return sb.reduce_matrices(
        np.eye(2),
        np.array([[2.0, -1.0], [-1.0, 1.0]]),
        np.array([[1.0, 0.0], [-1.0, 0.0]]),
        np.full(2, gap),
        loads=np.zeros((2, 1)),
        sensors={"1": 0, "2": 1},
        compliance=np.full(2, 1.0 / 30.0),
        damping=damping * np.array([[2.0, -1.0], [-1.0, 1.0]]),
    )


@pytest.mark.long
def test_second_mode_of_two_masses():
    """At 1.19768 J mass 1 moves by 0.8137 and does not reach the stops at 1: the linear 0.2575181 Hz. (The
    published 0.257905285 Hz is of stops made smooth, which push from afar; 1.5e-3 higher.) They are reached
    at 1.8090 J, beyond which the frequency rises.
    """
    r = two_masses()
    found = sb.backbone(r, 2, 0.5, 1.19768)
    linear = math.sqrt((3.0 + math.sqrt(5.0)) / 2.0) / (2.0 * math.pi)
    assert found.frequency == pytest.approx(linear, rel=1e-10)
    assert found.amplitude("1")[-1] == pytest.approx(0.8137, abs=1e-4)
    assert 0.257905285 / linear - 1.0 == pytest.approx(1.5e-3, rel=0.01)
    beyond = sb.backbone(r, 2, 1.7, 4.0)
    touching = 1.19768 / found.amplitude("1")[-1] ** 2
    assert (beyond.frequency[beyond.energy < touching] < linear * (1.0 + 1e-9)).all()
    rising = beyond.frequency[beyond.energy > 1.05 * touching]
    assert (np.diff(rising) > 0.0).all() and rising[-1] > 1.05 * linear


def integrated(state, duration, damper=0.0):
    """(u, v) of the two masses after a time, each stretch between contact changes by itself."""
    time, y = 0.0, np.array(state, dtype=float)
    side = 0.0 if abs(y[0]) < 1.0 else np.sign(y[0])
    while time < duration:
        matrix, push = np.array([[2.0 + 30.0 * abs(side), -1.0], [-1.0, 1.0]]), np.array([30.0 * side, 0.0])

        def rate(_, y, matrix=matrix, push=push):
            return np.concatenate([y[2:], push - matrix @ y[:2] - np.dot(damper, y[2:])])

        def reaches(_, y, side=side):
            return abs(y[0]) - 1.0 if side == 0.0 or side * y[0] > 0.0 else -1.0

        reaches.terminal, reaches.direction = True, -1.0 if side else 1.0
        part = solve_ivp(rate, (time, duration), y, method="DOP853", rtol=1e-12, atol=1e-13, events=reaches)
        time, y = part.t[-1], part.y[:, -1]
        side = (0.0 if side else np.sign(y[0])) if part.status == 1 else side
    return y


def energy_of(u):
    """J of the two masses at rest."""
    return 0.5 * u @ [[2.0, -1.0], [-1.0, 1.0]] @ u + 15.0 * max(0.0, abs(u[0]) - 1.0) ** 2


def from_rest(u, frequency, energy=None):
    """Displacements, and the frequency if an energy is given, from which the two masses come to rest again
    after half a period, near a guess.
    """

    def equations(x):
        f = frequency if energy is None else x[2]
        end = integrated([*x[:2], 0.0, 0.0], 0.5 / f)[2:]
        return end if energy is None else np.append(end, energy_of(x[:2]) / energy - 1.0)

    found = root(equations, u if energy is None else [*u, frequency], tol=1e-11)
    assert np.abs(found.fun).max() < 1e-9
    return found.x


@pytest.fixture(scope="module")
def damped():
    """Modes 1 and 2 of the two masses with dampers of 0.02 beside the springs."""
    return [sb.backbone(two_masses(damping=0.02), k, 0.5, 4.0, damping=True) for k in (1, 2)]


def independent(found, k):
    """Damping ratio and multipliers of a damped motion, by the independent integration from a guess: that
    along the motion is taken out of the product with its neighbour, which differences do not split.
    """
    r, m = found.reduced, len(found.reduced.omega)
    matrix = np.array([[2.0, -1.0], [-1.0, 1.0]])
    shapes = r.points.modes[:, 1]
    follow = shapes[:, found.mode - 1]
    guess = np.concatenate([shapes @ (found.states[k][:m] / r.omega), shapes @ found.states[k][m:]])
    excitation = 4.0 * math.pi * found.frequency[k] * found.damping_ratio[k]

    def flow(x, period, xi):
        return integrated(x, period, 0.02 * matrix - xi * np.eye(2))

    def equations(z):
        x = z[:4]
        return np.concatenate(
            [
                flow(x, z[4], z[5]) - x,
                [follow @ x[2:], energy_of(x[:2]) + 0.5 * x[2:] @ x[2:] - found.energy[k]],
            ]
        )

    solved = root(equations, np.concatenate([guess, [1.0 / found.frequency[k], excitation]]), tol=1e-11)
    assert np.abs(solved.fun).max() < 1e-8
    x, period, xi = solved.x[:4], solved.x[4], solved.x[5]
    columns = [(flow(x + h, period, xi) - flow(x - h, period, xi)) / 2e-5 for h in 1e-5 * np.eye(4)]
    values = np.linalg.eigvals(np.array(columns).T)
    near = np.argsort(np.abs(values - 1.0))
    one, other = near[0], near[1]
    if values[one].imag == 0.0 and values[other].imag:
        other = next(n for n in near[1:] if values[n].imag == 0.0)
    rest = np.append(np.delete(values, [one, other]), values[one] * values[other])
    return xi * period / (4.0 * math.pi), rest * math.exp(-0.5 * xi * period)


@pytest.mark.long
def test_multipliers_and_damping_of_two_masses(damped):
    """Against SciPy's integration between contact changes, by differences: multipliers to 1e-3, beyond the
    unit circle to 5e-3 of the largest, the ratio within twice what is told; and at every point the volume in
    the state space falls as the trace of the dampers says (Liouville).
    """
    for found in damped:
        assert found.complete
        ours, conjugate = np.sort_complex(found.multipliers), np.sort_complex(found.multipliers.conj())
        assert ours == pytest.approx(conjugate, abs=1e-12)
        loss = (0.02 * 3.0 - 0.5 * found.excitation) / found.own_frequency
        assert np.prod(found.multipliers, axis=1) == pytest.approx(np.exp(-loss), rel=3e-5)
        for k in np.linspace(len(found.energy) // 2, len(found.energy) - 1, 5).astype(int):
            ratio, values = independent(found, k)
            largest = np.abs(values).max()
            distance = [np.abs(found.multipliers[k] - value).min() for value in values]
            assert max(distance) < (1e-3 if largest < 1.0 else 5e-3 * largest)
            assert abs(found.damping_ratio[k] - ratio) < 2.0 * found.damping_error[k]


@pytest.mark.long
def test_nothing_is_passed_over_where_nothing_touches(damped):
    """Contact begins at 0.69124 J; below, the motion is the mode alone and meets no other."""
    assert damped[0].energy[0] < 0.68 and not damped[0].passed


@pytest.fixture(scope="module")
def turning():
    """The branch of mode 1 of the two masses up to 100 J, and its displacements at rest."""
    r = two_masses()
    found = sb.backbone(r, 1, 0.5, 100.0, interactions=True, largest_change=0.1, points=400, refine=False)
    return found, found.states[:, :2] / r.omega @ r.points.modes[:, 1].T


@pytest.mark.long
def test_a_branch_that_turns_back_in_energy(turning):
    """Mode 1 with a stop to either side turns where mass 1 begins to touch and comes back; again at 56 J,
    where three times its frequency is that of mode 2, down to 7.19 J, where it is mode 2 for three periods,
    through it, and after two more turns on to 100 J. Energies of the turns and motions between them by an
    independent integration from contact change to contact change: 1024 steps are good to 1e-3 of a turn's
    energy and 3e-5 of a frequency.
    """
    found, displacement = turning
    energy, frequency = found.energy, found.frequency
    turns = 1 + np.flatnonzero(np.diff(np.sign(np.diff(energy))))
    assert found.complete and not found.passed
    # two of the turns are near where the branch crosses that of mode 2, and near a grazing
    assert energy[turns] == pytest.approx([0.691239, 0.674821, 56.15923, 7.1903, 18.75787, 4.75130], rel=2e-3)
    for k in turns[[1, 2, 4]]:
        sign = np.sign(energy[k] - energy[k - 1])

        def depth(f, k=k, sign=sign):
            return -sign * energy_of(from_rest(displacement[k], f))

        bounds = sorted((frequency[k - 1], frequency[k + 1]))
        exact = minimize_scalar(depth, bounds=bounds, method="bounded", options={"xatol": 1e-7})
        assert energy[k] == pytest.approx(-sign * exact.fun, rel=1e-3)
    ends = np.concatenate([[0], turns, [len(energy) - 1]])
    for k in (ends[1:] + ends[:-1]) // 2:  # in the midst of every stretch
        *u, exact = from_rest(displacement[k], frequency[k], energy[k])
        assert frequency[k] == pytest.approx(exact, rel=3e-5)
        assert displacement[k] == pytest.approx(u, abs=1e-3 * np.abs(u).max())


@pytest.mark.long
def test_a_tongue_that_is_not_passed_over(turning):
    """Where the coupling is too strong to pass the interaction over by way of damped motions the branch is
    followed, and what is passed over lies beyond all energies before.
    """
    expected, _ = turning
    found = sb.backbone(two_masses(), 1, 0.5, 100.0, points=400, refine=False, stability=False)
    assert found.complete and found.energy[-1] == 100.0
    assert found.frequency[-1] == pytest.approx(expected.frequency[-1], rel=1e-6)
    for before, after in found.passed:
        assert after > found.energy[: 1 + np.flatnonzero(found.energy == before)[0]].max()


def of_a_mass_and_a_stop(energy, stop):
    """rad/s of mass 1 on a spring 1 with a stop at 1."""
    both = math.sqrt(1.0 + stop)
    outside = math.pi + 2.0 * math.asin(1.0 / math.sqrt(2.0 * energy))
    speed, rest = math.sqrt(2.0 * energy - 1.0), 1.0 / both**2
    inside = 2.0 * (math.pi / 2.0 - math.atan2(rest * both, speed)) / both
    return 2.0 * math.pi / (outside + inside)


@pytest.mark.parametrize("other, times, coupling", [(2.4, 2, 0.003), (3.5, 3, 0.03)])
def test_narrow_interactions_are_told(other, times, coupling):
    """A mass with a stop, coupled a little to another one: steps lead over the energy at which twice or three
    times the frequency, in closed form, is the other's, and `passed` holds it; without coupling none is met.
    """
    expected = brentq(lambda energy: times * of_a_mass_and_a_stop(energy, 3.0) - other, 0.6, 20.0)
    found = sb.backbone(beside_another(coupling, other), 1, 0.4, 20.0, steps=256, refine=False)
    ((before, after),) = found.passed
    assert before < expected < after < 1.2 * before
    assert before in found.energy and after in found.energy
    alone = sb.backbone(beside_another(0.0, other), 1, 0.4, 20.0, steps=256, refine=False)
    assert alone.complete and not alone.passed


def test_a_corner_is_not_an_interaction():
    """Nothing but the stop: no mode to interact with."""
    assert not sb.backbone(one_mass(), 1, 4e-4, 1.0, steps=128, refine=False).passed


@pytest.mark.long
def test_events_of_two_masses(turning):
    """Turns are within 1e-3 of those integrated, beyond the points next to them; multipliers leave the circle
    between points of which one is stable and the other is not.
    """
    found, _ = turning
    folds = [event for event in found.events if event.kind == "fold"]
    expected = [0.691239, 0.674821, 56.15923, 7.1903, 18.75787, 4.75130]
    assert [event.energy for event in folds] == pytest.approx(expected, rel=1e-3)
    for event in folds:  # one may be a point itself
        ends = found.energy[event.after - 1 : event.after + 1]
        assert event.energy > (1.0 - 1e-6) * ends.max() or event.energy < (1.0 + 1e-6) * ends.min()
    for event in set(found.events) - set(folds):
        assert found.stable[event.after - 1] != found.stable[event.after]
        ends = sorted(found.energy[event.after - 1 : event.after + 1])
        assert ends[0] <= event.energy <= ends[1] and abs(event.multiplier) > 1.0


def test_largest_step_and_points_where_the_branch_bends():
    """The energy changes by no more than is asked for; and by default a chord of the frequency over the
    logarithm of the energy is off the closed form by no more than 2 % of its range at any energy.
    """
    few = sb.backbone(one_mass(), 1, 4e-4, 1e-2, steps=512, stability=False)
    fine = sb.backbone(one_mass(), 1, 4e-4, 1e-2, steps=512, stability=False, largest_step=4e-4)
    assert np.diff(few.energy).max() > 8e-4 and np.diff(fine.energy).max() < 4.01e-4
    energies = np.geomspace(4e-4, 1e-2, 400)
    chord = np.interp(np.log(energies), np.log(few.energy), few.frequency)
    expected = np.array([exact(energy) for energy in energies])
    assert np.abs(chord - expected).max() < 0.02 * np.ptp(expected)


@pytest.mark.long
def test_a_motion_of_two_masses_repeats():
    """A free history from a point of the branch, by `transient`, returns after each of ten periods, and its
    energy is that of the branch.
    """
    r = two_masses()
    found = sb.backbone(r, 2, 1.5, 3.0, steps=8192, refine=False)
    motion, m = found.orbit(-1), len(r.omega)
    state = found.states[-1]
    history = sb.transient(
        r,
        [0.0],
        10.0 * motion.period,
        step=motion.period / 8192,
        initial=(state[:m] / r.omega, state[m:]),
    )
    u = history.displacement("2")[:, 1]
    assert np.abs(u[::8192] - u[0]).max() < 1e-6 * np.abs(u).max()
    assert history.energy.total[-1] == pytest.approx(3.0, rel=1e-5)


@pytest.fixture(scope="module")
def closed():
    """The paper's beam with a closed crack, 30 modes."""
    return beam(0.0)


def beam(opening, damping=0.0):
    model = sb.Model(
        paper_beam(opening=opening).mesh(order=4, face_edges=1),
        sb.Material(young=70e9, poisson=0.33, density=2700),
        damping=damping,
        tip_modes=0,  # a threshold of contact, and a bilinear formula, are those of pairs
    )
    # any load: a backbone has none
    return sb.periodic(model, sb.PointForce("A", fy=1e-9), 100.0, modes=30, stability=False).reduced


def tied(r):
    """Hz: frequencies with the faces tied, by the flexibility of the pairs."""
    stiffness = np.diag(r.omega**2) + r.gap.modes.T @ np.linalg.pinv(r.gap.contact) @ r.gap.modes
    return np.sqrt(np.linalg.eigvalsh(stiffness)) / (2.0 * np.pi)


@pytest.mark.long
@pytest.mark.parametrize("mode, error", [(1, 1e-5), (2, 2e-5), (3, 6e-4), (4, 6e-4), (5, 2e-3)])
def test_closed_crack(closed, mode, error):
    """The same frequency at every energy, and, within what the coupling of modes leaves, that of the bilinear
    formula 2 f1 f2 / (f1 + f2) of the open and the tied beam.
    """
    open_side, both = closed.frequencies[mode - 1], tied(closed)[mode - 1]
    formula = 2.0 * open_side * both / (open_side + both)
    found = sb.backbone(closed, mode, 1e-4, 1.0, refine=False)
    assert np.ptp(found.frequency) == 0.0 and found.energy[-1] == 1.0
    assert found.frequency[0] == pytest.approx(formula, rel=error)
    assert abs(found.frequency[0] - formula) < 0.1 * (both - open_side)
    if mode in (1, 2):
        again = sb.backbone(closed, mode, 50.0, 100.0, refine=False, stability=False)
        assert again.frequency[0] == pytest.approx(found.frequency[0], rel=1e-9)


@pytest.mark.long
def test_error_of_a_closed_crack():
    """Half the step does not converge from the motion of mode 3 with the default mesh and steps, but by way
    of damped motions; within what is told of the frequency with four times the steps.
    """
    shape = paper_beam(opening=0.0)
    model = sb.Model(shape.mesh(), sb.Material(young=70e9, poisson=0.33, density=2700))
    found = sb.backbone(model, 3, 1e-3, 2e-3, stability=False)
    finer = sb.backbone(model, 3, 1e-3, 2e-3, stability=False, steps=4096, refine=False)
    assert (found.frequency_error < 1e-6 * found.frequency).all()
    assert (np.abs(found.frequency - finer.frequency) < found.frequency_error).all()


@pytest.fixture(scope="module")
def opened():
    """The paper's beam, damping ratio 0.005, 30 modes."""
    return beam(0.0458366, 0.005)


@pytest.mark.slow
def test_open_crack(opened):
    """Mode 5: the open beam's frequency until the faces meet, then rising to that of the closed crack."""
    found = sb.backbone(opened, 5, 1e-4, 20.0, refine=False)
    own, both = opened.frequencies[4], tied(opened)[4]
    limit = 2.0 * own * both / (own + both)
    assert found.complete and found.frequency[found.energy < 1e-3] == pytest.approx(own, rel=1e-9)
    assert (np.diff(found.frequency) > -1e-9 * own).all()
    assert own + 0.8 * (limit - own) < found.frequency[-1] < limit
    # small motions are neither damped nor excited
    assert found.stable[0] and np.abs(found.multipliers[0]) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_damping_of_an_open_crack(opened):
    """Mode 1: the ratio is the modal one until the faces meet and falls as the motion shares its energy with
    higher modes; the frequency rises towards that of the closed crack.
    """
    found = sb.backbone(opened, 1, 1e-4, 20.0, damping=True, refine=False)
    own, both = opened.frequencies[0], tied(opened)[0]
    limit = 2.0 * own * both / (own + both)
    assert found.complete and not found.passed and found.stable.all()
    assert found.damping_ratio[found.energy < 1e-3] == pytest.approx(0.005, rel=1e-9)
    assert own + 0.9 * (limit - own) < found.frequency[-1] < limit
    assert 0.0048 < found.damping_ratio[-1] < 0.00495


@pytest.mark.long
def test_interactions_are_passed_over(opened):
    """Mode 1 without damping meets multiples of its frequency that are those of higher modes; the branch goes
    on beyond them, on the curve of the damped motion to 1e-4.
    """
    found = sb.backbone(opened, 1, 1e-4, 20.0, refine=False, stability=False)
    damped = sb.backbone(opened, 1, 1e-4, 20.0, damping=True, refine=False, stability=False)
    assert found.complete and found.passed
    assert all(after < 1.5 * before for before, after in found.passed)
    smooth = np.interp(np.log(found.energy), np.log(damped.energy), damped.frequency)
    assert np.abs(found.frequency - smooth).max() < 2e-3 * own_shift(opened)


def own_shift(r):
    """Hz: how far mode 1 moves in all, times a hundred."""
    return 100.0 * (tied(r)[0] - r.frequencies[0])


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"mode": 0}, "mode = 0 must be at least 1"),
        ({"mode": 2}, "mode = 2 must be an elastic one of the 1 modes kept"),
        ({"mode": 1.0}, "mode = 1.0 must be a whole number"),
        ({"start": 0.0}, "start = 0"),
        ({"stop": 4e-4}, "stop = 0.0004 is start itself"),
        ({"steps": 3}, "steps = 3 must be at least 48"),
    ],
)
def test_bad_requests(arguments, sentence):
    given = {"mode": 1, "start": 4e-4, "stop": 1.0, **arguments}
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.backbone(one_mass(), **given)


def test_a_motion_that_is_found_with_damping_only(monkeypatch):
    """Then the sentence says so, and what to do."""

    def without(*_):
        raise sb.SolveError("backbone: Newton's method did not converge at 1 Hz")

    monkeypatch.setattr(FreeSystem, "without", without)
    with pytest.raises(sb.SolveError, match="with a damping ratio of .* not without it .*take damping=True"):
        sb.backbone(replace(one_mass(), initial_gap=np.zeros(1)), 1, 0.1, 0.2)


def test_a_branch_cut_short():
    """Too few points: an error with what there is."""
    with pytest.raises(sb.SolveError, match="ends at .* J after 3 points, before 1 J: 3 points") as caught:
        sb.backbone(one_mass(), 1, 4e-4, 1.0, points=3)
    assert len(caught.value.backbone.energy) == 3 and not caught.value.backbone.complete


def test_what_a_motion_from_rest_has():
    """Displacements of the modes, no velocities; its frequency, no damping."""
    motions = FreeMotions(FreeSystem(beside_another(0.01, 3.5), 0, 64))
    assert motions.free.tolist() == [True, True, False, False, True, False]
