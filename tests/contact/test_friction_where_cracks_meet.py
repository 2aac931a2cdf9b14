"""Cracks that turn, branch, cross and meet under friction, in time: the derivative of a period, and motions
beside each other.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import CrackLine, Plate
from sbfem_petsc.contact.law import FREE
from sbfem_petsc.contact.marching import march
from sbfem_petsc.contact.step_data import StepHistory, StepLoads, StepState
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from tests.contact.test_friction import LINES
from tests.systems import ALUMINIUM

FREQUENCY, MODES = 3000.0, 8
SHAKEN = [sb.EdgeLoad("edge3", tx=sb.Harmonic(1e6, FREQUENCY), ty=sb.Harmonic(1e6, FREQUENCY, 0.3))]


def plate_of(lines, law):
    """A clamped square plate."""
    plate = Plate([(0, 0), (0.1, 0), (0.1, 0.1), (0, 0.1)], cracks=[CrackLine(points) for points in lines])
    mesh = plate.mesh(order=2, points={"P": (0.1, 0.1)}, size=0.03)
    return sb.Model(mesh, ALUMINIUM, damping=0.01, clamped="edge1", contact_laws=law)


def told_from_others(motion, rows):
    """Steps in which it is told where rows land from other states than those at the end without them."""
    count, found = motion.rows.shape[1] - motion.landings.shape[1], []
    for n, landed in enumerate(motion.landings[:, :, 0] > 0.0):
        apart = motion.rows[n + 1].copy()
        apart[rows[landed]], apart[count:][landed] = FREE, FREE
        if landed.any() and (apart != motion.told[n]).any():
            found.append(n)
    return found


@pytest.mark.parametrize(
    "name, law",
    [
        ("crossing", sb.Coulomb(0.8)),
        *[
            pytest.param(name, law, marks=pytest.mark.long)
            for name, law in [
                ("T", sb.Coulomb(0.2)),
                ("T", sb.Coulomb(0.2, static_friction=0.3)),
                ("kink", sb.Coulomb(0.2, compliance=1e-13, tangential_compliance=1e-13)),
                ("star", sb.Coulomb(0.2)),
                ("embedded", sb.Coulomb(0.2, static_friction=0.3)),
            ]
        ],
    ],
)
def test_derivative_of_a_period(name, law):
    """Beside central differences of the map as it is, along state and memory. Where a crossing's faces land
    in one step, others do or do not with them: no set of states tells itself where, and some touch that
    without the others would stay apart.
    """
    with plate_of(LINES[name], law) as model:
        settings = PeriodSettings(modes=MODES, steps=64)
        period = prepare("test", model, SHAKEN, FREQUENCY, settings=settings)
        driven = period.at(FREQUENCY)
        # far from a steady state faces land that touch with each other alone
        off, seed = (2.5e-2, 7) if name == "crossing" else (2.5e-4, 0)
        state, rng = driven.linear_state, np.random.default_rng(seed)
        for _ in range(3):
            state = state + driven.run(state).residual
        scale = np.linalg.norm(state)
        state[: 2 * MODES] += off * scale * rng.standard_normal(2 * MODES)
        motion = driven.run(state)
        if name == "crossing":
            assert told_from_others(motion, driven.constants.rubbing.rows)
        ways = np.zeros((len(state), 3))
        ways[: 2 * MODES, :2] = rng.standard_normal((2 * MODES, 2))
        ways[2 * MODES :, 2] = rng.standard_normal(len(state) - 2 * MODES)
        found = driven.carried(motion, ways)
        step = 1e-7 * scale  # of 1e-8 rounding leaves 2e-8, of 1e-7 1e-9
        pairs = [(driven.run(state + step * w), driven.run(state - step * w)) for w in ways.T]
        # slips that stay what they are all the time count as if they came to nothing
        moves = np.append(np.ones(2 * MODES, dtype=bool), ~motion.stays(len(period.laws)))
        for k, (one, other) in enumerate(pairs):
            expected = (one.residual - other.residual) / (2.0 * step) + ways[:, k]
            largest = np.abs(expected[moves]).max()
            assert found[moves, k] == pytest.approx(expected[moves], abs=1e-6 * max(largest, 1e-2)), k


@pytest.mark.parametrize(
    "name, law",
    [
        ("kink", sb.Coulomb(0.2, static_friction=0.3)),
        ("kink", sb.Coulomb(2.0)),
        pytest.param("crossing", sb.Coulomb(0.2, static_friction=0.3), marks=pytest.mark.long),
        pytest.param("crossing", sb.Coulomb(1.2), marks=pytest.mark.long),
        pytest.param("T", sb.Coulomb(0.2, static_friction=0.3), marks=pytest.mark.long),
        pytest.param("T", sb.Coulomb(2.0), marks=pytest.mark.long),
    ],
)
def test_no_step_ends_without_a_solution(name, law):
    """What has none with the coefficient that sticking ends at has one with the other, which obeys both; what
    exchanges find none for, Lemke's method does. Forces are within their bounds, and energy is
    kept.
    """
    lines = [[(0.05, 0.1), (0.04, 0.07), (0.06, 0.05)]] if name == "kink" else LINES[name]
    with plate_of(lines, law) as model:
        found = sb.transient(model, SHAKEN, 30 / FREQUENCY, 1 / (64 * FREQUENCY), modes=MODES)
        pressure, friction = np.maximum(found.contact_force, 0.0), np.abs(found.friction_force)
        most = law.static_friction
        assert (friction <= most * pressure + 1e-9 * pressure.max()).all()
        assert (friction > 0.67 * most * pressure + 1e-6 * pressure.max()).any()
        assert np.abs(found.energy.balance).max() < 1e-3 * found.energy.external.max()


@pytest.mark.long
def test_steady_state_of_friction_that_falls():
    """That of a kink is found where a step had no solution on the way."""
    lines = [[(0.05, 0.1), (0.04, 0.07), (0.06, 0.05)]]
    with plate_of(lines, sb.Coulomb(0.2, static_friction=0.3)) as model:
        for steps in (64, 256):
            options = {"steps": steps, "modes": MODES, "stability": False}
            found = sb.periodic(model, SHAKEN, FREQUENCY, **options)
            assert found.residuals[-1] < 1e-9 * np.linalg.norm(found.state)


def test_contact_as_a_period_begins_ends_in_a_solution():
    """Of random states of faces that meet in a T, for some of which exchanges find none: forces and slips
    obey the equations and the law.
    """
    with plate_of(LINES["T"], sb.Coulomb(3.0)) as model:
        period = prepare("test", model, SHAKEN, FREQUENCY, settings=PeriodSettings(modes=MODES, steps=64))
        driven, rng = period.at(FREQUENCY), np.random.default_rng(1)
        count, flexibility = len(period.laws), period.residual_flexibility
        rubs, moving, sticking = driven.constants.rubbing.rows, 0, 0
        # no step, but contact where the first one begins
        loads = StepLoads(np.empty((0, MODES)), driven.free_gap[:1], np.zeros(0, dtype=np.int8))
        history = StepHistory(*(np.empty((1, n)) for n in (MODES, MODES, period.pairs)), np.empty(0))
        for _ in range(60):
            state = np.linalg.norm(driven.linear_state) / 4.0 * rng.standard_normal(period.unknowns)
            q, former = state[:MODES] / period.weights, period.slip_units * state[2 * MODES :]
            begin = StepState(
                q, q.copy(), np.zeros(period.pairs), np.zeros(period.pairs, dtype=np.int8), former.copy()
            )
            march(driven.constants, loads, begin, history, period.kept(driven.constants))
            gap = driven.free_gap[0] + period.left @ (period.right.T @ q) + flexibility @ begin.force
            pressure, friction = begin.force[:count], begin.force[count:]
            size, least = np.abs(gap).max(), 1e-9 * pressure.max()
            assert (gap[:count] > -1e-8 * size).all() and (pressure >= -least).all()
            assert np.abs(pressure * gap[:count]).max() <= 1e-8 * size * pressure.max()
            assert gap[count:] == pytest.approx(begin.slip, abs=1e-8 * size)
            assert (np.abs(friction) <= 3.0 * pressure[rubs] + least).all()
            # what moves does so against all the friction there is
            moved = begin.slip - former
            moves = np.abs(moved) > 1e-7 * size
            against = -3.0 * (np.sign(moved) * pressure[rubs])[moves]
            assert friction[moves] == pytest.approx(against, abs=least)
            moving, sticking = moving + moves.sum(), sticking + (~moves & (pressure[rubs] > least)).sum()
        assert moving > 100 and sticking > 100


def test_basins_where_exchanges_find_no_solution():
    """Faces that meet in a T, with a coefficient at which Lemke's method is missed in some periods."""
    starts = 2e-6 * np.random.default_rng(4).standard_normal((2, 6, MODES)) * [[[1.0]], [[2e4]]]
    with plate_of(LINES["T"], sb.Coulomb(3.0)) as model:
        found = sb.basins(model, SHAKEN, FREQUENCY, tuple(starts), steps=64, modes=MODES, limit=2)
        assert (found.reached == -1).all()
