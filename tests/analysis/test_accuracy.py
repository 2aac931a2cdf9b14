"""An accuracy that is asked for: true errors beside many more modes and steps, what is said without it."""

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.harmonic_errors import FAINT
from tests.analysis.test_mode_error import TURN, rod, true_error
from tests.systems import coarse_beam, one_mass, two_masses

PUSH = sb.PointForce("A", fy=300.0)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3])
def test_modes_and_steps_of_an_orbit(accuracy):
    """Harmonics 1 to 4 beside 120 modes, each by its order, with a third of the modes of the default."""
    beam = coarse_beam(0.002)
    found = sb.periodic(beam, PUSH, 433.0, accuracy=accuracy, stability=False)
    true = true_error(found, sb.periodic(beam, PUSH, 433.0, modes=120, steps=1024, stability=False))
    orders = np.arange(1, 5)
    assert (true[1:] / orders).max() <= found.largest_mode_error <= accuracy, (true, found.mode_error)
    assert len(found.reduced.omega) <= 30 and len(found.time) <= 512


def test_more_modes_where_the_rule_has_few():
    """Beside a resonance those up to 16 times the load's frequency are told to be too few for 1e-3."""
    found = sb.periodic(coarse_beam(0.002), PUSH, 447.5, accuracy=1e-3, stability=False)
    assert len(found.reduced.omega) > 21 and found.largest_mode_error <= 1e-3


def test_what_is_given_rules():
    """Modes and steps that are given stay, and what is missing is said."""
    with pytest.warns(
        sb.AccuracyWarning, match="not within accuracy = 0.0001, most by what is left out .* 12"
    ):
        found = sb.periodic(coarse_beam(0.002), PUSH, 433.0, modes=12, accuracy=1e-4, stability=False)
    assert len(found.reduced.omega) == 12 and len(found.time) == 1664
    with pytest.warns(sb.AccuracyWarning, match="beyond 12 modes; leave guess out, whose modes these are"):
        sb.periodic(coarse_beam(0.002), PUSH, 433.0, guess=found, accuracy=1e-4, stability=False)
    with pytest.warns(
        sb.AccuracyWarning, match="lost in 64 steps a forcing period; give more than steps = 64"
    ):
        found = sb.periodic(rod(), [0.1], 1.1 / TURN, steps=64, accuracy=1e-3, stability=False)
    assert len(found.time) == 64


def test_of_a_reduced_model_only_steps_grow():
    """Both modes of two masses that meet a stop: the steps, until the true error is what is asked for."""
    found = sb.periodic(two_masses(), [0.2], 0.109, accuracy=1e-3, stability=False)
    true = true_error(found, sb.periodic(two_masses(), [0.2], 0.109, steps=2**16, stability=False))
    assert (true[1:] / np.arange(1, 5)).max() <= 1e-3 and len(found.time) > 512
    with pytest.warns(sb.AccuracyWarning, match="reduce the model to more modes"):
        sb.periodic(rod(6), [0.1], 1.1 / TURN, accuracy=1e-3, stability=False)


def test_accuracy_is_not_for_what_tells_no_errors():
    """Segments, a tolerance, the unreduced model, which has no modes."""
    for name, value in (("segments", 2), ("tolerance", 1e-3), ("reduction", None)):
        with pytest.raises(ValueError, match=f"accuracy .*{name}|accuracy = 0.001 is for the reduced model"):
            sb.periodic(coarse_beam(0.002), PUSH, 433.0, accuracy=1e-3, **{name: value})


def test_curves(tmp_path):
    """Followed once in the modes of their worst end or peak; gone on with from a file in its modes."""
    beam, file = coarse_beam(0.002), str(tmp_path / "curve.journal")
    asked = dict(accuracy=3e-3, stability=False)
    found = sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, **asked)
    fine = sb.frequency_response(beam, PUSH, 447.0, 447.8, modes=80, steps=1024, stability=False)
    assert 21 < len(found.reduced.omega) < 40 and found.largest_mode_error <= 3e-3
    assert found.peak("A").amplitude == pytest.approx(fine.peak("A").amplitude, rel=found.largest_mode_error)
    again = sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, resume=True, **asked)
    np.testing.assert_array_equal(again.point_amplitudes, found.point_amplitudes)
    with pytest.raises(ValueError, match="written with accuracy = 0.003, not 0.01"):
        sb.frequency_response(beam, PUSH, 447.0, 447.8, file=file, resume=True, **{**asked, "accuracy": 1e-2})


def test_bifurcations_are_not_located_where_the_error_is_above():
    """Two masses with a stop: it is between points of the curve, where it has it if none is asked."""
    system, range_of = two_masses(), (0.1085, 0.11)
    curve = sb.frequency_response(system, [0.2], *range_of, steps=512, accuracy=0.1)
    with pytest.warns(sb.AccuracyWarning, match="frequency_response: harmonics 1 to 4 are told to be"):
        blocked = sb.frequency_response(system, [0.2], *range_of, steps=512, accuracy=1e-7)
    assert len(curve.bifurcations) == 1 and blocked.bifurcations == () and not curve.unlocated
    places = blocked.unlocated.split(" are not located: ")[0].removeprefix("bifurcations ").split(", ")
    ends = [sorted(map(float, place.removeprefix("between ").split(" and "))) for place in places]
    for item in curve.bifurcations:
        assert any(low - 1e-6 <= item.own_value <= high + 1e-6 for low, high in ends), (item, ends)
    assert "are not located: harmonics" in repr(blocked)


def test_bifurcations_of_matrices_that_are_gone_on_with(tmp_path):
    """A resumed curve of matrices has the errors and the bifurcations of the run that it goes on with."""
    asked = dict(steps=512, accuracy=0.1, file=str(tmp_path / "curve.journal"))
    first = sb.frequency_response(two_masses(), [0.2], 0.1085, 0.11, **asked)
    again = sb.frequency_response(two_masses(), [0.2], 0.1085, 0.11, resume=True, **asked)
    np.testing.assert_array_equal(again.mode_error, first.mode_error)
    assert [b.own_value for b in again.bifurcations] == [b.own_value for b in first.bifurcations] != []


def test_two_tones():
    """Lines of each order beside 80 modes, which are 5e-4 from 120 in twice the steps."""
    load = sb.PointForce("A", fy=sb.Harmonic(100.0, 433.0) + sb.Harmonic(60.0, 61.7))
    frequencies, beam = (433.0, 61.7), coarse_beam(0.002)
    found = sb.quasi_periodic(beam, load, frequencies, accuracy=1e-2, stability=False)
    fine = sb.quasi_periodic(beam, load, frequencies, modes=80, steps=512, stability=False)
    sizes = {(m, n): abs(fine.line(m, n, "A")) for m in range(4) for n in range(-3, 4) if (m, n) > (0, 0)}
    least, errors = FAINT * max(sizes.values()), np.zeros(5)
    for (m, n), size in sizes.items():
        if (order := m + abs(n)) < 5:
            off = abs(found.line(m, n, "A") - fine.line(m, n, "A")) / max(size, least)
            errors[order] = max(errors[order], off / order)
    assert 1e-4 < errors.max() <= found.largest_mode_error <= 1e-2, (errors, found.mode_error)
    assert len(found.reduced.omega) < 20 and np.isnan(fine.mode_error).all()
    with pytest.warns(sb.AccuracyWarning, match="quasi_periodic: .* give more than modes = 6"):
        sb.quasi_periodic(beam, load, frequencies, modes=6, steps=192, accuracy=1e-3, stability=False)


def test_as_many_steps_as_by_default_are_not_begun_with_again():
    """Of a curve that begins in 256 steps and needs twice as many, 512: the default."""
    mass = one_mass(1.0, 3e-4, stiffness=0.02)
    first = mass.frequencies[0]
    curve = sb.frequency_response(mass, [9e-4], 0.97 * first, 1.1 * first, accuracy=5e-3, stability=False)
    assert curve.period.steps == 512 and curve.largest_mode_error <= 5e-3


def test_a_tone_that_the_samples_just_resolve():
    """The highest multiple of an even number of samples; errors of lines (0, -n) are those of (0, n)."""
    load = sb.PointForce("A", fy=sb.Harmonic(20.0, 433.0) + sb.Harmonic(60.0, 61.7) + sb.Harmonic(0.1, 493.6))
    asked = dict(modes=12, steps=192, accuracy=0.1, stability=False)
    with pytest.warns(sb.StepWarning):
        found = sb.quasi_periodic(coarse_beam(0.002), load, (433.0, 61.7), samples=16, **asked)
    assert found.mode_error[1] < found.mode_error[2] < 0.1
