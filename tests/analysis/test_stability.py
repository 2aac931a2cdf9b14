"""Floquet multipliers against closed forms, eigenvalues of the monodromy and what small disturbances do;
bifurcations.
"""

from functools import cache, partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import optimize

import sbfem_petsc as sb
from sbfem_petsc.continuation import bifurcations, branch_following, events, extrapolation
from sbfem_petsc.continuation.follow import Settings
from sbfem_petsc.continuation.multipliers import (
    Multipliers,
    ambiguous,
    eigenvalues,
    excursion,
    inverse_iteration,
    multipliers_of,
    passages,
)
from sbfem_petsc.continuation.problem import Point, Problem
from sbfem_petsc.continuation.problems import driven_orbits
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.errors import OutOfMemory
from sbfem_petsc.motion.period_map import FixedPoint
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from sbfem_petsc.reduction.matrices import reduce_matrices
from tests.event_map import two_masses_exactly
from tests.reference import paper_beam
from tests.systems import ALUMINIUM, one_mass, two_masses

TURN = 2 * np.pi


@pytest.fixture(scope="module")
def beam():
    """Case P on the faces that its figures belong to, 80 modes."""
    model = sb.Model(paper_beam().mesh(face_edges=1), ALUMINIUM, damping=0.002, tip_modes=0)
    return model, sb.periodic(model, sb.PointForce("A", fy=1.0), 14000.0, modes=80, stability=False).reduced


def multipliers(driven, motion, whole=None):
    return multipliers_of(FixedPoint(np.zeros(0), driven, motion), whole)


def motion_of(model, reduction, force, frequency, steps=512):
    """Orbit, period map and integrated period."""
    load = sb.PointForce("A", fy=force)
    orbit = sb.periodic(reduction, load, frequency, steps=steps)
    driven = prepare("test", reduction, load, frequency, settings=PeriodSettings(steps=steps)).at(frequency)
    return orbit, driven, driven.run(orbit.state)


@pytest.fixture(scope="module")
def up():
    """The response from 0.5 to 0.9 rad/s."""
    return sb.frequency_response(two_masses(), [0.1], 0.5 / (2 * np.pi), 0.9 / (2 * np.pi), steps=2048)


def test_linear_multipliers():
    """Pairs of modulus exp(-zeta omega T), one for each mode, whatever the load; by products as well."""
    omega = np.array([1.0, 2.3, 7.1, 30.0])
    zeta = 0.013
    r = reduce_matrices(
        np.eye(4),
        np.diag(omega**2),
        np.zeros((0, 4)),
        np.zeros(0),
        loads=np.ones((4, 1)),
        sensors={"x": 0},
        damping=zeta,
    )
    orbit = sb.periodic(r, 1.0, 0.21)
    exact = np.repeat(np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * omega / 0.21), 2)
    exact[1::2] = exact[1::2].conj()
    np.testing.assert_allclose(
        np.sort_complex(orbit.multipliers), np.sort_complex(exact), rtol=1e-11, atol=1e-14
    )
    assert (
        (np.diff(np.abs(orbit.multipliers)) <= 1e-15).all() and orbit.stable and orbit.multiplier_error < 1e-8
    )


def test_no_room_is_no_motion_that_is_not_found(monkeypatch):
    """In the steps that tell the multipliers' uncertainty; it would be told as not known."""
    orbit = sb.periodic(one_mass(0.5, 0.05), 1.0, 0.21)

    def full(*_, **__):
        raise OutOfMemory("no room")

    monkeypatch.setattr("sbfem_petsc.continuation.orbit.shoot", full)
    with pytest.raises(sb.SolverFailure, match="no room"):
        assert orbit.multiplier_error


@pytest.mark.long
def test_dense_and_krylov(beam):
    """SLEPc's LAPACK against numpy on the same matrix (1e-9, eigenvalues near the unit circle are well
    conditioned), and the largest by products alone.
    """
    orbit, driven, motion = motion_of(*beam, 1500.0, 14254.61)
    matrix = driven.monodromy(motion)
    exact = np.linalg.eigvals(matrix)
    exact = exact[np.argsort(-np.abs(exact), kind="stable")]
    np.testing.assert_allclose(np.abs(orbit.multipliers), np.abs(exact), atol=1e-9)
    for value in exact:
        assert np.abs(orbit.multipliers - value).min() < 1e-9
    products = multipliers(driven, motion, whole=False)
    assert len(products.values) >= 6
    np.testing.assert_allclose(np.abs(products.values[:6]), np.abs(exact[:6]), atol=1e-8)
    for k in range(6):
        vector = products.direction(k)
        assert np.linalg.norm(matrix @ vector - products.values[k] * vector) < 1e-7 * np.linalg.norm(vector)


def growth(model, reduction, force, frequency, steps=512, size=1e-3, periods=400):
    """log |mu|, and the growth per period of a disturbance along the least stable Floquet direction, by two
    histories from the orbit and from beside it.

    What is measured is the disturbance's part along the left eigenvector, in which no other direction takes
    part: it falls or grows from the first period on.
    """
    orbit, driven, motion = motion_of(model, reduction, force, frequency, steps)
    found = multipliers(driven, motion)
    values, left = np.linalg.eig(driven.monodromy(motion).T)
    left = left[:, np.argmin(np.abs(values - found.values[0]))]
    direction = found.direction(0).real / np.linalg.norm(found.direction(0).real)
    states = []
    for offset in (0.0, size * np.linalg.norm(orbit.state)):
        state = orbit.state + offset * direction
        m = len(reduction.omega)
        history = sb.transient(
            reduction,
            sb.PointForce("A", fy=sb.Harmonic(force, frequency)),
            periods / frequency,
            step=1 / (frequency * steps),
            decimation=steps,
            initial=(state[:m] / reduction.omega, state[m:]),
            progress=None,
        )
        assert len(history.time) == periods + 1
        states.append(np.concatenate([reduction.omega * history.states.q, history.states.v], axis=1))
    part = np.abs((states[1] - states[0]) @ left)
    return orbit, np.log(np.abs(found.values[0])), np.polyfit(np.arange(periods + 1), np.log(part), 1)[0]


@pytest.mark.long
@pytest.mark.parametrize(
    "force, frequency, size, stable",
    [
        (300.0, 14149.34, 1e-2, True),
        (300.0, 14176.39, 1e-2, False),
        (1500.0, 14163.31, 1e-2, False),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                (300.0, 14100.0, 1e-2, True),
                (1500.0, 14091.44, 1e-2, True),
                (1500.0, 14254.61, 1e-2, False),
                (1500.0, 14300.0, 1e-3, True),
            )
        ),
    ],
)
def test_disturbances_of_the_beam(beam, force, frequency, size, stable):
    """1 % off the orbit (0.1 % in the last case, where 1 % is no longer small), 400 periods: growth or decay
    per period, from 1e-5 to 4e-3, is log |mu| within 5 %; 1 % is met.
    """
    orbit, expected, found = growth(*beam, force, frequency, size=size)
    assert orbit.stable is stable and orbit.contact_resultant.max() > 0
    assert found == pytest.approx(expected, rel=0.03)


@pytest.mark.long
@pytest.mark.parametrize(
    "omega, large, size, stable",
    [
        (0.55, False, 1e-2, True),
        (0.66, True, 1e-2, True),
        (0.75, True, 3e-3, False),
        (0.605, True, 1e-3, False),
        (0.70, False, 1e-2, True),
    ],
)
def test_disturbances_of_two_masses(up, omega, large, size, stable):
    """The map itself, off the orbit along the direction: on the open branch, on stable and unstable parts
    with impacts; 5 % of log |mu|. They are disturbed so far that contact begins and ends some steps earlier
    or later, as the multipliers take it.
    """
    near = (
        np.abs(TURN * up.frequency - omega)
        + 10.0 * ((up.contact_peak > 0) != large)
        + 10.0 * (up.multipliers[:, 0].real > 1)
    )
    index = int(near.argmin())
    assert up.stable[index] == stable
    period = up.period.at(float(up.value[index]))
    state, motion = up.states[index], period.run(up.states[index])
    found = multipliers(period, motion)
    values, left = np.linalg.eig(period.monodromy(motion).T)
    left = left[:, np.argmin(np.abs(values - found.values[0]))]
    direction = found.direction(0).real
    moved = state + size * np.linalg.norm(state) * direction / np.linalg.norm(direction)
    part = [abs(left @ (moved - state))]
    for _ in range(12):
        moved = moved + period.run(moved).residual
        part.append(abs(left @ (moved - state)))
    # while the disturbance is small
    part = np.array(part)[np.array(part) < 10 * part[0]]
    assert len(part) > 4
    assert np.polyfit(np.arange(len(part)), np.log(part), 1)[0] == pytest.approx(
        np.log(abs(found.values[0])), rel=0.05
    )


@pytest.mark.slow
def test_without_damping_the_steps_are_symplectic():
    """Eigenvalues mu and 1 / mu, contact or not, of the steps' own derivative and of that with switches
    located: 1e-6 is asked for, 1e-10 is met.
    """
    model = sb.Model(paper_beam().mesh(order=4), ALUMINIUM)
    reduction = sb.periodic(model, sb.PointForce("A", fy=1.0), 2500.0, stability=False, modes=40).reduced
    for frequency in (433.0, 3000.0):
        orbit, driven, motion = motion_of(model, reduction, 300.0, frequency)
        assert orbit.contact_resultant.max() > 1000
        for located in (False, True):
            moduli = np.sort(
                np.abs(np.linalg.eigvals(driven.carried(motion, np.eye(len(orbit.state)), located=located)))
            )
            np.testing.assert_allclose(moduli * moduli[::-1], 1.0, atol=1e-8)


def test_uncertainty_is_what_twice_the_steps_change(beam):
    """By a motion sought in twice the steps, where the error is estimated with one derivative for both; and
    the largest modulus in sixteen times the steps is within it.
    """
    model, reduction = beam
    load = sb.PointForce("A", fy=1500.0)
    orbit = sb.periodic(reduction, load, 14254.61, steps=512)
    moduli = []
    for times in (2, 16):
        period = prepare("test", reduction, load, 14254.61, settings=PeriodSettings(steps=512 * times))
        found = shoot(period.at(14254.61), orbit.state)
        moduli.append(abs(multipliers(found.driven, found.motion).values[0]))
    change, error = np.abs(np.array(moduli) - abs(orbit.multipliers[0]))
    assert orbit.multiplier_error == pytest.approx(5.0 / 3.0 * change, rel=1e-2)
    assert 0.1 * orbit.multiplier_error < error < 2.0 * orbit.multiplier_error < 2e-3
    assert orbit.stable is False


@pytest.mark.slow
@pytest.mark.parametrize(
    "force, frequency",
    [(300.0, 14176.39), *(pytest.param(1500.0, f, marks=pytest.mark.long) for f in (14163.31, 14254.61))],
)
def test_multipliers_converge_with_the_steps(beam, force, frequency):
    """|mu| - 1 at 512 steps is within 1 % of that at 4096, and the verdict is the same from 256 on."""
    moduli = [
        np.abs(motion_of(*beam, force, frequency, steps)[0].multipliers[0]) for steps in (256, 512, 4096)
    ]
    assert all(m > 1 for m in moduli)
    assert moduli[0] - 1 == pytest.approx(moduli[2] - 1, rel=0.05) and moduli[1] - 1 == pytest.approx(
        moduli[2] - 1, rel=0.01
    )


# ---------------------------------------------------------------- two masses and a stop: a published example


@pytest.mark.slow
def test_grazing_peak_and_folds(up):
    """Grazing at 0.582, peak of the second mass' fundamental harmonic 0.936 at 0.751, folds at 0.7556 and
    0.655 rad/s, within 1 %.
    """
    omega, amplitude = 2 * np.pi * up.frequency, np.abs(up.harmonics("2")[:, 1])
    assert up.complete and up.value[-1] == pytest.approx(0.9 / (2 * np.pi)) and up.converged.all()
    touching = np.flatnonzero(up.contact_peak > 0)
    assert (np.diff(touching) == 1).all()
    # by the bifurcation that begins there, and by the points on either side of it
    first = up.bifurcations[0]
    assert (
        2 * np.pi * first.value == pytest.approx(0.582, rel=0.01)
        and omega[touching[0] - 1] < 2 * np.pi * first.value < omega[touching[0]]
    )
    top = amplitude.argmax()
    assert amplitude[top] == pytest.approx(0.936, rel=0.01) and omega[top] == pytest.approx(0.751, rel=0.01)
    folds = [2 * np.pi * b.value for b in up.bifurcations if b.kind == "fold"]
    assert folds == [pytest.approx(0.7556, rel=0.01), pytest.approx(0.655, rel=0.01)]
    assert max(omega[touching[0] : touching[-1]]) == pytest.approx(folds[0], rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("compliance, doubled", [(1e-2, False), (3e-4, True), (1e-4, True)])
def test_where_the_stop_is_met(compliance, doubled):
    """The open motion, whose multipliers have the modulus 0.94, meets the stop at 0.5819 rad/s (closed form).
    Behind it a pair of them leaves the unit circle; with a stiff stop they become real, and one of them comes
    back through -1 within 3e-5 of the frequency, all of which is resolved.
    """
    stiffness = np.array([[1.0, -1.0], [-1.0, 2.0]])

    def reach(omega):
        dynamic = (1.0 + 0.03j * omega) * stiffness - omega**2 * np.eye(2)
        return abs(np.linalg.solve(dynamic, [0.0, 0.1])[0]) - 1.0

    met = optimize.brentq(reach, 0.57, 0.59)
    system = two_masses(compliance=compliance)
    curve = sb.frequency_response(system, [0.1], 0.575 / TURN, 0.5825 / TURN, steps=1024)
    first, *others = curve.bifurcations
    assert first.kind == "Neimark-Sacker" and TURN * first.value == pytest.approx(met, rel=2e-5)
    inside = np.abs(curve.multipliers[: first.after, 0])
    assert inside[:-5] == pytest.approx(0.94, abs=1e-2)
    assert [other.kind for other in others] == ["period doubling"] * doubled
    for other in others:
        # the number of unstable multipliers of the motions on either side of it
        sides = [
            (np.abs(sb.periodic(system, [0.1], f, steps=1024, guess=curve.orbit(k)).multipliers) > 1.0).sum()
            for f, k in (
                (curve.value[other.after - 1], other.after - 1),
                (curve.value[other.after], other.after),
            )
        ]
        assert abs(sides[1] - sides[0]) == 1


@pytest.mark.slow
def test_verdicts_do_not_flip(up):
    """Six changes along 90 points, each with its bifurcation: a Neimark-Sacker point where the stop is met, a
    second one, two period doublings, two folds.
    """
    assert np.count_nonzero(up.stable[1:] != up.stable[:-1]) == 6
    for k in np.flatnonzero(up.stable[1:] != up.stable[:-1]) + 1:
        assert min(abs(b.after - k) for b in up.bifurcations) <= 1
    # what the verdict may depend on is measured, and true to the exact motions
    off = np.abs(np.abs(up.multipliers[:, 0]) - 1.0)
    known = np.isfinite(up.multiplier_error)
    assert known[off < 0.005].any() and known.sum() >= 4
    assert not known[off > 0.05].any() and up.undecided.sum() <= 0.05 * len(up.value)
    exact = two_masses_exactly(0.1)
    for k in np.flatnonzero(known & (up.contact_peak > 0)):
        orbit = up.orbit(int(k))
        state = np.array([of(p)[0, 1] for of in (orbit.displacement, orbit.velocity) for p in "12"])
        try:
            true = abs(exact.multipliers(state, orbit.frequency)[0])
        except (AssertionError, np.linalg.LinAlgError):  # beside a fold, where the exact motion has none
            continue
        error = abs(abs(orbit.multipliers[0]) - true)
        assert up.multiplier_error[k] >= 0.5 * error
        assert up.undecided[k] or up.stable[k] == (true < 1.0)
    # the open part is linear: one multiplier's modulus exp(-zeta omega T)
    r, away = up.reduced, up.contact_peak == 0
    exact = np.exp(-(r.damping * r.omega).min() / up.frequency[away])
    np.testing.assert_allclose(np.abs(up.multipliers[away, 0]), exact, rtol=1e-9)


@pytest.mark.slow
def test_period_doublings_are_bracketed(up):
    """A real multiplier passes -1 between the points beside each, first at 0.7388 rad/s, and again next to
    the upper fold: there the frequency itself may turn between them, so that they are told by the chord.
    """
    doublings = [b for b in up.bifurcations if b.kind == "period doubling"]
    assert doublings and 2 * np.pi * doublings[0].value == pytest.approx(0.7388, rel=2e-3)
    for b in doublings:
        lowest = [min(up.multipliers[k].real) for k in (b.after - 1, b.after)]
        assert (lowest[0] + 1) * (lowest[1] + 1) < 0
        assert b.multiplier.real == pytest.approx(-1.0, abs=2e-3) and abs(b.multiplier.imag) < 1e-9
        chord = up.states[b.after] - up.states[b.after - 1]
        assert 0.0 <= chord @ (b.state - up.states[b.after - 1]) <= chord @ chord


@pytest.mark.slow
def test_located_bifurcations_are_motions(up):
    """The states that come with them are fixed points, and their directions eigenvectors of the monodromy
    with the multiplier named.
    """
    assert up.bifurcations
    for b in up.bifurcations:
        driven = up.period.at(b.own_value)
        motion = driven.run(b.state)
        assert np.linalg.norm(motion.residual) < 1e-7 * np.linalg.norm(b.state)
        matrix = driven.monodromy(motion)
        assert np.linalg.norm(matrix @ b.direction - b.multiplier * b.direction) < 1e-4 * np.linalg.norm(
            b.direction
        ) * np.linalg.norm(matrix, 2)


@pytest.mark.slow
def test_period_doubled_motion(up):
    """Between the doublings a history beside the unstable motion settles on one of twice the period;
    `periods=2` from there finds it, and it is stable.
    """
    k = int(np.argmin(np.abs(2 * np.pi * up.frequency - 0.7445) + (up.amplitude("2") < 0.9)))
    frequency = float(up.frequency[k])
    assert up.multipliers[k].real.min() < -1 and not up.stable[k]
    driven = up.period.at(frequency)
    direction = multipliers(driven, driven.run(up.states[k])).direction(0).real
    state = up.states[k] + 1e-3 * np.linalg.norm(up.states[k]) * direction
    for _ in range(400):
        state = state + driven.run(state).residual
    twice = state + driven.run(state).residual
    apart = np.linalg.norm(twice - state)
    again = twice + driven.run(twice).residual
    assert apart > 1e-2 * np.linalg.norm(state) and np.linalg.norm(again - state) < 1e-4 * apart
    period = prepare("test", up.reduced, [0.1], frequency, settings=PeriodSettings(periods=2, steps=2048))
    shot = shoot(period.at(frequency), state)
    assert np.linalg.norm(shot.state - state) < 1e-3 * apart
    assert np.abs(multipliers(shot.driven, shot.motion).values[0]) < 1.0


@pytest.mark.slow
def test_coexisting_stable_branches(up):
    """Between 0.655 and 0.739 rad/s: two stable motions at one frequency, small without impacts and large
    with them; each is kept by its own history and the third one is unstable.
    """
    omega = 0.70
    apart = np.diff(np.sign(2 * np.pi * up.frequency - omega)) != 0
    beside = np.flatnonzero(apart)
    assert len(beside) == 3
    verdicts, amplitudes = up.stable[beside], np.abs(up.harmonics("2")[beside, 1])
    assert verdicts.tolist() == [True, False, True] and amplitudes[0] > 2 * amplitudes[2]
    period = up.period
    for k in (beside[0], beside[2]):
        driven = period.at(omega / (2 * np.pi))
        shot = shoot(period.at(omega / (2 * np.pi)), up.states[k])
        state = 1.01 * shot.state
        for _ in range(200):
            state = state + driven.run(state).residual
        assert np.linalg.norm(state - shot.state) < 1e-3 * np.linalg.norm(shot.state)
        assert np.abs(multipliers(shot.driven, shot.motion).values[0]) < 1


def found(*values):
    """Multipliers of a point."""
    return Multipliers(np.array(values, dtype=complex), lambda k: np.eye(len(values))[k])


def test_passages_between_two_points():
    """As many unstable multipliers before and behind, one at -1 and another at +1, or one pair in the place
    of another; a complex pair that comes out of two real ones passes nothing.
    """
    before, pair = found(-1.2, 0.9, 0.5), found(-1.1 + 0.2j, -1.1 - 0.2j, 0.5)
    behind = found(1.1, -0.9, 0.5)
    assert passages(before, behind) == passages(behind, before) == 2
    assert passages(before, found(-0.9, 0.9, 0.5)) == 1
    assert passages(found(-1.3, -1.2, 0.5), pair) == passages(pair, pair) == 0
    early, late = np.exp(0.4j), np.exp(2.8j)
    one = found(*(1.001 * early * np.array([1, 1])).tolist(), 0.99 * late, 0.99 * late.conjugate())
    one.values[1] = one.values[0].conjugate()
    other = found(0.999 * early, 0.999 * early.conjugate(), 1.02 * late, 1.02 * late.conjugate())
    assert passages(one, other) == passages(other, one) == 2
    assert passages(one, one) == 0
    # a pair outside and then one real multiplier: whatever has come back in, something else has passed
    assert ambiguous(pair, found(-1.3, -0.9, 0.5)) and ambiguous(found(-1.3, -0.9, 0.5), pair)
    assert not ambiguous(found(-1.3, -1.2, 0.5), pair) and not ambiguous(before, found(-0.9, 0.9, 0.5))


@pytest.mark.parametrize(
    ("outer", "inner", "place"),
    [
        ((0.96, 0.96), (0.999, 0.999), 0.5),  # out and back in
        ((1.04, 1.03), (1.002, 1.001), 0.56),  # in and back out
        ((0.97, 0.99), (0.98, 0.985), None),  # no bend
        ((0.9995, 0.9995), (0.999, 0.999), None),  # bent away from the circle
        ((0.96, 0.96), (0.99, 0.99), None),  # short of it
    ],
)
def test_excursions_between_two_points(outer, inner, place):
    """A pair whose modulus follows a parabola through four points at -1, 0, 1 and 2, beside another that
    stays inside.
    """
    turn = np.exp(1.3j)

    def at(modulus):
        return found(modulus * turn, modulus * turn.conjugate(), 0.97, 0.96)

    moduli = (outer[0], *inner, outer[1])
    expected = excursion([(k - 1.0, at(modulus)) for k, modulus in enumerate(moduli)])
    assert expected is None if place is None else abs(expected - place) < 0.05


@pytest.mark.long
def test_one_pair_in_the_place_of_another(beam, monkeypatch):
    """Within 3 Hz one pair enters the circle and another one leaves it: steps of 7 Hz pass both unless the
    multipliers themselves are looked at, not their number alone.
    """
    _, reduction = beam

    def located(span, largest):
        monkeypatch.setattr(driven_orbits, "SPAN", span)
        monkeypatch.setattr(branch_following, "Settings", partial(Settings, largest=largest))
        load = sb.PointForce("A", fy=1500.0)
        found = sb.frequency_response(reduction, load, 14135.0, 14155.0).bifurcations
        return [item.own_value for item in found]  # in more modes they are nearly one

    fine = located(7.0, 0.35)
    assert len(fine) == 2 and 2.0 < fine[1] - fine[0] < 3.0
    # to where they are located in the shorter chord
    np.testing.assert_allclose(located(0.5, 0.7), fine, atol=0.02)
    monkeypatch.setattr(branch_following, "_unseen", lambda *_: None)
    assert not located(0.5, 0.7)


NEIGHBOURS = {
    "a pair leaves and comes back": (
        [[3.4406822972284097, -0.5331344469177417], [-0.5331344469177417, 3.0354270384392645]],
        (0.05722611765676448, 8.02182822239003, 0.0, 0.6723650107918112, 0.6094897839740996),
    ),
    "a pair comes back, a real one leaves": (
        [[3.309698775132496, -0.6011519410485913], [-0.6011519410485913, 3.074270811680282]],
        (0.009754149660206095, 6.864697019059793, 0.0, 0.06153919980793193, 0.5069774525283081),
    ),
    "the same within a hundredth": (
        [[2.425502259191385, -0.25034763590404496], [-0.25034763590404496, 2.536893977540927]],
        (0.016376626907493478, 23.194427066168753, 0.0, 0.5833307291727118, 0.41329362259475017),
    ),
    "a steep passage beside first contact": (
        [[0.6843525334945149]],
        (0.020845727303632027, 4.393487672943018, 0.2, 0.45255057082192496, 0.23111145847255354),
    ),
}


@pytest.mark.long
@pytest.mark.parametrize("name", NEIGHBOURS)
def test_neighbouring_bifurcations_are_told_apart(name):
    """Systems found among random ones, in which steps of usual length pass two bifurcations, or one that is
    steep: kinds and places are those of a curve in three to eight times as many points.
    """
    stiffness, (damping, stop, gap, force, start) = NEIGHBOURS[name]
    stiffness, n = np.array(stiffness), len(stiffness)
    system = reduce_matrices(
        np.eye(n),
        stiffness,
        -np.eye(n)[:1],
        np.array([gap]),
        loads=np.eye(n)[:, -1:],
        sensors={"x": 0},
        compliance=np.array([1.0 / stop]),
        damping=damping,
    )

    def bifurcations_of(**options):
        curve = sb.frequency_response(system, [force], start, 1.5 * start, steps=256, **options)
        return [item.kind for item in curve.bifurcations], [item.value / start for item in curve.bifurcations]

    kinds, places = bifurcations_of()
    fine, expected = bifurcations_of(largest_step=0.5 * start / 120, points=1000)
    assert kinds == fine and len(kinds) > 1
    np.testing.assert_allclose(places, expected, atol=2e-4)


@pytest.mark.long
@pytest.mark.parametrize("name", ["two masses", "beam"])
def test_located_by_brents_method(name, beam, monkeypatch):
    """SciPy's root finder on the same test functions, to a millionth of the way between two points: what is
    located is as near to it as is said. The beam's have kinks, where another multiplier comes to be the
    largest, so that smooth ones are looked for; they take fewer points than the root finder.
    """
    apart, calls = [], [0, 0]
    own = events.find_zero

    def both(line, k, test, ends, smooth=None, small=np.inf):
        def counted(point):
            calls[0] += 1
            return test(point)

        found = own(line, k, counted, ends, smooth, small)
        known = {0.0: ends[0], 1.0: ends[1]}

        def value(share):
            if share not in known:
                calls[1] += 1
                known[share] = test(events.between(line, k, share))
            return known[share]

        exact = optimize.brentq(value, 0.0, 1.0, xtol=1e-6)
        apart.append(abs(events.Way(line, k).place_of(found[0]) - exact))
        return found

    for module in (bifurcations, events):
        monkeypatch.setattr(module, "find_zero", both)
    if name == "two masses":
        curve = sb.frequency_response(two_masses(), [0.1], 0.5 / (2 * np.pi), 0.9 / (2 * np.pi), steps=2048)
    else:
        curve = sb.frequency_response(beam[1], sb.PointForce("A", fy=1500.0), 14180.0, 14310.0)
    assert len(apart) >= len(curve.bifurcations) >= 3
    assert max(apart) < events.FINE
    assert calls[0] < 0.7 * calls[1]


def test_a_multiplier_is_followed_past_others():
    """One that grows past the modulus of others, by where it is expected."""
    shares = [0.0, 0.3, 0.5, 1.0, -0.8]
    moving = {share: (0.9 + 0.2 * share) * np.exp(1j * (1.0 + 0.1 * share)) for share in shares}
    spectra = {}
    for share, value in moving.items():
        values = np.array([value, value.conjugate(), 0.999j, -0.999j, 0.98, -0.97, 0.95 * np.exp(1.4j)])
        spectra[share] = values[np.argsort(-np.abs(values), kind="stable")]
    assert bifurcations.follow_multiplier(spectra, 1.0, 0) == pytest.approx(moving)
    assert bifurcations.follow_multiplier(spectra, 1.0, 1) == pytest.approx(moving)


@pytest.mark.parametrize("ends", [(0.13, 0.19), (0.19, 0.13)])
def test_folds_of_an_oscillator(ends):
    """As on curves in steps of a thousandth of the range, to 1e-7."""
    system = one_mass(1.0, 0.03 * 1.138979480397014)
    curve = sb.frequency_response(system, [0.15], *ends, steps=256)
    found = sorted(b.own_value for b in curve.bifurcations if b.kind == "fold")
    assert found == pytest.approx([0.169113741, 0.172550895], rel=1e-7)


@cache
def over_both_folds():
    system = one_mass(1.0, 0.015 * 1.138979480397014)
    return system, sb.frequency_response(system, [0.15], 0.13, 0.19, steps=256)


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("before", [1e-4, 1e-5, 1e-6, 1e-7, 1e-8])
def test_a_curve_from_beside_a_fold(which, before):
    """From shortly before a fold over it and back to the frequency at which it began, in the other motion:
    the resonance's fold from below, and from above that at which the motion ceases to touch.
    """
    system, whole = over_both_folds()
    fold = whole.bifurcations[which]
    start, stop = fold.own_value * (1.0 - (before, -before)[which]), (0.19, 0.13)[which]
    first = sb.periodic(system, [0.15], start, steps=256, guess=whole.orbit(fold.after - 1))
    with pytest.warns(sb.BranchWarning, match=f"turned about .* does not lead to {stop}") as told:
        curve = sb.frequency_response(system, [0.15], start, stop, steps=256, guess=first)
    assert len(told) == 1
    assert [b.kind for b in curve.bifurcations] == ["fold"] and curve.value[-1] == start
    assert curve.bifurcations[0].own_value == pytest.approx(fold.own_value, rel=1e-7)
    across = curve.states[[0, -1]] - fold.state
    assert across[0] @ across[1] < -0.99 * np.linalg.norm(across, axis=1).prod()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::meshing.warnings.StepWarning")
def test_a_fold_among_teeth_is_told_once():
    """In 256 steps the points turn three steps of the curve behind the place at which the multiplier passes
    1: that is one fold, where an exact integration turns, and no branch point beside a fold of another
    multiplier.
    """
    damping, compliance, force = 0.018806269343763747, 0.02287420151227054, 0.10012491490519909
    curve = sb.frequency_response(
        two_masses(damping, compliance), [force], 0.8741760234829364 / TURN, 0.5 / TURN, steps=256
    )
    near = [item for item in curve.bifurcations if abs(item.value * TURN - 0.7626) < 2e-3]
    assert [item.kind for item in near] == ["fold"] and abs(near[0].multiplier - 1.0) < 1e-3
    exact = two_masses_exactly(force, compliance, damping)
    orbit = curve.orbit(near[0].after)
    first = np.array([of(p)[0, 1] for of in (orbit.displacement, orbit.velocity) for p in "12"])
    turned, places = [], first[0] * np.array([0.999, 1.0, 1.001])
    for place in places:  # the motions with this displacement at t = 0, and their frequencies
        found = optimize.root(
            lambda z, place=place: exact.period(np.append(place, z[:3]), z[3])[0] - np.append(place, z[:3]),
            np.append(first[1:], orbit.frequency),
        )
        assert found.success
        turned.append(found.x[3])
    bend, slope, level = np.polyfit(places - places[1], turned, 2)
    assert near[0].value == pytest.approx(level - 0.25 * slope**2 / bend, rel=3e-5)


def test_motions_that_are_not_isolated():
    """Without damping, at half its frequency: every motion comes back after a period, at any amplitude."""
    free = one_mass(1.0, 0.0, stiffness=0.5)
    with pytest.warns(
        sb.BranchWarning, match="which it has not left: motions of one period are not isolated"
    ):
        curve = sb.frequency_response(free, [0.3], 0.5 / TURN, 0.9 / TURN, steps=192)
    assert not curve.complete
    curve = sb.frequency_response(free, [0.3], 0.51 / TURN, 0.6 / TURN, steps=192)
    assert curve.complete
    linear = 0.3 / (1.0 - (TURN * curve.value) ** 2)
    np.testing.assert_allclose(curve.amplitude("A"), linear, rtol=1e-3)  # of samples of a period


def test_a_body_without_supports():
    """A mass that drifts where it likes, beside a stop: it has a periodic motion, and any number of them."""
    system = sb.reduce_matrices(
        np.eye(2),
        np.diag([1.0, 0.0]),
        np.array([[0.0, 1.0]]),
        np.zeros(1),
        loads=np.array([[0.0], [1.0]]),
        sensors={"A": 1},
        compliance=np.array([0.1]),
    )
    assert sb.periodic(system, [0.1], 0.11, steps=128).stable
    with pytest.raises(sb.SolveError, match="not isolated at 0.11, as those of a body .* hold it"):
        sb.frequency_response(system, [0.1], 0.11, 0.15, steps=128)


def test_no_bifurcation_off_the_unit_circle():
    """Where a complex pair of modulus 0.98 becomes real beside a fold, and one of it passes 1 there."""
    stiffness = np.array([[2.1450927, -1.0276563], [-1.0276563, 1.0276563]])
    system = reduce_matrices(
        np.diag([1.675309, 0.75858799]),
        stiffness,
        np.diag([-1.0, 1.0]),
        np.array([1.0, 0.3]),
        loads=np.array([[0.0], [1.0]]),
        sensors={"1": 0, "2": 1},
        damping=0.0079541407 * stiffness,
        compliance=np.array([0.056636562, 2.0609249]),
    )
    curve = sb.frequency_response(system, [0.81483271], 0.17353143, 0.054535861, steps=192, points=2500)
    # those of steps of a four-hundredth of the range
    assert [b.kind for b in curve.bifurcations] == ["fold", "period doubling"]
    values = [b.own_value for b in curve.bifurcations]
    assert values == pytest.approx([0.1553723, 0.1648956], rel=1e-6)
    assert max(abs(abs(b.multiplier) - 1.0) for b in curve.bifurcations) < 1e-4


class _Spectrum(Problem):
    """A branch whose multipliers are given functions of the parameter, with points at -1, 0, 1 and 2."""

    def __init__(self, values, monkeypatch):
        self.values, self.calls = values, 0
        self.points = [self.point(float(place)) for place in (-1, 0, 1, 2)]
        monkeypatch.setattr(events, "between", self.between)
        monkeypatch.setattr(bifurcations, "fold_between", lambda line, k: None)  # a straight branch
        self.period = SimpleNamespace(steps=1024, excitation=SimpleNamespace(periods=1))

    def units(self, u):
        return np.ones(3), np.ones(3)

    def value(self, u):
        return u[-1], np.array([0.0, 0.0, 1.0])

    def point(self, place):
        state = SimpleNamespace(state=np.array([1.0, place]), touching=np.zeros(1, dtype=bool))
        state.multipliers = self.at(place)
        return Point(self, np.array([1.0, place, place]), state, place)

    def between(self, line, k, share, known=None):
        self.calls += 1
        return self.point(self.points[k].value + share)

    def at(self, place):
        values = np.array(self.values(place), dtype=complex)
        values = values[np.argsort(-np.abs(values), kind="stable")]
        return Multipliers(values, lambda k: np.eye(len(values))[k])

    def crossings(self):
        return bifurcations.locate(self)


def _pair(size, angle):
    return [size * np.exp(1j * angle), size * np.exp(-1j * angle)]


@pytest.mark.parametrize(
    "values, place, kind, calls",
    [
        (lambda x: [*_pair(1 + 0.3 * (x - 0.3), 1.0), 0.99, -0.98], 0.3, "Neimark-Sacker", 2),
        (lambda x: [-(1 + 0.5 * (x - 0.5)), 0.3], 0.5, "period doubling", 2),
        # the one that is followed passes first, but the number of them that the test counts changes later
        (
            lambda x: _pair(1 + 0.03 * (x - 0.3), 1.0) + _pair(1 + 1.5 * (x - 0.7), 2.0),
            0.7,
            "Neimark-Sacker",
            13,
        ),
        (
            lambda x: [*_pair(1 + 0.03 * (x - 0.3), 1.0), -(1 + 1.5 * (x - 0.7))],
            0.7,
            "period doubling",
            13,
        ),
        (
            lambda x: _pair(1 + 0.03 * (0.7 - x), 1.0) + _pair(1 + 1.5 * (0.3 - x), 2.0),
            0.3,
            "Neimark-Sacker",
            13,
        ),
        # a jump, which is halved until it is told from a steep passage
        (lambda x: [-1.2 if x > 0.37 else -0.8, 0.5], 0.37, "period doubling", 15),
    ],
)
def test_located_where_the_test_changes_its_sign(values, place, kind, calls, monkeypatch):
    """Given multipliers, of which several may pass the circle between two points."""
    monkeypatch.setattr(extrapolation, "passage", lambda line, k, found, *_: (found[0].value, 0.0))
    branch = _Spectrum(values, monkeypatch)
    found = [item for item in branch.crossings() if 0.0 < item.value < 1.0]
    assert [item.kind for item in found] == [kind]
    assert abs(found[0].value - place) < events.FINE
    assert branch.calls <= calls


@pytest.mark.filterwarnings("error")
def test_directions_of_singular_matrices():
    """Where elimination meets a pivot of zero: exact multipliers, 0, double ones, and random matrices of two
    unknowns, in which that happens most often.
    """
    generator = np.random.default_rng(1)
    matrices = [
        np.array([[-3.72, 3.11], [-2.05, 1.33]]),
        np.diag([-1.0, 0.5, 0.0]),
        np.eye(3),
        np.array([[2.0, 1.0], [0.0, 2.0]]),
        np.ones((4, 4)),
        *(np.round(generator.normal(size=(2, 2)), 2) for _ in range(200)),
    ]
    for matrix in matrices:
        for k, value in enumerate(np.linalg.eigvals(matrix)):
            values = np.full(k + 1, complex(value))
            found = Multipliers(
                values, lambda k, m=matrix, v=complex(value): inverse_iteration(m, v)
            ).direction(k)
            assert np.linalg.norm(found) == pytest.approx(1.0)
            missed = np.linalg.norm(matrix @ found - value * found)
            assert missed < 1e-7 * max(np.abs(matrix).max(), 1.0)


def test_eigenvalues_of_what_is_forgotten():
    """Rows and columns of zeros leave the others as NumPy finds them."""
    matrix = np.random.default_rng(3).normal(size=(9, 9))
    matrix[:, [2, 5]] = 0.0
    matrix[[5, 7]] = 0.0
    found, expected = eigenvalues(matrix), np.linalg.eigvals(matrix)
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(expected), abs=1e-12)
    assert (found == 0.0).sum() == 3
