"""Two tones: against histories, against `periodic` where the tones have a common period, closed forms without
contact, and what is refused.
"""

import re
import warnings

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.problems import curve as curve_module
from sbfem_petsc.continuation.problems.curve import spectral_tail
from sbfem_petsc.motion.two_tones import tone
from sbfem_petsc.plot import plot_lines
from tests.parallel import alone, answer, on_ranks
from tests.reference import paper_beam
from tests.systems import one_mass

PROBE, PUMP = 3000.0, 400.0 * np.sqrt(2.0)
STEPS = 384


def two_tones(pump=PUMP, force=100.0):
    return sb.PointForce("A", fy=sb.Harmonic(300.0, PROBE) + sb.Harmonic(force, pump))


@pytest.fixture(scope="module")
def beam():
    """80 mm, 0.06 degrees, damping ratio 0.005, with the contact pairs that the figures below were computed
    for by a program of another kind.
    """
    return sb.Model(
        paper_beam(opening=0.06).mesh(order=5, face_edges=1),
        sb.Material(young=70e9, poisson=0.3, density=2700),
        damping=0.005,
        tip_modes=0,
    )


@pytest.fixture(scope="module")
def found(beam):
    return sb.quasi_periodic(beam, two_tones(), (PROBE, PUMP), modes=30, steps=STEPS)


@pytest.mark.slow
def test_lines_of_a_history(beam, found, monkeypatch):
    """Lines of u_A within 1e-3 of those of a history that has settled (`settled_lines` for 8 s): 2e-5 for the
    tones, 2e-4 for the first and 9e-4 for the second sidebands with 41 samples; with 21 up to 1.6e-3. By a
    separate program, after 0.8 s: main tones 3e-4, first sidebands 3e-3, second ones 2 %.
    """
    history = {
        (1, 0): 5.055052e-5,
        (0, 1): 2.054968e-5,
        (1, 1): 3.168979e-8,
        (1, -1): 2.191454e-8,
        (1, 2): 5.713333e-9,
        (1, -2): 3.903328e-9,
    }
    monkeypatch.setattr(curve_module, "INSTANTS", 100)  # that are summed at a time
    finer = sb.quasi_periodic(found.reduced, two_tones(), (PROBE, PUMP), steps=STEPS, samples=41, guess=found)
    for (m, n), value in history.items():
        assert abs(finer.line(m, n, "A")) == pytest.approx(value, rel=1e-3)
        assert abs(found.line(m, n, "A")) == pytest.approx(value, rel=2e-3)
    separate = {(1, 0): 5.0547e-5, (0, 1): 2.0550e-5, (1, 1): 3.173e-8, (1, -1): 2.193e-8}
    for (m, n), value in separate.items():
        assert abs(found.line(m, n, "A")) == pytest.approx(value, rel=3e-4 if 0 in (m, n) else 3e-3)
    assert abs(found.line(1, 2, "A")) == pytest.approx(5.81e-9, rel=0.02)
    assert abs(found.line(1, -2, "A")) == pytest.approx(3.97e-9, rel=0.02)
    assert found.stable and len(found.residuals) <= 6


def test_at_coordinates(found):
    """The curve is integrated again for the place, which is that of a named point. Its row of contact comes
    from another solve with K, whose rounding is 3e-16 m/N here, and 2e-9 of the motion.
    """
    for direction in "xy":
        named, placed = (found.harmonics(point, direction) for point in ("A", (0.4, 0.005)))
        np.testing.assert_allclose(placed, named, rtol=0.0, atol=1e-8 * np.abs(named).max())
    assert "0.4 m, 0.005 m" in plot_lines(found, (0.4, 0.005)).get_ylabel()


@pytest.mark.long
def test_a_history_settles_on_it():
    """From the linear response to both tones, not from the curve. A damping ratio of 0.02 makes the slowest
    mode decay to 5e-4 within 2.5 s. Found: 2e-5 for the tones, up to 5e-4 for sidebands.
    """
    model = sb.Model(
        paper_beam(opening=0.06).mesh(order=5, face_edges=1),
        sb.Material(young=70e9, poisson=0.3, density=2700),
        damping=0.02,
        tip_modes=0,
    )
    reduced = sb.reduce(model, two_tones(), modes=20)
    lines = sb.quasi_periodic(reduced, two_tones(), (PROBE, PUMP), steps=STEPS, samples=41, stability=False)
    for (m, n), value in settled_lines(reduced, 2.5, 500).items():
        assert abs(lines.line(m, n, "A") - value) < 1e-3 * abs(value), (m, n, value)


def settled_lines(r, duration, last):
    """Complex lines of u_A over the last periods of the probe of a history, by least squares."""
    periods, rate = int(duration * PROBE), PROBE * STEPS
    q, v = linear_state(r)
    first = sb.transient(
        r, two_tones(), periods / PROBE, step=1.0 / rate, initial=(q, v), decimation=STEPS * 100
    )
    turned = 2.0 * np.pi * PUMP * periods / PROBE
    load = sb.PointForce("A", fy=sb.Harmonic(300.0, PROBE) + sb.Harmonic(100.0, PUMP, turned))
    state = first.states.q[-1], first.states.v[-1]
    second = sb.transient(r, load, last / PROBE, step=1.0 / rate, initial=state, decimation=24)
    time = second.time + periods / PROBE
    lines = [(m, n) for m in range(7) for n in range(-8, 9) if m or n >= 0]
    waves = np.exp(2j * np.pi * np.outer(time, [m * PROBE + n * PUMP for m, n in lines]))
    matrix = np.concatenate([waves.real, -waves.imag], axis=1)
    found = np.linalg.lstsq(matrix, second.displacement("A")[:, 1], rcond=None)[0]
    values = dict(zip(lines, found[: len(lines)] + 1j * found[len(lines) :]))
    return {line: values[line] for line in ((1, 0), (0, 1), (1, 1), (1, -1), (1, 2), (1, -2))}


def test_a_history_stays_on_it(beam, found):
    """`transient` from the state at t = 0: after 40 periods of the probe u_A is what the lines add up to,
    within 2e-4 of its size: the load is linear over a step there, (2 pi / 384)^2 / 12 = 2e-5, and lines end
    at the tenth of the pump.
    """
    r = found.reduced
    start = modal_state(found, r)
    periods = 40
    history = sb.transient(r, two_tones(), periods / PROBE, step=1.0 / (PROBE * STEPS), initial=start)
    u, time = history.displacement("A")[-STEPS:, 1], history.time[-STEPS:]
    lines = found.harmonics("A")
    expected = np.zeros(STEPS)
    for m in range(len(lines)):
        for k, n in enumerate(found.orders):
            if m or n >= 0:
                expected += (lines[m, k] * np.exp(2j * np.pi * (m * PROBE + n * PUMP) * time)).real
    assert np.abs(u - expected).max() < 2e-4 * np.abs(expected).max()


def linear_state(r):
    """Modal displacement and velocity at t = 0 of the linear response to both tones."""
    q, v = 0.0, 0.0
    for force, frequency in ((300.0, PROBE), (100.0, PUMP)):
        omega = 2.0 * np.pi * frequency
        amplitude = -1j * force * r.load_modes[:, 0]
        amplitude = amplitude / (r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
        q, v = q + amplitude.real, v + (1j * omega * amplitude).real
    return q, v


def modal_state(found, r):
    """Modal displacement and velocity at t = 0: the linear response and the difference to it."""
    m, (q, v) = len(r.omega), linear_state(r)
    return q + found.states[0, :m] / r.omega, v + found.states[0, m:]


@pytest.mark.slow
def test_common_period(found):
    """The pump an eighth of the probe: with 8 samples the curve passes through the motion that `periodic`
    finds, and lines that fall together add up to its harmonics, to 1e-8 of the largest sideband.
    """
    r, pump = found.reduced, PROBE / 8.0
    signal = sb.Harmonic(300.0, PROBE) + sb.Harmonic(100.0, pump)
    orbit = sb.periodic(r, [signal], pump, steps=8 * STEPS)
    harmonics = orbit.harmonics("A")
    both = sb.quasi_periodic(r, [signal], (PROBE, pump), samples=8, steps=STEPS)
    assert np.abs(folded(both) - harmonics[:25]).max() < 1e-8 * abs(harmonics[9])
    assert abs(both.line(1, 1, "A")) > 1e-4 * abs(both.line(1, 0, "A"))
    # the same disturbances die out, but for what their turning leaves of uncertainty
    slowest = np.log(np.abs(orbit.multipliers[0])) * pump
    assert both.exponents[:2].mean() == pytest.approx(slowest, rel=0.05)
    # a trigonometric interpolant through kinks: the error falls with the number of samples
    errors = []
    for samples in (9, 21, 41):
        other = sb.quasi_periodic(r, [signal], (PROBE, pump), samples=samples, steps=STEPS, stability=False)
        errors.append(np.abs(folded(other) - harmonics[:25]).max() / abs(harmonics[8]))
    assert errors[2] < 3e-6 and errors[2] < 0.5 * errors[1] < 0.25 * errors[0]


def folded(found):
    """Harmonics 0 to 24 of the eighth of the probe, to which lines of several (m, n) contribute."""
    half = found.samples // 2
    sums = np.zeros(25, dtype=complex)
    for m in range(10):
        for n in range(-half, half + 1):
            k = 8 * m + n
            if (m == 0 and n < 0) or abs(k) > 24:
                continue
            value = found.line(m, n, "A")
            sums[abs(k)] += value if k > 0 else np.conj(value) if k < 0 else value.real
    return sums


def test_order_of_the_tones(found):
    """The pump first: the same lines, indices exchanged."""
    other = sb.quasi_periodic(
        found.reduced,
        [sb.Harmonic(300.0, PROBE) + sb.Harmonic(100.0, PUMP)],
        (PUMP, PROBE),
        steps=STEPS,
        stability=False,
        guess=found,
    )
    assert len(other.residuals) == 1
    for m, n in ((1, 0), (0, 1), (1, -1), (-1, 1), (2, 1)):
        assert other.line(n, m, "A") == pytest.approx(found.line(m, n, "A"), rel=1e-9)


def test_without_contact_two_linear_responses():
    """An open notch: each tone by itself, no sidebands; a preload is the mean."""
    r = oscillator(gap=1e3)
    f1, f2, force = 0.3, 0.05 * np.sqrt(3.0), 2.0
    load = [sb.Harmonic(force, f1, 0.7) + sb.Harmonic(1.0, f2) + sb.Constant(0.5)]
    found = sb.quasi_periodic(r, load, (f1, f2))
    for (m, n), frequency, amplitude in (
        ((1, 0), f1, -1j * force * np.exp(0.7j)),
        ((0, 1), f2, -1j),
        ((0, 0), 0.0, 0.5),
    ):
        omega = 2.0 * np.pi * frequency
        assert found.line(m, n, "A") == pytest.approx(amplitude / (1.0 - omega**2 + 0.02j * omega), rel=1e-12)
    assert found.modulation_index("A") < 1e-14 and len(found.residuals) == 1
    # one mass: both exponents are minus the damping
    assert found.exponents == pytest.approx(-0.01, rel=0.2)


def oscillator(gap, damping=0.01):
    """A unit mass on a unit spring with an elastic stop."""
    return one_mass(gap, damping, towards=1.0)


def errors_of_lines(r, pump, samples, steps):
    """Largest errors of the main lines of a mass at a probe of 0.25 Hz and a pump of 0.087 Hz, relative to
    the largest line; the last number of samples is what the others are compared with.
    """
    tones = (0.25, 0.05 * np.sqrt(3.0))
    load = [sb.Harmonic(1.0, tones[0]) + sb.Harmonic(pump, tones[1])]

    def lines(count):
        found = sb.quasi_periodic(r, load, tones, samples=count, steps=steps, stability=False)
        return np.array([found.line(m, n, "A") for m in range(3) for n in (-1, 0, 1) if m or n >= 0])

    *others, reference = (lines(count) for count in samples)
    return np.array([np.abs(other - reference).max() for other in others]) / np.abs(reference).max()


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:quasi_periodic. [359] samples (do not )?resolve")
def test_convergence_in_the_samples():
    """Where the mass opens and closes once in every period of the probe, whatever the pump's phase, the curve
    is smooth and the error falls by more than a hundred with two more samples, down to that of the steps
    (1e-7); where some periods are without contact it falls with a power of their number, about 3.
    """
    smooth = errors_of_lines(oscillator(0.0, 0.2), 0.1, (3, 5, 7, 31), 2048)
    assert smooth[1] < 0.01 * smooth[0] and smooth[2] < 0.1 * smooth[1] and smooth[2] < 2e-7
    samples = np.array([5, 9, 15, 21, 41, 121])
    kinked = errors_of_lines(oscillator(0.6, 0.05), 0.3, samples, 512)
    power = -np.polyfit(np.log(samples[:-1]), np.log(kinked), 1)[0]
    assert 2.5 < power < 4.0 and 1e-6 < kinked[-1] < 1e-4


def test_sidebands_grow_with_the_pump(beam, found):
    """Modulation index over the pump's force: nothing without it, and rising."""
    index = []
    for force in (25.0, 50.0):
        weaker = sb.quasi_periodic(
            found.reduced,
            two_tones(force=force),
            (PROBE, PUMP),
            steps=STEPS,
            stability=False,
        )
        index.append(weaker.modulation_index("A"))
    assert 0.0 < index[0] < index[1] < found.modulation_index("A")


def test_few_steps_are_told():
    """A load at the seventh multiple of the faster tone: 48 steps are 6.9 in its period, and lines are off by
    a tenth to a half; 20 in its period are taken without a word.
    """
    load = [sb.Harmonic(1.0, 0.05) + sb.Harmonic(10.0, 0.35) + sb.Harmonic(0.3, 0.01 * np.sqrt(3.0))]
    r = oscillator(0.6, 0.05)

    def lines(steps):
        tones = (0.05, 0.01 * np.sqrt(3.0))
        found = sb.quasi_periodic(r, load, tones, steps=steps, samples=15, stability=False)
        return np.array([found.line(m, n, "A") for m, n in ((2, 0), (1, 1), (1, -1))]), found.steps

    (default, steps), (exact, _) = lines(None), lines(4096)
    assert steps == 512
    np.testing.assert_allclose(default, exact, rtol=0.01)
    with pytest.warns(
        sb.StepWarning, match="48 steps a period of the faster tone are 6.9 a period of the high"
    ):
        few, _ = lines(48)
    assert (abs(few - exact) > 0.1 * abs(exact)).all()
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.StepWarning)
        lines(140)


def test_few_samples_are_told():
    """A pump's third multiple with seven samples, which resolve it and not what contact makes of it: a tone
    itself is off by more than a tenth; with the thirteen that are asked for by less than a fiftieth.
    """
    r, pump = oscillator(0.0, 0.05), 0.05 / np.sqrt(3.0)
    load = [sb.Harmonic(1.0, 0.25) + sb.Harmonic(0.3, 3.0 * pump) + sb.Harmonic(0.05, pump)]

    def tones(samples):
        found = sb.quasi_periodic(r, load, (0.25, pump), samples=samples, stability=False)
        return np.array([found.line(1, 0, "A"), found.line(0, 1, "A")])

    exact = tones(41)
    with pytest.warns(
        sb.StepWarning, match="7 samples resolve multiples up to 3 of .* multiple 3; at least 13"
    ):
        few = tones(7)
    assert (abs(few - exact) > 0.1 * abs(exact)).any()
    with pytest.warns(sb.StepWarning, match="13 samples do not resolve the motion") as told:
        np.testing.assert_allclose(tones(13), exact, rtol=0.02)
    assert not any("multiples" in str(item.message) for item in told)


@pytest.mark.long
def test_samples_that_do_not_resolve_the_motion():
    """Two masses and a stop that touch in some periods, f2 three eighths of f1: with the default 21 samples
    lines beside those of `periodic` over the common period (f2, f1, 2 f1) are off by 3, 18 and 13 %, which is
    told; with 81 by 0.03, 0.6 and 2 %, with 8, which the map takes to each other, not at all: without a word.
    """
    stiffness = np.array([[2.0, -1.0], [-1.0, 1.0]])
    r = sb.reduce_matrices(
        np.eye(2),
        stiffness,
        np.array([[-1.0, 0.0]]),
        np.array([0.3]),
        loads=np.array([[0.0], [1.0]]),
        sensors={"1": 0, "2": 1},
        compliance=np.array([0.1]),
        damping=0.1 * stiffness,
    )
    first, second = 0.25, 0.25 * 3.0 / 8.0
    load = [sb.Harmonic(0.4, first) + sb.Harmonic(0.3, second)]
    harmonics = sb.periodic(r, load, first / 8.0, steps=8 * 512, stability=False).harmonics("1")[:17]

    def error(samples):
        found = sb.quasi_periodic(r, load, (first, second), samples=samples, steps=512, stability=False)
        lines, half = np.zeros(17, dtype=complex), samples // 2
        for m in range(21):
            for n in range(-half, half + 1):
                k = 8 * m + 3 * n
                if (m or n >= 0) and abs(k) < 17:
                    value = found.line(m, n, "1")
                    lines[abs(k)] += value if k > 0 else np.conj(value) if k < 0 else value.real
        return np.abs(lines / harmonics - 1.0)[[3, 8, 16]], found

    with pytest.warns(sb.StepWarning, match="21 samples do not resolve the motion: .* samples=41") as told:
        few, coarse = error(21)
    assert told[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.StepWarning)
        (many, fine), (exact, among) = error(81), error(8)
    assert few.max() > 0.1 and (many < [0.01, 0.01, 0.03]).all() and exact.max() < 1e-9
    assert not coarse.resolved and fine.resolved and among.resolved
    assert fine.tail < 0.002 < 0.02 < coarse.tail
    assert "not resolved" in repr(coarse)


def test_tail_of_known_curves():
    """A curve of one harmonic, one whose harmonics are known, and none."""
    turns = 2.0 * np.pi * np.arange(17) / 17.0
    one = np.column_stack([np.cos(turns), 3.0 + np.sin(turns)])
    assert spectral_tail(one) < 1e-15 == spectral_tail(0.0 * one) + 1e-15
    assert spectral_tail(np.cos(8.0 * turns)[:, None] + 5.0) == pytest.approx(1.0)
    # the highest quarter of eight: 7 and 8; 0.4^2 + 0.3^2 of 1 + 0.5^2
    wave = np.column_stack([np.cos(turns) + 0.3 * np.cos(8.0 * turns), 0.4 * np.sin(7.0 * turns)])
    assert spectral_tail(wave) == pytest.approx(np.sqrt(0.25 / 1.25))


@pytest.mark.parametrize(
    "load, frequencies, sentence",
    [
        (300.0, (3000.0, 70.0), "300.0 does not say to which tone it belongs; give Harmonic"),
        (
            sb.Harmonic(1.0, 3000.0) + sb.Harmonic(1.0, 71.0),
            (3000.0, 70.0),
            "frequency=71 Hz.* belongs to neither tone",
        ),
        (sb.Harmonic(1.0, 3000.0), (3000.0, 70.0), "no load oscillates at 70 Hz"),
        (sb.ToneBurst(1.0, 3000.0, 5), (3000.0, 70.0), "neither a Harmonic nor a Constant"),
        (sb.Harmonic(1.0, 3000.0), (3000.0, 3000.0), "both frequencies are 3000 Hz"),
        (sb.Harmonic(1.0, 3000.0), 3000.0, "must be two numbers"),
        (sb.Harmonic(1.0, 3000.0), (3000.0, -1.0), r"frequencies\[1\] = -1"),
    ],
)
def test_bad_requests(load, frequencies, sentence):
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.quasi_periodic(oscillator(1.0), [load], frequencies)


def test_no_load_belongs_to_either_tone():
    assert tone(0) == tone(0.0) == sb.Constant(0.0)


def test_lines_beyond_the_samples(found):
    with pytest.raises(ValueError, match=r"line \(1, 11\) is not resolved: 21 samples"):
        found.line(1, 11, "A")


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.continuation.problems.own_tone import OwnTone, curve_near, first_curve
from sbfem_petsc.continuation.problems.tones import own_motion
from tests.reference import paper_beam
from tests.systems import two_masses
mesh = paper_beam(opening=0.06).mesh(order=3, tip_size=2e-4)
model = sb.Model(mesh, sb.Material(70e9, 0.3, 2700), damping=0.005)
pump = 400.0 * np.sqrt(2.0)
load = sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0) + sb.Harmonic(100.0, pump))
lines = []
for samples in (3, 11):  # there may be more ranks than samples
    found = sb.quasi_periodic(model, load, (3000.0, pump), modes=16, steps=128, samples=samples)
    wanted = ((1, 0), (0, 1), (1, 1), (1, -1))
    lines += [abs(found.line(*k, at)) for at in ("A", (0.4, 0.005)) for k in wanted]
system = two_masses(0.02, compliance=0.1)
curve = sb.frequency_response(system, [0.1], 0.0962, 0.0959, steps=128)
own = OwnTone(curve.period, "frequency", None, 11, MPI.COMM_WORLD)
point = curve_near(own, *first_curve(own, curve.bifurcations[0], 0.05))
state = point.state
assert len(state.motions) <= 11 // MPI.COMM_WORLD.size + 1
lines += [state.value, state.rotation, abs(own_motion(point, False).line(0, 1, "1"))]
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({"lines": lines, "exponent": float(found.exponents[0]), "peak": found.contact_peak}))
"""


@pytest.mark.long
def test_ranks():
    """Ranks share the samples and the linear systems: the same motion, also with a tone of its own."""
    one = alone(RANKS)
    more = answer(on_ranks(4, RANKS))
    for name in one:
        assert more[name] == pytest.approx(one[name], rel=1e-6)


OPTIONS = """
import sbfem_petsc as sb
from tests.systems import one_mass
load = sb.Harmonic(1.0, 0.25) + sb.Harmonic(1.0, 0.07)
sb.quasi_periodic(one_mass(1.0, 0.05), [load], (0.25, 0.07), samples=9)
"""


REFUSED = """
from petsc4py import PETSc
for name, value in (("torus_ksp_type", "nix"), ("torus_ksp_type", "cg"), ("torus_pc_type", "lu")):
    PETSc.Options()[name] = value
    try:
        sb.quasi_periodic(one_mass(1.0, 0.05), [load], (0.25, 0.07), samples=9)
    except sb.SolverFailure as error:
        print(f"{type(error).__name__}: {error}")
    PETSc.Options().delValue(name)
"""


@pytest.mark.long
def test_options_of_the_linear_systems():
    """Under their prefix. Of a type that does not exist, and of ones that cannot do it: one sentence at once,
    not after tries from other first guesses.
    """
    given = ("-torus_ksp_converged_reason", "-torus_ksp_type", "fgmres")
    said = on_ranks(1, OPTIONS + REFUSED, *given).stdout.replace("\033[0m", "").splitlines()
    assert any("Linear torus_ solve converged" in line for line in said)
    told = [line for line in said if re.match(r"\w+: ", line)]
    refused = "(PETSc refuses an option that begins with -torus_|quasi_periodic: PETSc gave up)"
    assert len(told) == 3 and all(re.match(f"PetscFailure: {refused}", sentence) for sentence in told)
    assert not any("neither from where" in sentence for sentence in told)


SINGULAR = """
import dataclasses
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from sbfem_petsc.reduction.reduced_model import ReducedModel
from tests.systems import one_mass
ReducedModel.comm = property(lambda self: MPI.COMM_WORLD)
pump = 0.5 / (2.0 * np.pi)  # the mass, without damping, has twice this frequency
load = [sb.Harmonic(1.0, 0.25) + sb.Harmonic(0.3, pump)]
near = sb.quasi_periodic(one_mass(0.5, 0.05), load, (0.25, pump), samples=9, steps=128, stability=False)
free = one_mass(50.0, 0.0)
start = dataclasses.replace(near, reduced=free)
try:
    sb.quasi_periodic(free, load, (0.25, pump), samples=9, steps=128, guess=start, stability=False)
    told = "found"
except sb.SolveError as error:
    told = str(error)
told = MPI.COMM_WORLD.gather(told)
if MPI.COMM_WORLD.rank == 0:
    import json
    print(json.dumps({"told": told}))
"""


@pytest.mark.long
@pytest.mark.parametrize("ranks", [1, 3])
def test_motions_that_are_not_isolated(ranks):
    """An undamped mode at twice the slower tone may vibrate freely besides: no motion is as good as another,
    and none is told.
    """
    for told in answer(on_ranks(ranks, SINGULAR))["told"]:
        assert told.startswith("quasi_periodic: the motion is not isolated")
