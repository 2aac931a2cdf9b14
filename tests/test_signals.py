"""Signals: closed forms, eq. (39), sums, sampled data and files, and every bad input with its sentence."""

import math  # noqa: F401 (in CASES)

import numpy as np
import pytest

from sbfem_petsc.signals.samples import Samples
from sbfem_petsc.signals.signal import Constant, Custom, Sum, as_signal
from sbfem_petsc.signals.waves import Chirp, Harmonic, Step, ToneBurst

T = np.linspace(0.0, 0.04, 4001)


def test_harmonic():
    tone = Harmonic(300.0, 3000.0, phase=0.5)
    np.testing.assert_array_equal(tone(T), 300.0 * np.sin(2.0 * np.pi * 3000.0 * T + 0.5))
    assert (tone.highest_frequency, tone.end) == (3000.0, np.inf)
    assert repr(tone) == "Harmonic(amplitude=300, frequency=3000 Hz, phase=0.5 rad)"


def test_tone_burst_is_eq_39():
    """fc = 3000 Hz, n = 100: at t = (j + 1/4) / fc the carrier is 1 and the envelope 1 - cos(2 pi (j + 1/4) /
    100).
    """
    burst = ToneBurst(300.0, 3000.0, 100)
    quarter = (np.array([0, 10, 25, 50, 99]) + 0.25) / 3000.0
    # 300 (1 - cos(0.9 deg)), (36.9 deg), (90.9 deg), (180.9 deg), (357.3 deg)
    np.testing.assert_allclose(
        burst(quarter), [0.03701025549, 60.09460250, 304.7121951, 599.9629897, 0.3330375114], rtol=1e-9
    )
    assert burst.end == pytest.approx(1.0 / 30.0, rel=1e-15)
    assert burst.highest_frequency == pytest.approx(3060.0)
    fine = burst(np.linspace(0.0, burst.end, 400001))
    assert np.abs(fine).max() == pytest.approx(600.0, rel=1e-4) and np.abs(fine).max() <= 600.0
    np.testing.assert_array_equal(burst([-1e-9, -1e-4, burst.end * (1.0 + 1e-12), 0.034, 1.0]), 0.0)


def test_tone_burst_energy_and_impulse():
    """Of eq. (39): integral of f^2 is (3/4) F^2 n / fc, that of f vanishes."""
    burst = ToneBurst(2.0, 50.0, 8)
    t = np.arange(20000) * burst.end / 20000
    assert np.mean(burst(t) ** 2) == pytest.approx(0.75 * 4.0, rel=1e-12)
    assert np.mean(burst(t)) == pytest.approx(0.0, abs=1e-12)


def test_chirp():
    chirp = Chirp(2.0, 100.0, 500.0, 0.02)
    assert (chirp.highest_frequency, chirp.end) == (500.0, 0.02)
    inside = T[T <= 0.02]
    np.testing.assert_allclose(
        chirp(inside), 2.0 * np.sin(2.0 * np.pi * (100.0 * inside + 400.0 / 0.04 * inside**2)), atol=1e-12
    )
    assert not chirp(np.array([-1e-6, 0.020001, 1.0])).any()
    # 100 Hz * 0.02 s + 400 Hz * 0.02 s / 2 = 6 periods: 12 zero crossings after the start, the last at the
    # end
    assert np.count_nonzero(np.diff(np.sign(chirp(inside[1:-1])))) == 11
    falling = Chirp(1.0, 500.0, 0.0, 0.02, phase=np.pi / 2, taper=0.005)
    assert falling.highest_frequency == 500.0
    np.testing.assert_allclose(falling([0.0, 0.02]), 0.0, atol=1e-15)
    np.testing.assert_allclose(
        falling([0.0025, 0.0175]),
        0.5
        * np.cos(
            2.0 * np.pi * (500.0 * np.array([0.0025, 0.0175]) - 12500.0 * np.array([0.0025, 0.0175]) ** 2)
        ),
        atol=1e-12,
    )


def test_step():
    np.testing.assert_array_equal(Step(5.0, time=0.1)([0.0, 0.0999, 0.1, 0.2]), [0.0, 0.0, 5.0, 5.0])
    # 0.1 + 0.2 and 3 * 0.1 differ in the last digit; both are at 0.3
    assert Step(5.0, time=0.1 + 0.2)(0.3) == 5.0
    np.testing.assert_array_equal(Step(5.0)([-1e-6, 0.0]), [0.0, 5.0])
    smooth = Step(4.0, time=0.1, rise=0.2)
    np.testing.assert_allclose(
        smooth([0.0, 0.1, 0.15, 0.2, 0.25, 0.3, 9.0]),
        [0.0, 0.0, 2.0 - np.sqrt(2.0), 2.0, 2.0 + np.sqrt(2.0), 4.0, 4.0],
        atol=1e-14,
    )
    assert (smooth.end, smooth.highest_frequency) == (pytest.approx(0.3), 2.5)


def test_constant_and_numbers():
    assert as_signal(3) == Constant(3.0) and as_signal(np.float32(3.0)) == Constant(3.0)
    np.testing.assert_array_equal(Constant(3.0)(T), np.full(T.shape, 3.0))
    assert (Constant(3.0).end, Constant(3.0).highest_frequency) == (0.0, 0.0)


@pytest.mark.parametrize(
    "signal",
    [
        Constant(1.0),
        Harmonic(1.0, 5.0),
        ToneBurst(1.0, 5.0, 3),
        Chirp(1.0, 1.0, 9.0, 1.0),
        Step(1.0, 0.5, 0.1),
        Samples([0.0, 1.0], [1.0, 2.0]),
        Samples([0.0, 1.0, 2.0], [1.0, 2.0, 0.0], "cubic"),
        Custom(np.cos),
        Harmonic(1.0, 5.0) + 2.0,
    ],
)
def test_calls_keep_the_shape_and_signals_are_values(signal):
    t = np.linspace(0.1, 0.9, 6)
    values = signal(t)
    assert values.shape == (6,) and values.dtype == float
    np.testing.assert_array_equal(signal(t.reshape(2, 3)), values.reshape(2, 3))
    assert signal(float(t[2])) == values[2] and np.ndim(signal(0.1)) == 0
    assert signal(np.array([])).shape == (0,)
    assert signal == 1.0 * signal and hash(signal) == hash(1.0 * signal) and len({signal, 1.0 * signal}) == 1
    np.testing.assert_allclose((-3.0 * signal)(t), -3.0 * values, rtol=1e-14)
    np.testing.assert_allclose((signal / 4)(t), values / 4, rtol=1e-14)
    np.testing.assert_allclose((np.float64(2.0) * signal)(t), 2.0 * values, rtol=1e-14)
    with pytest.raises(AttributeError):
        signal.amplitude = 2.0


def test_sums():
    pump, probe, preload = Harmonic(300.0, 433.0), Harmonic(1.0, 3000.0), -5.0
    total = pump + probe + preload
    assert isinstance(total, Sum) and len(total.parts) == 3
    np.testing.assert_allclose(total(T), pump(T) + probe(T) - 5.0, atol=1e-12)
    np.testing.assert_allclose((1.0 - total / 2)(T), 1.0 - total(T) / 2, atol=1e-12)
    np.testing.assert_allclose((-total)(T), -total(T), atol=1e-12)
    assert (total.highest_frequency, total.end) == (3000.0, np.inf)
    assert sum([pump, probe]) == pump + probe and pump + 0 == pump
    assert 1.0 + pump + 2.0 == pump + 3.0
    assert Constant(1.0) + 2.0 == Constant(3.0)
    assert (ToneBurst(1.0, 100.0, 5) + Step(1.0, 0.2)).end == 0.2
    assert (pump + Custom(np.sin)).highest_frequency is None
    assert (pump + Custom(np.sin, highest_frequency=700.0)).highest_frequency == 700.0
    np.testing.assert_allclose((pump + np.cos)(T), pump(T) + np.cos(T), atol=1e-12)
    assert (
        repr(ToneBurst(1.0, 3000.0, 100) + 2.0)
        == "Constant(value=2) + ToneBurst(amplitude=1, frequency=3000 Hz, cycles=100)"
    )


def test_samples():
    line = Samples([0.0, 1.0, 3.0], [0.0, 2.0, -2.0])
    np.testing.assert_allclose(
        line([-0.1, 0.0, 0.25, 1.0, 2.0, 3.0, 3.1]), [0.0, 0.0, 0.5, 2.0, 0.0, -2.0, 0.0], atol=1e-15
    )
    assert line.end == 3.0
    t = np.linspace(0.0, 1.0, 201)
    cubic, linear = Samples(t, np.sin(7.0 * t), "cubic"), Samples(t, np.sin(7.0 * t))
    between = np.linspace(0.0, 1.0, 4001)
    # h = 1/200: linear 49 h^2 / 8 = 1.53e-4, cubic 7^4 h^4 / 384 = 1e-8 inside, more at the ends
    assert np.abs(linear(between) - np.sin(7.0 * between)).max() == pytest.approx(1.53e-4, rel=0.01)
    assert np.abs(cubic(between) - np.sin(7.0 * between)).max() < 1e-7
    # k * dt beyond the last sample by a rounding error is still at it
    assert Samples([0.0, 0.1, 0.3], [0.0, 1.0, 5.0])(3 * 0.1) == 5.0
    with pytest.raises(ValueError):
        line.value[0] = 1.0
    given = np.array([0.0, 1.0])
    kept = Samples(given, given)
    given[1] = 7.0
    assert kept(1.0) == 1.0
    assert (
        line == Samples([0, 1, 3], [0, 2, -2])
        and line != Samples([0, 1, 3], [0, 2, -2], "cubic")
        and line != 3
    )
    assert repr(line) == "Samples(3 samples from 0 s to 3 s, values from -2 to 2, linear)"


def test_band_of_samples():
    t = np.linspace(0.0, 1.0, 1001)
    assert Samples(t, np.sin(2.0 * np.pi * 50.0 * t)).highest_frequency == pytest.approx(50.0)
    assert Samples(t, 3.0 + 2.0 * t).highest_frequency == 0.0
    assert Samples(
        t, np.sin(2.0 * np.pi * 50.0 * t) + 0.02 * np.sin(2.0 * np.pi * 200.0 * t)
    ).highest_frequency == pytest.approx(200.0)
    assert Samples(
        t, np.sin(2.0 * np.pi * 50.0 * t) + 0.005 * np.sin(2.0 * np.pi * 200.0 * t)
    ).highest_frequency == pytest.approx(50.0)
    burst = ToneBurst(1.0, 50.0, 20)
    assert Samples(t, burst(t)).highest_frequency == pytest.approx(burst.highest_frequency, abs=2.0)
    noise = Samples(t, np.random.default_rng(1).standard_normal(1001))
    assert 490.0 < noise.highest_frequency <= 500.0
    assert Samples([0.0, 1e-3], [0.0, 1.0]).highest_frequency == 0.0


def write(folder, text):
    path = folder / "force.csv"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "text",
    [
        "0,1\n0.5,2\n2,-3\n",
        "time (s),force (N)\n0,1\n0.5,2\n2,-3",
        '# recorded\n"t";"F"\n0;1\n0.5;2\n# pause\n2;-3\n\n\n',
        "t\tF\n0\t1\n5e-1\t2\n2\t-3\n",
        "0 1\n 0.5   2\n2 -3\n",
        "\ufefft,F\r\n0,1\r\n0.5,2\r\n2,-3\r\n",
    ],
)
def test_csv(tmp_path, text):
    assert Samples.from_csv(write(tmp_path, text)) == Samples([0.0, 0.5, 2.0], [1.0, 2.0, -3.0])


def test_csv_scales(tmp_path):
    signal = Samples.from_csv(
        str(write(tmp_path, "ms,kN\n0,1\n500,2\n2000,-3\n")), "cubic", time_scale=1e-3, value_scale=1e3
    )
    assert signal == Samples([0.0, 0.5, 2.0], [1e3, 2e3, -3e3], "cubic")


CSV_CASES = {
    "0,1\n0.5,\n2,3\n": "line 2: a number is missing",
    "0,1\n,2\n2,3\n": "line 2: a number is missing",
    "0,1\n0.5\n2,3\n": "line 2: the number of columns is 1; two",
    "0,1\n\n2,3\n": "line 2: the line is empty",
    "t,F\n0,1\n0.5,2,3\n": "line 3: the number of columns is 3; two",
    "t,F\n0,1\n0.5,two\n": "line 3: 'two' is not a number",
    "t,F\nunit s,unit N\n0,1\n": "line 2: 'unit s' is not a number",
    "0,one\n1,2\n": "line 1: 'one' is not a number",
    "0;1\n0,5;2\n": "line 2: '0,5' is not a number",
    "0,1\n0.5,nan\n": "line 2: 'nan' is not finite",
    "0,1\ninf,2\n": "line 2: 'inf' is not finite",
    "t,F\n0,1\n1,2\n0.5,3\n": "line 4: time 0.5 follows 1; times must rise",
    "0,1\n1,2\n1,3\n": "line 3: time 1 follows 1; times must rise",
    "t,F\n0,1\n": "line 2: the number of samples is 1 where",
    "": "line 1: the number of samples is 0 where",
}


@pytest.mark.parametrize("text", CSV_CASES)
def test_bad_csv(tmp_path, text):
    path = write(tmp_path, text)
    with pytest.raises(ValueError) as error:
        Samples.from_csv(path)
    assert str(error.value).startswith(f"{path}, {CSV_CASES[text]}") and "\n" not in str(error.value)


def test_unreadable_csv(tmp_path):
    with pytest.raises(ValueError, match="nowhere.csv: cannot be read: No such file"):
        Samples.from_csv(tmp_path / "nowhere.csv")
    with pytest.raises(ValueError, match="cannot be read: Is a directory"):
        Samples.from_csv(tmp_path)
    binary = tmp_path / "picture.csv"
    binary.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(ValueError, match="picture.csv: is no text file"):
        Samples.from_csv(binary)


def test_custom():
    pulse = Custom(lambda t: np.where(t < 1e-3, 300.0, 0.0), highest_frequency=2000.0)
    np.testing.assert_array_equal(pulse([0.0, 9e-4, 1e-3]), [300.0, 300.0, 0.0])
    assert (pulse.highest_frequency, pulse.end, (2 * pulse)(0.0)) == (2000.0, np.inf, 600.0)
    assert "highest_frequency=2000 Hz" in repr(pulse) and "sin, highest_frequency=unknown" in repr(
        as_signal(np.sin)
    )
    late = Custom(lambda t: np.where(t < 1.0, t, np.nan))
    with pytest.raises(ValueError, match="returned nan at t = 2 s; finite numbers"):
        late([0.5, 2.0])


# statement -> (error, what its sentence must say)
CASES = {
    "Harmonic('big', 1.0)": (TypeError, "Harmonic: amplitude = 'big' must be a number"),
    "Harmonic(True, 1.0)": (TypeError, "Harmonic: amplitude = True"),
    "Harmonic(float('nan'), 1.0)": (ValueError, "Harmonic: amplitude = nan must be finite"),
    "Harmonic(1.0, 0.0)": (ValueError, "Harmonic: frequency = 0.0 must be finite and above 0 (Hz)"),
    "Harmonic(1.0, -5.0)": (ValueError, "Harmonic: frequency = -5.0"),
    "Harmonic(1.0, 5.0, np.inf)": (ValueError, "Harmonic: phase = inf must be finite (rad)"),
    "Harmonic(1.0, 5.0, 1j)": (TypeError, "Harmonic: phase = 1j must be a number (rad)"),
    "ToneBurst(1.0, 3000.0, 0)": (ValueError, "ToneBurst: cycles = 0"),
    "ToneBurst(1.0, -3000.0, 10)": (ValueError, "ToneBurst: frequency = -3000.0"),
    "Chirp(1.0, -1.0, 5.0, 1.0)": (ValueError, "Chirp: start = -1.0 must be finite and at least 0 (Hz)"),
    "Chirp(1.0, 0.0, 0.0, 1.0)": (ValueError, "Chirp: start = 0 Hz and stop = 0 Hz"),
    "Chirp(1.0, 1.0, 5.0, 0.0)": (ValueError, "Chirp: duration = 0.0"),
    "Chirp(1.0, 1.0, 5.0, 1.0, taper=0.6)": (
        ValueError,
        "Chirp: taper = 0.6 s must be at most half the duration, 0.5 s",
    ),
    "Step(1.0, rise=-1.0)": (ValueError, "Step: rise = -1.0"),
    "Step(1.0, time=None)": (TypeError, "Step: time = None must be a number (s)"),
    "Constant(np.inf)": (ValueError, "Constant: value = inf"),
    "Samples([0, 1], [0, 1, 2])": (ValueError, "2 times and 3 values"),
    "Samples([0], [1])": (ValueError, "number of samples is 1"),
    "Samples([], [])": (ValueError, "number of samples is 0"),
    "Samples([0, 2, 1], [0, 1, 2])": (ValueError, "time[2] = 1 s follows 2 s; times must rise"),
    "Samples([0, 1, 1], [0, 1, 2])": (ValueError, "time[2] = 1 s follows 1 s"),
    "Samples([0, np.nan, 1], [0, 1, 2])": (ValueError, "time[1] = nan must be finite"),
    "Samples([0, 1], [0, np.inf])": (ValueError, "value[1] = inf must be finite"),
    "Samples([0, 1], ['a', 'b'])": (TypeError, "value = ['a', 'b'] must be an array of real numbers"),
    "Samples([[0, 1]], [[0, 1]])": (ValueError, "time has 2 dimensions, 1 are expected"),
    "Samples([0, 1], [0, 1], 'quintic')": (
        ValueError,
        "interpolation = 'quintic' must be one of 'linear', 'cubic'",
    ),
    "Samples.from_csv('x.csv', time_scale=0.0)": (ValueError, "time_scale = 0.0"),
    "Custom(5.0)": (TypeError, "Custom: function = 5.0 cannot be called"),
    "Custom(lambda t: 1.0 if t < 1 else 0.0)": (ValueError, "must take an array, as numpy.vectorize"),
    "Custom(math.sin)": (ValueError, "must take an array, as numpy.vectorize(sin) does"),
    "Custom(lambda t: 1.0)": (ValueError, "returned the shape () for 2 times"),
    "Custom(lambda t: t[:1])": (ValueError, "returned the shape (1,) for 2 times"),
    "Custom(lambda t: 1j * t)": (TypeError, "type complex128; real numbers"),
    "Custom(lambda t: t + np.inf)": (ValueError, "returned inf at t = 0 s"),
    "Custom(np.sin, highest_frequency=-1.0)": (
        ValueError,
        "highest_frequency = -1.0 must be finite and at least 0 (Hz)",
    ),
    "Sum(())": (ValueError, "Sum: no signals"),
    "Sum(('x',))": (TypeError, "signal 'x' is neither"),
    "as_signal('x')": (TypeError, "signal 'x' is neither a number nor a signal nor a function of time"),
    "as_signal(None)": (TypeError, "signal None is neither"),
    "as_signal(True)": (TypeError, "signal True is neither"),
    "as_signal(Harmonic)": (TypeError, "is neither a number nor a signal"),
    "as_signal(np.nan)": (ValueError, "Constant: value = nan"),
    "Harmonic(1.0, 5.0) + 'x'": (TypeError, "signal 'x' is neither"),
    "Harmonic(1.0, 5.0) * 'x'": (TypeError, "Harmonic: factor = 'x' must be a number"),
    "Harmonic(1.0, 5.0) * Harmonic(1.0, 5.0)": (TypeError, "Harmonic: factor = Harmonic(amplitude=1"),
    "Harmonic(1.0, 5.0) * np.nan": (ValueError, "Harmonic: factor = nan must be finite"),
    "Harmonic(1.0, 5.0) / 0": (ValueError, "Harmonic: divisor = 0 must not be zero"),
}


@pytest.mark.parametrize("statement", CASES)
def test_bad_input(statement):
    kind, sentence = CASES[statement]
    with pytest.raises(kind) as error:
        eval(statement)
    assert sentence in str(error.value) and "\n" not in str(error.value)
