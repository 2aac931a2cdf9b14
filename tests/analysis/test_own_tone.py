"""Quasi-periodic motions behind a Neimark-Sacker point, whose second tone is their own: onset, an independent
integration, both parameters, and what is refused.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

import sbfem_petsc as sb
from sbfem_petsc.continuation.problems.own_tone import OwnTone, first_curve
from sbfem_petsc.study.kinds.kind import size_of
from tests.systems import two_masses

TURN = 2.0 * np.pi
STEPS = 1024
# rad/s; the motion is stable above 0.6034
ABOVE, BELOW, HERE = 0.607, 0.602, 0.603


@pytest.fixture(scope="module")
def system():
    return two_masses(0.02, compliance=0.1)


@pytest.fixture(scope="module")
def curve(system):
    return sb.frequency_response(system, [0.1], ABOVE / TURN, BELOW / TURN, steps=STEPS)


@pytest.fixture(scope="module")
def point(curve):
    (found,) = (item for item in curve.bifurcations if item.kind == "Neimark-Sacker")
    return found


@pytest.fixture(scope="module")
def tori(curve, point):
    return sb.quasi_periodic_response(sb.switch_branch(curve, point), HERE / TURN, progress=None)


def test_either_multiplier_of_the_pair(curve, point):
    """Both, with their own directions, are one small curve, whose tone turns forwards."""
    own = OwnTone(curve.period, curve.parameter, curve.fixed_frequency, 11, curve.period.comm)
    other = replace(point, multiplier=point.multiplier.conjugate(), direction=point.direction.conj())
    one, two = (first_curve(own, item, 0.05)[0] for item in (point, other))
    np.testing.assert_allclose(one, two, rtol=1e-14)
    assert one[-2] == pytest.approx(abs(np.angle(point.multiplier)) / TURN, rel=1e-14)


@pytest.mark.slow
def test_onset(system):
    """The tone begins with the frequency of the multiplier's angle, and the square of its amplitude with the
    distance from the point: both are smooth functions of that square, whose limits are the point's. 2048
    steps locate the point to 3e-6 (1024 and 2048 differ by 5e-6).
    """
    fine = sb.frequency_response(system, [0.1], ABOVE / TURN, BELOW / TURN, steps=2048)
    onset = next(item for item in fine.bifurcations if item.kind == "Neimark-Sacker")
    small = [sb.switch_branch(fine, onset, size=size, samples=11) for size in (0.04, 0.07, 0.1)]
    amplitude = np.array([abs(motion.line(0, 1, "1")) for motion in small])
    frequencies = np.array([motion.frequencies for motion in small])
    rotations = frequencies[:, 1] / frequencies[:, 0]
    assert rotations == pytest.approx(abs(np.angle(onset.multiplier)) / TURN, rel=0.01)
    for values, limit, tolerance in (
        (frequencies[:, 0], onset.value, 5e-6),
        (rotations, abs(np.angle(onset.multiplier)) / TURN, 2e-4),
    ):
        assert np.polyfit(amplitude**2, values, 2)[-1] == pytest.approx(limit, rel=tolerance)
    # 0.16 rad/s per square, to what the next power adds: no other power of the amplitude leaves that constant
    distance = (onset.value - frequencies[:, 0]) * TURN
    assert distance / amplitude**2 == pytest.approx(0.18, rel=0.2) and (distance > 0.0).all()


def test_more_samples_than_there_is_memory_for(curve, point):
    with pytest.raises(ValueError, match="switch_branch: 9,999,999 samples of .* of memory, .* give fewer"):
        sb.switch_branch(curve, point, samples=9_999_999)


@pytest.mark.long
def test_a_settled_history(system, point, tori):
    """160 periods by SciPy from a disturbed motion: the last 100 are the lines m f1 + n f2, with f2 and the
    amplitudes as found, to 1e-3 of the largest.
    """
    found = tori.motions[-1]
    first, own = found.frequencies
    assert tori.complete and found.stable and TURN * first == pytest.approx(HERE, rel=1e-12)

    def rates(t, state):
        x, y, v, w = state
        one, two = x + 0.02 * v, y + 0.02 * w
        stop = 10.0 * (x - 1.0) if x > 1.0 else 0.0
        return v, w, two - one - stop, 0.1 * math.sin(HERE * t) + one - 2.0 * two

    r, modes = system, len(system.omega)
    shapes = r.points.modes[:, 1, :]
    start = np.concatenate([shapes @ (1.1 * point.state[:modes] / r.omega), shapes @ point.state[modes:]])
    time = (60.0 + np.arange(100 * 16) / 16.0) / first
    u = solve_ivp(rates, (0.0, time[-1]), start, "DOP853", time, rtol=1e-7, atol=1e-9).y[0]
    order = [(m, n) for m in range(5) for n in range(-4, 5) if m or n > 0]

    def fitted(second):
        turns = np.exp(2j * np.pi * np.outer(time, [m * first + n * second for m, n in order]))
        columns = np.column_stack([np.ones(len(time)), turns.real, -turns.imag])
        answer = np.linalg.lstsq(columns, u, rcond=None)[0]
        return answer, float(np.linalg.norm(columns @ answer - u))

    span = 0.4 / (time[-1] - time[0])
    second = minimize_scalar(
        lambda f: fitted(f)[1], bounds=(own - span, own + span), method="bounded", options={"xatol": 1e-7}
    ).x
    answer, _ = fitted(second)
    lines = np.hypot(*answer[1:].reshape(2, -1))
    mine = np.array([abs(found.line(m, n, "1")) for m, n in order])
    print(second / own - 1, np.abs(lines - mine).max() / mine.max())
    assert second == pytest.approx(own, rel=4e-4)
    assert np.abs(lines - mine).max() < 1e-3 * mine.max() < 0.03 * mine[order.index((0, 1))]
    assert abs(found.line(0, 0, "1")) == pytest.approx(abs(answer[0]), abs=1e-3 * mine.max())


@pytest.mark.slow
def test_samples_and_start(system, tori):
    """More samples, fewer modes of the curve the same: from a motion that is known, at its frequency."""
    known = tori.motions[-1]
    finer = sb.quasi_periodic(
        system, [0.1], (known.frequencies[0], None), guess=known, samples=41, stability=False, steps=STEPS
    )
    assert finer.samples == 41 and finer.steps == STEPS and finer.own is not None
    assert finer.frequencies[1] == pytest.approx(known.frequencies[1], rel=2e-4)
    for line in ((1, 0), (0, 1), (1, -1)):
        assert abs(finer.line(*line, "1")) == pytest.approx(abs(known.line(*line, "1")), rel=2e-3)
    assert "its own" in repr(finer)


@pytest.mark.slow
def test_no_tone_is_left(system, point, tori):
    """Beyond the point at which the tone is born there is the periodic motion alone."""
    beyond = 1.002 * point.value
    with pytest.raises(sb.SolveError, match="ends at the periodic motion, which has no tone of its own"):
        sb.quasi_periodic(system, [0.1], (beyond, None), guess=tori.motions[0], stability=False, steps=STEPS)


@pytest.mark.long
def test_over_the_load(system):
    """At the frequency of a motion the branch over the load leads to it as well. Its samples are at other
    phases: begun at four phases of either branch, the tones differ by up to 2.6e-3, 7.7e-4 and 2.6e-4 with
    1024, 2048 and 4096 steps.
    """
    frequency = 0.6034 / TURN
    curves = (
        sb.frequency_response(system, [0.1], ABOVE / TURN, BELOW / TURN, steps=4096),
        sb.load_response(
            system,
            [0.1],
            frequency,
            1.0,
            stop=1.4,
            guess=sb.periodic(system, [0.1], frequency, steps=4096),
        ),
    )
    ends = []
    for curve, stop in zip(curves, (frequency, 1.0)):
        found = next(item for item in curve.bifurcations if item.kind == "Neimark-Sacker")
        branch = sb.quasi_periodic_response(
            sb.switch_branch(curve, found), stop, stability=False, progress=None
        )
        assert branch.parameter == curve.parameter and branch.complete
        ends.append(branch.motions[-1])
    known, other = ends
    assert other.frequencies == pytest.approx(known.frequencies, rel=5e-5)
    for line in ((1, 0), (0, 1), (1, -1)):
        assert abs(other.line(*line, "1")) == pytest.approx(abs(known.line(*line, "1")), rel=5e-4)


@pytest.mark.slow
def test_over_damping_and_gap(system, tori):
    """At the end of a branch over the damping stands a motion of the model of that damping, which Newton's
    method on that model leaves where it is. Gaps c times as wide are forces 1 / c times as large, and
    displacements in the same ratio: by branches that meet other curves, to their steps (see above).
    """
    known = tori.motions[-1]
    options = {"stability": False, "progress": None}
    damped = sb.quasi_periodic_response(known, 1.03, parameter="damping", **options)
    assert damped.parameter == "damping" and damped.complete and damped.value[[0, -1]].tolist() == [1.0, 1.03]
    last = damped.motions[-1]
    again = sb.quasi_periodic(
        two_masses(1.03 * 0.02, compliance=0.1),
        [0.1],
        (known.frequencies[0], None),
        guess=last,
        samples=last.samples,
        steps=STEPS,
        stability=False,
    )
    assert again.frequencies == pytest.approx(last.frequencies, rel=1e-9) and len(again.residuals) <= 2
    assert abs(last.frequencies[1] / known.frequencies[1] - 1.0) > 1e-4
    wide = sb.quasi_periodic_response(known, 1.01, parameter="gap", **options)
    weak = sb.quasi_periodic_response(known, 1.0 / 1.01, parameter="load", **options)
    assert wide.complete and weak.complete and weak.motions[-1].load_factor == 1.0 / 1.01
    one, other = wide.motions[-1], weak.motions[-1]
    assert one.frequencies == pytest.approx(other.frequencies, rel=3e-4)
    for line in ((1, 0), (0, 1), (1, -1)):
        assert abs(one.line(*line, "1")) == pytest.approx(1.01 * abs(other.line(*line, "1")), rel=3e-3)
    with pytest.raises(ValueError, match="stop = 1 is where guess is"):
        sb.quasi_periodic_response(known, 1.0, parameter="gap")


@pytest.mark.long
def test_largest_step(tori):
    """Of the parameter, from a motion to the next one."""
    branch = sb.quasi_periodic_response(
        tori.motions[0], HERE / TURN, largest_step=1e-5, stability=False, progress=None
    )
    assert branch.complete and np.abs(np.diff(branch.value)).max() < 1.06e-5 and len(branch) > len(tori)


def test_its_own_branch(curve, tori, tmp_path):
    """The tone grows from the point on; a branch that goes back shrinks onto the periodic motion."""
    amplitude = np.abs(tori.line(0, 1, "1"))
    assert (np.diff(amplitude[:6]) > 0.0).all() and len(tori) == len(tori.value) == len(tori.frequencies)
    tori.to_csv(str(tmp_path / "tori.csv"))
    table = np.genfromtxt(tmp_path / "tori.csv", delimiter=",", names=True)
    np.testing.assert_allclose(table["amplitude_f2_1_m"], amplitude, rtol=1e-12)


def test_stability_that_is_not_asked_for(tori):
    """Is not said to be that of no unstable motion, nor in the column of a sweep."""
    unasked = replace(tori, motions=tuple(replace(one, exponents=np.zeros(0)) for one in tori.motions))
    told = {known: {q.name: q.value for q in size_of(known)} for known in (tori, unasked)}
    count = told[tori]["unstable_points"]
    assert count == tori.unstable.sum() and f"Hz, {count:g} unstable, " in repr(tori)
    assert "Hz, stability not asked for, " in repr(unasked) and np.isnan(told[unasked]["unstable_points"])
    assert told[tori]["curve_points"] == told[unasked]["curve_points"] == len(tori)


LOCKED = 0.09586  # Hz; from here down histories repeat after five periods of the load


@pytest.mark.long
def test_where_the_tone_locks(system):
    """A branch towards 0.0955 Hz with few samples and steps ends before histories, by SciPy, begin to repeat
    after five periods of the load. With 21 samples alone Newton's method finds "stable" curves all the way.
    """
    curve = sb.frequency_response(system, [0.1], 0.0971, 0.0957, steps=256)
    onset = next(item for item in curve.bifurcations if item.kind == "Neimark-Sacker")
    begin = sb.switch_branch(curve, onset)
    branch = sb.quasi_periodic_response(begin, 0.0955, progress=None)
    assert not branch.complete and "the tone locks" in branch.reason
    assert LOCKED < branch.value.min() < 0.09589 and branch.value.argmin() == len(branch) - 1
    assert (branch.tail <= 0.01).all() and branch.stable[2:].all() and begin.samples == 21
    assert branch.motions[-1].samples > branch.motions[0].samples == 21
    last, modes = branch.motions[-1], len(system.omega)
    shapes = system.points.modes[:, 1, :]
    state = sb.periodic(system, [0.1], last.frequencies[0], contact=False, steps=256).state + last.states[0]
    state = np.concatenate([shapes @ (state[:modes] / system.omega), shapes @ state[modes:]])

    def strobed(frequency):
        """The last six of 500 periods, in units of the extent of the last hundred."""

        def rates(t, u):
            x, y, v, w = u
            one, two = x + 0.02 * v, y + 0.02 * w
            stop = 10.0 * (x - 1.0) if x > 1.0 else 0.0
            return v, w, two - one - stop, 0.1 * math.sin(TURN * frequency * t) + one - 2.0 * two

        time = np.arange(501) / frequency
        u = solve_ivp(rates, (0.0, time[-1]), state, "DOP853", time, rtol=1e-7, atol=1e-9).y.T[-100:]
        return u[-6:] / np.ptp(u, axis=0).max()

    # 256 steps shift the branch by 5e-6 Hz
    locked, free = strobed(LOCKED), strobed(last.frequencies[0] + 1e-5)
    assert np.linalg.norm(locked[-1] - locked[0]) < 1e-4 < 0.1 < np.linalg.norm(locked[-1] - locked[-2])
    assert np.linalg.norm(free[-1] - free[0]) > 0.01
    orbit = sb.periodic(system, [0.1], 0.0957, periods=5)
    assert orbit.stable and abs(orbit.multipliers).max() < 0.7 and abs(orbit.subharmonics("1")[1]) > 1e-3
    # one there, of as many samples as the branch began with: told, and not said to be stable
    with pytest.warns(sb.StepWarning, match="21 samples do not resolve the motion: .* the tone locks"):
        few = sb.quasi_periodic(system, [0.1], (last.frequencies[0], None), guess=last, steps=256)
    assert few.stable is None and not few.resolved and len(few.exponents) and "not resolved" in repr(few)


def test_bad_requests(system, curve, point, tori):
    known, load = tori.motions[-1], [sb.Harmonic(0.1, 0.0959)]
    two = sb.quasi_periodic(
        system, [sb.Harmonic(0.1, 0.05) + sb.Harmonic(0.1, 0.021)], (0.05, 0.021), steps=64
    )
    for error, sentence, call in (
        (ValueError, "samples = 20 must be odd", lambda: sb.switch_branch(curve, point, samples=20)),
        (ValueError, "has no tone of its own", lambda: sb.quasi_periodic_response(two, 0.09)),
        (TypeError, "guess", lambda: sb.quasi_periodic_response(curve, 0.09)),
        (ValueError, "is where guess is", lambda: sb.quasi_periodic_response(known, HERE / TURN)),
        (ValueError, "needs one to begin from", lambda: sb.quasi_periodic(system, load, (0.0959, None))),
        (
            ValueError,
            "guess has a tone of its own",
            lambda: sb.quasi_periodic(system, load, (0.0959, 0.02), guess=known),
        ),
        (
            ValueError,
            "must be odd",
            lambda: sb.quasi_periodic(system, load, (0.0959, None), guess=known, samples=6),
        ),
        (
            ValueError,
            "another model or number of modes .2 modes, not 1 mode.",
            lambda: sb.quasi_periodic(one_mass(), [0.1], (0.0959, None), guess=known),
        ),
    ):
        with pytest.raises(error, match=sentence):
            call()


def one_mass():
    one = np.ones((1, 1))
    return sb.reduce_matrices(
        one, one, one, np.ones(1), loads=one, sensors={"1": 0}, damping=0.01, compliance=np.ones(1)
    )
