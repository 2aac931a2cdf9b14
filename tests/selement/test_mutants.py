"""Signs, senses and quadratures that other tests would not miss."""

import numpy as np
import pytest

from meshing.gll import gll_nodes
from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement import coefficients
from sbfem_petsc.selement.congruence import placements
from sbfem_petsc.selement.face_tractions import face_axis, face_tractions
from sbfem_petsc.selement.fracture import t_stress_row
from sbfem_petsc.selement.intensity import intensity_rows
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_fracture import AXIS, NEARLY, STRONG, TIP, halved, lekhnitskii_crack
from tests.selement.test_solution import polygon


@pytest.mark.parametrize("angle", [20.0, 75.0, -40.0, 160.0])
@pytest.mark.parametrize("plane", ["stress", "strain"])
def test_sense_of_the_material_angle(angle, plane):
    """Under tension along axis 1, at `angle` counter-clockwise from x, the strain along it is 1 / E_1 in
    plane stress, and it is the stiffest direction in both plane states.
    """
    material = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=angle, plane=plane)
    compliance = np.linalg.inv(material.modulus * material.elasticity)

    def flexibility(degrees):
        c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        stress = np.array([c * c, s * s, c * s])
        return stress @ compliance @ stress

    if plane == "stress":
        assert flexibility(angle) == pytest.approx(1.0 / 14.0, rel=1e-12)
        assert flexibility(angle + 90.0) == pytest.approx(1.0, rel=1e-12)
    around = np.arange(angle - 90.0, angle + 90.0, 5.0)
    assert around[np.argmin([flexibility(a) for a in around])] == pytest.approx(angle)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("turn", [0.0, 1.1])
def test_intensity_of_placed_tips(mirrored, turn):
    """K, T and the K of face pressure of a turned, scaled, reflected copy: a reflection changes the sign of
    K_II, and the placement's rows give it in the copy's own frame.
    """
    order, size, thickness, material = 7, 0.013, 0.2, Material(7.0, 0.3, 1.0)
    shape = polygon(TIP, order, closed=False)
    u, exact, t = lekhnitskii_crack(shape, NEARLY.elasticity, 1.0, 0.5)
    c, s = np.cos(turn), np.sin(turn)
    move = np.array([[c, -s], [s, c]]) @ np.diag([1.0, -1.0 if mirrored else 1.0])
    outline, moved = shape @ move.T * size, u.reshape(-1, 2) @ move.T * size
    if mirrored:
        outline, moved = outline[::-1], moved[::-1]
    placement = placements(outline[None], order, False, True)[0]
    element = solve_selement(Sectors(placement.shape, order, material.elasticity), False)
    axis = face_axis(placement.shape)
    np.testing.assert_allclose(placement.rotation @ move @ AXIS, axis, atol=1e-12)
    form = intensity_rows(element.radial_form, Sectors(placement.shape, order, material.elasticity), axis)
    rows = form.placed(placement.rotation, placement.size, material.modulus)
    found = np.einsum("kni,ni->k", rows, moved[placement.permutation])
    # stresses of the field are those of unit modulus, lengths are scaled
    exact = exact * np.sqrt(size) * material.modulus * [1.0, -1.0 if mirrored else 1.0]
    np.testing.assert_allclose(found, exact, rtol=2e-4)
    t_row = t_stress_row(element.radial_form, placement.shape, material.elasticity, axis)
    t_found = np.sum(
        t_row.placed(placement.rotation, placement.size, material.modulus) * moved[placement.permutation]
    )
    assert t_found == pytest.approx(t * material.modulus, rel=2e-3)
    # closing the crack's faces by the pressure of a uniform stress leaves no stress intensity
    tractions = face_tractions(
        Sectors(placement.shape, order, material.elasticity),
        stiffness=element.stiffness,
        radial=element.radial,
        modes=1,
    )
    normal = placement.rotation.T @ [-axis[1], axis[0]]
    stress = 5.0 * np.outer(normal, normal)
    xx, yy, xy = np.linalg.solve(material.modulus * material.elasticity, stress[[0, 1, 0], [0, 1, 1]])
    uniform = outline[placement.permutation] @ np.array([[xx, 0.5 * xy], [0.5 * xy, yy]])
    force = tractions.uniform_force([-5.0]) * placement.size * thickness
    columns = form.placed_of_tractions(tractions, placement.rotation, placement.size, thickness)
    pressed = np.einsum("kni,ni->k", rows, uniform)
    assert np.abs(pressed).max() > 0.01
    np.testing.assert_allclose(pressed + columns @ force, 0.0, atol=1e-11)


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_exponents_of_a_symmetric_orthotropic_notch(angle):
    """A notch whose axis is a principal axis: the symmetric singular field gives K_I alone, with the exponent
    that the symmetric half of the S-element's radial equations has; the antisymmetric one K_II.
    """
    order, opening = 8, np.radians(25.0)
    corners = np.array([[-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]], float)
    corners[[0, -1], 1] = np.tan(opening) * np.array([-1.0, 1.0])
    shape = polygon(halved(corners / 1.5), order, closed=False)
    material = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=angle)
    element = solve_selement(Sectors(shape, order, material.elasticity), False)
    form = intensity_rows(element.radial_form, Sectors(shape, order, material.elasticity), AXIS)
    n = 2 * len(shape)
    mirror = np.eye(n).reshape(n // 2, 2, n // 2, 2)[::-1] * np.array([1.0, -1.0])[None, :, None, None]
    mirror = mirror.reshape(n, n)
    for i, sign in ((0, 1.0), (1, -1.0)):
        np.testing.assert_allclose(
            form.rows[i] @ mirror, sign * form.rows[i], atol=1e-8 * np.abs(form.rows[i]).max()
        )
        values, vectors = np.linalg.eigh(mirror)
        basis = vectors[:, values * sign > 0.0]
        own = np.linalg.eigvals(basis.T @ element.radial @ basis)
        own = own[(own.real > 0.05) & (own.real < 0.95)].real
        assert len(own) == 1
        assert form.exponents[i] == pytest.approx(own[0], abs=1e-5)
    assert abs(form.exponents[0] - form.exponents[1]) > 0.05


def test_quadrature_of_curved_edges(monkeypatch):
    """A quarter of the points more changes nothing; as few as straight edges need leave an error."""
    order = 4
    angles = np.concatenate(
        [a + 0.25 * np.pi * (1 + gll_nodes(order)[:-1]) for a in 0.5 * np.pi * np.arange(4)]
    )
    disc = 0.8 * np.stack([np.cos(angles), np.sin(angles)], axis=1) + [0.15, 0.1]

    def matrices():
        c = coefficients.coefficient_matrices(disc, order, True, STRONG.elasticity)
        return np.stack([c.e0, c.e1, c.e2, c.m0])

    chosen = matrices()
    monkeypatch.setattr(coefficients, "quadrature_points", lambda *a: 60)
    converged = matrices()
    assert np.abs(chosen - converged).max() < 1e-8 * np.abs(converged).max()
    monkeypatch.setattr(coefficients, "quadrature_points", lambda *a: order + 1)
    assert np.abs(matrices() - converged).max() > 1e-5 * np.abs(converged).max()
