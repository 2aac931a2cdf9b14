"""Periodic motions with contact against closed forms, converged values of an independent prototype, and time
integration.
"""

import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.contact.closed_sets import thin_factors
from sbfem_petsc.contact.step_data import Marched
from sbfem_petsc.continuation import search as steady
from sbfem_petsc.continuation.search import NEWTON_ALONE, Search
from sbfem_petsc.errors import PetscFailure
from sbfem_petsc.motion import period_map
from sbfem_petsc.petsc import PETSc
from sbfem_petsc.reduction.matrices import reduce_matrices
from tests.parallel import ROOT, alone, answer, on_ranks
from tests.reference import paper_beam
from tests.systems import case_p as paper_case
from tests.systems import one_mass, two_masses

FORCE = sb.PointForce("A", fy=300.0)


def beam(opening=0.0458366, poisson=0.33, damping=0.002, **mesh):
    return sb.Model(paper_beam(opening).mesh(**mesh), sb.Material(70e9, poisson, 2700), damping=damping)


def bilinear(ratio, zeta, gap=0.0, stiffness=1.0):
    """A mass whose spring is stiffer on one side: w_closed = 1, w_open = ratio; the second mass is far above
    and left out.
    """
    r = reduce_matrices(
        np.eye(2),
        stiffness * np.diag([ratio**2, 1e6]),
        np.array([[1.0, 0.0]]),
        np.array([gap]),
        loads=np.array([[1.0], [0.0]]),
        sensors={"x": 0},
        modes=1,
        damping=zeta,
        compliance=np.array([1 / (stiffness * (1 - ratio**2))]),
    )
    return r, 2 * ratio / (1 + ratio) / (2 * np.pi)


@pytest.fixture(scope="module")
def case_p():
    model = paper_case(damping=0.002)
    return model, sb.periodic(model, FORCE, 3000.0)


@pytest.fixture(scope="module")
def case_q():
    model = beam(0.06, 0.30)
    return model, sb.periodic(model, FORCE, 3000.0)


# ---------------------------------------------------------------- oscillators with known motions


@pytest.mark.parametrize(
    "ratio, mean, second, third, damping",
    [
        (0.9, 0.06704, 0.01488, 5.18e-4, (0.02, 0.005, 0.001)),
        (0.5, 0.43210, 1 / 11, 0.01920, (0.02, 0.01, 0.005)),
    ],
)
def test_bilinear_oscillator_at_its_resonance(ratio, mean, second, third, damping):
    """Driven at 2 w1 w2 / (w1 + w2) with light damping it moves as in free vibration; what damping changes is
    of first order in it, below 0.1 % at 2 %.
    """
    second_harmonics = []
    for zeta in damping:
        r, frequency = bilinear(ratio, zeta)
        orbit = sb.periodic(r, 1.0, frequency, steps=2048)
        h = np.abs(orbit.harmonics("x")[:4])
        np.testing.assert_allclose(h[[0, 2, 3]] / h[1], [mean, second, third], rtol=1e-3)
        assert orbit.stable
        second_harmonics.append(h[2] / h[1])
    # towards the undamped limit, each step by less
    assert np.all(np.diff(np.abs(np.diff(second_harmonics))) < 0)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.9, 0.5])
def test_bilinear_peak_frequency(ratio):
    """The response's peak is at 2 w1 w2 / (w1 + w2): 1 % is asked for, 1e-4 is met with damping of 2 % and of
    0.5 %.
    """
    for zeta in (0.02, 0.005):
        r, frequency = bilinear(ratio, zeta)
        curve = sb.frequency_response(
            r, [1.0], frequency * (1 - 8 * zeta), frequency * (1 + 8 * zeta), steps=1024, stability=False
        )
        assert curve.peak("x").frequency == pytest.approx(frequency, rel=1e-3)


def test_homogeneous_with_zero_gap():
    """No gap, no length: force times 1000 gives the motion times 1000, to the tolerance of Newton's
    method.
    """
    r, frequency = bilinear(0.9, 0.01)
    one, many = (sb.periodic(r, force, 0.9 * frequency) for force in (1.0, 1000.0))
    np.testing.assert_allclose(many.state, 1000 * one.state, rtol=1e-9)
    np.testing.assert_allclose(many.multipliers, one.multipliers, rtol=1e-9)


def test_preload_that_keeps_the_stop_closed():
    """Pressed onto its stop for good, the mass is linear with both springs: -i F / (w_closed^2 - w^2 + 2 i
    zeta w_open w).
    """
    zeta, ratio = 0.01, 0.5
    r, frequency = bilinear(ratio, zeta)
    preload = -100.0
    orbit = sb.periodic(r, 1.0 * sb.Harmonic(1.0, frequency) + preload, frequency, steps=2048)
    omega = 2 * np.pi * frequency
    assert (orbit.contact_force > 0).all()
    exact = -1j / (1 - omega**2 + 2j * zeta * ratio * omega)
    # contact forces are held at the mean of a step's ends, an error of (omega h)^2 / 12 of their part
    assert abs(orbit.harmonics("x")[1] / exact - 1) < 1e-5
    assert orbit.harmonics("x")[0].real == pytest.approx(preload, rel=1e-9)
    assert np.abs(orbit.harmonics("x")[2:]).max() < 1e-12 * abs(preload)


def test_second_order_in_the_step():
    """A piecewise linear motion, contact held at mean values: errors fall by 4 with half the step, in the
    mean of four halvings.
    """
    r, frequency = bilinear(0.5, 0.02, gap=0.3)
    found = {
        steps: sb.periodic(r, 1.0, 0.8 * frequency, steps=steps, stability=False).harmonics("x")[:7]
        for steps in (64, 128, 256, 512, 1024, 8192)
    }
    errors = [np.abs(found[steps] - found[8192]).max() for steps in (64, 128, 256, 512, 1024)]
    slope = np.polyfit(np.log([64, 128, 256, 512, 1024]), np.log(errors), 1)[0]
    assert -2.5 < slope < -1.7 and errors[-1] < 1e-4 * abs(found[8192][1])


# ---------------------------------------------------------------- the notched beam


@pytest.mark.slow
def test_harmonics_of_the_beam(case_q):
    """3 kHz, 300 N: mean, second to fourth harmonic of a converged prototype (85 pairs, 2048 steps) within 3
    %; 1.3 % is met with 26 pairs and 512 steps.
    """
    _, orbit = case_q
    h = np.abs(orbit.harmonics("A"))
    np.testing.assert_allclose(h[[0, 2, 3, 4]] / h[1], [0.2120, 8.450e-3, 4.89e-4, 5.15e-4], rtol=0.03)
    assert orbit.harmonics("A")[0].real < 0 and len(h) > 20 and orbit.converged and orbit.stable
    assert (orbit.contact_force >= 0).all() and orbit.gap.min() > -1e-15


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [433.0, 3000.0, pytest.param(20140.0, marks=pytest.mark.long)])
def test_newton_iterations(case_q, frequency):
    """At most 6 to 1e-10; the last one goes from the step at which the contact sets stop changing to
    round-off.
    """
    model, other = case_q
    orbit = sb.periodic(
        model if frequency > 3000 else other.reduced,
        FORCE,
        frequency,
        steps=512,
        jacobian="dense",
        stability=False,
    )
    residuals = np.array(orbit.residuals) / orbit.residuals[0]
    assert orbit.path == "Newton" and orbit.iterations <= 6
    assert residuals[-1] < 1e-10 and residuals[-2] > 1e-8


def test_one_newton_is_linear(case_q):
    """1 N closes no pair: no iteration, no harmonics, the response without contact, digit for digit;
    harmonics 2-10 below 1e-4 are asked for.
    """
    model, orbit = case_q
    light = sb.PointForce("A", fy=1.0)
    for frequency in (3000.0, 20140.0):
        found, open_crack = (
            sb.periodic(model, light, frequency, contact=c, modes=120, stability=False) for c in (True, False)
        )
        h = np.abs(found.harmonics("A"))
        assert found.iterations == 0 and not found.contact_force.any() and h[2:11].max() < 1e-14 * h[1]
        np.testing.assert_allclose(found.harmonics("A")[1], open_crack.harmonics("A")[1], rtol=1e-13)
        r, omega = found.reduced, 2 * np.pi * frequency
        k = r.points.names.index("A")
        modal = r.load_modes[:, 0] / (r.omega**2 - omega**2 + 2j * r.damping * r.omega * omega)
        assert found.harmonics("A")[1] == pytest.approx(
            -1j * (r.points.modes[k, 1] @ modal + r.points.loads[k, 1, 0]), rel=1e-12
        )


@pytest.mark.long
def test_steps_modes_and_pairs(case_q):
    """512 steps are within 4e-6 of 8192, 40 and 80 modes within 5e-5 and 5e-6 of 160."""
    model, orbit = case_q
    by_steps = {
        s: sb.periodic(orbit.reduced, FORCE, 3000.0, steps=s, stability=False).harmonics("A")[:7]
        for s in (128, 512, 2048, 8192)
    }
    errors = [np.abs(by_steps[s] - by_steps[8192]).max() / abs(by_steps[8192][1]) for s in (128, 512, 2048)]
    assert errors[1] < 6e-6
    # second order: a factor of 16 each
    assert 8 < errors[0] / errors[1] < 32 and 6 < errors[1] / errors[2] < 32
    by_modes = [
        sb.periodic(model, FORCE, 3000.0, steps=1024, modes=m, stability=False).harmonics("A")[:7]
        for m in (40, 80, 160)
    ]
    far = [np.abs(h - by_modes[-1]).max() / abs(by_modes[-1][1]) for h in by_modes[:-1]]
    assert far[0] < 5e-5 and far[1] < 5e-6


@pytest.mark.long
def test_mean_converges_with_the_mesh(case_q):
    """The mean, most sensitive to contact near the tip: the default mesh is within 1e-3 of one of order 8
    whose tip element is ten times smaller, a mesh in between is within 3e-4.
    """
    _, orbit = case_q
    orbits = [orbit]
    for mesh in (
        {"order": 6, "grading": 1.8, "tip_size": 5e-6},
        {"order": 8, "grading": 1.5, "tip_size": 5e-6},
    ):
        orbits.append(sb.periodic(beam(0.06, 0.30, **mesh), FORCE, 3000.0, stability=False))
    coarse, between, fine = (abs(o.harmonics("A")[0] / o.harmonics("A")[1]) for o in orbits)
    assert abs(coarse / fine - 1.0) < 1e-3
    assert abs(between / fine - 1.0) < 3e-4


def one_period(history, steps):
    """Complex harmonics of the last period of a history."""
    u = history.displacement("A")[-steps - 1 : -1, 1]
    found = np.fft.rfft(u) * 2 / steps
    found[0] /= 2
    return found[:7]


@pytest.mark.long
def test_a_history_stays_on_the_orbit(case_p):
    """100 periods of `transient` from the orbit's state: harmonics 0-6 within 1e-4 of the first; what differs
    is the load, linear in a step there: (omega h)^2 / 12.
    """
    model, orbit = case_p
    apart = []
    for steps in (512, 1024):
        here = sb.periodic(orbit.reduced, FORCE, 3000.0, steps=steps, stability=False)
        history = sb.transient(
            orbit.reduced,
            sb.PointForce("A", fy=sb.Harmonic(300.0, 3000.0)),
            100 / 3000,
            step=1 / (3000 * steps),
            initial=(here.states.q[0], here.states.v[0]),
        )
        assert len(history.time) == 100 * steps + 1
        apart.append(
            np.abs(one_period(history, steps) - here.harmonics("A")[:7]).max() / abs(here.harmonics("A")[1])
        )
    assert apart[0] < 1e-4 and apart[1] == pytest.approx(apart[0] / 4, rel=0.2)


@pytest.mark.long
def test_rest_leads_to_the_orbit():
    """433 Hz, damping 5 %, 300 N from rest until the slowest mode has died away to 1e-6: within 1e-4 of the
    first harmonic; 3e-6 is met.
    """
    steps, frequency = 512, 433.0
    model = beam(damping=0.05)
    orbit = sb.periodic(model, FORCE, frequency, steps=steps)
    assert (
        orbit.contact_resultant.max() > 1000 and abs(orbit.harmonics("A")[2] / orbit.harmonics("A")[1]) > 0.01
    )
    count = int(np.log(1e-6) / np.log(abs(orbit.multipliers[0])))
    load = sb.PointForce("A", fy=sb.Harmonic(300.0, frequency))
    history = sb.transient(
        orbit.reduced,
        load,
        count / frequency,
        step=1 / (frequency * steps),
        decimation=steps,
    )
    last = sb.transient(
        orbit.reduced,
        load,
        1 / frequency,
        step=1 / (frequency * steps),
        initial=(history.states.q[-1], history.states.v[-1]),
    )
    assert np.abs(one_period(last, steps) - orbit.harmonics("A")[:7]).max() < 2e-5 * abs(
        orbit.harmonics("A")[1]
    )


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [pytest.param(433.0, marks=pytest.mark.long), 3000.0])
def test_dense_matrix_free_and_differences(case_p, frequency):
    """One orbit, three ways: 1e-8 is asked for; Newton's tolerance is 1e-10."""
    model, orbit = case_p
    dense, free, differences = (
        sb.periodic(orbit.reduced, FORCE, frequency, steps=512, jacobian=j, stability=False)
        for j in ("dense", "matrix-free", "differences")
    )
    size = np.linalg.norm(dense.state)
    assert (
        np.linalg.norm(free.state - dense.state) < 1e-9 * size
        and np.linalg.norm(differences.state - dense.state) < 1e-8 * size
    )
    assert free.iterations == dense.iterations and differences.iterations <= dense.iterations + 1
    for other in (free, differences):
        np.testing.assert_allclose(
            other.harmonics("A"), dense.harmonics("A"), atol=1e-8 * np.abs(dense.harmonics("A")).max()
        )


@pytest.mark.slow
def test_options_of_the_command_line():
    """-shooting_... reaches Newton's method: PETSc's own differences, and another solver of its linear
    systems, give the same orbit; the monitor prints.
    """
    program = """
import sys
from sbfem_petsc.command_line import Parser, run
arguments = Parser("orbit").parse(sys.argv[1:])
def main():
    import sbfem_petsc as sb
    from sbfem_petsc.continuation.search import NEWTON_ALONE
    from tests.systems import two_masses
    orbit = sb.periodic(two_masses(), [0.1], 0.095, steps=256, stability=False, search=NEWTON_ALONE)
    print(repr(complex(orbit.harmonics("1")[2])))
run(main)
"""

    def call(*options):
        return subprocess.run(
            [sys.executable, "-c", program, *options],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=300,
        )

    done = call(
        *("-shooting_snes_fd", "-shooting_snes_monitor"),
        *("-shooting_ksp_type", "gmres", "-shooting_ksp_converged_reason"),
    )
    (answered,) = (complex(line) for line in done.stdout.splitlines() if line.startswith("("))
    orbit = sb.periodic(two_masses(), [0.1], 0.095, steps=256, stability=False)
    exact = orbit.harmonics("1")[2]
    assert abs(exact) > 0.01 * abs(orbit.harmonics("1")[1])  # it meets the stop
    # differences by 1e-8 leave Newton's method at 1e-10 of the first residual
    monitored = [line for line in done.stdout.splitlines() if "SNES Function norm" in line]
    assert abs(answered - exact) < 1e-7 * abs(exact)
    assert len(monitored) > 3 and "0 SNES Function norm" in monitored[0]
    assert "Linear shooting_ solve converged due to CONVERGED_RTOL" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("allowed", [0, 1])
def test_iterations_that_an_option_allows(allowed, monkeypatch):
    """-shooting_snes_max_it ends it at once, with a sentence that names it: no history and no ramp."""

    def no(*arguments):
        raise AssertionError("a search was begun")

    monkeypatch.setattr(steady, "_Attempts", no)
    options = PETSc.Options()
    options.setValue("shooting_snes_max_it", allowed)
    try:
        with pytest.raises(
            PetscFailure,
            match=f"has taken the {allowed} iterations that -shooting_snes_max_it {allowed} allows: "
            r"x\(T\) - x\(0\) is at .* of the motion's size",
        ):
            sb.periodic(beam(order=3, tip_size=2e-4), FORCE, 3000.0, modes=24, steps=1024, stability=False)
    finally:
        options.delValue("shooting_snes_max_it")


def test_start_from_a_neighbour(case_p):
    """From the orbit at 3000 Hz that at 3001 Hz is the same as from the linear response; from itself there is
    nothing to do.
    """
    model, orbit = case_p
    fresh = sb.periodic(orbit.reduced, FORCE, 3001.0, stability=False)
    warm = sb.periodic(model, FORCE, 3001.0, guess=orbit, stability=False, jacobian="dense")
    assert warm.iterations <= 6 and warm.reduced is orbit.reduced
    assert sb.periodic(model, FORCE, 3000.0, guess=orbit, stability=False).iterations <= 1
    assert np.linalg.norm(warm.state - fresh.state) < 1e-8 * np.linalg.norm(fresh.state)


def test_two_periods_of_a_period_one_motion(case_p):
    """With twice the period the same motion is found, without subharmonics, and multipliers are squares."""
    model, orbit = case_p
    twice = sb.periodic(orbit.reduced, FORCE, 3000.0, periods=2, steps=512)
    once = sb.periodic(orbit.reduced, FORCE, 3000.0, steps=512)
    np.testing.assert_allclose(
        twice.harmonics("A")[:21], once.harmonics("A")[:21], atol=1e-9 * abs(once.harmonics("A")[1])
    )
    assert abs(twice.subharmonics("A")[1]) < 1e-9 * abs(
        once.harmonics("A")[1]
    ) and twice.period == pytest.approx(2 / 3000)
    np.testing.assert_allclose(np.abs(twice.multipliers[:6]), np.abs(once.multipliers[:6]) ** 2, rtol=1e-9)


def test_commensurate_tones_and_preload(case_p):
    """3000 Hz with 1500 Hz beside it and a constant force: two periods, and the history that starts there
    stays.
    """
    model, _ = case_p
    load = sb.PointForce("A", fy=sb.Harmonic(200.0, 3000.0) + sb.Harmonic(60.0, 1500.0, 0.3) + 20.0)
    orbit = sb.periodic(model, load, 3000.0, steps=512, stability=False)
    assert (
        orbit.periods == 2
        and abs(orbit.subharmonics("A")[1]) > 0.01 * abs(orbit.harmonics("A")[1])
        and orbit.contact_resultant.max() > 100
    )
    history = sb.transient(
        orbit.reduced,
        load,
        20 / 3000,
        step=1 / (3000 * 512),
        initial=(orbit.states.q[0], orbit.states.v[0]),
    )
    u, v = history.displacement("A")[-1025:-1, 1], orbit.displacement("A")[:, 1]
    assert np.abs(u - v).max() < 1e-4 * np.abs(v).max()


def test_what_an_orbit_tells(case_p):
    """Gaps, forces and acceleration obey the equations; the text names the verdict."""
    _, orbit = case_p
    assert (
        orbit.displacement("B").shape == (len(orbit.time), 2)
        and orbit.time[0] == 0
        and orbit.time[-1] + orbit.time[1] == pytest.approx(1 / 3000)
    )
    # no gap where there is a force, but for what the steps leave out of the modes' gaps (`thin_factors`)
    modes = orbit.reduced.gap.modes
    left, right = thin_factors(modes)
    left_out = (orbit.states.q @ (modes - left @ right.T).T)[:, : orbit.gap.shape[1]]
    closed = orbit.contact_force > 0.0
    assert np.abs((orbit.gap - left_out)[closed]).max() < 1e-14 * orbit.gap.max()
    # velocity and acceleration are derivatives of the displacement, taken from its Fourier series below the
    # 20th harmonic
    for values, derivative in (
        (orbit.states.q, orbit.states.v),
        (orbit.states.v, orbit.states.modal_acceleration),
    ):
        lines = np.fft.rfft(values[:, :10], axis=0)[:20]
        assert (
            np.abs(
                2j * np.pi * 3000 * np.arange(20)[:, None] * lines
                - np.fft.rfft(derivative[:, :10], axis=0)[:20]
            ).max()
            < 1e-4 * np.abs(np.fft.rfft(derivative[:, :10], axis=0)).max()
        )
    assert "stable" in repr(orbit) and "3000 Hz" in repr(orbit) and "Newton iterations" in repr(orbit)
    with pytest.raises(KeyError, match="point 'Q' does not exist; the model has"):
        orbit.harmonics("Q")
    with pytest.raises(ValueError, match="direction = 'z'"):
        orbit.harmonics("A", "z")


# ---------------------------------------------------------------- bad input and hard cases


@pytest.mark.parametrize(
    "arguments, sentence",
    [
        ({"frequency": 0.0}, "frequency = 0.0"),
        ({"frequency": -3.0}, "frequency"),
        ({"frequency": float("nan")}, "frequency"),
        ({"frequency": "fast"}, "frequency"),
        ({"steps": 0}, "steps = 0"),
        ({"steps": 16}, "steps = 16 must be at least 48"),
        ({"steps": 100.0}, "steps = 100.0 must be a whole number"),
        ({"steps": True}, "steps"),
        ({"periods": 0}, "periods = 0"),
        ({"periods": 1.5}, "periods"),
        ({"modes": 0}, "modes = 0"),
        ({"longest": 0}, "longest"),
        (
            {"jacobian": "exact"},
            "jacobian = 'exact' is unknown; valid are 'auto', 'dense', 'matrix-free', 'differences'",
        ),
        ({"reduction": "all"}, "reduction = 'all'"),
    ],
)
def test_bad_requests(case_p, arguments, sentence):
    model, _ = case_p
    with pytest.raises((ValueError, TypeError), match=sentence):
        sb.periodic(model, FORCE, **{"frequency": 3000.0, **arguments})


def test_bad_loads(case_p):
    model, orbit = case_p
    with pytest.raises(KeyError, match="'Q'"):
        sb.periodic(model, sb.PointForce("Q", fy=1.0), 3000.0)
    with pytest.raises(TypeError):
        sb.periodic(model, 300.0, 3000.0)
    with pytest.raises(ValueError, match="made for other loads than PointForce"):
        sb.periodic(orbit.reduced, sb.PointForce("A", fx=1.0, fy=1.0), 3000.0)
    for other in (sb.PointForce("A", fx=1.0), sb.PointForce("B", fy=1.0)):
        with pytest.raises(ValueError, match="the reduced model was made for other loads than PointForce"):
            sb.periodic(orbit.reduced, other, 3000.0)
    with pytest.raises(ValueError, match="is not periodic"):
        sb.periodic(model, sb.PointForce("A", fy=sb.ToneBurst(300.0, 3000.0, 5)), 3000.0)
    with pytest.raises(ValueError, match="433 Hz has no common period with 3000 Hz"):
        sb.periodic(model, sb.PointForce("A", fy=sb.Harmonic(1.0, 433.0)), 3000.0)
    with pytest.raises(ValueError, match="another number of modes .31 modes and .* vectors, not 1 mode."):
        sb.periodic(bilinear(0.9, 0.01)[0], 1.0, 0.1, guess=orbit)


def test_undamped_at_a_resonance():
    """The linear response is infinite there: said so, with the remedy; the same model with contact is solved
    a little beside it.
    """
    model = beam(order=3, damping=0.0)
    resonance = sb.modal(model, 3).frequencies[2]
    with pytest.raises(ValueError, match="mode 3 at .* Hz has no damping and is driven at its own frequency"):
        sb.periodic(model, FORCE, resonance)
    for curve, asked in ((sb.frequency_response, (1.1 * resonance,)), (sb.load_response, ())):
        with pytest.raises(ValueError, match=f"^{curve.__name__}: mode 3 at .* has no damping"):
            curve(model, FORCE, resonance, *asked)
    assert sb.periodic(model, sb.PointForce("A", fy=1e-3), 1.05 * resonance).iterations == 0


def test_no_convergence():
    """Far from any motion that Newton's method finds: the residual and the remedy in the message."""
    r, frequency = bilinear(0.1, 1e-5)
    with pytest.raises(
        sb.SolveError,
        match=r"did not converge \(.*\).* of the motion's size, from .*start from a neighbour, take "
        r"more steps",
    ):
        sb.periodic(r, 1.0, frequency, stability=False, search=NEWTON_ALONE)


def test_contact_problem_that_is_not_solved(case_p, monkeypatch):
    """An error inside SNES' callback comes out as itself."""
    model, orbit = case_p
    monkeypatch.setattr(period_map, "march", lambda *arguments, **named: Marched(7, 0, 0, 7))
    with pytest.raises(sb.SolveError, match="contact problem of step .* at 3000 Hz was not solved"):
        sb.periodic(orbit.reduced, FORCE, 3000.0)


@pytest.mark.parametrize("amplitude", [np.float32(1), np.int64(1), np.float64(1), 1])
def test_numbers_of_all_kinds_are_amplitudes(amplitude):
    """Not constants: the mean is zero and the fundamental that of the closed form."""
    r, frequency = bilinear(0.9, 0.01, gap=100.0)
    omega = np.pi * frequency
    found = sb.periodic(r, amplitude, 0.5 * frequency).harmonics("x")
    assert (
        found[1] == pytest.approx(-1j / (0.81 - omega**2 + 0.018j * omega), rel=1e-10)
        and abs(found[0]) < 1e-14
    )


@pytest.mark.long
def test_a_ramp_past_a_corner():
    """Where Newton's method fails from the linear response the load is ramped, past a corner at a third of it
    where a stiff stop is met and the branch turns back.
    """
    r = two_masses()
    settled = sb.periodic(r, 0.1, 0.1, steps=2048, stability=False)
    assert settled.path == "history" and settled.residuals[-1] < 1e-9
    orbit = sb.periodic(r, 0.1, 0.1, steps=2048, stability=False, search=Search(settling=()))
    assert orbit.path == "ramp of the load" and orbit.amplitude("2") == pytest.approx(0.64656, rel=1e-3)
    again = sb.periodic(r, 0.1, 0.1, steps=2048, guess=orbit, stability=False)
    assert again.iterations <= 1


def test_a_ramp_of_too_many_iterations(monkeypatch):
    """It is given up, and the sentence says where."""
    monkeypatch.setattr(steady, "EFFORT", 3)
    only = Search(settling=(), dampings=(), neighbours=())
    with pytest.raises(sb.SolveError, match=r"over the load from 0.02 \(until 3 Newton iterations, at 0"):
        sb.periodic(two_masses(), 0.1, 0.1, steps=512, search=only)


@pytest.mark.parametrize("number", [np.int64(300), np.float32(300), 300])
def test_forces_of_all_kinds_are_amplitudes(case_p, number):
    """The same motion as for a float."""
    model, orbit = case_p
    again = sb.periodic(orbit.reduced, sb.PointForce("A", fy=number), 3000.0, stability=False)
    np.testing.assert_allclose(
        again.harmonics("A")[:5],
        orbit.harmonics("A")[:5],
        rtol=0,
        atol=1e-9 * np.abs(orbit.harmonics("A")[1]),
    )


@pytest.mark.slow
def test_orbits_of_other_models_are_refused(case_p):
    """A state has a meaning in its own model's modes alone: another material, damping or load places cannot
    pass.
    """
    model, orbit = case_p
    other = sb.Model(paper_beam().mesh(), sb.Material(young=7e9, poisson=0.33, density=2700), damping=0.002)
    with pytest.raises(ValueError, match="belongs to another model"):
        sb.periodic(other, FORCE, 3000.0, guess=orbit)
    with pytest.raises(TypeError, match="in the place of the model"):
        sb.periodic(other, FORCE, 3000.0, reduction=orbit.reduced)


RANKS = """
import json
import numpy as np
import sbfem_petsc as sb
from mpi4py import MPI
from tests.reference import paper_beam
model = sb.Model(paper_beam().mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), damping=0.002)
orbit = sb.periodic(model, sb.PointForce("A", fy=300.0), 3000.0, modes=30)
h = orbit.harmonics("A")[:7]
all_h = MPI.COMM_WORLD.gather(h)
if MPI.COMM_WORLD.rank == 0:
    print(json.dumps({
        "h": [[v.real, v.imag] for v in h],
        "same": max(float(np.abs(o - h).max()) for o in all_h),
        "mu": abs(orbit.multipliers[:4]).tolist(),
        "iterations": orbit.iterations,
        "force": float(orbit.contact_resultant.max()),
    }))
"""


def test_pickled():
    """What computes the uncertainty later on is not, its value is; nor are sets that have been met."""
    masses = two_masses(0.02)
    unmet = len(pickle.dumps(masses.closed_sets))
    orbit = sb.periodic(masses, [0.1], 0.092)
    assert len(pickle.dumps(masses.closed_sets)) == unmet
    copy = pickle.loads(pickle.dumps(orbit))
    assert copy.multiplier_error == orbit.multiplier_error > 0.0 and copy.stable
    np.testing.assert_array_equal(copy.state, orbit.state)


@pytest.mark.long
def test_ranks():
    """The same orbit on 1, 2 and 3 ranks: within 1e-7 of the first harmonic, since the reduction's modes
    differ by up to 3e-8; the same on every rank.
    """
    serial, *others = alone(RANKS), *(answer(on_ranks(n, RANKS)) for n in (2, 3))
    exact = np.array(serial["h"]) @ [1, 1j]
    for found in others:
        assert found["same"] == 0.0 and found["iterations"] == serial["iterations"]
        np.testing.assert_allclose(np.array(found["h"]) @ [1, 1j], exact, atol=1e-7 * abs(exact[1]))
        np.testing.assert_allclose(found["mu"], serial["mu"], atol=1e-8)
        assert found["force"] == pytest.approx(serial["force"], rel=1e-6)


def test_steps_follow_the_fastest_tone():
    """A fast probe over a slow pump (one mass with a stop): sidebands of the default steps beside many; few
    steps given are told.
    """
    system = one_mass(0.1, 0.05)
    load = [sb.Harmonic(0.3, 0.01) + sb.Harmonic(30.0, 1.0)]

    def sidebands(steps):
        orbit = sb.periodic(system, load, 0.01, steps=steps, stability=False)
        return orbit.spectrum("A")[[99, 101]], len(orbit.time)

    (found, steps), (exact, _) = sidebands(None), sidebands(25600)
    assert steps == 3200
    np.testing.assert_allclose(found, exact, rtol=0.02)
    with pytest.warns(sb.StepWarning, match="512 steps a forcing period are 5.1 a period of the highest"):
        few, _ = sidebands(512)
    assert (abs(few - exact) > 0.1 * abs(exact)).any()


@pytest.mark.parametrize("kind", [ValueError, sb.SolveError])
@pytest.mark.parametrize("within", ["more modes", "a search"])
def test_errors_of_progress_end_the_analysis(kind, within):
    """In an attempt in more modes, and in a search, where others of that kind call for another way."""
    told = list[float]()

    def closed(done):
        told.append(done)
        raise kind("I/O operation on closed file")

    if within == "a search":
        asked = one_mass(0.0, 0.005, stiffness=30.0), 0.5, 0.2546554
    else:
        mesh = Beam(0.4, 0.005, [VNotch(0.08, 0.0025, 0.0, tilt=45.0)]).mesh(order=3, tip_size=2e-4)
        rubs = {"crack1": sb.Coulomb(0.3)}
        model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700), damping=0.002, contact_laws=rubs)
        asked = model, sb.PointForce("A", fy=50.0), 1000.0
    with pytest.raises(kind, match="^I/O operation on closed file$"):
        sb.periodic(*asked, steps=256 if within == "a search" else None, stability=False, progress=closed)
    assert len(told) == 1
