"""Stress intensity, T-stress, energy release rate and exponents of tips against closed forms: cracks in
isotropic, orthotropic and two materials, notches, cracks at an interface.
"""

import numpy as np
import pytest
from scipy import optimize

from sbfem_petsc.material import Material, OrthotropicMaterial
from sbfem_petsc.selement.coefficients import SElementError, coefficient_matrices
from sbfem_petsc.selement.face_tractions import face_axis, face_tractions, single_face_directions
from sbfem_petsc.selement.fracture import (
    dundurs,
    energy_release_rate,
    interface_energy_release_rate,
    t_stress_row,
)
from sbfem_petsc.selement.intensity import intensity_rows
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.singular_modes import TipSectors
from sbfem_petsc.selement.solution import solve_selement
from tests.selement.test_solution import polygon

ISOTROPIC = Material(1.0, 0.3, 1.0)
NEARLY = OrthotropicMaterial(1.0, 1.0001, 0.3, 0.5 / 1.3, 1.0, angle=30.0)
STRONG = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=30.0)
# An outline without symmetry around the tip at the origin; the crack runs along the negative x axis.
TIP = np.array([[-1, 0], [-1, -0.8], [0.4, -1.1], [1.2, 0.3], [0.2, 0.9], [-0.9, 0.8], [-1, 0]]) / 1.3
SQUARE = np.array([[-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]]) / np.sqrt(
    2
)
AXIS = np.array([-1.0, 0.0])
HALF_LENGTH = 4.0


def halved(corners):
    """The outline with a vertex in the middle of every edge."""
    middles = 0.5 * (corners[:-1] + corners[1:])
    return np.concatenate([np.stack([corners[:-1], middles], axis=1).reshape(-1, 2), corners[-1:]])


def lekhnitskii_crack(shape, elasticity, tension, shear):
    """Crack of half-length a in an infinite plate with the remote stresses given, its right tip at the origin
    (Sih, Liebowitz 1968): displacements at `shape`, (K_I, K_II), T.
    """
    s = np.linalg.inv(elasticity)
    mu = np.roots([s[0, 0], -2 * s[0, 2], 2 * s[0, 1] + s[2, 2], -2 * s[1, 2], s[1, 1]])
    mu = mu[mu.imag > 0.0]
    x, y = shape[:, 0] + HALF_LENGTH, shape[:, 1]
    # the first half of the chain is below the crack; a vanishing imaginary part keeps its side
    side = np.where(np.arange(len(x)) < len(x) // 2, -1e-300, 1e-300)
    u = np.zeros((len(x), 2))
    amplitudes = np.array([-mu[1] * tension - shear, mu[0] * tension + shear]) / (2.0 * (mu[0] - mu[1]))
    for root, amplitude in zip(mu, amplitudes):
        z = x + root.real * y + 1j * np.where(np.abs(y) < 1e-14, side, root.imag * y)
        potential = amplitude * (np.sqrt(z - HALF_LENGTH) * np.sqrt(z + HALF_LENGTH) - z)
        u[:, 0] += 2.0 * ((s[0, 0] * root**2 + s[0, 1] - s[0, 2] * root) * potential).real
        u[:, 1] += 2.0 * ((s[0, 1] * root + s[1, 1] / root - s[1, 2]) * potential).real
    strain = s @ [0.0, tension, shear]
    u += np.stack([strain[0] * x + strain[2] * y, strain[1] * y], axis=1)
    factor = np.sqrt(np.pi * HALF_LENGTH)
    t = tension * mu.prod().real + shear * mu.sum().real
    return u.ravel(), factor * np.array([tension, shear]), t


@pytest.mark.parametrize(
    "material, corners, order, bound",
    [
        (NEARLY, TIP, 5, 1.5e-3),
        (NEARLY, TIP, 9, 3e-6),
        (NEARLY, TIP, 13, 4e-9),
        (STRONG, SQUARE, 5, 1.2e-2),
        (STRONG, halved(SQUARE), 5, 4e-5),
        (STRONG, halved(SQUARE), 7, 6e-8),
        (STRONG, TIP, 9, 2e-3),
        (STRONG, TIP, 13, 4e-5),
    ],
)
def test_crack_in_an_infinite_plate(material, corners, order, bound):
    """K_I, K_II, T from the exact boundary displacements; bounds three times what is measured. The error
    of exact singular modes, .64 to 1.05 of that of K, tells it.
    """
    shape = polygon(corners, order, closed=False)
    element = solve_selement(Sectors(shape, order, material.elasticity), False)
    u, exact, t = lekhnitskii_crack(shape, material.elasticity, 1.0, 0.5)
    form = intensity_rows(element.radial_form, Sectors(shape, order, material.elasticity), AXIS)
    error = np.abs(form.rows @ u - exact).max() / np.linalg.norm(exact)
    assert error < bound
    np.testing.assert_array_equal(form.exponents, 0.5)
    assert 0.5 < error / np.linalg.norm(form.errors * exact / np.linalg.norm(exact)) < 1.5
    assert abs(t_stress_row(element.radial_form, shape, material.elasticity, AXIS).row @ u - t) < 10.0 * bound


@pytest.mark.parametrize(
    "angle", [0.0, 60.0, *(pytest.param(angle, marks=pytest.mark.long) for angle in (30.0, 90.0, 120.0))]
)
def test_energy_release_rate_of_a_moved_tip(angle):
    """-dPi/da at fixed boundary displacements by moving the scaling centre along the crack, orthotropic, in
    mixed mode, against the closed form with the exact K.
    """
    material = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=angle)
    order, step = 7, 2e-3
    shape = polygon(halved(SQUARE), order, closed=False)
    u, exact, _ = lekhnitskii_crack(shape, material.elasticity, 1.0, 0.5)

    def energy(distance):
        moved = solve_selement(Sectors(shape - [distance, 0.0], order, material.elasticity), False)
        return 0.5 * u @ moved.stiffness @ u

    slope = (8 * (energy(step) - energy(-step)) - (energy(2 * step) - energy(-2 * step))) / (12 * step)
    assert energy_release_rate(exact, material.elasticity, AXIS) == pytest.approx(-slope, rel=2e-6)


def test_isotropic_energy_release_rate():
    """Irwin's (K_I^2 + K_II^2) / E' in both plane states, whatever the crack's direction."""
    for plane, modulus in (("stress", 3.0), ("strain", 3.0 / (1.0 - 0.3**2))):
        material = Material(3.0, 0.3, 1.0, plane)
        for angle in (0.0, 1.0, 4.0):
            axis = np.array([np.cos(angle), np.sin(angle)])
            found = energy_release_rate([2.0, -0.7], material.modulus * material.elasticity, axis)
            assert found == pytest.approx((2.0**2 + 0.7**2) / modulus, rel=1e-9)


def edge_crack(ratio, height, order=12):
    """Plate of unit width, edge crack of length `ratio` at mid-height, as one S-element about the tip."""
    corners = np.array([[-1, 0], [-1, -1], [0, -1], [1, -1], [1, 0], [1, 1], [0, 1], [-1, 1], [-1, 0]], float)
    corners[:, 0] = np.where(corners[:, 0] < 0, -ratio, np.where(corners[:, 0] > 0, 1.0 - ratio, 0.0))
    corners[:, 1] *= height
    return polygon(halved(corners), order, closed=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "ratio, height, factor, t_stress",
    [
        (0.2, 1.0, 1.368040, None),
        (0.3, 1.0, 1.661122, None),
        (0.5, 1.0, 2.825465, None),
        (0.3, 2.0, None, -0.6103),
    ],
)
def test_edge_crack(ratio, height, factor, t_stress):
    """Edge crack under uniform tension: K at half-height = width of an independent prototype to its digits,
    T of Sham (1991) for a long strip. The same plate with its faces under pressure has the same K
    and T (superposition).
    """
    order = 12
    shape = edge_crack(ratio, height)
    element = solve_selement(Sectors(shape, order, ISOTROPIC.elasticity), False)
    axis = face_axis(shape)
    form = intensity_rows(element.radial_form, Sectors(shape, order, ISOTROPIC.elasticity), axis)
    t_form = t_stress_row(element.radial_form, shape, ISOTROPIC.elasticity, axis)
    # tension of the ends: the nodal forces of the uniform stress, without those on the sides
    strain = np.linalg.solve(ISOTROPIC.elasticity, [0.0, 1.0, 0.0])
    uniform = (shape * strain[:2]).ravel()
    c = coefficient_matrices(shape, order, False, ISOTROPIC.elasticity)
    ends = (c.e0 + c.e1.T) @ uniform
    inverse = np.linalg.pinv(element.stiffness, rcond=1e-11)
    u = inverse @ ends
    k = form.rows @ u
    if factor is not None:
        assert k[0] / np.sqrt(np.pi * ratio) == pytest.approx(factor, abs=2e-6)
    assert abs(k[1]) < 1e-8
    if t_stress is not None:
        assert t_form.row @ u == pytest.approx(t_stress, abs=6e-5)  # four digits are given
    tractions = face_tractions(
        Sectors(shape, order, ISOTROPIC.elasticity),
        stiffness=element.stiffness,
        radial=element.radial,
        modes=3,
    )
    force = tractions.uniform_force([1.0])
    pressed = inverse @ (tractions.rows.T @ force)
    assert np.abs(form.rows @ pressed + form.of_tractions(tractions) @ force - k).max() < 1e-8
    assert t_form.row @ pressed + t_form.of_tractions(tractions) @ force == pytest.approx(
        t_form.row @ u, abs=1e-8
    )


def test_t_stress_of_uniform_stress():
    """A uniform stress with its tractions on the faces: T is the stress along the crack, also where the
    tractions come face by face; a notch has none.
    """
    order = 4
    shape = polygon(TIP, order, closed=False)
    for material in (ISOTROPIC, STRONG):
        element = solve_selement(Sectors(shape, order, material.elasticity), False)
        tractions = face_tractions(
            Sectors(shape, order, material.elasticity),
            stiffness=element.stiffness,
            radial=element.radial,
            directions=np.concatenate([single_face_directions(0), single_face_directions(1)]),
            modes=3,
        )
        strain = np.linalg.solve(material.elasticity, [0.4, 1.0, 0.7])
        u = (shape @ np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]])).ravel()
        force = tractions.uniform_force([0.7, 1.0, -0.7, -1.0])
        form = t_stress_row(element.radial_form, shape, material.elasticity, AXIS)
        assert form.row @ u + form.of_tractions(tractions) @ force == pytest.approx(0.4, abs=1e-10)
    corners = TIP.copy()
    corners[[0, -1], 1] = [-0.3, 0.3]
    notch = polygon(corners, order, closed=False)
    element = solve_selement(Sectors(notch, order, ISOTROPIC.elasticity), False)
    assert t_stress_row(element.radial_form, notch, ISOTROPIC.elasticity, AXIS) is None


def williams_exponent(gamma, sign):
    """Root of Williams' (1952) equation of modes that open (1) or slide (-1) between faces at +-gamma."""
    return optimize.brentq(
        lambda x: np.sin(2.0 * x * gamma) + sign * x * np.sin(2.0 * gamma), 0.4, 0.95, xtol=1e-15
    )


@pytest.mark.parametrize("half_opening", [5.0, 20.0, 35.0])
def test_notch_exponents(half_opening):
    """Williams' closed form for isotropic notches; for orthotropic ones the closed form and the S-element's
    eigenvalues, two independent computations, and both exponents differ from the isotropic ones.
    """
    angle = np.radians(half_opening)
    corners = TIP.copy()
    corners[[0, -1], 1] = np.tan(angle) * np.abs(corners[0, 0]) * np.array([-1.0, 1.0])
    shape = polygon(halved(corners), 8, closed=False)
    exact = np.array([williams_exponent(np.pi - angle, sign) for sign in (1.0, -1.0)])
    sectors = TipSectors(shape, 8, ISOTROPIC.elasticity, AXIS)
    np.testing.assert_allclose(sectors.exponents(exact + [0.004, -0.003]), exact, atol=1e-10)
    for turn in (30.0, 90.0):
        material = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=turn)
        element = solve_selement(Sectors(shape, 8, material.elasticity), False)
        form = intensity_rows(element.radial_form, Sectors(shape, 8, material.elasticity), AXIS)
        own = np.linalg.eigvals(element.radial)
        own = np.sort(own[(own.real > 0.05) & (own.real < 0.95)].real)
        np.testing.assert_allclose(np.sort(form.exponents), own, atol=1e-5)
        assert np.abs(form.exponents - exact).max() > 1e-3


@pytest.mark.parametrize("opening", [0.0458366, 10.0, 40.0])
def test_isotropic_notch(opening):
    """Each of the two modes has the exponent of its own, also where they are as near to each other as at the
    paper's notch, by Williams' closed form; one opens, the other slides.
    """
    angle = np.radians(0.5 * opening)
    corners = TIP.copy()
    corners[[0, -1], 1] = np.tan(angle) * np.abs(corners[0, 0]) * np.array([-1.0, 1.0])
    sectors = Sectors(polygon(corners, 5, closed=False), 5, ISOTROPIC.elasticity)
    form = intensity_rows(solve_selement(sectors, False).radial_form, sectors, AXIS)
    exact = [williams_exponent(np.pi - angle, sign) for sign in (1.0, -1.0)]
    np.testing.assert_allclose(form.exponents, exact, rtol=0.0, atol=1e-12)
    assert np.diff(exact)[0] > 1e-4


def test_wide_orthotropic_notch():
    """A notch of 160 degrees about a principal axis has one singular mode: K_I alone."""
    angles = np.radians(np.linspace(-100.0, 100.0, 7))
    shape = polygon(np.stack([np.cos(angles), np.sin(angles)], axis=1), 8, closed=False)
    material = OrthotropicMaterial(14.0, 1.0, 0.3, 0.7, 1.0, angle=90.0)
    element = solve_selement(Sectors(shape, 8, material.elasticity), False)
    form = intensity_rows(element.radial_form, Sectors(shape, 8, material.elasticity), AXIS)
    own = np.linalg.eigvals(element.radial).real
    own = own[(own > 0.05) & (own < 0.95)]
    assert len(own) == 1 and form.exponents[0] == pytest.approx(own[0], abs=1e-6)
    assert np.isnan(form.exponents[1]) and not form.rows[1].any() and form.rows[0].any()


@pytest.mark.parametrize("order, corners", [(1, 4), (2, 3), (8, 7)])
@pytest.mark.parametrize("opening", [104.0, 120.0, 150.0])
def test_wide_isotropic_notch(opening, order, corners):
    """Beyond 102.6 degrees faces that slide have no singular mode (Williams): K_I alone, also of a tip
    element so coarse that its rotation counts among singular fields.
    """
    half = np.pi - 0.5 * np.radians(opening)
    angles = np.linspace(-half, half, corners)
    sectors = Sectors(
        polygon(np.stack([np.cos(angles), np.sin(angles)], axis=1), order, closed=False),
        order,
        ISOTROPIC.elasticity,
    )
    form = intensity_rows(solve_selement(sectors, False).radial_form, sectors, AXIS)
    exact = optimize.brentq(lambda x: np.sin(2.0 * x * half) + x * np.sin(2.0 * half), 0.4, 0.9, xtol=1e-15)
    assert form.exponents[0] == pytest.approx(exact, abs=1e-10)
    assert np.isnan(form.exponents[1]) and not form.rows[1].any() and form.rows[0].any()


STIFF, SOFT = (
    Material(1.0, 0.25, 1.0, "strain").elasticity,
    0.1 * Material(1.0, 0.35, 1.0, "strain").elasticity,
)


def interface_shape(order, corners=SQUARE):
    """The outline with material 2 (soft) in its lower half and material 1 (stiff) in its upper one."""
    half = (len(corners) - 1) // 2
    return polygon(corners, order, closed=False), np.array([SOFT] * half + [STIFF] * half)


def interface_crack(shape, tension, shear):
    """Crack of half-length a between two half-planes (England 1965; Rice, Sih 1965), right tip at the origin:
    displacements at `shape`, complex K, eps.
    """
    (g1, k1), (g2, k2) = ((d[2, 2], 1 + 2 * d[2, 2] / (d[0, 1] + d[2, 2])) for d in (STIFF, SOFT))
    c1, c2 = k1 / g1 + 1 / g2, k2 / g2 + 1 / g1
    eps = np.log(c1 / c2) / (2.0 * np.pi)
    a, p = HALF_LENGTH, tension - 1j * shear
    factor = -p * c1 * c2 / (c1 + c2)

    def power(z):
        return np.exp(1j * eps * (np.log(z + a) - np.log(z - a)))

    def integral(z):
        return factor * (z - np.sqrt(z - a) * np.sqrt(z + a) * power(z))

    def slope(z):
        return factor * (1.0 - (z - 2j * eps * a) * power(z) / (np.sqrt(z - a) * np.sqrt(z + a)))

    half = len(shape) // 2
    upper = np.arange(len(shape)) >= half  # the middle node lies on the interface
    x, y = shape[:, 0] + a, shape[:, 1]
    y = np.where(np.abs(y) < 1e-14, np.where(upper, 1e-300, -1e-300), y)
    z = x + 1j * y
    own, other = np.where(upper, c1, c2), np.where(upper, c2, c1)
    g, kappa = np.where(upper, g1, g2), np.where(upper, k1, k2)
    w = kappa * integral(z) / own - integral(z.conj()) / other - 2j * y * np.conj(slope(z) / own)
    u = np.stack([w.real, w.imag], axis=1) / (2.0 * g)[:, None]
    s1, s2 = np.linalg.inv(STIFF), np.linalg.inv(SOFT)
    along = (s1[0, 1] * tension - s2[0, 1] * tension) / s2[0, 0]  # sigma_xx below for one strain along x
    for inside, s, stress in ((upper, s1, [0.0, tension, shear]), (~upper, s2, [along, tension, shear])):
        e = s @ stress
        u[inside] += np.stack([e[0] * x + e[2] * y, e[1] * y], axis=1)[inside]
    k = (tension + 1j * shear) * (1.0 + 2j * eps) * np.sqrt(np.pi * a) * (2.0 * a) ** (-1j * eps)
    return u.ravel(), k, eps


@pytest.mark.parametrize(
    "order, corners, bound", [(5, SQUARE, 6e-4), (9, SQUARE, 4e-7), (7, halved(SQUARE), 2e-8)]
)
def test_interface_crack(order, corners, bound):
    """Exponents from Dundurs' beta, K at several reference lengths, and K under shear; bounds three times
    what is measured.
    """
    shape, elasticity = interface_shape(order, corners)
    element = solve_selement(Sectors(shape, order, elasticity), False)
    beta = dundurs((STIFF, SOFT))[1]
    eps = np.log((1.0 - beta) / (1.0 + beta)) / (2.0 * np.pi)
    for tension, shear in ((1.0, 0.0), (0.3, -1.0)):
        u, k, closed_form = interface_crack(shape, tension, shear)
        assert closed_form == pytest.approx(eps, rel=1e-12) and abs(eps) > 0.05
        for length in (0.01, 1.0, 2.0 * HALF_LENGTH):
            form = intensity_rows(
                element.radial_form, Sectors(shape, order, elasticity), AXIS, reference_length=length
            )
            assert form.oscillation == pytest.approx(abs(eps), abs=1e-9)
            exact = k * length ** (1j * eps)
            assert np.abs(form.rows @ u - [exact.real, exact.imag]).max() < bound * abs(k)
        np.testing.assert_array_equal(form.exponents, 0.5)
        assert form.errors.max() < bound


def test_interface_crack_turned_over():
    """The body mirrored about the crack: K_I stays, K_II changes its sign."""
    order = 5
    shape, elasticity = interface_shape(order)
    u, _, _ = interface_crack(shape, 1.0, 0.4)
    element = solve_selement(Sectors(shape, order, elasticity), False)
    here = intensity_rows(element.radial_form, Sectors(shape, order, elasticity), AXIS).rows @ u
    mirrored, flipped = (shape * [1, -1])[::-1], elasticity[::-1]
    image = (u.reshape(-1, 2) * [1, -1])[::-1].ravel()
    element = solve_selement(Sectors(mirrored, order, flipped), False)
    there = intensity_rows(element.radial_form, Sectors(mirrored, order, flipped), AXIS).rows @ image
    np.testing.assert_allclose(there, here * [1, -1], rtol=1e-8)


def test_interface_energy_release_rate():
    """-dPi/da by moving the tip along the interface, against Rice's closed form."""
    order, step = 8, 2e-3
    shape, elasticity = interface_shape(order, halved(SQUARE))
    u, k, _ = interface_crack(shape, 1.0, 0.4)

    def energy(distance):
        return (
            0.5 * u @ solve_selement(Sectors(shape - [distance, 0.0], order, elasticity), False).stiffness @ u
        )

    # vertices above and below the tip are on no interface: only those on the x axis carry one
    slope = (8 * (energy(step) - energy(-step)) - (energy(2 * step) - energy(-2 * step))) / (12 * step)
    found = interface_energy_release_rate([k.real, k.imag], np.array([STIFF, SOFT]))
    assert found == pytest.approx(-slope, rel=1e-6)
    with pytest.raises(SElementError, match="isotropic materials alone"):
        interface_energy_release_rate([1.0, 0.0], np.array([STIFF, STRONG.elasticity]))


@pytest.mark.parametrize("ratio", [0.1, 0.5, 3.0, 20.0])
def test_crack_that_ends_at_an_interface(ratio):
    """Zak and Williams (1963), in the form of He and Hutchinson (1989), for a crack normal to the interface:
    cos(s pi) = 2 (beta - alpha) / (1 + beta) (1 - s)^2 + (alpha + beta^2) / (1 - beta^2), stresses r^-s,
    Dundurs' parameters with the material ahead first; opening and sliding have the same exponent.
    """
    order = 8
    cracked = Material(1.0, 0.3, 1.0, "strain").elasticity
    ahead = ratio * Material(1.0, 0.2, 1.0, "strain").elasticity
    alpha, beta = dundurs((ahead, cracked))

    def equation(s):
        right = 2 * (beta - alpha) / (1 + beta) * (1 - s) ** 2 + (alpha + beta**2) / (1 - beta**2)
        return np.cos(np.pi * s) - right

    exponent = 1.0 - optimize.brentq(equation, 0.05, 0.95, xtol=1e-14)
    shape = polygon(SQUARE, order, closed=False)
    elasticity = np.array([cracked] * 2 + [ahead] * 4 + [cracked] * 2)
    element = solve_selement(Sectors(shape, order, elasticity), False)
    form = intensity_rows(element.radial_form, Sectors(shape, order, elasticity), AXIS)
    np.testing.assert_allclose(form.exponents, exponent, atol=1e-8)
    assert form.errors.max() < 1e-5 and form.oscillation == 0.0
    opening = (form.rows.reshape(2, -1, 2) * [1, -1])[:, ::-1].reshape(2, -1)
    np.testing.assert_allclose(opening, form.rows * [[1], [-1]], atol=1e-6 * np.abs(form.rows).max())


def test_t_stress_of_several_materials():
    shape, elasticity = interface_shape(3)
    element = solve_selement(Sectors(shape, 3, elasticity), False)
    with pytest.raises(SElementError, match="several materials is not one number"):
        t_stress_row(element.radial_form, shape, elasticity, AXIS)
