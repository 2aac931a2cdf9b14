"""Steps are halved where contact does work: energies of histories whose contact must do none.

In the exact motion frictionless faces do no work: the oracle is the energy itself.
"""

import functools
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, CrackLine
from sbfem_petsc.continuation.multipliers import multipliers_of
from sbfem_petsc.continuation.shooting import shoot
from sbfem_petsc.motion.integration import Steps
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from sbfem_petsc.motion.reduced_history import ReducedIntegrator
from tests.systems import chain


@functools.cache
def cantilever(damping: float = 0.0) -> sb.Model:
    """200 x 50 mm with a closed inclined crack at its upper edge, plane strain, on the default mesh."""
    beam = Beam(0.2, 0.05, cracks=[CrackLine([(0.05, 0.05), (0.06, 0.02)])])
    return sb.Model(beam.mesh(), sb.Material(70e9, 0.33, 2700, plane="strain"), damping=damping)


@pytest.mark.slow
@pytest.mark.parametrize(
    "damping, shortest", [pytest.param(5e-4, True, marks=pytest.mark.long), (5e-3, False)]
)
def test_contact_of_lightly_damped_bodies_does_no_work(damping, shortest):
    """A burst beside the first frequency and what follows: at equal steps contact fed in 1.6 % of what was
    supplied, or the history was refused; at the default step and at 0.8 of the highest mode's period.
    """
    model = cantilever(damping)
    first = sb.modal(model, count=1).frequencies[0]
    load = sb.PointForce("A", fy=sb.ToneBurst(300.0, frequency=1.03 * first, cycles=10))
    step = 0.8 / model.modes(80).frequencies[-1] if shortest else None
    energy = sb.transient(model, load, 30.0 / first, step).energy
    assert np.abs(energy.contact).max() < 1e-4 * energy.external.max()
    assert np.abs(energy.balance).max() < 5e-4 * energy.external.max()  # of damping's trapezoidal rule


@pytest.mark.long
def test_contact_of_unreduced_bodies_gives_no_energy():
    """Each step takes energy or none, and half as long ones hardly less in all; what is taken is no error of
    the account, for the balance holds.
    """
    beam = Beam(0.2, 0.05, cracks=[CrackLine([(0.05, 0.05), (0.06, 0.02)])])
    model = sb.Model(beam.mesh(order=3), sb.Material(70e9, 0.33, 2700, plane="strain"), damping=5e-4)
    first = sb.modal(model, count=1).frequencies[0]
    load = sb.PointForce("A", fy=sb.ToneBurst(300.0, frequency=1.03 * first, cycles=3))
    for steps in (400, 800):
        step = 1.0 / (first * steps)
        energy = sb.transient(model, load, 5.0 / first, step, reduction=None, modes=10).energy
        supplied = energy.external.max()
        assert np.diff(energy.contact).max() < 1e-14 * supplied
        assert 1e-4 * supplied < -energy.contact[-1] < 1e-2 * supplied
        assert np.abs(energy.balance).max() < 1e-9 * supplied


@pytest.mark.long
def test_energy_of_free_vibration_is_kept():
    """20,000 default steps without damping, about 63 periods of the first mode: equal steps ended with 1.6e6
    J of the 0.3 J that were there.
    """
    reduced = sb.reduce(cantilever(), sb.PointForce("A", fy=1.0))
    start = np.zeros((2, len(reduced.omega)))
    start[0, 0] = 0.8 / reduced.omega[0]
    if (reduced.gap.modes @ start[0]).sum() < 0.0:  # at first the faces are apart
        start[0] *= -1.0
    step = 0.8 / reduced.frequencies[-1]
    history = sb.transient(reduced, sb.PointForce("A", fy=0.0), 20_000 * step, initial=tuple(start))
    energy = history.energy
    assert len(history.time) == 20_001 and history.states.contact.any()
    assert np.abs(energy.total / energy.total[0] - 1.0).max() < 1e-3
    # what the parts of steps did is what the energies of the equal steps' ends have changed by
    assert np.abs(energy.balance).max() < 1e-10 * energy.total[0]


@pytest.mark.long
def test_a_history_that_does_not_come_to_the_periodic_motion():
    """The cantilever driven at its first frequency, 2048 steps a period: the periodic motion is unstable by a
    pair of multipliers off the real axis, and what a history settles on is a motion with a tone of its own
    around it, at the pair's angle.
    """
    model, load = cantilever(5e-4), sb.PointForce("A", fy=300.0)
    first = sb.modal(model, count=1).frequencies[0]
    period = prepare("periodic", model, load, first, settings=PeriodSettings(steps=2048))
    state = None
    for damping in (16.0, 8.0, 4.0, 2.0, 1.4, 1.0):
        driven = period.at(first, damping=damping)
        fixed = shoot(driven, driven.linear_state if state is None else state)
        state = fixed.state
    pair, r = multipliers_of(fixed).values[0], period.reduced
    assert abs(pair) == pytest.approx(1.006, abs=2e-3) and abs(pair.imag) > 0.9
    m, beside = len(r.omega), 1.02 * state
    history = sb.transient(
        r,
        [sb.Harmonic(300.0, first)],
        600.0 / first,
        1.0 / (2048 * first),
        initial=(beside[:m] / r.omega, beside[m:]),
        decimation=2048,
    )
    away = np.hstack([history.states.q * r.omega, history.states.v])[-256:] - state
    distances = np.linalg.norm(away, axis=1) / np.linalg.norm(state)
    assert 0.015 < distances.min() < distances.max() < 0.04
    lines = (np.abs(np.fft.fft(away * np.hanning(256)[:, None], axis=0)) ** 2).sum(axis=1)[2:128]
    assert (2 + np.argmax(lines)) / 256 == pytest.approx(np.angle(pair) / (2.0 * np.pi), abs=0.01)


VELOCITY = np.array([0.3, -0.2, 0.25, -0.1, 0.2])


def thrown(duration, step, scheme="exact"):
    """Five masses thrown at the stops on both sides, without damping."""
    start, loads = (np.zeros(5), VELOCITY), [sb.Constant(0.0)] * 2
    return sb.transient(chain(damping=0.0), loads, duration, step, scheme=scheme, initial=start)


@pytest.mark.parametrize("scheme", ["exact", "newmark"])
@pytest.mark.parametrize("share", [0.8, 0.4, 0.2])
def test_stiff_stops(scheme, share):
    """Equal steps of these shares of the shortest period were refused."""
    history = thrown(60.0, share / chain().frequencies[-1], scheme)
    assert (history.contact_force > 0.0).any(axis=0).all()
    assert np.abs(history.energy.total / history.energy.total[0] - 1.0).max() < 1e-4


def test_a_history_that_goes_on_halves_the_same_steps():
    """From a checkpoint in the midst of contact, to the last bit, as one that is not interrupted; with the
    work of contact and with what could not be halved further.
    """
    reduced, steps = chain(damping=0.0), Steps(400, 0.2, True, "exact", 1)
    loads = [sb.Harmonic(0.05, 0.1), sb.Constant(0.0)]
    one, other = (ReducedIntegrator(reduced, loads, steps, (np.zeros(5), VELOCITY)) for _ in range(2))
    one.first(), other.first()
    one.advance(0, 171, 1)
    other.restore(one.checkpoint())
    whole, again = one.advance(171, 229, 1), other.advance(171, 229, 1)
    assert np.ptp(whole["energies"][:, 4]) > 0.0
    for name, values in whole.items():
        assert np.array_equal(values, again[name]), name
    assert all(map(np.array_equal, one.checkpoint(), other.checkpoint()))


def test_loads_are_linear_in_halved_steps():
    """A ramp that presses on the stops: were it not split where steps are, the balance of energies, whose
    work of the loads is of fourth order in the equal steps, would miss what the parts of steps get.
    """
    ramp = [sb.Samples(np.array([0.0, 8.0, 16.0]), np.array([0.0, -0.5, 0.0])), sb.Constant(0.0)]
    missed = []
    for step in (0.5, 0.25, 0.1):
        energy = sb.transient(chain(damping=0.0), ramp, 16.0, step).energy
        assert energy.contact.any()
        missed.append(np.abs(energy.balance).max() / energy.total.max())
    assert missed[0] < 1e-4 and missed[1] < missed[0] / 10.0 and missed[2] < missed[1] / 25.0


def test_what_cannot_be_halved_further_is_told():
    """Steps of many periods of the highest mode: with what contact has done in all."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        energy = thrown(20.0 * 30.0, 30.0).energy
    told = [str(w.message) for w in caught if "halved 10 times" in str(w.message)]
    assert len(told) == 1 and "use a step smaller than 30 s" in told[0]
    assert f"{energy.contact[-1]:.3g} J in all beside {energy.total[0]:.3g} J" in told[0]
