"""Periodic loads, their common period, and linear steady states against closed forms."""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam
from sbfem_petsc.motion.excitation import Excitation
from sbfem_petsc.reduction.matrices import reduce_matrices

MASS = np.array([[2.0, 0.3], [0.3, 1.0]])
STIFFNESS = np.array([[30.0, -12.0], [-12.0, 20.0]])
RAYLEIGH = 0.1 * MASS + 0.003 * STIFFNESS


def pair_of_masses(damping=RAYLEIGH, gap=50.0):
    """Two coupled masses, a load on each, and an elastic stop out of reach."""
    return reduce_matrices(
        MASS,
        STIFFNESS,
        np.array([[1.0, 0.0]]),
        np.array([gap]),
        loads=np.eye(2),
        sensors={"a": 0, "b": 1},
        damping=damping,
        compliance=np.array([0.01]),
    )


def receptance(frequency, damping=RAYLEIGH):
    omega = 2 * np.pi * frequency
    return np.linalg.inv(STIFFNESS - omega**2 * MASS + 1j * omega * damping)


@pytest.mark.parametrize("contact", [True, False])
@pytest.mark.parametrize("frequency", [0.05, 0.5, 0.55, 3.0])
def test_two_oscillators_with_tones_and_preload(contact, frequency):
    """Below, at and above the resonances: every line of the spectrum against (K - w^2 M + i w C)^-1 f, to
    1e-12 of the largest (1e-10 is asked for).
    """
    tones = sb.Harmonic(1.0, frequency, 0.3) + sb.Harmonic(0.5, 1.5 * frequency) + 2.0
    orbit = sb.periodic(
        pair_of_masses(), [tones, sb.Harmonic(0.7, frequency)], frequency, contact=contact, steps=64
    )
    assert (orbit.periods, orbit.iterations, orbit.converged) == (2, 0, True)
    lines = np.zeros((len(orbit.time) // 2 + 1, 2), dtype=complex)
    lines[0] = receptance(0.0) @ [2.0, 0.0]
    lines[2] = receptance(frequency) @ [np.exp(0.3j) / 1j, 0.7 / 1j]
    lines[3] = receptance(1.5 * frequency) @ [0.5 / 1j, 0.0]
    for k, point in enumerate("ab"):
        found = orbit.spectrum(point)
        found[-1] = 0.0  # the line at half the sampling rate is shared by two
        np.testing.assert_allclose(found, lines[:, k], atol=1e-12 * np.abs(lines).max())
        np.testing.assert_allclose(
            orbit.harmonics(point)[:21], lines[::2, k][:21], atol=1e-12 * np.abs(lines).max()
        )
        assert (
            orbit.subharmonics(point).shape == (2,)
            and abs(orbit.subharmonics(point)[1]) < 1e-12 * np.abs(lines).max()
        )
        # the motion between, and its velocity
        series = np.real(
            lines[:, k] * np.exp(2j * np.pi * np.outer(orbit.time, np.arange(len(lines))) * frequency / 2)
        )
        np.testing.assert_allclose(
            orbit.displacement(point)[:, 1], series.sum(axis=1), atol=1e-12 * np.abs(lines).max()
        )


def test_one_oscillator_through_resonance():
    """F / (k sqrt((1 - r^2)^2 + (2 zeta r)^2)) and its phase; 1 / (2 zeta) of the static deflection at the
    resonance itself.
    """
    zeta, omega = 0.01, 3.0
    r = reduce_matrices(
        np.eye(1),
        omega**2 * np.eye(1),
        np.zeros((0, 1)),
        np.zeros(0),
        loads=np.eye(1),
        sensors={"x": 0},
        damping=zeta,
    )
    for ratio in (0.3, 0.999, 1.0, 1.01, 4.0):
        orbit = sb.periodic(r, 2.0, ratio * omega / (2 * np.pi))
        exact = -2j / (omega**2 * (1 - ratio**2 + 2j * zeta * ratio))
        assert abs(orbit.harmonics("x")[1] / exact - 1) < 1e-12 and np.abs(
            orbit.harmonics("x")[2:20]
        ).max() < 1e-14 * abs(exact)
        # the peak lies between two of 512 instants
        assert orbit.amplitude("x") == pytest.approx(abs(exact), rel=(np.pi / 512) ** 2)
        # both multipliers have modulus exp(-zeta omega T) and turn by the damped frequency
        expected = np.exp((-zeta + 1j * np.sqrt(1 - zeta**2)) * omega * orbit.period)
        np.testing.assert_allclose(
            sorted(orbit.multipliers, key=np.imag),
            sorted([expected, np.conj(expected)], key=np.imag),
            rtol=1e-12,
        )


@pytest.mark.slow
@pytest.mark.parametrize("backwards", [False, pytest.param(True, marks=pytest.mark.long)])
def test_frequency_response_without_contact(backwards):
    """Every point against the closed form, with a preload; the resonances are among the points that are
    chosen.
    """
    start, stop = (1.2, 0.2) if backwards else (0.2, 1.2)
    curve = sb.frequency_response(pair_of_masses(), [1.0, sb.Constant(3.0)], start, stop, contact=False)
    exact = np.array([receptance(f) @ [-1j, 0.0] for f in curve.frequency])
    assert (
        curve.complete
        and curve.converged.all()
        and curve.stable.all()
        and curve.value[[0, -1]] == pytest.approx([start, stop])
    )
    assert (np.diff(curve.frequency) * (stop - start) > 0).all()
    for k, point in enumerate("ab"):
        assert curve.harmonics(point).shape == (len(curve), 1 + 20)
        np.testing.assert_allclose(
            curve.harmonics(point)[:, 1], exact[:, k], atol=1e-12 * np.abs(exact).max()
        )
        np.testing.assert_allclose(
            curve.harmonics(point)[:, 0], (receptance(0.0) @ [0.0, 3.0])[k], rtol=1e-12
        )
        # half the peak-to-peak of 256 instants
        np.testing.assert_allclose(curve.amplitude(point), np.abs(exact[:, k]), rtol=(np.pi / 256) ** 2)
    finest = np.array([abs(receptance(f) @ [-1j, 0.0])[0] for f in np.linspace(0.2, 1.2, 20001)])
    assert curve.amplitude("a").max() == pytest.approx(finest.max(), rel=5e-3)
    assert curve.peak("a").frequency == pytest.approx(np.linspace(0.2, 1.2, 20001)[finest.argmax()], rel=1e-3)


def test_half_power_bandwidth_of_a_linear_peak():
    """2 zeta f for light damping, symmetric: within zeta, which the half-power rule neglects, and the points'
    distance.
    """
    zeta, f = 0.004, 10.0
    r = reduce_matrices(
        np.eye(1),
        (2 * np.pi * f) ** 2 * np.eye(1),
        np.zeros((0, 1)),
        np.zeros(0),
        loads=np.eye(1),
        sensors={"x": 0},
        damping=zeta,
    )
    peak = sb.frequency_response(r, 1.0, 9.0, 11.0, contact=False).peak("x")
    assert peak.frequency == pytest.approx(f * np.sqrt(1 - 2 * zeta**2), rel=1e-4)
    assert peak.bandwidth == pytest.approx(2 * zeta * f, rel=0.01) and abs(peak.skewness) < 0.02
    assert peak.amplitude == pytest.approx(1 / (2 * zeta * (2 * np.pi * f) ** 2), rel=1e-3)


def test_beam_without_contact_is_a_sum_of_modes():
    """A healthy beam's line at the load's frequency against the modal sum with its residual flexibility, from
    the public results of `modal` and `static`.
    """
    model = sb.Model(Beam(0.4, 0.005).mesh(order=4), sb.Material(70e9, 0.33, 2700), damping=0.01)
    load, frequency = sb.PointForce("A", fy=2.0), 433.0
    orbit = sb.periodic(model, load, frequency, modes=20)
    modes, push = sb.modal(model, 20), sb.static(model, load)
    shape = modes.displacement("A")[:, 1]
    own, omega = 2 * np.pi * modes.frequencies, 2 * np.pi * frequency
    compliance = (
        (shape**2 / (own**2 - omega**2 + 0.02j * own * omega)).sum()
        - (shape**2 / own**2).sum()
        + push.displacement("A")[1] / 2.0
    )
    assert abs(orbit.harmonics("A")[1] / (-2j * compliance) - 1) < 1e-9
    assert abs(orbit.harmonics("A")[2:20]).max() < 1e-13 * abs(orbit.harmonics("A")[1])


@pytest.mark.parametrize(
    "signals, frequency, periods, orders",
    [
        ([sb.Harmonic(1.0, 3000.0)], 3000.0, 1, [1]),
        ([sb.Harmonic(1.0, 430.0), sb.Harmonic(1.0, 3000.0)], 430.0, 43, [43, 300]),
        ([sb.Harmonic(1.0, 10.0) + sb.Harmonic(0.1, 25.0) + 0.5], 10.0, 2, [0, 2, 5]),
        ([sb.Harmonic(1.0, 0.1), sb.Constant(2.0)], 0.1, 1, [0, 1]),
    ],
)
def test_common_period(signals, frequency, periods, orders):
    drive = Excitation.of(signals, frequency, None, 64)
    assert drive.periods == periods and drive.orders.tolist() == orders
    # the loads that come back are those that went in
    count = 64 * periods * 4
    values = (drive.phases(count) @ drive.amplitudes).real
    time = np.arange(count + 1) * periods / frequency / count
    np.testing.assert_allclose(values, np.stack([s(time) for s in signals], axis=1), atol=1e-9)


def test_a_tone_of_many_cycles_repeats():
    """640,001 cycles in the common period: rounding of the time in far periods is not held against it."""
    drive = Excitation.of([sb.Harmonic(1.0, 10.0), sb.Harmonic(1.0, 100000.15625)], 10.0, None, 64)
    assert drive.periods == 64 and drive.orders.tolist() == [64, 640001]


def test_repeated_and_scaled_drives():
    drive = Excitation.of([sb.Harmonic(1.0, 10.0) + 0.5], 10.0, None, 8)
    once, thrice = ((d.phases(60 * d.periods) @ d.amplitudes).real for d in (drive, drive.repeated(3)))
    np.testing.assert_allclose(thrice[:61], once, atol=1e-12)
    np.testing.assert_allclose(thrice[60:121], once, atol=1e-12)
    np.testing.assert_allclose(
        (drive.scaled(3.0).phases(60) @ drive.scaled(3.0).amplitudes).real, 3 * (once - 0.5) + 0.5, atol=1e-12
    )


@pytest.mark.parametrize(
    "load, frequency, options, sentence",
    [
        (
            sb.Harmonic(1.0, 433.0),
            3000.0,
            {},
            r"433 Hz has no common period with 3000 Hz within 64 periods; choose for instance .*4\d\d.* Hz "
            r"\(.* of 3000 Hz\)",
        ),
        (sb.Harmonic(1.0, 4500.0), 3000.0, {"periods": 1}, "4500 Hz makes 1.5 cycles in 1 period of 3000 Hz"),
        (sb.Harmonic(1.0, 1000 * np.pi), 3000.0, {"longest": 4}, "within 4 periods"),
        (sb.ToneBurst(1.0, 3000.0, 5), 3000.0, {}, "ToneBurst.* is not periodic"),
        (sb.Step(1.0, rise=0.1), 3000.0, {}, "Step.* is not periodic"),
    ],
)
def test_no_common_period(load, frequency, options, sentence):
    with pytest.raises(ValueError, match=sentence):
        sb.periodic(pair_of_masses(), [load, 0.0], frequency, **options)


@pytest.mark.parametrize(
    "tone, options",
    [(433.0, {}), (433.0, {"longest": 5}), (1010.0, {"periods": 4}), (5000.1, {"longest": 3})],
)
def test_the_neighbours_of_the_message_work(tone, options):
    """The frequencies that the message proposes lie on either side, and are accepted as they are printed."""
    with pytest.raises(ValueError) as caught:
        sb.periodic(pair_of_masses(), [sb.Harmonic(1.0, tone), 0.0], 3000.0, **options)
    proposed = [
        float(part.split(" Hz (")[0].split()[-1])
        for part in str(caught.value).split("for instance ")[1].split(" or ")
        if " Hz (" in part
    ]
    assert proposed and max(proposed) > tone and (len(proposed) == 1 or min(proposed) < tone)
    for near in proposed:
        assert sb.periodic(
            pair_of_masses(), [sb.Harmonic(1.0, near), 0.0], 3000.0, steps=48, **options
        ).converged


@pytest.mark.parametrize(
    "wave, amplitudes",
    [
        (
            lambda t: np.arcsin(np.sin(2 * np.pi * 0.7 * t)),
            {1: 4 / np.pi, 3: 4 / (9 * np.pi), 5: 4 / (25 * np.pi)},
        ),
        (
            lambda t: np.abs(np.sin(2 * np.pi * 0.7 * t)),
            {0: 2 / np.pi, 2: 4 / (3 * np.pi), 4: 4 / (15 * np.pi)},
        ),
    ],
)
def test_periodic_functions(wave, amplitudes):
    """A triangular wave and a rectified sine against their Fourier series; corners fold lines above 512 back,
    (k / 1024)^2 of each.
    """
    drive = Excitation.of([sb.Custom(wave)], 0.7, None, 8)
    found = dict(zip(drive.orders.tolist(), np.abs(drive.amplitudes[:, 0])))
    for order in range(6):
        assert found.get(order, 0.0) == pytest.approx(amplitudes.get(order, 0.0), rel=1e-4, abs=1e-9)


def test_square_wave():
    """Rounding decides on which side of a jump its instant is; the wave is periodic all the same."""
    drive = Excitation.of([sb.Custom(lambda t: np.sign(np.sin(2 * np.pi * 0.7 * t)))], 0.7, None, 8)
    found = dict(zip(drive.orders.tolist(), np.abs(drive.amplitudes[:, 0])))
    for order in (1, 3, 5):  # a sample of 1024 on each jump
        assert found[order] == pytest.approx(4 / (order * np.pi), abs=4 / 1024)


def test_undamped_at_resonance():
    """Explained, also for the constant load on a rigid-body motion; a hair beside the resonance there is an
    answer.
    """
    r = pair_of_masses(damping=0.0)
    frequency = r.frequencies[0]
    with pytest.raises(
        ValueError,
        match="mode 1 at .* Hz has no damping and is driven at its own frequency.* damping ratio or move the "
        "frequency",
    ):
        sb.periodic(r, [1.0, 0.0], frequency)
    exact = receptance(1.001 * frequency, 0.0 * MASS) @ [-1j, 0.0]
    assert sb.periodic(r, [1.0, 0.0], 1.001 * frequency, contact=False).harmonics("a")[1] == pytest.approx(
        exact[0], rel=1e-9
    )
    free = reduce_matrices(
        np.eye(2),
        np.array([[1.0, -1.0], [-1.0, 1.0]]),
        np.zeros((0, 2)),
        np.zeros(0),
        loads=np.eye(2),
        sensors={"a": 0},
    )
    with pytest.raises(ValueError, match="rigid-body motion of mode 1"):
        sb.periodic(free, [sb.Constant(1.0), 1.0], 0.5)


def test_undamped_at_resonance_beside_a_preload():
    """A load of 1e-14 of the preload is told as it is alone."""
    r = pair_of_masses(damping=0.0, gap=1e30)
    with pytest.raises(ValueError, match="mode 1 at .* Hz has no damping and is driven at its own frequency"):
        sb.periodic(r, [sb.Constant(1e14), 1.0], r.frequencies[0])


def test_a_tone_beside_its_own_preload():
    """On one load, 1e13 apart: what float64 leaves of the tone's displacement is below 1e-3."""
    load = sb.Constant(1e13) + sb.Harmonic(1.0, 0.5)
    orbit = sb.periodic(pair_of_masses(gap=1e30), [load, 0.0], 0.5)
    exact = receptance(0.5) @ [-1j, 0.0]
    assert abs(orbit.harmonics("a")[1] - exact[0]) < 1e-3 * abs(exact[0])


def test_tones_that_cancel_are_none():
    """What rounding leaves of their sum is no line."""
    parts = (
        sb.Harmonic(0.1, 0.7) + sb.Harmonic(0.2, 0.7) + sb.Harmonic(0.3, 0.7, np.pi) + sb.Harmonic(1.0, 1.4)
    )
    assert Excitation.of([parts], 0.7, None, 8).orders.tolist() == [2]


def test_constants_that_cancel_push_no_free_body():
    """What rounding leaves of their sum, 6e-17 of a tone, is no constant load."""
    none, spring = np.zeros((0, 2)), np.array([[1.0, -1.0], [-1.0, 1.0]])
    free = reduce_matrices(np.eye(2), spring, none, np.zeros(0), loads=np.eye(2), sensors={"a": 0})
    tone = sb.Harmonic(1.0, 0.5)
    load = tone + sb.Constant(0.1) + sb.Constant(0.2) + sb.Constant(-0.3)
    exact = np.linalg.solve(spring - np.pi**2 * np.eye(2), [-1j, 0.0])
    assert sb.periodic(free, [load, 0.0], 0.5).harmonics("a")[1] == pytest.approx(exact[0], rel=1e-9)
    assert load == tone and sb.Constant(0.5) - sb.Constant(0.5) == sb.Constant(0.0)
