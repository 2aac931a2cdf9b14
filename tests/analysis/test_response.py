"""Response curves over frequency and load: folds and corners from both sides, peaks, the beam's five curves,
refusals.
"""

import copy
import itertools
from dataclasses import replace

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing.warnings import BranchWarning
from sbfem_petsc.continuation import branch_following, events, follow
from sbfem_petsc.continuation.branch import find_peak
from sbfem_petsc.continuation.events import Way, between
from sbfem_petsc.continuation.follow import Follower, Line, Settings
from sbfem_petsc.continuation.problem import Point, Range
from sbfem_petsc.continuation.problems.driven_orbits import Orbits, OrbitState, ParameterRange
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import Period
from sbfem_petsc.reduction.matrices import reduce_matrices
from tests.parallel import alone, answer, on_ranks
from tests.systems import case_p, two_masses

TURN = 2 * np.pi


def with_a_stop(gap=1.0, zeta=0.05, compliance=2.0):
    """One mode (1 rad/s) and a soft stop."""
    return reduce_matrices(
        np.eye(2),
        np.diag([1.0, 1e6]),
        np.array([[1.0, 0.0]]),
        np.array([gap]),
        loads=np.array([[1.0], [0.0]]),
        sensors={"x": 0},
        modes=1,
        damping=zeta,
        compliance=np.array([compliance]),
    )


@pytest.fixture(scope="module")
def curves():
    """Upwards and downwards."""
    return [
        sb.frequency_response(two_masses(), [0.1], start / TURN, stop / TURN, steps=2048, stability=False)
        for start, stop in ((0.5, 0.9), (0.9, 0.5))
    ]


def crossings(curve, omega):
    """Amplitudes of the second mass where a curve passes a frequency, in order of size."""
    x, a = TURN * curve.frequency, curve.amplitude("2")
    k = np.flatnonzero((x[:-1] - omega) * (x[1:] - omega) <= 0)
    return np.sort(a[k] + (a[k + 1] - a[k]) * (omega - x[k]) / (x[k + 1] - x[k]))


@pytest.mark.long
def test_the_same_branch_from_both_ends(curves):
    """Up and down, through two folds and the corner at 0.653 rad/s where the stop is met: one curve, complete
    both ways.
    """
    up, down = curves
    assert up.complete and down.complete and up.converged.all() and down.converged.all()
    assert TURN * up.value[[0, -1]] == pytest.approx([0.5, 0.9]) and TURN * down.value[
        [0, -1]
    ] == pytest.approx([0.9, 0.5])
    for curve in curves:
        turns = np.flatnonzero(np.diff(np.sign(np.diff(curve.value))))
        assert len(turns) == 2
    for omega, count in ((0.55, 1), (0.64, 1), (0.70, 3), (0.74, 3), (0.80, 1)):
        found = [crossings(curve, omega) for curve in curves]
        assert len(found[0]) == len(found[1]) == count
        # linear between points that are up to 0.02 rad/s apart
        np.testing.assert_allclose(found[0], found[1], rtol=0.01)


@pytest.mark.long
def test_points_are_periodic_motions(curves):
    """Each point is the orbit that `periodic` finds from it; harmonics and amplitudes are that orbit's."""
    up = curves[0]
    for k in (3, 20, 45, len(up.value) - 4):
        orbit = up.orbit(k)
        again = sb.periodic(up.reduced, [0.1], float(up.value[k]), steps=2048, guess=orbit, stability=False)
        assert (
            np.linalg.norm(again.state - up.states[k]) < 1e-8 * np.linalg.norm(up.states[k])
            and again.iterations <= 1
        )
        np.testing.assert_allclose(
            again.harmonics("2")[:21], up.harmonics("2")[k], atol=1e-8 * again.amplitude("2")
        )
        assert again.amplitude("2") == pytest.approx(up.amplitude("2")[k], rel=1e-8)
        assert again.contact_resultant.max() == pytest.approx(up.contact_peak[k], rel=1e-6, abs=1e-9)


@pytest.mark.long
def test_open_part_is_linear(curves):
    """Where the stop is not met: (K - w^2 M + 0.03 i w K)^-1 f to 1e-10."""
    up, k = curves[0], np.array([[1.0, -1.0], [-1.0, 2.0]])
    away = np.flatnonzero(up.contact_peak == 0)
    assert len(away) > 20
    for n in away:
        omega = TURN * up.frequency[n]
        exact = np.linalg.solve(k - omega**2 * np.eye(2) + 0.03j * omega * k, [0.0, -0.1j])
        np.testing.assert_allclose([up.harmonics(p)[n, 1] for p in "12"], exact, rtol=1e-10)


@pytest.mark.long
def test_smaller_steps_are_the_same_curve(curves):
    """`largest_step` bounds the change of the frequency; the branch is the same."""
    fine = sb.frequency_response(
        two_masses(), [0.1], 0.5 / TURN, 0.6 / TURN, steps=2048, stability=False, largest_step=0.004 / TURN
    )
    assert np.abs(np.diff(fine.value)).max() <= 0.004 / TURN * 1.2 and len(fine.value) > 25
    np.testing.assert_allclose(crossings(fine, 0.55), crossings(curves[0], 0.55), rtol=0.01)


def test_load_response_from_nothing():
    """Linear in the factor until the stop is met, at the factor gap / linear amplitude; at factor 1 the orbit
    of `periodic`.
    """
    r, omega = with_a_stop(), 0.9
    linear = 3.0 / abs(1 - omega**2 + 0.1j * omega)
    curve = sb.load_response(r, [3.0], omega / TURN)
    assert (
        curve.parameter == "load"
        and curve.complete
        and curve.value[0] == 0.0
        and curve.value[-1] == 1.0
        and (np.diff(curve.value) > 0).all()
    )
    assert curve.amplitude("x")[0] == 0.0 and curve.frequency == pytest.approx(
        np.full(len(curve.value), omega / TURN)
    )
    away = curve.value < 1.0 / linear
    # the largest displacement lies between two of 512 instants
    np.testing.assert_allclose(
        np.abs(curve.harmonics("x")[:, 1])[away], linear * curve.value[away], rtol=1e-9, atol=1e-14
    )
    assert (
        not curve.contact_peak[curve.value < 0.999 / linear].any()
        and curve.contact_peak[curve.value > 1.01 / linear].all()
    )
    orbit = sb.periodic(r, [3.0], omega / TURN, guess=curve.orbit(len(curve.value) - 1))
    assert curve.amplitude("x")[-1] == pytest.approx(orbit.amplitude("x"), rel=1e-8) and orbit.iterations <= 1
    back = sb.load_response(r, [3.0], omega / TURN, start=1.0, stop=0.0, guess=orbit)
    assert back.value[-1] == 0.0 and back.amplitude("x")[-1] < 1e-9 * orbit.amplitude("x")


@pytest.fixture(scope="module")
def stepped():
    """A continuation with some points, and two beyond them."""
    system = two_masses()
    driven = Period(system, Excitation.of([sb.Harmonic(0.1, 0.1)], 0.1, 1, 1), 256)
    first = shoot(driven.at(0.105), driven.at(0.105).linear_state)
    parameter = ParameterRange("frequency", 0.105, 0.112)
    line = Line([Point.known(Orbits(driven, parameter), np.append(first.state, 0.105))])
    found = Follower(line, parameter.range, Settings())
    assert len(list(itertools.islice(found, 5))) == 5
    return found


def test_points_between_two():
    """Periodic motions at their fractions of the way: across the chord, or of the parameter's change where
    the way is mostly that, which they then have to the last digit.
    """
    period = Period(with_a_stop(zeta=0.01), Excitation.of([sb.Harmonic(0.05, 0.1)], 0.1, 1, 1), 256)
    lower, upper = 0.9 / TURN, 1.1 / TURN
    first = shoot(period.at(lower), period.at(lower).linear_state)
    parameter = ParameterRange("frequency", lower, upper)
    orbits = Orbits(period, parameter)
    line = Line([Point.known(orbits, np.append(first.state, lower))])
    follow.follow(line, parameter.range)
    held = []
    for k, (one, other) in enumerate(itertools.pairwise(line.points)):
        way = Way(line, k)
        held.append(way.held)
        for fraction in (0.3, 0.8):
            point = between(line, k, fraction)
            residual = orbits.driven(point.value).run(point.u[:-1]).residual
            assert np.linalg.norm(residual) < 1e-8 * way.metric.units[0]
            if way.held:
                assert point.value == one.value + fraction * (other.value - one.value)
                continue
            # across the chord, with the value as a share of the range
            size = way.metric.units[0]
            chord, there = (
                np.append((to.u[:-1] - one.u[:-1]) / size, (to.value - one.value) / parameter.range.extent)
                for to in (other, point)
            )
            assert there @ chord / (chord @ chord) == pytest.approx(fraction, abs=1e-8)
    assert any(held) and not all(held) and line.points[-1].value == upper


def test_points_on_the_part_that_has_been_gone_through(stepped):
    """Beyond a corner a point between the last three is one of them again, the next one is none; nor is a
    point aside of them.
    """
    points = stepped.points
    behind = [between(stepped.line, k, 0.5) for k in (2, 3)]
    ahead = points.pop()
    del points[5:]
    assert all(stepped._gone_through(point) for point in behind)
    assert not stepped._gone_through(ahead)
    aside = copy.copy(behind[1])
    aside.u = np.append(behind[1].u[:-1], behind[1].value + 0.5 * (points[4].value - points[3].value))
    assert not stepped._gone_through(aside)


@pytest.mark.long
def test_a_corner_where_a_branch_turned_about(monkeypatch):
    """A stop fifty times as stiff as the spring, at 256 steps: the curve has teeth as high as what a step of
    time lets its contact change by. With the derivative of the steps as they are, which has the teeth too, it
    goes back along itself at one of them to where it began, which is told; with a look at where it has been,
    or with the switches inside their steps, it comes to its end.
    """
    stiff = with_a_stop(zeta=0.01, compliance=0.02)
    options = {"steps": 256, "stability": False}
    curve = sb.frequency_response(stiff, [0.3], 0.7 / TURN, 1.5 / TURN, **options)
    assert curve.complete and curve.contact_peak[-1] > 25.0

    of_steps = OrbitState.linear
    monkeypatch.setattr(OrbitState, "linear", lambda self, smooth=False: of_steps(self))
    curve = sb.frequency_response(stiff, [0.3], 0.7 / TURN, 1.5 / TURN, **options)
    assert curve.complete
    monkeypatch.setattr(Follower, "_gone_through", lambda self, point: False)
    monkeypatch.setattr(follow, "ASIDE", np.pi)
    monkeypatch.setattr(follow, "STRAIGHT", 0.0)
    with pytest.warns(sb.BranchWarning, match="back at its beginning at .* has turned about near 0.2383"):
        other = sb.frequency_response(stiff, [0.3], 0.7 / TURN, 1.5 / TURN, **options)
    assert not other.complete and "run back along itself" in other.reason


def test_finer_points_are_among_those_allowed():
    """A curve that comes to its end has 39 points or more, of which 36 are allowed."""
    system, ends = two_masses(), (0.5 / TURN, 0.6 / TURN)
    with pytest.warns(sb.BranchWarning, match="has all the 36 points that it may have.*raise points"):
        curve = sb.frequency_response(system, [0.1], *ends, steps=256, points=36)
    assert curve.complete and len(curve.value) == 36 and curve.value[-1] == ends[1]
    assert len(sb.frequency_response(system, [0.1], *ends, steps=256).value) > 36


@pytest.mark.slow
@pytest.mark.parametrize(
    "damping, compliance, force, steps, highest",
    [
        (0.01, 0.12100891, 0.12112702, 256, 0.92188251),
        pytest.param(0.03, 0.01923889, 0.10303447, 1024, 1.08253308, marks=pytest.mark.long),
    ],
)
def test_corners_that_are_come_to_from_above(damping, compliance, force, steps, highest):
    """Downwards to where the stop is met and the branch turns back: a step across the corner that lands on
    the part behind, aside of its tangent, is taken again; these two of eighty curves had run back to their
    beginning. The same folds as upwards, to what lies between two points of the curves.
    """
    system, options = two_masses(damping, compliance), {"steps": steps, "stability": False}
    ends = [0.5 / TURN, highest / TURN]
    folds = []
    for start, stop in (ends, ends[::-1]):
        curve = sb.frequency_response(system, [force], start, stop, **options)
        assert curve.complete
        folds.append(np.sort(curve.value[np.flatnonzero(np.diff(np.sign(np.diff(curve.value)))) + 1]))
    assert len(folds[0]) == 2
    np.testing.assert_allclose(*folds, rtol=5e-4)


@pytest.mark.long
def test_load_response_past_a_corner():
    """0.1 Hz: the stop, stiff as it is, is met at 0.3269 of the load, from where the branch turns back, and
    later forth to the full load.
    """
    curve = sb.load_response(two_masses(), [0.1], 0.1, steps=2048, stability=False)
    k, omega = np.array([[1.0, -1.0], [-1.0, 2.0]]), 0.2 * np.pi
    corner = 1 / abs(np.linalg.solve(k - omega**2 * np.eye(2) + 0.03j * omega * k, [0.0, 0.1])[0])
    assert curve.complete and curve.value[-1] == 1.0
    touching = np.flatnonzero(curve.contact_peak > 0)
    assert (
        curve.value[touching[0] - 1] == pytest.approx(corner, rel=1e-3)
        and curve.value[touching].min() < 0.9 * corner
    )
    assert (np.diff(touching) == 1).all()


def test_over_the_gap():
    """Of loads that all oscillate: a gap g times as wide is met by g times the motion under 1 / g times the
    load, point by point by single motions.
    """
    curve = sb.load_response(two_masses(), [0.1], 0.55 / TURN, 0.4, stop=1.2, parameter="gap", steps=256)
    assert (
        curve.complete and curve.parameter == "gap" and curve.value[-1] == 1.2 and "over gap" in repr(curve)
    )
    for k in range(0, len(curve.value), 7):
        gap = float(curve.value[k])
        orbit = curve.orbit(k)
        again = sb.periodic(two_masses(), [0.1 / gap], 0.55 / TURN, steps=256, guess=None)
        assert orbit.amplitude("2") == pytest.approx(curve.amplitude("2")[k], rel=1e-9)
        if again.stable and orbit.stable and curve.contact_peak[k] > 0.0:
            assert again.amplitude("2") * gap == pytest.approx(orbit.amplitude("2"), rel=1e-6)
    assert curve.contact_peak[0] > 0.0


def test_over_the_damping():
    """Each point is a motion of the system with so many times the damping."""
    curve = sb.load_response(
        two_masses(), [0.1], 0.55 / TURN, 0.5, stop=2.0, parameter="damping", steps=256, largest_step=0.2
    )
    assert curve.complete and curve.value[0] == 0.5 and np.diff(curve.value).max() <= 0.2 + 1e-12
    for k in (0, len(curve.value) // 2, -1):
        damped = two_masses(0.03 * float(curve.value[k]))
        orbit = sb.periodic(damped, [0.1], 0.55 / TURN, steps=256)
        assert curve.amplitude("2")[k] == pytest.approx(orbit.amplitude("2"), rel=1e-6)
        assert abs(curve.multipliers[k, 0]) == pytest.approx(abs(orbit.multipliers[0]), rel=1e-6)
    with pytest.raises(ValueError, match="parameter = 'frequency'"):
        sb.load_response(two_masses(), [0.1], 0.55 / TURN, parameter="frequency")


def test_load_response_keeps_the_preload():
    """Only what oscillates is scaled: at factor 0 the static deflection is left."""
    curve = sb.load_response(with_a_stop(gap=10.0), [sb.Harmonic(1.0, 0.1) + 0.5], 0.1, stop=2.0)
    np.testing.assert_allclose(curve.harmonics("x")[:, 0], 0.5, rtol=1e-9)
    assert curve.amplitude("x")[-1] == pytest.approx(
        2.0 / abs(1 - (0.2 * np.pi) ** 2 + 0.1j * 0.2 * np.pi), rel=1e-4
    )


@pytest.mark.parametrize("start", [0.0, 0.4])
def test_curve_begins_where_a_constant_load_presses(start):
    """Newton's method does not come there from the motion without contact; a history does. Faces that stay
    together are springs, of which the response is known, at the load's own factor.
    """
    damping, frequency = 0.05, 0.175
    stiffness = np.array([[2.0, -1.0, 0.0], [-1.0, 3.0, 0.5], [0.0, 0.5, 6.0]])
    held = stiffness + np.diag([0.0, 0.0, 60.0])
    system = reduce_matrices(
        np.eye(3),
        stiffness,
        np.eye(3)[[2]],
        np.array([0.02]),
        loads=np.eye(3)[:, [0, 2]],
        sensors={"x": 0},
        rayleigh=(damping, 0.0),
        compliance=[1.0 / 60.0],
    )
    curve = sb.load_response(system, [0.8, sb.Constant(-1.5)], frequency, start, steps=256)
    rate = 2.0 * np.pi * frequency
    expected = 0.8 * np.linalg.inv(held - (rate**2 - 1j * damping * rate) * np.eye(3))[0, 0]
    assert curve.value[0] == start and curve.complete
    assert curve.amplitude("x") == pytest.approx(curve.value * abs(expected), rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("zeta", [0.05, 0.005])
@pytest.mark.parametrize("ends", [(0.5, 1.5), (1.5, 0.5)])
def test_chords_are_near_the_curve(zeta, ends):
    """A stop that is never met leaves the amplitude 3 / |1 - w^2 + 2 i zeta w|: chords are off it by 1.5 %,
    times 1.2 as how it bends is estimated from three points, but where it is steep; and the peak is where it
    is, within a fiftieth of its width, however narrow.
    """
    curve = sb.frequency_response(with_a_stop(gap=1e6, zeta=zeta), [3.0], *(end / TURN for end in ends))
    order = np.argsort(curve.value)
    value, amplitude = TURN * curve.value[order], curve.amplitude("x")[order]

    def exact(omega):
        return 3.0 / np.abs(1.0 - omega**2 + 2j * zeta * omega)

    omega = np.linspace(0.5, 1.5, 20001)
    off = np.abs(np.interp(omega, value, amplitude) / exact(omega) - 1.0)
    top = np.sqrt(1.0 - 2.0 * zeta**2)
    rise = np.diff(amplitude) / exact(top) / np.diff(value)
    steep = np.abs(rise) > np.sqrt(1.0 / events.STEEP**2 - 1.0)
    chord = np.minimum(np.searchsorted(value, omega, side="right") - 1, len(rise) - 1)
    assert off[~steep[chord]].max() < 1.2 * events.CHORD and steep.any()
    peak = curve.peak("x")
    assert abs(TURN * peak.frequency - top) < 0.02 * 2.0 * zeta
    assert peak.amplitude == pytest.approx(exact(top), rel=1e-3)


def test_ends_at_the_end_of_its_range():
    """Where a step across a steep flank aims at what is inside and leads beyond it, too."""
    period = Period(with_a_stop(zeta=0.01), Excitation.of([sb.Harmonic(0.05, 0.1)], 0.1, 1, 1), 256)
    lower, upper = 0.9 / TURN, 1.1 / TURN
    first = shoot(period.at(lower), period.at(lower).linear_state)
    parameter = ParameterRange("frequency", lower, upper)
    orbits = Orbits(period, parameter)
    line = Line([Point.known(orbits, np.append(first.state, lower))])
    found, led = Follower(line, parameter.range, Settings()), 0
    while parameter.range.holds(line.points[-1].value) or len(line.points) == 1:
        before, tangent = replace(line, points=list(line.points)), found.tangent()
        target = line.points[-1].value + line.length * found.metric.units[-1] * tangent[-1]
        value = found.next().value
        end = 0.5 * (target + value)
        if target < end < value and abs(tangent[-1]) <= follow.HELD:
            *_, point = Follower(before, Range(end - (upper - lower), end, 1), Settings())
            led += 1
            assert point.value == end
            residual = orbits.driven(end).run(point.u[:-1]).residual
            assert np.linalg.norm(residual) < 1e-8 * np.linalg.norm(point.u[:-1])
    assert line.points[-1].value == upper and led


@pytest.mark.parametrize("times, divided", [(0.85, []), (1.15, [0, 1])])
def test_chords_that_are_divided(times, divided):
    """At the bottom of a circle, whose chords of length l are off it by l^2 / 8 r, from where that is as much
    as allowed.
    """
    length = times * np.sqrt(8.0 * 0.5 * events.CHORD)
    angles = 2.0 * np.arcsin(0.5 * length / 0.5) * np.arange(-1, 2)
    found = events.coarse_chords(0.5 * np.sin(angles), 1.0 + 0.5 * (1.0 - np.cos(angles)))
    np.testing.assert_array_equal(found, divided)


def test_chords_at_a_corner():
    """Those beside it, unless they are short."""
    corner = np.array([[0.0, 0.5], [0.1, 0.5], [0.2, 0.5], [0.3, 0.8], [0.4, 1.1], [0.5, 1.4]])
    np.testing.assert_array_equal(events.coarse_chords(*corner.T), [1, 2])
    corner[:, 1] = 1.0 + 0.01 * corner[:, 1]
    corner[:, 0] *= 0.01
    np.testing.assert_array_equal(events.coarse_chords(*corner.T), [])


def test_peak_of_a_known_resonance():
    """A parabola's top, bandwidth and skewness; order of arc length also where the curve turns back."""
    f = np.linspace(9, 11, 401)
    a = 1 / np.abs(1 - (f / 10) ** 2 + 0.02j * f / 10)
    for order in (slice(None), slice(None, None, -1)):
        peak = find_peak(f[order], a[order])
        assert peak.frequency == pytest.approx(
            10 * np.sqrt(1 - 2 * 0.01**2), rel=1e-4
        ) and peak.amplitude == pytest.approx(50.0, rel=1e-3)
        assert (
            peak.bandwidth == pytest.approx(0.2, rel=0.01)
            and abs(peak.skewness) < 0.02
            and peak.lower < peak.frequency < peak.upper
        )
    leaning = find_peak(f + 0.004 * a, a)
    assert leaning.skewness > 0.2 and leaning.frequency == pytest.approx(10.2, rel=1e-3)
    assert np.isnan(find_peak(f[:200], a[:200]).upper)


@pytest.fixture(scope="module", name="case_p")
def paper_case():
    return case_p(damping=0.002)


@pytest.mark.long
def test_response_of_the_beam(case_p):
    """13.9-14.6 kHz: the open crack's peak at mode 17 (14.144 kHz), moved up and leaning by 300 N; every
    verdict is one multiplier's.
    """
    load = sb.PointForce("A", fy=300.0)
    linear = sb.frequency_response(case_p, load, 13900.0, 14600.0, contact=False)
    mode = sb.modal(case_p, 46).frequencies
    resonance = mode[np.argmin(abs(mode - 14144))]
    assert linear.peak("A").frequency == pytest.approx(resonance, rel=1e-4) and linear.peak(
        "A"
    ).bandwidth == pytest.approx(0.004 * resonance, rel=0.03)
    curve = sb.frequency_response(case_p, load, 13900.0, 14600.0)
    assert curve.complete and (np.diff(curve.value) > 0).all() and len(curve.value) < 60
    peak = curve.peak("A")
    assert resonance + 10 < peak.frequency < resonance + 60 and peak.amplitude < linear.peak("A").amplitude
    for k in range(len(curve.value)):
        error = curve.multiplier_error[k]
        assert curve.stable[k] == (abs(curve.multipliers[k, 0]) <= 1 + (1e-9 if np.isnan(error) else error))
    changes = np.count_nonzero(curve.stable[1:] != curve.stable[:-1])
    # 36 points, a short unstable part beyond the peak: nothing flips
    assert changes == 2 and curve.stable[[0, -1]].all()
    # light load: the linear curve
    light = sb.frequency_response(
        linear.reduced, sb.PointForce("A", fy=0.01), 14100.0, 14200.0, stability=False
    )
    exact = [
        sb.periodic(linear.reduced, sb.PointForce("A", fy=0.01), f, contact=False, stability=False).harmonics(
            "A"
        )[1]
        for f in light.value[::4]
    ]
    np.testing.assert_allclose(light.harmonics("A")[::4, 1], exact, rtol=1e-10)


@pytest.mark.long
def test_verdicts_do_not_depend_on_the_grid(case_p):
    """700 N at 512 and 1024 steps: the same bifurcations within 3e-5 (one whose multipliers pass the circle
    at a slope of 1e-6 a hertz moves by 1.5e-5), one for each change of the number of
    unstable multipliers, and four changes of the verdict.
    """
    found = [
        sb.frequency_response(case_p, sb.PointForce("A", fy=700.0), 14080.0, 14250.0, steps=steps)
        for steps in (512, 1024)
    ]
    kinds = [[b.kind for b in curve.bifurcations] for curve in found]
    assert kinds[0] == kinds[1] and len(kinds[0]) >= 4
    np.testing.assert_allclose(*([b.value for b in curve.bifurcations] for curve in found), rtol=3e-5)
    for curve in found:
        assert np.count_nonzero(curve.stable[1:] != curve.stable[:-1]) == 4
        outside = (np.abs(curve.multipliers) > 1).sum(axis=1)
        assert set(np.flatnonzero(np.diff(outside)) + 1) == {
            b.after for b in curve.bifurcations if b.kind != "fold"
        }


@pytest.mark.long
def test_three_motions_with_little_damping():
    """Damping 0.0005: the branch folds, and between the folds it passes one frequency three times; from the
    nearest point at each of the three places `periodic` converges to a motion of its own, of another
    amplitude.
    """
    model, load, between = case_p(damping=0.0005), sb.PointForce("A", fy=300.0), 14210.0
    options = {"modes": 80, "steps": 256, "stability": False}
    curve = sb.frequency_response(model, load, 14100.0, 14350.0, **options)
    assert curve.complete

    def passes(frequency):
        side = np.sign(curve.value - frequency)
        assert side.all()
        return np.flatnonzero(np.diff(side))

    assert [len(passes(f)) for f in (14150.0, between, 14300.0)] == [1, 3, 1]
    nearest = [k + np.argmin(np.abs(curve.value[k : k + 2] - between)) for k in passes(between)]
    orbits = [sb.periodic(model, load, between, guess=curve.orbit(int(k)), **options) for k in nearest]
    amplitudes = sorted(orbit.amplitude("A") for orbit in orbits)
    assert min(np.diff(amplitudes)) > 0.02 * amplitudes[-1]
    for orbit, k in zip(orbits, passes(between)):
        beside = curve.amplitude("A")[k : k + 2]
        assert 0.98 * beside.min() < orbit.amplitude("A") < 1.02 * beside.max()


# ---------------------------------------------------------------- refusals and hard cases


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"start": 0.0}, "start = 0.0"),
        ({"stop": -1.0}, "stop"),
        ({"stop": 0.08}, "stop = 0.08 is start itself"),
        ({"start": "low"}, "start"),
        ({"steps": 10}, "steps = 10 must be at least 48"),
        ({"load": [sb.Harmonic(0.1, 0.08)]}, "does not follow the swept frequency; give a number"),
        ({"load": [sb.ToneBurst(0.1, 0.08, 3)]}, "does not follow the swept frequency"),
        ({"load": [0.0]}, "no load oscillates"),
        ({"load": [sb.Constant(1.0)]}, "no load oscillates"),
        ({"largest_step": 0.0}, "largest_step"),
        ({"periods": 0}, "periods"),
        ({"load": [0.1, 0.2]}, "the reduced model has 1 unit loads, the load has 2"),
    ],
)
def test_bad_sweeps(arguments, sentence):
    given = {"load": [0.1], "start": 0.08, "stop": 0.1, **arguments}
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.frequency_response(two_masses(), given.pop("load"), given.pop("start"), given.pop("stop"), **given)


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"start": -0.1}, "start = -0.1"),
        ({"stop": float("inf")}, "stop = inf"),
        ({"start": 1.0}, "stop = 1 is start itself"),
        ({"frequency": 0.0}, "frequency"),
    ],
)
def test_bad_ramps(arguments, sentence):
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.load_response(two_masses(), [0.1], **{"frequency": 0.1, **arguments})


@pytest.mark.long
def test_first_orbit_elsewhere(curves):
    with pytest.raises(ValueError, match="guess is at .* Hz, not at"):
        sb.frequency_response(two_masses(), [0.1], 0.09, 0.1, guess=curves[0].orbit(3))


@pytest.mark.long
def test_unknown_point_of_a_curve(curves):
    for ask in (curves[0].amplitude, curves[0].harmonics, curves[0].peak):
        with pytest.raises(KeyError, match="point 'A' does not exist; the model has '1', '2'"):
            ask("A")
    with pytest.raises(ValueError, match="direction = 'z' must be"):
        curves[0].harmonics("1", "z")


def test_harmonic_load_on_a_beam_is_refused_in_a_sweep(case_p):
    with pytest.raises(ValueError, match="fy of PointForce = Harmonic.* does not follow the swept frequency"):
        sb.frequency_response(case_p, sb.PointForce("A", fy=sb.Harmonic(300.0, 14000.0)), 13900.0, 14600.0)


def test_a_curve_that_stops(monkeypatch):
    """Newton's method fails beyond 0.65 rad/s: where and why in the message, and the points so far with
    it.
    """
    whole = follow.correct

    def fails(problem, u, *rest):
        if u[-1] > 0.65 / TURN:
            raise sb.SolveError("no")
        return whole(problem, u, *rest)

    monkeypatch.setattr(follow, "correct", fails)
    with pytest.raises(
        sb.SolveError,
        match="frequency_response: the curve stops at 0.103.* after .* points: no further point within a "
        "step",
    ) as caught:
        sb.frequency_response(two_masses(), [0.1], 0.5 / TURN, 0.9 / TURN, steps=256)
    curve = caught.value.branch
    assert (
        not curve.complete
        and 10 < len(curve.value) < 100
        and curve.value.max() < 0.65 / TURN
        and curve.stable.any()
    )
    assert "no further point" in repr(curve)


def test_a_curve_that_comes_back():
    """From the middle one of three motions through a fold back to where it began, on the upper ones: it was
    no warning that the end of the range is not met.
    """
    system = two_masses()
    whole = sb.frequency_response(system, [0.1], 0.5 / TURN, 0.9 / TURN, steps=512, stability=False)
    falling = np.flatnonzero((np.diff(whole.value) < 0.0) & (TURN * whole.value[1:] < 0.72))
    middle = whole.orbit(int(falling[0]))
    with pytest.warns(BranchWarning, match="turned about at .* and come back to .* does not lead to 0.14"):
        found = sb.frequency_response(
            system, [0.1], middle.frequency, 0.9 / TURN, steps=512, stability=False, guess=middle
        )
    assert not found.complete and found.value[-1] == found.value[0] == middle.frequency
    assert found.value.max() == pytest.approx(whole.value[: falling[0]].max(), rel=1e-3)
    assert found.amplitude("2")[-1] > 1.2 * found.amplitude("2")[0]


def test_a_curve_that_leads_away(monkeypatch):
    """As a motion beside a period doubling may, whose curve has room behind its beginning: it has not come
    back to that.
    """
    system = two_masses()
    first = sb.periodic(system, [0.1], 0.6 / TURN, steps=512, stability=False)
    away = Range(0.5 / TURN, 0.9 / TURN, -1)
    monkeypatch.setattr(branch_following, "led_away", lambda line, within: away)
    with pytest.warns(BranchWarning) as told:
        found = sb.frequency_response(
            system,
            [0.1],
            first.frequency,
            0.9 / TURN,
            stability=False,
            guess=replace(first, path="period doubling"),
        )
    (text,) = (str(one.message) for one in told)
    assert "begins away from 0.14323945 and has come to 0.079577472 without turning" in text
    assert not found.complete and found.value[-1] == away.lower and (np.diff(found.value) < 0.0).all()


def test_a_largest_step_that_is_none():
    """The message says what is short, and not that steps of time are few."""
    with pytest.raises(
        sb.SolveError, match=r"largest_step = 1e-12 is less than the shortest step .*; give"
    ) as e:
        sb.frequency_response(
            two_masses(), [0.1], 0.5 / TURN, 0.9 / TURN, steps=256, stability=False, largest_step=1e-12
        )
    assert "steps a period" not in str(e.value)


def test_points_at_most():
    curve = sb.frequency_response(
        two_masses(), [0.1], 0.5 / TURN, 0.9 / TURN, steps=1024, points=7, stability=False
    )
    assert len(curve.value) == 7 and not curve.complete and curve.reason == "7 points"


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from tests.reference import paper_beam
model = sb.Model(paper_beam().mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=0.002)
curve = sb.frequency_response(model, sb.PointForce("A", fy=300.0), 2950.0, 3050.0, modes=20, stability=False)
same = all(np.array_equal(v, curve.value) for v in MPI.COMM_WORLD.allgather(curve.value))
if MPI.COMM_WORLD.rank == 0:
    found = {"value": curve.value.tolist(), "amplitude": curve.amplitude("A").tolist(), "same": same}
    print(json.dumps(found))
"""


@pytest.mark.long
def test_ranks():
    """The same points on 1 and 2 ranks: the branch within 1e-6, since points depend on steps that round-off
    may change.
    """
    one, two = alone(RANKS), answer(on_ranks(2, RANKS))
    assert one["same"] and two["same"]
    np.testing.assert_allclose(two["value"], one["value"], rtol=1e-7)
    np.testing.assert_allclose(two["amplitude"], one["amplitude"], rtol=1e-5)


def test_no_bifurcations_without_damping():
    """Multipliers on the unit circle leave and enter it by rounding alone."""
    branch = sb.frequency_response(two_masses(0.0), [0.01], 0.05, 0.0505)
    assert np.abs(np.abs(branch.multipliers) - 1.0).max() < 1e-9
    assert branch.complete and branch.bifurcations == ()
