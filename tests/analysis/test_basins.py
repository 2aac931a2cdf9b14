"""Basins of attraction of one mass with a stop: against SciPy's integration, the unstable orbit on their
boundary, motions of two periods, ranks.
"""

import dataclasses

import numpy as np
import pytest
from mpi4py import MPI
from scipy.integrate import solve_ivp

import sbfem_petsc as sb
from sbfem_petsc.contact.repeating import Patience
from sbfem_petsc.continuation.attraction import Attraction
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from sbfem_petsc.plot import plot_basins, save_picture
from tests.parallel import answer, on_ranks
from tests.systems import one_mass

TURN = 2.0 * np.pi
FORCE, OMEGA, RATIO = 0.15, 1.08, 0.03
STEPS = 256


def mass(stiffness=1.0, gap=1.0, damping=RATIO):
    """Mass 1 on a spring 1, an elastic stop at a distance `gap`."""
    return one_mass(gap, damping, stiffness=stiffness)


@pytest.fixture(scope="module")
def orbits():
    """The linear, the unstable and the large motion between the folds at 1.0648 and 1.0939 rad/s."""
    branch = sb.frequency_response(mass(), FORCE, 0.9 / TURN, 1.3 / TURN, steps=STEPS, stability=False)
    crossings = np.flatnonzero(np.diff(np.sign(branch.value - OMEGA / TURN)))
    found = [
        sb.periodic(branch.reduced, FORCE, OMEGA / TURN, steps=STEPS, guess=branch.orbit(int(k)))
        for k in crossings
    ]
    return sorted(found, key=lambda orbit: orbit.amplitude("A"))


@pytest.fixture(scope="module")
def grid():
    axes = [sb.StartAxis(np.linspace(-4.0, 4.0, 17)), sb.StartAxis(np.linspace(-4.0, 4.0, 17), "velocity")]
    return sb.basins(mass(), FORCE, OMEGA / TURN, axes, steps=STEPS)


def touches(q, v, periods=50):
    """Whether the mass still meets its stop in the last period, by SciPy on
    x'' + 2 z x' + x + max(x - 1, 0) = F sin(w t).
    """
    n = len(q)

    def rates(t, y):
        x, v = y[:n], y[n:]
        return np.concatenate([v, FORCE * np.sin(OMEGA * t) - 2.0 * RATIO * v - x - np.maximum(x - 1.0, 0.0)])

    period = TURN / OMEGA
    times = period * (periods - 1 + np.linspace(0.0, 1.0, 65))
    found = solve_ivp(
        rates, (0.0, periods * period), np.concatenate([q, v]), "RK45", times, rtol=1e-6, atol=1e-6
    )
    return found.y[:n].max(axis=1) > 1.0


@pytest.mark.long
def test_verdicts_of_an_independent_integration(grid):
    """20 of the states, every fourteenth."""
    chosen = np.arange(20) * 14 + 3
    states, reached = grid.states.reshape(-1, 2)[chosen], grid.reached.ravel()[chosen]
    large = np.array([orbit.contact_resultant.max() > 0.0 for orbit in grid.orbits])
    assert len(grid.orbits) == 2 and set(reached) == {0, 1}
    assert (large[reached] == touches(states[:, 0], states[:, 1])).all()
    assert grid.share.sum() == 1.0


@pytest.mark.slow
def test_the_unstable_orbit_is_on_the_boundary(orbits, grid):
    """A ten thousandth to either side of it histories part; from itself they stay; the orbits that the grid
    has found are those of the branch.
    """
    low, unstable, high = orbits
    assert (low.stable, unstable.stable, high.stable) == (True, False, True)
    for orbit in (low, high):
        assert min(np.linalg.norm(found.state - orbit.state) for found in grid.orbits) < 1e-7
    states = unstable.state + 1e-4 * np.array([[-1.0, 0.0], [0.0, 0.0], [1.0, 0.0]])
    found = sb.basins(low.reduced, FORCE, OMEGA / TURN, (states[:, :1], states[:, 1:]), orbits=orbits)
    assert set(found.reached[[0, 2]]) == {0, 2} and found.reached[1] == 1
    assert found.orbits == tuple(orbits)
    # the nearest of these that leaves an orbit is what its integrity says
    distance = np.linalg.norm(states[found.reached != 0] - low.state, axis=1).min()
    assert found.integrity(0) == pytest.approx(0.5 * distance**2, rel=1e-12)
    # a history that has not settled leads nowhere that is known
    nearest = np.argmin(np.where(found.reached == 0, np.inf, np.linalg.norm(states - low.state, axis=1)))
    unsettled = dataclasses.replace(found, reached=np.where(np.arange(3) == nearest, -1, found.reached))
    further = np.linalg.norm(states[unsettled.reached > 0] - low.state, axis=1).min()
    assert further > distance and unsettled.integrity(0) == pytest.approx(0.5 * further**2, rel=1e-12)
    assert dataclasses.replace(found, reached=np.full(3, -1)).integrity(0) == np.inf


def test_an_impulse_upon_a_steady_state(orbits):
    """Impulses of the load change the velocity by impulse / mass: enough of it leads over; what is within
    1e-3 of a motion is known to stay at once.
    """
    low = orbits[0]
    axis = sb.StartAxis([-3.0, 0.0, 0.05, 3.0], "impulse")
    found = sb.basins(low.reduced, FORCE, OMEGA / TURN, [axis], orbits=orbits, around=low)
    np.testing.assert_allclose(found.states - low.state, np.outer(axis.values, [0.0, 1.0]), atol=1e-15)
    ends = touches(found.states[:, 0], found.states[:, 1])
    assert (ends == (found.reached == 2)).all() and found.reached[1] == 0 and found.periods[1] == 0
    axis, high = sb.StartAxis([0.0, 3e-4], "impulse"), orbits[2]
    near = sb.basins(low.reduced, FORCE, OMEGA / TURN, [axis], orbits=orbits, around=high)
    assert (near.reached == 2).all() and not near.periods.any()


def test_a_motion_that_a_history_is_not_on(orbits):
    """From a state 1 % off the small motion Newton's method finds that, which a history there is not on."""
    low = orbits[0]
    period = prepare("test", low.reduced, FORCE, OMEGA / TURN, settings=PeriodSettings(steps=STEPS))
    attraction = Attraction(period, OMEGA / TURN, Patience(8, 1e-6, 100), MPI.COMM_SELF)
    attraction.add(low)
    assert [attraction._identified(share * low.state, 1) for share in (1.0, 1.01)] == [0, -1]


def test_motions_of_two_periods_and_what_never_settles():
    """A stop at rest driven near twice its bilinear frequency: two motions of two periods, a forcing period
    apart in time, which are one orbit; without damping nothing settles.
    """
    system = mass(stiffness=8.0, gap=0.0, damping=0.02)
    omega = 2.0 * 2.0 * 3.0 / (1.0 + 3.0)
    axes = [sb.StartAxis([-1.0, 0.3, 1.0], point="A"), sb.StartAxis([-1.0, 0.0], "velocity")]
    found = sb.basins(system, 1.0, omega / TURN, axes, steps=STEPS)
    assert [orbit.periods for orbit in found.orbits] == [2] and found.orbits[0].stable
    assert (found.reached == 0).all() and found.states[0, 0] == pytest.approx([-1.0, -1.0])
    told: list[float] = []
    axis = sb.StartAxis(np.linspace(-1.0, 1.0, 12))
    free = sb.basins(mass(damping=0.0), 0.5, 1.7 / TURN, [axis], steps=64, limit=200, progress=told.append)
    assert told == sorted(told) and told[0] > 0.0 and told[-1] == 1.0
    assert (free.reached == -1).all() and (free.periods == 200).all() and not free.orbits


def test_periods_are_the_fewest():
    """Free motions that turn by 7/8 in a forcing period, about 4/5 and 5/6 with contact: changes over 8, 5
    and 6 periods fall below the tolerance first, but the motion is the one of one period that `periodic`
    finds, with its multipliers (without contact exp(-z 2 pi / w) in size). One of three periods stays so.
    """
    axes = [sb.StartAxis([-1.0, 0.3, 1.0]), sb.StartAxis([-1.0, 0.0], "velocity")]
    for system, force, omega in (
        (mass(damping=0.002, gap=100.0), 0.1, 8.0 / 7.0),
        (mass(damping=0.02), 0.8, 1.32),
        (mass(damping=0.02), 0.8, 1.3),
    ):
        found = sb.basins(system, force, omega / TURN, axes, steps=128)
        single = sb.periodic(system, force, omega / TURN, steps=128)
        (orbit,) = found.orbits
        assert orbit.periods == 1 and len(orbit.time) == 128 and not found.reached.any()
        np.testing.assert_allclose(orbit.state, single.state, rtol=0, atol=1e-8)
        np.testing.assert_allclose(np.abs(orbit.multipliers), np.abs(single.multipliers), rtol=1e-6)
        # from the motion itself it is known at once
        assert not sb.basins(system, force, omega / TURN, axes, orbits=[single]).reached.any()
    decay = np.exp(-0.002 * TURN * 7.0 / 8.0)
    linear = sb.basins(mass(damping=0.002, gap=100.0), 0.1, 8.0 / 7.0 / TURN, axes, steps=128)
    assert np.abs(linear.orbits[0].multipliers) == pytest.approx([decay, decay], rel=1e-9)
    system = mass(stiffness=8.0, gap=0.0, damping=0.02)
    for longest in (3, 8, 24):
        third = sb.basins(system, 1.0, 4.75 / TURN, axes, steps=128, longest=longest)
        (orbit,) = third.orbits
        assert orbit.periods == 3 and not third.reached.any()
        share = np.abs(orbit.subharmonics("A")[1:]) / np.abs(orbit.harmonics("A")[1])
        assert share.max() > 1.0
        known = sb.periodic(system, 1.0, 4.75 / TURN, periods=3, steps=128, guess=orbit)
        np.testing.assert_allclose(np.abs(orbit.multipliers), np.abs(known.multipliers), rtol=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("ranks", [1, 2])
def test_periods_are_the_fewest_on_any_ranks(ranks):
    program = """
import json, sbfem_petsc as sb
from mpi4py import MPI
from tests.analysis.test_basins import TURN, mass
axes = [sb.StartAxis([-1.0, 0.3, 1.0]), sb.StartAxis([-1.0, 0.0], "velocity")]
def settled(system, force, omega):
    return sb.basins(system, force, omega / TURN, axes, steps=128, comm=MPI.COMM_WORLD)
found = [settled(mass(damping=0.02), 0.8, 1.3), settled(mass(8.0, 0.0, 0.02), 1.0, 4.75)]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"ranks": MPI.COMM_WORLD.size, "periods": [[o.periods for o in b.orbits] for b in found],
                      "reached": [int(b.reached.max()) for b in found]}))
"""
    expected = {"ranks": ranks, "periods": [[1], [3]], "reached": [0, 0]}
    assert answer(on_ranks(ranks, program)) == expected


@pytest.mark.long
def test_ranks_share_the_histories(grid):
    program = """
import json, numpy as np, sbfem_petsc as sb
from mpi4py import MPI
from tests.analysis.test_basins import FORCE, OMEGA, STEPS, TURN, mass
axes = [sb.StartAxis(np.linspace(-4.0, 4.0, 17)[::4]), sb.StartAxis(np.linspace(-4.0, 4.0, 17), "velocity")]
found = sb.basins(mass(), FORCE, OMEGA / TURN, axes, steps=STEPS, comm=MPI.COMM_WORLD)
print(json.dumps({"contact": [float(o.contact_resultant.max()) for o in found.orbits],
                  "reached": found.reached.tolist()})) if MPI.COMM_WORLD.rank == 0 else None
"""
    other = answer(on_ranks(2, program))
    peaks = np.array([orbit.contact_resultant.max() for orbit in grid.orbits])
    assert peaks[grid.reached[::4]] == pytest.approx(np.array(other["contact"])[np.array(other["reached"])])


def test_picture(grid, orbits, tmp_path):
    """Colours of the basins in the places of the grid, marks of the orbits at their states."""
    axes = plot_basins(grid, title="one mass with a stop")
    np.testing.assert_array_equal(axes.collections[0].get_array().reshape(17, 17), grid.reached.T)
    marks = np.array([line.get_xydata()[0] for line in axes.lines])
    np.testing.assert_allclose(marks, [orbit.state for orbit in grid.orbits], atol=1e-12)
    save_picture(axes, str(tmp_path / "basins.png"))
    grid.to_csv(str(tmp_path / "basins.csv"))
    table = np.loadtxt(tmp_path / "basins.csv", delimiter=",", skiprows=1)
    assert table.shape == (17 * 17, 4) and (table[:, 2] == grid.reached.ravel()).all()
    with pytest.raises(ValueError, match="two axes"):
        plot_basins(sb.Basins(1.0, (), grid.reached, grid.periods, grid.states))


def test_oblique_axes_of_a_picture(orbits):
    """Two impulses whose velocities are not at right angles: a state is where both values say."""
    axes = (sb.StartAxis([0.0, 1.0], "impulse"), sb.StartAxis([0.0, 2.0], "impulse", 2))
    first, second, corner = np.array([0.0, 1.0]), np.array([1.0, 1.0]), np.array([0.3, 0.1])
    states = corner + np.array([[0.0 * first, 2.0 * second], [first, first + 2.0 * second]])
    one = dataclasses.replace(orbits[0], state=corner + 0.25 * first + 0.5 * second)
    whole = np.zeros((2, 2), dtype=int)
    drawn = plot_basins(sb.Basins(1.0, (one,), whole, whole, states, axes))
    np.testing.assert_allclose(drawn.lines[0].get_xydata()[0], [0.25, 0.5], atol=1e-12)


def test_units_of_a_picture(orbits):
    """Axes in units with few digits, whatever the size of the values; marks in the same ones."""
    (one, _, _), whole = orbits, np.zeros((2, 2), dtype=int)
    states = np.array([[[0.0, 0.0], [0.0, 3.0]], [[1.0, 0.0], [1.0, 3.0]]])
    for first, second, factors, labels in (
        (
            sb.StartAxis([0.0, 2e-5], point="A"),
            sb.StartAxis([0.0, 3e-3], "velocity", point="A"),
            (1e6, 1e3),
            ("initial displacement of A in mode 1 (µm)", "initial velocity of A in mode 1 (mm/s)"),
        ),
        (
            sb.StartAxis([0.0, 2e-5]),
            sb.StartAxis([0.0, 3e-3], "impulse"),
            (1e6, 1e3),
            ("initial modal displacement of mode 1 ($10^{-6}$ m kg$^{1/2}$)", "impulse of load 1 (mN s)"),
        ),
    ):
        basins = sb.Basins(1.0, (one,), whole, whole, states, (first, second))
        drawn = plot_basins(basins)
        assert (drawn.get_xlabel(), drawn.get_ylabel()) == labels
        assert drawn.get_xlim()[1] == pytest.approx(factors[0] * 2e-5)
        assert drawn.get_ylim()[1] == pytest.approx(factors[1] * 3e-3)
        place = one.state * [2e-5, 1e-3] * factors
        np.testing.assert_allclose(drawn.lines[0].get_xydata()[0], place, rtol=1e-9)


def test_orbits_in_other_steps(orbits):
    """Are found again in the most steps of those given, which default steps are halved to for each alone."""
    system, frequency = orbits[0].reduced, OMEGA / TURN
    finer = sb.periodic(system, FORCE, frequency, steps=2 * STEPS, guess=orbits[2])
    found = sb.basins(system, FORCE, frequency, [sb.StartAxis([0.0])], orbits=[orbits[0], finer])
    assert [len(orbit.time) for orbit in found.orbits[:2]] == [2 * STEPS] * 2
    own = sb.periodic(system, FORCE, frequency, steps=2 * STEPS, guess=orbits[0])
    np.testing.assert_allclose(found.orbits[0].state, own.state, rtol=1e-8)
    assert found.orbits[1] is finer


def test_bad_input(orbits):
    low, system = orbits[0], orbits[0].reduced
    axis = sb.StartAxis([0.0, 1.0])
    other = sb.periodic(mass(stiffness=3.0), FORCE, OMEGA / TURN, steps=STEPS)
    for keywords, error, sentence in (
        ({"starts": [sb.StartAxis([0.0], mode=2)]}, ValueError, "mode of starts = 2"),
        ({"starts": [sb.StartAxis([0.0], point="B")]}, KeyError, "point 'B' does not exist"),
        ({"starts": [sb.StartAxis([0.0], point="A", direction="x")]}, ValueError, "does not move point"),
        ({"starts": (np.zeros((3, 2)), np.zeros((3, 2)))}, ValueError, "starts has the shapes"),
        ({"starts": 3}, TypeError, "starts = 3"),
        ({"orbits": [low], "load": 2.0 * FORCE}, ValueError, "is no motion of this model"),
        ({"orbits": [low], "frequency": 0.2}, ValueError, "not at 0.2 Hz"),
        ({"around": other}, ValueError, "belongs to another model"),
        ({"load": 0.0}, ValueError, "no load oscillates"),
        ({"limit": 0}, ValueError, "limit"),
    ):
        given = {"load": FORCE, "frequency": OMEGA / TURN, "starts": [axis], **keywords}
        with pytest.raises(error, match=sentence):
            sb.basins(system, given.pop("load"), given.pop("frequency"), given.pop("starts"), **given)
    for arguments in (([1.0, 0.0],), ([],), ([0.0], "impulse", 1, "A"), ([0.0], "momentum")):
        with pytest.raises(ValueError, match="StartAxis"):
            sb.StartAxis(*arguments)
