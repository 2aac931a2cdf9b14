"""Loads that jump within a step: closed forms of the modes, event integration, energy and restarts."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.reduction.matrices import reduce_matrices

ALUMINIUM = sb.Material(70e9, 0.33, 2700)
RATIO, TURN = 0.005, 2.0 * np.pi


@pytest.fixture(scope="module")
def beam():
    return sb.Model(Beam(0.4, 0.01).mesh(), ALUMINIUM, clamped="left", damping=RATIO)


def push(signal):
    return sb.PointForce("A", fy=signal)


def swing(r, time):
    """Modal displacement and velocity under a unit load from t = 0 on, (n, modes) each."""
    t, w = np.maximum(time, 0.0)[:, None], r.omega
    decay, turn = r.damping * w, w * np.sqrt(1.0 - r.damping**2)
    fall = np.exp(-decay * t)
    q = (1.0 - fall * (np.cos(turn * t) + decay / turn * np.sin(turn * t))) / w**2
    return q, fall * np.sin(turn * t) / turn


def risen(r, time, rise):
    """The same under (1 - cos(pi t / rise)) / 2 until `rise`, one from then on."""
    w, along = r.omega, np.pi / rise
    decay, turn = r.damping * w, w * np.sqrt(1.0 - r.damping**2)
    answer = 1.0 / (w**2 - along**2 + 2j * decay * along)
    q0, v0 = 0.5 * answer.real - 0.5 / w**2, 0.5 * (1j * along * answer).real

    def wave(t):
        on, t = (t > 0.0)[:, None], np.maximum(t, 0.0)[:, None]
        fall, turned = np.exp(-decay * t), answer * np.exp(1j * along * t)
        q = fall * (q0 * np.cos(turn * t) + (v0 + decay * q0) / turn * np.sin(turn * t))
        v = fall * (v0 * np.cos(turn * t) - (decay * v0 + w**2 * q0) / turn * np.sin(turn * t))
        return on * (q + 0.5 / w**2 - 0.5 * turned.real), on * (v - 0.5 * (1j * along * turned).real)

    # the same wave half a period later takes the oscillation away and leaves one
    first, second = wave(time), wave(time - rise)
    return first[0] + second[0], first[1] + second[1]


def assert_motion(history, q, v, tolerance):
    """Displacement and velocity of A are those of modal coordinates, as shares of the largest ones."""
    r, point = history.reduced, history.reduced.points.of("A", "point")
    q, v = q * r.load_modes[:, 0], v * r.load_modes[:, 0]
    u = point(q, history.states.amplitudes, np.zeros((len(q), len(r.initial_gap))))
    for found, exact in ((history.displacement("A"), u), (history.velocity("A"), point.rates(v))):
        assert np.abs(found - exact).max() < tolerance * np.abs(exact).max()


@pytest.mark.parametrize(
    "duration, time, modes", [(10.0, 1.0, 8), (4.0, 0.5, 8), (1.0, 0.5, None), (1.0, 0.31234567, None)]
)
def test_step(beam, duration, time, modes):
    """At the default step, however long the history: exact (1e-9 for the cancellation of 1e4 periods). The
    account of work takes cubics between instants, which follow the modes that the load moves: the highest of
    80 asks for 200,000 steps a second.
    """
    history = sb.transient(beam, push(sb.Step(1.0, time=time)), duration, modes=modes)
    assert_motion(history, *swing(history.reduced, history.time - time), 1e-9)
    assert np.abs(history.energy.balance).max() < 1e-5 * history.energy.external.max()
    assert history.step > 0.9e-4


@pytest.mark.parametrize("duration", [2.0, pytest.param(10.0, marks=pytest.mark.long)])
def test_rise(beam, duration):
    """The rise sets the step: lines instead of half a cosine, (pi h / rise)^2 / 12 = 3e-5."""
    history = sb.transient(beam, push(sb.Step(1.0, time=1.0, rise=1e-3)), duration, modes=8)
    assert history.step < 1e-3 / 159
    assert_motion(history, *risen(history.reduced, history.time - 1.0, 1e-3), 3e-5)


@pytest.mark.parametrize("rise", [1e-11, 1e-8])
def test_a_line_as_good_as_a_jump(beam, rise):
    """Samples that rise within a time that nothing else knows of are a step there, for the motion, the
    default step and what is told of modes; beside other samples their band is that of the others.
    """
    time = 1e-3
    line = sb.Samples([0.0, time, time + rise, 4e-3], [0.0, 0.0, 1.0, 1.0])
    one, other = (sb.transient(beam, push(load), 4e-3, modes=8) for load in (line, sb.Step(1.0, time=time)))
    assert one.step == pytest.approx(other.step, rel=1e-12)
    found, exact = one.velocity("A"), other.velocity("A")
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e2 * rise / time * np.abs(exact).max())
    told = [sb.Samples(line.time, line.value), sb.Step(1.0, time=time)]
    for load in told:
        with pytest.warns(sb.MeshWarning, match="a load jumps, .* above the 8 computed ones"):
            sb.transient(beam, sb.PointForce("A", fx=load), 4e-3, 1e-4, modes=8)
    t = np.linspace(0.0, 1.0, 401)
    wave = np.sin(TURN * 3.0 * t)
    at = np.searchsorted(t, 0.3001)
    jumped = sb.Samples(
        np.insert(t, at, [0.3001, 0.3001 + 1e-9]),
        np.insert(wave + (t > 0.3001), at, [np.interp(0.3001, t, wave), np.interp(0.3001, t, wave) + 1.0]),
    )
    assert jumped.highest_frequency == pytest.approx(sb.Samples(t, wave).highest_frequency, rel=1e-9)
    assert {0.3001, 0.3001 + 1e-9} <= set(jumped.breaks)


@pytest.mark.filterwarnings("ignore:.*highest load frequency:sbfem_petsc.StepWarning")
@pytest.mark.filterwarnings("ignore:.*less than twice as high")
@pytest.mark.parametrize(
    "scheme, step, modes, tolerance", [("exact", 1.7e-3, 4, 1e-7), ("newmark", 2e-5, 1, 2e-4)]
)
def test_sum_of_jumps(beam, scheme, step, modes, tolerance):
    """Several in one step, at its ends and in the middle, of all signals that jump, one of them 1e-10 s long;
    with Newmark's period error: nine cycles of the first mode turn by omega t (omega h)^2 / 24 = 1e-4.
    """
    times, sizes = np.array([1e-4, 3.33e-4, 4e-4, 1.7e-3, 3.4e-3, 0.01, 0.0100001]), np.arange(1.0, 8.0)
    load = sum(sb.Step(f, time=t) for f, t in zip(sizes[:4], times))
    load += sb.Custom(lambda t: sizes[4] * (t >= times[4]), 0.0, breaks=[times[4]])
    load += sb.Samples([times[5], 1.0], [sizes[5], sizes[5]])
    load += sb.Samples([0.0, times[6], times[6] + 1e-10, 1.0], [0.0, 0.0, sizes[6], sizes[6]])
    history = sb.transient(beam, push(load), 0.17, step, modes=modes, scheme=scheme)
    parts = [swing(history.reduced, history.time - t) for t in times]
    q, v = (sum(f * part[k] for f, part in zip(sizes, parts)) for k in range(2))
    assert_motion(history, q, v, tolerance)


def test_chirp_that_breaks_off(beam):
    """It ends within a step at its full value: the same as twice as many steps, one of which ends there."""
    chirp = sb.Chirp(1.0, 20.0, 100.0, 0.1005, phase=1.0)
    one = sb.transient(beam, push(chirp), 0.2, 1e-3 / 10, modes=6)
    other = sb.transient(beam, push(chirp), 0.2, 1e-3 / 20, decimation=2, modes=6)
    # lines instead of waves of 100 Hz: (omega h)^2 / 12
    size = np.abs(one.displacement("A")).max()
    assert np.abs(one.displacement("A") - other.displacement("A")).max() < 4e-4 * size
    assert chirp.before(0.1005) == chirp(0.1005) != 0.0 == chirp.after(0.1005)


def stop():
    """One mode of 1 rad/s and a soft stop of stiffness 1 / 2 at -1."""
    return reduce_matrices(
        np.eye(2),
        np.diag([1.0, 1e6]),
        np.array([[1.0, 0.0]]),
        np.array([1.0]),
        loads=np.array([[1.0], [0.0]]),
        sensors={"x": 0},
        modes=1,
        damping=0.02,
        compliance=np.array([2.0]),
    )


def test_jumps_with_contact():
    """Beside event integration, in the stop and away from it: the steps' own error, (omega h)^2 / 12; half a
    step late it would be 2e-3.
    """
    times, sizes = (2.0 / 3.0, 5.123, 11.377, 23.3333), (-1.5, 2.0, -1.0, -2.0)
    load = sum(sb.Step(f, time=t) for f, t in zip(sizes, times))
    history = sb.transient(stop(), load, 30.0, 0.01)

    def rate(t, state, force):
        x, v = state
        return [v, force - 0.04 * v - x - 0.5 * min(x + 1.0, 0.0)]

    state, force, found = np.zeros(2), 0.0, []
    for begin, end, jump in zip((0.0, *times), (*times, 30.0), (*sizes, 0.0)):
        inside = history.time[(history.time >= begin) & (history.time < end)]
        at = np.append(inside, end)
        run = solve_ivp(
            rate, (begin, end), state, "DOP853", at, args=(force,), rtol=1e-9, atol=1e-10, max_step=0.01
        )
        found.append(run.y[0, :-1])
        state, force = run.y[:, -1], force + jump
    exact = np.append(np.concatenate(found), state[0])
    assert history.contact_resultant.max() > 0.5
    assert np.abs(history.displacement("x")[:, 1] - exact).max() < 5e-5 * np.abs(exact).max()
    assert np.abs(history.energy.balance).max() < 1e-6 * history.energy.total.max()


@pytest.fixture(scope="module")
def cracked():
    return sb.Model(
        Beam(0.4, 0.02, [VNotch(0.1, 0.008, 0.0)]).mesh(order=3), ALUMINIUM, clamped="left", damping=0.01
    )


def test_restart_and_decimation(cracked, tmp_path):
    """Those of the uninterrupted run, which breaks off at an instant at which a load jumps; but for the
    rounding of products with chunks of other lengths.
    """
    load = push(sb.Step(300.0, time=1e-3) + sb.Step(-900.0, time=2.00013e-3) + sb.Samples([0, 2e-3], [1, 50]))
    options = {"step": 5e-6, "modes": 10}
    whole = sb.transient(cracked, load, 4e-3, **options)
    # also at the instant of the first jump, whose contact is that of the loads behind it
    touching = whole.contact_force > 0.0
    assert whole.time[200] == pytest.approx(1e-3) and touching[200].any()
    assert np.abs(whole.gap[touching]).max() < 1e-12 * np.abs(whole.gap).max()
    file = str(tmp_path / "history.h5")
    sb.transient(cracked, load, 2e-3, file=file, **options)
    longer = sb.transient(cracked, load, 4e-3, file=file, resume=True, **options)
    every = sb.transient(cracked, load, 4e-3, decimation=8, **options)
    for name in ("q", "v", "contact", "amplitudes"):
        one, other, fewer = (getattr(history.states, name) for history in (whole, longer, every))
        np.testing.assert_allclose(other, one, rtol=0.0, atol=1e-12 * np.abs(one).max())
        np.testing.assert_allclose(fewer, one[::8], rtol=0.0, atol=1e-12 * np.abs(one).max())
    np.testing.assert_allclose(longer.energy.external, whole.energy.external, rtol=1e-10)


@pytest.mark.parametrize("contact", [False, True])
def test_unreduced(cracked, contact):
    """A jump within a step of the unreduced model has its impulse: as one on an instant and as the reduced
    model's, within what halved steps change; half a step late it would be 6 %.
    """
    step, time = 2e-4, 4.02e-4
    load = push(sb.Step(-300.0, time=time))
    options = {"contact": contact, "modes": 10}
    coarse = sb.transient(cracked, load, 8e-3, step, reduction=None, **options)
    fine = sb.transient(cracked, load, 8e-3, 2e-6, decimation=100, **options)
    size = np.abs(fine.displacement("A")).max()
    assert np.abs(coarse.displacement("A") - fine.displacement("A")).max() < 2e-2 * size


@pytest.mark.parametrize(
    "load",
    [
        sb.EdgeLoad("right", ty=sb.Step(1.0)),
        sb.EdgeLoad("right", tx=sb.Step(1.0, time=1e-4)),
        pytest.param(sb.EdgeLoad("right", tx=1.0), marks=pytest.mark.long),
    ],
)
def test_cells_too_large_are_told(load):
    """A jump moves all modes: it is told where cells are too large for those that count, and the motion is
    5e-3 off or more.
    """

    def motion(modes, **mesh):
        model = sb.Model(Beam(0.4, 0.1).mesh(**mesh), ALUMINIUM, clamped="left", damping=RATIO)
        history = sb.transient(model, load, 4e-3, modes=modes, decimation=1)
        return history.time, np.linalg.norm(history.displacement("A"), axis=1)

    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.MeshWarning)
        time, fine = motion(100, order=6, size=0.04)
    with pytest.warns(sb.MeshWarning, match="a load jumps, .* the error of mode .* changes what it moves"):
        instants, coarse = motion(None, order=2, size=0.1)
    assert np.abs(np.interp(time, instants, coarse) - fine).max() > 5e-3 * fine.max()


@pytest.mark.parametrize(
    "way", ["reduced model", "unreduced", pytest.param("steady state", marks=pytest.mark.long)]
)
def test_cells_too_large_are_told_however_it_is_computed(way):
    """A reduced model that is handed in, and the model itself, tell what the model's reduction tells; loads
    of a known band move nothing beyond it.
    """
    damping = {"damping": RATIO, "rayleigh": (0.0, 1e-6)}
    model = sb.Model(Beam(0.4, 0.1).mesh(order=2, size=0.1), ALUMINIUM, clamped="left", **damping)

    def run(signal):
        load = sb.PointForce("A", fy=signal)
        if way == "steady state":
            return sb.periodic(model, load, 500.0, reduction=None, steps=64)
        reduced = sb.reduce(model, load, modes=40)
        given, options = (model, {"reduction": None}) if way == "unreduced" else (reduced, {})
        return sb.transient(given, load, 5e-4, 1e-6, decimation=100, **options)

    sudden = sb.Custom(lambda t: (t * 500.0 % 1.0 < 0.5) * 1.0) if way == "steady state" else sb.Step(1.0)
    with pytest.warns(sb.MeshWarning, match="a load jumps, .* the error of mode .* changes what it moves"):
        run(sudden)
    with warnings.catch_warnings():
        warnings.simplefilter("error", sb.MeshWarning)
        run(sb.Harmonic(1.0, 50.0))
