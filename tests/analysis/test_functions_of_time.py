"""Functions of time as loads: found out by sampling, beside closed forms, in histories and steady states."""

import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam
from meshing.warnings import BranchWarning, IncompleteBranch
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.reduction.matrices import reduce_matrices
from sbfem_petsc.signals.sampling import sampled

TURN = 2.0 * np.pi


@pytest.fixture(scope="module")
def beam():
    material = sb.Material(70e9, 0.33, 2700)
    return sb.Model(Beam(0.4, 0.01).mesh(), material, clamped="left", damping=0.005)


def pulses(frequency, duty, late=0.0):
    return lambda t: ((t * frequency - late) % 1.0 < duty).astype(float)


@pytest.mark.parametrize(
    "function, breaks",
    [
        (lambda t: np.where(t < 0.123, 0.0, 1.0), [0.123]),
        (lambda t: (np.abs(t - 0.5) < 1e-5) * 1.0, [0.49999, 0.50001]),  # both in one interval
        (lambda t: np.sin(300.0 * t) + 0.01 * (t > 1.0 / 3.0), [1.0 / 3.0]),
        (lambda t: np.abs(np.sin(TURN * 50.0 * t)), []),
        (pulses(20.0, 0.003), np.add.outer(np.arange(21), [0.0, 0.003]).ravel()[1:-1] / 20.0),
        (lambda t: np.zeros_like(t), []),
    ],
)
def test_jumps_are_found(function, breaks):
    """To the last digits, those of corners are none."""
    found = sampled(sb.Custom(function), 0.0, 1.0)
    np.testing.assert_allclose(found.breaks, breaks, rtol=1e-13)


@pytest.mark.parametrize("frequency, least", [(0.2, 320), (12.7, 320), (1000.0, 226)])
def test_steps_of_a_tone(frequency, least):
    """From 226 steps a period on chords are as near as is asked for in the mean, and twice as many are not
    too many; never below 2048 in all.
    """
    found = sampled(sb.Custom(lambda t: 3.0 + 1e-3 * np.sin(TURN * frequency * t)), 0.0, 1.0)
    assert found.intervals == 2048 or least * frequency <= found.intervals < 4 * 320 * frequency


@pytest.mark.long
def test_tone(beam):
    """As the same harmonic load, which is exact to (2 pi / 320)^2 / 12 of its forced part."""
    frequency = 251.4
    loads = (sb.Custom(lambda t: np.sin(TURN * frequency * t)), sb.Harmonic(1.0, frequency))
    one, other = (sb.transient(beam, sb.PointForce("A", fy=load), 10.0, modes=5) for load in loads)
    assert one.step * frequency < 1.0 / 226.0
    found = np.interp(other.time, one.time, one.displacement("A")[:, 1])
    exact = other.displacement("A")[:, 1]
    assert np.abs(found - exact).max() < 1e-4 * np.abs(exact).max()


def test_pulses_in_a_history(beam):
    """The same as steps at their ends, but for rounding."""
    function = sb.Custom(pulses(31.0, 0.003, late=0.2))
    ends = np.add.outer(np.arange(7) + 0.2, [0.0, 0.003]).ravel() / 31.0
    steps = sum(sb.Step((-1.0) ** k, time=t) for k, t in enumerate(ends[ends < 0.2]))
    one, other = (
        sb.transient(beam, sb.PointForce("A", fy=load), 0.2, 1e-3, modes=10) for load in (function, steps)
    )
    size = np.abs(other.velocity("A")).max()
    np.testing.assert_allclose(one.velocity("A"), other.velocity("A"), rtol=0.0, atol=1e-9 * size)


@pytest.mark.parametrize("steps, aliased", [(None, 1e-6), (600, 2e-4)])
@pytest.mark.parametrize("frequency", [20.0, pytest.param(70.0, marks=pytest.mark.long)])
@pytest.mark.parametrize(
    "duty", [pytest.param(0.5, marks=pytest.mark.long), 0.01, pytest.param(0.003, marks=pytest.mark.long)]
)
def test_pulse_trains(beam, frequency, duty, steps, aliased):
    """In closed form: the pulses' harmonics times the modes' receptances, and the pulses themselves times the
    residual flexibility, at every instant, also beside and on the pulses' ends; velocities by the modes'
    answers to the pulses' ends. Harmonics are those of the
    instants: lines beyond half the steps fold back.
    """
    force, late = 100.0, 0.3
    load = sb.PointForce("A", fy=force * sb.Custom(pulses(frequency, duty, late)))
    orbit = sb.periodic(beam, load, frequency, steps=steps, stability=False)
    r, k, n = orbit.reduced, np.arange(40000), len(orbit.time)
    point = r.points.of("A", "point")
    turns = np.where(k > 0, (1.0 - np.exp(-1j * TURN * k * duty)) / (1j * np.pi * np.maximum(k, 1)), duty)
    turns *= force * np.exp(-1j * TURN * k * late)
    omega = TURN * frequency * k[:, None]
    q = turns[:, None] * r.load_modes[:, 0] / (r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
    moved, static = q @ point.modes[1], point.loads[1, 0]
    u = np.zeros(n, dtype=complex)
    np.add.at(u, k % n, moved)
    after = (np.arange(n) / n - late + 1e-10) % 1.0
    inside = np.where(np.minimum(after % duty, duty - after % duty) < 2e-10, 0.5, 1.0) * (
        after < duty + 2e-10
    )
    u = np.fft.ifft(u, norm="forward").real + static * force * inside
    assert np.abs(orbit.displacement("A")[:, 1] - u).max() < 1e-5 * np.abs(u).max()
    v = np.zeros((n, len(r.omega)))
    poles = r.omega * (-r.damping + 1j * np.sqrt(1.0 - r.damping**2))
    for since, jump in ((after, force), ((after - duty) % 1.0, -force)):
        gone = np.where(np.abs(since - 1.0) < 2e-10, 0.0, since)[:, None] / frequency
        v += jump * (np.exp(poles * gone) / (1.0 - np.exp(poles / frequency))).imag / poles.imag
    v = (v * r.load_modes[:, 0]) @ point.modes[1]
    assert np.abs(orbit.velocity("A")[:, 1] - v).max() < 1e-3 * np.abs(v).max()
    lines = (moved + static * turns)[:21]
    np.testing.assert_allclose(orbit.harmonics("A")[:21], lines, rtol=0.0, atol=aliased * abs(lines).max())


def stop():
    """Two masses and a stop."""
    return reduce_matrices(
        np.eye(2),
        np.array([[2.0, -1.0], [-1.0, 1.0]]),
        np.array([[0.0, 1.0]]),
        np.array([0.1]),
        loads=np.array([[1.0], [0.0]]),
        sensors={"1": 0, "2": 1},
        damping=0.05,
        compliance=np.array([0.5]),
    )


@pytest.mark.parametrize("duty", [0.3, 0.01])
def test_pulse_trains_with_contact(duty):
    """As a history settles, whose steps end at the pulses' ends."""
    frequency, force = 0.13, 2.0 / duty**0.5
    load = force * sb.Custom(pulses(frequency, duty))
    orbit = sb.periodic(stop(), load, frequency, steps=2000, stability=False)
    assert orbit.contact_resultant.max() > 0.1
    history = sb.transient(stop(), load, 60.0 / frequency, 1.0 / (frequency * 2000))
    found, exact = orbit.displacement("2")[:, 1], history.displacement("2")[-2001:-1, 1]
    assert np.abs(found - exact).max() < 1e-3 * np.abs(exact).max()


def test_pulse_trains_in_a_file(tmp_path):
    """A curve that is read back has the loads that it was computed for, jumps and all of their lines."""
    load = sb.Custom(lambda t: pulses(0.13, 0.3)(t) + np.abs(np.sin(TURN * 0.13 * t)))
    file = str(tmp_path / "curve.h5")
    with pytest.warns(BranchWarning):
        curve = sb.load_response(stop(), load, 0.13, 0.5, points=3, stability=False, file=file)
    with pytest.warns(IncompleteBranch):
        found = sb.read(file)
    assert found.period.excitation.jumps is not None and found.period.excitation.further is not None
    one, other = found.orbit(1), curve.orbit(1)
    np.testing.assert_allclose(one.states.amplitudes, other.states.amplitudes, rtol=0.0, atol=1e-13)
    np.testing.assert_allclose(one.displacement("2"), other.displacement("2"), rtol=1e-12, atol=1e-13)


def test_two_jumps_given(beam):
    """Jumps that are told with a band need not be found, and their lines do not end with it."""
    told = sb.Custom(pulses(0.7, 0.25), highest_frequency=0.7, breaks=[0.0, 0.25 / 0.7, 1.0 / 0.7])
    drive = Excitation.of([told], 0.7, None, 8)
    found = dict(zip(drive.orders.tolist(), drive.amplitudes[:, 0]))
    for k in (1, 2, 3, 7, 601):
        exact = (1.0 - np.exp(-0.5j * np.pi * k)) / (1j * np.pi * k)
        assert found[k] == pytest.approx(exact, abs=1e-12)


@pytest.mark.parametrize("band", [pytest.param(0.0, marks=pytest.mark.long), 0.013, 0.13])
@pytest.mark.parametrize("function", [pulses(0.13, 0.05), lambda t: 2.0 + np.sin(TURN * 26.0 * t)])
def test_a_band_that_does_not_hold(function, band):
    """The function counts: the answer is the one without a band, which was up to 7 % off."""
    told, none = sb.Custom(function, highest_frequency=band), sb.Custom(function)
    one, other = (sb.periodic(stop(), load, 0.13, stability=False) for load in (told, none))
    np.testing.assert_allclose(one.displacement("2"), other.displacement("2"), rtol=0.0, atol=1e-12)
    one, other = (sb.transient(stop(), load, 3.0 / 0.13) for load in (told, none))
    np.testing.assert_allclose(one.displacement("2"), other.displacement("2"), rtol=0.0, atol=1e-12)


def test_a_band_that_holds():
    """It says the steps of a history."""
    load = sb.Custom(lambda t: np.abs(np.sin(TURN * 0.4 * t)), 0.5)
    assert sb.transient(stop(), load, 20.0).step == pytest.approx(1.0 / (320.0 * 0.5), rel=1e-3)


def test_a_band_that_cannot_be_checked():
    """A tone above what the samples tell is taken where its band holds, and refused where it does not."""
    fits, low = (sb.Custom(lambda t: np.sin(TURN * 1e5 * t), band) for band in (1e5, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drive = Excitation.of([fits], 1.0, None, 8)
    expected = np.where(drive.orders == 100000, 1.0, 0.0)
    np.testing.assert_allclose(np.abs(drive.amplitudes[:, 0]), expected, rtol=0.0, atol=1e-9)
    assert expected.any()
    says = (
        "changes between 1,048,576 samples of 1 s; 320 in a period of its highest_frequency do not follow it"
    )
    with pytest.raises(ValueError, match=f"steady state: .*{says}"):
        Excitation.of([low], 1.0, None, 8)
    with pytest.raises(ValueError, match=f"transient: .*{says}"):
        sb.transient(stop(), low, 1.0)


@pytest.mark.parametrize("reduction", ["modes", None])
def test_too_fast(beam, reduction):
    """Refused where a million samples do not tell what it does."""
    load = sb.PointForce("A", fy=sb.Custom(lambda t: np.sin(TURN * 1e6 * t)))
    sentence = r"changes between 1,048,576 samples of 1 s; give its highest_frequency, and breaks"
    with pytest.raises(ValueError, match=sentence):
        sb.transient(beam, load, 1.0, 1e-3, reduction=reduction)
    with pytest.raises(ValueError, match=f"periodic: .*{sentence}"):
        sb.periodic(beam, load, 1.0, reduction=reduction)
