"""Shooting on the unreduced model, without a matrix, against the reduced one and against the linear
response.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.continuation.problems.driven_orbits import ParameterRange
from sbfem_petsc.continuation.problems.unreduced import UnreducedOrbits
from sbfem_petsc.continuation.search import Search
from sbfem_petsc.motion.preparation import PeriodSettings
from sbfem_petsc.motion.unreduced.period import prepare_unreduced
from tests.parallel import alone, answer, on_ranks
from tests.reference import paper_beam

RATIOS = sb.rayleigh_factors(1500.0, 0.005, 9000.0, 0.005)
LOAD = sb.PointForce("A", fy=300.0)


@pytest.fixture(scope="module")
def model():
    return sb.Model(paper_beam().mesh(order=3, tip_size=2e-4), sb.Material(70e9, 0.33, 2700), rayleigh=RATIOS)


def harmonics(orbit):
    return orbit.harmonics("A")[:7]


@pytest.mark.long
def test_open_crack_is_the_linear_response(model):
    """Without contact: the closed form in 160 modes, but for average acceleration's period error of (omega
    h)^2 / 12, magnified by mode 7 at 3006 Hz.
    """
    exact = harmonics(sb.periodic(model, LOAD, 3000.0, contact=False, modes=160, stability=False))[1]
    errors = []
    for steps in (65, 129):
        orbit = sb.periodic(model, LOAD, 3000.0, steps=steps, contact=False, reduction=None)
        found = harmonics(orbit)
        assert orbit.iterations == 1 or orbit.residuals[1] < 1e-3 * orbit.residuals[0]
        place, named = model.points["A"][0], orbit.displacement("A")
        assert np.abs(orbit.displacement(place) - named).max() < 1e-9 * np.abs(named).max()
        assert np.abs(found[2:]).max() < 1e-7 * np.abs(found[1])  # the linear solves' tolerance
        errors.append(abs(found[1] - exact) / abs(exact))
    magnified = (2 * np.pi / 129) ** 2 / 12 / model.damping_ratios(np.array([2 * np.pi * 3000.0]))[0]
    assert errors[1] < magnified and np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


@pytest.mark.long
def test_reduced_orbits_converge_to_the_unreduced_one(model):
    """The extrapolated unreduced orbit (second order in the step) and reduced ones with more and more modes:
    the distance falls to the extrapolation's own error.
    """
    coarse, fine = (
        harmonics(sb.periodic(model, LOAD, 3000.0, steps=steps, reduction=None)) for steps in (193, 385)
    )
    limit = fine + (fine - coarse) / ((385 / 193) ** 2 - 1.0)
    distances = [
        np.linalg.norm(
            harmonics(sb.periodic(model, LOAD, 3000.0, steps=1024, modes=modes, stability=False)) - limit
        )
        / np.linalg.norm(limit)
        for modes in (10, 20, 40, 80)
    ]
    assert distances[0] > 2.0 * distances[1] > 2.0 * distances[2] and distances[3] < 2e-4, distances
    assert np.abs(limit[2]) > 5e-3 * np.abs(limit[1])  # the crack breathes


@pytest.mark.long
def test_iterations_and_residual(model):
    """Newton's method ends as on the reduced model; a dozen linearised periods for each of its solves at
    most. An even number of steps is raised by one: what the steps do not resolve then turns its sign over the
    period, and Phi - 1 is not singular.
    """
    told: list[float] = []
    orbit = sb.periodic(model, LOAD, 3000.0, steps=128, reduction=None, progress=told.append)
    assert len(told) == orbit.iterations + 1 and told == sorted(told) and told[-1] == 1.0
    assert len(orbit.time) == 129 and orbit.stable is None and "stability not computed" in repr(orbit)
    assert (
        orbit.iterations <= 6
        and orbit.residuals[-1] < 1e-8 * orbit.residuals[0]
        and orbit.products <= 12 * orbit.iterations
    )
    assert (
        (orbit.contact_force >= 0.0).all()
        and (orbit.gap >= -1e-12).all()
        and orbit.contact_resultant.max() > 1000.0
    )


@pytest.mark.long
@pytest.mark.parametrize("opening", [0.0458366, 0.0])
def test_ends_at_rounding(opening):
    """A slender beam far below most of its modes, whose steps leave more to rounding than they do elsewhere:
    Newton's method ends there, beside 120 modes; of the closed notch the crack breathes.
    """
    beam, frequency = Beam(0.4, 0.005, (VNotch(0.08, 0.0025, opening),)), 300.0
    model = sb.Model(beam.mesh(order=3), sb.Material(70e9, 0.33, 2700), rayleigh=(5.0, 1e-6))
    load = sb.EdgeMotion("left", uy=sb.Harmonic(1e-6, frequency))
    orbit = sb.periodic(model, load, frequency, steps=129, reduction=None)
    exact = sb.periodic(model, load, frequency, modes=120, steps=1024, stability=False)
    assert orbit.path == "Newton" and orbit.products < 30 and orbit.iterations <= 4
    assert np.abs(harmonics(orbit) - harmonics(exact)).max() < 2e-4 * np.abs(harmonics(exact)[1])
    assert (orbit.contact_resultant.max() > 1.0) == (opening == 0.0)


PROGRAM = """
import json
import sbfem_petsc as sb
from tests.analysis.test_unreduced_shooting import narrow
model = narrow(0.1)
orbit = sb.periodic(model, sb.PointForce("A", fy=3e3), 1380.0, steps=49, reduction=None)
assert orbit.contact_resultant.max() > 1000.0
if model.comm.rank == 0:
    c = orbit.harmonics("A")[:4]
    print(json.dumps({"real": list(c.real), "imag": list(c.imag)}))
"""


@pytest.mark.long
def test_ranks_agree():
    """The linear solves' tolerance is what remains."""
    found = [alone(PROGRAM), answer(on_ranks(2, PROGRAM))]
    one, other = (np.array(f["real"]) + 1j * np.array(f["imag"]) for f in found)
    np.testing.assert_allclose(other, one, rtol=0, atol=1e-6 * np.abs(one).max())


def test_bad_input(model):
    undamped = sb.Model(
        paper_beam().mesh(order=3), sb.Material(young=70e9, poisson=0.33, density=2700), damping=0.002
    )
    with pytest.raises(ValueError, match="stiffness-proportional damping"):
        sb.periodic(undamped, LOAD, 3000.0, reduction=None)
    with pytest.raises(ValueError, match="jacobian = .differences. is for the reduced model"):
        sb.periodic(model, LOAD, 3000.0, reduction=None, jacobian="differences")
    for further in ({"stability": True}, {"search": Search()}):
        with pytest.raises(ValueError, match="(search|stability) = .* is for the reduced model"):
            sb.periodic(model, LOAD, 3000.0, reduction=None, **further)
    with pytest.raises(ValueError, match="search is for a reduced model with contact"):
        sb.periodic(model, LOAD, 3000.0, contact=False, search=Search())
    with pytest.raises(KeyError, match="point 'Q' does not exist"):
        sb.periodic(model, sb.PointForce("Q", fy=1.0), 3000.0, reduction=None)


# ---------------------------------------------------------------------- curves
def narrow(damping=0.003):
    """A beam whose crack closes on the way up its first resonance, so that the curve leans over."""
    shape = Beam(0.1, 0.02, (VNotch(0.04, 0.008, 0.5),))
    ratios = sb.rayleigh_factors(1000.0, damping, 9000.0, damping)
    material = sb.Material(young=70e9, poisson=0.33, density=2700)
    return sb.Model(shape.mesh(order=2, face_edges=2), material, rayleigh=ratios)


PUSH = sb.PointForce("A", fy=300.0)


def turns(curve):
    """Where a curve turns back: extremes of parabolas of the value over the amplitude."""
    value, height = curve.value, curve.amplitude("A")
    found = []
    for k in np.flatnonzero(np.diff(np.sign(np.diff(value)))) + 1:
        near = slice(k - 1, k + 2)
        bend, slope, _ = np.polyfit(height[near] - height[k], value[near] - value[k], 2)
        found.append(value[k] - 0.25 * slope**2 / bend)
    return np.array(found)


def test_a_short_curve_is_that_of_single_motions():
    """Each point is the motion that `periodic` finds by SNES, to the tolerances of both."""
    model = narrow()
    curve = sb.frequency_response(model, PUSH, 1300.0, 1330.0, steps=49, reduction=None, points=2)
    assert curve.reason == "2 points" and not curve.multipliers.shape[1] and curve.reduced is None
    for value, amplitude, peak in zip(curve.value, curve.amplitude("A"), curve.contact_peak):
        orbit = sb.periodic(model, PUSH, float(value), steps=49, reduction=None)
        assert amplitude == pytest.approx(orbit.amplitude("A"), rel=1e-6)
        assert peak == pytest.approx(orbit.contact_resultant.max(), rel=1e-6, abs=1e-9)
    with pytest.raises(ValueError, match="that of an unreduced model"):
        curve.orbit(0)


def test_derivative_with_the_frequency():
    """By a difference to one side, against the one to both, of second order."""
    period = prepare_unreduced("test", narrow(), PUSH, 1300.0, settings=PeriodSettings(steps=49))
    orbits = UnreducedOrbits(period, ParameterRange("frequency", 1300.0, 1330.0))
    u, step = np.append(orbits.driven(1300.0).linear_state, 1300.0), 0.01
    behind, ahead = (orbits.at(orbits.placed(u, 1300.0 + moved)).residual for moved in (-step, step))
    expected = (ahead - behind) / (2.0 * step)
    found = orbits.at(u).linear().column
    assert np.linalg.norm(found - expected) < 1e-3 * np.linalg.norm(expected)


@pytest.mark.long
def test_a_turn_is_that_of_the_reduced_model():
    """Down to a fold and back, beside that of 40 modes in 1024 exact steps: lower by what average
    acceleration makes a period of 49 steps longer, (omega h)^2 / 12, and up to two fifths more for the
    harmonics of contact.
    """
    model = narrow()
    curve = sb.frequency_response(model, PUSH, 1405.2, 1360.0, steps=49, reduction=None)
    exact = sb.frequency_response(model, PUSH, 1408.0, 1360.0, steps=1024, modes=40, stability=False)
    ((found,), (expected,)) = turns(curve), turns(exact)
    assert 0.8 < (1.0 - found / expected) / ((2.0 * np.pi / 49) ** 2 / 12.0) < 1.4


@pytest.mark.long
def test_over_the_load():
    """From no load at all: while the crack stays open the motion is proportional to the load."""
    model, push = narrow(0.1), sb.PointForce("A", fy=3e3)
    curve = sb.load_response(model, push, 1350.0, steps=49, reduction=None, largest_step=0.25)
    assert curve.complete and curve.value[0] == 0.0 and curve.amplitude("A")[0] == 0.0
    free = (curve.contact_peak == 0.0) & (curve.value > 0.0)
    ratio = curve.amplitude("A")[free] / curve.value[free]
    assert free.any() and np.ptp(ratio) < 1e-6 * ratio.max()
    assert curve.contact_peak[-1] > 1000.0
    orbit = sb.periodic(model, push, 1350.0, steps=49, reduction=None)
    assert curve.amplitude("A")[-1] == pytest.approx(orbit.amplitude("A"), rel=1e-6)


def test_what_curves_of_the_unreduced_model_have_not(model):
    for further in ({"stability": True}, {"guess": sb.periodic(model, LOAD, 3000.0, modes=4, steps=64)}):
        with pytest.raises(ValueError, match="(guess|stability) = .* is for the reduced model"):
            sb.frequency_response(model, LOAD, 3000.0, 3001.0, reduction=None, **further)
    with pytest.raises(ValueError, match="parameter = 'gap' is for the reduced model"):
        sb.load_response(model, LOAD, 3000.0, parameter="gap", reduction=None)
    with pytest.raises(ValueError, match="takes neither file nor guess nor reduction"):
        sb.frequency_response(model, LOAD, 3000.0, 3001.0, contact=False, reduction=None)
    with pytest.raises(TypeError, match="reduction = 'none' must be 'modes' or None"):
        sb.frequency_response(model, LOAD, 3000.0, 3001.0, reduction="none")
