"""Slowly swept frequency: along the stable branches, over the folds, closed form without contact."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator

import sbfem_petsc as sb
from meshing import Beam
from sbfem_petsc.motion.swept import linear_changes
from sbfem_petsc.plot import plot_swept, save_picture
from tests.analysis.test_basins import FORCE, RATIO, STEPS, TURN, mass
from tests.systems import coarse_beam, two_masses

LOW, HIGH = 0.95 / TURN, 1.2 / TURN
CYCLES = (500, 2000)


@pytest.fixture(scope="module")
def branch():
    return sb.frequency_response(mass(), FORCE, LOW, HIGH, steps=STEPS)


@pytest.fixture(scope="module")
def sweeps():
    """Up and down, at two rates."""
    return [
        [
            sb.swept_response(mass(), FORCE, start, stop, duration=cycles / (0.5 * (LOW + HIGH)))
            for start, stop in ((LOW, HIGH), (HIGH, LOW))
        ]
        for cycles in CYCLES
    ]


@pytest.mark.slow
def test_along_the_stable_branches_and_off_at_the_folds(branch, sweeps):
    """The distance from the branch is proportional to the rate, at 500 cycles below 1.5 %; the jump is the
    later by the rate to the power 2/3 (passage through a saddle-node), 4^(2/3) = 2.5 for four times the rate.
    """
    upper, lower = (bifurcation.value for bifurcation in branch.bifurcations)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(branch.value)))) + 1
    amplitude = branch.amplitude("A")
    parts = (
        PchipInterpolator(branch.value[: turns[0] + 1], amplitude[: turns[0] + 1]),
        PchipInterpolator(branch.value[turns[1] :], amplitude[turns[1] :]),
    )
    apart, late = np.zeros((2, 2)), np.zeros((2, 2))
    for row, pair in enumerate(sweeps):
        for column, (swept, curve, fold) in enumerate(zip(pair, parts, (upper, lower))):
            assert len(swept.frequency) == CYCLES[row] and swept.upwards == (column == 0)
            before = swept.frequency < 0.995 * fold if swept.upwards else swept.frequency > 1.005 * fold
            found = swept.amplitude("A")[before] / curve(swept.frequency[before]) - 1.0
            apart[row, column] = np.abs(found).max()
            (jump,) = swept.jumps("A")
            assert (jump.after < jump.before) == swept.upwards
            late[row, column] = (jump.frequency / fold - 1.0) * (1.0 if swept.upwards else -1.0)
    assert (apart[0] < 0.015).all() and (np.abs(apart[0] / apart[1] - 4.0) < 0.6).all()
    assert (late > 0.0).all() and (late[0] < 0.016).all()
    assert (np.abs(late[0] / late[1] - 4.0 ** (2.0 / 3.0)) < 0.3).all()


def test_a_linear_resonance_has_no_jumps():
    """The amplitude is force / |1 - w^2 + 2 i z w|, to first order in the rate r (rad/s^2) times the factor
    1 + r Re(i / (z + i (w - 1))^2), which is up to 2.3 % off 1 here; what is left is of second order, 0.3 %.
    """
    swept = sb.swept_response(mass(gap=100.0), FORCE, 0.8 / TURN, 1.2 / TURN, duration=2000 * TURN)
    w = TURN * swept.frequency
    closed = FORCE / np.abs(1.0 - w**2 + 0.06j * w)
    detuned = RATIO + 1j * (w - 1.0)
    lag = 1.0 + 0.4 / (2000 * TURN) * (1j / detuned**2).real
    assert 0.022 < np.abs(lag - 1.0).max() < 0.024
    assert np.abs(swept.amplitude("A") / (closed * lag) - 1.0).max() < 0.003
    assert swept.jumps("A") == () and not swept.contact_peak.any() and swept.settling == 6


def test_both_directions():
    """Far below resonance the corner of a beam follows the static solution, by (f / f1)^2 and by the samples
    of a cycle, (pi / 320)^2 / 2, off; rows have one direction.
    """
    with sb.Model(Beam(0.1, 0.01).mesh(order=3), sb.Material(70e9, 0.33, 2700), damping=0.01) as model:
        swept = sb.swept_response(model, sb.PointForce("A", fy=100.0), 2.0, 3.0, duration=2.0, modes=4)
        still = sb.static(model, sb.PointForce("A", fy=100.0)).displacement("A")
        for direction in "xy":  # integrated again for the place
            there = swept.amplitude((0.1, 0.01), direction)
            np.testing.assert_allclose(there, swept.amplitude("A", direction), rtol=1e-8)
        (line,) = plot_swept(None, swept, (0.1, 0.01)).lines
        assert line.get_ydata()[0] > 0.0 and "0.1 m, 0.01 m" in line.axes.get_ylabel()
    assert abs(still[0]) > 0.05 * abs(still[1])
    for direction, u in zip("xy", still):
        np.testing.assert_allclose(swept.amplitude("A", direction), abs(u), rtol=2e-4)
        (line,) = plot_swept(None, swept, "A", direction).lines
        drawn = line.get_ydata() / swept.amplitude("A", direction)
        assert np.ptp(drawn) < 1e-12 * drawn[0]
    row = sb.swept_response(mass(gap=100.0), FORCE, 0.1 / TURN, 0.2 / TURN, duration=20 * TURN)
    with pytest.raises(sb.SolveError, match="direction = 'x' is not known of rows"):
        row.amplitude("A", "x")


def through_resonance(damping, rate, upwards=True, gap=1e3, stiffness=1.0):
    """A sweep over eight half-power bandwidths about the resonance of a mass, whose rate is so many times the
    square of its decay.
    """
    low, high = (1.0 - 8.0 * damping) / TURN, (1.0 + 8.0 * damping) / TURN
    ends = (low, high) if upwards else (high, low)
    system = mass(gap=gap, damping=damping, stiffness=stiffness)
    return sb.swept_response(system, 2.0 * damping, *ends, duration=16.0 / (damping * rate), steps=96)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("damping", "rate"),
    [(damping, rate) for damping in (0.03, 0.01) for rate in (0.15, 1.5)] + [(0.03, 0.02), (0.002, 1.5)],
)
def test_linear_passages_have_no_jumps(damping, rate):
    """At any rate at which jumps are told; with the same motion as if contact acted all the time too, so that
    the bound alone tells: with a share of a tenth they stay below it.
    """
    for upwards in (True, False):
        swept = through_resonance(damping, rate, upwards)
        assert swept.tells_jumps and not swept.contact_peak.any()
        whole_cycles = TURN * damping * swept.settling
        assert 1.0 <= whole_cycles < 1.2 and swept.rate == pytest.approx(rate * whole_cycles**2, rel=0.02)
        assert swept.jumps("A", 1e-6) == ()
        touching = dataclasses.replace(swept, contact_peak=np.ones(len(swept.frequency)))
        assert touching.jumps("A") == () and touching.jumps("A", 0.1) == ()


def test_a_passage_with_soft_contact_has_no_jumps():
    """A stop of a thousandth of the stiffness acts at resonance without bending the curve."""
    for rate in (0.15, 0.6):
        swept = through_resonance(0.03, rate, gap=0.3, stiffness=1e-3)
        assert swept.contact_peak.any() and swept.jumps("A") == ()


@pytest.mark.parametrize("rate", [0.002, 0.1, 0.5, 1.0, 2.0])
def test_largest_changes_of_a_linear_passage(rate):
    """Against y' = -(1 + i R s) y + 1, integrated; slow ones by the slope of 1 / sqrt(1 + d^2), 1 / 2 at
    d = 1, over the three settling times: 3 R / 2.
    """
    rise, fall = linear_changes(rate)
    if rate < 0.01:
        assert (rise, fall) == pytest.approx((1.5 * rate, 1.5 * rate), rel=0.02)
        return
    limit = 4.0 / rate + 12.0
    found = solve_ivp(
        lambda s, y: -(1.0 + 1j * rate * s) * y + 1.0,
        (-limit, limit),
        [1.0 / (1.0 - 1j * rate * limit)],
        t_eval=np.arange(-limit, limit, 0.02),
        rtol=1e-8,
        atol=1e-10,
    )
    size = np.abs(found.y[0])
    means = np.convolve(size, np.full(50, 0.02), "valid")
    change = np.log(means[150:] / means[:-150])
    assert (rise, fall) == pytest.approx((change.max(), -change.min()), rel=0.01)
    assert fall > rise


def test_what_is_too_fast_to_tell():
    swept = through_resonance(0.01, 3.0)
    assert not swept.tells_jumps and 4 * swept.settling < len(swept.frequency)
    with pytest.raises(
        ValueError, match="nothing tells a jump from the passage through a resonance; sweep in"
    ):
        swept.jumps("A")


@pytest.mark.slow
def test_jumps_of_two_masses():
    """One each, up behind the upper fold and down behind the lower one, late by the rate to the power 2/3."""
    system = two_masses(0.1, compliance=1.0)
    branch = sb.frequency_response(system, [0.1], 0.6 / TURN, 0.8 / TURN, steps=STEPS, stability=False)
    upper, lower = branch.value[np.flatnonzero(np.diff(np.sign(np.diff(branch.value)))) + 1]
    late = []
    for cycles in (400, 1600):
        up, down = (
            sb.swept_response(
                system, [0.1], start / TURN, stop / TURN, duration=cycles * TURN / 0.7, steps=128
            ).jumps("1")
            for start, stop in ((0.6, 0.8), (0.8, 0.6))
        )
        assert len(up) == len(down) == 1
        assert up[0].after < 0.3 * up[0].before and down[0].after > 1.4 * down[0].before
        late.append([up[0].frequency / upper - 1.0, 1.0 - down[0].frequency / lower])
    assert 0.0 < max(late[0]) < 0.025
    assert late[0] == pytest.approx(4.0 ** (2.0 / 3.0) * np.array(late[1]), rel=0.1)


@pytest.mark.slow
def test_picture_and_table(branch, sweeps, tmp_path):
    axes = plot_swept(branch, sweeps[0], title="one mass with a stop")
    drawn = {line.get_label(): line.get_xydata() for line in axes.lines}
    assert {"stable", "unstable", "swept up", "swept down"} <= set(drawn)
    for name, swept in zip(("swept up", "swept down"), sweeps[0]):
        np.testing.assert_allclose(
            drawn[name], np.column_stack([swept.frequency, swept.amplitude("A")]), rtol=1e-12
        )
    assert len(axes.texts) == 2  # an arrow for each jump
    save_picture(axes, str(tmp_path / "swept.png"))
    sweeps[0][0].to_csv(str(tmp_path / "swept.csv"))
    assert np.loadtxt(tmp_path / "swept.csv", delimiter=",", skiprows=1).shape == (CYCLES[0], 3)


def test_from_a_steady_state_in_other_modes():
    """One in few modes leads to that in those of the sweep; under another load it is refused."""
    beam, push = coarse_beam(0.002), sb.PointForce("A", fy=300.0)
    few = sb.periodic(beam, push, 433.0, stability=False)
    asked = dict(duration=0.02, modes=30)
    found = sb.swept_response(beam, push, 433.0, 440.0, initial=few, **asked)
    expected = sb.swept_response(beam, push, 433.0, 440.0, **asked)
    assert len(few.reduced.omega) < 30 == len(found.reduced.omega)
    np.testing.assert_allclose(found.amplitude("A"), expected.amplitude("A"), rtol=1e-7)
    with pytest.raises(ValueError, match="^swept_response: .* is no steady state under this load"):
        sb.swept_response(beam, sb.PointForce("B", fy=300.0), 433.0, 440.0, initial=few, **asked)


def test_from_a_steady_state_with_vectors():
    """The same whatever the order of the loads, and in a model of more of them."""
    beam, push, pull = coarse_beam(0.002), sb.PointForce("A", fy=300.0), sb.PointForce("B", fx=4000.0)
    orbit = sb.periodic(beam, [push, pull], 433.0, stability=False)
    turned, asked = (
        sb.periodic(beam, [pull, push], 433.0, stability=False),
        dict(initial=orbit, duration=0.02),
    )
    assert orbit.reduced.vectors and orbit.reduced.loads == turned.reduced.loads[::-1]
    np.testing.assert_allclose(turned.state, orbit.state, rtol=0.0, atol=1e-6 * np.linalg.norm(orbit.state))
    one, other = (
        sb.swept_response(beam, load, 433.0, 440.0, **asked) for load in ([push, pull], [pull, push])
    )
    np.testing.assert_allclose(one.amplitude("A"), other.amplitude("A"), rtol=1e-6)
    wide = sb.reduce(beam, [push, sb.PointForce("C", fx=1.0), pull], modes=30)
    found = sb.swept_response(wide, [push, pull], 433.0, 440.0, **asked)
    np.testing.assert_allclose(found.amplitude("A"), one.amplitude("A"), rtol=1e-3)
    with pytest.raises(ValueError, match="is no steady state under this load"):
        sb.swept_response(wide, push, 433.0, 440.0, **asked)


def test_from_a_steady_state_with_other_damping():
    beam, push, at = (
        coarse_beam(0.002),
        sb.PointForce("A", fy=300.0),
        dict(modes=20, steps=256, stability=False),
    )
    branch = sb.load_response(beam, push, 433.0, start=1.0, stop=1.2, parameter="damping", **at)
    with pytest.raises(ValueError, match="is no steady state under this load"):
        sb.swept_response(beam, push, 433.0, 440.0, initial=branch.orbit(-1), duration=0.02, modes=20)


@pytest.mark.slow
def test_bad_input(branch):
    orbit = branch.orbit(0)
    for keywords, error, sentence in (
        ({"stop": LOW}, ValueError, "is start itself"),
        ({"duration": 1.0}, ValueError, "cycles"),
        ({"duration": 1e13}, ValueError, "cycles"),
        ({"load": sb.Harmonic(1.0, 1.0)}, ValueError, "does not follow the swept frequency"),
        ({"load": 0.0}, ValueError, "no load oscillates"),
        ({"load": sb.Constant(1.0)}, ValueError, "no load oscillates"),
        ({"initial": orbit, "start": 0.9 * LOW}, ValueError, "initial is at"),
        ({"steps": 3}, ValueError, "steps = 3"),
    ):
        given = {"load": FORCE, "start": LOW, "stop": HIGH, "duration": 100.0, **keywords}
        with pytest.raises(error, match=sentence):
            sb.swept_response(mass(), given.pop("load"), given.pop("start"), given.pop("stop"), **given)
    system = mass()
    other = sb.periodic(system, 2.0 * FORCE, LOW, steps=STEPS)
    with pytest.raises(ValueError, match="is no steady state under this load"):
        sb.swept_response(system, FORCE, LOW, HIGH, duration=100.0, initial=other)
    with pytest.raises(ValueError, match="another model"):
        sb.swept_response(mass(stiffness=3.0), FORCE, LOW, HIGH, duration=100.0, initial=other)
    short = sb.swept_response(system, FORCE, LOW, HIGH, duration=10.0 / LOW)
    with pytest.raises(ValueError, match="no longer than four settling times"):
        short.jumps("A")
    free = sb.swept_response(mass(damping=0.0), FORCE, 0.5 / TURN, 0.6 / TURN, duration=200.0)
    with pytest.raises(ValueError, match="without damping"):
        free.jumps("A")


def test_accuracy():
    """In as many modes as steady states of the range need, beside 80: amplitudes as near as was asked; modes
    that are given stay, and what is missing is said.
    """
    beam, push = coarse_beam(0.002), sb.PointForce("A", fy=300.0)
    asked = dict(duration=0.02, progress=None)
    found = sb.swept_response(beam, push, 430.0, 436.0, accuracy=1e-2, **asked)
    exact = sb.swept_response(beam, push, 430.0, 436.0, modes=80, **asked)
    off = np.abs(found.amplitude("A") / exact.amplitude("A") - 1.0).max()
    assert len(found.reduced.omega) < 40 and 1e-5 < off < found.mode_error <= 1e-2, (off, found)
    assert "error of harmonics" in repr(found) and np.isnan(exact.mode_error)
    with pytest.warns(sb.AccuracyWarning, match="swept_response: harmonics .* give more than modes = 3"):
        few = sb.swept_response(beam, push, 430.0, 436.0, modes=3, accuracy=1e-3, **asked)
    assert len(few.reduced.omega) == 3 and few.mode_error > 1e-3
