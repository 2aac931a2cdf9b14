"""One tip element whose faces close a wedge, under the exact field of a wedge disclination.

With the angle alpha, r from the tip and the mouth at theta = 0: U = A r^2 ln r, A = E' alpha / (8 pi);
sigma_theta = A (2 ln r + 3), sigma_r = A (2 ln r + 1), no shear; u_r = A / E' (2 (1 - nu') r ln r - (1 + nu')
r), u_theta = 4 A theta r / E' (Volterra 1907; E' and nu' of plane stress or strain).
"""

import math

import numpy as np
import pytest

from sbfem_petsc.material import Material
from sbfem_petsc.selement.face_tractions import face_axis, face_tractions
from sbfem_petsc.selement.fracture import t_stress_row
from sbfem_petsc.selement.intensity import intensity_rows
from sbfem_petsc.selement.interior import radial_displacement
from sbfem_petsc.selement.points import locate, point_operators
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon

ALPHA, ORDER = 1e-3, 12
# About a tip with the mouth on +x, of unit length: a square, and a polygon without symmetry.
SQUARE = [(1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1), (1, 0)]
SKEW = [
    (1, 0),
    (1, 0.7),
    (0.5, 0.9),
    (-0.3, 1),
    (-0.9, 0.6),
    (-1, -0.2),
    (-0.6, -0.9),
    (0.1, -1),
    (1, -0.7),
    (1, 0),
]


class Disclination:
    """The exact field; E = 1."""

    def __init__(self, material):
        nu, strain = material.poisson, material.plane == "strain"
        self.stiffness, self.poisson = (1.0 / (1.0 - nu**2), nu / (1.0 - nu)) if strain else (1.0, nu)
        self.amplitude = self.stiffness * ALPHA / (8.0 * math.pi)

    def displacement(self, places, theta):
        r, scale = np.hypot(*places.T), self.amplitude / self.stiffness
        radial = scale * r * (2.0 * (1.0 - self.poisson) * np.log(r) - (1.0 + self.poisson))
        around = 4.0 * scale * theta * r
        c, s = np.cos(theta), np.sin(theta)
        return np.stack([radial * c - around * s, radial * s + around * c], axis=1)

    def stress(self, places):
        """(k, 3): xx, yy, xy."""
        r = np.hypot(*places.T)
        c, s = (places / r[:, None]).T
        one, two = (self.amplitude * (2.0 * np.log(r) + more) for more in (1.0, 3.0))
        return np.stack([one * c * c + two * s * s, one * s * s + two * c * c, (one - two) * s * c], axis=1)


class Case:
    """An element under the field: `u` on its boundary, `force` of the pressure ``-A (2 ln xi + 3)``."""

    def __init__(self, corners, plane, polynomials):
        material = Material(1.0, 0.3, 1.0, plane=plane)
        self.shape, self.exact = polygon(corners, ORDER, closed=False), Disclination(material)
        self.sectors = Sectors(self.shape, ORDER, material.elasticity)
        self.element = solve_selement(self.sectors, False)
        self.tractions = face_tractions(
            self.sectors,
            stiffness=self.element.stiffness,
            radial=self.element.radial,
            modes=polynomials,
            logarithm=True,
        )
        theta = np.unwrap(np.arctan2(self.shape[:, 1], self.shape[:, 0]))
        self.u = self.exact.displacement(self.shape, theta).ravel()
        # -2 ln xi is the mode 2 (xi - 1 - ln xi) less 2 (xi - 1), or twice -ln xi
        levels = np.linspace(0.1, 1.0, 2 * polynomials + 3)
        pressure = -self.exact.amplitude * (2.0 * np.log(levels) + 3.0)
        self.force = np.linalg.lstsq(self.tractions.shapes(levels), pressure, rcond=None)[0]


@pytest.fixture(
    scope="module",
    params=[
        (SQUARE, "stress", 4),
        (SQUARE, "strain", 2),
        (SQUARE, "stress", 1),
        (SKEW, "stress", 4),
        (SKEW, "strain", 12),
    ],
    ids=lambda given: f"{'square' if given[0] is SQUARE else 'skew'}-{given[1]}-{given[2]}",
)
def case(request):
    return Case(*request.param)


def test_no_stress_intensity(case):
    """K_I and K_II of the field are zero, to 1e-11 of A, where displacements alone leave more than A."""
    form = intensity_rows(case.element.radial_form, case.sectors, face_axis(case.shape))
    of_displacements = form.rows @ case.u
    found = of_displacements + form.of_tractions(case.tractions) @ case.force
    assert abs(of_displacements[0]) > case.exact.amplitude
    assert np.abs(found).max() < 1e-11 * case.exact.amplitude


def test_faces_close_the_wedge(case):
    """They come together by alpha r, in every weighted mean and everywhere on the faces."""
    means = case.tractions.rows @ case.u + case.tractions.flexibility @ case.force
    assert means == pytest.approx(-case.tractions.initial_mean([0.0, 0.0, ALPHA, 0.0]), rel=1e-9)
    levels = np.array([0.0, 1e-6, 1e-3, 0.1, 0.5, 1.0])
    inside = radial_displacement(
        case.element.radial, case.u[:, None], levels, (case.tractions, case.force[:, None])
    )[:, :, 0]
    assert inside[:, 1] - inside[:, -1] == pytest.approx(-ALPHA * levels, rel=1e-6, abs=1e-12 * ALPHA)


def test_pressure_and_its_resultant(case):
    levels = np.array([1e-9, 1e-3, 0.2, 1.0])
    pressure = case.tractions.traction(case.force, levels)[:, 0]
    assert pressure == pytest.approx(-case.exact.amplitude * (2.0 * np.log(levels) + 3.0), rel=1e-10)
    # int_0^1 -(2 ln xi + 3) dxi = -1
    assert case.force.sum() == pytest.approx(-case.exact.amplitude, rel=1e-10)


def test_stress_inside(case):
    places = np.array([[0.3, 0.2], [-0.01, 0.02], [-0.5, 0.0], [1e-4, -3e-4], [-2e-7, 1e-7]])
    operators = point_operators(
        case.element.radial,
        case.sectors,
        located=locate(case.shape, ORDER, False, places),
        closed=False,
        tractions=case.tractions,
    )
    found = operators.stress @ np.concatenate([case.u, case.force])
    assert np.abs(found - case.exact.stress(places)).max() < 1e-6 * case.exact.amplitude


def test_forces_on_the_boundary(case):
    """K u less what the pressure does are the nodal forces of the exact tractions."""
    found = case.element.stiffness @ case.u - case.tractions.rows.T @ case.force
    # virtual work in linear displacements
    x, y = case.shape.T
    motions = np.stack([x, 0 * x, 0 * y, y, y, x], axis=1).reshape(-1, 3, 2)
    work = np.einsum("nci,ni->c", motions, found.reshape(-1, 2))
    at, weight = np.polynomial.legendre.leggauss(40)
    exact = np.zeros(3)
    corners = case.shape[::ORDER]
    for first, last in zip(corners, corners[1:]):
        places = first + 0.5 * (at[:, None] + 1.0) * (last - first)
        normal = np.array([last[1] - first[1], first[0] - last[0]]) * 0.5  # times the half-length
        xx, yy, xy = case.exact.stress(places).T
        traction = np.stack([xx * normal[0] + xy * normal[1], xy * normal[0] + yy * normal[1]], axis=1)
        moved = np.stack([places[:, 0], 0 * at, 0 * at, places[:, 1], places[:, 1], places[:, 0]], axis=1)
        exact += np.einsum("q,qci,qi->c", weight, moved.reshape(-1, 3, 2), traction)
    assert np.abs(work - exact).max() < 1e-8 * case.exact.amplitude


def test_flexibility_is_positive(case):
    scale = np.sqrt(np.diag(case.tractions.flexibility))
    assert np.linalg.eigvalsh(case.tractions.flexibility / np.outer(scale, scale))[0] > 0.0


def test_no_t_stress(case):
    """Its stress along the crack has no limit: nan for the logarithm, as ever for the polynomials."""
    form = t_stress_row(case.element.radial_form, case.shape, case.sectors.elasticity, face_axis(case.shape))
    columns = form.of_tractions(case.tractions)
    assert np.isnan(columns[-1]) and np.isfinite(columns[:-1]).all()
