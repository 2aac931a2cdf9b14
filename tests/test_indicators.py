"""Indicators: the bilinear oscillator's exact harmonics, amplitude modulation, spectra, duty, shifts, and bad
input.
"""

import numpy as np
import pytest

from sbfem_petsc.indicators import (
    beta,
    coherent_record,
    contact_duty,
    detection_probability,
    frequency_shift,
    gamma,
    harmonic_ratios,
    harmonics,
    sidebands,
    spectrum,
    subharmonics,
    tones,
)


def grid(count, step, start=0.0):
    return start + step * np.arange(count)


def bilinear(t, w_open, w_closed):
    """Free vibration of the bilinear oscillator with velocity 1 at u = 0: half sines of either frequency."""
    opened = np.pi / w_open
    s = np.mod(t, opened + np.pi / w_closed)
    return np.where(s < opened, np.sin(w_open * s) / w_open, -np.sin(w_closed * (s - opened)) / w_closed)


def bilinear_harmonics(w_open, w_closed, count):
    """c_k of it in closed form; the integral of sin(w s) exp(-i O s) over half a period is w (1 + exp(-i O pi
    / w)) / (w^2 - O^2).
    """
    w = 2.0 * w_open * w_closed / (w_open + w_closed)
    turn = w * np.arange(count + 1)

    def half(v):
        return v * (1.0 + np.exp(-1j * turn * np.pi / v)) / (v**2 - turn**2)

    integral = half(w_open) / w_open - np.exp(-1j * turn * np.pi / w_open) * half(w_closed) / w_closed
    return w / np.pi * integral * np.where(np.arange(count + 1) == 0, 0.5, 1.0)


# printed digits of the closed form
BILINEAR = {0.9: (0.06704, 0.01488, 5.18e-4), 0.5: (0.43210, 1.0 / 11.0, 0.01920)}


@pytest.mark.parametrize("ratio", BILINEAR)
# samples per period, samples, error relative to A_1: a coherent record of 4 periods, then 30.3, 10.0 and 3.3
# periods
@pytest.mark.parametrize(
    "rate, count, error",
    [(1024.0, 4096, 1e-11), (300.37, 9100, 1e-10), (300.37, 3000, 1e-9), (300.37, 1000, 1e-6)],
)
def test_bilinear_oscillator(ratio, rate, count, error):
    w_open = 2.0 * np.pi * 60.0
    w_closed = w_open / ratio
    frequency = w_open * w_closed / (w_open + w_closed) / np.pi
    t = grid(count, 1.0 / (rate * frequency), start=0.0123)
    c = harmonics(t, bilinear(t, w_open, w_closed), frequency, 20)
    exact = bilinear_harmonics(w_open, w_closed, 20)
    assert np.abs(c - exact).max() < error * abs(exact[1])
    ratios = harmonic_ratios(c)
    dc, second, third = BILINEAR[ratio]
    assert ratios[0] == pytest.approx(dc, abs=5e-6) and ratios[1] == 1.0
    assert ratios[2] == pytest.approx(second, abs=5e-6)
    assert ratios[3] == pytest.approx(third, abs=5e-6 if ratio == 0.5 else 5e-7)
    assert beta(c) == pytest.approx(ratios[2] / abs(c[1]), rel=1e-14)
    assert gamma(c) == pytest.approx(ratios[3] / abs(c[1]) ** 2, rel=1e-14)


def test_harmonics_to_round_off():
    """Five harmonics with phases, on a record without whole periods in whole steps, and the convention of the
    sign.
    """
    given = np.array([0.3, 1.0 - 2.0j, 0.1j, -0.02, 1e-6 + 1e-6j, 1e-9])
    t = grid(4321, 1e-6, start=0.07)
    u = sum((c * np.exp(2j * np.pi * k * 2950.0 * t)).real for k, c in enumerate(given))
    np.testing.assert_allclose(harmonics(t, u, 2950.0, 5), given, atol=1e-12)
    np.testing.assert_allclose(harmonics(t, u, 2950.0, 8)[6:], 0.0, atol=1e-12)
    # sin = Re(-i exp): one period is enough
    np.testing.assert_allclose(
        harmonics(grid(100, 0.01), np.sin(2.0 * np.pi * grid(100, 0.01)), 1.0, 2),
        [0.0, -1.0j, 0.0],
        atol=1e-14,
    )
    np.testing.assert_allclose(
        tones(t, u, [5900.0, 0.0, 2950.0, 8850.0, 11800.0, 14750.0]), given[[2, 0, 1, 3, 4, 5]], atol=1e-12
    )


def test_ratios_along_a_curve():
    c = np.array([[0.5, 2.0, 0.4, 0.08], [0.0, 4.0j, 0.0, 0.64]])
    np.testing.assert_allclose(harmonic_ratios(c), [[0.25, 1.0, 0.2, 0.04], [0.0, 1.0, 0.0, 0.16]])
    np.testing.assert_allclose(beta(c), [0.1, 0.0])
    np.testing.assert_allclose(gamma(c), [0.01, 0.01])


def test_coherent_record():
    t = grid(33000, 1e-6)
    times, values = coherent_record(t, np.stack([t, 2.0 * t], axis=1), 3000.0)
    assert values.shape == (33000, 2) and len(times) == 33000
    t = grid(33333, 1e-6)
    times, values = coherent_record(t, t, [3000.0, 5000.0])
    assert len(times) == 33000 and times[-1] == t[-1] and values[0] == t[333]
    # 433 and 3000 Hz have the common period of 1 s
    times, _ = coherent_record(grid(250000, 1e-5), grid(250000, 1e-5), [433.0, 3000.0])
    assert len(times) == 200000
    with pytest.raises(ValueError) as error:
        coherent_record(grid(33000, 1e-6), grid(33000, 1e-6), [433.0, 3000.0])
    assert (
        "the nearest, 32333 samples, would for 432.994155 Hz and 3000.03093 Hz, and 1000000 samples (1 s) "
        "for the given ones" in str(error.value)
    )
    # the proposals hold what they promise
    nearby = np.round(32333e-6 * np.array([433.0, 3000.0])) / 32333e-6
    assert len(coherent_record(grid(33000, 1e-6), grid(33000, 1e-6), nearby)[0]) == 32333
    assert len(coherent_record(grid(1000000, 1e-6), grid(1000000, 1e-6), [433.0, 3000.0])[0]) == 1000000
    with pytest.raises(ValueError, match=r"0.001 s is shorter than one period of 433 Hz, 0.0023"):
        coherent_record(grid(1000, 1e-6), grid(1000, 1e-6), [3000.0, 433.0])


@pytest.mark.parametrize("window", [None, "hann", "flattop", ("kaiser", 9.0)])
def test_spectrum_of_a_coherent_record(window):
    t = grid(2000, 1e-4, start=0.3)
    u = 0.7 + 3.0 * np.sin(2.0 * np.pi * 250.0 * t + 0.4) + 0.01 * np.cos(2.0 * np.pi * 1000.0 * t)
    result = spectrum(t, u, window)
    at = {f: result.amplitude[np.argmin(np.abs(result.frequency - f))] for f in (0.0, 250.0, 1000.0)}
    # the skirts of the Kaiser window do not end
    tolerance = 1e-3 if isinstance(window, tuple) else 1e-12
    assert at[0.0] == pytest.approx(0.7, rel=tolerance)
    assert at[250.0] == pytest.approx(3.0 * np.exp(1j * (0.4 - np.pi / 2.0)), rel=tolerance)
    assert abs(at[1000.0]) == pytest.approx(0.01, rel=tolerance)
    assert (
        result.coherent
        and result.frequency[1] == pytest.approx(5.0)
        and result.frequency[-1] == pytest.approx(5000.0)
    )
    assert "1001 lines every 5 Hz" in repr(result) and ", coherent;" in repr(result)


@pytest.mark.parametrize("offset", [-0.5, -0.3, 0.1, 0.25, 0.5])
def test_windowed_amplitude_between_the_lines(offset):
    """Within 0.1 % (measured 1e-5) with the scalloping taken out; the flat top alone has 0.01 dB, 0.112 %, of
    it.
    """
    t = grid(2000, 1e-4, start=0.3)
    frequency = 5.0 * (50 + offset)
    u = 3.0 * np.sin(2.0 * np.pi * frequency * t)
    hann, flat_top = spectrum(t, u, "hann"), spectrum(t, u, "flattop")
    assert hann.at(frequency) == pytest.approx(-3.0j, rel=2e-5)
    assert flat_top.at(frequency) == pytest.approx(-3.0j, rel=2e-5)
    assert np.abs(flat_top.amplitude).max() == pytest.approx(3.0, rel=1.13e-3)
    assert not hann.coherent and not flat_top.coherent
    if abs(offset) == 0.5:
        assert np.abs(hann.amplitude).max() == pytest.approx(
            3.0 * 0.84883, rel=1e-4
        )  # 8 / (3 pi), its scalloping


def test_coherent_flag():
    t = grid(1000, 1e-3)
    assert spectrum(t, np.ones(1000)).coherent
    assert (
        spectrum(t, np.sin(2.0 * np.pi * t)).coherent
        and not spectrum(t, np.sin(2.0 * np.pi * 1.4 * t)).coherent
    )
    u = np.sin(2.0 * np.pi * 50.0 * t) + 0.1 * np.sin(2.0 * np.pi * 70.5 * t)
    assert spectrum(t, u).coherent
    assert spectrum(t, u, frequencies=50.0).coherent and not spectrum(t, u, frequencies=[50.0, 70.5]).coherent


@pytest.mark.parametrize("count", [999, 1000])
def test_parseval_and_synthesis(count):
    t = grid(count, 1e-3, start=-0.2)
    u = np.random.default_rng(3).standard_normal(count)
    result = spectrum(t, u)
    power = np.abs(result.amplitude) ** 2
    alone = np.zeros(len(power), dtype=bool)
    alone[0], alone[-1] = True, count % 2 == 0
    assert np.sum(np.where(alone, power, 0.5 * power)) == pytest.approx(np.mean(u**2), rel=1e-12)
    some = t[::97]
    np.testing.assert_allclose(
        (np.exp(2j * np.pi * np.outer(some, result.frequency)) @ result.amplitude).real, u[::97], atol=1e-11
    )


def test_detrend():
    t = grid(1000, 1e-3)
    u = 5.0 + 2.0 * t + np.sin(2.0 * np.pi * 50.0 * t)
    assert abs(spectrum(t, u, detrend="constant").amplitude[0]) < 1e-12
    line = spectrum(t, u, "hann", detrend="linear")
    assert (
        np.abs(line.amplitude[:20]).max() < 0.02 < 0.4 < np.abs(spectrum(t, u, "hann").amplitude[:20]).max()
    )


def test_subharmonics():
    t = grid(33000, 1e-6)
    u = (
        2.0 * np.sin(2.0 * np.pi * 14100.0 * t)
        + 0.3 * np.cos(2.0 * np.pi * 7050.0 * t)
        + 0.05 * np.cos(2.0 * np.pi * 21150.0 * t)
        + 0.5
    )
    half = subharmonics(t, u, 14100.0, 2, count=2)
    np.testing.assert_allclose(half.amplitude, [0.5, 0.3, -2.0j, 0.05, 0.0], atol=1e-12)
    np.testing.assert_allclose(half.frequency, [0.0, 7050.0, 14100.0, 21150.0, 28200.0])
    assert half.ratio == pytest.approx(0.15, rel=1e-12)
    assert subharmonics(t, u, 14100.0, 3).ratio < 1e-3
    assert repr(half).startswith("Subharmonics(drive 14100 Hz / 2: 0.3 at 7050 Hz, 2 at the drive")


def modulated(t, depth, pump=0.0):
    """Carrier 1 um at 3000 Hz, modulated by 1 + depth sin + depth/4 cos(2 .), beside a pump at 433 Hz with
    harmonics 2 and 7.
    """
    w, carrier = 2.0 * np.pi * 433.0, np.sin(2.0 * np.pi * 3000.0 * t)
    envelope = 1.0 + depth * np.sin(w * t + 1.0) + 0.25 * depth * np.cos(2.0 * w * t)
    return 1e-6 * (
        envelope * carrier
        + pump * (10.0 * np.sin(w * t) + np.sin(2.0 * w * t + 0.3) + 0.1 * np.cos(7.0 * w * t))
    )


# duration, step, error relative to the carrier: coherent, then a record in which 7 x 433 = 3031 Hz can be
# told from 3000 Hz
@pytest.mark.parametrize("duration, step, error", [(1.0, 2e-5, 1e-12), (0.1, 1e-6, 1e-10)])
def test_sidebands(duration, step, error):
    t = grid(round(duration / step), step)
    for pump in (0.0, 1.0):
        result = sidebands(t, modulated(t, 0.02, pump), 3000.0, 433.0, order=2)
        assert result.inseparable == ()
        # sin a sin b = (cos(a - b) - cos(a + b)) / 2
        expected = 1e-8 * np.array([np.exp(-1j), -np.exp(1j)])
        np.testing.assert_allclose([result.lower[0], result.upper[0]], expected, atol=1e-6 * error)
        np.testing.assert_allclose(np.abs([result.lower[1], result.upper[1]]), 2.5e-9, atol=1e-6 * error)
        assert result.centre == pytest.approx(-1e-6j, abs=1e-6 * error)
        np.testing.assert_allclose(result.indices, [0.02, 0.005], atol=10.0 * error)
        assert result.modulation_index == result.indices[0]
        assert "modulation index (A_L + A_R)/A_0 = 0.02)" in repr(result)


def test_further_pairs_do_not_leak():
    """Two pairs more than asked for, as strong as the carrier, in a record that is not coherent: all in it is
    fitted, so that the pair asked for is exact to round-off.
    """
    t = grid(10_000, 1e-5)
    u = sum((1.0 + 0.1 * n) * np.cos(2.0 * np.pi * (3000.0 + 433.0 * n) * t + n) for n in range(-3, 4))
    result = sidebands(t, u, 3000.0, 433.0)
    found = [result.lower[0], result.centre, result.upper[0]]
    np.testing.assert_allclose(found, [0.9 * np.exp(-1j), 1.0, 1.1 * np.exp(1j)], atol=1e-10)


def test_inseparable_sidebands_are_named():
    """33 ms: the pump's seventh harmonic is one line from the carrier. And a carrier that is a multiple of
    the modulation.
    """
    t = grid(33000, 1e-6)
    result = sidebands(t, modulated(t, 0.02, 1.0), 3000.0, 433.0)
    assert result.inseparable == (6, 7, 8) and "lines include harmonics 6, 7, 8 of the modulation" in repr(
        result
    )
    assert result.modulation_index == pytest.approx(0.02, rel=0.2)
    u = (1.0 + 0.1 * np.sin(2.0 * np.pi * 300.0 * t)) * np.sin(2.0 * np.pi * 3000.0 * t)
    result = sidebands(t, u, 3000.0, 300.0)
    assert result.modulation_index == pytest.approx(0.1, rel=1e-10) and result.inseparable == (9, 10, 11)


def test_contact_duty():
    force = np.zeros((1000, 3))
    force[:250, 0], force[200:400, 1] = 5.0, 1e-9
    duty = contact_duty(grid(1000, 1e-6), force)
    np.testing.assert_allclose(duty.pairs, [0.25, 0.2, 0.0])
    assert (duty.any, duty.all) == (0.4, 0.0)
    assert contact_duty(grid(1000, 1e-6), force, threshold=1e-6).any == 0.25
    single = contact_duty(grid(1000, 1e-6), force[:, 0])
    assert single.pairs.shape == (1,) and single.any == single.all == 0.25
    assert repr(duty) == "ContactDuty(3 pairs: any in contact 40 %, all 0 % of the time)"


def test_frequency_shift():
    np.testing.assert_allclose(
        frequency_shift([59.54, 200.0], [60.22, 200.0]), [-0.68 / 60.22, 0.0], rtol=1e-12
    )


T = grid(1000, 1e-3)
U = np.sin(T)
JUMP = np.where(T > 0.5, T + 1e-5, T)

# statement -> (error, what its sentence must say)
CASES = {
    "spectrum(T, U[:-1])": (ValueError, "1000 times and 999 values"),
    "spectrum(T[:3], U[:3])": (ValueError, "number of samples is 3"),
    "spectrum(T, np.where(T > 0.5, np.nan, U))": (ValueError, "values[501] = nan must be finite"),
    "spectrum(T, 1j * U)": (TypeError, "must be an array of real numbers"),
    "spectrum(['a'] * 4, U[:4])": (TypeError, "time = ['a', 'a', 'a', 'a'] must be an array"),
    "spectrum(T, np.stack([U, U], axis=1))": (
        ValueError,
        "one dimension is expected (one component, such as values[:, 1])",
    ),
    "spectrum(JUMP, U)": (ValueError, "the step after time[500] is 0.00101 s and the mean step"),
    "spectrum(T[::-1], U)": (ValueError, "times must rise"),
    "spectrum(np.zeros(9), U[:9])": (ValueError, "times must rise"),
    "spectrum(T, U, 'boxcat')": (ValueError, "window = 'boxcat' is unknown"),
    "spectrum(T, U, detrend='cubic')": (ValueError, "detrend = 'cubic' must be one of"),
    "spectrum(T, U, frequencies=[600.0])": (ValueError, "600 Hz is not below half the sampling rate, 500 Hz"),
    "spectrum(T, U).at(-1.0)": (ValueError, "Spectrum: frequency -1 Hz must be positive"),
    "coherent_record(T, U, [])": (ValueError, "frequencies = [] must be"),
    "coherent_record(T, U, 'fast')": (TypeError, "frequencies = 'fast' must be"),
    "coherent_record(T, U, [5.0, 0.0])": (ValueError, "frequency 0 Hz must be positive"),
    "coherent_record(T, U, 500.0)": (ValueError, "500 Hz is not below half the sampling rate"),
    "harmonics(T, U, 100.0, 5)": (
        ValueError,
        "harmonics: frequency 500 Hz is not below half the sampling rate",
    ),
    "harmonics(T, U, 0.5, 3)": (
        ValueError,
        "the record of 1 s is too short to tell apart lines 0.5 Hz apart; at least 2 s",
    ),
    "harmonics(T, U, -5.0)": (ValueError, "harmonics: frequency = -5.0"),
    "harmonics(T, U, '5')": (TypeError, "harmonics: frequency = '5'"),
    "harmonics(T, U, 5.0, 0)": (ValueError, "harmonics: count = 0 must be between 1 and 1000"),
    "harmonics(T, U, 5.0, 2.5)": (TypeError, "harmonics: count = 2.5 must be an integer"),
    "tones(T, U, [5.0, 5.0])": (ValueError, "a frequency is given twice"),
    "tones(T, U, [5.0, 5.1])": (ValueError, "lines 0.1 Hz apart; at least 10 s"),
    "harmonic_ratios([1.0])": (ValueError, "c_0 to c_1 are needed"),
    "harmonic_ratios([0.0, 0.0, 1.0])": (ValueError, "A_1 = |c_1| not zero"),
    "beta([0.0, 1.0])": (ValueError, "beta: harmonics of shape (2,) were given; c_0 to c_2"),
    "gamma([0.0, 1.0, 2.0])": (ValueError, "gamma: harmonics of shape (3,) were given; c_0 to c_3"),
    "gamma([0.0, 1.0, 2.0, np.nan])": (ValueError, "must be finite"),
    "subharmonics(T, U, 50.0, 1)": (ValueError, "divisor = 1 must be between 2 and 1000"),
    "subharmonics(T, U, 50.0, 100)": (ValueError, "lines 0.5 Hz apart"),
    "sidebands(T, U, 50.0, 60.0)": (ValueError, "carrier = 50 Hz must be above order * modulation = 60 Hz"),
    "sidebands(T, U, 50.0, 20.0, order=3)": (
        ValueError,
        "carrier = 50 Hz must be above order * modulation = 60 Hz",
    ),
    "sidebands(T, U, 50.0, 1.5)": (ValueError, "too short for sidebands 1.5 Hz apart; at least 1.33333 s"),
    "sidebands(T, U, 450.0, 60.0)": (ValueError, "510 Hz is not below half the sampling rate"),
    "sidebands(T, U, 450.0, 6.0, order=0)": (ValueError, "order = 0 must be at least 1"),
    "contact_duty(T, U[:5])": (ValueError, "1000 times and 5 values"),
    "contact_duty(T, np.zeros((1000, 0)))": (ValueError, "shape (1000, 0); (times,) or (times, pairs)"),
    "contact_duty(T, np.zeros((1000, 2, 2)))": (ValueError, "shape (1000, 2, 2)"),
    "frequency_shift([1.0, 2.0], [1.0])": (ValueError, "(2,) cracked and (1,) healthy"),
    "frequency_shift([1.0, 0.0], [1.0, 1.0])": (ValueError, "cracked frequencies must be positive"),
    "frequency_shift([1.0], [np.nan])": (ValueError, "healthy[0] = nan must be finite"),
}


@pytest.mark.parametrize("statement", CASES)
def test_bad_input(statement):
    kind, sentence = CASES[statement]
    with pytest.raises(kind) as error:
        eval(statement)
    assert sentence in str(error.value) and "\n" not in str(error.value)


def test_rounded_times_are_uniform():
    """Sums of 0.25 us over 33 ms, and times far from zero, are rounded but uniform."""
    t = np.cumsum(np.full(132000, 0.25e-6))
    assert abs(harmonics(t, np.sin(2.0 * np.pi * 3000.0 * t), 3000.0, 1)[1]) == pytest.approx(1.0, rel=1e-9)
    spectrum(grid(1000, 1e-6, start=1e3), U)


class TestDetectionProbability:
    """The chance that a sum of squares exceeds what noise alone reaches with a given probability."""

    def test_one_line_is_marcums_q(self):
        """An amplitude a in complex noise has Rice's distribution, without a crack Rayleigh's."""
        from scipy.stats import rayleigh, rice

        a, noise, false_alarm = np.array([0.3, 1.0, 2.5, 6.0]), 0.7, 0.02
        threshold = rayleigh.isf(false_alarm)
        expected = rice.sf(threshold, a / noise)
        found = detection_probability((a * np.exp(0.4j))[:, None], noise, false_alarm)
        assert found == pytest.approx(expected, rel=1e-9)  # two codes of one integral

    def test_one_shift_is_the_normal_distributions(self):
        from scipy.stats import norm

        limit = norm.isf(0.005)
        expected = norm.sf(limit - 2.0) + norm.cdf(-limit - 2.0)
        assert detection_probability([2e-3], 1e-3, 0.01) == pytest.approx(expected, rel=1e-9)

    def test_counted(self):
        """By drawing noise 200,000 times: four standard errors of a share."""
        values, draws = np.array([0.5, -1.0, 0.2, 0.8]), 200_000
        noise = np.random.default_rng(3).normal(size=(draws, 4))
        limit = np.quantile(np.sum(noise**2, axis=1), 0.95)
        share = np.mean(np.sum((values + noise) ** 2, axis=1) > limit)
        assert detection_probability(values, 1.0, 0.05) == pytest.approx(
            share, abs=4.0 * np.sqrt(0.25 / draws)
        )

    def test_limits(self):
        found = detection_probability([[0.0, 0.0], [1e-12, 0.0], [1e6, 0.0], [1e300, 0.0]], 1.0, 0.03)
        assert found == pytest.approx([0.03, 0.03, 1.0, 1.0], rel=1e-9)

    @pytest.mark.parametrize(
        "arguments, sentence",
        [
            (([np.nan], 1.0), "values must be finite"),
            ((1.0, 1.0), "shape"),
            (([1.0], 0.0), "noise"),
            (([1.0], 1.0, 1.0), "false_alarm = 1 must be between 0 and 1"),
            ((np.ma.array([1.0, 9.0], mask=[False, True]), 1.0), "values has masked entries"),
        ],
    )
    def test_bad_input(self, arguments, sentence):
        with pytest.raises(ValueError, match=sentence):
            detection_probability(*arguments)


@pytest.mark.parametrize("ratio", [harmonic_ratios, beta, gamma])
def test_masked_harmonics_are_refused(ratio):
    with pytest.raises(ValueError, match="c has masked entries"):
        ratio(np.ma.array([0.0, 1.0, 9.0, 9.0], mask=[False, False, True, False]))
