"""Tractions on the faces of a tip element against closed-form fields, superposition and reciprocity."""

import numpy as np
import pytest
from scipy import linalg

from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.coefficients import SElementError, coefficient_matrices
from sbfem_petsc.selement.face_tractions import (
    bernstein,
    face_axis,
    face_tractions,
    opening_direction,
    single_face_directions,
)
from sbfem_petsc.selement.intensity import intensity_rows
from sbfem_petsc.selement.interior import radial_displacement
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon

ISOTROPIC = Material(1.0, 0.3, 1.0)
ORTHOTROPIC = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=30.0)
MATERIALS = pytest.mark.parametrize("material", [ISOTROPIC, ORTHOTROPIC], ids=["isotropic", "orthotropic"])
# The crack lies on the positive x axis, or a notch of 40 degrees about it; no symmetry.
CRACK = np.array([[1, 0], [1, 0.8], [-0.4, 1.1], [-1.2, -0.3], [-0.2, -0.9], [0.9, -0.8], [1, 0]]) / 1.3
NOTCH = CRACK.copy()
NOTCH[[0, -1], 1] = np.tan(np.radians(20.0)) * NOTCH[0, 0] * np.array([1.0, -1.0])
LEVELS = np.array([1.0, 0.6, 0.2, 0.01])


def resultant(tractions, force):
    """(d,): sum of the forces of each direction."""
    return force.reshape(len(tractions.lengths), -1).sum(axis=1)


def element(corners, order, material, modes=4, directions=None):
    shape = polygon(corners, order, closed=False)
    solved = solve_selement(Sectors(shape, order, material.elasticity), False, 0)
    tractions = face_tractions(
        Sectors(shape, order, material.elasticity),
        stiffness=solved.stiffness,
        radial=solved.radial,
        directions=directions,
        modes=modes,
    )
    form = intensity_rows(solved.radial_form, Sectors(shape, order, material.elasticity), face_axis(shape))
    return shape, solved, tractions, form


def both_faces():
    return np.concatenate([single_face_directions(0), single_face_directions(1)])


def face_normals(shape):
    first, last = (shape[i] / np.linalg.norm(shape[i]) for i in (0, -1))
    return np.array([[first[1], -first[0]], [-last[1], last[0]]])


@MATERIALS
@pytest.mark.parametrize("corners", [CRACK, NOTCH, CRACK[::-1] * [1, -1]], ids=["crack", "notch", "mirrored"])
@pytest.mark.parametrize("stress", np.eye(3), ids=["xx", "yy", "xy"])
def test_uniform_stress(corners, material, stress):
    """A uniform stress with its tractions on faces and edges is the exact linear displacement without stress
    intensity: nodal forces, field, means of the displacement, K.
    """
    order = 4
    shape, solved, tractions, form = element(corners, order, material, 3, both_faces())
    strain = np.linalg.solve(material.elasticity, stress)
    gradient = np.array([[strain[0], 0.5 * strain[2] + 0.3], [0.5 * strain[2] - 0.3, strain[1]]])
    u = (shape @ gradient.T).ravel()
    tensor = np.array([[stress[0], stress[2]], [stress[2], stress[1]]])
    force = tractions.uniform_force((face_normals(shape) @ tensor).ravel())
    scale = np.abs(u).max()
    c = coefficient_matrices(shape, order, False, material.elasticity)
    balance = solved.stiffness @ u - tractions.rows.T @ force - (c.e0 + c.e1.T) @ u
    assert np.abs(balance).max() < 1e-12 * scale
    field = radial_displacement(solved.radial, u[:, None], LEVELS, (tractions, force[:, None]))[..., 0]
    assert np.abs(field - LEVELS[:, None] * u).max() < 1e-11 * scale
    # u varies linearly along the faces: its weighted means are those of its ends
    ends = u[[0, 1, -2, -1]]
    expected = np.concatenate([tractions.initial_mean([0.0, 0.0, end, 0.0]) for end in ends])
    assert np.abs(tractions.rows @ u + tractions.flexibility @ force - expected).max() < 1e-12 * scale
    k = form.rows @ u + form.of_tractions(tractions) @ force
    assert np.abs(k).max() < 1e-11 * np.abs(form.rows).max() * scale
    np.testing.assert_allclose(
        tractions.traction(force, LEVELS), np.tile((face_normals(shape) @ tensor).ravel(), (4, 1)), atol=1e-13
    )


@pytest.mark.parametrize("power", [0, 1, 2, 3])
def test_polynomial_pressure(power):
    """Airy's function Re z^(t + 2): pressure proportional to x^t on the faces of a crack, which stay closed;
    2 G (u + i v) = -conj((t + 2) z^(t + 1)).
    """
    order = 5
    shape, solved, tractions, form = element(CRACK, order, ISOTROPIC, 4)
    z = shape @ [1.0, 1j]
    shear = ISOTROPIC.elasticity[2, 2]
    w = -np.conj((power + 2) * z ** (power + 1)) / (2.0 * shear)
    u = np.stack([w.real, w.imag], axis=1).ravel()
    length = tractions.lengths[0]
    pressure = -(power + 2) * (power + 1) * (length * LEVELS) ** power
    # coefficients of xi^t in Bernstein polynomials: sums to the pressure at the levels
    at = np.linspace(0.0, 1.0, 9)
    profile = -(power + 2) * (power + 1) * (length * at) ** power
    force = np.linalg.lstsq(bernstein(4, at), profile, rcond=None)[0] * length / 4
    np.testing.assert_allclose(tractions.traction(force, LEVELS)[:, 0], pressure, atol=1e-12)
    np.testing.assert_allclose(resultant(tractions, force), -(power + 2) * length ** (power + 1), rtol=1e-12)
    c = coefficient_matrices(shape, order, False, ISOTROPIC.elasticity)
    edges = ((power + 1) * c.e0 + c.e1.T) @ u
    assert np.abs(solved.stiffness @ u - tractions.rows.T @ force - edges).max() < 1e-11
    field = radial_displacement(solved.radial, u[:, None], LEVELS, (tractions, force[:, None]))[..., 0]
    assert np.abs(field - LEVELS[:, None] ** (power + 1) * u).max() < 1e-11
    assert np.abs(tractions.rows @ u + tractions.flexibility @ force).max() < 1e-12
    assert np.abs(form.rows @ u + form.of_tractions(tractions) @ force).max() < 1e-10


def test_pressure_on_one_face_has_a_logarithm():
    """Michell's r^2 theta: uniform pressure on one face of a crack; the displacement has r log r. theta is no
    polynomial along the edges: the error falls with the order.
    """
    shear, kappa = ISOTROPIC.elasticity[2, 2], (3.0 - 0.3) / 1.3
    b, a, d = 0.25 / np.pi, -0.5, -0.125 / np.pi  # unit pressure

    def exact(r, theta):
        radial = (kappa - 1.0) * (a + b * theta) - 2.0 * d * np.sin(2.0 * theta)
        hoop = -(kappa + 1.0) * b * np.log(r) - 2.0 * d * np.cos(2.0 * theta)
        turn = np.array([[np.cos(theta), -np.sin(theta)], [np.sin(theta), np.cos(theta)]])
        return (r / (2.0 * shear) * np.einsum("ijn,jn->in", turn, np.array([radial, hoop]))).T

    errors = []
    for order in (4, 8, 12):
        shape, solved, tractions, _ = element(CRACK, order, ISOTROPIC, 1, single_face_directions(0))
        r, theta = np.hypot(*shape.T), np.unwrap(np.arctan2(shape[:, 1], shape[:, 0]))
        u = exact(r, theta).reshape(-1, 1)
        force = tractions.uniform_force([0.0, 1.0])[:, None]
        field = radial_displacement(solved.radial, u, LEVELS, (tractions, force))[..., 0]
        errors.append(max(np.abs(f - exact(r * x, theta).ravel()).max() for x, f in zip(LEVELS, field)))
    assert errors[2] < 2e-7 * np.abs(u).max() and errors[2] < errors[1] / 30 < errors[0] / 900


@MATERIALS
@pytest.mark.parametrize("corners", [CRACK, NOTCH], ids=["crack", "notch"])
def test_superposition(corners, material):
    """Free body: K under pressure on the faces is K under the edge tractions of the uniform stress."""
    order = 5
    shape, solved, tractions, form = element(corners, order, material, 2, both_faces())
    tensor = np.array([[0.4, 0.7], [0.7, 1.0]])
    strain = np.linalg.solve(material.elasticity, [0.4, 1.0, 0.7])
    u = (shape @ np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]])).ravel()
    c = coefficient_matrices(shape, order, False, material.elasticity)
    edges = (c.e0 + c.e1.T) @ u
    pressure = -tractions.uniform_force((face_normals(shape) @ tensor).ravel())
    tension = form.rows @ np.linalg.lstsq(solved.stiffness, edges, rcond=1e-12)[0]
    pressed = form.rows @ np.linalg.lstsq(solved.stiffness, tractions.rows.T @ pressure, rcond=1e-12)[0]
    pressed += form.of_tractions(tractions) @ pressure
    assert np.abs(tension).min() > 0.1
    np.testing.assert_allclose(pressed, tension, rtol=1e-9)


@MATERIALS
@pytest.mark.parametrize("modes", [1, 2, 4, 8])
def test_closed_crack_under_compression(material, modes):
    """Uniform compression across a closed crack: pressure uniform, closed, no stress intensity."""
    order = 5
    shape, solved, tractions, form = element(CRACK, order, material, modes)
    strain = np.linalg.solve(material.elasticity, [0.0, -1.0, 0.0])
    u = (shape @ np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]])).ravel()
    c = coefficient_matrices(shape, order, False, material.elasticity)
    inverse = np.linalg.pinv(solved.stiffness, rcond=1e-10)
    free = inverse @ (c.e0 + c.e1.T) @ u
    delassus = tractions.rows @ inverse @ tractions.rows.T + tractions.flexibility
    force = np.linalg.solve(delassus, -tractions.rows @ free)
    np.testing.assert_allclose(tractions.traction(force, LEVELS)[:, 0], 1.0, atol=1e-9)
    np.testing.assert_allclose(resultant(tractions, force), tractions.lengths, rtol=1e-10)
    moved = free + inverse @ (tractions.rows.T @ force)
    assert (form.rows @ free)[0] < -0.1
    assert np.abs(form.rows @ moved + form.of_tractions(tractions) @ force).max() < 1e-9


def sliding_direction(shape):
    return np.array([face_axis(shape), -face_axis(shape)])


@pytest.mark.parametrize("corners", [CRACK, NOTCH], ids=["crack", "notch"])
def test_reflection(corners):
    """A mirrored element: its faces change sides, opening stays opening, sliding turns its sense in the
    frame of the element but not relative to its own first face.
    """
    order = 3
    directions = lambda shape: np.stack([opening_direction(shape), sliding_direction(shape)])
    shape = polygon(corners, order, closed=False)
    here = element(corners, order, ISOTROPIC, 3, directions(shape))[2]
    mirror = np.diag([1.0, -1.0])
    image = (shape @ mirror)[::-1]
    np.testing.assert_allclose(
        opening_direction(image), (opening_direction(shape) @ mirror)[::-1], atol=1e-14
    )
    np.testing.assert_allclose(
        sliding_direction(image), -(sliding_direction(shape) @ mirror)[::-1], atol=1e-14
    )
    there = element(corners[::-1] * [1, -1], order, ISOTROPIC, 3, directions(image))[2]
    turned = (there.rows.reshape(6, -1, 2) @ mirror)[:, ::-1].reshape(6, -1)
    sense = np.repeat([1.0, -1.0], 3)
    np.testing.assert_allclose(turned, sense[:, None] * here.rows, atol=1e-12)
    np.testing.assert_allclose(
        there.flexibility, np.outer(sense, sense) * here.flexibility, rtol=1e-9, atol=1e-12
    )


@MATERIALS
@pytest.mark.parametrize("order", [2, 5, 9])
def test_flexibility_and_rows(order, material):
    """Reciprocity at round-off, flexibility positive definite, unit translation and rotation of the first
    face measured exactly.
    """
    shape, _, tractions, _ = element(NOTCH, order, material, 5, both_faces())
    assert tractions.reciprocity < 2e-11
    assert np.abs(tractions.flexibility - tractions.flexibility.T).max() == 0.0
    assert np.linalg.eigvalsh(tractions.flexibility)[0] > 1e-5
    translation = tractions.rows @ np.tile([1.0, 0.0], len(shape))
    np.testing.assert_allclose(translation, np.repeat([1.0, 0.0, 1.0, 0.0], 5), atol=1e-12)
    rotation = tractions.rows @ np.stack([-shape[:, 1], shape[:, 0]], axis=1).ravel()
    ends = [-shape[0, 1], shape[0, 0], -shape[-1, 1], shape[-1, 0]]
    np.testing.assert_allclose(
        rotation, np.concatenate([tractions.initial_mean([0.0, 0.0, e, 0.0]) for e in ends]), atol=1e-12
    )


def test_initial_gap():
    """Means of linear and round gaps by quadrature with the polynomials, over the root of the distance."""
    tractions = element(NOTCH, 2, ISOTROPIC, 4)[2]
    root, weights = np.polynomial.legendre.leggauss(12)
    root, weights = 0.5 * (root + 1.0), 0.5 * weights
    for factors in ([0.3, 0.0, 0.9, 0.0], [0.0, 0.7, 0.0, -0.2]):
        gap = root[:, None] ** [0.0, 1.0, 2.0, 3.0] @ factors
        means = 4.0 * bernstein(4, root**2).T @ (weights * 2.0 * root * gap)
        np.testing.assert_allclose(tractions.initial_mean(factors), means, rtol=1e-13)


def test_violated_reciprocity_is_an_error():
    shape, solved, _, _ = element(CRACK, 3, ISOTROPIC)
    with pytest.raises(SElementError, match="reciprocity of its face tractions is violated"):
        face_tractions(
            Sectors(shape, 3, ISOTROPIC.elasticity),
            stiffness=solved.stiffness,
            radial=solved.radial * (1.0 + 1e-6),
        )
    with pytest.raises(ValueError, match="modes = 0 must be at least 1"):
        face_tractions(
            Sectors(shape, 3, ISOTROPIC.elasticity), stiffness=solved.stiffness, radial=solved.radial, modes=0
        )


@pytest.mark.parametrize("angles", [(0.0, 130.0, 235.0), (10.0, 190.0), (0.0, 90.0, 180.0, 270.0)])
def test_bodies_that_meet_at_one_centre(angles):
    """Cracks that branch, cross or cut through: several S-elements about one scaling centre press on one
    another along their faces. Under equal pressure from all sides the pressure between them is uniform.
    """
    order, modes = 3, 3
    bodies = len(angles)
    unit = lambda degrees: np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    blocks, rows, flexibility, ends = [], [], [], []
    for k, start in enumerate(angles):
        stop = angles[(k + 1) % bodies] + (360.0 if k == bodies - 1 else 0.0)
        corners = np.array([unit(start + t * (stop - start)) for t in np.linspace(0.0, 1.0, 4)])
        # normals of both faces point out of the body
        first, last = unit(start), unit(stop)
        directions = np.zeros((2, 2, 2))
        directions[0, 0], directions[1, 1] = [first[1], -first[0]], [-last[1], last[0]]
        shape, solved, tractions, _ = element(corners, order, ISOTROPIC, modes, directions)
        u = (shape * np.linalg.solve(ISOTROPIC.elasticity, [-1.0, -1.0, 0.0])[:2]).ravel()
        c = coefficient_matrices(shape, order, False, ISOTROPIC.elasticity)
        ends.append((c.e0 + c.e1.T) @ u)
        blocks.append(solved.stiffness)
        rows.append(tractions.rows)
        flexibility.append(tractions.flexibility)
    stiffness = linalg.block_diag(*blocks)
    # crack k lies between the last face of body k and the first one of the next; pressure pushes both back
    select = np.zeros((bodies * modes, 2 * bodies * modes))
    for k in range(bodies):
        crack = slice(k * modes, (k + 1) * modes)
        after = (k + 1) % bodies
        select[crack, (2 * k + 1) * modes : (2 * k + 2) * modes] = -np.eye(modes)
        select[crack, 2 * after * modes : (2 * after + 1) * modes] = -np.eye(modes)
    gap = select @ linalg.block_diag(*rows)
    self_flexibility = select @ linalg.block_diag(*flexibility) @ select.T
    system = np.block([[stiffness, -gap.T], [gap, self_flexibility]])
    right = np.concatenate([*ends, np.zeros(bodies * modes)])
    solution, *_ = np.linalg.lstsq(system, right, rcond=1e-11)
    assert np.abs(system @ solution - right).max() < 1e-11
    # L = 1: equal forces of the modes are a uniform pressure
    np.testing.assert_allclose(solution[len(stiffness) :], 1.0 / modes, atol=1e-9)
