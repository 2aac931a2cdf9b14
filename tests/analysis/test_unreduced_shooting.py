"""Shooting on the unreduced model, without a matrix, against the reduced one and against the linear
response.
"""

import numpy as np
import pytest

import sbfem_petsc as sb
from sbfem_petsc.continuation.search import Search
from tests.parallel import answer, on_ranks
from tests.reference import paper_beam

RATIOS = sb.rayleigh_factors(0.005, 1500.0, 9000.0)
LOAD = sb.PointForce("A", fy=300.0)


@pytest.fixture(scope="module")
def model():
    return sb.Model(
        paper_beam().mesh(order=3), sb.Material(young=70e9, poisson=0.33, density=2700), rayleigh=RATIOS
    )


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
        harmonics(sb.periodic(model, LOAD, 3000.0, steps=steps, reduction=None)) for steps in (257, 513)
    )
    limit = fine + (fine - coarse) / ((513 / 257) ** 2 - 1.0)
    distances = [
        np.linalg.norm(
            harmonics(sb.periodic(model, LOAD, 3000.0, steps=2048, modes=modes, stability=False)) - limit
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
    orbit = sb.periodic(model, LOAD, 3000.0, steps=128, reduction=None)
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


PROGRAM = """
import json
import sbfem_petsc as sb
from tests.reference import paper_beam
aluminium = sb.Material(young=70e9, poisson=0.33, density=2700)
rayleigh = sb.rayleigh_factors(0.005, 1500.0, 9000.0)
model = sb.Model(paper_beam().mesh(order=3), aluminium, rayleigh=rayleigh)
orbit = sb.periodic(model, sb.PointForce("A", fy=300.0), 3000.0, steps=65, reduction=None)
if model.comm.rank == 0:
    c = orbit.harmonics("A")[:4]
    print(json.dumps({"real": list(c.real), "imag": list(c.imag)}))
"""


@pytest.mark.long
def test_ranks_agree():
    """The linear solves' tolerance is what remains."""
    found = [answer(on_ranks(ranks, PROGRAM)) for ranks in (1, 3)]
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
