"""Faces between two stops: closed forms, SciPy's bounded least squares, integration between events, and the
same system with two rows of unilateral contact, one for each side.
"""

import math

import numpy as np
import pytest
from scipy import linalg, optimize

import sbfem_petsc as sb
from sbfem_petsc.contact.law import RowLaws
from tests.contact.test_law import ALPHA, BETA, LAYER, block, dense, rows_of_layer, two_notches
from tests.event_map import EventMap

# half the clearance of a mass between two springs, and their stiffness
HALF, SPRING = 0.3, 4.0


def between(law, rows, gaps, *, stiffness=0.0, damping=0.0, compliance=1.0 / SPRING):
    """Mass 1 on a spring to ground, and springs that it meets at either side."""
    return sb.reduce_matrices(
        np.eye(1),
        stiffness * np.eye(1),
        np.array(rows, dtype=float)[:, None],
        np.array(gaps, dtype=float),
        loads=np.ones((1, 1)),
        sensors={"A": 0},
        damping=damping * np.eye(1),
        compliance=np.full(len(rows), compliance),
        contact_laws=law,
    )


def one_row(**options):
    """With one row that has a clearance."""
    return between(sb.Clearance(width=2.0 * HALF), [1.0], [HALF], **options)


def two_rows(**options):
    """With two rows of unilateral contact."""
    return between(None, [1.0, -1.0], [HALF, HALF], **options)


# ---------------------------------------------------------------------- statics
@pytest.mark.parametrize("thickness", [1.0, 0.02])
def test_a_block_pulled_open(thickness):
    """Under 50 Pa the joint opens by its width and the layer's 50 Pa c; under -50 Pa it is the layer alone.

    The springs that hold the upper half are seen in 1e-5 of it.
    """
    width, layer = 3e-7, 2e-9
    for sign, opened in ((1.0, width + 50.0 * layer), (-1.0, -50.0 * layer)):
        u = []
        for law in (sb.Clearance(layer, width=width), sb.Tied()):
            with block(6, law, thickness=thickness) as model:
                found = sb.static(model, sb.EdgeLoad("edge3", ty=50.0 * sign))
                u.append(found.displacement("P")[1])
        assert abs(u[0] - u[1] - opened) < 2e-5 * abs(opened)
    with block(6, sb.Clearance(width=width), thickness=thickness) as model:
        found = sb.static(model, sb.EdgeLoad("edge3", ty=50.0))
        np.testing.assert_allclose(found.gap, width, rtol=1e-12)
        # 50 Pa on 0.1 m; the springs carry 1 N/m^3 times the upper half's displacement
        assert abs(found.contact_resultant / (-5.0 * thickness) - 1.0) < 1e-6


@pytest.mark.parametrize("compliance", [0.0, LAYER])
@pytest.mark.parametrize("fy", [3e3, -3e3])
def test_statics_of_a_crack(fy, compliance):
    """One crack of two with a clearance, against bounded least squares: gaps minimise the energy between
    their bounds, 1/2 (g - free)^T W^-1 (g - free).
    """
    width = 2.5e-6  # the notches are 2 micrometres wide at the mouth
    model = two_notches(contact_laws={"crack2": sb.Clearance(compliance, width=width)})
    mine = np.array([model.cracks[k].name == "crack2" for k in model.pairs.crack])
    load = sb.PointForce("A", fy=fy)
    stiffness, gaps, opening = dense(model)
    factor = linalg.cho_factor(stiffness)
    flexibility = gaps @ linalg.cho_solve(factor, gaps.T) + rows_of_layer(model, compliance) * mine
    free = gaps @ linalg.cho_solve(factor, model.load_columns([load]).forces[:, 0]) + opening
    lower = np.linalg.cholesky(0.5 * (flexibility + flexibility.T))
    half = linalg.solve_triangular(lower, np.eye(len(free)), lower=True)
    unit = width
    expected = (
        unit
        * optimize.lsq_linear(
            unit * half, half @ free, bounds=(0.0, np.where(mine, 1.0, np.inf)), method="bvls", tol=1e-15
        ).x
    )
    found = sb.static(model, load)
    np.testing.assert_allclose(found.gap, expected, atol=1e-7 * np.abs(expected).max())
    force = linalg.solve(flexibility, expected - free, assume_a="pos")
    np.testing.assert_allclose(found.contact_force, force, atol=1e-6 * np.abs(force).max())
    assert (found.contact_force[~mine] >= 0.0).all() and (found.gap[mine] <= width).all()
    assert fy > 0.0 or found.contact_force[mine].min() < 0.0


def test_no_width_is_tied():
    """A closed crack between stops at no distance."""
    results = []
    for law in (sb.Clearance(2e-9, width=0.0), sb.Tied(2e-9)):
        with block(6, law) as model:
            found = sb.static(model, sb.EdgeLoad("edge3", ty=50.0, tx=20.0))
            results.append((found.contact_force, found.displacement("P")))
    for one, other in zip(*results):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())


# ---------------------------------------------------------------------- motions
def test_free_vibration_of_a_mass_between_two_springs():
    """No spring to ground: 4 d / v between the springs and half a period of each on them, T = 4 d / v + 2 pi
    sqrt(m / k), under forces up to v sqrt(k m); second order in the step.
    """
    speed = 1.7
    period = 4.0 * HALF / speed + 2.0 * math.pi / math.sqrt(SPRING)
    errors = []
    for count in (4000, 8000):
        initial = (np.zeros(1), np.array([speed]))
        history = sb.transient(
            one_row(), [sb.Constant(0.0)], 3.0 * period, step=3.0 * period / count, initial=initial
        )
        q, v = history.states.q[-1, 0], history.states.v[-1, 0]
        errors.append(max(abs(q) / HALF, abs(v / speed - 1.0)))
        force = history.contact_force[:, 0]
        peak = speed * math.sqrt(SPRING)
        assert abs(force.max() / peak - 1.0) < 1e-4 and abs(force.min() / -peak - 1.0) < 1e-4
        # the gap and what the springs give way: the place of the mass
        place = history.displacement("A")[:, 1]
        shut = np.clip(place + HALF, 0.0, 2.0 * HALF)
        np.testing.assert_allclose(history.gap[:, 0], shut, atol=1e-12)
    assert errors[1] < 1e-4 and errors[1] < 0.5 * errors[0]


def free_frequency(energy, stiffness):
    """Of a mass 1 on a spring between two further ones."""
    speed = math.sqrt(2.0 * energy)
    own, both = math.sqrt(stiffness), math.sqrt(stiffness + SPRING)
    between = math.asin(HALF * own / speed) / own
    left = math.sqrt(speed**2 - (own * HALF) ** 2)
    beyond = math.atan2(left / both, HALF - SPRING * HALF / (stiffness + SPRING)) / both
    return 1.0 / (4.0 * (between + beyond))


def test_how_far_a_free_row_may_move():
    """By hand: to either stop, from inside and from beyond."""
    laws, gap = RowLaws.of([sb.Clearance(width=1.0)] * 3), np.array([0.7, -0.1, 1.2])
    assert laws.reach(gap, np.ones(3)) == pytest.approx([0.3, 1.1, 0.0])
    assert laws.reach(gap, -np.ones(3)) == pytest.approx([0.7, 0.0, 1.2])


@pytest.mark.long
def test_backbone():
    """Frequency over energy in closed form, from where the mass moves freely."""
    errors = []
    for steps in (256, 512):
        # the error goes up and down between the points, with where switches stand in their steps
        found = sb.backbone(one_row(stiffness=1.0), 1, 0.02, 0.5, steps=steps, largest_step=0.004)
        assert found.complete and found.energy[0] < 0.5 * HALF**2 < found.energy[-1]
        exact = [
            free_frequency(e, 1.0) if e > 0.5 * HALF**2 else 0.5 / math.pi for e in found.energy.tolist()
        ]
        errors.append(np.abs(found.frequency / exact - 1.0).max())
    assert errors[1] < 1e-5 and errors[1] < errors[0] / 3.0


def exact_orbit(event_map, frequency, state):
    """x(0) of the periodic motion by Newton's method, and the derivative of the map."""
    for _ in range(20):
        end, whole = event_map.period(state, frequency)
        change = np.linalg.solve(whole - np.eye(len(state)), state - end)
        state = state + change
        if np.abs(change).max() < 1e-12:
            return state, whole
    raise AssertionError("no periodic motion")


@pytest.mark.parametrize("frequency", [0.2, 0.35, 0.5])
def test_steady_state(frequency):
    """State and multipliers against SciPy's DOP853 from event to event, of second order in the step; .35 Hz
    is beside the resonance of the mass on all springs.
    """
    damping = 0.1
    exact = EventMap(
        np.eye(1), [[damping]], np.eye(1), [[1.0], [-1.0]], [HALF, HALF], [SPRING, SPRING], [4.0]
    )
    for steps in (512, 1024):
        orbit = sb.periodic(one_row(stiffness=1.0, damping=damping), [4.0], frequency, steps=steps)
        assert orbit.contact_force.max() > 0.0 > orbit.contact_force.min()
        guess = np.array([orbit.states.q[0, 0], orbit.states.v[0, 0]])
        state, whole = exact_orbit(exact, frequency, guess)
        known = np.sort(np.abs(np.linalg.eigvals(whole)))
        off = np.abs(np.sort(np.abs(orbit.multipliers)) - known).max()
        assert np.abs(guess - state).max() < 1e-3 * (512 / steps) ** 2 * np.abs(state).max()
        assert off < 2e-5 * (512 / steps) ** 2


def chains(modes):
    """Five masses, a row with a clearance at the first, unilateral contact at the last, and the same with a
    row for each side of the first.
    """
    stiffness = np.diag(np.full(5, 2.0)) - np.eye(5, k=1) - np.eye(5, k=-1)
    options = {"loads": np.eye(5)[:, [1]], "sensors": {"first": 0}, "modes": modes}
    damping = ALPHA * np.eye(5) + BETA * stiffness
    unit = np.eye(5)
    one = sb.reduce_matrices(
        np.eye(5), stiffness, unit[[0, 4]], [0.3, 0.2], damping=damping, compliance=[0.2, 0.1],
        contact_laws=[sb.Clearance(width=0.5), sb.Unilateral()], **options,
    )  # fmt: skip
    two = sb.reduce_matrices(
        np.eye(5), stiffness, [unit[0], -unit[0], unit[4]], [0.3, 0.2, 0.2], damping=damping,
        compliance=[0.2, 0.2, 0.1], **options,
    )  # fmt: skip
    return one, two


@pytest.mark.long
@pytest.mark.parametrize("modes", [5, 3])
def test_against_two_rows(modes):
    """The same history, orbit, derivative and response curve to rounding: the rows never act together."""
    one, two = chains(modes)
    histories = [sb.transient(r, [sb.Harmonic(1.0, 0.12)], 30.0, step=0.02) for r in (one, two)]
    forces = [history.contact_force for history in histories]
    np.testing.assert_allclose(forces[0][:, 0], forces[1][:, 0] - forces[1][:, 1], atol=1e-10)
    np.testing.assert_allclose(histories[0].states.q, histories[1].states.q, atol=1e-10)
    assert forces[0][:, 0].min() < 0.0 < forces[0][:, 0].max()
    for name in ("contact", "strain", "external"):
        a, b = (getattr(history.energy, name) for history in histories)
        np.testing.assert_allclose(a, b, atol=1e-10)
    orbits = [sb.periodic(r, [1.0], 0.12, steps=512) for r in (one, two)]
    np.testing.assert_allclose(orbits[0].states.q, orbits[1].states.q, atol=1e-9)
    np.testing.assert_allclose(
        np.sort_complex(orbits[0].multipliers), np.sort_complex(orbits[1].multipliers), atol=1e-7
    )
    curve = sb.frequency_response(one, [1.0], 0.1, 0.14, steps=512)
    amplitude = curve.amplitude("first")
    assert curve.complete
    for k in (0, int(amplitude.argmax()), len(amplitude) - 1):
        orbit = sb.periodic(two, [1.0], float(curve.frequency[k]), steps=512)
        assert abs(orbit.amplitude("first") / amplitude[k] - 1.0) < 1e-7


@pytest.mark.long
def test_unreduced_history():
    """The unreduced model beside the reduced one, to the modes that are left out and both schemes' errors."""
    law = {"crack2": sb.Clearance(LAYER, width=2.5e-6)}
    model = two_notches(contact_laws=law, rayleigh=sb.rayleigh_factors(500.0, 0.05, 20e3, 0.05))
    load = sb.PointForce("A", fy=sb.Harmonic(3e3, 400.0))
    whole = sb.transient(model, load, 0.004, step=4e-6, reduction=None)
    part = sb.transient(model, load, 0.004, step=4e-6, modes=60)
    mine = np.array([model.cracks[k].name == "crack2" for k in model.pairs.crack])
    for history in (whole, part):
        assert history.contact_force[:, mine].min() < 0.0 < history.contact_force.max()
        assert history.contact_force[:, ~mine].min() >= 0.0
        assert history.gap[:, mine].max() < 2.5e-6 * (1.0 + 1e-9)
    one, other = whole.displacement("A")[:, 1], part.displacement("A")[:, 1]
    assert np.abs(one - other).max() < 1e-3 * np.abs(other).max()


def test_bad_widths():
    for width, error, text in (
        (-1e-6, ValueError, "Clearance: width = -1e-06 .*must be finite and at least 0"),
        (math.inf, ValueError, "Clearance: width = inf .*must be finite"),
        ("wide", TypeError, "Clearance: width = 'wide' must be a number"),
    ):
        with pytest.raises(error, match=text):
            sb.Clearance(width=width)
    with pytest.raises(TypeError, match="width"):
        sb.Clearance(1e-6)
