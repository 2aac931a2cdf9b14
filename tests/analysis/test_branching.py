"""Motions of twice the period behind a period doubling: two masses and an elastic stop (NLvib's example
03).
"""

from dataclasses import replace

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from meshing.warnings import BranchWarning
from sbfem_petsc.continuation.problems.driven_orbits import minimal_periods
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.motion.period_map import FixedPoint, Period
from tests.systems import case_p, one_mass, same_products, two_masses

TURN = 2.0 * np.pi
STEPS = 2048


@pytest.fixture(scope="module")
def reduction():
    return two_masses()


@pytest.fixture(scope="module")
def curve(reduction):
    return sb.frequency_response(
        reduction,
        [0.1],
        0.7 / TURN,
        0.9 / TURN,
        steps=STEPS,
        guess=sb.periodic(reduction, [0.1], 0.7 / TURN, steps=STEPS, guess=_contacting(reduction)),
    )


def _contacting(reduction):
    """The motion that touches the stop at 0.7 rad/s, beside the one that does not."""
    below = sb.frequency_response(reduction, [0.1], 0.55 / TURN, 0.7 / TURN, steps=STEPS, stability=False)
    return below.orbit(-1)


@pytest.fixture(scope="module")
def orbit(curve):
    return sb.switch_branch(curve, _doubling(curve))


def _doubling(curve):
    return next(item for item in curve.bifurcations if item.kind == "period doubling")


@pytest.mark.long
def test_doubling_with_its_direction_turned_about(curve, orbit):
    """The sign of a Floquet direction means nothing: the same motion, at one of its beginnings."""
    doubling = _doubling(curve)
    other = sb.switch_branch(curve, replace(doubling, direction=-doubling.direction))
    assert other.amplitude("2") == pytest.approx(orbit.amplitude("2"), rel=1e-9)


@pytest.mark.long
def test_doubling_is_where_a_multiplier_is_minus_one(curve):
    """The multiplier at the point found; the step of the grid moves it by 1e-3 (2048 against 4096 steps)."""
    found = _doubling(curve)
    assert found.multiplier == pytest.approx(-1.0, abs=1e-3) and found.value * TURN == pytest.approx(
        0.7385, abs=1e-3
    )


@pytest.mark.slow
def test_motion_takes_two_periods(orbit):
    """Half the frequency is in it, and one forcing period does not close."""
    assert orbit.periods == 2 and len(orbit.time) == 2 * STEPS and orbit.path == "period doubling"
    first, half = np.abs(orbit.harmonics("2")[1]), np.abs(orbit.subharmonics("2")[1])
    assert 0.005 * first < half < first


@pytest.mark.slow
def test_a_history_stays_on_it(reduction, orbit):
    """A stable motion of two periods: a time history from it, of the same steps, repeats after two forcing
    periods and not after one, for 40.
    """
    assert orbit.stable
    duration = 40.0 / orbit.frequency
    history = sb.transient(
        reduction,
        [sb.Harmonic(0.1, orbit.frequency)],
        duration,
        step=1.0 / (STEPS * orbit.frequency),
        initial=(orbit.states.q[0], orbit.states.v[0]),
    )
    u = history.displacement("2")[:, 1]
    late = u[-4 * STEPS - 1 :]
    two, one = (
        np.abs(late[2 * STEPS :] - late[: -2 * STEPS]).max(),
        np.abs(late[STEPS:] - late[:-STEPS]).max(),
    )
    # the history's loads are linear over a step, the orbit's are exact: (2 pi / 2048)^2 / 12 = 1e-6 of the
    # amplitude
    assert two < 1e-4 * np.ptp(u) and one > 1e-2 * np.ptp(u)


@pytest.mark.slow
def test_its_branch_can_be_followed(reduction, orbit):
    branch = sb.frequency_response(reduction, [0.1], orbit.frequency, 1.002 * orbit.frequency, guess=orbit)
    assert branch.complete and branch.periods == 2 and (np.abs(branch.subharmonics("2")[:, 1]) > 1e-3).all()


@pytest.mark.long
def test_a_branch_that_falls_onto_a_shorter_one():
    """A mass whose spring is four times as stiff on one side, driven at twice its own frequency: upwards the
    motion of two periods shrinks into that of one. The branch ends there and says so; it goes on neither as
    its own motion begun a period later nor as one of a single period.
    """
    reduction = one_mass(0.0, 0.1, stiffness=3.0, towards=1.0)
    frequency = 2.0 * (4.0 / 3.0) / TURN
    history = sb.transient(
        reduction, [sb.Harmonic(1.0, frequency)], 200.0 / frequency, step=1.0 / (512 * frequency)
    )
    state = np.concatenate([history.states.q[-1], history.states.v[-1]])
    guess = replace(sb.periodic(reduction, [1.0], frequency, periods=2, stability=False), state=state)
    first = sb.periodic(reduction, [1.0], frequency, periods=2, guess=guess)
    assert first.stable and np.abs(first.subharmonics("A")[1]) > 0.5
    with pytest.raises(sb.SolveError, match="of 2 periods falls onto a motion of 1 at 0.545") as caught:
        sb.frequency_response(reduction, [1.0], frequency, 1.6 * frequency, guess=first)
    branch = caught.value.branch
    half = np.abs(branch.subharmonics("A")[:, 1])
    assert (np.diff(half) < 0.0).all() and half[-1] < 0.02 * half[0] and not branch.complete
    # one period is stable beyond and unstable before
    for factor, stable in ((0.995, False), (1.005, True)):
        beyond = sb.periodic(reduction, [1.0], factor * branch.frequency[-1])
        assert beyond.stable == stable


def test_a_motion_of_one_period_over_two(reduction):
    """Told by its states, whatever number of periods was asked for."""
    short = sb.periodic(reduction, [0.05], 0.5 / TURN, periods=2, steps=256, stability=False)
    assert short.periods == 2
    drive = Excitation.of([sb.Harmonic(0.05, short.frequency)], short.frequency, 2, 64)
    driven = Period(reduction, drive, 512).at(short.frequency)
    assert minimal_periods(FixedPoint(short.state, driven, driven.run(short.state))) == 1


@pytest.mark.long
def test_subcritical_doubling(tmp_path):
    """A beam whose motions of two periods begin unstable: their branch first goes back, turns in a fold and
    becomes stable. Interrupted while it is outside of its range, it goes on to the same points.
    """
    model = sb.Model(
        Beam(0.200, 0.005, [VNotch(0.050, 0.0025, 0.03)]).mesh(order=5, tip_size=2e-6),
        sb.Material(70e9, 0.33, 2700),
        damping=0.002,
    )
    load = sb.EdgeLoad("right", ty=4e5)
    curve = sb.frequency_response(model, load, 3427.0, 3428.5, modes=20)
    found = sb.switch_branch(curve, _doubling(curve))
    branch = sb.frequency_response(model, load, found.frequency, 3436.0, guess=found)
    half = np.abs(branch.subharmonics("A")[:, 1])
    assert branch.complete and branch.frequency.min() < found.frequency - 0.1
    asked = {"guess": found, "file": str(tmp_path / "branch.journal")}
    with pytest.warns(BranchWarning, match="after 3 points"):
        few = sb.frequency_response(model, load, found.frequency, 3436.0, points=3, **asked)
    assert few.frequency[-1] < found.frequency
    with pytest.warns(BranchWarning, match="after 8 points"):
        again = sb.frequency_response(model, load, found.frequency, 3436.0, points=8, resume=True, **asked)
    np.testing.assert_array_equal(again.states, branch.states[:8])
    assert any(item.kind == "fold" for item in branch.bifurcations)
    assert branch.stable[-1] and not branch.stable[0] and half[-1] == pytest.approx(3.67e-4, rel=0.01)
    settled = sb.periodic(model, load, 3436.0, periods=2, modes=20, guess=branch.orbit(-3), stability=False)
    assert np.abs(settled.subharmonics("A")[1]) == pytest.approx(half[-1], rel=1e-6)


def doublings(load, curve, tries=6):
    """Motions of twice the period near the first unstable motions with a negative real multiplier: the
    disturbance that grows shows itself whatever the direction.
    """
    real = (curve.multipliers.imag == 0.0) & (curve.multipliers.real < -1.0)
    for k in np.flatnonzero(real.any(axis=1))[:tries]:
        orbit = curve.orbit(int(k))
        direction = np.random.default_rng(0).standard_normal(len(orbit.state))
        direction *= np.linalg.norm(orbit.state) / np.linalg.norm(direction)
        for share in (0.01, 0.02, 0.05, 0.1, 0.2):  # one of five leads there
            guess = replace(orbit, state=orbit.state + share * direction)
            options = {"periods": 2, "steps": len(orbit.time), "guess": guess}
            try:
                other = sb.periodic(curve.reduced, load, orbit.frequency, **options)
            except sb.SolveError:
                continue
            if half(other) > 1e-6:
                yield other
                break


def half(orbit):
    """Amplitude at half the drive over the first harmonic."""
    return float(abs(orbit.subharmonics("A")[1]) / abs(orbit.harmonics("A")[1]))


@pytest.mark.long
@pytest.mark.parametrize("damping, force, some", [(0.0005, 1300.0, True), (0.001, 1500.0, False)])
def test_search_over_fig_11(damping, force, some):
    """The paper's beam where motions of twice the period come nearest, in the modes and steps of its report:
    at half the damping some are found, none stable, at double that none, and no real multiplier is below -1.
    """
    load = sb.PointForce("A", fy=force)
    options = {"largest_step": 4.0, "modes": 80, "steps": 256}
    curve = sb.frequency_response(case_p(damping), load, 14110.0, 14130.0, **options)
    found = list(doublings(load, curve))
    real = curve.multipliers[curve.multipliers.imag == 0.0].real
    assert curve.complete and (real.min() < -1.0) == some and bool(found) == some
    for orbit in found:
        assert orbit.periods == 2 and not orbit.stable and 1e-4 < half(orbit) < 0.02


@pytest.mark.slow
def test_only_from_a_period_doubling(curve):
    other = next(item for item in curve.bifurcations if item.kind != "period doubling")
    with pytest.raises(ValueError, match="is no period doubling"):
        sb.switch_branch(curve, other)


@pytest.mark.slow
def test_orbit_file(orbit, tmp_path):
    """A motion read back is the same; a missing file is told."""
    path = str(tmp_path / "orbit.h5")
    sb.save(path, orbit)
    again = sb.read(path)
    same_products(again.harmonics("2"), orbit.harmonics("2"))
    np.testing.assert_array_equal(again.multipliers, orbit.multipliers)
    assert again.stable == orbit.stable and again.periods == 2 and repr(again) == repr(orbit)
    with pytest.raises(ValueError, match="result file .* does not exist"):
        sb.read(str(tmp_path / "none.h5"))
