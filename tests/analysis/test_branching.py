"""Motions of twice the period behind a period doubling: two masses and an elastic stop (NLvib's example
03).
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from tests.systems import two_masses

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
        first=sb.periodic(reduction, [0.1], 0.7 / TURN, steps=STEPS, start=_contacting(reduction)),
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


def test_doubling_is_where_a_multiplier_is_minus_one(curve):
    """The multiplier at the point found; the step of the grid moves it by 1e-3 (2048 against 4096 steps)."""
    found = _doubling(curve)
    assert found.multiplier == pytest.approx(-1.0, abs=1e-3) and found.value * TURN == pytest.approx(
        0.7385, abs=1e-3
    )


def test_motion_takes_two_periods(orbit):
    """Half the frequency is in it, and one forcing period does not close."""
    assert orbit.periods == 2 and len(orbit.time) == 2 * STEPS and orbit.path == "period doubling"
    first, half = np.abs(orbit.harmonics("2")[1]), np.abs(orbit.subharmonics("2")[1])
    assert 0.005 * first < half < first


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
        start=(orbit.states.q[0], orbit.states.v[0]),
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


def test_its_branch_can_be_followed(reduction, orbit):
    branch = sb.frequency_response(reduction, [0.1], orbit.frequency, 1.002 * orbit.frequency, first=orbit)
    assert branch.complete and branch.periods == 2 and (np.abs(branch.subharmonics("2")[:, 1]) > 1e-3).all()


def test_only_from_a_period_doubling(curve):
    other = next(item for item in curve.bifurcations if item.kind != "period doubling")
    with pytest.raises(ValueError, match="is no period doubling"):
        sb.switch_branch(curve, other)


def test_orbit_file(orbit, tmp_path):
    """A motion read back is the same to the last digit; other files are told apart."""
    path = str(tmp_path / "orbit.h5")
    sb.save_orbit(orbit, path)
    again = sb.read_orbit(path)
    np.testing.assert_array_equal(again.harmonics("2"), orbit.harmonics("2"))
    np.testing.assert_array_equal(again.multipliers, orbit.multipliers)
    assert again.stable == orbit.stable and again.periods == 2 and repr(again) == repr(orbit)
    with pytest.raises(ValueError, match="HDF5 file of another kind"):
        sb.read_curve(path)
    with pytest.raises(ValueError, match="orbit file .* does not exist"):
        sb.read_orbit(str(tmp_path / "none.h5"))
