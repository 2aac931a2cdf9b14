"""Steps of steady states are halved where contact does work in them, which it does not in the exact motion.

The oracle is the motion from contact change to contact change by DOP853 (`event_map`).
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.motion.contact_work import LARGEST, REPORTED, contact_work
from sbfem_petsc.motion.preparation import PeriodSettings, prepare
from tests.analysis.test_steps_errors import begins, random_masses
from tests.event_map import TURN, EventMap, two_masses_exactly
from tests.systems import one_mass, two_masses


def resonant(damping: float, stop: float):
    """A mass whose stop stands at no distance, beside its resonance; its exact map and the frequency, Hz."""
    root = np.sqrt(1.0 + stop)
    model = one_mass(0.0, damping, stiffness=stop)
    exact = EventMap(np.eye(1), [[2.0 * damping]], np.eye(1), [[-1.0]], [0.0], [stop], [1.0])
    return model, exact, 1.00005 * 2.0 * root / (1.0 + root) / TURN


CASES = {
    **{f"two masses at {omega}": (two_masses(), two_masses_exactly(1.0), omega / TURN)
       for omega in (0.6, 0.65, 0.7)},
    "beside a resonance": resonant(0.002, 50.0),
    "lightly damped": resonant(0.0005, 4.0),
}  # fmt: skip


def work_of(model, orbit) -> float:
    """Of contact in an orbit's steps."""
    settings = PeriodSettings(1, len(orbit.time))
    driven = prepare("periodic", model, [1.0], orbit.frequency, settings=settings).at(orbit.frequency)
    return contact_work(driven, driven.run(orbit.state))


def error_of(exact: EventMap, orbit) -> float:
    """Of the state at t = 0, relative."""
    true, _ = exact.orbit(begins(orbit), orbit.frequency)
    return float(np.linalg.norm(begins(orbit) - true) / np.linalg.norm(true))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::meshing.warnings.StepWarning")
@pytest.mark.parametrize("name", CASES)
def test_the_work_of_contact_tells_the_error(name):
    """512 steps do more of it than is allowed; by default there are more of them, and the error, up to 2e-2
    in 512, is what the work tells.
    """
    model, exact, frequency = CASES[name]
    coarse = sb.periodic(model, [1.0], frequency, steps=512)
    work, error = work_of(model, coarse), error_of(exact, coarse)
    assert work > LARGEST and 0.1 * work < error < 6.0 * work
    orbit = sb.periodic(model, [1.0], frequency)
    assert len(orbit.time) > 512 and work_of(model, orbit) < LARGEST
    assert error_of(exact, orbit) < min(0.5 * error, 2.0 * LARGEST)


def test_given_steps_stay():
    """With the work of contact in a warning."""
    model, exact, frequency = CASES["beside a resonance"]
    with pytest.warns(sb.StepWarning, match=r"does 0\.03 of .* in 512 steps a period.*give more steps"):
        orbit = sb.periodic(model, [1.0], frequency, steps=512)
    assert len(orbit.time) == 512
    assert REPORTED < work_of(model, orbit) and 0.01 < error_of(exact, orbit) < 0.06


def test_multiple_shooting_halves_the_same_steps():
    model, _, frequency = CASES["two masses at 0.6"]
    whole, parts = (sb.periodic(model, [1.0], frequency, segments=n) for n in (1, 4))
    assert len(parts.time) == len(whole.time) == 1024
    np.testing.assert_allclose(parts.state, whole.state, rtol=0.0, atol=1e-9 * np.abs(whole.state).max())


@pytest.mark.long
def test_a_curve_takes_the_steps_of_its_worst_point():
    """Two masses with a stop over their lower resonance, whose map in 512 steps has a Neimark-Sacker point
    too many, in the place of a period doubling; the first period doubling stands where the exact map has it.
    """
    start, stop = 0.6 / TURN, 0.9 / TURN
    curve = sb.frequency_response(two_masses(), [1.0], start, stop)
    assert curve.period.steps == 2048
    kinds = [item.kind for item in curve.bifurcations]
    assert sorted(kinds) == ["Neimark-Sacker"] * 2 + ["fold"] * 2 + ["period doubling"] * 4
    exact, n = two_masses_exactly(1.0), 2
    shapes = curve.reduced.points.modes[:, 1]
    item = curve.bifurcations[kinds.index("period doubling")]
    motion = item.state[:n] / curve.reduced.omega, item.state[n:]
    true = exact.doubling(np.concatenate([shapes @ part for part in motion]), item.value)
    assert item.value == pytest.approx(true, rel=1e-6)
    coarse = sb.frequency_response(two_masses(), [1.0], start, stop, steps=512)
    assert coarse.period.steps == 512
    others = [item.kind for item in coarse.bifurcations]
    assert others.count("period doubling") == 3 and others.count("Neimark-Sacker") == 3


@pytest.mark.long
def test_two_tones_halve_the_same_steps():
    """A lightly damped mass on a stop: the work of contact over all phases of the slower tone tells the error
    of the invariant curve, beside the one in eight times the steps.
    """
    system, tones = one_mass(0.0, 0.005, stiffness=4.0), (0.2199, 0.0345)
    load = [sb.Harmonic(1.0, tones[0]) + sb.Harmonic(0.3, tones[1])]
    found = {
        steps: sb.quasi_periodic(system, load, tones, samples=41, steps=steps, stability=False)
        for steps in (4096, 512, None)
    }
    exact = found[4096].states
    errors = [np.linalg.norm(found[n].states - exact) / np.linalg.norm(exact) for n in (512, None)]
    assert found[512].steps == 512 and found[None].steps == 1024
    assert errors[0] > LARGEST > 2.0 * errors[1]


def test_a_curve_that_is_resumed_goes_on_in_its_steps(tmp_path):
    """Which are not asked for; other ones that are, are refused."""
    system, start, stop, file = two_masses(), 0.6 / TURN, 0.66 / TURN, str(tmp_path / "curve.h5")
    whole = sb.frequency_response(system, [1.0], start, stop)
    with pytest.warns(sb.BranchWarning):
        sb.frequency_response(system, [1.0], start, stop, points=4, file=file)
    again = sb.frequency_response(system, [1.0], start, stop, file=file, resume=True)
    assert again.complete and again.period.steps == whole.period.steps > 512
    np.testing.assert_allclose(again.value, whole.value, rtol=1e-7)
    with pytest.raises(ValueError, match=rf"written with steps = {whole.period.steps}, not 512"):
        sb.frequency_response(system, [1.0], start, stop, steps=512, file=file, resume=True)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::meshing.warnings.StepWarning")
@pytest.mark.parametrize("count", [25, pytest.param(100, marks=pytest.mark.long)])
def test_residuals_and_derivatives_of_random_motions(count):
    """So many of one to three masses with a stop in the steps that they get: closed to 1e-10, and the
    derivative of the period is that of central differences, of these steps.
    """
    generator, errors = np.random.default_rng(3), []
    while len(errors) < count:
        model, _, resonance = random_masses(generator, int(generator.integers(1, 4)))
        frequency = resonance * generator.uniform(0.6, 2.0)
        try:
            orbit = sb.periodic(model, [1.0], frequency, stability=False)
        except sb.SolveError:
            continue
        if not orbit.contact_resultant.any():
            continue
        settings = PeriodSettings(orbit.periods, len(orbit.time) // orbit.periods)
        driven = prepare("periodic", model, [1.0], frequency, settings=settings).at(frequency)
        motion, unit = driven.run(orbit.state), np.eye(len(orbit.state))
        assert np.linalg.norm(motion.residual) < 1e-10 * np.linalg.norm(orbit.state)
        found, step = driven.carried(motion, unit), 1e-6 * np.linalg.norm(orbit.state)
        ends = [
            [driven.run(orbit.state + side * step * e).residual + side * step * e for e in unit]
            for side in (1.0, -1.0)
        ]
        differences = (np.array(ends[0]) - np.array(ends[1])).T / (2.0 * step)
        errors.append(np.abs(found - differences).max() / np.abs(differences).max())
    assert max(errors) < 1e-6
