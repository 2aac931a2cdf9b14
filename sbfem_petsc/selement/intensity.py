"""Stress intensity factors from the singular radial modes of an open S-element with its scaling centre on a
tip.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from .basis import shape_functions
from .coefficients import SElementError, edge_nodes, strain_operators
from .face_tractions import FaceTractions

# Imaginary parts up to this are a double exponent that an unsymmetric, coarse element has split; a
# homogeneous tip has real ones.
_SPLIT = 0.05


@dataclass(frozen=True, eq=False)
class IntensityRows:
    """Stress intensity factors of a non-dimensional tip element as linear forms of its boundary
    displacements.

    Attributes
    ----------
    rows : (2, n) array
        K_I and K_II (opening and sliding of the faces) for boundary displacements in units of the size and
        stresses in units of the modulus; lengths in units of the size.
    exponents : (2,) array
        Exponents lambda of the displacement modes r^lambda that give K_I and K_II: 1/2 at a crack; nan where
        a wide notch has no such singularity.
    amplitudes : (s, n) array
        Amplitudes of the singular modes, c, for boundary displacements; ``xi c,xi = generator c``.
    generator : (s, s) array
    strength : (2, s) array
        K_I and K_II of the amplitudes at xi = 1: ``rows = strength @ amplitudes``.

    Notes
    -----
    In units: K_i (Pa m^(1 - lambda_i)) is ``E h^-lambda_i rows[i] @ u + h^-lambda_i / thickness columns[i] @
    force`` for displacements in m and, from `of_tractions`, forces on the faces in N.
    """

    rows: np.ndarray
    exponents: np.ndarray
    amplitudes: np.ndarray
    generator: np.ndarray
    strength: np.ndarray

    def of_tractions(self, tractions: FaceTractions) -> np.ndarray:
        """(2, m): what forces on the faces, in units of E h thickness, add to K_I and K_II at given boundary
        displacements.
        """
        inflow = self.amplitudes @ tractions.forcing
        identity = np.eye(len(self.generator))
        parts = [
            linalg.solve(p * identity - self.generator, inflow[:, i]) for i, p in enumerate(tractions.powers)
        ]
        return self.strength @ np.reshape(parts, inflow.T.shape).T @ tractions.monomials


def intensity_rows(
    radial: np.ndarray,
    shape: np.ndarray,
    order: int,
    elasticity: np.ndarray,
    axis: np.ndarray,
    isotropic: bool,
) -> IntensityRows:
    """Linear forms for K_I and K_II.

    Parameters
    ----------
    radial : (n, n) array
        A of the S-element.
    shape : (nodes, 2) array
        Boundary nodes about the tip, in units of the size.
    order : int
    elasticity : (3, 3) array
        D in units of the modulus.
    axis : (2,) array
        Unit vector from the tip to the mouth.
    isotropic : bool

    Notes
    -----
    ``K_i = sqrt(2 pi) lim r^(1 - lambda_i) sigma_i`` straight ahead of the tip, sigma_I normal to the axis,
    sigma_II shear. The space of the singular modes (0 < lambda < 1) is separated from the rest by an ordered
    Schur form and a Sylvester equation: the pair of a crack's modes shares the exponent 1/2, and an element
    without symmetry splits it into a complex pair that is close to 1/2 only to the accuracy of its edges. In
    isotropic materials that space is compared with Williams' modes of the notch in closed form, which loses
    no order; in others the stress is taken from it ahead of the tip.

    Raises
    ------
    SElementError
        If the exponents are complex by more than such a split.
    """
    n = len(radial)
    triangle, basis, count = linalg.schur(radial, output="real", sort=lambda re, im=0.0: 0.05 < re < 0.95)
    if count == 0:
        return IntensityRows(
            np.zeros((2, n)), np.full(2, np.nan), np.zeros((0, n)), np.zeros((0, 0)), np.zeros((2, 0))
        )
    singular, rest = triangle[:count, :count], triangle[count:, count:]
    mixing = linalg.solve_sylvester(singular, -rest, -triangle[:count, count:])
    amplitudes = basis[:, :count].T - mixing @ basis[:, count:].T  # (count, n): c from u(1)
    fields = basis[:, :count]
    if isotropic:
        strength, exponents = _williams_strength(shape, elasticity, axis, fields)
        return IntensityRows(strength @ amplitudes, exponents, amplitudes, singular, strength)
    values, modes = linalg.eig(singular)
    if np.abs(values.imag).max() > _SPLIT:
        raise SElementError(
            "the stresses at the tip oscillate (complex exponents): K_I and K_II are not defined"
        )
    if values.imag.any() or np.ptp(values.real) < 1e-6:
        values, modes = np.full(count, values.real.mean()), np.eye(count)
    else:
        values, modes = values.real, modes.real
    slopes = fields @ singular @ modes  # u,xi at xi = 1
    strength = _stress_strength(shape, order, elasticity, axis, values, fields @ modes, slopes)
    exponents = np.full(2, np.nan)
    for i in range(2):
        k = int(np.argmax(np.abs(strength[i])))
        if np.abs(strength[i, k]) > 1e-3 * np.abs(strength).max():
            exponents[i] = values[k]
    strength = linalg.solve(modes.T, strength.T).T
    return IntensityRows(strength @ amplitudes, exponents, amplitudes, singular, strength)


def _williams_strength(
    shape: np.ndarray, elasticity: np.ndarray, axis: np.ndarray, fields: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """K_I and K_II (2, count) of singular fields by least squares with the modes of Williams (1952) at the
    nodes, and their exponents (2,).

    In Muskhelishvili's form 2 mu (u + i v) = kappa phi - z conj(phi') - conj(psi) with phi = a z^lambda, psi
    = b z^lambda, the axes along and across the ligament; a = 1 (opening) or i (sliding), b from the free
    faces at theta = +-gamma.
    """
    ahead, normal = -axis, np.array([axis[1], -axis[0]])
    shear = elasticity[2, 2]
    kappa = 1.0 + 2.0 * shear / (elasticity[0, 1] + shear)  # plane stress and plane strain alike
    z = shape @ ahead + 1j * (shape @ normal)
    # the chain runs once around the tip, from face to face: theta follows it across the cut of the complex
    # power
    theta = np.unwrap(np.angle(z))
    theta -= 2.0 * np.pi * np.round(0.5 * (theta[0] + theta[-1]) / (2.0 * np.pi))
    gamma = 0.5 * float(theta[-1] - theta[0])
    exponents = np.array([_williams_exponent(gamma, 1.0), _williams_exponent(gamma, -1.0)])
    strength = np.zeros((2, fields.shape[1]))
    columns = []
    present = np.flatnonzero(np.isfinite(exponents))
    for i in present:
        exponent, a = exponents[i], (1.0, 1j)[i]
        phase, other = (exponent - 1.0) * gamma, (exponent + 1.0) * gamma
        sine = abs(np.sin(other)) > abs(np.cos(other))
        if i == 0:
            b = (
                -(exponent - 1.0) * np.sin(phase) / np.sin(other)
                if sine
                else -(exponent + 1.0) * np.cos(phase) / np.cos(other)
            )
            stress = exponent * (exponent + 1.0 + b)
        else:
            b = (
                -(exponent + 1.0) * np.sin(phase) / np.sin(other)
                if sine
                else -(exponent - 1.0) * np.cos(phase) / np.cos(other)
            )
            stress = exponent * (exponent - 1.0 + b)
        power = np.abs(z) ** exponent * np.exp(1j * exponent * theta)
        mode = (kappa * a * power - z * np.conj(a * exponent * power / z) - np.conj(a * b * power)) / (
            2.0 * shear
        )
        columns.append(np.concatenate([mode.real, mode.imag]) / (np.sqrt(2.0 * np.pi) * stress))  # unit K
    if columns:
        measured = np.concatenate(
            [
                np.tensordot(fields.reshape(-1, 2, fields.shape[1]), axis, axes=(1, 0))
                for axis in (ahead, normal)
            ]
        )
        strength[present] = linalg.lstsq(np.array(columns).T, measured)[0]
    return strength, exponents


def _williams_exponent(gamma: float, sign: float) -> float:
    """Lowest root of sin(2 lambda gamma) + sign lambda sin(2 gamma) = 0: opening (1) or sliding (-1) between
    faces at +-gamma; nan if not singular.
    """

    def faces(exponent: float) -> float:
        return np.sin(2.0 * exponent * gamma) + sign * exponent * np.sin(2.0 * gamma)

    low, high = 0.4, 0.95
    return float(optimize.brentq(faces, low, high, xtol=1e-15)) if faces(low) > 0.0 > faces(high) else np.nan


def _stress_strength(
    shape: np.ndarray,
    order: int,
    elasticity: np.ndarray,
    axis: np.ndarray,
    exponents: np.ndarray,
    fields: np.ndarray,
    slopes: np.ndarray,
) -> np.ndarray:
    """(2, count): K_I and K_II of each singular field u (n, count) with its u,xi from its stress straight
    ahead of the tip.
    """
    ahead = _stress_operator(shape, order, elasticity, -axis)
    normal = np.array([axis[1], -axis[0]])  # across the axis
    across = np.array([normal[0] ** 2, normal[1] ** 2, 2.0 * normal[0] * normal[1]])
    along = np.array(
        [-axis[0] * normal[0], -axis[1] * normal[1], -(axis[0] * normal[1] + axis[1] * normal[0])]
    )
    strength = np.zeros((2, len(exponents)))
    for k, exponent in enumerate(exponents):
        stress, distance = ahead(slopes[:, k], fields[:, k])
        strength[:, k] = (
            np.sqrt(2.0 * np.pi) * distance ** (1.0 - exponent) * np.array([across @ stress, along @ stress])
        )
    return strength


def _stress_operator(shape: np.ndarray, order: int, elasticity: np.ndarray, direction: np.ndarray):
    """Function (u,xi, u) at xi = 1 -> (stress (3,), distance) where the ray `direction` meets the boundary
    (mean of both edges at a vertex).
    """
    connectivity = edge_nodes(len(shape), order, closed=False)
    side = shape @ np.array([-direction[1], direction[0]])
    reach = shape @ direction
    tolerance = 1e-9
    hits = []
    for edge in connectivity:
        a, b = side[edge[0]], side[edge[-1]]
        if min(reach[edge[0]], reach[edge[-1]]) <= 0.0 or a > tolerance or b < -tolerance:
            continue
        low, high = -1.0, 1.0
        if abs(a) <= tolerance:
            high = low
        elif abs(b) <= tolerance:
            low = high
        for _ in range(60):
            middle = 0.5 * (low + high)
            value = float(shape_functions(order, [middle])[0][0] @ side[edge])
            low, high = (middle, high) if value < 0.0 else (low, middle)
        hits.append((edge, 0.5 * (low + high)))
    if not hits:
        raise SElementError("the ray ahead of the tip misses the boundary of the tip element")

    def evaluate(slope: np.ndarray, field: np.ndarray) -> tuple[np.ndarray, float]:
        stresses, distances = [], []
        for edge, eta in hits:
            values, derivatives = shape_functions(order, [eta])
            first, second, _ = strain_operators(shape[edge][None], values, derivatives)
            unknowns = (2 * edge[:, None] + np.arange(2)).ravel()
            stresses.append(
                elasticity
                @ (
                    first[0, 0].reshape(3, -1) @ slope[unknowns]
                    + second[0, 0].reshape(3, -1) @ field[unknowns]
                )
            )
            distances.append(np.linalg.norm(values[0] @ shape[edge]))
        return np.mean(stresses, axis=0), float(np.mean(distances))

    return evaluate
